/* SPDX-License-Identifier: Apache-2.0 */
/*
 * validate_batch.h - checks the rules between the entries of one call. Clients check them too, because a client may cut
 * a call into several requests.
 */
#ifndef BVHD_VALIDATE_BATCH_H
#define BVHD_VALIDATE_BATCH_H

#include "proto/base/geometry.h"
#include "proto/base/memory.h"
#include "proto/base/status.h"

/*
 * Checks three rules for each entry: its destination is not another entry's destination (VUID 03698), its source, in an
 * update, is not another entry's destination (03403), and none of its references is another entry's destination
 * (03407). Handles 0 are ignored. An entry that breaks a rule fails alone; two entries with one destination both fail.
 * Takes O(n log n) time in entries and references. Changes nothing else.
 *
 * Writes BVHD_OK or an error for each entry to ret_errors[count]. Returns BVHD_NO_MEMORY if it could not check.
 */
enum bvhd_status validate_batch(const struct build_input *inputs, uint32_t count, struct memory *memory,
                                struct bvhd_error *ret_errors);

/*
 * Checks the first two rules alone, for a caller that builds what the references name before the entries that have
 * them.
 */
enum bvhd_status validate_batch_destinations(const struct build_input *inputs, uint32_t count, struct memory *memory,
                                             struct bvhd_error *ret_errors);

#endif
