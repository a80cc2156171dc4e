/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/transform.h"

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
