/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/motion_fit.h"

#include <float.h>
#include <math.h>
#include <string.h>

/*
 * The longest pivot, in the greatest distance of the path from the origin. What rounding of it does to both ends stays
 * below 1e-5 of that.
 */
enum { PIVOT_MOST = 32 };

/* ---- vectors ---- */

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double ret[3])
{
    for (int i = 0; i < 3; i++)
        ret[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

/* Scales a vector of any length to 1. Returns false if it is shorter than `least`. */
static bool make_unit(double *vector, int width, double least)
{
    double square = 0;
    for (int i = 0; i < width; i++)
        square += vector[i] * vector[i];
    double length = sqrt(square);
    if (!(length > least))
        return false;
    for (int i = 0; i < width; i++)
        vector[i] /= length;
    return true;
}

/* Takes out of `vector` what is in the direction of `unit`. */
static void make_across(double vector[3], const double unit[3])
{
    double share = dot(vector, unit);
    for (int i = 0; i < 3; i++)
        vector[i] -= share * unit[i];
}

/* ---- a matrix as a rotation after an upper triangular matrix ---- */

/* The columns of a rotation, and what is before it: the numbers sx, a, b, sy, c, sz of VkSRTDataNV. */
struct parts {
    double columns[3][3];
    double upper[6];
};

static void column_of(const struct gltf_matrix *matrix, int column, double ret[3])
{
    for (int row = 0; row < 3; row++)
        ret[row] = matrix->at[4 * row + column];
}

/*
 * Finds the rotation by the columns of the matrix, one after the other. Where a column gives no direction, because a
 * scale is 0, that of `other` is taken.
 */
static void find_rotation(const struct gltf_matrix *matrix, double (*other)[3], double ret_columns[3][3])
{
    double largest = 0;
    for (int i = 0; i < 12; i++)
        largest = i % 4 == 3 ? largest : fmax(largest, fabs(matrix->at[i]));
    column_of(matrix, 0, ret_columns[0]);
    column_of(matrix, 1, ret_columns[1]);
    if (!make_unit(ret_columns[0], 3, largest * 1e-12))
        memcpy(ret_columns[0], other[0], sizeof ret_columns[0]);
    make_across(ret_columns[1], ret_columns[0]);
    double least = largest * 1e-9;
    for (int next = 1; !make_unit(ret_columns[1], 3, least); next++) {
        memcpy(ret_columns[1], other[next % 3], sizeof ret_columns[1]);
        make_across(ret_columns[1], ret_columns[0]);
        least = 0.1; /* of three that are across each other, at most one is shorter */
    }
    cross(ret_columns[0], ret_columns[1], ret_columns[2]);
}

static struct parts take_apart(const struct gltf_matrix *matrix, double (*other)[3])
{
    struct parts parts;
    double columns[3][3];
    find_rotation(matrix, other, parts.columns);
    for (int i = 0; i < 3; i++)
        column_of(matrix, i, columns[i]);
    for (int row = 0, at = 0; row < 3; row++)
        for (int column = row; column < 3; column++)
            parts.upper[at++] = dot(parts.columns[row], columns[column]);
    return parts;
}

/* The quaternion x, y, z, w of a rotation, by the largest of its four numbers. */
static void quaternion_of(double (*columns)[3], double ret[4])
{
    double trace = columns[0][0] + columns[1][1] + columns[2][2];
    const double squares[4] = {1 + 2 * columns[0][0] - trace, 1 + 2 * columns[1][1] - trace,
                               1 + 2 * columns[2][2] - trace, 1 + trace};
    int most = 0;
    for (int i = 1; i < 4; i++)
        most = squares[i] > squares[most] ? i : most;
    for (int i = 0; i < 3; i++) {
        int y = (i + 1) % 3, z = (i + 2) % 3;
        double turn = columns[y][z] - columns[z][y];
        ret[i] = most == 3 ? turn : most == i ? squares[i] : columns[i][most] + columns[most][i];
        if (most == i)
            ret[3] = turn;
    }
    ret[3] = most == 3 ? squares[3] : ret[3];
    make_unit(ret, 4, 0);
}

/* Makes the rows of the rotation of a quaternion, which counts as divided by its length. Returns false if that is 0. */
static bool rotation_of(const double quaternion[4], double ret_rows[3][3])
{
    double q[4] = {quaternion[0], quaternion[1], quaternion[2], quaternion[3]};
    if (!make_unit(q, 4, 1e-9))
        return false;
    struct gltf_trs trs = gltf_trs_identity;
    memcpy(trs.rotation, q, sizeof q);
    struct gltf_matrix matrix = gltf_trs_matrix(&trs);
    for (int row = 0; row < 3; row++)
        memcpy(ret_rows[row], matrix.at + (ptrdiff_t)4 * row, sizeof ret_rows[row]);
    return true;
}

/* ---- motion ---- */

static double mix(double start, double end, double share)
{
    return start * (1 - share) + end * share;
}

/* Makes the matrix at a time from 0 to 1. Returns false if there is none. */
static bool motion_at(const struct import_motion *motion, double share, struct gltf_matrix *ret_matrix)
{
    double numbers[16], rows[3][3];
    for (int i = 0; i < 16; i++)
        numbers[i] = mix((double)motion->start[i], (double)motion->end[i], share);
    if (motion->kind != ORACLE_SRT) {
        memcpy(ret_matrix->at, numbers, sizeof ret_matrix->at);
        return true;
    }
    if (!rotation_of(numbers + 9, rows))
        return false;
    const double *s = numbers;
    const struct gltf_matrix scale = {{s[0], s[1], s[2], s[3], 0, s[4], s[5], s[6], 0, 0, s[7], s[8]}};
    struct gltf_matrix turn = {{0}};
    for (int i = 0; i < 12; i++)
        turn.at[i] = i % 4 == 3 ? numbers[13 + i / 4] : rows[i / 4][i % 4];
    *ret_matrix = gltf_matrix_product(&turn, &scale);
    return true;
}

static void corner_of(const struct motion_path *path, int corner, double ret[3])
{
    for (int axis = 0; axis < 3; axis++)
        ret[axis] = corner >> axis & 1 ? path->high[axis] : path->low[axis];
}

/* Returns the length of what `matrix` makes of a point. */
static double reach_of(const struct gltf_matrix *matrix, const double point[3])
{
    double square = 0;
    for (int row = 0; row < 3; row++) {
        double sum = dot(matrix->at + (ptrdiff_t)4 * row, point) + matrix->at[4 * row + 3];
        square += sum * sum;
    }
    return sqrt(square);
}

/*
 * Measures a motion. The distance of a point is the length of what the difference of two matrices makes of it, which is
 * convex, so that it is greatest in a corner of the box.
 */
static void measure(const struct motion_path *path, struct motion_fit *fit)
{
    fit->distance = 0;
    fit->step = 0;
    for (int step = 0; step <= MOTION_FIT_STEPS; step++) {
        struct gltf_matrix difference;
        bool is_there = motion_at(&fit->motion, (double)step / MOTION_FIT_STEPS, &difference);
        for (int i = 0; i < 12 && is_there; i++)
            difference.at[i] -= path->at[step].at[i];
        for (int corner = 0; corner < 8; corner++) {
            double point[3];
            corner_of(path, corner, point);
            double distance = is_there ? reach_of(&difference, point) : INFINITY;
            if (!(distance <= fit->distance)) {
                fit->distance = distance <= DBL_MAX ? distance : DBL_MAX; /* also if it is no number */
                fit->step = step;
            }
        }
    }
}

/* Returns how far from the origin the path takes a point of the box. */
static double length_of(const struct motion_path *path)
{
    double reach = 0;
    for (int step = 0; step <= MOTION_FIT_STEPS; step++)
        for (int corner = 0; corner < 8; corner++) {
            double point[3];
            corner_of(path, corner, point);
            reach = fmax(reach, reach_of(&path->at[step], point));
        }
    return reach;
}

/* ---- turning ---- */

/* Both ends of a path, in parts. */
struct turn {
    struct parts ends[2];
    double quaternions[2][4];
    double pivot[3]; /* about which it turns, in the space of the scaled object */
};

/* Solves three equations by Cramer's rule. They have a single solution, or one that is no number. */
static void solve(const double rows[3][3], const double right[3], double ret[3])
{
    double normal[3];
    cross(rows[1], rows[2], normal);
    double determinant = dot(rows[0], normal);
    for (int k = 0; k < 3; k++) {
        double changed[3][3];
        memcpy(changed, rows, sizeof changed);
        for (int row = 0; row < 3; row++)
            changed[row][k] = right[row];
        cross(changed[1], changed[2], normal);
        ret[k] = dot(changed[0], normal) / determinant;
    }
}

/* Returns where a motion without a pivot has a point, less where the path has it. */
static void find_offset(const struct motion_path *path, const struct turn *turn, int step, double (*rotation)[3],
                        const double point[3], double ret[3])
{
    const struct gltf_matrix *first = &path->at[0], *last = &path->at[MOTION_FIT_STEPS], *at = &path->at[step];
    const double share = (double)step / MOTION_FIT_STEPS;
    double u[6];
    for (int i = 0; i < 6; i++)
        u[i] = mix(turn->ends[0].upper[i], turn->ends[1].upper[i], share);
    const double scaled[3] = {u[0] * point[0] + u[1] * point[1] + u[2] * point[2], u[3] * point[1] + u[4] * point[2],
                              u[5] * point[2]};
    for (int row = 0; row < 3; row++)
        ret[row] = dot(rotation[row], scaled) + mix(first->at[4 * row + 3], last->at[4 * row + 3], share) -
                   dot(at->at + (ptrdiff_t)4 * row, point) - at->at[4 * row + 3];
}

/*
 * Finds the pivot p for which the squares of the distances of the middle of the box are least. With it the rotation
 * R(t) is about another point, and the translation makes up for that at both ends, so that (R(t) - linear R) p is added
 * to where everything is. What of p is along the axis of the turn has no effect: a small multiple of the unit matrix
 * keeps it near 0. It is not longer than `most`, because rounding it to float moves both ends.
 */
static void find_pivot(const struct motion_path *path, double most, struct turn *turn)
{
    double rows[3][3] = {{0}}, right[3] = {0}, ends[2][3][3], middle[3];
    rotation_of(turn->quaternions[0], ends[0]);
    rotation_of(turn->quaternions[1], ends[1]);
    for (int i = 0; i < 3; i++)
        middle[i] = mix(path->low[i], path->high[i], 0.5);
    for (int step = 1; step < MOTION_FIT_STEPS; step++) {
        double share = (double)step / MOTION_FIT_STEPS, q[4], rotation[3][3], offset[3];
        for (int i = 0; i < 4; i++)
            q[i] = mix(turn->quaternions[0][i], turn->quaternions[1][i], share);
        if (!rotation_of(q, rotation))
            continue;
        find_offset(path, turn, step, rotation, middle, offset);
        for (int row = 0; row < 3; row++)
            for (int k = 0; k < 3; k++)
                rotation[row][k] -= mix(ends[0][row][k], ends[1][row][k], share);
        for (int i = 0; i < 9; i++)
            for (int row = 0; row < 3; row++)
                rows[i / 3][i % 3] += rotation[row][i / 3] * rotation[row][i % 3];
        for (int i = 0; i < 9; i++)
            right[i / 3] -= rotation[i % 3][i / 3] * offset[i % 3];
    }
    double weight = 1e-9 * (rows[0][0] + rows[1][1] + rows[2][2]);
    for (int i = 0; i < 3; i++)
        rows[i][i] += weight;
    if (weight > 0) /* it turns */
        solve((const double(*)[3])rows, right, turn->pivot);
    double length = sqrt(dot(turn->pivot, turn->pivot));
    for (int i = 0; i < 3 && length > most; i++)
        turn->pivot[i] *= most / length;
}

/* Writes the 16 numbers of one end. The translation makes up for what rounding does to the others. */
static bool write_end(const struct gltf_matrix *matrix, const struct turn *turn, int end, float ret[16])
{
    static const int uppers[6] = {0, 1, 2, 4, 5, 7}, pivots[3] = {3, 6, 8};
    double q[4], rotation[3][3], pivot[3];
    for (int i = 0; i < 6; i++)
        ret[uppers[i]] = (float)turn->ends[end].upper[i];
    for (int i = 0; i < 4; i++)
        q[i] = ret[9 + i] = (float)turn->quaternions[end][i];
    for (int i = 0; i < 3; i++)
        pivot[i] = ret[pivots[i]] = (float)turn->pivot[i];
    bool is_finite = rotation_of(q, rotation);
    for (int i = 0; i < 3; i++)
        ret[13 + i] = (float)(matrix->at[4 * i + 3] - dot(rotation[i], pivot));
    for (int i = 0; i < 16; i++)
        is_finite &= isfinite(ret[i]) != 0;
    return is_finite;
}

/* Replaces the best motion by one that turns, if that is closer. */
static void try_turn(const struct motion_path *path, const struct turn *turn, double rounding, struct motion_fit *best)
{
    struct motion_fit fit = {.motion.kind = ORACLE_SRT};
    bool is_finite = write_end(&path->at[0], turn, 0, fit.motion.start);
    is_finite &= write_end(&path->at[MOTION_FIT_STEPS], turn, 1, fit.motion.end);
    if (!is_finite)
        return;
    measure(path, &fit);
    if (fit.distance + rounding < best->distance)
        *best = fit;
}

/* Tries to turn both ways round, about the object's own origin and then about a pivot. */
static void try_turns(const struct motion_path *path, bool starts_whole, struct motion_fit *best)
{
    double upright[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    double length = length_of(path), rounding = length * 4 * (double)FLT_EPSILON;
    struct turn turn;
    int first = starts_whole ? 0 : 1; /* the end that has a rotation, which the other may need */
    for (int i = 0; i < 2; i++) {
        int end = i ? 1 - first : first;
        turn.ends[end] = take_apart(&path->at[end * MOTION_FIT_STEPS], i ? turn.ends[first].columns : upright);
        quaternion_of(turn.ends[end].columns, turn.quaternions[end]);
    }
    for (int way = 0; way < 2; way++) {
        memset(turn.pivot, 0, sizeof turn.pivot);
        try_turn(path, &turn, rounding, best);
        find_pivot(path, length * PIVOT_MOST, &turn);
        try_turn(path, &turn, rounding, best);
        for (int i = 0; i < 4; i++)
            turn.quaternions[1][i] *= -1;
    }
}

bool motion_fit(const struct motion_path *path, struct motion_fit *ret_fit)
{
    struct motion_fit best = {.motion.kind = ORACLE_MATRIX, .distance = DBL_MAX};
    bool starts = gltf_matrix_round(&path->at[0], best.motion.start);
    bool ends = gltf_matrix_round(&path->at[MOTION_FIT_STEPS], best.motion.end);
    bool is_finite = true, is_still = true;
    for (int i = 0; i < 12; i++) {
        is_finite &= isfinite(best.motion.start[i]) && isfinite(best.motion.end[i]);
        is_still &= best.motion.start[i] == best.motion.end[i];
    }
    if (!is_finite || (!starts && !ends))
        return false;
    if (is_still)
        best.motion.kind = ORACLE_STILL;
    if (starts && ends)
        measure(path, &best);
    if (best.motion.kind != ORACLE_STILL)
        try_turns(path, starts, &best);
    *ret_fit = best;
    return best.distance < DBL_MAX || (starts && ends);
}
