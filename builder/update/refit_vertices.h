/* SPDX-License-Identifier: Apache-2.0 */
/*
 * refit_vertices.h - writes the vertices of an updated portable structure whose records name vertices: the new values
 * of the same vertices as in its source, which keeps only those that active primitives use.
 */
#ifndef BVHD_REFIT_VERTICES_H
#define BVHD_REFIT_VERTICES_H

#include "builder/format/record_kind.h"
#include "builder/update/record.h"

/*
 * Writes the `count` vertices that the source has, of kind->vertex_size bytes each: those that active primitives use,
 * in their order. `record` is that of `canonical`. Returns BVHD_NO_MEMORY, BVHD_CANCELLED, or BVHD_CORRUPT if so many
 * vertices are not used.
 */
enum bvhd_status refit_vertices(const struct record_kind *kind, const struct canonical *canonical,
                                const struct record *record, const struct build_context *context, float *vertices,
                                uint32_t count, struct bvhd_error *error);

#endif
