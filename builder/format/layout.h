/* SPDX-License-Identifier: Apache-2.0 */
/*
 * layout.h - writers of serialized structures, by target. A layout states what kind of tree it needs, and the builder
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
#include "proto/base/validate_shape.h"

/* How many bytes of a blob each section takes. */
struct layout_sizes {
    uint64_t total, header, nodes, records, vertices, geometries;
};

/* The input of a layout, from which it writes a blob. */
struct layout_input {
    const struct canonical *canonical;
    const struct ir *ir; /* with arity 8 only its boxes, refs and their counts are used: there may be no nodes */
    const struct wide *wide; /* NULL if the layout's arity is 2 */
    bool complete; /* every primitive is in the tree */
    uint32_t layout_flags; /* PORTABLE_FAST_TRIANGLES */
    const struct device_format *device; /* the format that the blob is for; ignored by portable */
    struct memory *memory;
    const struct parallel *parallel;
    const atomic_bool *cancel; /* may be NULL */
    struct build_output *output; /* provides the blob's bytes; NULL: the blob comes from `memory` */
};

/* The most of everything that a structure may have, from which a layout bounds its size. */
struct layout_counts {
    uint32_t structure_type, geometry_type; /* STRUCTURE_, GEOMETRY_; of no geometry any */
    uint32_t geometry_count, layout_flags;
    uint64_t primitives, refs, vertices;
    uint64_t wide_nodes; /* of an 8-wide tree; a binary tree has refs - 1 inner nodes */
    bool has_micromaps; /* some triangles have micromaps, or special indices instead */
    uint64_t micromaps; /* that triangles name; of a micromap: indices that its bytes have */
    uint64_t states; /* of a micromap: bytes */
};

/* A micromap, from which a layout writes a blob. */
struct layout_micromap {
    uint32_t flags; /* BUILD_ */
    const struct micromap_triangle *triangles; /* valid; offsets count in `states` */
    uint32_t triangle_count;
    const unsigned char *states;
    uint64_t states_size;
    const uint32_t *indices; /* of a baked micromap; else NULL */
    uint32_t index_count;
    uint64_t baked[4]; /* of a baked micromap: micro-triangles by enum micro_state; else 0 */
    struct memory *memory;
    struct build_output *output; /* as in struct layout_input */
};

/* One layout: what kind of tree it needs, and how it writes a blob. */
struct layout {
    enum target target;
    const char *name; /* for example "portable" */
    /*
     * Returns the version of structures whose geometries are of GEOMETRY_ `geometry_type`, which is part of their keys,
     * or 0 if the layout has no such structures.
     */
    uint32_t (*version)(uint32_t geometry_type);
    uint32_t micromap_version; /* of bottom levels with micromaps; 0: the layout has none */
    uint32_t arity; /* 2 or 8 */
    uint32_t leaf_max; /* the most refs in one leaf */
    uint32_t depth_limit; /* maximum number of levels: arity 8, of its nodes; arity 2, of the ir, leaves included */
    uint32_t flags; /* the layout_flags that it knows */
    uint32_t variants; /* device_format.variant is 1 .. variants; 0: the layout leaves nothing open */

    /*
     * Enlarges the boxes of a tree as the traversal of this layout requires. It is called for trees whose leaf boxes
     * are not those of whole primitives: with split references, or over instances. NULL: nothing is required. Returns
     * false if cancelled.
     */
    bool (*inflate_boxes)(const struct canonical *canonical, const struct parallel *parallel, const atomic_bool *cancel,
                          struct ir *ir);

    /* Returns the most bytes of a body with these counts, which never decreases when one of them grows. */
    uint64_t (*bound)(const struct layout_counts *counts);

    /*
     * Writes the whole blob. *ret_blob comes from input->output, or from input->memory (64-byte aligned, freed by the
     * caller). The same input gives the same bytes for any number of threads. Fails with BVHD_NO_MEMORY,
     * BVHD_CANCELLED, or BVHD_TOO_LARGE if a section needs more than 32-bit ids.
     */
    enum bvhd_status (*write)(const struct layout_input *input, unsigned char **ret_blob,
                              struct layout_sizes *ret_sizes, struct bvhd_error *error);

    /*
     * Writes the whole blob of a micromap. *ret_blob comes from where that of `write` does. Fails with BVHD_NO_MEMORY.
     * NULL: the layout has no micromaps.
     */
    enum bvhd_status (*write_micromap)(const struct layout_micromap *input, unsigned char **ret_blob,
                                       struct layout_sizes *ret_sizes, struct bvhd_error *error);
};

extern const struct layout layout_portable, layout_lavapipe;

/* Returns the version of a layout for a structure that is built from a canonical copy; it is part of its key. */
uint32_t layout_version(const struct layout *layout, const struct canonical *canonical);

/*
 * Checks whether a layout has structures of this geometry's kind, which is known: BVHD_UNSUPPORTED, with its place, if
 * it has not.
 */
enum bvhd_status layout_check_kind(const struct layout *layout, const struct validate_subject *subject);

/* Return a layout, or NULL for an unknown target or name. */
const struct layout *layout_find(enum target target);
const struct layout *layout_find_name(const char *name);

#endif
