/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/structure.h"

#include <string.h>

#include "builder/format/serialized.h"
#include "builder/traverse/motion.h"
#include "client/bvhctl/scene/target_reader.h"

/*
 * The header of a native blob names a driver's build, which no table here knows, so that every native reader tries it.
 */
static enum bvhd_status open_native(struct bytes blob, struct memory *memory, struct structure *structure,
                                    struct bvhd_error *error)
{
    struct bvhd_error inner = {0};
    enum bvhd_status status = BVHD_CORRUPT;
    for (int i = 0; i < TARGET_READER_COUNT && status == BVHD_CORRUPT; i++) {
        if (!target_readers[i]->is_native)
            continue;
        structure_close(structure);
        *structure = (struct structure){.blob = blob, .memory = memory, .target = target_readers[i]->target};
        status = target_readers[i]->open(structure, &inner);
    }
    if (status == BVHD_CORRUPT)
        return bvhd_error_set(error, status, inner.where, "%s, or this is the structure of another driver", inner.text);
    if (status != BVHD_OK && error)
        *error = inner;
    return status;
}

/* Returns the reader whose blobs begin with this UUID, or NULL. */
static const struct target_reader *find_reader(const uint8_t *driver_uuid)
{
    for (int i = 0; i < TARGET_READER_COUNT; i++) {
        const uint8_t *own = target_readers[i]->driver_uuid;
        if (own && !memcmp(driver_uuid, own, SERIALIZED_UUID_SIZE))
            return target_readers[i];
    }
    return NULL;
}

/* A header with wrong sizes and without one of our UUIDs most likely is not that of a structure; the error says so. */
static enum bvhd_status read_header(struct bytes blob, struct serialized_header *ret_header, struct bvhd_error *error)
{
    struct bvhd_error inner;
    enum bvhd_status status = serialized_read(blob, ret_header, &inner);
    bool is_ours = blob.size >= SERIALIZED_UUID_SIZE && find_reader(blob.data);
    if (status == BVHD_CORRUPT && !is_ours)
        return bvhd_error_set(error, status, "header",
                              "this is not a structure, or only a part of a driver's structure (%s: %s)", inner.where,
                              inner.text);
    if (status != BVHD_OK && error)
        *error = inner;
    return status;
}

enum bvhd_status structure_open(struct bytes blob, struct memory *memory, struct structure *ret_structure,
                                struct bvhd_error *error)
{
    struct structure structure = {.blob = blob, .memory = memory};
    struct serialized_header header;
    enum bvhd_status status = read_header(blob, &header, error);
    if (status != BVHD_OK)
        return status;
    const struct target_reader *reader = find_reader(header.driver_uuid);
    if (reader) {
        structure.target = reader->target;
        status = reader->open(&structure, error);
    } else {
        status = open_native(blob, memory, &structure, error);
    }
    if (status != BVHD_OK)
        structure_close(&structure);
    else
        *ret_structure = structure;
    return status;
}

void structure_close(struct structure *structure)
{
    if (!structure || !structure->memory)
        return;
    memory_free(structure->memory, structure->geometries);
    memory_free(structure->memory, structure->instance_rows);
    *structure = (struct structure){0};
}

void structure_bounds(const struct structure *structure, float ret_bounds[6])
{
    target_reader_find(structure->target)->bounds(structure, ret_bounds);
}

uint32_t structure_triangle_count(const struct structure *structure)
{
    return structure->content == CONTENT_TRIANGLES ? structure->record_count : 0;
}

void structure_triangle(const struct structure *structure, uint32_t row, float time, float ret_corners[3][3],
                        uint32_t *ret_primitive)
{
    target_reader_find(structure->target)->triangle(structure, row, time, ret_corners, ret_primitive);
}

uint32_t structure_round_count(const struct structure *structure)
{
    bool is_round = structure->content == CONTENT_SPHERES || structure->content == CONTENT_SWEPT_SPHERES;
    return is_round ? structure->record_count : 0;
}

struct structure_round structure_round(const struct structure *structure, uint32_t row)
{
    return target_reader_find(structure->target)->round(structure, row);
}

uint32_t structure_instance_count(const struct structure *structure)
{
    return structure->content == CONTENT_INSTANCES ? structure->record_count : 0;
}

struct structure_instance structure_instance(const struct structure *structure, uint32_t row)
{
    return target_reader_find(structure->target)->instance(structure, row);
}

void structure_instance_matrix(const struct structure_instance *instance, float time, float ret_matrix[12])
{
    struct portable_moving_instance record = {.motion = instance->motion};
    if (instance->motion == MOTION_STATIC) {
        memcpy(ret_matrix, instance->start, PORTABLE_MATRIX * sizeof *ret_matrix);
        return;
    }
    memcpy(record.start, instance->start, sizeof record.start);
    memcpy(record.end, instance->end, sizeof record.end);
    if (!motion_matrix(&record, time, ret_matrix))
        memset(ret_matrix, 0, PORTABLE_MATRIX * sizeof *ret_matrix);
}
