/* SPDX-License-Identifier: Apache-2.0 */
/* kind_round.c - what spheres and the ends of linear swept spheres have in common. */
#include "proto/base/kind_internal.h"
#include "proto/base/validate_shape.h"
#include "proto/base/vertex_element.h"

static enum bvhd_status check_radii(const struct validate_subject *subject, const struct geometry_spheres *spheres,
                                    const struct kind_rules *rules)
{
    if (!radius_element_find(spheres->radius_format))
        return kind_refuse_format(subject, "radiusFormat", spheres->radius_format, rules->radius_format,
                                  rules->radius_format_parameter);
    return subject->ignores_strides ? BVHD_OK
                                    : kind_check_large_stride(subject, "radiusStride", spheres->radius_stride, rules);
}

enum bvhd_status kind_check_spheres(const struct validate_subject *subject, const struct geometry_spheres *spheres,
                                    const struct kind_rules *rules)
{
    enum bvhd_status status = kind_check_vertices(subject, spheres->vertex_format, spheres->vertex_stride, rules);
    if (status == BVHD_OK)
        status = check_radii(subject, spheres, rules);
    return status == BVHD_OK ? kind_check_index_type(subject, spheres->index_type, rules) : status;
}

/* Returns how many elements an array may have, the last of which may end before its stride does. */
static uint64_t elements_of(struct bytes array, uint64_t stride)
{
    return stride == 0 ? UINT64_MAX : array.size / stride + (array.size % stride != 0);
}

bool kind_is_one_sphere(const struct geometry_spheres *spheres)
{
    return spheres->vertex_stride == 0 && spheres->radius_stride == 0;
}

uint64_t kind_named_spheres(const struct geometry_spheres *spheres)
{
    uint64_t most = spheres->index_type == INDEX_UINT16 ? UINT64_C(1) << 16 : UINT64_C(1) << 32;
    uint64_t centres = elements_of(spheres->vertices, spheres->vertex_stride);
    uint64_t radii = elements_of(spheres->radii, spheres->radius_stride);
    most = centres < most ? centres : most;
    return radii < most ? radii : most;
}
