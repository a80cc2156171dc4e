/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fetch.h - the part of prepare.h that reads the caller's memory: every byte once, in chunks on any thread, at the
 * speed of memory.
 */
#ifndef BVHD_FETCH_H
#define BVHD_FETCH_H

#include "builder/format/canonical.h"
#include "builder/context.h"
#include "builder/input/reference_rows.h"

struct fetch_source;

struct fetch {
    const struct build_input *input;
    uint32_t index; /* of the entry, for errors */
    unsigned char *block;
    struct canonical view; /* counts and the geometry table, which is prefix sums at first; pointers come later */
    struct fetch_source *sources; /* one a geometry */
    struct reference_lookup lookup;
    atomic_bool suspect; /* contents break a rule: validate_canonical finds which */
    _Atomic uint32_t first_unknown; /* the first instance whose reference is not in the table, or UINT32_MAX */
};

/*
 * Takes a validated input. On success view.geometries is the caller's to free, the rest is freed by fetch_finish.
 * BVHD_CANCELLED.
 */
enum bvhd_status fetch_init(struct fetch *fetch, const struct build_input *input, uint32_t index,
                            const struct build_context *context, struct bvhd_error *error);
void fetch_finish(struct fetch *fetch, struct memory *memory);

/*
 * Fills the arrays of indices, boxes and records that the rows in `block` place, checks indices and reads transforms,
 * and sets vertex_count and first_vertex in the view. Records come out with 1-based positions in the caller's reference
 * table. With strides of 0 all indices become 0. BVHD_CANCELLED.
 */
enum bvhd_status fetch_primitives(struct fetch *fetch, unsigned char *block, const struct build_context *context,
                                  struct bvhd_error *error);

/* Fills the arrays of positions, transformed. BVHD_CANCELLED. */
enum bvhd_status fetch_positions(struct fetch *fetch, unsigned char *block, const struct build_context *context,
                                 struct bvhd_error *error);

#endif
