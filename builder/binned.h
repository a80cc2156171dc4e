/* SPDX-License-Identifier: Apache-2.0 */
/*
 * binned.h - our own builder of a piece: binned SAH (Wald 2007) down to the leaves, on one thread.
 *
 * No slower than Embree's MEDIUM and of the same quality.
 */
#ifndef BVHD_BINNED_H
#define BVHD_BINNED_H

#include <stdatomic.h>

#include "ir.h"
#include "primitive.h"

struct binned_request {
    struct primitive_ref *refs, *scratch; /* `count` each; what they hold afterwards is of no use */
    uint32_t count; /* >= 1 */
    uint32_t leaf_max; /* >= 1; a node of so many refs or fewer is a leaf */
    const atomic_bool *cancel; /* may be NULL; looked at every few thousand refs */
};

/*
 * Magnitudes are at most 2^40. *ret_ir is made by ir_init from `memory`. Where nothing separates the refs they are halved in their order.
 * BVHD_NO_MEMORY, BVHD_CANCELLED.
 */
enum bvhd_status binned_build(const struct binned_request *request, struct memory *memory, struct ir *ret_ir, struct bvhd_error *error);

#endif
