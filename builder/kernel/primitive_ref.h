/* SPDX-License-Identifier: Apache-2.0 */
/* primitive_ref.h - what builders sort: a box with the number of the primitive that it bounds. */
#ifndef BVHD_PRIMITIVE_REF_H
#define BVHD_PRIMITIVE_REF_H

#include <stdint.h>

#include "proto/base/box.h"

/*
 * A box and its owner in 32 bytes, a vector register each half; Embree's RTCBuildPrimitive looks the same, so
 * benchmarks hand it over without a copy.
 */
struct primitive_ref {
    float min[3];
    /* 0; of a run (primitive_collect_blocks) how many primitives follow the first; from then on the builder's own */
    uint32_t link;
    float max[3];
    uint32_t id; /* flat primitive id */
};

/* The box of all refs, and that of min + max of each, which is twice its centre; both are empty when there are no refs. */
void primitive_ref_bounds(const struct primitive_ref *refs, uint32_t count, struct box *ret_bounds,
                          struct box *ret_centroids);

static inline struct box primitive_ref_box(const struct primitive_ref *ref)
{
    return (struct box){{ref->min[0], ref->min[1], ref->min[2]}, {ref->max[0], ref->max[1], ref->max[2]}};
}

#endif
