/* SPDX-License-Identifier: Apache-2.0 */
/*
 * triangle.h - the watertight ray-triangle test, decided in double with exact signs (Woop 2013; symbolic perturbation
 * as in Edelsbrunner and Mücke 1990).
 *
 * Vertices are moved so that the ray starts at the origin, and sheared so that it runs along one axis. What is left are
 * three edge functions in the plane across it, whose signs say on which side of each edge the ray passes. Moving and
 * shearing sees one vertex at a time, so the triangles that share a vertex agree about where it lies in the plane, and
 * rounding can shift it but not tear a mesh open.
 *
 * Signs are exact for those places in the plane. An edge function is a difference of two products; rounding is
 * monotone, so the difference of the rounded products has the right sign or is 0. When it is 0 the sign is taken from
 * the products' rounding errors, and when that is 0 too, the ray meets the edge's line, and counts as moved by (e, e *
 * e) for an infinitely small e: its side is then that of the edge's direction. So of the triangles around an edge or a
 * closed fan exactly one is hit: no ray slips through, none hits twice.
 *
 * The same on every machine: IEEE double, no contraction. Works for all finite floats; products stay in double's range.
 */
#ifndef BVHD_TRIANGLE_H
#define BVHD_TRIANGLE_H

#include <stdbool.h>

/* A ray in one object's space. */
struct triangle_ray {
    double origin[4]; /* along axis[k]; the last is of no use */
    double shear
        [4]; /* direction[axis[k]] / direction[axis[2]] for k = 0, 1; then 1 / direction[axis[2]]; the last is of no use */
    int axis
        [4]; /* the third is the one along which the direction is longest; in an order that keeps the winding; the last is 3 */
};

struct triangle_hit {
    double t;
    double u, v; /* position = (1 - u - v) v0 + u v1 + v v2 */
    bool front; /* (v1 - v0) x (v2 - v0) points against the ray: Vulkan's front face without FLIP_FACING */
};

/*
 * Below this share of the products that it is made of, the sum of the edge functions has lost more than 8 of double's
 * 53 bits. The weights that it divides would put the hit somewhere else on the triangle, up to outside of the boxes
 * that hold it. Such triangles are decided exactly.
 */
static const double triangle_cancellation = 0x1p-8;

/* Axes in the order of triangle_ray: by whether the direction goes backwards along the longest, and which that is. */
extern const int triangle_axis_orders[2][3][4];

/* The direction is finite and not zero. */
void triangle_ray_init(const double origin[3], const double direction[3], struct triangle_ray *ret_ray);

/*
 * Whether the line of the ray meets the triangle, at any t, behind the origin too. Never for triangles of zero area and
 * those seen edge-on.
 */
bool triangle_intersect(const struct triangle_ray *ray, const float v0[3], const float v1[3], const float v2[3],
                        struct triangle_hit *ret_hit);

#endif
