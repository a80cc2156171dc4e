/* SPDX-License-Identifier: Apache-2.0 */
/*
 * subtrees.h - visits the nodes of a tree from its leaves up, on all threads, where the nodes lie in depth-first order:
 * the descendants of a node are one range, and children follow their parents.
 *
 * The tree is cut into ranges of whole subtrees, each a task, and the few nodes above them. A layout's own function
 * makes the cut: it calls subtrees_add_top for a node, and subtrees_add_range for descendants that are no tops.
 */
#ifndef BVHD_SUBTREES_H
#define BVHD_SUBTREES_H

#include "builder/context.h"
#include "proto/base/status.h"

/* Nodes [begin, end) of one task. */
struct subtrees_range {
    uint32_t begin, end;
};

/* The parts of a tree. Both arrays grow in `memory`. */
struct subtrees {
    struct memory *memory;
    uint32_t node_count; /* of the whole tree */
    uint32_t limit; /* a range should have no more nodes */
    uint32_t *tops; /* parents before their children */
    struct subtrees_range *ranges;
    uint32_t top_count, top_room, range_count, range_room;
    bool out_of_memory;
};

/*
 * Visits node `node`. Its children must lie in (node, end), where every node has been visited, and the function returns
 * false if they do not, or if the node is corrupt otherwise. Nodes of different ranges are visited at the same time.
 */
typedef bool (*subtrees_visit)(void *context, uint32_t node, uint32_t end);

/* Starts with no parts, for a tree of so many nodes. */
void subtrees_init(struct subtrees *subtrees, uint32_t node_count, struct memory *memory);
void subtrees_finish(struct subtrees *subtrees);

/* Adds a part. When there is no memory, out_of_memory is set instead. */
void subtrees_add_top(struct subtrees *subtrees, uint32_t node);
void subtrees_add_range(struct subtrees *subtrees, uint32_t begin, uint32_t end);

/*
 * Visits every node of all parts once, children before their parents. Returns BVHD_CANCELLED, or BVHD_CORRUPT with a
 * corrupt node in *ret_node.
 */
enum bvhd_status subtrees_sweep(const struct subtrees *subtrees, const struct build_context *context,
                                subtrees_visit visit, void *visit_context, uint32_t *ret_node);

#endif
