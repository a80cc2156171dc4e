/* SPDX-License-Identifier: Apache-2.0 */
/*
 * surface.h - draws random points of a mesh's surface, by area or by triangle with equal probability.
 *
 * Triangles without area, and triangles with corners that are NaN or infinite, have no points.
 */
#ifndef BVHD_BENCH_SURFACE_H
#define BVHD_BENCH_SURFACE_H

#include "tests/support/scene/ply.h"
#include "tests/support/random.h"

struct surface {
    const struct ply *mesh; /* belongs to the caller and has to outlive the surface */
    uint32_t count; /* number of triangles with an area; 0: there is nothing to draw from */
    uint32_t *triangles; /* their numbers; malloc */
    double *sums; /* twice the summed area of triangles[0 .. i]; malloc */
};

struct surface_point {
    double position[3];
    uint32_t triangle;
};

struct surface surface_of(const struct ply *mesh);
/* Frees the arrays. Accepts NULL, and a surface that is finished already. */
void surface_finish(struct surface *surface);

/* Draws uniformly over the surface. Here and below, the surface must not be empty. */
struct surface_point surface_draw(const struct surface *surface, struct random *random);
/* Draws a triangle, each with equal probability, then a point uniformly over it. */
struct surface_point surface_draw_triangle(const struct surface *surface, struct random *random);

/* The unit normal of a triangle that has an area. */
void surface_normal(const struct ply *mesh, uint32_t triangle, double ret_normal[3]);

#endif
