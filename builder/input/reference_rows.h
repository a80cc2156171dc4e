/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reference_rows.h - the structures that instances name: from the caller's handles to rows of a canonical copy's
 * reference table.
 *
 * The canonical table lists what is named, in the order of first use: handles themselves do not enter a key. Two
 * handles are two rows whatever they name, since only the caller knows which structure each stands for.
 */
#ifndef BVHD_REFERENCE_ROWS_H
#define BVHD_REFERENCE_ROWS_H

#include "builder/input/canonical_form.h"
#include "builder/context.h"
#include "proto/base/handle_table.h"

struct reference_lookup {
    struct handle_entry *entries; /* sorted; a number is the position in the caller's table */
    uint32_t count;
};

/*
 * Checks the caller's table (kinds, handles, bounds; BVHD_INVALID with the place) and sorts it. `index`: of the entry,
 * for errors.
 */
enum bvhd_status reference_lookup_init(const struct build_input *input, uint32_t index,
                                       const struct build_context *context, struct reference_lookup *ret_lookup,
                                       struct bvhd_error *error);
void reference_lookup_finish(struct reference_lookup *lookup, struct memory *memory);

/* 1-based position in the caller's table; 0 for an unknown handle. Handle 0 is unknown. */
uint64_t reference_lookup_find(const struct reference_lookup *lookup, uint64_t handle);

struct reference_rows {
    struct form_reference *rows; /* of `memory`, freed by the caller; NULL without any */
    uint32_t count;
};

/*
 * Records come in with 1-based positions in `references` (0: inactive) in their reference field, and leave with 1-based
 * rows of *ret_rows. BVHD_NO_MEMORY and BVHD_CANCELLED leave the records in between.
 */
enum bvhd_status reference_rows_make(unsigned char *records, uint32_t record_count, const struct reference *references,
                                     uint32_t reference_count, const struct build_context *context,
                                     struct reference_rows *ret_rows, struct bvhd_error *error);

#endif
