/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/structure.h"

#include <string.h>

#include "builder/format/serialized.h"
#include "client/bvhctl/scene/structure_lavapipe.h"

static const enum structure_content portable_contents[] = {
    [PORTABLE_INDEXED_TRIANGLES] = CONTENT_TRIANGLES,
    [PORTABLE_TRIANGLES] = CONTENT_TRIANGLES,
    [PORTABLE_AABBS] = CONTENT_AABBS,
    [PORTABLE_INSTANCES] = CONTENT_INSTANCES,
};

static enum bvhd_status open_portable(struct structure *structure, struct bvhd_error *error)
{
    struct portable_view *view = &structure->view.portable;
    enum bvhd_status status = portable_open(structure->blob, structure->memory, view, error);
    if (status)
        return status;
    const struct portable_header *header = view->header;
    structure->target = TARGET_PORTABLE;
    structure->content = portable_contents[header->content];
    structure->primitive_count = header->primitive_count;
    structure->record_count = header->record_count;
    structure->geometries =
        memory_array(structure->memory, (uint64_t)header->geometry_count + 1, sizeof *structure->geometries);
    if (!structure->geometries)
        return bvhd_error_set(error, BVHD_NO_MEMORY, "geometries", "no memory for them");
    for (uint32_t i = 0; i < header->geometry_count; i++) {
        const struct portable_geometry *row = &view->geometries[i];
        structure->geometries[i] =
            (struct structure_geometry){i, row->flags, row->first_primitive, row->primitive_count};
    }
    structure->geometry_count = header->geometry_count;
    return BVHD_OK;
}

/* Blobs of native targets bear their driver's UUID, which nobody here knows. */
static enum bvhd_status open_native(struct structure *structure, struct bvhd_error *error)
{
    struct bvhd_error inner;
    enum bvhd_status status = structure_lavapipe_open(structure, &inner);
    if (status == BVHD_CORRUPT)
        return bvhd_error_set(error, status, inner.where, "%s, or this is the structure of another driver", inner.text);
    if (status && error)
        *error = inner;
    return status;
}

/* Without the name of ours at its begin, what disagrees with itself is most likely no structure at all. */
static enum bvhd_status read_header(struct bytes blob, struct serialized_header *ret_header, struct bvhd_error *error)
{
    struct bvhd_error inner;
    enum bvhd_status status = serialized_read(blob, ret_header, &inner);
    bool is_ours = blob.size >= sizeof portable_driver_uuid &&
                   !memcmp(blob.data, portable_driver_uuid, sizeof portable_driver_uuid);
    if (status == BVHD_CORRUPT && !is_ours)
        return bvhd_error_set(error, status, "header", "this is no structure, or a part of a driver's (%s: %s)",
                              inner.where, inner.text);
    if (status && error)
        *error = inner;
    return status;
}

enum bvhd_status structure_open(struct bytes blob, struct memory *memory, struct structure *ret_structure,
                                struct bvhd_error *error)
{
    struct structure structure = {.blob = blob, .memory = memory};
    struct serialized_header header;
    enum bvhd_status status = read_header(blob, &header, error);
    if (status)
        return status;
    bool is_portable = !memcmp(header.driver_uuid, portable_driver_uuid, sizeof header.driver_uuid);
    status = is_portable ? open_portable(&structure, error) : open_native(&structure, error);
    if (status)
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
    if (structure->target == TARGET_LAVAPIPE) {
        memcpy(ret_bounds, structure->view.lavapipe.bounds, sizeof structure->view.lavapipe.bounds);
        return;
    }
    const struct portable_header *header = structure->view.portable.header;
    memset(ret_bounds, 0, 6 * sizeof *ret_bounds);
    if (header->node_count)
        memcpy(ret_bounds, header->bounds, sizeof header->bounds);
}

uint32_t structure_triangle_count(const struct structure *structure)
{
    return structure->content == CONTENT_TRIANGLES ? structure->record_count : 0;
}

static void portable_triangle(const struct portable_view *view, uint32_t row, float ret_corners[3][3],
                              uint32_t *ret_primitive)
{
    if (view->header->content == PORTABLE_TRIANGLES) {
        const struct portable_triangle *triangle = (const struct portable_triangle *)view->records + row;
        memcpy(ret_corners[0], triangle->v0, sizeof triangle->v0);
        memcpy(ret_corners[1], triangle->v1, sizeof triangle->v1);
        memcpy(ret_corners[2], triangle->v2, sizeof triangle->v2);
        *ret_primitive = triangle->id & PORTABLE_ID_MASK;
        return;
    }
    const struct portable_indexed_triangle *triangle = (const struct portable_indexed_triangle *)view->records + row;
    for (int i = 0; i < 3; i++)
        memcpy(ret_corners[i], view->vertices + UINT64_C(3) * triangle->vertices[i], sizeof ret_corners[i]);
    *ret_primitive = triangle->id & PORTABLE_ID_MASK;
}

void structure_triangle(const struct structure *structure, uint32_t row, float ret_corners[3][3],
                        uint32_t *ret_primitive)
{
    if (structure->target == TARGET_PORTABLE) {
        portable_triangle(&structure->view.portable, row, ret_corners, ret_primitive);
        return;
    }
    const struct lavapipe_triangle triangle = lavapipe_triangle_at(&structure->view.lavapipe, row);
    memcpy(ret_corners, triangle.corners, sizeof triangle.corners);
    *ret_primitive = row;
}

uint32_t structure_instance_count(const struct structure *structure)
{
    return structure->content == CONTENT_INSTANCES ? structure->record_count : 0;
}

struct structure_instance structure_instance(const struct structure *structure, uint32_t row)
{
    if (structure->target == TARGET_LAVAPIPE)
        return structure_lavapipe_instance(structure, row);
    const struct portable_instance *record = (const struct portable_instance *)structure->view.portable.records + row;
    struct structure_instance instance = {.instance = record->instance, .bottom = record->handle};
    memcpy(instance.object_to_world, record->object_to_world, sizeof instance.object_to_world);
    return instance;
}
