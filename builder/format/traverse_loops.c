/* SPDX-License-Identifier: Apache-2.0 */
/* traverse_loops.c - the loops over nodes: with float boxes in plain C and eight wide, and with boxes in double. */
#include "boxtest_kernels.h"
#include "traverse_walk.h"
#include "triangle_wide.h"

/* Each level leaves at most 7 siblings waiting; the last one may add all 8. */
enum { STACK_SIZE = 7 * PORTABLE_MAX_DEPTH + 1 };

enum { CHILD_COUNT_SHIFT = 30, CHILD_INDEX_MASK = (1 << CHILD_COUNT_SHIFT) - 1 };

_Static_assert(PORTABLE_LEAF_MAX <= 3 && PORTABLE_MAX_ROWS - 1 <= (int)CHILD_INDEX_MASK, "a child fits into 32 bits");

/* The stack entry for what hangs in a slot. */
BOXTEST_INLINE uint32_t child_in_slot(const struct portable_node *node, unsigned slot)
{
    if (node->inner_mask >> slot & 1)
        return node->first_child + (uint32_t)__builtin_popcount(node->inner_mask & ((1u << slot) - 1));
    uint32_t unary = node->meta[slot] >> 5, count = unary - (unary >> 1) - (unary >> 2);
    return count << CHILD_COUNT_SHIFT | (node->first_record + (node->meta[slot] & 31));
}

#define LOOP_NAME traverse_loop_float
#define LOOP_TARGET
#define LOOP_REAL float
#define LOOP_RAY struct boxtest_ray
#define LOOP_BOXES kernel_float
#define LOOP_LIMIT tmax_above
#define LOOP_LEAF leaf
#include "traverse_loop.h"

#define LOOP_NAME traverse_loop_double
#define LOOP_TARGET
#define LOOP_REAL double
#define LOOP_RAY struct boxtest_exact
#define LOOP_BOXES kernel_double
#define LOOP_LIMIT tmax
#define LOOP_LEAF leaf
#include "traverse_loop.h"

#ifdef BOXTEST_WIDE

BOXTEST_WIDE static inline __attribute__((always_inline)) void triangles_wide(struct traverse_walk *walk, uint32_t first,
                                                                              uint32_t count)
{
    struct traverse_state *state = &walk->state;
    const bool flip = state->options->flip_order;
    state->counters.triangles += count;
    for (uint32_t i = 0; i < count && !state->is_done; i++) {
        uint32_t record = first + (flip ? count - 1 - i : i);
        const float *corners[3];
        uint32_t id = traverse_corners(walk->view, record, corners);
        if (triangle_wide_may_hit(&state->triangle_ray, corners[0], corners[1], corners[2]))
            traverse_leaf_triangle(state, record, id & PORTABLE_ID_MASK, id & PORTABLE_ID_OPAQUE, corners);
    }
}

#define LOOP_NAME traverse_loop_wide
#define LOOP_TARGET BOXTEST_WIDE
#define LOOP_REAL float
#define LOOP_RAY struct boxtest_ray
#define LOOP_BOXES kernel_wide
#define LOOP_LIMIT tmax_above
#define LOOP_LEAF leaf
#include "traverse_loop.h"

#define LOOP_NAME traverse_loop_wide_triangles
#define LOOP_TARGET BOXTEST_WIDE
#define LOOP_REAL float
#define LOOP_RAY struct boxtest_ray
#define LOOP_BOXES kernel_wide
#define LOOP_LIMIT tmax_above
#define LOOP_LEAF triangles_wide
#include "traverse_loop.h"

#else

void traverse_loop_wide(struct traverse_walk *walk, const struct boxtest_ray *ray, traverse_leaf leaf)
{
    traverse_loop_float(walk, ray, leaf);
}

void traverse_loop_wide_triangles(struct traverse_walk *walk, const struct boxtest_ray *ray, traverse_leaf leaf)
{
    traverse_loop_float(walk, ray, leaf);
}

#endif
