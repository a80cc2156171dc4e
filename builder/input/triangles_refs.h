/* SPDX-License-Identifier: Apache-2.0 */
/* triangles_refs.h - the refs of triangles: two functions of `input_triangles` (input_kind.h). */
#ifndef BVHD_TRIANGLES_REFS_H
#define BVHD_TRIANGLES_REFS_H

#include "builder/input/classification.h"

struct classification triangles_refs_look(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                          uint32_t index);

/* The usual triangles are recognised two at a time where the processor has AVX2, with the same results. */
uint32_t triangles_refs_collect(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                uint32_t first, uint32_t end, struct classification_counts *counts,
                                struct primitive_ref *refs);

#endif
