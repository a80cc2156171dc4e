/* SPDX-License-Identifier: Apache-2.0 */
/* depth.h - a pass over an ir: no leaf deeper than a limit, at the least cost in quality. */
#ifndef BVHD_DEPTH_H
#define BVHD_DEPTH_H

#include "ir.h"

/*
 * Rebuilds, balanced over their leaves in order, the smallest subtrees that reach below `limit` levels and have an ancestor where that
 * fits. Needs ceil(log2(leaves)) + 1 <= limit, else BVHD_TOO_LARGE. Refs and their order stay; node indices change. Does nothing to a
 * tree that fits.
 */
enum bvhd_status depth_limit(struct ir *ir, uint32_t limit, struct bvhd_error *error);

#endif
