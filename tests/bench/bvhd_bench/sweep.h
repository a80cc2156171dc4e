/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sweep.h - builds the reference tree that others are compared with: a full sweep of the surface area heuristic, which
 * tries every position on every axis at every node.
 *
 * A traversal step and an intersection cost 1 each; a node becomes a leaf where no split is cheaper. The builder is
 * slow and greedy, and has neither reinsertion nor spatial splits.
 */
#ifndef BVHD_BENCH_SWEEP_H
#define BVHD_BENCH_SWEEP_H

#include "builder/input/primitive.h"
#include "tests/bench/bvhd_bench/tree.h"

struct tree sweep_build(const struct primitive_ref *refs, uint32_t count);

#endif
