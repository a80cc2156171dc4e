/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sample_cut.h - finds the plane that divides a part of the sample (scatter_plan.h), and divides the part by it. Large
 * parts are cut on all threads: otherwise these would wait for one that has to get the sample from the caches of the
 * others. The plane, and which refs are on each side, are the same for any number of threads.
 */
#ifndef BVHD_SAMPLE_CUT_H
#define BVHD_SAMPLE_CUT_H

#include "builder/kernel/primitive_ref.h"
#include "proto/base/parallel.h"

/* Refs whose centroid (min + max) on `axis` is below the threshold are on the left. */
struct sample_plane {
    float threshold;
    uint32_t axis;
};

/* Returns whether a part of `count` refs is worth several threads. */
bool sample_is_large(uint32_t count, const struct parallel *parallel);

/* Finds the plane by binned SAH. Returns false if there is none. */
bool sample_plane_find(const struct primitive_ref *refs, uint32_t count, const struct parallel *parallel,
                       struct sample_plane *ret_plane);

/* Moves refs on the left to the front, without keeping their order, and returns how many there are. */
uint32_t sample_divide(struct primitive_ref *refs, uint32_t count, const struct sample_plane *plane);

/* The same for a large part, but the refs are copied to another array. */
uint32_t sample_divide_into(const struct primitive_ref *refs, uint32_t count, const struct sample_plane *plane,
                            const struct parallel *parallel, struct primitive_ref *ret_refs);

#endif
