/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/lavapipe_tree.h"

enum { BOX = sizeof(struct lavapipe_box), KIND_MASK = 3 };

struct lavapipe_box lavapipe_tree_box(const struct lavapipe_view *view, uint32_t index)
{
    return lavapipe_box_at(view, LAVAPIPE_HEADER + index * BOX);
}

static bool is_box(uint32_t reference)
{
    return reference != LAVAPIPE_NONE && (reference & KIND_MASK) == LAVAPIPE_BOX;
}

uint32_t lavapipe_tree_child(uint32_t reference, uint32_t node, uint32_t end)
{
    const uint32_t offset = reference & ~(uint32_t)KIND_MASK;
    if (!is_box(reference) || offset < LAVAPIPE_HEADER || (offset - LAVAPIPE_HEADER) % BOX != 0)
        return LAVAPIPE_NONE;
    const uint32_t child = (offset - LAVAPIPE_HEADER) / BOX;
    return child > node && child < end ? child : LAVAPIPE_NONE;
}

uint32_t lavapipe_tree_leaf(const struct lavapipe_view *view, uint32_t reference, enum lavapipe_kind kind,
                            uint32_t leaf_count)
{
    const uint32_t offset = reference & ~(uint32_t)KIND_MASK, size = lavapipe_leaf_size(kind);
    if ((reference & KIND_MASK) != kind || offset < view->leaf_offset || (offset - view->leaf_offset) % size != 0)
        return LAVAPIPE_NONE;
    const uint32_t leaf = (offset - view->leaf_offset) / size;
    return leaf < leaf_count ? leaf : LAVAPIPE_NONE;
}

uint32_t lavapipe_tree_room(const struct lavapipe_view *view)
{
    return (view->leaf_offset - LAVAPIPE_HEADER) / BOX;
}

/* The last box node is the one that has no box as a child, found by always taking the last child that is one. */
uint32_t lavapipe_tree_count(const struct lavapipe_view *view)
{
    const uint32_t room = lavapipe_tree_room(view);
    uint32_t node = 0;
    for (;;) {
        const struct lavapipe_box box = lavapipe_tree_box(view, node);
        uint32_t last = lavapipe_tree_child(box.children[1], node, room);
        last = last != LAVAPIPE_NONE ? last : lavapipe_tree_child(box.children[0], node, room);
        if (last == LAVAPIPE_NONE)
            return node + 1;
        node = last;
    }
}

/* Cuts the subtree of `node`, which is [node, end). */
static bool cut(const struct lavapipe_view *view, struct subtrees *subtrees, uint32_t node, uint32_t end, int level)
{
    if (end - node <= subtrees->limit) {
        subtrees_add_range(subtrees, node, end);
        return true;
    }
    const struct lavapipe_box box = lavapipe_tree_box(view, node);
    uint32_t next = node + 1;
    subtrees_add_top(subtrees, node);
    for (int i = 0; i < 2; i++) {
        if (!is_box(box.children[i]))
            continue;
        const uint32_t child = lavapipe_tree_child(box.children[i], node, end);
        const bool is_first = i == 0 && is_box(box.children[1]);
        const uint32_t last = is_first ? lavapipe_tree_child(box.children[1], node, end) : end;
        if (child != next || last == LAVAPIPE_NONE || last <= child || level > LAVAPIPE_MAX_LEVELS)
            return false;
        if (!cut(view, subtrees, child, last, level + 1))
            return false;
        next = last;
    }
    return next == end;
}

bool lavapipe_tree_cut(const struct lavapipe_view *view, uint32_t count, struct subtrees *subtrees)
{
    return cut(view, subtrees, 0, count, 1);
}
