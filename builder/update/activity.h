/* SPDX-License-Identifier: Apache-2.0 */
/*
 * activity.h - tells which primitives of a canonical copy are active, that is, which a ray could hit. An update must
 * not change that (Vulkan specification, Inactive Primitives and Instances).
 */
#ifndef BVHD_ACTIVITY_H
#define BVHD_ACTIVITY_H

#include "builder/context.h"
#include "builder/format/canonical.h"

/* Returns how many 64-bit words hold one bit for each primitive. */
static inline uint64_t activity_words(uint32_t primitives)
{
    return ((uint64_t)primitives + 63) / 64;
}

/*
 * Counts the primitives that are not active. Where no vertex has a NaN, primitives with vertices take one pass over
 * these. Returns BVHD_OK or BVHD_CANCELLED.
 */
enum bvhd_status activity_count(const struct canonical *canonical, const struct build_context *context,
                                uint32_t *ret_inactive);

/*
 * Sets bit i % 64 of words[i / 64] if flat primitive i is active, and clears all other bits. Returns BVHD_OK or
 * BVHD_CANCELLED.
 */
enum bvhd_status activity_find(const struct canonical *canonical, const struct build_context *context, uint64_t *words);

#endif
