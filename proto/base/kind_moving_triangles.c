/* SPDX-License-Identifier: Apache-2.0 */
/* kind_moving_triangles.c - triangles whose vertices are in one place at t = 0 and in another at t = 1. */
#include "proto/base/kind_internal.h"
#include "proto/base/validate_shape.h"

/* The vertices at t = 1 have the format, the stride and the indices of those at t = 0. */
static enum bvhd_status check_shape(const struct validate_subject *subject)
{
    return kind_triangles.check_shape(subject);
}

static uint64_t vertices(const struct geometry *geometry)
{
    return kind_triangles.vertices(geometry);
}

const struct kind kind_moving_triangles = {
    .type = GEOMETRY_MOVING_TRIANGLES,
    .vulkan_type = GEOMETRY_TRIANGLES,
    .moves = true,
    .number = KIND_MOVING_TRIANGLES,
    .noun = "motion triangles",
    .member = "triangles",
    .too_many = BVHD_VUID_03795,
    .primitive_bytes = 3 * sizeof(uint32_t),
    .vertex_bytes = 6 * sizeof(float),
    .check_shape = check_shape,
    .vertices = vertices,
};
