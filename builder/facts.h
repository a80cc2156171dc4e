/* SPDX-License-Identifier: Apache-2.0 */
/*
 * facts.h - what a structure's primitives are like, told cheaply: a look at some of them, evenly spread in the order of their ids.
 *
 * Of canonical bytes alone, by additions, products, quotients and roots in double: the same on every machine.
 */
#ifndef BVHD_FACTS_H
#define BVHD_FACTS_H

#include "canonical.h"

/* One primitive of so many is looked at, and no more than is worth it: 1 or 2 % of the quickest build. */
enum { FACTS_SHARE = 32, FACTS_LEAST = 64, FACTS_MOST = 1024 };

struct facts {
    uint32_t primitives; /* of the structure */
    uint32_t sampled;
    uint32_t met; /* of the sampled ones, those that a ray can meet; without any the rest is 0 */
    bool can_split; /* triangles, of a build whose flags let them be split */
    /* Boxes of primitives that a line at random through the box of all passes through: by surface areas, of convex bodies the chance to be met. */
    double crossings;
    /*
     * The part of these, 0 .. 1, that a triangle's slant makes: the half area of boxes beyond that of two triangles, which is the box's when it has no thickness. That
     * is what splits can take away. 0 for whatever is no triangle.
     */
    double slant;
    double spread; /* of sizes (sums of a box's sides): the standard deviation in octaves */
};

/* `canonical` comes from prepare or prepare_open. Some 100 ns a sampled primitive, or 300 when nothing is in the caches. */
void facts_gather(const struct canonical *canonical, struct facts *ret_facts);

/* The logarithm to base 2 of a positive finite number, to 0.01, and its inverse to 0.5 %, without the library's, which differs from machine to machine. */
double facts_log2(double value);
double facts_exp2(double value);

#endif
