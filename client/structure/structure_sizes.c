/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/layout.h"
#include "builder/format/size_bound.h"
#include "client/argument.h"
#include "client/library.h"
#include "client/structure/structure.h"
#include "client/vulkan_input.h"
#include "proto/base/kind.h"
#include "proto/base/place.h"
#include "proto/base/validate_shape.h"

/* The rule about the number of instances has a name of its own here. */
static enum bvhd_status check_instances(const struct build_input *input, struct bvhd_error *error)
{
    const uint64_t most = limits_default().max_instances;
    const struct kind *kind = input->geometry_count == 1 ? kind_find(input->geometries->type) : NULL;
    if (!kind || !kind->is_top || input->geometries->range.primitive_count <= most)
        return BVHD_OK;
    return bvhd_error_rule(error, BVHD_VUID_03785, "max_primitive_counts[0]", "%u instances, at most %llu",
                           input->geometries->range.primitive_count, (unsigned long long)most);
}

static enum bvhd_status check_geometries(const struct build_input *input, struct bvhd_error *error)
{
    const struct limits limits = limits_default();
    uint64_t total = 0;
    enum bvhd_status status = check_instances(input, error);
    for (uint32_t i = 0; status == BVHD_OK && i < input->geometry_count; i++) {
        const struct validate_subject subject = {&input->geometries[i], 0, i, error, .ignores_strides = true};
        status = validate_geometry(&subject, input, &limits, &total);
        if (status == BVHD_OK)
            status = layout_check_kind(layout_find(input->options.target), &subject);
        if (status == BVHD_OK)
            status = kind_find(input->geometries[i].type)->check_shape(&subject);
    }
    return status;
}

static enum bvhd_status check(const struct build_input *input, struct bvhd_error *error)
{
    const struct limits limits = limits_default();
    enum bvhd_status status = validate_type(input->type, input->flags, 0, error);
    if (status == BVHD_OK)
        status = validate_geometry_count(input->type, input->geometry_count, 0, &limits, error);
    return status == BVHD_OK ? check_geometries(input, error) : status;
}

/*
 * Converts the info without anything behind its addresses: ranges without primitives reach nothing, and the counts are
 * put in afterwards.
 */
static enum bvhd_status convert(const VkAccelerationStructureBuildGeometryInfoKHR *info,
                                const struct build_options *options, struct vulkan_input **ret_input,
                                struct bvhd_error *error)
{
    const struct limits limits = limits_default();
    const uint64_t room = info->geometryCount <= limits.max_geometries ? (uint64_t)info->geometryCount + 1 : 1;
    VkAccelerationStructureBuildRangeInfoKHR *ranges = memory_array(&library_memory, room, sizeof *ranges);
    if (!ranges)
        return bvhd_error_no_memory(error, "info", "no memory for %u geometries", info->geometryCount);
    memset(ranges, 0, room * sizeof *ranges);
    const VkAccelerationStructureBuildRangeInfoKHR *const array[] = {ranges};
    struct bvhd_error inner = {.status = BVHD_OK};
    enum bvhd_status status =
        vulkan_input_create_in(&library_memory, info, 1, array, NULL, 0, options, ret_input, &inner);
    memory_free(&library_memory, ranges);
    if (status != BVHD_OK)
        return bvhd_error_no_memory(error, "info", "no memory for %u geometries", info->geometryCount);
    if (inner.status == BVHD_OK)
        return BVHD_OK;
    vulkan_input_destroy(*ret_input);
    if (error)
        *error = inner;
    return inner.status;
}

enum bvhd_status structure_bound(const VkAccelerationStructureBuildGeometryInfoKHR *info, const uint32_t *counts,
                                 const struct build_options *options, uint64_t *ret_size, struct bvhd_error *error)
{
    struct vulkan_input *converted;
    enum bvhd_status status = convert(info, options, &converted, error);
    if (status != BVHD_OK)
        return status;
    struct build_input input = *vulkan_input_entries(converted);
    struct geometry *geometries = memory_array(&library_memory, (uint64_t)input.geometry_count + 1, sizeof *geometries);
    if (!geometries) {
        status = bvhd_error_no_memory(error, "info", "no memory for %u geometries", input.geometry_count);
    } else {
        for (uint32_t i = 0; i < input.geometry_count; i++) {
            geometries[i] = input.geometries[i];
            geometries[i].range.primitive_count = counts[i];
        }
        input.geometries = geometries;
        status = check(&input, error);
    }
    if (status == BVHD_OK)
        *ret_size = size_bound(&input);
    memory_free(&library_memory, geometries);
    vulkan_input_destroy(converted);
    return status;
}

static enum bvhd_status check_query(const struct bvhd_structure_sizes_query *query, struct bvhd_error *error)
{
    enum bvhd_status status =
        argument_check_size(query, sizeof *query, sizeof *query, "query", "bvhd_structure_sizes_query", error);
    if (status == BVHD_OK)
        status =
            structure_check_argument(query->info, "query.info", BVHD_VUID_GetBuildSizes_pBuildInfo_parameter, error);
    if (status != BVHD_OK)
        return status;
    if ((uint32_t)query->build_type > VK_ACCELERATION_STRUCTURE_BUILD_TYPE_HOST_OR_DEVICE_KHR)
        return bvhd_error_rule(error, BVHD_VUID_GetBuildSizes_buildType_parameter, "query.build_type",
                               "%u is no VkAccelerationStructureBuildTypeKHR", (unsigned)query->build_type);
    if (query->info->geometryCount > 0 && !query->max_primitive_counts)
        return bvhd_error_rule(error, BVHD_VUID_03619, "query.max_primitive_counts",
                               "it is NULL, but geometryCount is %u", query->info->geometryCount);
    if ((unsigned)query->quality > BVHD_QUALITY_AUTO)
        return bvhd_error_set(error, BVHD_INVALID, "query.quality", "%u is no value of enum bvhd_quality",
                              (unsigned)query->quality);
    return BVHD_OK;
}

static enum bvhd_status read_options(const struct bvhd_structure_sizes_query *query, struct build_options *ret_options,
                                     struct bvhd_error *error)
{
    const enum target target = query->target ? (enum target)query->target : TARGET_PORTABLE;
    const struct layout *layout = layout_find(target);
    if (!layout)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "query.target", "target %u is not known", (unsigned)target);
    if (query->layout_flags & ~layout->flags)
        return bvhd_error_set(error, BVHD_INVALID, "query.layout_flags", "target %s has no bits 0x%x", layout->name,
                              query->layout_flags & ~layout->flags);
    *ret_options = (struct build_options){
        .quality = (enum build_quality)query->quality, .target = target, .layout_flags = query->layout_flags};
    return BVHD_OK;
}

enum bvhd_status bvhd_structure_sizes(const struct bvhd_structure_sizes_query *query,
                                      VkAccelerationStructureBuildSizesInfoKHR *ret_sizes, struct bvhd_error *ret_error)
{
    static const struct structure_head head = {VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR,
                                               BVHD_VUID_BuildSizesInfo_sType_sType,
                                               BVHD_VUID_BuildSizesInfo_pNext_pNext, "ret_sizes"};
    struct build_options options;
    uint64_t size = 0;
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {query, "query"});
    if (status == BVHD_OK)
        status =
            structure_check_argument(ret_sizes, "ret_sizes", BVHD_VUID_GetBuildSizes_pSizeInfo_parameter, ret_error);
    if (status == BVHD_OK)
        status = structure_check_head(&head, ret_sizes, ret_error);
    if (status == BVHD_OK)
        status = check_query(query, ret_error);
    if (status == BVHD_OK)
        status = read_options(query, &options, ret_error);
    if (status == BVHD_OK)
        status = structure_bound(query->info, query->max_primitive_counts, &options, &size, ret_error);
    if (status != BVHD_OK)
        return status;
    ret_sizes->accelerationStructureSize = size;
    ret_sizes->updateScratchSize = ret_sizes->buildScratchSize = 0;
    return BVHD_OK;
}
