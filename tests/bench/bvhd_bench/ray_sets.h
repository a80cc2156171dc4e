/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ray_sets.h - makes the rays that are timed: primary rays of a picture, shadow rays from their hits to a light, and
 * diffuse rays from anywhere on the surface.
 *
 * A diffuse ray starts at a random point of the surface and goes in a cosine-distributed direction to a random side.
 * Half of the points are drawn by area, the other half by triangle, all triangles with equal probability. The points
 * are not those that a camera outside sees: most rays from there leave the scene at once, after one step in the tree of
 * a stadium, and say next to nothing about the tree. By area alone, one large ground would receive nearly all rays,
 * although small triangles matter more than their share of the area. The side is random because meshes have no reliable
 * front.
 *
 * All subjects are given the same rays. Shadow rays end at the first hit.
 */
#ifndef BVHD_BENCH_RAY_SETS_H
#define BVHD_BENCH_RAY_SETS_H

#include "tests/bench/bvhd_bench/subject.h"

enum ray_kind { RAYS_PRIMARY, RAYS_DIFFUSE, RAYS_SHADOW, RAY_KINDS };

struct ray_sets {
    uint32_t counts[RAY_KINDS];
    struct ray *rays[RAY_KINDS]; /* malloc */
};

const char *ray_kind_name(enum ray_kind kind);

/* Makes a picture of size x size pixels, where size is a multiple of 8. `subject` has to be of the portable target. */
struct ray_sets ray_sets_make(const struct subject *subject, const struct ply *mesh, uint32_t size);
void ray_sets_finish(struct ray_sets *sets);

#endif
