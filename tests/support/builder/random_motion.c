/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_motion.h"

#include <math.h>

#include "tests/support/builder/random_top.h"

/* Where the parts of a VkSRTDataNV begin. */
enum { SHEAR_A = 1, PIVOT_X = 3, SCALE_Y = 4, SHEAR_C = 5, SCALE_Z = 7, QUATERNION = 9, TRANSLATION = 13 };

static const int scales[3] = {0, SCALE_Y, SCALE_Z}, shears[3] = {SHEAR_A, SHEAR_A + 1, SHEAR_C},
                 pivots[3] = {PIVOT_X, SCALE_Y + 2, SCALE_Z + 1};

static void random_quaternion(struct random *random, double length, float ret_quaternion[4])
{
    double q[4], square;
    do {
        square = 0;
        for (int i = 0; i < 4; i++) {
            q[i] = random_between(random, -1, 1);
            square += q[i] * q[i];
        }
    } while (square < 0.01);
    for (int i = 0; i < 4; i++)
        ret_quaternion[i] = (float)(q[i] * length / sqrt(square));
}

/* Makes the quaternion of a turn by an angle round an axis through the corner of a cube. */
static void turn(double angle, float ret_quaternion[4])
{
    for (int i = 0; i < 3; i++)
        ret_quaternion[i] = (float)(sin(angle / 2) * sqrt(1.0 / 3));
    ret_quaternion[3] = (float)cos(angle / 2);
}

static void random_key(enum random_choice choice, struct random *random, float ret_srt[16])
{
    static const double sizes[] = {1, 1, 1, 0.3, 3};
    const bool is_plain = random_chance(random, 0.3);
    const double size = sizes[random_below(random, 5)], reach = choice == RANDOM_ALL ? 2 : 4;
    const double even = size * random_between(random, 0.5, 1);
    for (int i = 0; i < 3; i++) {
        const double own = size * random_between(random, 0.3, 1) * (random_chance(random, 0.2) ? -1 : 1);
        ret_srt[scales[i]] = (float)(is_plain ? even : own);
        ret_srt[shears[i]] = is_plain ? 0 : (float)random_between(random, -0.2, 0.2);
        ret_srt[pivots[i]] = is_plain ? 0 : (float)random_between(random, -1, 1);
        ret_srt[TRANSLATION + i] = (float)random_between(random, -reach, reach);
    }
    random_quaternion(random, random_chance(random, 0.2) ? random_between(random, 0.1, 5) : 1, ret_srt + QUATERNION);
}

/* Makes the end of what a request may be unprepared for. */
static void make_odd(struct random *random, struct random_motion *motion)
{
    float *const start = motion->start, *const end = motion->end, *const key = random_chance(random, 0.5) ? start : end;
    switch (random_below(random, 7)) {
    case 0: /* nearly once round */
        turn(0, start + QUATERNION);
        turn(359 * 3.14159265358979 / 180, end + QUATERNION);
        break;
    case 1:
        for (int i = 0; i < 4; i++)
            end[QUATERNION + i] = -start[QUATERNION + i];
        break;
    case 2:
        key[scales[random_below(random, 3)]] = 0;
        break;
    case 3: /* only the rotation moves */
        memcpy(end, start, QUATERNION * sizeof *end);
        memcpy(end + TRANSLATION, start + TRANSLATION, 3 * sizeof *end);
        break;
    case 4:
        key[random_below(random, 16)] = NAN;
        break;
    case 5:
        memset(key + QUATERNION, 0, 4 * sizeof *key);
        break;
    default: /* nothing moves */
        memcpy(end, start, sizeof motion->end);
    }
}

void random_motion_make(enum random_choice choice, struct random *random, struct random_motion *ret_motion)
{
    memset(ret_motion, 0, sizeof *ret_motion);
    ret_motion->type = random_below(random, MOTION_TYPES);
    if (ret_motion->type == MOTION_SRT) {
        random_key(choice, random, ret_motion->start);
        random_key(choice, random, ret_motion->end);
        if (random_chance(random, 0.5))
            make_odd(random, ret_motion);
        return;
    }
    random_top_transform(choice, random, ret_motion->start);
    memcpy(ret_motion->end, ret_motion->start, sizeof ret_motion->end);
    if (ret_motion->type == MOTION_STATIC)
        return;
    if (random_chance(random, 0.5))
        random_top_transform(choice, random, ret_motion->end);
    for (int row = 0; row < 3; row++)
        ret_motion->end[4 * row + 3] = random_chance(random, 0.02) ? NAN : (float)random_between(random, -4, 4);
}

void random_motion_record(const struct random_motion *motion, const uint32_t words[2], uint64_t handle,
                          unsigned char ret_record[MOTION_RECORD_SIZE])
{
    const size_t size = (motion->type == MOTION_SRT ? 16 : 12) * sizeof(float);
    const uint32_t head[2] = {motion->type, 0};
    unsigned char *at = ret_record + MOTION_RECORD_DATA;
    memset(ret_record, 0xcc, MOTION_RECORD_SIZE);
    memcpy(ret_record, head, sizeof head);
    memcpy(at, motion->start, size);
    if (motion->type != MOTION_STATIC)
        memcpy(at + size, motion->end, size);
    at += motion->type == MOTION_STATIC ? size : 2 * size;
    memcpy(at, words, 2 * sizeof *words);
    memcpy(at + 2 * sizeof *words, &handle, sizeof handle);
}

bool random_motion_is_active(const struct random_motion *motion)
{
    for (int i = 0; i < 16; i++)
        if (isnan(motion->start[i]) || isnan(motion->end[i]))
            return false;
    return true;
}

void random_motion_apply(const struct random_motion *motion, struct oracle_mesh *mesh)
{
    static const enum oracle_motion motions[MOTION_TYPES] = {ORACLE_STILL, ORACLE_MATRIX, ORACLE_SRT};
    mesh->motion = motions[motion->type];
    mesh->transform = motion->start;
    mesh->end_transform = motion->end;
}

/* Rotates the vector by the quaternion, which need not be of length 1. Returns false if it is 0. */
static bool rotate(const float quaternion[4], double vector[3])
{
    const double q[3] = {quaternion[0], quaternion[1], quaternion[2]}, w = quaternion[3];
    const double square = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + w * w;
    double across[3], twice[3];
    for (int i = 0; i < 3; i++)
        across[i] = q[(i + 1) % 3] * vector[(i + 2) % 3] - q[(i + 2) % 3] * vector[(i + 1) % 3];
    for (int i = 0; i < 3; i++)
        twice[i] = q[(i + 1) % 3] * across[(i + 2) % 3] - q[(i + 2) % 3] * across[(i + 1) % 3];
    for (int i = 0; i < 3 && square > 0; i++)
        vector[i] += 2 * (w * across[i] + twice[i]) / square;
    return square > 0;
}

static bool compose(const float srt[16], float ret_matrix[12])
{
    const double columns[4][3] = {{srt[0], 0, 0},
                                  {srt[SHEAR_A], srt[SCALE_Y], 0},
                                  {srt[SHEAR_A + 1], srt[SHEAR_C], srt[SCALE_Z]},
                                  {srt[pivots[0]], srt[pivots[1]], srt[pivots[2]]}};
    for (int column = 0; column < 4; column++) {
        double vector[3] = {columns[column][0], columns[column][1], columns[column][2]};
        if (!rotate(srt + QUATERNION, vector))
            return false;
        for (int row = 0; row < 3; row++)
            ret_matrix[4 * row + column] = (float)(vector[row] + (column == 3 ? srt[TRANSLATION + row] : 0));
    }
    return true;
}

static bool is_invertible(const float m[12])
{
    double determinant = 0, permanent = 0;
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const double a = (double)m[4 + j] * m[8 + k], b = (double)m[4 + k] * m[8 + j];
        determinant += m[i] * (a - b);
        permanent += fabs((double)m[i]) * (fabs(a) + fabs(b));
    }
    return fabs(determinant) > 1e-3 * permanent;
}

bool random_motion_matrix(const struct random_motion *motion, float time, float ret_matrix[12])
{
    float numbers[16];
    for (int i = 0; i < 16; i++) {
        const float before = motion->start[i] * (1 - time), after = motion->end[i] * time;
        numbers[i] = motion->type == MOTION_STATIC ? motion->start[i] : before + after;
    }
    if (motion->type != MOTION_SRT)
        memcpy(ret_matrix, numbers, 12 * sizeof *numbers);
    else if (!compose(numbers, ret_matrix))
        return false;
    return is_invertible(ret_matrix);
}
