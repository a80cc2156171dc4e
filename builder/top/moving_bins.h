/* SPDX-License-Identifier: Apache-2.0 */
/*
 * moving_bins.h - divides refs of what moves by the places where they are at t = 0 or at t = 1, with the boxes of both
 * ends: binned SAH (Wald 2007) along six axes.
 *
 * A place is min + max, which is twice the centre. Magnitudes are at most 2^40, so that areas times counts stay in
 * float's range. Results depend only on the refs and their order.
 */
#ifndef BVHD_MOVING_BINS_H
#define BVHD_MOVING_BINS_H

#include "builder/input/primitive.h"
#include "builder/kernel/vec4.h"

/* A ref: at both ends its minimum, and its negated maximum, so that one operation grows both. */
struct moving_ref {
    struct {
        float min[3], negated_max[3];
    } keys[2];
    uint32_t place; /* among the refs before they were divided */
};

struct moving_ref moving_ref_of(const struct box keys[2], uint32_t place);

/* Reads the boxes of a primitive that has a ref. */
void moving_ref_read(struct primitive_finder *finder, uint32_t id, uint32_t place, struct moving_ref *ret_ref);

/* Grows boxes; gives a ref the box of both ends at both ends; returns the sum of half areas of both ends. */
void moving_ref_grow(struct moving_ref *ref, const struct moving_ref *other);
void moving_ref_unite(struct moving_ref *ref);
double moving_ref_area(const struct moving_ref *ref);

/*
 * Moves some refs, of which there are at least two, to the front, and returns how many: at least one, and not all. The
 * sum of the areas of both sides, each times its refs, is the least that planes between the bins give. Without a plane
 * the refs stay, and are halved.
 */
uint32_t moving_bins_divide(struct moving_ref *refs, uint32_t count);

#endif
