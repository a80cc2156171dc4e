/* SPDX-License-Identifier: Apache-2.0 */
/* micromap_usages.h - counts triangles of micromaps by format and level, as requests do and as their arrays say. */
#ifndef BVHD_MICROMAP_USAGES_H
#define BVHD_MICROMAP_USAGES_H

#include "builder/format/micro_triangle.h"
#include "proto/base/geometry.h"
#include "proto/base/place.h"
#include "proto/base/status.h"

enum { MICROMAP_FORMATS = 2 };

/* Numbers of triangles by format, from enum micro_format on, and level. */
struct micromap_usages {
    uint64_t counts[MICROMAP_FORMATS][MICRO_LEVEL_MAX + 1];
};

/* Returns whether there are triangles of that format and level. */
static inline bool micromap_usage_is_valid(uint32_t format, uint32_t level)
{
    return (format == MICRO_2_STATE || format == MICRO_4_STATE) && level <= MICRO_LEVEL_MAX;
}

/*
 * Adds up what a request says, and reads each byte once. `where`: the place of the array. `flags`: BUILD_ of a
 * micromap, which decide about rules. Returns BVHD_INVALID with the rule of a format or level that there is not.
 */
enum bvhd_status micromap_usages_read(const struct bytes *usages, uint32_t flags, struct place where,
                                      struct micromap_usages *ret_usages, struct bvhd_error *error);

/* Returns the sum of all numbers. */
uint64_t micromap_usages_total(const struct micromap_usages *usages);

/* Compares what a request says with the triangles. Returns BVHD_INVALID with the first difference. */
enum bvhd_status micromap_usages_compare(const struct micromap_usages *said, const struct micromap_usages *found,
                                         struct place where, struct bvhd_error *error);

#endif
