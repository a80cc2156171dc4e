/* SPDX-License-Identifier: Apache-2.0 */
/* kind_arrays.c - the rules about formats, strides and index types that kinds with vertices share. */
#include <inttypes.h>

#include "proto/base/kind_internal.h"
#include "proto/base/place.h"
#include "proto/base/validate_shape.h"
#include "proto/base/vertex_element.h"
#include "proto/base/vulkan_name.h"

/* Values of VkFormat that decide which rule a wrong one breaks. */
enum { FORMAT_LAST_OF_CORE = 184, FORMAT_FIRST_OF_EXTENSIONS = 1000000000 };

/* Returns the place of a field, as in "infos[0].geometries[1].triangles.vertexFormat". */
static struct place field_place(const struct validate_subject *subject, const char *field)
{
    return place("infos[%u].geometries[%u].%s.%s", subject->info, subject->index,
                 kind_find(subject->geometry->type)->member, field);
}

/* Numbers of extensions may be formats that are newer than this program, those below them are known. */
enum bvhd_status kind_refuse_format(const struct validate_subject *subject, const char *field, uint32_t format,
                                    enum bvhd_vuid rule, enum bvhd_vuid parameter_rule)
{
    bool is_format = format <= FORMAT_LAST_OF_CORE || format >= FORMAT_FIRST_OF_EXTENSIONS;
    return bvhd_error_rule(subject->error, is_format ? rule : parameter_rule, field_place(subject, field).text,
                           "%s is %s, which is no %s", field, vulkan_name(VULKAN_FORMAT, format).text,
                           is_format ? "format of this array" : "VkFormat");
}

enum bvhd_status kind_check_large_stride(const struct validate_subject *subject, const char *field, uint64_t stride,
                                         const struct kind_rules *rules)
{
    if (stride <= UINT32_MAX)
        return BVHD_OK;
    return bvhd_error_rule(subject->error, rules->large_stride, field_place(subject, field).text,
                           "%" PRIu64 " is over 2^32 - 1", stride);
}

enum bvhd_status kind_check_vertices(const struct validate_subject *subject, uint32_t format, uint64_t stride,
                                     const struct kind_rules *rules)
{
    const struct vertex_element *element = vertex_element_find(format);
    if (!element)
        return kind_refuse_format(subject, "vertexFormat", format, rules->vertex_format,
                                  rules->vertex_format_parameter);
    if (subject->ignores_strides)
        return BVHD_OK;
    if (stride % element->alignment != 0)
        return bvhd_error_rule(subject->error, rules->vertex_stride, field_place(subject, "vertexStride").text,
                               "%" PRIu64 " is no multiple of %u, as %s needs", stride, element->alignment,
                               element->name);
    return kind_check_large_stride(subject, "vertexStride", stride, rules);
}

enum bvhd_status kind_check_index_type(const struct validate_subject *subject, uint32_t type,
                                       const struct kind_rules *rules)
{
    if (type == INDEX_NONE || type == INDEX_UINT16 || type == INDEX_UINT32)
        return BVHD_OK;
    return bvhd_error_rule(subject->error, type == INDEX_UINT8 ? rules->index_type : rules->index_type_parameter,
                           field_place(subject, "indexType").text, "indexType is %s, none of UINT16, UINT32 and NONE",
                           vulkan_name(VULKAN_INDEX_TYPE, type).text);
}
