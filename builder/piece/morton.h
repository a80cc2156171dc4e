/* SPDX-License-Identifier: Apache-2.0 */
/*
 * morton.h - sorts refs along a Morton curve through their centroids, so that neighbours in the order are close in
 * space.
 */
#ifndef BVHD_MORTON_H
#define BVHD_MORTON_H

#include "builder/kernel/primitive_ref.h"

struct morton_key {
    uint32_t code, ref;
};

/*
 * Copies `count` refs to `ret_sorted` in the order of the curve. The cells of the curve are cubes, 256 along the
 * longest side of the centroids' box; refs of one cell keep their order. `keys` has room for 2 * count. Magnitudes are
 * at most 2^40.
 */
void morton_sort(const struct primitive_ref *refs, uint32_t count, struct morton_key *keys,
                 struct primitive_ref *ret_sorted);

#endif
