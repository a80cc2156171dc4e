/* SPDX-License-Identifier: Apache-2.0 */
/*
 * motion.h - what moves, at the time of a ray: numbers, vertices, and the matrices of instances.
 *
 * A number at time t is start * (1 - t) + end * t in float, each operation rounded once. It is the same for everybody
 * who computes it, so that triangles that share a vertex agree about its place. Rounding is monotone: of two numbers
 * that are in order at both keys, those at any time are in the same order or equal.
 */
#ifndef BVHD_MOTION_H
#define BVHD_MOTION_H

#include "builder/format/portable.h"

/* By how much the numbers at t = 0 and at t = 1 count. */
struct motion_weights {
    float start, end;
};

static inline struct motion_weights motion_weights_at(float time)
{
    return (struct motion_weights){1 - time, time};
}

static inline float motion_number(float start, float end, struct motion_weights at)
{
    return start * at.start + end * at.end;
}

/* Gives the corners of a record of motion triangles at a time, and returns its id. */
static inline uint32_t motion_corners(const struct portable_view *view, uint32_t record, struct motion_weights at,
                                      float ret_corners[3][3])
{
    const struct portable_indexed_triangle *triangle = (const struct portable_indexed_triangle *)view->records + record;
    for (int k = 0; k < 3; k++) {
        const float *start = view->vertices + (uint64_t)6 * triangle->vertices[k], *end = start + 3;
        for (int axis = 0; axis < 3; axis++)
            ret_corners[k][axis] = motion_number(start[axis], end[axis], at);
    }
    return triangle->id;
}

/*
 * Gives the matrix of a motion instance at a time: row-major 3x4, from the space of its structure. For MOTION_SRT it is
 * translation * rotation * scale, multiplied in double and rounded once. Returns false if there is none, because the
 * quaternion is zero or not finite at that time.
 */
bool motion_matrix(const struct portable_moving_instance *instance, float time, float ret_matrix[12]);

#endif
