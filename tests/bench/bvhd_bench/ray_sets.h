/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ray_sets.h - the rays that are timed: of a picture, from what they hit in random directions, from there to a light.
 *
 * Through any subject, so that all are sent the same ones. Shadow rays end at the first hit.
 */
#ifndef BVHD_BENCH_RAY_SETS_H
#define BVHD_BENCH_RAY_SETS_H

#include "subject.h"

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
