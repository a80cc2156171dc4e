/* SPDX-License-Identifier: Apache-2.0 */
/*
 * input_kind.h - what this stage does differently for each kind of geometry: one struct for each, which the file of the
 * kind fills, such as triangles.c.
 *
 * Functions of hot loops take ranges of primitives or vertices, so that one call through a pointer serves thousands of
 * them; `look` serves callers that need single ones. Every geometry that the functions get has passed the checks that
 * come before: check_memory follows validate_geometry and check_shape (kind.h), and all others follow validate_input
 * or, for a block that comes from elsewhere, the checks of its tables.
 */
#ifndef BVHD_INPUT_KIND_H
#define BVHD_INPUT_KIND_H

#include <stdbool.h>
#include <stdint.h>

#include "builder/format/canonical.h"
#include "builder/kernel/primitive_ref.h"
#include "proto/base/validate_shape.h"

struct build_context;
struct classification;
struct classification_counts;
struct fetch;
struct form_geometry;
struct reach;
struct vec4_box;

/* Kinds of micromaps, of which no trees are built, have no functions about refs. */
struct input_kind {
    uint32_t version; /* of a canonical copy with such geometries (canonical.h) */
    bool has_radii; /* its rows have the fields of round kinds */
    uint32_t corners; /* vertices of a primitive; 0: the kind has no vertices */

    /* Checks the range of the geometry, and that the memory which it names is there. */
    enum bvhd_status (*check_memory)(const struct validate_subject *subject);

    /* Fills the fields of a row that only this kind has. NULL: there are none. */
    void (*describe)(const struct geometry *geometry, bool is_update, struct form_geometry *row);
    /* Checks what a row of an updatable geometry from elsewhere records. NULL: nothing is recorded. */
    bool (*update_is_sound)(const struct form_geometry *row);
    /* Sets the pointer of the view that leads to the array at data_offset. */
    void (*view)(const void *data, struct canonical_geometry *geometry);

    /*
     * Makes the whole copy of a structure of this kind, as prepare() does, which has checked the input. NULL: the
     * functions below read it.
     */
    enum bvhd_status (*prepare)(const struct build_input *input, uint32_t index, const struct limits *limits,
                                const struct build_context *context, struct canonical *ret_canonical,
                                struct bvhd_error *error);

    /* Returns how many words of scratch memory the functions that read need, until the vertices are read. NULL: 0. */
    uint64_t (*scratch)(const struct geometry *geometry);
    /* Returns the most bytes that reading takes beside the copy, with the scratch memory. NULL: 0. */
    uint64_t (*beside)(const struct geometry *geometry);
    /* Reads primitives, that is, indices, boxes or records, once; called on any thread. */
    void (*fetch_primitives)(struct fetch *fetch, uint32_t geometry, uint32_t first, uint32_t count);
    /* Checks what was read when all primitives have been, and counts the vertices in use. NULL: nothing to do. */
    enum bvhd_status (*finish)(struct fetch *fetch, uint32_t geometry, struct bvhd_error *error);
    /*
     * Makes canonical indices, which count from the lowest one, of those that were read; called on any thread, where
     * `finish` set must_rebase. NULL: no indices.
     */
    void (*rebase)(struct fetch *fetch, uint32_t geometry, uint32_t first, uint32_t count);
    /* Reads vertices once; called on any thread. NULL: the kind has none. */
    void (*fetch_vertices)(struct fetch *fetch, uint32_t geometry, uint32_t first, uint32_t count);

    /* Reads the vertices that fetch_vertices leaves to it, on all threads of the context. NULL: it leaves none. */
    enum bvhd_status (*gather)(struct fetch *fetch, uint32_t geometry, const struct build_context *context,
                               struct bvhd_error *error);

    /*
     * Checks Vulkan's rules about contents. `info` and `index` are the numbers of the entry and of the geometry, for
     * errors. NULL: there is no such rule.
     */
    enum bvhd_status (*check_contents)(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                                       uint32_t info, uint32_t index, struct bvhd_error *error);
    /* Checks a geometry of a block that comes from elsewhere for contents that prepare() would not have written. */
    enum bvhd_status (*check_foreign)(const struct canonical *canonical, uint32_t geometry, struct bvhd_error *error);

    /* Classifies one primitive, and finds its box. */
    struct classification (*look)(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                  uint32_t index);
    /*
     * Does the same, and finds the boxes at t = 0 and at t = 1, between which that of another time is interpolated.
     * NULL: the primitives do not move.
     */
    struct classification (*look_at_keys)(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                          uint32_t index, struct box ret_boxes[2]);
    /*
     * Grows two boxes by those of primitives that have a ref, at t = 0 and at t = 1. `ids` are flat. NULL:
     * look_at_keys, or look, finds them.
     */
    void (*grow_keys)(const struct canonical_geometry *geometry, const uint32_t *ids, uint32_t count,
                      struct vec4_box *boxes);
    /*
     * Fetches into the cache what grow_keys will read of one primitive: in step 0 its indices, and in step 1, when
     * these are there, its vertices. NULL: nothing is far apart.
     */
    void (*prefetch_keys)(const struct canonical_geometry *geometry, uint32_t id, int step);
    /* Makes the refs of primitives [first, end), counts those that get none, and returns the number of refs. */
    uint32_t (*collect)(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t first,
                        uint32_t end, struct classification_counts *counts, struct primitive_ref *refs);
    /* Grows the reach by vertices or, of a kind without vertices, by primitives. NULL: it has no outline. */
    void (*outline)(const struct canonical_geometry *geometry, uint32_t first, uint32_t count, struct reach *reach);
};

extern const struct input_kind input_triangles, input_aabbs, input_instances, input_spheres, input_swept_spheres,
    input_moving_triangles, input_moving_instances, input_micromap;

/* Returns the kind of geometries of this type; NULL for a type that bvhd does not build. */
const struct input_kind *input_kind_of(uint32_t type);

#endif
