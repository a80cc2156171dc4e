/* SPDX-License-Identifier: Apache-2.0 */
/*
 * numbering.h - divides items that are numbered through over all geometries, its primitives or its vertices, among the
 * geometries that have them.
 */
#ifndef BVHD_NUMBERING_H
#define BVHD_NUMBERING_H

#include "builder/input/canonical_form.h"

/* Processes items [first, first + count) of one geometry. */
typedef void (*numbering_function)(void *context, uint32_t geometry, uint32_t first, uint32_t count);

/*
 * Calls `take` for items [begin, end), cut at the borders of geometries. `section`: FORM_PRIMITIVES for primitives,
 * FORM_POSITIONS for vertices. Of the view only the counts and the prefix sums of its geometries are used.
 */
void numbering_for_each(const struct canonical *view, enum form_section section, size_t begin, size_t end,
                        numbering_function take, void *context);

#endif
