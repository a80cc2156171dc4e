/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse_loop.h - the loop over the nodes of one level, compiled once for each kind of box test. It is not an
 * ordinary header: traverse_loops.c includes it with these macros defined:
 *
 *   LOOP_NAME     the function
 *   LOOP_TARGET   its attributes
 *   LOOP_REAL     the type of distances: float or double
 *   LOOP_NODE     the type of nodes, which begin with a struct portable_node
 *   LOOP_RAY      the box test's ray
 *   LOOP_BOXES    the box test
 *   LOOP_LIMIT    the member of the state that holds the end of the interval
 *   LOOP_LEAF     what to do at a leaf
 *
 * The loop visits the nearest child first (with flip_order: the farthest first), and avoids unpredictable branches. A
 * stack entry that is popped is dropped if a closer hit has been found since it was pushed. An entry is a node, or a
 * leaf: the number of its records in the two highest bits, the first record below.
 */
LOOP_TARGET void LOOP_NAME(struct traverse_walk *walk, const LOOP_RAY *ray, traverse_leaf leaf)
{
    /* The stack is two arrays, because a value that was stored in one piece can be loaded again without a stall. */
    LOOP_REAL distances[STACK_SIZE];
    uint32_t children[STACK_SIZE];
    struct traverse_state *state = &walk->state;
    const struct portable_view view = *walk->view; /* a copy, which stores through other pointers cannot change */
    const LOOP_NODE *nodes = (const LOOP_NODE *)(const void *)view.nodes;
    const size_t size = record_kind_of(view.header->content)->size;
    const bool flip = state->options->flip_order;
    unsigned top = 0;
    uint32_t child = 0;
    uint64_t visited = 0;
    (void)leaf;

    for (;;) {
        if (child >> CHILD_COUNT_SHIFT) {
            LOOP_LEAF(walk, &view, child & CHILD_INDEX_MASK, child >> CHILD_COUNT_SHIFT);
            if (state->is_done)
                break;
        } else {
            LOOP_REAL near[8];
            const struct portable_node *node = (const struct portable_node *)&nodes[child];
            unsigned hits = LOOP_BOXES(ray, &nodes[child], state->LOOP_LIMIT, near);
            visited++;
            if (hits) {
                unsigned slot = (unsigned)__builtin_ctz(hits), base = top;
                LOOP_REAL nearest = near[slot];
                child = child_in_slot(node, slot);
                while (hits &= hits - 1) {
                    slot = (unsigned)__builtin_ctz(hits);
                    uint32_t other = child_in_slot(node, slot);
                    LOOP_REAL distance = near[slot];
                    bool is_next = (distance <= nearest) != flip;
                    uint32_t later = is_next ? child : other;
                    LOOP_REAL farther = is_next ? nearest : distance;
                    child = is_next ? other : child;
                    nearest = is_next ? distance : nearest;
                    unsigned at = top++;
                    for (; at > base && (distances[at - 1] < farther) != flip; at--) {
                        distances[at] = distances[at - 1];
                        children[at] = children[at - 1];
                    }
                    prefetch_child(&view, sizeof *nodes, size, later);
                    distances[at] = farther;
                    children[at] = later;
                }
                continue;
            }
        }
        do {
            if (top == 0) {
                state->counters.nodes += visited;
                return;
            }
            top--;
        } while (!(distances[top] <= state->LOOP_LIMIT));
        child = children[top];
    }
    state->counters.nodes += visited;
}

#undef LOOP_NAME
#undef LOOP_TARGET
#undef LOOP_REAL
#undef LOOP_NODE
#undef LOOP_RAY
#undef LOOP_BOXES
#undef LOOP_LIMIT
#undef LOOP_LEAF
