/* SPDX-License-Identifier: Apache-2.0 */
/*
 * facts.h - what a structure's primitives are like, told cheaply: a look at some of them, evenly spread in the order of
 * their ids.
 *
 * Of canonical bytes alone, by additions, products, quotients and comparisons in double: the same on every machine.
 */
#ifndef BVHD_FACTS_H
#define BVHD_FACTS_H

#include "builder/format/canonical.h"

/*
 * One primitive of so many is looked at, and no more than is worth it: 1 or 2 % of the quickest build. From how many of
 * them the others are seen.
 */
enum { FACTS_SHARE = 32, FACTS_LEAST = 64, FACTS_MOST = 1024, FACTS_VIEWS = 32 };

struct facts {
    uint32_t primitives; /* of the structure */
    uint32_t sampled;
    uint32_t met; /* of the sampled ones, those that a ray can meet; without any the rest is 0 */
    bool can_split; /* triangles, of a build whose flags let them be split */
    /*
     * Boxes of other primitives that a ray passes through which starts at a primitive in any direction, if nothing
     * stops it: half of them start at primitives that are drawn one like another, half by their boxes' areas. Of a box
     * of half area A at the distance d (0 inside) it is taken to be A / (A + 8 pi d^2): 1 inside, and far away a convex
     * body's mean share of all directions.
     */
    double crossings;
    /*
     * The part of the boxes' area that larger ones have beyond an equal share: 0 when all are alike, nearly 1 when one
     * has it all.
     */
    double unevenness;
    double thickness; /* the shortest side of the box of all, as a part of its longest; 0 when they are a point */
};

/*
 * `canonical` comes from prepare or prepare_open. Some 100 ns a sampled primitive, 200 when nothing is in the caches.
 */
void facts_gather(const struct canonical *canonical, struct facts *ret_facts);

/*
 * The logarithm to base 2 of a positive finite number, to 0.01, and its inverse to 0.5 %, without the library's, which
 * differs from machine to machine.
 */
double facts_log2(double value);
double facts_exp2(double value);

#endif
