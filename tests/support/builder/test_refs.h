/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_refs.h - refs for tests of builders: clouds of boxes, and sets that no plane separates. For test programs only.
 */
#ifndef BVHD_TEST_REFS_H
#define BVHD_TEST_REFS_H

#include <stdlib.h>

#include "builder/format/ir.h"
#include "builder/input/primitive.h"
#include "tests/support/random.h"

enum test_refs_kind {
    REFS_CLOUD, /* small boxes, evenly distributed */
    REFS_CLUSTERS, /* sizes and densities over many orders of magnitude */
    REFS_FLAT, /* in a plane */
    REFS_LINE, /* without any area */
    REFS_SAME, /* the same box many times */
    REFS_SAME_CENTRE, /* boxes inside each other */
    REFS_CHAIN, /* distances grow by a factor, which makes the deepest trees */
    REFS_KINDS
};

/* Makes `count` refs, 64-byte aligned, to be freed with free(); ids are 0 .. count - 1. */
static inline struct primitive_ref *test_refs_make(enum test_refs_kind kind, uint32_t count, uint64_t seed)
{
    struct random random = {seed};
    struct primitive_ref *refs = aligned_alloc(64, ((size_t)count * sizeof *refs + 64) / 64 * 64);
    if (!refs)
        abort();
    for (uint32_t i = 0; i < count; i++) {
        double centre[3], half[3], scale = __builtin_ldexp(1, (int)random_between(&random, -20, 0));
        random_point(&random, centre);
        random_point(&random, half);
        for (int axis = 0; axis < 3; axis++) {
            half[axis] *= kind == REFS_CLUSTERS ? 0.01 * scale : kind == REFS_SAME_CENTRE ? scale : 0.01;
            centre[axis] *= kind == REFS_CLUSTERS ? scale * scale : 1;
            if (kind == REFS_SAME || kind == REFS_SAME_CENTRE || (kind == REFS_FLAT && axis == 1) ||
                (kind >= REFS_LINE && axis))
                centre[axis] = 0.25;
            if (kind == REFS_SAME)
                half[axis] = 0.125;
            if ((kind == REFS_FLAT && axis == 1) || (kind == REFS_LINE && axis) || kind == REFS_CHAIN)
                half[axis] = 0;
            if (kind == REFS_CHAIN && axis == 0)
                centre[axis] = __builtin_ldexp(1, -(int)(i % 100)) * (i % 3 + 1);
            half[axis] = half[axis] < 0 ? -half[axis] : half[axis];
            refs[i].min[axis] = (float)(centre[axis] - half[axis]);
            refs[i].max[axis] = (float)(centre[axis] + half[axis]);
        }
        refs[i].link = 0;
        refs[i].id = i;
    }
    return refs;
}

/* Returns each primitive's box as boxes[id], for ir_check; to be freed with free(). */
static inline struct box *test_refs_boxes(const struct primitive_ref *refs, uint32_t count)
{
    struct box *boxes = calloc(count ? count : 1, sizeof *boxes);
    if (!boxes)
        abort();
    for (uint32_t i = 0; i < count; i++)
        boxes[refs[i].id] = primitive_ref_box(&refs[i]);
    return boxes;
}

#endif
