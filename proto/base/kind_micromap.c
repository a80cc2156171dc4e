/* SPDX-License-Identifier: Apache-2.0 */
/* kind_micromap.c - opacity micromaps, whose primitives are triangles that are cut into micro-triangles. */
#include <inttypes.h>

#include "proto/base/kind_internal.h"
#include "proto/base/place.h"
#include "proto/base/validate_shape.h"

enum { STRIDE_ALIGNMENT = 4 };

static enum bvhd_status check_shape(const struct validate_subject *subject)
{
    const uint64_t stride = subject->geometry->micromap.stride;
    if (subject->ignores_strides)
        return BVHD_OK;
    if (stride < sizeof(struct micromap_triangle))
        return bvhd_error_rule(subject->error, BVHD_VUID_11646,
                               VALIDATE_GEOMETRY_PLACE(subject, "micromap.triangleArrayStride"),
                               "%" PRIu64 " is less than a triangle's 8 bytes", stride);
    if (stride % STRIDE_ALIGNMENT != 0)
        return bvhd_error_rule(subject->error, BVHD_VUID_11647,
                               VALIDATE_GEOMETRY_PLACE(subject, "micromap.triangleArrayStride"),
                               "%" PRIu64 " is no multiple of 4", stride);
    return BVHD_OK;
}

/* Triangles whose states overlap in the request have each their own in a copy, so that this is an estimate. */
static uint64_t vertices(const struct geometry *geometry)
{
    return geometry->micromap.states.size;
}

const struct kind kind_micromap = {
    .type = GEOMETRY_MICROMAP,
    .vulkan_type = GEOMETRY_MICROMAP,
    .number = KIND_MICROMAP,
    .noun = "opacity micromaps",
    .member = "micromap",
    .is_micromap = true,
    .too_many = BVHD_VUID_11643,
    .primitive_bytes = sizeof(struct micromap_triangle),
    .vertex_bytes = 1,
    .check_shape = check_shape,
    .vertices = vertices,
};
