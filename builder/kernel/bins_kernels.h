/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bins_kernels.h - the two loops over refs of bins.c, in a form for every machine and one for those with AVX2, to the
 * same bits.
 */
#ifndef BVHD_BINS_KERNELS_H
#define BVHD_BINS_KERNELS_H

#include "builder/kernel/bins.h"

struct bins_kernels {
    /*
     * As bins_clear. What is stored in two halves is slow to load as a whole right after: who adds must have cleared.
     */
    void (*clear)(struct bins *bins, const struct bins_mapping *mapping);
    /* Even refs go to sets[0], odd ones to sets[1]; the two may be one. */
    void (*add)(struct bins *const sets[2], const struct bins_mapping *mapping, const struct primitive_ref *refs,
                uint32_t count);
    /* As bins_partition. */
    void (*partition)(const struct bins_mapping *mapping, const struct bins_plane *plane,
                      const struct primitive_ref *refs, uint32_t count, struct primitive_ref *left,
                      struct primitive_ref *right, struct vec4_box ret_centroids[2]);
};

extern const struct bins_kernels bins_kernels_plain;

/* NULL where this machine, or this build, has none. */
const struct bins_kernels *bins_kernels_avx2(void);

#endif
