/* SPDX-License-Identifier: Apache-2.0 */
/*
 * reference_rows.h - turns the handles by which instances name structures into rows of a canonical copy's reference
 * table.
 *
 * The canonical table lists the structures that are named, in the order of first use, so handles do not enter a key.
 * Two handles always give two rows, even for equal structures, because only the caller knows which structure each
 * stands for.
 */
#ifndef BVHD_REFERENCE_ROWS_H
#define BVHD_REFERENCE_ROWS_H

#include "builder/input/canonical_form.h"
#include "builder/context.h"
#include "proto/base/handle_table.h"

struct reference_lookup {
    struct handle_entry *entries; /* sorted by handle; an entry's number is the position in the caller's table */
    uint32_t count;
};

/*
 * Checks the caller's table and sorts it. `index`: the entry's position in its batch, for errors. Returns BVHD_INVALID
 * with the place for a bad handle, bounds or slabs or for a handle that occurs twice, BVHD_UNSUPPORTED for an unknown
 * kind (a top level names bottom levels, and a bottom level micromaps), BVHD_NOT_FOUND for a micromap without bytes,
 * BVHD_NO_MEMORY, or BVHD_CANCELLED. reference_lookup_finish frees the lookup; it may be NULL.
 */
enum bvhd_status reference_lookup_init(const struct build_input *input, uint32_t index,
                                       const struct build_context *context, struct reference_lookup *ret_lookup,
                                       struct bvhd_error *error);
void reference_lookup_finish(struct reference_lookup *lookup, struct memory *memory);

/* Returns the 1-based position in the caller's table; 0 for a handle that is not there, such as handle 0. */
uint64_t reference_lookup_find(const struct reference_lookup *lookup, uint64_t handle);

/* The records of the instances of a top level. */
struct reference_records {
    uint32_t index; /* the entry's position in its batch, for errors */
    uint32_t type; /* GEOMETRY_INSTANCES or GEOMETRY_MOVING_INSTANCES, which decides on the form of records */
    uint32_t count;
    unsigned char *records;
};

struct reference_rows {
    struct form_reference *rows; /* from `memory` of the context; the caller frees them; NULL without any */
    uint32_t count;
};

/*
 * Makes the rows. The records' reference fields come in as 1-based positions in `references` (0: inactive), and leave
 * as 1-based rows of *ret_rows. Returns BVHD_INVALID with the first instance that names a structure that moves, if the
 * top level does not, or disables micromaps that may not be disabled, BVHD_NO_MEMORY or BVHD_CANCELLED; some fields may
 * have changed then and others not.
 */
enum bvhd_status reference_rows_make(const struct reference_records *records, const struct reference *references,
                                     uint32_t reference_count, const struct build_context *context,
                                     struct reference_rows *ret_rows, struct bvhd_error *error);

#endif
