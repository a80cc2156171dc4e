/* SPDX-License-Identifier: Apache-2.0 */
/*
 * refit_vertices.h - writes the vertices of an updated portable structure with indexed triangles: the new positions of
 * the same vertices as in its source, which keeps only those that its records name.
 */
#ifndef BVHD_REFIT_VERTICES_H
#define BVHD_REFIT_VERTICES_H

#include "builder/context.h"
#include "builder/format/canonical.h"
#include "builder/format/portable.h"

/*
 * Writes source->header->vertex_count positions, three floats each. Where the source dropped vertices, its records tell
 * which; vertices that no record names become zero. Returns BVHD_NO_MEMORY, BVHD_CANCELLED, or BVHD_CORRUPT for a
 * source that cannot be of this geometry.
 */
enum bvhd_status refit_vertices(const struct canonical *canonical, const struct portable_view *source,
                                const struct build_context *context, float *vertices, struct bvhd_error *error);

#endif
