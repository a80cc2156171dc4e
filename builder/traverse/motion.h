/* SPDX-License-Identifier: Apache-2.0 */
/* motion.h - what moves, at the time of a ray: vertices, and the matrices of instances. */
#ifndef BVHD_MOTION_H
#define BVHD_MOTION_H

#include "builder/format/motion_number.h"
#include "builder/format/portable.h"

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
