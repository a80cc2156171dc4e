/* SPDX-License-Identifier: Apache-2.0 */
/* round_records.h - the records of spheres and of linear swept spheres, and a ray against one of them. Internal. */
#ifndef BVHD_ROUND_RECORDS_H
#define BVHD_ROUND_RECORDS_H

#include "builder/traverse/traverse_state.h"

static inline const struct portable_round *round_record_at(const struct portable_view *view, uint32_t record)
{
    return (const struct portable_round *)view->records + record;
}

/* Returns the vertex of a record. A linear swept sphere's second end follows it. */
static inline const float *round_vertex_of(const struct portable_view *view, const struct portable_round *round)
{
    return view->vertices + (uint64_t)4 * round->vertex;
}

/* Prepares a state for the tests of one kind (leaf_round.c). */
void round_prepare(struct traverse_state *state, enum traverse_kind kind);

/* Test the ray in the state against one record (leaf_round.c). */
void round_meet_sphere(struct traverse_state *state, const struct portable_view *view, uint32_t record);
void round_meet_swept(struct traverse_state *state, const struct portable_view *view, uint32_t record);
/* Does it for a linear swept sphere of which the ray can enter only the cap of one end, if there is one. */
void round_meet_cap(struct traverse_state *state, const struct portable_view *view, uint32_t record, unsigned end);

/*
 * Traverses a non-empty bottom level of spheres or linear swept spheres with AVX2 (round_avx2.c), on machines for which
 * boxtest_has_avx2() is true. The state is ready for its primitives, but not prepared. Returns false, and does nothing,
 * if the general walk is needed.
 */
bool traverse_avx2_round(struct traverse_state *state, const struct portable_view *view,
                         const struct unpacked_node *unpacked);

/* Does the same for a plain ray in world space and an unpacked structure, with a state that is settled plainly. */
bool traverse_avx2_round_plain(struct traverse_state *state, const struct portable_view *view,
                               const struct unpacked_node *unpacked);

#endif
