/* SPDX-License-Identifier: Apache-2.0 */
/* bench_vulkan_rays.h - the rays that a scene is measured with: the same for everybody who traces it. */
#ifndef BVHD_BENCH_VULKAN_RAYS_H
#define BVHD_BENCH_VULKAN_RAYS_H

#include "tests/bench/bench_vulkan_scene.h"
#include "proto/base/parallel.h"

enum bench_rays_kind { RAYS_PRIMARY, RAYS_DIFFUSE, RAYS_SURFACE, RAYS_RANDOM, RAYS_KINDS };

extern const char *const bench_rays_names[RAYS_KINDS];

struct bench_rays {
    struct ray *rays[RAYS_KINDS];
    uint32_t count[RAYS_KINDS]; /* 0: not wanted; diffuse: or no primary ray hits anything; surface: or there is none */
    struct memory *memory;
};

struct bench_rays_options {
    uint32_t count; /* of each kind, about */
    bool kinds[RAYS_KINDS]; /* that are wanted */
};

/*
 * Primary: a square picture by the camera that `bvhctl trace` chooses, in tiles of 8 x 4. Diffuse: from what those hit
 * (found on the CPU), in the same order, and from the first again after the last; cosine-distributed, tmin a little
 * above 0. Surface: from random points of all surfaces (bench_vulkan_surface.h), in random order. Random: origins in
 * the bounds of the scene's bulk, directions evenly. The rays of a kind do not depend on which others are wanted. End
 * with bench_rays_finish.
 */
enum bvhd_status bench_rays_make(const struct bench_scene *scene, const struct bench_rays_options *options,
                                 const struct parallel *parallel, struct memory *memory, struct bench_rays *ret_rays,
                                 struct bvhd_error *error);
void bench_rays_finish(struct bench_rays *rays);

#endif
