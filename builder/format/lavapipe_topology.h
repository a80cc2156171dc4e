/* SPDX-License-Identifier: Apache-2.0 */
/*
 * lavapipe_topology.h - the tree of somebody else's structure, over geometry that both know: writing it again must give
 * that one's bytes, if the layout is understood.
 */
#ifndef BVHD_LAVAPIPE_TOPOLOGY_H
#define BVHD_LAVAPIPE_TOPOLOGY_H

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "builder/format/lavapipe.h"

struct lavapipe_topology {
    struct ir ir;
    uint32_t *places; /* of each node: its box, as lavapipe_write_at takes them */
    struct memory *memory;
};

/*
 * Takes nothing of `view` but which node is whose child and where it lies. Boxes come from `canonical` and are those of
 * the driver, to the bit: from the leaves up, the smaller of two minima, and for an instance the bounds of what it
 * names through its matrix, in float. A view over something else than `canonical` asks for, or with a box of a single
 * child in a tree of several leaves, is BVHD_UNSUPPORTED. Ended with lavapipe_topology_finish.
 */
enum bvhd_status lavapipe_topology_read(const struct lavapipe_view *view, const struct canonical *canonical,
                                        struct memory *memory, struct lavapipe_topology *ret_topology,
                                        struct bvhd_error *error);

/* NULL-safe, idempotent. */
void lavapipe_topology_finish(struct lavapipe_topology *topology);

#endif
