/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ray_sets.h - the rays that are timed: of a picture, from its points to a light, and diffuse ones from anywhere.
 *
 * A diffuse ray starts at a random point of the surface, half of them drawn by area, the other half one triangle like
 * another, and goes in a cosine-distributed direction to a random side. What a camera outside sees is no place to start
 * from: most rays from there leave the scene at once, after one step of a stadium's tree, and tell next to nothing
 * about it. By area alone one large ground would be all there is; small triangles are looked at more than their area
 * tells. To a random side, since meshes have no reliable front.
 *
 * Through any subject, so that all are sent the same ones. Shadow rays end at the first hit.
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

/* A picture of size x size, a multiple of 8. `subject` is of the portable target. */
struct ray_sets ray_sets_make(const struct subject *subject, const struct ply *mesh, uint32_t size);
void ray_sets_finish(struct ray_sets *sets);

#endif
