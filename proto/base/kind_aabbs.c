/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>

#include "proto/base/kind_internal.h"
#include "proto/base/place.h"
#include "proto/base/validate_shape.h"

static enum bvhd_status check_shape(const struct validate_subject *subject)
{
    uint64_t stride = subject->geometry->aabbs.stride;
    if (subject->ignores_strides)
        return BVHD_OK;
    if (stride % 8 != 0)
        return bvhd_error_rule(subject->error, BVHD_VUID_03545, VALIDATE_GEOMETRY_PLACE(subject, "aabbs.stride"),
                               "%" PRIu64 " is no multiple of 8", stride);
    if (stride > UINT32_MAX)
        return bvhd_error_rule(subject->error, BVHD_VUID_03820, VALIDATE_GEOMETRY_PLACE(subject, "aabbs.stride"),
                               "%" PRIu64 " is over 2^32 - 1", stride);
    return BVHD_OK;
}

const struct kind kind_aabbs = {
    .type = GEOMETRY_AABBS,
    .vulkan_type = GEOMETRY_AABBS,
    .number = KIND_AABBS,
    .noun = "AABBs",
    .member = "aabbs",
    .too_many = BVHD_VUID_03794,
    .primitive_bytes = 6 * sizeof(float),
    .check_shape = check_shape,
    .vertices = kind_no_vertices,
};
