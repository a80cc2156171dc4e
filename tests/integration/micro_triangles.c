/* SPDX-License-Identifier: Apache-2.0 */
/*
 * micro_triangles.c - compares the closed form of the micro-triangle at a point (micro_triangle.h) with a search in
 * double, which goes down the recursion that defines their order, at random points of all levels.
 *
 *     micro_triangles [COUNT [SEED]]
 *
 * COUNT is the number of points (1,000,000 by default). They lie anywhere, near and on corners and edges of the
 * triangle and of micro-triangles, a few ulp beside those, and outside. Where both differ, the micro-triangle that the
 * closed form names has to contain the point but for the rounding of one sum of floats; these points are counted as
 * uncertain. It prints each failure; the exit status is 1 if there was any.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "builder/format/micro_triangle.h"
#include "tests/support/random.h"

struct point {
    double u, v;
};

static float clamped(float x)
{
    return x >= 1 ? 1 : x > 0 ? x : 0; /* a NaN is 0 */
}

/* Moves a float by up to three ulp, and not at all in half of the cases. */
static float near_to(struct random *random, double x)
{
    float result = (float)x;
    uint64_t choice = random_next(random);
    if (choice & 1)
        for (uint64_t i = choice >> 8 & 3; i > 0; i--)
            result = nextafterf(result, choice & 2 ? 2.0f : -2.0f);
    return result;
}

/* Chooses a point of one of the kinds above. */
static void choose(struct random *random, unsigned level, float ret_at[2])
{
    const double parts = ldexp(1, (int)level);
    double u = random_between(random, 0, 1), v = random_between(random, 0, 1);
    switch (random_next(random) % 8) {
    case 0: /* on corners of micro-triangles */
        ret_at[0] = near_to(random, floor(u * (parts + 1)) / parts);
        ret_at[1] = near_to(random, floor(v * (parts + 1)) / parts);
        return;
    case 1: /* on edges of constant u or v */
        ret_at[random_next(random) & 1] = (float)v;
        ret_at[random_next(random) & 1] = near_to(random, floor(u * (parts + 1)) / parts);
        return;
    case 2: /* on edges of constant u + v, also the triangle's own edge */
        u *= v = floor(v * (parts + 1)) / parts;
        ret_at[0] = near_to(random, u);
        ret_at[1] = near_to(random, v - u);
        return;
    case 3: /* near corners of the triangle */
        u = ldexp(u, -(int)(random_next(random) % 32));
        v = ldexp(v, -(int)(random_next(random) % 32));
        ret_at[0] = (float)(random_next(random) & 1 ? 1 - u : u);
        ret_at[1] = (float)(random_next(random) & 1 ? 1 - v : v);
        return;
    case 4: /* anywhere around the triangle, and no number */
        ret_at[0] = random_next(random) % 64 ? (float)(4 * u - 1.5) : NAN;
        ret_at[1] = random_next(random) % 64 ? (float)(4 * v - 1.5) : -INFINITY;
        return;
    default:
        ret_at[0] = (float)(u + v > 1 ? 1 - u : u);
        ret_at[1] = (float)(u + v > 1 ? 1 - v : v);
    }
}

/* Searches the micro-triangle with larger u and v of those that contain the point, which lies inside the triangle. */
static uint32_t search(struct point at, unsigned level)
{
    struct point corners[3] = {{0, 0}, {1, 0}, {0, 1}};
    uint32_t index = 0;
    while (level-- > 0) {
        const struct point a = corners[0], b = corners[1], c = corners[2];
        const struct point p = {(a.u + b.u) / 2, (a.v + b.v) / 2}, q = {(b.u + c.u) / 2, (b.v + c.v) / 2};
        const struct point r = {(c.u + a.u) / 2, (c.v + a.v) / 2};
        const struct point children[4][3] = {{a, p, r}, {r, q, p}, {p, b, q}, {q, r, c}};
        int best = -1;
        double best_middle = -1;
        for (int child = 0; child < 4; child++) {
            const struct point *t = children[child];
            double low_u = fmin(t[0].u, fmin(t[1].u, t[2].u)), high_u = fmax(t[0].u, fmax(t[1].u, t[2].u));
            double low_v = fmin(t[0].v, fmin(t[1].v, t[2].v)), high_v = fmax(t[0].v, fmax(t[1].v, t[2].v));
            double low_sum = fmin(t[0].u + t[0].v, fmin(t[1].u + t[1].v, t[2].u + t[2].v));
            double high_sum = fmax(t[0].u + t[0].v, fmax(t[1].u + t[1].v, t[2].u + t[2].v));
            double middle = t[0].u + t[1].u + t[2].u + t[0].v + t[1].v + t[2].v;
            if (at.u < low_u || at.u > high_u || at.v < low_v || at.v > high_v || at.u + at.v < low_sum ||
                at.u + at.v > high_sum || middle < best_middle)
                continue;
            best = child;
            best_middle = middle;
        }
        if (best < 0)
            return UINT32_MAX;
        for (int corner = 0; corner < 3; corner++)
            corners[corner] = children[best][corner];
        index = 4 * index + (uint32_t)best;
    }
    return index;
}

/* Returns how far, in edges of micro-triangles, the point lies outside micro-triangle `index`. */
static double outside(struct point at, uint32_t index, unsigned level)
{
    uint32_t corners[3][2];
    bool is_upright = micro_triangle_corners(index, level, corners);
    double low_u = fmin(corners[0][0], fmin(corners[1][0], corners[2][0]));
    double low_v = fmin(corners[0][1], fmin(corners[1][1], corners[2][1]));
    double u = ldexp(at.u, (int)level) - low_u, v = ldexp(at.v, (int)level) - low_v;
    return is_upright ? fmax(fmax(-u, -v), u + v - 1) : fmax(fmax(u - 1, v - 1), 1 - u - v);
}

/* Returns 0 if the answer equals that of the search, 1 if it is right but for rounding, 2 if it is wrong. */
static int judge(const float at[2], unsigned level)
{
    struct point p = {clamped(at[0]), clamped(at[1])};
    uint32_t answer = micro_triangle_index(at[0], at[1], level);
    bool is_beyond = p.u + p.v > 1;
    if (is_beyond)
        p.u = 1 - p.v;
    if (answer >= micro_triangle_count(level))
        return 2;
    if (answer == search(p, level))
        return 0;
    /* A sum of two floats below 1 is rounded by at most 2^-25; u may have moved by the rounding of 1 - v. */
    return outside(p, answer, level) <= 0x1p-24 ? 1 : 2;
}

int main(int argc, char **argv)
{
    uint64_t count = argc > 1 ? strtoull(argv[1], NULL, 10) : 1000000, uncertain = 0, wrong = 0;
    struct random random = {argc > 2 ? strtoull(argv[2], NULL, 10) : 1};
    for (uint64_t i = 0; i < count; i++) {
        float at[2] = {0, 0};
        unsigned level = (unsigned)(i % (MICRO_LEVEL_MAX + 1));
        choose(&random, level, at);
        int verdict = judge(at, level);
        uncertain += verdict == 1;
        wrong += verdict == 2;
        if (verdict == 2 && wrong <= 20)
            printf("wrong: level %u, u %a, v %a: micro-triangle %" PRIu32 "\n", level, (double)at[0], (double)at[1],
                   micro_triangle_index(at[0], at[1], level));
    }
    printf("%" PRIu64 " points: %" PRIu64 " wrong, %" PRIu64 " uncertain\n", count, wrong, uncertain);
    return wrong ? 1 : 0;
}
