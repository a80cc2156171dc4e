/* SPDX-License-Identifier: Apache-2.0 */
/*
 * surface.h - random points of a mesh's surface, by area or one triangle like another.
 *
 * Triangles without area, or with corners that are no numbers, have no points.
 */
#ifndef BVHD_BENCH_SURFACE_H
#define BVHD_BENCH_SURFACE_H

#include "tests/support/scene/ply.h"
#include "tests/support/random.h"

struct surface {
    const struct ply *mesh; /* the caller's, while the surface lives */
    uint32_t count; /* of triangles that have an area; 0: there is nothing to draw from */
    uint32_t *triangles; /* which; malloc */
    double *sums; /* area of triangles[0 .. i], twice; malloc */
};

struct surface_point {
    double position[3];
    uint32_t triangle;
};

struct surface surface_of(const struct ply *mesh);
/* NULL-safe, idempotent. */
void surface_finish(struct surface *surface);

/* Uniform over the surface. The surface is not empty, here and below. */
struct surface_point surface_draw(const struct surface *surface, struct random *random);
/* Uniform over a triangle, which is one like another. */
struct surface_point surface_draw_triangle(const struct surface *surface, struct random *random);

/* Of a triangle that has an area; of length 1. */
void surface_normal(const struct ply *mesh, uint32_t triangle, double ret_normal[3]);

#endif
