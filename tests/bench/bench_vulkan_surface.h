/* SPDX-License-Identifier: Apache-2.0 */
/* bench_vulkan_surface.h - makes rays from all surfaces of a scene, whether a camera sees them or not. */
#ifndef BVHD_BENCH_VULKAN_SURFACE_H
#define BVHD_BENCH_VULKAN_SURFACE_H

#include "tests/bench/bench_vulkan_scene.h"

/*
 * Draws half of the origins by area, and half by triangle with equal probability. Directions are cosine-distributed
 * around the normal of a random side; the order is random. Triangles without area have no rays. *ret_count becomes
 * `count`, or 0 when no triangle has any area.
 */
enum bvhd_status bench_surface_rays(const struct bench_scene *scene, float tmin, uint32_t count, struct ray *rays,
                                    uint32_t *ret_count, struct bvhd_error *error);

#endif
