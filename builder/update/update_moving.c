/* SPDX-License-Identifier: Apache-2.0 */
/*
 * update_moving.c - updates of motion triangles and of motion instances. Vulkan has no rules of its own for them: both
 * ends of a motion may change, and so may the type of a motion instance.
 */
#include "builder/input/primitive.h"
#include "builder/update/update_triangles.h"

enum { FLOATS = 3, ENDS = 6 /* of a vertex: at one end, and at both */ };

static uint64_t active_triangles(const struct canonical_geometry *geometry, uint32_t first, uint32_t count)
{
    uint64_t found = 0;
    for (uint32_t i = 0; i < count; i++) {
        float corners[2][3][3];
        canonical_triangle_at(geometry, first + i, 0, corners[0]);
        canonical_triangle_at(geometry, first + i, 1, corners[1]);
        found |= (uint64_t)!update_any_nan(corners[0][0], 18) << i;
    }
    return found;
}

static bool has_nan(const struct canonical_geometry *geometry, size_t first, size_t count)
{
    return update_any_nan(canonical_positions(geometry, 0) + FLOATS * first, FLOATS * count) ||
           update_any_nan(canonical_positions(geometry, 1) + FLOATS * first, FLOATS * count);
}

/* Records of static triangles beside those that move have vertices with two equal places. */
static inline void find_triangle(const struct refit_records *records, uint32_t record, struct vec4_box ret_boxes[2])
{
    const void *written = records->written.records;
    const uint32_t *rows = ((const struct portable_indexed_triangle *)written)[record].vertices;
    for (int key = 0; key < 2; key++) {
        const float *at = records->vertices + (ptrdiff_t)FLOATS * key;
        ret_boxes[key] =
            update_triangles_box(at + ENDS * (size_t)rows[0], at + ENDS * (size_t)rows[1], at + ENDS * (size_t)rows[2]);
    }
}

static void triangle_boxes(const struct refit_records *records, uint32_t first, const uint8_t counts[8],
                           struct refit_node ret_leaves[2][8])
{
    update_key_boxes(records, first, counts, ret_leaves, find_triangle);
}

static bool is_active(const unsigned char *record)
{
    const uint32_t fields = canonical_record_fields(GEOMETRY_MOVING_INSTANCES, record);
    float numbers[2 * PORTABLE_SRT];
    memcpy(numbers, record + MOTION_RECORD_DATA, fields - MOTION_RECORD_DATA);
    return bytes_get64(record + fields + 8) != 0 &&
           !update_any_nan(numbers, (fields - MOTION_RECORD_DATA) / sizeof *numbers);
}

static uint64_t active_instances(const struct canonical_geometry *geometry, uint32_t first, uint32_t count)
{
    uint64_t found = 0;
    for (uint32_t i = 0; i < count; i++)
        found |= (uint64_t)is_active(geometry->instances + (size_t)MOTION_RECORD_STRIDE * (first + i)) << i;
    return found;
}

static bool write_instances(const struct refit_records *records, uint32_t first, unsigned count)
{
    const struct portable_moving_instance *source =
        (const struct portable_moving_instance *)records->source->records + first;
    uint32_t ids[REFIT_RECORDS_MAX];
    for (unsigned i = 0; i < count; i++)
        ids[i] = source[i].instance;
    return update_write(records, first, ids, count);
}

static inline void find_instance(const struct refit_records *records, uint32_t record, struct vec4_box ret_boxes[2])
{
    const void *written = records->written.records;
    const struct canonical *canonical = records->written.canonical;
    struct box boxes[2];
    primitive_key_boxes(canonical, canonical->geometries,
                        ((const struct portable_moving_instance *)written)[record].instance, boxes);
    for (int key = 0; key < 2; key++)
        ret_boxes[key] = vec4_box_from(&boxes[key]);
}

static void instance_boxes(const struct refit_records *records, uint32_t first, const uint8_t counts[8],
                           struct refit_node ret_leaves[2][8])
{
    update_key_boxes(records, first, counts, ret_leaves, find_instance);
}

const struct update_kind update_moving_triangles = {
    .version = 3,
    .describe = update_triangles_describe,
    .row_is_sound = update_triangles_row_is_sound,
    .rules = update_triangles_rules,
    .rule_count = UPDATE_TRIANGLES_RULES,
    .check = update_triangles_check,
    .active = active_triangles,
    .has_nan = has_nan,
    .write = update_triangles_copy,
    .key_boxes = triangle_boxes,
};

const struct update_kind update_moving_instances = {
    .version = 3,
    .row_is_sound = update_row_is_plain,
    .active = active_instances,
    .write = write_instances,
    .key_boxes = instance_boxes,
};
