/* SPDX-License-Identifier: Apache-2.0 */
/*
 * inputs.h - small valid requests of each kind, for tests that break or vary them. All data lie in the struct, which
 * must not be copied.
 */
#ifndef BVHD_TEST_INPUTS_H
#define BVHD_TEST_INPUTS_H

#include <stdbool.h>
#include <string.h>

#include "proto/base/geometry.h"

enum { INPUTS_RECORDS = 4, INPUTS_BOXES = 3, INPUTS_VERTICES = 9, INPUTS_MOTION_RECORDS = 5 };

struct test_input {
    struct build_input input;
    struct geometry geometries[2];
    struct reference references[3];
    float vertices[INPUTS_VERTICES][5]; /* xyz, a radius, and four bytes of other data */
    uint16_t indices[8];
    float transform[16]; /* the matrix begins at byte 16 */
    float boxes[INPUTS_BOXES][6];
    uint32_t records[INPUTS_RECORDS][16];
    float end_vertices[INPUTS_VERTICES][5]; /* as vertices, at t = 1 */
    uint32_t motion_records[INPUTS_MOTION_RECORDS][40];
    /* of inputs_micromap.h */
    struct micromap_usage usages[2];
    struct micromap_triangle micromap_triangles[2];
    unsigned char states[16]; /* or 4 x 4 texels */
    uint16_t micromap_indices[4];
    float coordinates[4][2];
};

static inline void inputs_start(struct test_input *test, uint32_t type, uint32_t geometry_count)
{
    memset(test, 0, sizeof *test);
    test->input.type = type;
    test->input.geometry_count = geometry_count;
    test->input.geometries = test->geometries;
    test->input.options.target = TARGET_PORTABLE;
}

/* Fills the vertices and the indices, the first two of which are before the range. */
static inline void inputs_fill_vertices(struct test_input *test)
{
    static const uint16_t indices[8] = {9, 9, 0, 1, 2, 2, 1, 3};
    for (int i = 0; i < INPUTS_VERTICES; i++)
        for (int k = 0; k < 5; k++)
            test->vertices[i][k] = (float)(i * i % 7) + 0.25f * (float)(k * (i + 1) % 5);
    memcpy(test->indices, indices, sizeof indices);
}

/*
 * Makes two geometries: two triangles with 16-bit indices from vertex 1 on and a transform, and three triangles without
 * indices.
 */
static inline void inputs_triangles(struct test_input *test)
{
    static const float transform[16] = {0, 0, 0, 0, 0, -2, 0, 1, 2, 0, 0, -1, 0, 0, 0.5f, 3};
    inputs_start(test, STRUCTURE_BOTTOM, 2);
    inputs_fill_vertices(test);
    memcpy(test->transform, transform, sizeof transform);
    test->geometries[0] = (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .flags = GEOMETRY_OPAQUE,
        .triangles = {.vertex_format = 106,
                      .max_vertex = 8,
                      .vertex_stride = 20,
                      .index_type = INDEX_UINT16,
                      .vertices = {(const unsigned char *)test->vertices, sizeof test->vertices},
                      .indices = {(const unsigned char *)test->indices, sizeof test->indices},
                      .transform = {(const unsigned char *)test->transform, sizeof test->transform}},
        .range = {.primitive_count = 2, .primitive_offset = 4, .first_vertex = 1, .transform_offset = 16},
    };
    test->geometries[1] = (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .triangles = {.vertex_format = 106,
                      .max_vertex = 8,
                      .vertex_stride = 20,
                      .index_type = INDEX_NONE,
                      .vertices = {(const unsigned char *)test->vertices, sizeof test->vertices}},
        .range = {.primitive_count = 3},
    };
}

/*
 * Makes the same with the flag MOTION, of which the first geometry moves and the second one stands still, if `mixed`;
 * else both move.
 */
static inline void inputs_motion_triangles_and(struct test_input *test, bool mixed)
{
    inputs_triangles(test);
    test->input.flags = BUILD_MOTION;
    for (int i = 0; i < INPUTS_VERTICES; i++)
        for (int k = 0; k < 5; k++)
            test->end_vertices[i][k] = test->vertices[i][k] + (float)(i % 3 - 1) + 0.5f * (float)k;
    for (int i = 0; i < (mixed ? 1 : 2); i++) {
        test->geometries[i].type = GEOMETRY_MOVING_TRIANGLES;
        test->geometries[i].triangles.end_vertices =
            (struct bytes){(const unsigned char *)test->end_vertices, sizeof test->end_vertices};
    }
}

static inline void inputs_motion_triangles(struct test_input *test)
{
    inputs_motion_triangles_and(test, false);
}

static inline void inputs_mixed_triangles(struct test_input *test)
{
    inputs_motion_triangles_and(test, true);
}

/* Makes one geometry of three boxes: a cube, a point, an inactive one. */
static inline void inputs_aabbs(struct test_input *test)
{
    static const float boxes[INPUTS_BOXES][6] = {
        {0, 1, 2, 3, 4, 5}, {-1, -1, -1, -1, -1, -1}, {__builtin_nanf(""), 0, 0, -1, -1, -1}};
    inputs_start(test, STRUCTURE_BOTTOM, 1);
    memcpy(test->boxes, boxes, sizeof boxes);
    test->geometries[0] = (struct geometry){
        .type = GEOMETRY_AABBS,
        .aabbs = {24, {(const unsigned char *)test->boxes, sizeof test->boxes}},
        .range = {.primitive_count = INPUTS_BOXES},
    };
}

/* Describes the vertices as spheres, with the 16-bit indices or without indices. */
static inline struct geometry_spheres inputs_ends(const struct test_input *test, bool indexed)
{
    struct geometry_spheres ends = {
        .vertex_format = 106,
        .radius_format = 100,
        .index_type = INDEX_NONE,
        .vertex_stride = 20,
        .radius_stride = 20,
        .vertices = {(const unsigned char *)test->vertices, sizeof test->vertices},
        .radii = {(const unsigned char *)&test->vertices[0][3], sizeof test->vertices - 3 * sizeof(float)},
    };
    if (indexed) {
        ends.index_type = INDEX_UINT16;
        ends.index_stride = sizeof(uint16_t);
        ends.indices = (struct bytes){(const unsigned char *)test->indices, sizeof test->indices};
    }
    return ends;
}

/* Makes two geometries: six spheres with 16-bit indices from vertex 1 on, and three spheres without indices. */
static inline void inputs_spheres(struct test_input *test)
{
    inputs_start(test, STRUCTURE_BOTTOM, 2);
    inputs_fill_vertices(test);
    test->geometries[0] = (struct geometry){
        .type = GEOMETRY_SPHERES,
        .flags = GEOMETRY_OPAQUE,
        .spheres = inputs_ends(test, true),
        .range = {.primitive_count = 6, .primitive_offset = 4, .first_vertex = 1},
    };
    test->geometries[1] = (struct geometry){
        .type = GEOMETRY_SPHERES,
        .spheres = inputs_ends(test, false),
        .range = {.primitive_count = 3},
    };
}

/*
 * Makes two geometries: six linear swept spheres in chains, with 16-bit indices from vertex 1 on, and three without
 * indices and caps.
 */
static inline void inputs_swept_spheres(struct test_input *test)
{
    inputs_start(test, STRUCTURE_BOTTOM, 2);
    inputs_fill_vertices(test);
    test->geometries[0] = (struct geometry){
        .type = GEOMETRY_SWEPT_SPHERES,
        .flags = GEOMETRY_OPAQUE,
        .swept_spheres = {inputs_ends(test, true), SWEPT_SUCCESSIVE, SWEPT_CAPS_CHAINED},
        .range = {.primitive_count = 6, .primitive_offset = 4, .first_vertex = 1},
    };
    test->geometries[1] = (struct geometry){
        .type = GEOMETRY_SWEPT_SPHERES,
        .swept_spheres = {inputs_ends(test, false), SWEPT_LIST, SWEPT_CAPS_NONE},
        .range = {.primitive_count = 3},
    };
}

static inline void inputs_set_record(struct test_input *test, int index, uint64_t reference, uint32_t flags)
{
    static const float matrix[12] = {1, 0, 0, 5, 0, 2, 0, 6, 0, 0, -3, 7};
    uint32_t *record = test->records[index];
    memcpy(record, matrix, sizeof matrix);
    record[12] = 0xff000000 | (uint32_t)(0x123450 + index);
    record[13] = flags << 24 | (uint32_t)(0x54321 + index);
    memcpy(record + 14, &reference, sizeof reference);
}

/*
 * Makes four instances of the handles 77, 0 (inactive), 55, 77; the table has 33, 55 and 77, the last with bounds only.
 */
static inline void inputs_instances(struct test_input *test)
{
    inputs_start(test, STRUCTURE_TOP, 1);
    inputs_set_record(test, 0, 77, INSTANCE_CULL_DISABLE);
    inputs_set_record(test, 1, 0, 0);
    inputs_set_record(test, 2, 55, INSTANCE_FORCE_OPAQUE);
    inputs_set_record(test, 3, 77, INSTANCE_FLIP_FACING | INSTANCE_FORCE_NO_OPAQUE);
    for (int i = 0; i < 3; i++)
        test->references[i] = (struct reference){.kind = REFERENCE_BLAS,
                                                 .handle = 33 + 22 * (uint64_t)i,
                                                 .has_key = i < 2,
                                                 .bounds = {{-1, -1, -1}, {1, 1, (float)(i + 1)}}};
    memset(&test->references[0].key, 0x33, sizeof(struct key));
    memset(&test->references[1].key, 0x55, sizeof(struct key));
    test->input.references = test->references;
    test->input.reference_count = 3;
    test->geometries[0] = (struct geometry){
        .type = GEOMETRY_INSTANCES,
        .instances = {{(const unsigned char *)test->records, sizeof test->records}},
        .range = {.primitive_count = INPUTS_RECORDS},
    };
}

/* Sets what all types of motion records have, which follows their numbers at `word` of the record. */
static inline void inputs_end_motion_record(struct test_input *test, int index, int word, uint64_t reference,
                                            uint32_t flags)
{
    uint32_t *record = test->motion_records[index] + word;
    record[0] = 0xff000000 | (uint32_t)(0x123450 + index);
    record[1] = flags << 24 | (uint32_t)(0x54321 + index);
    memcpy(record + 2, &reference, sizeof reference);
}

static inline void inputs_set_motion_record(struct test_input *test, int index, uint32_t type, uint64_t reference,
                                            uint32_t flags)
{
    static const float matrices[24] = {1, 0, 0, 5, 0, 2, 0, 6, 0, 0, -3, 7, 1.5f, 0, 0, 5, 0, 2, 0.5f, 6, 0, 0, -3, 8};
    /* From the identity to a turn by 180 degrees about z with a scale, a shear, a pivot and a translation. */
    static const float srts[32] = {1, 0, 0, 0, 1, 0, 0, 1, 0,  0, 0, 0, 1, 0, 0, 0,
                                   2, 1, 0, 0, 2, 0, 1, 2, -1, 0, 0, 1, 0, 4, 5, 6};
    uint32_t *record = test->motion_records[index];
    memset(record, 0, sizeof test->motion_records[index]);
    record[0] = type;
    if (type == MOTION_SRT)
        memcpy(record + 2, srts, sizeof srts);
    else
        memcpy(record + 2, matrices, type == MOTION_MATRIX ? sizeof matrices : sizeof matrices / 2);
    inputs_end_motion_record(test, index, type == MOTION_SRT ? 34 : type == MOTION_MATRIX ? 26 : 14, reference, flags);
}

/*
 * Makes five motion instances of the references of inputs_instances: a static one of 77, an inactive static one, a
 * matrix one of 55, a SRT one of 77, and an inactive SRT one.
 */
static inline void inputs_motion_instances(struct test_input *test)
{
    inputs_instances(test);
    test->input.flags = BUILD_MOTION;
    inputs_set_motion_record(test, 0, MOTION_STATIC, 77, INSTANCE_CULL_DISABLE);
    inputs_set_motion_record(test, 1, MOTION_STATIC, 0, 0);
    inputs_set_motion_record(test, 2, MOTION_MATRIX, 55, INSTANCE_FORCE_OPAQUE);
    inputs_set_motion_record(test, 3, MOTION_SRT, 77, INSTANCE_FLIP_FACING | INSTANCE_FORCE_NO_OPAQUE);
    inputs_set_motion_record(test, 4, MOTION_SRT, 0, 0);
    test->geometries[0] = (struct geometry){
        .type = GEOMETRY_MOVING_INSTANCES,
        .instances = {{(const unsigned char *)test->motion_records, sizeof test->motion_records}},
        .range = {.primitive_count = INPUTS_MOTION_RECORDS},
    };
}

#endif
