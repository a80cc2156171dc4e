/* SPDX-License-Identifier: Apache-2.0 */
/*
 * decay.h - decides from the decay of an update (refit.h) whether building the structure would have paid.
 *
 * A build pays where it takes less time than its tree saves for the rays until the geometry moves again:
 *
 *     build_ns < rays per primitive * (ray_ns through the updated tree - ray_ns through a built tree)
 *
 * Measured on twisted meshes (PERFORMANCE.md), the time of a ray grows about as the square root of the decay, and a
 * build takes as long as 0.13 (FAST), 0.3 (BALANCED) or 1.9 rays (HIGH) for each primitive. Only ratios of times
 * matter, so the rule holds for other machines and numbers of threads, as long as both builds and rays use all of them.
 *
 * Decay compares a tree with the pose of its last build. It tells nothing about a pose that is worse, or better, for
 * every tree, and after a build in an unusual pose it may be below 1 although a build would pay. No other figure
 * that is known without a build does better: the cost of a tree of one scene is several times that of another.
 */
#ifndef BVHD_DECAY_H
#define BVHD_DECAY_H

#include "proto/base/geometry.h"

/*
 * Returns the decay above which building pays, for a structure that was built in this quality; it is more than 1.
 * `rays_per_primitive` are those that are traced before the next update; 0: not known, which counts as 1. FAST and HIGH
 * have constants of their own, any other quality counts as BALANCED.
 */
double decay_to_rebuild(enum build_quality quality, double rays_per_primitive);

#endif
