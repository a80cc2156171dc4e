/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/round_surface.h"

/* Returns column `i` of the cofactors of the 3x3 part of a matrix: the cross product of its two other columns. */
static struct vector cofactors(const float m[12], int i)
{
    int j = (i + 1) % 3, k = (i + 2) % 3;
    struct vector a = {(double)m[j], (double)m[4 + j], (double)m[8 + j]},
                  b = {(double)m[k], (double)m[4 + k], (double)m[8 + k]};
    return vector_cross(a, b);
}

/*
 * With the matrix A and its matrix of cofactors C, the inverse of A is C^T / det(A). It takes the way from the centre
 * to object space, where it is a normal, and its transpose takes this to world space. Both together are C C^T /
 * det(A)^2, in which the divisor only changes the length.
 */
struct vector round_surface_normal(const struct structure_round *round, const float *object_to_world,
                                   struct vector position, double u)
{
    struct vector first = vector_from_floats(round->ends[0]), second = vector_from_floats(round->ends[1]);
    struct vector centre = vector_mix(first, second, u), normal = {0, 0, 0};
    if (!object_to_world)
        return vector_unit(vector_sub(position, centre));
    struct vector columns[3], away = vector_sub(position, vector_transform(object_to_world, centre));
    double longest = 0;
    for (int i = 0; i < 3; i++) {
        columns[i] = cofactors(object_to_world, i);
        longest = fmax(longest, vector_length(columns[i]));
    }
    for (int i = 0; i < 3 && longest > 0; i++) {
        struct vector column = vector_scale(columns[i], 1 / longest);
        normal = vector_mad(normal, column, vector_dot(column, away));
    }
    return vector_unit(normal);
}

void round_surface_stand_in(const struct structure_round *round, struct vector ret_corners[3])
{
    struct vector first = vector_from_floats(round->ends[0]), second = vector_from_floats(round->ends[1]);
    struct vector along = vector_unit(vector_sub(second, first)), side, other;
    if (vector_length(along) == 0)
        along = vector_make(0, 0, 1);
    vector_basis(along, &side, &other);
    double first_radius = (double)round->ends[0][3], second_radius = (double)round->ends[1][3];
    ret_corners[0] = vector_mad(vector_mad(first, side, first_radius), along, -first_radius);
    ret_corners[1] = vector_mad(vector_mad(first, side, -first_radius), along, -first_radius);
    ret_corners[2] = vector_mad(second, along, second_radius);
}
