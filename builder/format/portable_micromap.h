/* SPDX-License-Identifier: Apache-2.0 */
/*
 * portable_micromap.h - a micromap of the portable layout: its bytes as structs, its writer and its reader. FORMATS.md
 * has the tables.
 *
 * A blob is both UUIDs of Vulkan's serialized header (serialized micromaps have no more of it), zeros up to a multiple
 * of 64, then the body; offsets in the body count from its start. Triangles whose states are the same bytes share them.
 */
#ifndef BVHD_PORTABLE_MICROMAP_H
#define BVHD_PORTABLE_MICROMAP_H

#include "builder/format/layout.h"
#include "builder/format/micro_triangle.h"
#include "builder/format/portable.h"

enum { PORTABLE_MICROMAP_MAGIC = 0x4d485642 /* "BVHM" */, PORTABLE_MICROMAP_BODY = 64 };

/* The first 128 bytes of the body. */
struct portable_micromap_header {
    uint32_t magic;
    uint32_t version; /* of the portable layout: the oldest one that has micromaps */
    uint32_t build_flags; /* BUILD_ of the request */
    uint32_t triangle_count; /* struct micromap_triangle, 8 bytes each */
    uint32_t index_count; /* of a baked micromap, one u32 for each triangle of the request; else 0 */
    uint32_t reserved[3]; /* 0 */
    /* Offsets from the body's start, multiples of 16. Each section lies inside the body, in this order. */
    uint64_t triangle_offset;
    uint64_t states_offset;
    uint64_t states_size; /* bytes */
    uint64_t index_offset;
    uint64_t body_size;
    /*
     * For each enum micro_state, how many micro-triangles of the request's triangles have it. Only baked micromaps have
     * these numbers; others have zeros.
     */
    uint64_t baked[MICRO_STATES];
    uint64_t reserved_end[3]; /* 0 */
};

_Static_assert(sizeof(struct portable_micromap_header) == 128, "layout");

/* A blob opened for reading. All pointers lead into the blob, which must stay unchanged and outlive the view. */
struct portable_micromap_view {
    const struct portable_micromap_header *header;
    const struct micromap_triangle *triangles;
    const unsigned char *states;
    const uint32_t *indices; /* header->index_count: special ones (MICROMAP_FULLY_), or below triangle_count */
};

/*
 * Opens a hostile blob, 16-byte aligned. It checks the header, every section's place, and of every triangle its level,
 * its format and that its states lie inside, and every index, so that portable_micromap_state reads without further
 * checks. Takes O(triangles and indices) time. Returns BVHD_CORRUPT or BVHD_INCOMPATIBLE with the place.
 */
enum bvhd_status portable_micromap_open(struct bytes blob, struct portable_micromap_view *ret_view,
                                        struct bvhd_error *error);

/* Writes a micromap. It is the function of the layout (layout.h). */
enum bvhd_status portable_micromap_write(const struct layout_micromap *input, unsigned char **ret_blob,
                                         struct layout_sizes *ret_sizes, struct bvhd_error *error);

/* Returns the bytes of the body of a micromap with these numbers of triangles, bytes of states and indices. */
uint64_t portable_micromap_bound(uint64_t triangles, uint64_t states, uint64_t indices);

/* Returns the state at the point with weights u and v of triangle `triangle`, which is below header->triangle_count. */
static inline enum micro_state portable_micromap_state(const struct portable_micromap_view *view, uint32_t triangle,
                                                       float u, float v)
{
    const struct micromap_triangle *found = &view->triangles[triangle];
    return micro_triangle_state(view->states + found->offset, (enum micro_format)found->format,
                                micro_triangle_index(u, v, found->level));
}

#endif
