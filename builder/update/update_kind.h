/* SPDX-License-Identifier: Apache-2.0 */
/*
 * update_kind.h - what updates have to know of a kind of geometry: one row for each, in a file of its own, such as
 * update_triangles.c. Internal.
 */
#ifndef BVHD_UPDATE_KIND_H
#define BVHD_UPDATE_KIND_H

#include "builder/format/portable_records.h"
#include "builder/update/refit_internal.h"
#include "proto/base/place.h"

struct form_geometry;

/* A field that an update must not change. */
struct update_rule {
    enum bvhd_vuid vuid; /* or BVHD_VUID_NONE: Vulkan has no rule */
    size_t offset; /* of a uint32_t in the header or in the row of a geometry */
    const char *name; /* of the field in places */
};

/* An update and its source, whose records are compared. */
struct update_comparison {
    const struct record *source, *now;
    uint32_t info;
    struct bvhd_error *error;
};

enum { REFIT_RECORDS_MAX = 8 * PORTABLE_LEAF_MAX }; /* of a node */

/* The records of a portable structure that is refitted. */
struct refit_records {
    const struct portable_view *source;
    const struct record *record; /* of the new geometry */
    struct portable_records written; /* where the new ones go */
    const float *vertices; /* the new ones */
};

/* One kind of geometry. */
struct update_kind {
    uint32_t version; /* of records with rows of this kind: the oldest one that has them */
    /* Fills the fields of a row that only this kind has, from that of the canonical form. NULL: there are none. */
    void (*describe)(const struct form_geometry *form, struct record_geometry *row);
    /* Returns whether an untrusted row can be that of such a geometry. */
    bool (*row_is_sound)(const struct record_geometry *row);
    /* The rules about fields that only this kind has. */
    const struct update_rule *rules;
    uint32_t rule_count;
    /* Checks all other rules that only this kind has, for one geometry. NULL: there are none. */
    enum bvhd_status (*check)(const struct update_comparison *comparison, uint32_t geometry);

    /* Returns a word whose bit i is set if primitive first + i is active. `count` is at most 64; other bits are 0. */
    uint64_t (*active)(const struct canonical_geometry *geometry, uint32_t first, uint32_t count);
    /*
     * Returns whether some of the vertices first .. first + count - 1 are NaN; if none is, all primitives are active.
     * NULL: the primitives have no vertices.
     */
    bool (*has_nan)(const struct canonical_geometry *geometry, size_t first, size_t count);

    /* Writes the new records of a node of the source. Returns false for records that no writer has made. */
    bool (*write)(const struct refit_records *records, uint32_t first, unsigned count);
    /*
     * Finds the box of each leaf of a node, whose records have been written: counts[slot] of them from `first` on.
     * NULL: the primitives move.
     */
    void (*boxes)(const struct refit_records *records, uint32_t first, const uint8_t counts[8],
                  struct refit_node ret_leaves[8]);
    /* Finds the boxes at t = 0 and at t = 1 in the same way. NULL: the primitives do not move. */
    void (*key_boxes)(const struct refit_records *records, uint32_t first, const uint8_t counts[8],
                      struct refit_node ret_leaves[2][8]);
};

extern const struct update_kind update_triangles, update_aabbs, update_instances, update_spheres, update_swept_spheres,
    update_moving_triangles, update_moving_instances;

/* Returns the row of a GEOMETRY_, or NULL for a type that is none. */
const struct update_kind *update_kind_of(uint32_t type);

/* Returns the place of a field of a geometry. */
static inline struct place update_place(const struct update_comparison *comparison, uint32_t geometry,
                                        const char *field)
{
    return place("infos[%u].geometries[%u].%s", comparison->info, geometry, field);
}

/* Returns whether the fields are 0 that only kinds with vertices have. */
bool update_row_is_plain(const struct record_geometry *row);

static inline bool update_any_nan(const float *values, size_t count)
{
    int found = 0;
    for (size_t i = 0; i < count; i++)
        found |= values[i] != values[i];
    return found;
}

/* Writes the records of these primitives. Returns false if one of them is not there, or is inactive. */
bool update_write(const struct refit_records *records, uint32_t first, const uint32_t *primitives, unsigned count);

/* Finds the boxes of leaves by a function that returns the box of a record; the compiler inlines it. */
static inline __attribute__((always_inline)) void update_boxes(
    const struct refit_records *records, uint32_t first, const uint8_t counts[8], struct refit_node ret_leaves[8],
    struct vec4_box (*box_of)(const struct refit_records *records, uint32_t record))
{
    for (unsigned slot = 0; slot < 8; slot++) {
        if (counts[slot] == 0)
            continue;
        struct vec4_box box = box_of(records, first);
        for (unsigned i = 1; i < counts[slot]; i++) {
            const struct vec4_box next = box_of(records, first + i);
            vec4_box_grow(&box, next.min, next.max);
        }
        vec4_box_put(refit_box_finite(box), &ret_leaves[slot].box);
        first += counts[slot];
    }
}

/* Does the same by a function that finds the boxes of a record at both keys. */
static inline __attribute__((always_inline)) void update_key_boxes(
    const struct refit_records *records, uint32_t first, const uint8_t counts[8], struct refit_node ret_leaves[2][8],
    void (*find)(const struct refit_records *records, uint32_t record, struct vec4_box ret_boxes[2]))
{
    for (unsigned slot = 0; slot < 8; slot++) {
        struct vec4_box boxes[2] = {vec4_box_empty(), vec4_box_empty()};
        for (unsigned i = 0; i < counts[slot]; i++) {
            struct vec4_box own[2];
            find(records, first + i, own);
            for (int key = 0; key < 2; key++)
                vec4_box_grow(&boxes[key], own[key].min, own[key].max);
        }
        for (int key = 0; key < 2 && counts[slot] > 0; key++)
            vec4_box_put(refit_box_finite(boxes[key]), &ret_leaves[key][slot].box);
        first += counts[slot];
    }
}

#endif
