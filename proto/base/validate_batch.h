/* SPDX-License-Identifier: Apache-2.0 */
/*
 * validate_batch.h - the rules between the entries of one call. A client decides them too: it may cut a call into
 * several requests.
 */
#ifndef BVHD_VALIDATE_BATCH_H
#define BVHD_VALIDATE_BATCH_H

#include "proto/base/geometry.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/*
 * Row F17, for each entry: its destination is nobody else's (03698), its source, when it updates, is no other entry's
 * destination (03403), none of its references is another entry's destination (03407). Handles 0 are ignored. An entry
 * that breaks a rule fails alone; of two with one destination both do. O(n log n) in entries and references. Pure.
 *
 * ret_errors[count]: BVHD_OK or the error of each entry. BVHD_NO_MEMORY when it could not check.
 */
enum bvhd_status validate_batch(const struct build_input *inputs, uint32_t count, struct memory *memory,
                                struct bvhd_error *ret_errors);

#endif
