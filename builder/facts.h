/* SPDX-License-Identifier: Apache-2.0 */
/*
 * facts.h - samples a structure's primitives, to estimate cheaply what a ray will meet in it. tier.h chooses the build
 * quality by these facts.
 *
 * The sample is spread evenly over the primitives' numbers. Facts are computed from the canonical bytes alone, by
 * additions, products, quotients and comparisons in double, so that they are the same on every machine.
 */
#ifndef BVHD_FACTS_H
#define BVHD_FACTS_H

#include "builder/format/canonical.h"

/*
 * Sizes of the sample: one primitive of every FACTS_SHARE, at least FACTS_LEAST and at most FACTS_MOST, which keeps the
 * cost at 1 or 2 % of the quickest build; crossings are counted from FACTS_VIEWS of them.
 */
enum { FACTS_SHARE = 32, FACTS_LEAST = 64, FACTS_MOST = 1024, FACTS_VIEWS = 32 };

struct facts {
    uint32_t primitives; /* of the whole structure */
    uint32_t sampled;
    uint32_t met; /* sampled primitives that a ray can hit; when 0, the fields below except can_split are 0 */
    /* the primitives are triangles, and the build's flags allow splits (no LOW_MEMORY, no ALLOW_UPDATE) */
    bool can_split;
    /*
     * Mean number of other primitives' boxes that a ray passes through when it starts at a primitive, in a random
     * direction, and nothing stops it. Half of the starting primitives are drawn uniformly, half in proportion to the
     * areas of their boxes. A box of half area A at distance d (0 when the ray starts inside) counts as
     * A / (A + 8 pi d^2): 1 inside, and far away a convex body's mean share of all directions.
     */
    double crossings;
    /*
     * Share of the boxes' total area that lies above the mean area: 0 when all boxes have the same area, nearly 1 when
     * one has nearly all.
     */
    double unevenness;
    double thickness; /* shortest side of the bounds of all, divided by the longest; 0 when they are a point */
};

/*
 * Fills *ret_facts. `canonical` comes from prepare or prepare_open. Takes about 100 ns for each sampled primitive,
 * 200 ns when nothing is in the caches. Allocates nothing and cannot fail.
 */
void facts_gather(const struct canonical *canonical, struct facts *ret_facts);

/*
 * Base-2 logarithm of a positive finite number, with an error below 0.01, and its inverse, with a relative error below
 * 0.5 %. They replace log2() and exp2(), whose last bits differ between machines.
 */
double facts_log2(double value);
double facts_exp2(double value);

#endif
