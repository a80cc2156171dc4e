/* SPDX-License-Identifier: Apache-2.0 */
/* update_triangles.h - what updates of triangles and of motion triangles share (update_kind.h). */
#ifndef BVHD_UPDATE_TRIANGLES_H
#define BVHD_UPDATE_TRIANGLES_H

#include "builder/update/update_kind.h"

enum { UPDATE_TRIANGLES_RULES = 3 };

extern const struct update_rule update_triangles_rules[UPDATE_TRIANGLES_RULES];

void update_triangles_describe(const struct form_geometry *form, struct record_geometry *row);
bool update_triangles_row_is_sound(const struct record_geometry *row);
enum bvhd_status update_triangles_check(const struct update_comparison *comparison, uint32_t geometry);

/* Copies the records of a node, which name vertices: these have the same rows. Returns what update_kind.write does. */
bool update_triangles_copy(const struct refit_records *records, uint32_t first, unsigned count);

/* Returns the box of three corners, none of which is NaN unless foreign bytes name it. */
static inline struct vec4_box update_triangles_box(const float *a, const float *b, const float *c)
{
    const vec4 p = vec4_load3(a), q = vec4_load3(b), r = vec4_load3(c);
    return (struct vec4_box){vec4_min(r, vec4_min(q, p)), vec4_max(r, vec4_max(q, p))};
}

#endif
