/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scatter.h - the top of a build for qualities fast and balanced: divides the refs into pieces in two passes. The
 * planes are found on a sample by binned SAH (scatter_plan.h), and then every ref is sent directly to its piece.
 *
 * Refs about as large as the whole scene (outsize refs) would enlarge the box of every node above them, so they form a
 * separate piece directly below the root. A piece that comes out much larger than the sample predicts is divided again
 * by split_refs.
 */
#ifndef BVHD_SCATTER_H
#define BVHD_SCATTER_H

#include "builder/top/split.h"

/*
 * Does what split_refs does, with these differences: the pieces lie in request->scratch; of the bounds in the tree's
 * nodes only the root's are set; and request->piece_size is a target, as a piece can have up to 2 * piece_size + 1
 * refs. The result is the same for any number of threads. Returns BVHD_CANCELLED or BVHD_NO_MEMORY.
 */
enum bvhd_status scatter_refs(const struct split_request *request, struct memory *memory,
                              const struct parallel *parallel, struct split_tree *ret_tree, struct bvhd_error *error);

#endif
