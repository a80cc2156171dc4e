/* SPDX-License-Identifier: Apache-2.0 */
/* kind_internal.h - the kinds, one a file, and the functions that several of them share. */
#ifndef BVHD_KIND_INTERNAL_H
#define BVHD_KIND_INTERNAL_H

#include "proto/base/kind.h"

extern const struct kind kind_triangles, kind_aabbs, kind_instances, kind_spheres, kind_swept_spheres,
    kind_moving_triangles, kind_moving_instances, kind_micromap, kind_baked_micromap;

/* The rules about the arrays of a kind with vertices. Triangles have no radii. */
struct kind_rules {
    enum bvhd_vuid vertex_format, vertex_format_parameter; /* no format of vertices; no VkFormat */
    enum bvhd_vuid vertex_stride, large_stride;
    enum bvhd_vuid radius_format, radius_format_parameter;
    enum bvhd_vuid index_type, index_type_parameter; /* the type of others' indices; no VkIndexType */
};

/* Checks format and stride of the vertices. */
enum bvhd_status kind_check_vertices(const struct validate_subject *subject, uint32_t format, uint64_t stride,
                                     const struct kind_rules *rules);
enum bvhd_status kind_check_index_type(const struct validate_subject *subject, uint32_t type,
                                       const struct kind_rules *rules);

/* Checks what spheres, and the ends of linear swept spheres, consist of. */
enum bvhd_status kind_check_spheres(const struct validate_subject *subject, const struct geometry_spheres *spheres,
                                    const struct kind_rules *rules);

/* Returns whether all vertices are one and the same, because both strides are 0. */
bool kind_is_one_sphere(const struct geometry_spheres *spheres);
/* Returns how many vertices lie between the least and the greatest one that any indices can name, at the most. */
uint64_t kind_named_spheres(const struct geometry_spheres *spheres);

/* Refuses a format that the field may not have. */
enum bvhd_status kind_refuse_format(const struct validate_subject *subject, const char *field, uint32_t format,
                                    enum bvhd_vuid rule, enum bvhd_vuid parameter_rule);
enum bvhd_status kind_check_large_stride(const struct validate_subject *subject, const char *field, uint64_t stride,
                                         const struct kind_rules *rules);

/* Checks index type and stride of the micromap of a geometry with triangles, if there is one. */
enum bvhd_status kind_check_triangle_micromap(const struct validate_subject *subject);

/* For kinds whose primitives have no vertices. */
uint64_t kind_no_vertices(const struct geometry *geometry);

#endif
