/* SPDX-License-Identifier: Apache-2.0 */
/*
 * round_judge.h - judges hits of spheres and linear swept spheres: it finds them by their definition, in quadruple
 * precision where the compiler has it. It shares neither code nor formulas with the traversal. For test programs only.
 */
#ifndef BVHD_ROUND_JUDGE_H
#define BVHD_ROUND_JUDGE_H

#include <math.h>
#include <stdbool.h>

#ifdef __SIZEOF_FLOAT128__
__extension__ typedef __float128 quad;
#else
typedef long double quad;
#endif

/* Where a ray enters a shape first, if it does. */
struct round_answer {
    bool is_hit;
    bool is_doubtful; /* something is too close to be certain */
    quad t, u;
};

static const long double round_judge_margin = 1e-24L;

static inline quad round_judge_size(quad a)
{
    return a < 0 ? -a : a;
}

/* Returns the square root. Two steps of Newton's method double the digits of the first guess twice. */
static inline quad round_judge_root(quad a)
{
    if (a <= 0)
        return 0;
    quad root = sqrtl((long double)a);
    for (int step = 0; step < 2; step++)
        root = (root + a / root) / 2;
    return root;
}

static inline quad round_judge_dot(const quad a[3], const quad b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Notes that the sign of `value` decides, which is the difference of numbers of some size. */
static inline bool round_judge_is_above(quad value, quad size, struct round_answer *answer)
{
    if (round_judge_size(value) <= round_judge_margin * size)
        answer->is_doubtful = true;
    return value >= 0;
}

/* The ray's interval is open. */
static inline void round_judge_add(quad t, quad size, quad u, quad tmin, quad tmax, struct round_answer *answer)
{
    if (!round_judge_is_above(t - tmin, size, answer) || !round_judge_is_above(tmax - t, size, answer) ||
        (answer->is_hit && answer->t <= t))
        return;
    answer->is_hit = true;
    answer->t = t;
    answer->u = u;
}

/*
 * Returns whether a line passes a shape by so much that doubles tell: it misses the sphere around the middle of both
 * ends, enlarged by a thousandth and by far more than the roundings of the products below. Most lines of a test do, and
 * quadruple precision, which takes a hundred times as long, has nothing to add.
 */
static inline bool round_judge_passes(const double origin[3], const double direction[3], const float first[4],
                                      const float second[4])
{
    double o[3], half = 0, far = 0, dd = 0, across = 0;
    for (int k = 0; k < 3; k++) {
        const double middle = 0.5 * first[k] + 0.5 * second[k], apart = 0.5 * first[k] - 0.5 * second[k];
        o[k] = origin[k] - middle;
        half += apart * apart;
        far += fabs(origin[k]) + fabs(middle);
        dd += direction[k] * direction[k];
    }
    for (int x = 0; x < 3; x++) {
        const int y = (x + 1) % 3, z = (x + 2) % 3;
        const double part = o[y] * direction[z] - o[z] * direction[y];
        across += part * part;
    }
    const double reach = 1.001 * (sqrt(half) + fmax(first[3], second[3])) + 1e-9 * far;
    return across > reach * reach * dd;
}

/* A line, from the first end of a shape. */
struct round_line {
    quad o[3], d[3], dd, tmin, tmax;
};

static inline struct round_line round_judge_line(const double origin[3], const double direction[3], double tmin,
                                                 double tmax, const float centre[3])
{
    struct round_line line = {.tmin = tmin, .tmax = tmax};
    for (int k = 0; k < 3; k++) {
        line.o[k] = (quad)origin[k] - centre[k];
        line.d[k] = direction[k];
    }
    line.dd = round_judge_dot(line.d, line.d);
    return line;
}

/*
 * Adds where the line enters a sphere around its zero, if that is beyond a plane, so that (point . axis - limit) * side
 * is not negative. Side 0: everywhere.
 */
static inline void round_judge_ball(const struct round_line *line, quad r, const quad axis[3], quad limit, int side,
                                    quad u, struct round_answer *answer)
{
    quad b = round_judge_dot(line->o, line->d), oo = round_judge_dot(line->o, line->o), next = -b / line->dd, at[3];
    quad across[3];
    for (int k = 0; k < 3; k++)
        across[k] = line->o[k] + next * line->d[k];
    quad apart = round_judge_dot(across, across), rest = r * r - apart;
    if (r <= 0 || !round_judge_is_above(rest, r * r + apart + oo * 1e-9L * 1e-20L, answer))
        return;
    quad t = next - round_judge_root(rest / line->dd);
    for (int k = 0; k < 3; k++)
        at[k] = line->o[k] + t * line->d[k];
    quad beyond = side * (round_judge_dot(at, axis) - limit);
    if (side != 0 && !round_judge_is_above(beyond, r + round_judge_root(oo) * 1e-8L, answer))
        return;
    round_judge_add(t, round_judge_root((oo + r * r) / line->dd) * 1e-4L, u, line->tmin, line->tmax, answer);
}

static inline struct round_answer round_judge_sphere(const double origin[3], const double direction[3], double tmin,
                                                     double tmax, const float sphere[4])
{
    struct round_answer answer = {.is_hit = false};
    const quad no_axis[3] = {0, 0, 0};
    if (round_judge_passes(origin, direction, sphere, sphere))
        return answer;
    const struct round_line line = round_judge_line(origin, direction, tmin, tmax, sphere);
    round_judge_ball(&line, sphere[3], no_axis, 0, 0, 0, &answer);
    return answer;
}

/* Adds where the line enters the side: the cone of which the distance from the axis is (r0 - s y) / root(1 - s^2). */
static inline void round_judge_side(const struct round_line *line, const quad axis[3], quad length, quad r0, quad r1,
                                    struct round_answer *answer)
{
    const quad s = (r0 - r1) / length, flat = 1 - s * s, next = -round_judge_dot(line->o, line->d) / line->dd;
    quad from[3];
    for (int k = 0; k < 3; k++)
        from[k] = line->o[k] + next * line->d[k];
    /* points are from + w d */
    const quad y0 = round_judge_dot(from, axis), y1 = round_judge_dot(line->d, axis);
    const quad a = (line->dd - y1 * y1) * flat - s * s * y1 * y1, b = -y0 * y1 * flat + (r0 - s * y0) * s * y1,
               c = (round_judge_dot(from, from) - y0 * y0) * flat - (r0 - s * y0) * (r0 - s * y0);
    const quad size = round_judge_root(round_judge_dot(from, from)) + r0 + round_judge_size(s * y0);
    if (round_judge_size(a) <= 1e-12L * line->dd)
        answer->is_doubtful = true;
    const quad rest = b * b - a * c;
    if (!round_judge_is_above(rest, line->dd * size * size * flat * 1e-4L, answer))
        return;
    for (int sign = -1; sign <= 1; sign += 2) {
        const quad w = (-b + sign * round_judge_root(rest)) / a, y = y0 + w * y1;
        quad at[3], outward = 0;
        for (int k = 0; k < 3; k++)
            at[k] = from[k] + w * line->d[k];
        if (!round_judge_is_above(y - r0 * s, (length + r0) * 1e-4L, answer) ||
            !round_judge_is_above(length + r1 * s - y, (length + r0) * 1e-4L, answer))
            continue;
        /* The normal is across the axis, tilted by s along it; its length does not matter. */
        const quad far = (r0 - s * y) / round_judge_root(flat);
        for (int k = 0; k < 3; k++)
            outward += line->d[k] * ((at[k] - y * axis[k]) * round_judge_root(flat) + s * far * axis[k]);
        if (!round_judge_is_above(-outward, round_judge_root(line->dd) * far * 1e-4L, answer))
            continue;
        quad u = (y - s * r0) / flat / length;
        round_judge_add(next + w, (round_judge_size(next) + round_judge_size(w)) * 1e-4L,
                        u < 0   ? 0
                        : u > 1 ? 1
                                : u,
                        line->tmin, line->tmax, answer);
    }
}

static inline struct round_answer round_judge_swept(const double origin[3], const double direction[3], double tmin,
                                                    double tmax, const float first[4], const float second[4],
                                                    unsigned caps)
{
    struct round_answer answer = {.is_hit = false};
    if (round_judge_passes(origin, direction, first, second))
        return answer;
    const struct round_line line = round_judge_line(origin, direction, tmin, tmax, first),
                            last = round_judge_line(origin, direction, tmin, tmax, second);
    const quad r0 = first[3], r1 = second[3];
    quad axis[3];
    for (int k = 0; k < 3; k++)
        axis[k] = (quad)second[k] - first[k];
    const quad length = round_judge_root(round_judge_dot(axis, axis));
    if (round_judge_is_above(round_judge_size(r0 - r1) - length, length > 0 ? length : 0, &answer)) {
        answer.is_doubtful = answer.is_doubtful && r0 - r1 != length && r1 - r0 != length;
        const bool is_second = r1 > r0;
        if (caps >> is_second & 1)
            round_judge_ball(is_second ? &last : &line, is_second ? r1 : r0, axis, 0, 0, is_second, &answer);
        return answer;
    }
    for (int k = 0; k < 3; k++)
        axis[k] /= length;
    const quad s = (r0 - r1) / length;
    round_judge_side(&line, axis, length, r0, r1, &answer);
    if (caps & 1)
        round_judge_ball(&line, r0, axis, r0 * s, -1, 0, &answer);
    if (caps & 2)
        round_judge_ball(&last, r1, axis, r1 * s, 1, 1, &answer);
    return answer;
}

#endif
