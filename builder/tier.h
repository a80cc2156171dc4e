/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tier.h - which quality pays: what each costs to build and to trace, as far as a look at the primitives tells.
 *
 *     cost(tier) = primitives * (build_ns(tier) + rays a primitive * ray_ns(tier))
 *
 * A model with few constants, fitted to measurements (`bvhd-bench --calibrate` makes them anew, PERFORMANCE.md tells
 * how good it is). Of times only their ratios count, so it holds for machines other than that which was measured, and
 * for any number of threads.
 */
#ifndef BVHD_TIER_H
#define BVHD_TIER_H

#include "builder/facts.h"
#include "proto/base/geometry.h"

/*
 * What a constant is multiplied with: 1; of crossings the logarithm (to base 2, of 1 + them) and its square; of
 * thickness the logarithm's square; the square for crossings once more, times unevenness, for few large boxes can be
 * split and many alike cannot.
 */
enum { TIER_TERMS = 5 };
void tier_terms(const struct facts *facts, double ret_terms[TIER_TERMS]);

struct tier_cost {
    double build_ns, ray_ns; /* a primitive; a ray */
};

/* On one thread. `quality`: FAST, BALANCED or HIGH. */
struct tier_cost tier_cost(enum build_quality quality, const struct facts *facts);

/*
 * The quality of least cost; of equal ones the faster; high only where it can split, which is what it is for.
 * `rays_per_primitive` is finite and not negative. Never UNSPECIFIED or AUTO.
 */
enum build_quality tier_choose(const struct facts *facts, float rays_per_primitive);

/*
 * What becomes of a request: a named quality is itself; UNSPECIFIED is what Vulkan's PREFER flags say (FAST_BUILD:
 * fast, FAST_TRACE: high), else AUTO; AUTO is the one of least cost, and balanced where nothing is said of rays. Looks
 * at primitives only when it has to choose. Never UNSPECIFIED or AUTO; the same again for what it returns.
 */
enum build_quality tier_resolve(const struct canonical *canonical, const struct build_options *options);

#endif
