/* SPDX-License-Identifier: Apache-2.0 */
/*
 * triangle.h - the watertight ray-triangle test, decided in double with exact signs (Woop 2013; symbolic perturbation
 * as in Edelsbrunner and Mücke 1990).
 *
 * Vertices are moved so that the ray starts at the origin, and sheared so that it runs along one axis. There remain
 * three edge functions in the plane across the ray, whose signs tell on which side of each edge the ray passes. Moving
 * and shearing process one vertex at a time, so the triangles that share a vertex agree about its place in the plane:
 * rounding can shift it but not tear a mesh open.
 *
 * The signs are exact for those places in the plane. An edge function is a difference of two products; rounding is
 * monotone, so the difference of the rounded products has the right sign or is 0. If it is 0 the sign follows from the
 * products' rounding errors. If that is 0 too, the ray meets the edge's line and counts as moved by (e, e * e) for an
 * infinitely small e: its side then follows from the edge's direction. So exactly one of the triangles around an edge
 * or a closed fan is hit: no ray slips through, and none hits twice.
 *
 * Results are the same on every machine: IEEE double, no contraction. The test works for all finite floats; products
 * stay within double's range.
 */
#ifndef BVHD_TRIANGLE_H
#define BVHD_TRIANGLE_H

#include <stdbool.h>

/* A ray in one object's space. */
struct triangle_ray {
    double origin[4]; /* along axis[k]; the last element is unused */
    /* direction[axis[k]] / direction[axis[2]] for k = 0, 1; then 1 / direction[axis[2]]; the last element is unused */
    double shear[4];
    /*
     * The third is the axis along which the direction is longest; the order keeps the winding; the last element is 3.
     */
    int axis[4];
};

/* Where a ray's line meets a triangle. */
struct triangle_hit {
    double t;
    double u, v; /* position = (1 - u - v) v0 + u v1 + v v2 */
    bool front; /* (v1 - v0) x (v2 - v0) points against the ray: Vulkan's front face without FLIP_FACING */
};

/*
 * If the sum of the edge functions is below this share of the products that it is made of, it has lost more than 8 of
 * double's 53 bits. The weights, which are divided by it, would then move the hit on the triangle, even out of the
 * boxes around it. Such triangles are decided exactly.
 */
static const double triangle_cancellation = 0x1p-8;

/*
 * The axes in the order of triangle_ray, indexed by whether the direction is negative along its longest axis, and by
 * that axis.
 */
extern const int triangle_axis_orders[2][3][4];

/* Prepares a ray. The direction is finite and not zero. */
void triangle_ray_init(const double origin[3], const double direction[3], struct triangle_ray *ret_ray);

/*
 * Returns whether the ray's line meets the triangle, at any t, also behind the origin. Triangles of zero area or seen
 * edge-on are never hit.
 */
bool triangle_intersect(const struct triangle_ray *ray, const float v0[3], const float v1[3], const float v2[3],
                        struct triangle_hit *ret_hit);

#endif
