/* SPDX-License-Identifier: Apache-2.0 */
/*
 * record_kind.h - what the portable layout and its builder have to know of the kinds of records: one row for each
 * content that a structure can have. The rows of each kind of geometry are in a file of their own, such as
 * portable_triangles.c.
 */
#ifndef BVHD_RECORD_KIND_H
#define BVHD_RECORD_KIND_H

#include <stddef.h>

#include "builder/format/canonical.h"
#include "builder/format/portable.h"

struct portable_records;

/* One kind of records. */
struct record_kind {
    uint32_t version; /* the layout's version of structures with this content: the oldest one that has it */
    uint32_t type; /* GEOMETRY_ of what they are made from, for motion triangles also static ones beside them */
    bool is_top; /* a top level consists of them */
    uint32_t layout_flag; /* the flag of a request that chooses it among the contents of this type; 0: none is needed */
    uint16_t size; /* bytes of a record */
    uint16_t vertex_size; /* bytes of a vertex; 0: the records hold their geometry themselves */
    uint16_t node_size; /* of struct portable_node, or portable_moving_node for contents that move */
    /*
     * The most primitives that share a leaf from the beginning of a build. Primitives that are fast to test need no
     * tree of their own; the collapse may decide on each of the others.
     */
    uint32_t first_leaf;
    float cost; /* of testing a ray against one, in visits of a wide node */

    /*
     * Returns the most vertices that a geometry can have in a structure. Its memory is not looked at, and counts are
     * maxima. NULL: there are no vertices.
     */
    uint64_t (*vertices_most)(const struct geometry *geometry);
    /* Writes `count` records, one for each ref, which is a flat primitive id. */
    void (*write)(const struct portable_records *writer, const uint32_t *refs, uint32_t count, unsigned char *record);
    /* Prefetches the data of refs that will be written soon. NULL: their place in memory is known too late. */
    void (*prefetch)(const struct portable_records *writer, const uint32_t *refs, uint32_t count);
    /*
     * Sets used[vertex] to 1 for each vertex of these primitives, by relaxed atomic stores. May be called from any
     * thread. NULL here and in `mark_range`: there are no vertices.
     */
    void (*mark)(const struct canonical *canonical, const uint32_t *refs, uint32_t count, uint8_t *used);
    /* Does the same for `count` primitives of one geometry, from its primitive `first` on. */
    void (*mark_range)(const struct canonical_geometry *geometry, uint32_t first, uint32_t count, uint8_t *used);
    /*
     * Copies the vertices first .. first + count - 1 of a geometry to `to`, without those whose used[i], counted from
     * `first`, is 0; NULL: all are used. Returns where the next one goes. NULL: there are no vertices.
     */
    float *(*copy_vertices)(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                            const uint8_t *used, float *to);
    /*
     * Returns the first record of an untrusted structure, of which the sections and the nodes have been checked, that
     * no writer has made, or the number of records if there is none.
     */
    uint32_t (*find_unsound)(const struct portable_view *view);
    /* Returns the same about vertices. NULL: they may have any values. */
    uint32_t (*find_unsound_vertex)(const struct portable_view *view);
};

extern const struct record_kind record_indexed_triangles, record_triangles, record_aabbs, record_instances,
    record_spheres, record_swept_spheres, record_moving_triangles, record_moving_instances;

/* The rows by enum portable_content. */
extern const struct record_kind *const record_kinds[PORTABLE_CONTENTS];

/* Returns the row of a content, or NULL for a number that is none. */
static inline const struct record_kind *record_kind_of(uint32_t content)
{
    return content < PORTABLE_CONTENTS ? record_kinds[content] : NULL;
}

/* Returns whether structures with that content are top levels, which have handles and no geometries. */
static inline bool record_kind_is_top(uint32_t content)
{
    return content < PORTABLE_CONTENTS && record_kinds[content]->is_top;
}

/* Returns whether records of this kind move, and their nodes have boxes at t = 0 and t = 1. */
static inline bool record_kind_moves(const struct record_kind *kind)
{
    return kind->node_size == sizeof(struct portable_moving_node);
}

/*
 * Returns the content that a structure of STRUCTURE_ `structure_type` gets, whose geometries are of GEOMETRY_
 * `geometry_type`: if they are of several, the one that moves. A top level is one of instances even if it has no
 * geometry.
 */
enum portable_content record_content_for(uint32_t structure_type, uint32_t geometry_type, uint32_t layout_flags);

/* Returns the content of a structure that is built from a canonical copy. */
enum portable_content record_content_of(const struct canonical *canonical, uint32_t layout_flags);

#endif
