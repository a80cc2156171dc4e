/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/kind_internal.h"

static enum bvhd_status check_shape(const struct validate_subject *subject)
{
    (void)subject;
    return BVHD_OK;
}

static uint64_t vertices(const struct geometry *geometry)
{
    return 2 * (uint64_t)geometry->range.primitive_count;
}

const struct kind kind_swept_spheres = {
    .type = GEOMETRY_SWEPT_SPHERES,
    .number = KIND_SWEPT_SPHERES,
    .noun = "linear swept spheres",
    .member = "linearSweptSpheres",
    .too_many = BVHD_VUID_03795,
    .primitive_bytes = sizeof(uint32_t),
    .vertex_bytes = 4 * sizeof(float),
    .check_shape = check_shape,
    .vertices = vertices,
};
