/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe_topology.h - reads the tree of a structure that a driver wrote, over geometry that is known. Writing the
 * same tree again must reproduce the driver's bytes if the layout is understood.
 */
#ifndef BVHD_LAVAPIPE_TOPOLOGY_H
#define BVHD_LAVAPIPE_TOPOLOGY_H

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "builder/format/lavapipe.h"

/* A driver's tree, and the places of its boxes. */
struct lavapipe_topology {
    struct ir ir;
    uint32_t *places; /* for each inner node the place of its box, as lavapipe_write_at takes it */
    struct memory *memory;
};

/*
 * Reads the parent-child relations and the places of the boxes from `view`, and nothing else. The boxes are computed
 * from `canonical` as the driver computes them, to the bit: from the leaves up, with the smaller of two minima; for an
 * instance from the bounds of its bottom level and its matrix, in float. Returns BVHD_UNSUPPORTED if the view does not
 * fit `canonical`, or has a box with a single child in a tree of several leaves; BVHD_NO_MEMORY. The caller frees the
 * result with lavapipe_topology_finish.
 */
enum bvhd_status lavapipe_topology_read(const struct lavapipe_view *view, const struct canonical *canonical,
                                        struct memory *memory, struct lavapipe_topology *ret_topology,
                                        struct bvhd_error *error);

/* Frees the topology. NULL and repeated calls are allowed. */
void lavapipe_topology_finish(struct lavapipe_topology *topology);

#endif
