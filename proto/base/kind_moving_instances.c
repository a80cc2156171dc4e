/* SPDX-License-Identifier: Apache-2.0 */
/* kind_moving_instances.c - the instances of a top level that moves, each of which may stand still or move. */
#include "proto/base/kind_internal.h"

/* Instance records have one format. */
static enum bvhd_status check_shape(const struct validate_subject *subject)
{
    (void)subject;
    return BVHD_OK;
}

const struct kind kind_moving_instances = {
    .type = GEOMETRY_MOVING_INSTANCES,
    .vulkan_type = GEOMETRY_INSTANCES,
    .moves = true,
    .number = KIND_MOVING_INSTANCES,
    .noun = "motion instances",
    .member = "instances",
    .is_top = true,
    .too_many = BVHD_VUID_03801,
    .primitive_bytes = MOTION_RECORD_STRIDE,
    .check_shape = check_shape,
    .vertices = kind_no_vertices,
};
