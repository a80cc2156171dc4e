/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/kind_internal.h"

/* Instance records have one format. */
static enum bvhd_status check_shape(const struct validate_subject *subject)
{
    (void)subject;
    return BVHD_OK;
}

const struct kind kind_instances = {
    .type = GEOMETRY_INSTANCES,
    .vulkan_type = GEOMETRY_INSTANCES,
    .number = KIND_INSTANCES,
    .noun = "instances",
    .member = "instances",
    .is_top = true,
    .too_many = BVHD_VUID_03801,
    .primitive_bytes = 64,
    .check_shape = check_shape,
    .vertices = kind_no_vertices,
};
