/* SPDX-License-Identifier: Apache-2.0 */
/*
 * tier.h - chooses a build quality: estimates, from a sample of the primitives (facts.h), how long each quality takes
 * to build and how long a ray then takes to trace.
 *
 *     cost(tier) = primitives * (build_ns(tier) + rays per primitive * ray_ns(tier))
 *
 * The model has few constants, which are fitted to measurements (`bvhd-bench --calibrate` fits them again;
 * PERFORMANCE.md says how good the model is). Only ratios of times matter for a choice, so it holds for machines other
 * than the measured one, and for any number of threads.
 */
#ifndef BVHD_TIER_H
#define BVHD_TIER_H

#include "builder/facts.h"
#include "proto/base/geometry.h"

/*
 * Fills the terms of the model. Each time is 2^e nanoseconds, where e is a sum of these terms times fitted constants.
 * With L = log2(1 + crossings), T = log2(thickness) and U = unevenness they are
 *
 *     1, L, L^2 / 8, T^2 / 6, U * L^2 / 16
 *
 * where crossings are at most 4096 and thickness at least 1/64. The last term stands for spatial splits, which help
 * where a few boxes are large, but not where many are of one size.
 */
enum { TIER_TERMS = 5 };
void tier_terms(const struct facts *facts, double ret_terms[TIER_TERMS]);

struct tier_cost {
    /* nanoseconds for each primitive; nanoseconds for each ray */
    double build_ns, ray_ns;
};

/* Estimates the times of one thread for a quality. `quality`: FAST, BALANCED or HIGH. */
struct tier_cost tier_cost(enum build_quality quality, const struct facts *facts);

/*
 * Returns the quality of least cost, and the faster of two that cost the same. HIGH is considered only where
 * facts->can_split, because splits are what it is for. `rays_per_primitive` is finite and not negative. The result is
 * FAST, BALANCED or HIGH.
 */
enum build_quality tier_choose(const struct facts *facts, float rays_per_primitive);

/*
 * Resolves the quality that a request asks for to the one that is built. A named quality is kept. UNSPECIFIED follows
 * Vulkan's PREFER flags (FAST_BUILD: FAST, FAST_TRACE: HIGH); without them it is treated as AUTO. AUTO becomes the
 * quality of least cost, and BALANCED when the request says nothing about rays. Reads primitives only when it has to
 * choose. The result is FAST, BALANCED or HIGH, and resolving it again gives the same.
 */
enum build_quality tier_resolve(const struct canonical *canonical, const struct build_options *options);

#endif
