/* SPDX-License-Identifier: Apache-2.0 */
/*
 * triangle_micromap.h - the micromaps of triangles: reads the indices by which triangles name those of a micromap, and
 * checks and normalises them.
 *
 * In a copy an index is a special one (MICROMAP_FULLY_) or the number of a triangle of the micromap, the base added.
 * A triangle whose micro-triangles are all of one state gets the special index of that state, unless updates may change
 * the states or the micromap.
 */
#ifndef BVHD_TRIANGLE_MICROMAP_H
#define BVHD_TRIANGLE_MICROMAP_H

#include "builder/input/fetch.h"
#include "proto/base/validate_shape.h"

/* Returns whether any triangles of the input name a micromap, so that its table of references is needed. */
bool triangle_micromap_names_any(const struct build_input *input);

/* Checks that the indices of a geometry's micromap are there. */
enum bvhd_status triangle_micromap_check_memory(const struct validate_subject *subject);

/*
 * Reads the indices of all geometries into their places in the block, and makes a row of the reference table for each
 * micromap, in the order of first use. The caller frees the rows. Returns BVHD_INVALID with the rule that is broken,
 * the errors of portable_micromap_open, BVHD_NO_MEMORY or BVHD_CANCELLED.
 */
enum bvhd_status triangle_micromaps_read(struct fetch *fetch, const struct build_context *context,
                                         struct reference_rows *ret_rows, struct bvhd_error *error);

/* Check a block that comes from elsewhere: the micromap of a geometry, and that each row of the table is named. */
enum bvhd_status triangle_micromap_check_foreign(const struct canonical *canonical, uint32_t geometry,
                                                 struct bvhd_error *error);
enum bvhd_status triangle_micromap_check_references(const struct canonical *canonical, struct bvhd_error *error);

#endif
