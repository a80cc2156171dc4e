/* SPDX-License-Identifier: Apache-2.0 */
/*
 * leaves.h - cuts a row of refs whose neighbours are near each other into leaves, before there is a tree: what is
 * sorted and clustered afterwards is a half or a third as much.
 *
 * Leaves are runs of the row. Of all ways to cut it the one of least cost, by dynamic programming: a leaf costs its
 * half area times its primitives. A cut costs a multiple of what a node above the two refs beside it would, their
 * common half area, but of no more than the smaller one twice: what is large only because the other one is says nothing
 * about this place.
 *
 * A row is cut into LEAVES_PARTS of one length first (the last ones may be shorter): they are worked on side by side.
 */
#ifndef BVHD_LEAVES_H
#define BVHD_LEAVES_H

#include "builder/kernel/primitive_ref.h"
#include "builder/kernel/vec4.h"

enum {
    LEAVES_REFS_MAX = 3, /* refs a leaf */
    LEAVES_PARTS = 4
};

struct leaves_options {
    uint32_t leaf_max; /* >= 1; primitives a leaf */
    /*
     * Below 1: only what is no worse in one leaf; above: larger leaves, less of everything that follows, a little more
     * for rays.
     */
    float cut_cost;
};

/*
 * ret_lengths: room for `count` >= 1; how many refs each leaf has, in their order. Returns how many leaves there are.
 * No leaf has more than LEAVES_REFS_MAX refs, or, if it has more than one, more than leaf_max primitives. Boxes may be
 * of any size; where areas leave float's range refs stay alone. The same on every machine.
 */
uint32_t leaves_cut(const struct primitive_ref *refs, uint32_t count, const struct leaves_options *options,
                    uint8_t *ret_lengths);

/*
 * The box of `count` refs, 1 <= count <= LEAVES_REFS_MAX; fourth lanes are of no meaning. Without a branch on how many,
 * which nobody can foresee: one of them again where there are fewer.
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
