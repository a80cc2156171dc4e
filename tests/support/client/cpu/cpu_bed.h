/* SPDX-License-Identifier: Apache-2.0 */
/*
 * cpu_bed.h - a scene of triangles, boxes and instances in both targets, and rays through it, for tests of bvhd_cpu.h.
 * For unit tests only.
 */
#ifndef BVHD_CPU_BED_H
#define BVHD_CPU_BED_H

#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include <bvhd/bvhd_cpu.h>

#include "client/library.h"
#include "tests/support/builder/test_scene.h"

enum { CPU_BED_TRIANGLES = 60, CPU_BED_BOXES = 40, CPU_BED_INSTANCES = 40, CPU_BED_BOTTOMS = 2, CPU_BED_BLOBS = 3 };

struct cpu_bed {
    float corners[CPU_BED_TRIANGLES][3][3];
    float boxes[CPU_BED_BOXES][6];
    struct test_instance instances[CPU_BED_INSTANCES];
    struct test_scene scene;
    bool is_native;
    struct bvhd_cpu_blob blobs[CPU_BED_BLOBS]; /* triangles, half of them opaque; boxes; the top level */
};

static inline void cpu_bed_fill(struct cpu_bed *bed, struct random *random)
{
    for (int i = 0; i < CPU_BED_TRIANGLES; i++)
        for (int k = 0; k < 9; k++)
            bed->corners[i][k / 3][k % 3] = (float)random_between(random, -1, 1);
    for (int i = 0; i < CPU_BED_BOXES; i++)
        for (int axis = 0; axis < 3; axis++) {
            bed->boxes[i][axis] = (float)random_between(random, -1, 1);
            bed->boxes[i][3 + axis] = bed->boxes[i][axis] + (float)random_between(random, 0, 0.3);
        }
    for (uint32_t i = 0; i < CPU_BED_INSTANCES; i++) {
        bed->instances[i] = (struct test_instance){.custom_index = 0xabc000 + i,
                                                   .mask = i % 5 ? 0xff : 1u << (i % 8),
                                                   .sbt_offset = 0x123000 + i,
                                                   .flags = i % 4,
                                                   .bottom = i % CPU_BED_BOTTOMS};
        test_scene_transform(random, 0.3, 1, bed->instances[i].transform);
    }
}

static inline void cpu_bed_init(struct cpu_bed *bed, bool is_native)
{
    struct random random = {17};
    cpu_bed_fill(bed, &random);
    const float(*corners)[3][3] = (const float(*)[3][3])bed->corners;
    const struct geometry triangles[2] = {
        test_scene_triangles(corners, CPU_BED_TRIANGLES / 2, GEOMETRY_OPAQUE),
        test_scene_triangles(corners + CPU_BED_TRIANGLES / 2, CPU_BED_TRIANGLES / 2, 0)};
    const struct geometry boxes = test_scene_aabbs((const float(*)[6])bed->boxes, CPU_BED_BOXES, 0);
    test_scene_init_native(&bed->scene, LAVAPIPE_COMPACTED);
    test_scene_add(&bed->scene, triangles, 2, 0);
    test_scene_add(&bed->scene, &boxes, 1, 0);
    test_scene_add_top(&bed->scene, bed->instances, CPU_BED_INSTANCES);
    bed->is_native = is_native;
    for (int i = 0; i < CPU_BED_BLOBS; i++) {
        int row = i < CPU_BED_BOTTOMS ? i : TEST_SCENE_BOTTOMS;
        const struct batch_item *item = is_native ? &bed->scene.native_items[row] : &bed->scene.items[row];
        bed->blobs[i] = (struct bvhd_cpu_blob){item->blob, item->size};
    }
}

static inline void cpu_bed_finish(struct cpu_bed *bed)
{
    test_scene_finish(&bed->scene);
    assert_int_equal(library_memory.live, 0);
}

static inline enum bvhd_status cpu_bed_try(const struct bvhd_cpu_blob *blobs, uint32_t count, const uint64_t *handles,
                                           struct bvhd_cpu_scene **ret_scene, struct bvhd_error *error)
{
    const struct bvhd_cpu_scene_options options = {
        .struct_size = sizeof options, .blobs = blobs, .blob_count = count, .handles = handles};
    return bvhd_cpu_scene_create(&options, ret_scene, error);
}

static inline struct bvhd_cpu_scene *cpu_bed_open(const struct bvhd_cpu_blob *blobs, uint32_t count)
{
    struct bvhd_cpu_scene *scene = NULL;
    struct bvhd_error error = {0};
    if (cpu_bed_try(blobs, count, NULL, &scene, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return scene;
}

/* Makes a ray from outside or from inside, towards the middle; flags and masks of all kinds. */
static inline struct bvhd_cpu_ray cpu_bed_ray(struct random *random, uint32_t number)
{
    static const uint32_t flags[] = {0,
                                     0,
                                     BVHD_CPU_RAY_OPAQUE,
                                     BVHD_CPU_RAY_NO_OPAQUE,
                                     BVHD_CPU_RAY_CULL_OPAQUE | BVHD_CPU_RAY_SKIP_AABBS,
                                     BVHD_CPU_RAY_CULL_NO_OPAQUE | BVHD_CPU_RAY_CULL_BACK_FACING,
                                     BVHD_CPU_RAY_CULL_FRONT_FACING | BVHD_CPU_RAY_NO_OPAQUE,
                                     BVHD_CPU_RAY_SKIP_TRIANGLES};
    struct bvhd_cpu_ray ray = {.tmax = number % 7 ? FLT_MAX : 2, .mask = number % 3 ? 0xff : 0x100u | number};
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)random_between(random, -3, 3);
        ray.direction[axis] = (float)random_between(random, -1, 1) - ray.origin[axis];
    }
    ray.flags = flags[number % 8];
    ray.time = (float)(number % 5) / 4;
    return ray;
}

static inline struct ray cpu_bed_inner(const struct bvhd_cpu_ray *ray)
{
    struct ray inner = {.tmin = ray->tmin, .tmax = ray->tmax, .flags = ray->flags, .cull_mask = ray->mask & 0xff};
    memcpy(inner.origin, ray->origin, sizeof inner.origin);
    memcpy(inner.direction, ray->direction, sizeof inner.direction);
    return inner;
}

/* Traces a ray by the internal function. */
static inline bool cpu_bed_expect(const struct cpu_bed *bed, const struct bvhd_cpu_ray *ray,
                                  const struct traverse_options *options, struct ray_hit *ret_hit)
{
    const struct ray inner = cpu_bed_inner(ray);
    return bed->is_native ? lavapipe_traverse(&bed->scene.native, &inner, options, ret_hit, NULL)
                          : traverse(&bed->scene.scene, &inner, options, ret_hit, NULL);
}

static inline struct bvhd_cpu_trace cpu_bed_trace(const struct bvhd_cpu_ray *rays, struct bvhd_cpu_hit *hits,
                                                  uint64_t count)
{
    return (struct bvhd_cpu_trace){.struct_size = sizeof(struct bvhd_cpu_trace),
                                   .rays = rays,
                                   .ray_size = sizeof *rays,
                                   .hits = hits,
                                   .hit_size = sizeof *hits,
                                   .ray_count = count};
}

#endif
