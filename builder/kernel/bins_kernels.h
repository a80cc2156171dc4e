/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bins_kernels.h - the loops of bins.c over refs, once for every machine and once for machines with AVX2. Both give the
 * same bits.
 */
#ifndef BVHD_BINS_KERNELS_H
#define BVHD_BINS_KERNELS_H

#include "builder/kernel/bins.h"

struct bins_kernels {
    /*
     * Does what bins_clear does. Use clear and add of the same set: one set stores a box in two halves, and the other
     * loads it as a whole, which is slow directly after such a store (store forwarding fails).
     */
    void (*clear)(struct bins *bins, const struct bins_mapping *mapping);
    /* Adds refs with an even index to sets[0] and the others to sets[1]; both may point to the same bins. */
    void (*add)(struct bins *const sets[2], const struct bins_mapping *mapping, const struct primitive_ref *refs,
                uint32_t count);
    /* Does what bins_partition does. */
    void (*partition)(const struct bins_mapping *mapping, const struct bins_plane *plane,
                      const struct primitive_ref *refs, uint32_t count, struct primitive_ref *left,
                      struct primitive_ref *right, struct vec4_box ret_centroids[2]);
};

extern const struct bins_kernels bins_kernels_plain;

/* Returns NULL when this machine or this build has no AVX2. */
const struct bins_kernels *bins_kernels_avx2(void);

#endif
