/* SPDX-License-Identifier: Apache-2.0 */
/*
 * scatter.h - the top of a build in two passes over the refs: planes are found on a sample, by binned SAH, and every
 * ref is sent to its piece at once.
 *
 * Refs about as large as the whole, which would blow up every box on their way down, make a piece of their own below
 * the root. A piece that is larger than expected of the sample is cut by split_refs.
 */
#ifndef BVHD_SCATTER_H
#define BVHD_SCATTER_H

#include "builder/top/split.h"

/*
 * As split_refs, but the pieces lie in request->scratch, and bounds are set of the root alone. request->piece_size is
 * what is aimed at; no piece has more than twice as many refs and one. The same for any number of threads.
 * BVHD_CANCELLED, BVHD_NO_MEMORY.
 */
enum bvhd_status scatter_refs(const struct split_request *request, struct memory *memory,
                              const struct parallel *parallel, struct split_tree *ret_tree, struct bvhd_error *error);

#endif
