/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe_write.h - writes the lavapipe layout with each box node at a given place, to reproduce what a driver wrote.
 */
#ifndef BVHD_LAVAPIPE_WRITE_H
#define BVHD_LAVAPIPE_WRITE_H

#include "builder/format/lavapipe.h"
#include "builder/format/lavapipe_leaves.h"
#include "builder/format/layout.h"

/*
 * Returns how many box nodes the driver reserves for a request of `primitives`: an update rebuilds the tree into them.
 */
uint32_t lavapipe_box_room(uint32_t primitives);

/*
 * Writes like layout_lavapipe.write, but puts the box node of inner node i of the ir at box places[i]. All places are
 * different, the root's is 0, and all are below the larger of lavapipe_box_room() and the number of inner nodes.
 */
enum bvhd_status lavapipe_write_at(const struct layout_input *input, const uint32_t *places, unsigned char **ret_blob,
                                   struct layout_sizes *ret_sizes, struct bvhd_error *error);

/*
 * Return a child's bounds as a box node stores them, min and max, and those of the whole tree as the header does. In
 * some variants boxes are a bit larger than what they bound.
 */
void lavapipe_child_bounds(const struct lavapipe_leaves *leaves, enum lavapipe_variant variant, const struct box *box,
                           float ret_bounds[6]);
void lavapipe_root_bounds(const struct lavapipe_leaves *leaves, const struct box *box, float ret_bounds[6]);

#endif
