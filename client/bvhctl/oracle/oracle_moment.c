/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/oracle_moment.h"

#include <math.h>

#include "client/bvhctl/oracle/oracle.h"

/* What a double may round in an entry of a matrix, relative to the sum of what it is made of. */
#define COMPOSED_WITHIN 4e-15

/* Every operation is rounded to a float: this is the definition of what moves. */
static float at_time(float start, float end, float time)
{
    const float rest = 1 - time, before = start * rest, after = end * time;
    return before + after;
}

void oracle_moment_vertex(const struct oracle_moment *moment, uint64_t vertex, float ret_position[3])
{
    const struct oracle_mesh *mesh = moment->mesh;
    for (int axis = 0; axis < 3; axis++) {
        const uint64_t at = 3 * vertex + (uint64_t)axis;
        ret_position[axis] = mesh->end_positions ? at_time(mesh->positions[at], mesh->end_positions[at], moment->time)
                                                 : mesh->positions[at];
    }
}

bool oracle_moves(const struct oracle_mesh *meshes, uint32_t mesh_count)
{
    for (uint32_t i = 0; i < mesh_count; i++)
        if (meshes[i].end_positions || meshes[i].motion != ORACLE_STILL)
            return true;
    return false;
}

/* ---- matrices ---- */

/* Makes the rotation of a quaternion x, y, z, w, which counts as divided by its length. Returns false if that is 0. */
static bool rotate(const float q[4], double ret_rotation[3][3])
{
    const double x = q[0], y = q[1], z = q[2], w = q[3], square = x * x + y * y + z * z + w * w;
    if (!(square > 0) || isinf(square))
        return false;
    const double two = 2 / square;
    const double rotation[3][3] = {{1 - two * (y * y + z * z), two * (x * y - z * w), two * (x * z + y * w)},
                                   {two * (x * y + z * w), 1 - two * (x * x + z * z), two * (y * z - x * w)},
                                   {two * (x * z - y * w), two * (y * z + x * w), 1 - two * (x * x + y * y)}};
    memcpy(ret_rotation, rotation, sizeof rotation);
    return true;
}

/* The numbers are those of VkSRTDataNV, in its order: sx, a, b, pvx, sy, c, pvy, sz, pvz, q, t. */
static bool compose(const float srt[16], struct radial ret_matrix[12])
{
    const double scale[3][4] = {{srt[0], srt[1], srt[2], srt[3]}, {0, srt[4], srt[5], srt[6]}, {0, 0, srt[7], srt[8]}};
    double rotation[3][3];
    if (!rotate(srt + 9, rotation))
        return false;
    for (int row = 0; row < 3; row++)
        for (int column = 0; column < 4; column++) {
            double sum = column == 3 ? srt[13 + row] : 0, parts = fabs(sum);
            for (int k = 0; k < 3; k++) {
                sum += rotation[row][k] * scale[k][column];
                parts += fabs(scale[k][column]);
            }
            struct radial *entry = &ret_matrix[4 * row + column];
            *entry = radial_input((float)sum);
            entry->radius += COMPOSED_WITHIN * parts;
        }
    return true;
}

static double determinant(const struct radial m[12])
{
    double x = m[5].centre * m[10].centre - m[6].centre * m[9].centre;
    double y = m[6].centre * m[8].centre - m[4].centre * m[10].centre;
    double z = m[4].centre * m[9].centre - m[5].centre * m[8].centre;
    return m[0].centre * x + m[1].centre * y + m[2].centre * z;
}

/* Inverts the first three columns of the matrix. Returns false if they may be singular. */
static bool invert(const struct radial matrix[12], struct radial ret_inverse[3][3])
{
    struct radial adjugate[3][3], det = {0, 0};
    for (int k = 0; k < 9; k++) {
        const struct radial *next = matrix + 4 * ((k / 3 + 1) % 3), *last = matrix + 4 * ((k / 3 + 2) % 3);
        const int y = (k % 3 + 1) % 3, z = (k % 3 + 2) % 3;
        adjugate[k / 3][k % 3] = radial_sub(radial_mul(next[y], last[z]), radial_mul(next[z], last[y]));
    }
    for (int k = 0; k < 3; k++) {
        const struct radial part = radial_mul(matrix[k], adjugate[0][k]);
        det = k ? radial_add(det, part) : part;
    }
    if (!radial_is_nonzero(det))
        return false;
    for (int k = 0; k < 9; k++)
        ret_inverse[k / 3][k % 3] = radial_div(adjugate[k % 3][k / 3], det);
    return true;
}

/* Returns whether the matrix is singular because a column is 0, or not finite. */
static bool is_nothing(const struct radial matrix[12])
{
    bool is_wrong = false;
    for (int k = 0; k < 12; k++)
        is_wrong |= !isfinite(matrix[k].centre);
    for (int k = 0; k < 3; k++)
        is_wrong |= matrix[k].centre == 0 && matrix[4 + k].centre == 0 && matrix[8 + k].centre == 0;
    return is_wrong;
}

static bool move_matrix(const struct oracle_mesh *mesh, float time, struct radial ret_matrix[12])
{
    const int count = mesh->motion == ORACLE_SRT ? 16 : 12;
    float numbers[16];
    for (int k = 0; k < count; k++)
        numbers[k] = at_time(mesh->transform[k], mesh->end_transform[k], time);
    if (mesh->motion == ORACLE_SRT)
        return compose(numbers, ret_matrix) && !is_nothing(ret_matrix);
    for (int k = 0; k < 12; k++)
        ret_matrix[k] = radial_input(numbers[k]);
    return !is_nothing(ret_matrix);
}

bool oracle_moment_make(const struct oracle_mesh *mesh, float time, struct oracle_moment *ret_moment)
{
    const bool moves = mesh->motion != ORACLE_STILL;
    ret_moment->mesh = mesh;
    ret_moment->time = time;
    ret_moment->has_matrix = mesh->transform != NULL;
    ret_moment->mirrored = ret_moment->vague = false;
    if (!mesh->transform)
        return true;
    if (moves && !move_matrix(mesh, time, ret_moment->matrix))
        return false;
    for (int k = 0; !moves && k < 12; k++)
        ret_moment->matrix[k] = radial_input(mesh->transform[k]);
    ret_moment->mirrored = determinant(ret_moment->matrix) < 0;
    if (moves || mesh->shape != ORACLE_TRIANGLES)
        ret_moment->vague = !invert(ret_moment->matrix, ret_moment->inverse);
    return true;
}
