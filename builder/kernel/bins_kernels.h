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
     * Does what bins_clear does. The same set of kernels has to clear and to add: a box that is stored in two halves is
     * slow to load as a whole directly afterwards.
     */
    void (*clear)(struct bins *bins, const struct bins_mapping *mapping);
    /* Adds even refs to sets[0] and odd ones to sets[1]; both may point to the same bins. */
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
