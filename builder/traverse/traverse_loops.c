/* SPDX-License-Identifier: Apache-2.0 */
/*
 * traverse_loops.c - the loops over nodes, and over moving nodes: with float boxes in plain C and with AVX2, and with
 * boxes in double.
 */
#include "builder/format/record_kind.h"
#include "builder/traverse/boxtest_moving.h"
#include "builder/traverse/traverse_walk.h"

/* Each level leaves at most 7 siblings on the stack; the last one can add all 8. */
enum { STACK_SIZE = 7 * PORTABLE_MAX_DEPTH + 1 };

/* Here the two highest bits of a child are the number of its records; 0: it is a node. */
enum { CHILD_COUNT_SHIFT = CHILD_KIND_SHIFT };

/* Returns the stack entry of the child in a slot. */
BOXTEST_INLINE uint32_t child_in_slot(const struct portable_node *node, unsigned slot)
{
    uint32_t inner = node->inner_mask, meta = node->meta[slot], unary = meta >> 5;
    uint32_t leaf = (unary - (unary >> 1) - (unary >> 2)) << CHILD_COUNT_SHIFT | (node->first_record + (meta & 31));
    uint32_t below = node->first_child + (uint32_t)__builtin_popcount(inner & ((1u << slot) - 1));
    return inner >> slot & 1 ? below : leaf;
}

/* Prefetches a child that is pushed on the stack. */
BOXTEST_INLINE void prefetch_child(const struct portable_view *view, size_t node_size, size_t size, uint32_t child)
{
    uintptr_t index = child & CHILD_INDEX_MASK;
    uintptr_t node = (uintptr_t)view->nodes + node_size * index, record = (uintptr_t)view->records + size * index;
    __builtin_prefetch((const void *)(child >> CHILD_COUNT_SHIFT ? record : node));
}

#define LOOP_NAME traverse_loop_float
#define LOOP_TARGET
#define LOOP_REAL float
#define LOOP_NODE struct portable_node
#define LOOP_RAY struct boxtest_ray
#define LOOP_BOXES kernel_float
#define LOOP_LIMIT tmax_above
#define LOOP_LEAF(walk, view, first, count) leaf(walk, first, count)
#include "builder/traverse/traverse_loop.h"

#define LOOP_NAME traverse_loop_double
#define LOOP_TARGET
#define LOOP_REAL double
#define LOOP_NODE struct portable_node
#define LOOP_RAY struct boxtest_exact
#define LOOP_BOXES kernel_double
#define LOOP_LIMIT tmax
#define LOOP_LEAF(walk, view, first, count) leaf(walk, first, count)
#include "builder/traverse/traverse_loop.h"

#define LOOP_NAME traverse_loop_moving_float
#define LOOP_TARGET
#define LOOP_REAL float
#define LOOP_NODE struct portable_moving_node
#define LOOP_RAY struct boxtest_moving
#define LOOP_BOXES kernel_moving_float
#define LOOP_LIMIT tmax_above
#define LOOP_LEAF(walk, view, first, count) leaf(walk, first, count)
#include "builder/traverse/traverse_loop.h"

#define LOOP_NAME traverse_loop_moving_double
#define LOOP_TARGET
#define LOOP_REAL double
#define LOOP_NODE struct portable_moving_node
#define LOOP_RAY struct boxtest_moving_exact
#define LOOP_BOXES kernel_moving_double
#define LOOP_LIMIT tmax
#define LOOP_LEAF(walk, view, first, count) leaf(walk, first, count)
#include "builder/traverse/traverse_loop.h"

#ifdef BOXTEST_AVX2

#define LOOP_NAME traverse_loop_avx2
#define LOOP_TARGET BOXTEST_AVX2
#define LOOP_REAL float
#define LOOP_NODE struct portable_node
#define LOOP_RAY struct boxtest_ray
#define LOOP_BOXES kernel_avx2
#define LOOP_LIMIT tmax_above
#define LOOP_LEAF(walk, view, first, count) leaf(walk, first, count)
#include "builder/traverse/traverse_loop.h"

#define LOOP_NAME traverse_loop_moving_avx2
#define LOOP_TARGET BOXTEST_AVX2
#define LOOP_REAL float
#define LOOP_NODE struct portable_moving_node
#define LOOP_RAY struct boxtest_moving
#define LOOP_BOXES kernel_moving_avx2
#define LOOP_LIMIT tmax_above
#define LOOP_LEAF(walk, view, first, count) leaf(walk, first, count)
#include "builder/traverse/traverse_loop.h"

#else

void traverse_loop_avx2(struct traverse_walk *walk, const struct boxtest_ray *ray, traverse_leaf leaf)
{
    traverse_loop_float(walk, ray, leaf);
}

void traverse_loop_moving_avx2(struct traverse_walk *walk, const struct boxtest_moving *ray, traverse_leaf leaf)
{
    traverse_loop_moving_float(walk, ray, leaf);
}

#endif
