/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/oracle_hull.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

/* The golden section shortens the interval to 0.618 of its length: in 70 steps to less than a double can tell apart. */
enum { STEPS = 70 };

static const double golden = 0.6180339887498949;

static double mix(const double ends[2], double z)
{
    return (1 - z) * ends[0] + z * ends[1];
}

static double distance(const struct oracle_hull *hull, double z)
{
    double square = 0;
    for (int axis = 0; axis < 3; axis++) {
        const double ends[2] = {hull->across[0][axis], hull->across[1][axis]};
        square += mix(ends, z) * mix(ends, z);
    }
    return sqrt(square);
}

double oracle_hull_gap(const struct oracle_hull *hull, double z)
{
    return distance(hull, z) - mix(hull->radius, z);
}

double oracle_hull_entry(const struct oracle_hull *hull, double z)
{
    double apart = distance(hull, z), radius = mix(hull->radius, z);
    return mix(hull->along, z) - (radius > apart ? sqrt((radius - apart) * (radius + apart)) : 0);
}

/* Returns whether the line is nearer to the sphere at a than to that at b. */
static bool is_nearer(const struct oracle_hull *hull, double a, double b)
{
    return oracle_hull_gap(hull, a) < oracle_hull_gap(hull, b);
}

/* Returns whether the line enters the sphere at a before that at b; spheres that it misses come last, by their gap. */
static bool is_earlier(const struct oracle_hull *hull, double a, double b)
{
    double gap_a = oracle_hull_gap(hull, a), gap_b = oracle_hull_gap(hull, b);
    if (gap_a > 0 || gap_b > 0)
        return gap_a < gap_b;
    return oracle_hull_entry(hull, a) < oracle_hull_entry(hull, b);
}

/* Returns whether the spheres at all z are the same one. */
static bool is_sphere(const struct oracle_hull *hull)
{
    return memcmp(hull->across[0], hull->across[1], sizeof hull->across[0]) == 0 && hull->along[0] == hull->along[1] &&
           hull->radius[0] == hull->radius[1];
}

/* Finds the best z. The ends are compared, too, because a search only comes near them. */
static double search(const struct oracle_hull *hull,
                     bool (*is_better)(const struct oracle_hull *hull, double a, double b))
{
    if (is_sphere(hull))
        return 0;
    double low = 0, high = 1, a = high - golden * (high - low), b = low + golden * (high - low);
    for (int step = 0; step < STEPS; step++) {
        if (is_better(hull, a, b)) {
            high = b;
            b = a;
            a = high - golden * (high - low);
        } else {
            low = a;
            a = b;
            b = low + golden * (high - low);
        }
    }
    double best = 0.5 * (low + high);
    for (int end = 0; end < 2; end++)
        best = is_better(hull, best, end) ? best : end;
    return best;
}

double oracle_hull_nearest(const struct oracle_hull *hull)
{
    return search(hull, is_nearer);
}

double oracle_hull_first(const struct oracle_hull *hull)
{
    return search(hull, is_earlier);
}
