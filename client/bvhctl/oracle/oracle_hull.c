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

/* The entry of a sphere at a known distance from the line. */
static double entry_at(const struct oracle_hull *hull, double z, double apart)
{
    double radius = mix(hull->radius, z);
    return mix(hull->along, z) - (radius > apart ? sqrt((radius - apart) * (radius + apart)) : 0);
}

double oracle_hull_gap(const struct oracle_hull *hull, double z)
{
    return distance(hull, z) - mix(hull->radius, z);
}

double oracle_hull_entry(const struct oracle_hull *hull, double z)
{
    return entry_at(hull, z, distance(hull, z));
}

/* The sphere at z as a search compares it; its entry counts only where the line does not miss it. */
struct place {
    double z, gap, entry;
};

static struct place place_near(const struct oracle_hull *hull, double z)
{
    return (struct place){.z = z, .gap = oracle_hull_gap(hull, z)};
}

static struct place place_early(const struct oracle_hull *hull, double z)
{
    const double apart = distance(hull, z);
    struct place place = {.z = z, .gap = apart - mix(hull->radius, z)};
    if (!(place.gap > 0))
        place.entry = entry_at(hull, z, apart);
    return place;
}

/* Returns whether the line is nearer to the sphere at a than to that at b. */
static bool is_nearer(const struct place *a, const struct place *b)
{
    return a->gap < b->gap;
}

/* Returns whether the line enters the sphere at a before that at b; spheres that it misses come last, by their gap. */
static bool is_earlier(const struct place *a, const struct place *b)
{
    if (a->gap > 0 || b->gap > 0)
        return a->gap < b->gap;
    return a->entry < b->entry;
}

/* Returns whether the spheres at all z are the same one. */
static bool is_sphere(const struct oracle_hull *hull)
{
    return memcmp(hull->across[0], hull->across[1], sizeof hull->across[0]) == 0 && hull->along[0] == hull->along[1] &&
           hull->radius[0] == hull->radius[1];
}

/* Finds the best z. Each place is computed once. The ends are compared, too, because a search only comes near them. */
static inline double search(const struct oracle_hull *hull,
                            struct place (*place_at)(const struct oracle_hull *hull, double z),
                            bool (*is_better)(const struct place *a, const struct place *b))
{
    if (is_sphere(hull))
        return 0;
    double low = 0, high = 1;
    struct place a = place_at(hull, high - golden * (high - low)), b = place_at(hull, low + golden * (high - low));
    for (int step = 0; step < STEPS; step++) {
        if (is_better(&a, &b)) {
            high = b.z;
            b = a;
            a = place_at(hull, high - golden * (high - low));
        } else {
            low = a.z;
            a = b;
            b = place_at(hull, low + golden * (high - low));
        }
    }
    struct place best = place_at(hull, 0.5 * (low + high));
    for (int end = 0; end < 2; end++) {
        const struct place last = place_at(hull, end);
        best = is_better(&best, &last) ? best : last;
    }
    return best.z;
}

double oracle_hull_nearest(const struct oracle_hull *hull)
{
    return search(hull, place_near, is_nearer);
}

double oracle_hull_first(const struct oracle_hull *hull)
{
    return search(hull, place_early, is_earlier);
}
