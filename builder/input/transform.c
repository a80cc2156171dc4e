/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/transform.h"

#include <math.h>

bool transform_is_identity(const float matrix[12])
{
    static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    bool equal = true;
    for (int i = 0; i < 12; i++)
        equal &= matrix[i] == identity[i];
    return equal;
}

static float transform_row(const double row[4], double x, double y, double z)
{
    double value = row[0] * x + row[1] * y + row[2] * z + row[3];
    return value != value ? transform_nan() : (float)value;
}

void transform_points(const float matrix[12], float *points, uint64_t count)
{
    double rows[12];
    for (int i = 0; i < 12; i++)
        rows[i] = matrix[i];
    for (uint64_t i = 0; i < count; i++, points += 3) {
        double x = points[0], y = points[1], z = points[2];
        points[0] = transform_row(rows, x, y, z);
        points[1] = transform_row(rows + 4, x, y, z);
        points[2] = transform_row(rows + 8, x, y, z);
    }
}

/*
 * Transforms the box by its centre and half extent: c' = M c + t, e' = |M| e. `slack` bounds the rounding errors of
 * these few operations, relative to the sum of magnitudes.
 */
void transform_bounds(const double matrix[12], const struct box *box, double ret_min[3], double ret_max[3])
{
    for (int row = 0; row < 3; row++) {
        const double *m = matrix + 4 * row;
        double centre = m[3], extent = 0, magnitude = fabs(m[3]);
        for (int axis = 0; axis < 3; axis++) {
            double min = box->min[axis], max = box->max[axis];
            centre += m[axis] * (0.5 * (min + max));
            extent += fabs(m[axis]) * (0.5 * (max - min));
            magnitude += fabs(m[axis]) * (fabs(min) + fabs(max));
        }
        double slack = magnitude * 0x1p-48;
        ret_min[row] = centre - extent - slack;
        ret_max[row] = centre + extent + slack;
    }
}
