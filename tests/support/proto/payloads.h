/* SPDX-License-Identifier: Apache-2.0 */
/* payloads.h - payloads of rows for tests: written, read back, compared, refused. */
#ifndef BVHD_TEST_PAYLOADS_H
#define BVHD_TEST_PAYLOADS_H

#include "tests/support/unit.h"

#include "proto/wire/rows.h"

/* The account of the rows that are read; a test that includes this header has one of its own. */
static struct memory payload_memory = {.limit = UINT64_MAX, .fail_after = -1};

struct payload {
    unsigned char *bytes;
    uint64_t size;
    struct rows_shape shape;
};

static inline struct payload payload_write(const struct build_input *input)
{
    struct payload payload = {
        .shape = {input->geometry_count, rows_geometry_size(input), input->reference_count, ROWS_REFERENCE_SIZE, NULL}};
    assert_true(rows_payload_size(input, &payload.size));
    payload.bytes = aligned_alloc(64, payload.size + 64 - payload.size % 64);
    assert_non_null(payload.bytes);
    memset(payload.bytes, 0xee, payload.size + 64 - payload.size % 64);
    rows_write(input, payload.bytes);
    assert_int_equal(payload.bytes[payload.size], 0xee);
    return payload;
}

static inline enum bvhd_status payload_read(const struct payload *payload, struct build_input *input,
                                            struct bvhd_error *error)
{
    return rows_read((struct bytes){payload->bytes, payload->size}, &payload->shape, 5, &payload_memory, input, error);
}

/* Reads a copy of exactly the payload's size, so that a sanitizer detects a read past the end. */
static inline void payload_refuse(const struct payload *payload, enum bvhd_status want, const char *where)
{
    struct payload exact = *payload;
    struct build_input input = {.type = 77, .geometry_count = 3, .reference_count = 4}, before = input;
    struct bvhd_error error;
    exact.bytes = malloc(payload->size + 1);
    memcpy(exact.bytes, payload->bytes, payload->size);
    exact.bytes = realloc(exact.bytes, payload->size ? payload->size : 1);
    assert_int_equal(payload_read(&exact, &input, &error), want);
    assert_string_equal(error.where, where);
    assert_memory_equal(&input, &before, sizeof input);
    assert_int_equal(payload_memory.live, 0);
    free(exact.bytes);
}

static inline void payload_compare_bytes(struct bytes a, struct bytes b)
{
    assert_int_equal(a.size, b.size);
    assert_int_equal(a.data == NULL, b.data == NULL);
    if (a.size > 0)
        assert_memory_equal(a.data, b.data, a.size);
}

static inline void payload_compare_spheres(const struct geometry_spheres *a, const struct geometry_spheres *b)
{
    assert_int_equal(a->vertex_format, b->vertex_format);
    assert_int_equal(a->radius_format, b->radius_format);
    assert_int_equal(a->index_type, b->index_type);
    assert_int_equal(a->vertex_stride, b->vertex_stride);
    assert_int_equal(a->radius_stride, b->radius_stride);
    assert_int_equal(a->index_stride, b->index_stride);
    payload_compare_bytes(a->vertices, b->vertices);
    payload_compare_bytes(a->radii, b->radii);
    payload_compare_bytes(a->indices, b->indices);
}

static inline void payload_compare_attached(const struct triangle_micromap *a, const struct triangle_micromap *b)
{
    assert_int_equal(a->is_given, b->is_given);
    assert_int_equal(a->index_type, b->index_type);
    assert_int_equal(a->stride, b->stride);
    assert_int_equal(a->base_triangle, b->base_triangle);
    assert_int_equal(a->has_usages, b->has_usages);
    assert_int_equal(a->micromap, b->micromap);
    payload_compare_bytes(a->indices, b->indices);
    payload_compare_bytes(a->usages, b->usages);
}

static inline void payload_compare_micromaps(const struct geometry_micromap *a, const struct geometry_micromap *b)
{
    assert_int_equal(a->stride, b->stride);
    payload_compare_bytes(a->usages, b->usages);
    payload_compare_bytes(a->states, b->states);
    payload_compare_bytes(a->triangles, b->triangles);
}

static inline void payload_compare_bakes(const struct geometry_bake *a, const struct geometry_bake *b)
{
    assert_int_equal(a->width, b->width);
    assert_int_equal(a->height, b->height);
    assert_int_equal(a->row_stride, b->row_stride);
    assert_int_equal(a->wrap_u, b->wrap_u);
    assert_int_equal(a->wrap_v, b->wrap_v);
    assert_int_equal(a->is_nearest, b->is_nearest);
    assert_int_equal(a->mode, b->mode);
    assert_memory_equal(&a->cutoff, &b->cutoff, sizeof a->cutoff);
    assert_int_equal(a->format, b->format);
    assert_int_equal(a->level, b->level);
    assert_int_equal(a->coordinate_stride, b->coordinate_stride);
    assert_int_equal(a->vertex_count, b->vertex_count);
    assert_int_equal(a->index_type, b->index_type);
    payload_compare_bytes(a->alpha, b->alpha);
    payload_compare_bytes(a->coordinates, b->coordinates);
    payload_compare_bytes(a->indices, b->indices);
}

static inline void payload_compare_geometries(const struct geometry *a, const struct geometry *b)
{
    assert_int_equal(a->type, b->type);
    assert_int_equal(a->flags, b->flags);
    assert_memory_equal(&a->range, &b->range, sizeof a->range);
    if (a->type == GEOMETRY_TRIANGLES || a->type == GEOMETRY_MOVING_TRIANGLES) {
        assert_int_equal(a->triangles.vertex_format, b->triangles.vertex_format);
        assert_int_equal(a->triangles.max_vertex, b->triangles.max_vertex);
        assert_int_equal(a->triangles.vertex_stride, b->triangles.vertex_stride);
        assert_int_equal(a->triangles.index_type, b->triangles.index_type);
        payload_compare_bytes(a->triangles.vertices, b->triangles.vertices);
        payload_compare_bytes(a->triangles.indices, b->triangles.indices);
        payload_compare_bytes(a->triangles.transform, b->triangles.transform);
        payload_compare_bytes(a->triangles.end_vertices, b->triangles.end_vertices);
        payload_compare_attached(&a->triangles.micromap, &b->triangles.micromap);
    } else if (a->type == GEOMETRY_AABBS) {
        assert_int_equal(a->aabbs.stride, b->aabbs.stride);
        payload_compare_bytes(a->aabbs.boxes, b->aabbs.boxes);
    } else if (a->type == GEOMETRY_INSTANCES || a->type == GEOMETRY_MOVING_INSTANCES) {
        payload_compare_bytes(a->instances.records, b->instances.records);
    } else if (a->type == GEOMETRY_SPHERES) {
        payload_compare_spheres(&a->spheres, &b->spheres);
    } else if (a->type == GEOMETRY_SWEPT_SPHERES) {
        payload_compare_spheres(&a->swept_spheres.ends, &b->swept_spheres.ends);
        assert_int_equal(a->swept_spheres.indexing_mode, b->swept_spheres.indexing_mode);
        assert_int_equal(a->swept_spheres.end_caps_mode, b->swept_spheres.end_caps_mode);
    } else if (a->type == GEOMETRY_MICROMAP) {
        payload_compare_micromaps(&a->micromap, &b->micromap);
    } else if (a->type == GEOMETRY_BAKED_MICROMAP) {
        payload_compare_bakes(&a->bake, &b->bake);
    }
}

static inline void payload_compare_references(const struct reference *a, const struct reference *b)
{
    assert_int_equal(a->kind, b->kind);
    assert_int_equal(a->handle, b->handle);
    assert_int_equal(a->moves, b->moves);
    assert_int_equal(a->has_key, b->has_key);
    if (a->has_key)
        assert_memory_equal(&a->key, &b->key, sizeof a->key);
    assert_memory_equal(&a->bounds, &b->bounds, sizeof a->bounds);
    assert_memory_equal(&a->slabs, &b->slabs, sizeof a->slabs);
}

#endif
