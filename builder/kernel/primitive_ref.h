/* SPDX-License-Identifier: Apache-2.0 */
/* primitive_ref.h - defines the refs that builders sort: a box with the number of the primitive that it bounds. */
#ifndef BVHD_PRIMITIVE_REF_H
#define BVHD_PRIMITIVE_REF_H

#include <stdint.h>

#include "proto/base/box.h"

/*
 * A reference to a primitive in 32 bytes, which are two vector registers. Embree's RTCBuildPrimitive has the same
 * layout, so benchmarks hand over an array without a copy.
 */
struct primitive_ref {
    float min[3];
    /*
     * Number of primitives that follow the first one in a run (primitive_collect_blocks), else 0. Once a builder has
     * read it, the field is free for its own use.
     */
    uint32_t link;
    float max[3];
    uint32_t id; /* number of the primitive (of the run's first one), counted over all geometries */
};

/*
 * Computes the box of all refs, and the box of their centroids min + max, which are twice the centres. Both are empty
 * when there are no refs.
 */
void primitive_ref_bounds(const struct primitive_ref *refs, uint32_t count, struct box *ret_bounds,
                          struct box *ret_centroids);

static inline struct box primitive_ref_box(const struct primitive_ref *ref)
{
    return (struct box){{ref->min[0], ref->min[1], ref->min[2]}, {ref->max[0], ref->max[1], ref->max[2]}};
}

#endif
