/* SPDX-License-Identifier: Apache-2.0 */
/* bench_vulkan_rays.h - makes the rays that a scene is measured with; they are the same for every tracer. */
#ifndef BVHD_BENCH_VULKAN_RAYS_H
#define BVHD_BENCH_VULKAN_RAYS_H

#include "tests/bench/bench_vulkan_scene.h"
#include "proto/base/parallel.h"

enum bench_rays_kind { RAYS_PRIMARY, RAYS_DIFFUSE, RAYS_SURFACE, RAYS_RANDOM, RAYS_KINDS };

extern const char *const bench_rays_names[RAYS_KINDS];

struct bench_rays {
    struct ray *rays[RAYS_KINDS];
    /* 0: not wanted; also for diffuse, if no primary ray hits anything, and for surface, if there is no surface */
    uint32_t count[RAYS_KINDS];
    struct memory *memory;
};

struct bench_rays_options {
    uint32_t count; /* about how many of each kind */
    bool kinds[RAYS_KINDS]; /* the wanted kinds */
};

/*
 * Makes rays of the wanted kinds. The rays of a kind do not depend on which other kinds are wanted. The caller ends
 * them with bench_rays_finish.
 * Primary: a square picture by the camera that `bvhctl trace` chooses, in tiles of 8 x 4.
 * Diffuse: cosine-distributed, from the points that primary rays hit (found on the CPU), in the same order and cyclic;
 * tmin is slightly above 0.
 * Surface: from random points of all surfaces (bench_vulkan_surface.h), in random order.
 * Random: origins in the bounds of the bulk of the scene, directions uniform.
 */
enum bvhd_status bench_rays_make(const struct bench_scene *scene, const struct bench_rays_options *options,
                                 const struct parallel *parallel, struct memory *memory, struct bench_rays *ret_rays,
                                 struct bvhd_error *error);
void bench_rays_finish(struct bench_rays *rays);

#endif
