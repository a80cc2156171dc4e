/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe_write.h - writing the lavapipe layout with the box nodes where another writer put them: for reproducing what
 * a driver wrote.
 */
#ifndef BVHD_LAVAPIPE_WRITE_H
#define BVHD_LAVAPIPE_WRITE_H

#include "builder/format/layout.h"

/*
 * How many box nodes there is room for over a request of `primitives`, as the driver counts: an update rebuilds into
 * them.
 */
uint32_t lavapipe_box_room(uint32_t primitives);

/*
 * As layout_lavapipe.write, but the box node of inner node i of the ir lies at box places[i]; all are different, 0 is
 * the root's, and all are below the larger of lavapipe_box_room() and the number of inner nodes.
 */
enum bvhd_status lavapipe_write_at(const struct layout_input *input, const uint32_t *places, unsigned char **ret_blob,
                                   struct layout_sizes *ret_sizes, struct bvhd_error *error);

#endif
