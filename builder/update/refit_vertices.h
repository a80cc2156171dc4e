/* SPDX-License-Identifier: Apache-2.0 */
/*
 * refit_vertices.h - writes the vertices of an updated portable structure with indexed triangles: the new positions of
 * the same vertices as in its source, which keeps only those that active triangles use.
 */
#ifndef BVHD_REFIT_VERTICES_H
#define BVHD_REFIT_VERTICES_H

#include "builder/update/record.h"

/*
 * Writes the `count` positions that the source has, three floats each: those of the vertices that active triangles use,
 * in their order. `record` is that of `canonical`. Returns BVHD_NO_MEMORY, BVHD_CANCELLED, or BVHD_CORRUPT if so many
 * vertices are not used.
 */
enum bvhd_status refit_vertices(const struct canonical *canonical, const struct record *record,
                                const struct build_context *context, float *vertices, uint32_t count,
                                struct bvhd_error *error);

#endif
