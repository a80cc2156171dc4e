/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sweep.h - the tree that others are measured by: a full sweep of the surface area heuristic, every position on every
 * axis at every node.
 *
 * Traversal and intersection cost 1; a leaf is made where no split is cheaper. Slow, greedy, without reinsertion and
 * spatial splits.
 */
#ifndef BVHD_BENCH_SWEEP_H
#define BVHD_BENCH_SWEEP_H

#include "builder/input/primitive.h"
#include "tests/bench/bvhd_bench/tree.h"

struct tree sweep_build(const struct primitive_ref *refs, uint32_t count);

#endif
