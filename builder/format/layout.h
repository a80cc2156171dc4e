/* SPDX-License-Identifier: Apache-2.0 */
/*
 * layout.h - writers of serialized structures, by target. A layout states what it needs of the tree; the builder
 * provides it.
 */
#ifndef BVHD_LAYOUT_H
#define BVHD_LAYOUT_H

#include <stdatomic.h>

#include "builder/format/canonical.h"
#include "builder/format/ir.h"
#include "builder/format/output.h"
#include "proto/base/parallel.h"
#include "builder/format/wide.h"

/* Where the bytes of a blob go. */
struct layout_sizes {
    uint64_t total, header, nodes, records, vertices, geometries;
};

struct layout_input {
    const struct canonical *canonical;
    const struct ir *ir; /* with arity 8 only boxes, refs and their counts: there may be no nodes */
    const struct wide *wide; /* NULL when the layout's arity is 2 */
    bool complete; /* every primitive is in the tree */
    uint32_t layout_flags; /* PORTABLE_FAST_TRIANGLES */
    const struct device_format *device; /* what the blob is to be loaded by; portable: not looked at */
    struct memory *memory;
    const struct parallel *parallel;
    const atomic_bool *cancel; /* may be NULL */
    struct build_output *output; /* NULL: the blob comes from `memory` */
};

struct layout {
    enum target target;
    const char *name; /* "portable" */
    uint32_t version; /* part of every key */
    uint32_t arity; /* 2 or 8 */
    uint32_t leaf_max; /* most refs a leaf may hold */
    uint32_t depth_limit; /* most levels: arity 8, of its nodes; arity 2, of the ir, leaves included */
    uint32_t flags; /* layout_flags that it knows */
    uint32_t variants; /* device_format.variant is 1 .. variants; 0: the layout leaves nothing open */

    /*
     * Lets the boxes of a tree grow to what those who trace it need. Asked for trees whose leaf boxes are not those of
     * whole primitives: with split references, or over instances. NULL: nothing is needed. False when cancelled.
     */
    bool (*inflate_boxes)(const struct canonical *canonical, const struct parallel *parallel, const atomic_bool *cancel,
                          struct ir *ir);

    /*
     * Writes the whole blob: *ret_blob from input->output, or from input->memory (64-byte aligned, the caller frees
     * it). The same input gives the same bytes for any number of threads. BVHD_NO_MEMORY, BVHD_CANCELLED,
     * BVHD_TOO_LARGE (a section passes 32-bit ids).
     */
    enum bvhd_status (*write)(const struct layout_input *input, unsigned char **ret_blob,
                              struct layout_sizes *ret_sizes, struct bvhd_error *error);
};

/* Takes back what write() gave, or was about to give. */
void layout_discard(const struct layout_input *input, unsigned char *blob);

extern const struct layout layout_portable, layout_lavapipe;

/* NULL for an unknown target. */
const struct layout *layout_find(enum target target);
const struct layout *layout_find_name(const char *name);

#endif
