/* SPDX-License-Identifier: Apache-2.0 */
/*
 * oracle_hull.h - where a line enters the convex hull of two spheres: a search in double, without error bounds, which
 * finds the sphere between the two that decides. oracle_round.c proves bounds with what the search finds.
 *
 * Between the ends, at z = 0 .. 1, the body's spheres have centres and radii that are linear in z. The distance of the
 * line from the centre, less the radius, is convex in z. So are the parts of [0, 1] where the line has entered the
 * sphere by a given t. Both minima are therefore found by comparing values only.
 */
#ifndef BVHD_ORACLE_HULL_H
#define BVHD_ORACLE_HULL_H

/* The spheres at both ends as they lie to a line with a direction of length 1. */
struct oracle_hull {
    double across[2]
                 [3]; /* from the line to the centre, at a right angle to the line, or turned about it by one angle */
    double along[2]; /* of the centre, from the line's origin */
    double radius[2];
};

/* Returns the distance of the line from the sphere at z; negative if the line meets the sphere. */
double oracle_hull_gap(const struct oracle_hull *hull, double z);
/* Returns how far along the line it enters the sphere at z, or comes next to its centre if it does not meet it. */
double oracle_hull_entry(const struct oracle_hull *hull, double z);

/* Returns the z with the least gap. */
double oracle_hull_nearest(const struct oracle_hull *hull);
/*
 * Returns the z at which the line enters first, which is where it enters the hull. Where the line misses the hull it
 * returns the z with the least gap.
 */
double oracle_hull_first(const struct oracle_hull *hull);

#endif
