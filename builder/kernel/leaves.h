/* SPDX-License-Identifier: Apache-2.0 */
/*
 * leaves.h - cuts a sequence of refs, whose neighbours are near each other, into leaves before a tree is built. The
 * builder then sorts and clusters a half or a third as many items.
 *
 * Leaves are runs of the sequence. leaves_cut finds the cheapest way to cut it, by dynamic programming: a leaf costs
 * its half area times its primitives. A cut between two refs costs `cut_cost` times the half area of their common box,
 * which is what a node above both would cost, but that area counts at most as twice the smaller ref's: a large ref
 * beside a small one says nothing about whether to cut there.
 *
 * The sequence is first divided into LEAVES_RANGES ranges of equal length (the last ones may be shorter), because the
 * processor then works on their chains of dependent operations at the same time.
 */
#ifndef BVHD_LEAVES_H
#define BVHD_LEAVES_H

#include "builder/kernel/primitive_ref.h"
#include "builder/kernel/vec4.h"

enum {
    LEAVES_REFS_MAX = 3, /* most refs in a leaf */
    LEAVES_RANGES = 4
};

struct leaves_options {
    uint32_t leaf_max; /* most primitives in a leaf; >= 1 */
    /*
     * Relative to the cost of a node. Below 1, refs share a leaf only where the tree is no worse for it; above 1 leaves
     * become larger, which makes the rest of the build shorter and costs the rays a little.
     */
    float cut_cost;
};

/*
 * Cuts `count` >= 1 refs. ret_lengths has room for `count` bytes, and gets the number of refs of each leaf, in their
 * order. Returns the number of leaves.
 *
 * No leaf has more than LEAVES_REFS_MAX refs; a leaf of several refs has at most leaf_max primitives. Boxes may be of
 * any size; refs whose areas exceed float's range stay alone. The result is the same on every machine.
 */
uint32_t leaves_cut(const struct primitive_ref *refs, uint32_t count, const struct leaves_options *options,
                    uint8_t *ret_lengths);

/*
 * Returns the box of `count` refs, 1 <= count <= LEAVES_REFS_MAX. The fourth lanes have no meaning. There is no branch
 * on the count, because it is unpredictable: with fewer refs, one of them is added again.
 */
static inline struct vec4_box leaves_box(const struct primitive_ref *refs, uint32_t count)
{
    struct vec4_box box = vec4_box_load(refs);
    const struct vec4_box second = vec4_box_load(&refs[count > 1]), last = vec4_box_load(&refs[count - 1]);
    vec4_box_grow(&box, second.min, second.max);
    vec4_box_grow(&box, last.min, last.max);
    return box;
}

#endif
