/* SPDX-License-Identifier: Apache-2.0 */
/*
 * trace_scene.h - structures of triangles, of spheres and of linear swept spheres, and rays through them, for tests of
 * tracing kernels. For one test program only, which includes unit.h before.
 */
#ifndef BVHD_TEST_TRACE_SCENE_H
#define BVHD_TEST_TRACE_SCENE_H

#include <math.h>

#include "builder/build.h"
#include "builder/input/prepare.h"
#include "builder/traverse/ray.h"
#include "tests/support/builder/builders.h"
#include "tests/support/random.h"

enum {
    SCATTERED = 1500,
    COPIES = 60,
    STRIP = 40,
    SLIVERS = 30,
    FIRST_GEOMETRY = 1000,
    TRIANGLES = SCATTERED + COPIES + STRIP + SLIVERS,
    RAYS = 4000,
};

static struct memory memory;
static float positions[TRIANGLES * 3][3];
static struct ray rays[RAYS];

/* Long and slim, each in a direction of its own: their normals are lost in products of floats. */
static void make_slivers(float (*corners)[3])
{
    struct random random = {13};
    for (int i = 0; i < SLIVERS; i++, corners += 3)
        for (int axis = 0; axis < 3; axis++) {
            float along = (float)random_between(&random, -4, 4);
            corners[0][axis] = (float)random_between(&random, -3, 3);
            corners[1][axis] = corners[0][axis] + along;
            corners[2][axis] = corners[0][axis] + along / 2 + (float)random_between(&random, -2e-3, 2e-3);
        }
}

/* Scattered triangles; one large one many times over; a strip whose triangles share their edges; slivers. */
static inline void make_triangles(void)
{
    struct random random = {7};
    for (int i = 0; i < SCATTERED * 3; i++)
        for (int axis = 0; axis < 3; axis++)
            positions[i][axis] =
                (float)random_between(&random, -1, 1) + (i % 3 ? positions[i - i % 3][axis] * 0.9f : 0);
    static const float copied[3][3] = {{-3, -3, 2.5f}, {3, -3, 2.5f}, {0, 4, 2.5f}};
    for (int i = 0; i < COPIES; i++)
        memcpy(positions[(SCATTERED + i) * 3], copied, sizeof copied);
    for (int i = 0; i < STRIP; i++)
        for (int k = 0; k < 3; k++) {
            float *corner = positions[(SCATTERED + COPIES + i) * 3 + k];
            corner[0] = (float)((i + k) / 2) * 0.2f - 4;
            corner[1] = (i + k) % 2 ? 1 : -1;
            corner[2] = -3;
        }
    make_slivers(&positions[(SCATTERED + COPIES + STRIP) * 3]);
}

/* From where the ray is to a place within a sliver. */
static void aim_at_sliver(struct ray *ray, int i)
{
    float(*corners)[3] = &positions[(SCATTERED + COPIES + STRIP + i % SLIVERS) * 3];
    for (int axis = 0; axis < 3; axis++)
        ray->direction[axis] =
            (corners[0][axis] * 0.2f + corners[1][axis] * 0.3f + corners[2][axis] * 0.5f) - ray->origin[axis];
}

/*
 * Half of them next to each other and nearly parallel, along edges of the strip too; half of them in all directions,
 * some to slivers.
 */
static inline void make_rays(void)
{
    struct random random = {11};
    for (int i = 0; i < RAYS; i++) {
        rays[i] = (struct ray){.tmax = i % 9 ? INFINITY : 5, .cull_mask = 0xff};
        bool is_parallel = i < RAYS / 2;
        for (int axis = 0; axis < 3; axis++) {
            rays[i].origin[axis] = is_parallel ? (axis == 2 ? 6 : 0) : (float)random_between(&random, -4, 4);
            rays[i].direction[axis] = (float)random_between(&random, -1, 1);
        }
        if (is_parallel) {
            rays[i].origin[0] = (float)(i % 50) * 0.1f - 4;
            rays[i].origin[1] = (float)(i / 50) * 0.1f - 2;
            rays[i].direction[0] = rays[i].direction[1] = 0;
            rays[i].direction[2] = -1;
        } else if (i % 8 == 0)
            aim_at_sliver(&rays[i], i);
    }
}

static uint32_t blobs_built;

static void build_geometries(const struct geometry *geometries, uint32_t count, uint32_t layout_flags,
                             struct bytes *ret_blob)
{
    struct bvhd_error error;
    struct canonical canonical;
    struct build_stats stats;
    unsigned char *blob;
    struct limits limits = limits_default();
    struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    const bool moves = geometries[count - 1].type == GEOMETRY_MOVING_TRIANGLES;
    struct build_input input = {.type = STRUCTURE_BOTTOM,
                                .flags = moves ? BUILD_MOTION : 0,
                                .geometry_count = count,
                                .geometries = geometries,
                                .options = {.quality = QUALITY_BALANCED,
                                            .target = TARGET_PORTABLE,
                                            .layout_flags = layout_flags,
                                            .builder = builders_turn(blobs_built++)}};
    assert_int_equal(prepare(&input, 0, &limits, &context, &canonical, &error), BVHD_OK);
    assert_int_equal(build(&canonical, &input.options, &context, &blob, &stats, &error), BVHD_OK);
    prepare_finish(&canonical, &memory);
    *ret_blob = (struct bytes){blob, stats.sizes.total};
}

static inline void build_blob(uint32_t layout_flags, struct bytes *ret_blob)
{
    struct geometry geometries[2];
    for (int i = 0; i < 2; i++)
        geometries[i] =
            (struct geometry){.type = GEOMETRY_TRIANGLES,
                              .triangles = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                                            .max_vertex = TRIANGLES * 3 - 1,
                                            .vertex_stride = 12,
                                            .index_type = INDEX_NONE,
                                            .vertices = {(const unsigned char *)positions, sizeof positions}},
                              .range = {.primitive_count = i ? TRIANGLES - FIRST_GEOMETRY : FIRST_GEOMETRY,
                                        .first_vertex = i ? 3 * FIRST_GEOMETRY : 0}};
    build_geometries(geometries, 2, layout_flags, ret_blob);
}

/* Spheres at the corners of the triangles, or linear swept spheres between pairs of them. */
static inline void build_round(uint32_t type, struct bytes *ret_blob)
{
    static float radii[TRIANGLES * 3];
    for (int i = 0; i < TRIANGLES * 3; i++)
        radii[i] = 0.05f + 0.03f * (float)(i % 7);
    const struct geometry_spheres spheres = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                                             .radius_format = VK_FORMAT_R32_SFLOAT,
                                             .index_type = INDEX_NONE,
                                             .vertex_stride = 12,
                                             .radius_stride = 4,
                                             .vertices = {(const unsigned char *)positions, sizeof positions},
                                             .radii = {(const unsigned char *)radii, sizeof radii}};
    struct geometry geometry = {.type = type, .range.primitive_count = TRIANGLES};
    if (type == GEOMETRY_SPHERES)
        geometry.spheres = spheres;
    else
        geometry.swept_spheres =
            (struct geometry_swept_spheres){spheres, .indexing_mode = SWEPT_LIST, .end_caps_mode = SWEPT_CAPS_CHAINED};
    build_geometries(&geometry, 1, 0, ret_blob);
}

/* The triangles, which move: each by a way of its own, and the first geometry not at all. */
static inline void build_moving(struct bytes *ret_blob)
{
    static float ends[TRIANGLES * 9];
    struct geometry geometries[2];
    const float *starts = (const float *)(const void *)positions;
    for (int i = 0; i < TRIANGLES * 9; i++)
        ends[i] = starts[i] + 0.5f * (float)((i / 9 + i % 3) % 5 - 2);
    for (int i = 0; i < 2; i++)
        geometries[i] =
            (struct geometry){.type = i ? GEOMETRY_MOVING_TRIANGLES : GEOMETRY_TRIANGLES,
                              .triangles = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                                            .max_vertex = TRIANGLES * 3 - 1,
                                            .vertex_stride = 12,
                                            .index_type = INDEX_NONE,
                                            .vertices = {(const unsigned char *)positions, sizeof positions}},
                              .range = {.primitive_count = i ? TRIANGLES - FIRST_GEOMETRY : FIRST_GEOMETRY,
                                        .first_vertex = i ? 3 * FIRST_GEOMETRY : 0}};
    geometries[1].triangles.end_vertices = (struct bytes){(const unsigned char *)ends, sizeof ends};
    build_geometries(geometries, 2, 0, ret_blob);
}

#endif
