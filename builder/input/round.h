/* SPDX-License-Identifier: Apache-2.0 */
/*
 * round.h - what spheres and linear swept spheres share: their vertices are centres with radii, and name-by-index works
 * in the same way. Internal to the two kinds.
 */
#ifndef BVHD_ROUND_H
#define BVHD_ROUND_H

#include "builder/input/classification.h"
#include "builder/input/fetch_internal.h"
#include "builder/input/input_kind.h"

/* The rules about memory and radii that a kind has. */
struct round_rules {
    enum bvhd_vuid indices_given; /* although the index type is NONE */
    enum bvhd_vuid indices, vertices, radii; /* these arrays are there, and reach far enough */
    enum bvhd_vuid negative; /* radii are not negative */
};

/* Returns the arrays of spheres, or of the ends of linear swept spheres. */
const struct geometry_spheres *round_arrays(const struct geometry *geometry);

/* Returns how many vertices the arrays have room for, as far as indices can name them. */
uint64_t round_room(const struct geometry *geometry);

/* Returns whether both strides are 0, so that all vertices are one. */
bool round_is_one_vertex(const struct geometry *geometry);

/*
 * Checks that the arrays are there. `per_primitive`: how many indices, or else vertices, a primitive takes. Vertices
 * that are named by indices are checked by round_check_named.
 */
enum bvhd_status round_check_memory(const struct validate_subject *subject, const struct round_rules *rules,
                                    uint32_t per_primitive);

/* Fills the fields of the row that both kinds have in the same way; an update records more than a build. */
void round_describe(const struct geometry *geometry, bool is_update, struct form_geometry *row);

void round_view(const void *data, struct canonical_geometry *geometry);

/* Reads indices from number `first` on, once. They are as in the request, without firstVertex. */
void round_read_indices(const struct geometry *geometry, uint64_t first, uint64_t count, uint32_t *ret_indices);

/*
 * Checks, when all indices have been read, that the vertices are there which they name. Index i names `per_index`
 * vertices from values[i] on.
 */
enum bvhd_status round_check_named(const struct fetch *fetch, uint32_t geometry, const struct round_rules *rules,
                                   const uint32_t *values, uint64_t count, uint32_t per_index,
                                   struct bvhd_error *error);

/*
 * Sets the number of the geometry's vertices, of which there are `most` at the most. Returns BVHD_TOO_LARGE for more.
 */
enum bvhd_status round_count_vertices(struct fetch *fetch, uint32_t geometry, uint64_t vertices, uint64_t most,
                                      struct bvhd_error *error);

/*
 * Reads `count` vertices from number `vertex` of the request on, to which firstVertex is still to be added, as four
 * floats each. Notes negative radii.
 */
void round_read_vertices(struct fetch *fetch, uint32_t geometry, uint64_t vertex, uint32_t count, float *ret_vertices);

/* Grows the reach by spheres around the vertices, which contain whatever is swept between them, too. */
void round_outline(const struct canonical_geometry *geometry, uint32_t first, uint32_t count, struct reach *reach);

#endif
