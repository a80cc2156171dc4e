/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sample_scene.h - small structures of every kind for targets that read structures: a bottom level of triangles, one of
 * boxes, and a top level over both, each portable and native; and portable ones of spheres, of linear swept spheres, of
 * motion triangles and of motion instances.
 */
#ifndef BVHD_FUZZ_SAMPLE_SCENE_H
#define BVHD_FUZZ_SAMPLE_SCENE_H

#include "tests/fuzz/fuzz.h"
#include "tests/support/builder/test_scene.h"

/* Points to the three structures of a scene, the bottom levels first. */
struct sample_structures {
    const struct batch_item *items[3];
};

/* Builds the scene, which the caller ends with test_scene_finish. */
static inline void sample_scene_init(struct test_scene *ret_scene)
{
    enum { TRIANGLES = 12, BOXES = 6 };
    static float corners[TRIANGLES][3][3], boxes[BOXES][6];
    static const struct test_instance instances[] = {
        {.transform = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .mask = 0xff, .bottom = 0},
        {.transform = {0, 1, 0, 0.5f, -1, 0, 0, 0, 0, 0, 2, 0}, .mask = 0x81, .flags = 2, .bottom = 1}};
    struct random random = {5};
    for (int i = 0; i < TRIANGLES * 9; i++)
        corners[i / 9][i / 3 % 3][i % 3] = (float)random_between(&random, -1, 1);
    for (int i = 0; i < BOXES * 3; i++) {
        boxes[i / 3][i % 3] = (float)random_between(&random, -1, 1);
        boxes[i / 3][3 + i % 3] = boxes[i / 3][i % 3] + 0.3f;
    }
    const struct geometry triangles = test_scene_triangles((const float(*)[3][3])corners, TRIANGLES, 0),
                          aabbs = test_scene_aabbs((const float(*)[6])boxes, BOXES, 0);
    test_scene_init_native(ret_scene, LAVAPIPE_PLAIN);
    test_scene_add(ret_scene, &triangles, 1, 0);
    test_scene_add(ret_scene, &aabbs, 1, 0);
    test_scene_add_top(ret_scene, instances, 2);
}

/* Builds bottom levels of spheres and of linear swept spheres, items 0 and 1. The caller ends the scene likewise. */
static inline void sample_scene_init_round(struct test_scene *ret_scene)
{
    enum { VERTICES = 16 };
    static const uint16_t indices[] = {0, 1, 2, 3, 4, 6, 7, 9, 10, 12, 14};
    static float vertices[VERTICES][4];
    struct random random = {6};
    for (int i = 0; i < VERTICES * 4; i++)
        vertices[i / 4][i % 4] = (float)random_between(&random, i % 4 == 3 ? 0 : -1, i % 4 == 3 ? 0.4 : 1);
    const struct geometry_spheres ends = {
        .vertex_format = 106,
        .radius_format = 100,
        .index_type = INDEX_UINT16,
        .vertex_stride = 16,
        .radius_stride = 16,
        .index_stride = 2,
        .vertices = {(const unsigned char *)vertices, sizeof vertices},
        .radii = {(const unsigned char *)&vertices[0][3], sizeof vertices - 12},
        .indices = {(const unsigned char *)indices, sizeof indices},
    };
    const uint32_t count = sizeof indices / sizeof *indices;
    const struct geometry spheres = {.type = GEOMETRY_SPHERES, .spheres = ends, .range.primitive_count = count};
    const struct geometry swept = {.type = GEOMETRY_SWEPT_SPHERES,
                                   .flags = GEOMETRY_OPAQUE,
                                   .swept_spheres = {ends, SWEPT_SUCCESSIVE, SWEPT_CAPS_CHAINED},
                                   .range.primitive_count = count};
    test_scene_init(ret_scene);
    test_scene_add(ret_scene, &spheres, 1, 0);
    test_scene_add(ret_scene, &swept, 1, 0);
}

/*
 * Builds a bottom level of motion triangles beside static ones, item 0, and a top level that has it as a motion
 * instance of each type, item TEST_SCENE_BOTTOMS. The caller ends the scene likewise.
 */
static inline void sample_scene_init_motion(struct test_scene *ret_scene)
{
    enum { TRIANGLES = 12 };
    static const float matrices[2][12] = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                                          {0, 1, 0, 0.5f, -1, 0, 0, 0, 0, 0, 2, 0}},
                       srts[2][16] = {{1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0},
                                      {2, 0.5f, 0, 0, 1, 0, 0, 1, 0.25f, 0.6f, 0, 0, -0.8f, 1, 0, 0}};
    static const uint32_t fields[4] = {UINT32_C(0xff000003), UINT32_C(0x02000000), 0x1000, 0};
    static float corners[2][TRIANGLES][3][3];
    static uint32_t records[MOTION_TYPES][MOTION_RECORD_STRIDE / 4];
    struct random random = {7};
    for (int i = 0; i < 2 * TRIANGLES * 9; i++)
        corners[i / 9 / TRIANGLES][i / 9 % TRIANGLES][i / 3 % 3][i % 3] = (float)random_between(&random, -1, 1);
    struct geometry geometries[2];
    for (int i = 0; i < 2; i++)
        geometries[i] = test_scene_triangles((const float(*)[3][3])corners[i], TRIANGLES, 0);
    geometries[0].type = GEOMETRY_MOVING_TRIANGLES;
    geometries[0].triangles.end_vertices = geometries[1].triangles.vertices;
    for (uint32_t type = 0; type < MOTION_TYPES; type++) {
        const size_t size = type == MOTION_STATIC   ? sizeof *matrices
                            : type == MOTION_MATRIX ? sizeof matrices
                                                    : sizeof srts;
        uint32_t *numbers = records[type] + MOTION_RECORD_DATA / 4;
        records[type][0] = type;
        memcpy(numbers, type == MOTION_SRT ? srts[0] : matrices[0], size);
        memcpy(numbers + size / 4, fields, sizeof fields);
    }
    test_scene_init(ret_scene);
    ret_scene->flags = BUILD_MOTION;
    test_scene_add(ret_scene, geometries, 2, 0);
    test_scene_add_motion_top(ret_scene, (const unsigned char *)records, MOTION_TYPES);
}

static inline struct sample_structures sample_scene_structures(const struct test_scene *scene, bool native)
{
    const struct batch_item *from = native ? scene->native_items : scene->items;
    return (struct sample_structures){{&from[0], &from[1], &from[TEST_SCENE_BOTTOMS]}};
}

#endif
