/* SPDX-License-Identifier: Apache-2.0 */
/*
 * crossing.h - decides whether what moves crosses, so that it should be divided by moving_split.h.
 *
 * Two places of the structure are looked at, found on a sample that is spread over all primitives. Of each some hundred
 * neighbours are divided twice, by their boxes of all times and by those of both ends. It crosses if the second tree's
 * nodes have areas at both ends that are clearly smaller.
 */
#ifndef BVHD_CROSSING_H
#define BVHD_CROSSING_H

#include "builder/input/primitive.h"

/*
 * Returns in *ret_crosses whether it does; false for what does not move. `refs` are those of the copy, with or without
 * gaps between blocks, runs or not; their magnitudes are at most 2^40. The answer is the same on every machine. Takes
 * up to 4 % of the time of a quick build. Returns BVHD_NO_MEMORY.
 */
enum bvhd_status crossing_find(const struct canonical *canonical, const struct primitive_refs *refs,
                               struct memory *memory, bool *ret_crosses);

#endif
