/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fetch.h - the part of prepare() that reads the caller's memory. It reads every byte once, in chunks on all threads.
 *
 * prepare() calls the functions in this order: fetch_init; fetch_primitives, for which it has allocated the block and
 * written the geometry rows (canonical_form.h) with the offsets of the arrays of primitives; fetch_positions, for which
 * it has enlarged the block and written the offsets of the positions; fetch_finish.
 */
#ifndef BVHD_FETCH_H
#define BVHD_FETCH_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "builder/input/reference_rows.h"

struct fetch_source;

struct fetch {
    const struct build_input *input;
    uint32_t index; /* the entry's place in its batch, for errors */
    unsigned char *block;
    /* counts, and a table of geometries that holds prefix sums only: form_view() sets the pointers at the end */
    struct canonical view;
    struct fetch_source *sources; /* one for each geometry */
    uint32_t *scratch; /* of all geometries; NULL: none needs any */
    uint64_t scratch_words;
    bool must_rebase; /* some indices have to change, so that each geometry's count from 0 */
    struct reference_lookup lookup;
    atomic_bool suspect; /* some content breaks a rule; validate_canonical then finds out which */
    /* number of the first instance whose reference is not in the table, or UINT32_MAX */
    _Atomic uint32_t first_unknown;
};

/*
 * Starts reading an input that validate_input has accepted. On success the caller frees view.geometries, and
 * fetch_finish frees the rest. Returns BVHD_NO_MEMORY, BVHD_CANCELLED, or the errors of reference_lookup_init.
 */
enum bvhd_status fetch_init(struct fetch *fetch, const struct build_input *input, uint32_t index,
                            const struct build_context *context, struct bvhd_error *error);
/* Frees what fetch_init and the functions below have allocated, except view.geometries. */
void fetch_finish(struct fetch *fetch, struct memory *memory);

/*
 * Fills the arrays of indices, boxes and instance records, at the offsets in the geometry rows of `block`. Checks
 * indices, reads transforms, and sets vertex_count and first_vertex in the view. The reference field of a record
 * becomes a 1-based position in the caller's reference table. With a vertex stride of 0 all indices become 0. Returns
 * BVHD_INVALID with the rule that is broken, BVHD_TOO_LARGE for 2^32 or more vertices, or BVHD_CANCELLED.
 */
enum bvhd_status fetch_primitives(struct fetch *fetch, unsigned char *block, const struct build_context *context,
                                  struct bvhd_error *error);

/*
 * Fills the arrays of positions, at the offsets in the geometry rows of `block`, with the geometries' transforms
 * applied. Returns BVHD_CANCELLED when the flag is set, or BVHD_NO_MEMORY.
 */
enum bvhd_status fetch_positions(struct fetch *fetch, unsigned char *block, const struct build_context *context,
                                 struct bvhd_error *error);

#endif
