/* SPDX-License-Identifier: Apache-2.0 */
/* bench_vulkan_surface.h - rays from everywhere on the surfaces of a scene, whether anybody sees them or not. */
#ifndef BVHD_BENCH_VULKAN_SURFACE_H
#define BVHD_BENCH_VULKAN_SURFACE_H

#include "tests/bench/bench_vulkan_scene.h"

/*
 * Half of the origins are drawn by area, half with each triangle as likely as any other; directions are
 * cosine-distributed around the normal of a random side; the order is random. Triangles without area have no rays;
 * returns how many rays there are: `count`, or 0 when no triangle has any.
 */
enum bvhd_status bench_surface_rays(const struct bench_scene *scene, float tmin, uint32_t count, struct ray *rays,
                                    uint32_t *ret_count, struct bvhd_error *error);

#endif
