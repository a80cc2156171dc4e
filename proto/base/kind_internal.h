/* SPDX-License-Identifier: Apache-2.0 */
/* kind_internal.h - the kinds, one a file, and what those share that have no formats or vertices. */
#ifndef BVHD_KIND_INTERNAL_H
#define BVHD_KIND_INTERNAL_H

#include "proto/base/kind.h"

extern const struct kind kind_triangles, kind_aabbs, kind_instances, kind_spheres, kind_swept_spheres;

/* For kinds whose primitives have no vertices. */
uint64_t kind_no_vertices(const struct geometry *geometry);

#endif
