/* SPDX-License-Identifier: Apache-2.0 */
/*
 * size_bound.h - how large a structure may become: a function of its flags, types and counts alone, for programs that
 * ask before they build (Vulkan specification, vkGetAccelerationStructureBuildSizesKHR).
 *
 * The bound is never below the size of a structure that is built from such a request, or from one with fewer
 * geometries, primitives or vertices, and it never decreases when a count grows. It is what the worst tree takes: most
 * trees take a quarter of it.
 */
#ifndef BVHD_SIZE_BOUND_H
#define BVHD_SIZE_BOUND_H

#include "proto/base/geometry.h"

/*
 * Returns the most bytes of the body of a structure, its deserialized size. `input` has passed the checks of
 * validate_shape.h, and its target is known; the memory and the offsets of its geometries are not looked at, except
 * for the usages of a micromap, and primitive_count and max_vertex count as maxima. QUALITY_UNSPECIFIED stands for
 * what the PREFER flags say, and without them, as QUALITY_AUTO does, for any quality.
 */
uint64_t size_bound(const struct build_input *input);

#endif
