/* SPDX-License-Identifier: Apache-2.0 */
/* micromap_submit.c - requests micromaps as structures of VK_KHR_opacity_micromap, whatever form they come in. */
#include <bvhd/bvhd_micromap.h>

#include "client/argument.h"
#include "client/client_submit.h"
#include "client/library.h"
#include "proto/base/geometry.h"
#include "proto/base/memory.h"
#include "proto/base/place.h"

/* What the infos of a call become. It lives during the call. */
struct conversion {
    VkAccelerationStructureGeometryMicromapDataKHR *data; /* of infos; not of bakes, which are data themselves */
    VkAccelerationStructureGeometryKHR *geometries;
    VkAccelerationStructureBuildGeometryInfoKHR *infos;
    struct bvhd_error *errors;
};

/* The flags that micromaps have in both extensions. */
static const struct {
    VkBuildMicromapFlagBitsEXT from;
    uint32_t to;
} flag_pairs[] = {
    {VK_BUILD_MICROMAP_PREFER_FAST_TRACE_BIT_EXT, BUILD_PREFER_FAST_TRACE},
    {VK_BUILD_MICROMAP_PREFER_FAST_BUILD_BIT_EXT, BUILD_PREFER_FAST_BUILD},
    {VK_BUILD_MICROMAP_ALLOW_COMPACTION_BIT_EXT, BUILD_ALLOW_COMPACTION},
};

_Static_assert(sizeof(VkMicromapUsageEXT) == sizeof(VkMicromapUsageKHR) &&
                   sizeof(VkMicromapTriangleEXT) == sizeof(VkMicromapTriangleKHR),
               "both extensions have the same structs");

static enum bvhd_status check_build(const struct bvhd_micromap_build *build, struct bvhd_error *error)
{
    enum bvhd_status status =
        argument_check_size(build, sizeof *build, sizeof *build, "build", "bvhd_micromap_build", error);
    if (status != BVHD_OK)
        return status;
    if (build->info_count > 0 && !build->infos == !build->bakes)
        return bvhd_error_set(error, BVHD_INVALID, "build.infos",
                              build->infos ? "infos and bakes are both set"
                                           : "infos and bakes are both NULL, but info_count is %u",
                              build->info_count);
    for (uint32_t i = 0; build->bakes && i < build->info_count; i++)
        if (build->bakes[i].sType != BVHD_STRUCTURE_TYPE_MICROMAP_BAKE || build->bakes[i].pNext)
            return bvhd_error_set(error, BVHD_INVALID, place("build.bakes[%u].sType", i).text,
                                  "sType is not BVHD_STRUCTURE_TYPE_MICROMAP_BAKE, or pNext is not NULL");
    return build->reserved == 0 ? BVHD_OK : bvhd_error_set(error, BVHD_UNSUPPORTED, "build.reserved", "it is not 0");
}

static uint32_t known_flags(void)
{
    uint32_t flags = 0;
    for (size_t i = 0; i < sizeof flag_pairs / sizeof *flag_pairs; i++)
        flags |= (uint32_t)flag_pairs[i].from;
    return flags;
}

/* Checks what only the struct of VK_EXT_opacity_micromap shows. */
static enum bvhd_status check_info(const VkMicromapBuildInfoEXT *info, uint32_t index, struct bvhd_error *error)
{
    if (info->sType != VK_STRUCTURE_TYPE_MICROMAP_BUILD_INFO_EXT)
        return bvhd_error_rule(error, BVHD_VUID_MicromapBuildInfo_sType_sType, place("infos[%u].sType", index).text,
                               "sType is not MICROMAP_BUILD_INFO_EXT");
    if (info->pNext)
        return bvhd_error_rule(error, BVHD_VUID_MicromapBuildInfo_pNext_pNext, place("infos[%u].pNext", index).text,
                               "no struct belongs here");
    if (info->type != VK_MICROMAP_TYPE_OPACITY_MICROMAP_EXT)
        return bvhd_error_rule(error, BVHD_VUID_MicromapBuildInfo_type_parameter, place("infos[%u].type", index).text,
                               "type is %u, which is no opacity micromap", (uint32_t)info->type);
    if (info->flags & ~known_flags())
        return bvhd_error_rule(error, BVHD_VUID_MicromapBuildInfo_flags_parameter, place("infos[%u].flags", index).text,
                               "unknown bits 0x%x", info->flags & ~known_flags());
    if (info->mode != VK_BUILD_MICROMAP_MODE_BUILD_EXT)
        return bvhd_error_rule(error, BVHD_VUID_07462, place("infos[%u].mode", index).text,
                               "mode is %u, but micromaps are built, not updated", (uint32_t)info->mode);
    if (info->pUsageCounts && info->ppUsageCounts)
        return bvhd_error_rule(error, BVHD_VUID_07516, place("infos[%u].pUsageCounts", index).text,
                               "pUsageCounts and ppUsageCounts are both set");
    return BVHD_OK;
}

static uint32_t convert_flags(VkBuildMicromapFlagsEXT flags)
{
    uint32_t converted = 0;
    for (size_t i = 0; i < sizeof flag_pairs / sizeof *flag_pairs; i++)
        converted |= flags & (uint32_t)flag_pairs[i].from ? flag_pairs[i].to : 0;
    return converted;
}

static VkDeviceAddress number_of(VkDeviceOrHostAddressConstKHR address)
{
    return (VkDeviceAddress)(uintptr_t)address.hostAddress;
}

static VkAccelerationStructureGeometryMicromapDataKHR convert_data(const VkMicromapBuildInfoEXT *info)
{
    return (VkAccelerationStructureGeometryMicromapDataKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MICROMAP_DATA_KHR,
        .usageCountsCount = info->usageCountsCount,
        .pUsageCounts = (const void *)info->pUsageCounts,
        .ppUsageCounts = (const void *)info->ppUsageCounts,
        .data = number_of(info->data),
        .triangleArray = number_of(info->triangleArray),
        .triangleArrayStride = info->triangleArrayStride,
    };
}

/* Makes the info of number `index`, whose geometry has its data in the struct `data`. */
static void convert_info(struct conversion *conversion, uint32_t index, uint32_t flags, const void *data)
{
    conversion->geometries[index] = (VkAccelerationStructureGeometryKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .pNext = data,
        .geometryType = VK_GEOMETRY_TYPE_MICROMAP_KHR,
    };
    conversion->infos[index] = (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = VK_ACCELERATION_STRUCTURE_TYPE_OPACITY_MICROMAP_KHR,
        .flags = flags,
        .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
        .geometryCount = 1,
        .pGeometries = &conversion->geometries[index],
    };
}

static void convert(const struct bvhd_micromap_build *build, struct conversion *conversion)
{
    for (uint32_t i = 0; i < build->info_count; i++) {
        conversion->errors[i] = (struct bvhd_error){.status = BVHD_OK};
        if (build->bakes) {
            convert_info(conversion, i, 0, &build->bakes[i]);
            continue;
        }
        check_info(&build->infos[i], i, &conversion->errors[i]);
        conversion->data[i] = convert_data(&build->infos[i]);
        convert_info(conversion, i, convert_flags(build->infos[i].flags), &conversion->data[i]);
    }
}

static bool make_room(uint32_t count, struct conversion *conversion)
{
    const uint64_t some = (uint64_t)count + 1;
    conversion->data = memory_array(&library_memory, some, sizeof *conversion->data);
    conversion->geometries = memory_array(&library_memory, some, sizeof *conversion->geometries);
    conversion->infos = memory_array(&library_memory, some, sizeof *conversion->infos);
    conversion->errors = memory_array(&library_memory, some, sizeof *conversion->errors);
    return conversion->data && conversion->geometries && conversion->infos && conversion->errors;
}

static void free_room(struct conversion *conversion)
{
    memory_free(&library_memory, conversion->data);
    memory_free(&library_memory, conversion->geometries);
    memory_free(&library_memory, conversion->infos);
    memory_free(&library_memory, conversion->errors);
}

enum bvhd_status bvhd_micromap_submit(struct bvhd_client *client, const struct bvhd_micromap_build *build,
                                      struct bvhd_batch **ret_batch, struct bvhd_error *ret_error)
{
    struct conversion conversion = {0};
    enum bvhd_status status =
        ARGUMENTS_CHECK(ret_error, {client, "client"}, {build, "build"}, {ret_batch, "ret_batch"});
    if (status == BVHD_OK)
        status = check_build(build, ret_error);
    if (status != BVHD_OK)
        return status;
    if (make_room(build->info_count, &conversion)) {
        convert(build, &conversion);
        const struct bvhd_build converted = {
            .struct_size = sizeof converted,
            .info_count = build->info_count,
            .infos = conversion.infos,
            .priority = build->priority,
            .deadline_ms = build->deadline_ms,
        };
        status = client_submit(client, &converted, conversion.errors, ret_batch, ret_error);
    } else {
        status = bvhd_error_no_memory(ret_error, "batch", "no memory for it");
    }
    free_room(&conversion);
    return status;
}
