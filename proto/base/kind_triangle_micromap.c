/* SPDX-License-Identifier: Apache-2.0 */
/* kind_triangle_micromap.c - the rules about how triangles name those of an opacity micromap. */
#include <inttypes.h>

#include "proto/base/kind_internal.h"
#include "proto/base/place.h"
#include "proto/base/validate_shape.h"
#include "proto/base/vulkan_name.h"

/* Both extensions have these rules, under different numbers. */
struct rules {
    enum bvhd_vuid index_type, stride, large_stride;
};

static const struct rules ext = {BVHD_VUID_10719, BVHD_VUID_10722, BVHD_VUID_10723};
static const struct rules khr = {BVHD_VUID_11570, BVHD_VUID_11573, BVHD_VUID_11574};

/* Returns the bytes of an index of this type, or 0 for a type that micromaps of the extension may not have. */
static uint32_t index_size(uint32_t type, bool is_khr)
{
    switch (type) {
    case INDEX_UINT8:
        return is_khr ? 1 : 0;
    case INDEX_UINT16:
        return 2;
    case INDEX_UINT32:
        return 4;
    default:
        return 0;
    }
}

enum bvhd_status kind_check_triangle_micromap(const struct validate_subject *subject)
{
    const struct triangle_micromap *micromap = &subject->geometry->triangles.micromap;
    const bool is_khr = !micromap->has_usages;
    const struct rules *rules = is_khr ? &khr : &ext;
    if (!micromap->is_given || micromap->index_type == INDEX_NONE)
        return BVHD_OK;
    const uint32_t size = index_size(micromap->index_type, is_khr);
    if (size == 0)
        return bvhd_error_rule(subject->error, rules->index_type,
                               VALIDATE_GEOMETRY_PLACE(subject, "triangles.micromap.indexType"),
                               "indexType is %s, which indices of micromaps are not",
                               vulkan_name(VULKAN_INDEX_TYPE, micromap->index_type).text);
    if (subject->ignores_strides)
        return BVHD_OK;
    if (micromap->stride % size != 0)
        return bvhd_error_rule(subject->error, rules->stride,
                               VALIDATE_GEOMETRY_PLACE(subject, "triangles.micromap.indexStride"),
                               "%" PRIu64 " is no multiple of an index's %u bytes", micromap->stride, size);
    if (micromap->stride > UINT32_MAX)
        return bvhd_error_rule(subject->error, rules->large_stride,
                               VALIDATE_GEOMETRY_PLACE(subject, "triangles.micromap.indexStride"),
                               "%" PRIu64 " is over 2^32 - 1", micromap->stride);
    return BVHD_OK;
}
