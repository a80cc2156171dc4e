/* SPDX-License-Identifier: Apache-2.0 */
/*
 * moving_split.h - divides refs of what moves into small pieces that stay together at all times.
 *
 * Other splits see one box for each ref, which holds it at all times. Where neighbours move together that is as good.
 * Where they do not, as in flocks that cross or traffic in two directions, all these boxes overlap: what is near in
 * them is far apart at most times. Here a part is divided by the places of its refs at t = 0 or at t = 1, and the cost
 * of a division is that of the boxes at both ends, whose areas bound those between. This is binned SAH (Wald 2007) with
 * two boxes in each bin, along six axes. It takes about seven times as long as splits of one box do, and is meant for
 * what crosses (crossing.h).
 */
#ifndef BVHD_MOVING_SPLIT_H
#define BVHD_MOVING_SPLIT_H

#include "builder/format/canonical.h"
#include "builder/top/split.h"

/*
 * Does what split_refs does, but the refs lie in request->scratch afterwards, and the bounds of nodes are not set.
 * Each ref stands for one primitive of the copy, and its box is not read. Blocks must have no gaps between them.
 */
enum bvhd_status moving_split(const struct split_request *request, const struct canonical *canonical,
                              struct memory *memory, const struct parallel *parallel, struct split_tree *ret_tree,
                              struct bvhd_error *error);

#endif
