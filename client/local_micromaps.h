/* SPDX-License-Identifier: Apache-2.0 */
/*
 * local_micromaps.h - holds the opacity micromaps that the triangles of one item name, from its submission until it is
 * prepared in this process. Those are found that were built in this process, as long as something holds their blobs.
 *
 * One thread at a time may use an object.
 */
#ifndef BVHD_LOCAL_MICROMAPS_H
#define BVHD_LOCAL_MICROMAPS_H

#include <stdbool.h>

#include "proto/base/geometry.h"
#include "proto/base/status.h"

/* References to blobs. */
struct local_micromaps;

/*
 * Finds what the references of an input name. *ret_micromaps is NULL if they name none. Returns false without memory.
 */
bool local_micromaps_find(const struct build_input *input, struct local_micromaps **ret_micromaps);

/*
 * Sets the bytes of those of `references` that are micromaps and that were found; others get none. They live as long as
 * `micromaps`, which may be NULL. BVHD_INVALID for the key of another structure, with the place; `index` is the item's.
 */
enum bvhd_status local_micromaps_give(const struct local_micromaps *micromaps, struct reference *references,
                                      uint32_t count, uint32_t index, struct bvhd_error *error);

/* Drops the references to the blobs. NULL is allowed. */
void local_micromaps_destroy(struct local_micromaps *micromaps);

#endif
