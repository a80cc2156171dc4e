/* SPDX-License-Identifier: Apache-2.0 */
/* triangles_refs.h - the refs of triangles and motion triangles: functions of their kinds (input_kind.h). */
#ifndef BVHD_TRIANGLES_REFS_H
#define BVHD_TRIANGLES_REFS_H

#include "builder/input/classification.h"
#include "builder/kernel/vec4.h"

struct classification triangles_refs_look(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                          uint32_t index);

/* The usual triangles are recognised two at a time where the processor has AVX2, with the same results. */
uint32_t triangles_refs_collect(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                uint32_t first, uint32_t end, struct classification_counts *counts,
                                struct primitive_ref *refs);

/* The same for motion triangles, whose `look` decides about those that are not usual. */
uint32_t triangles_refs_collect_moving(classification_look look, const struct canonical *canonical,
                                       const struct canonical_geometry *geometry, uint32_t first, uint32_t end,
                                       struct classification_counts *counts, struct primitive_ref *refs);

/* The functions grow_keys and prefetch_keys of both kinds. */
void triangles_refs_grow_keys(const struct canonical_geometry *geometry, const uint32_t *ids, uint32_t count,
                              struct vec4_box *boxes);
void triangles_refs_prefetch_keys(const struct canonical_geometry *geometry, uint32_t id, int step);

#endif
