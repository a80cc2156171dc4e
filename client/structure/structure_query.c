/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <string.h>

#include "client/argument.h"
#include "client/structure/structure.h"
#include "proto/base/place.h"

/* The four properties: the rule about their stride, and where they come from. */
static const struct property {
    uint32_t type; /* VkQueryType; numbers, because installed headers may lack the later ones */
    enum bvhd_vuid stride_rule;
    bool needs_compaction, is_of_top;
} properties_known[] = {
    {1000150000, BVHD_VUID_03448, true, false}, /* COMPACTED_SIZE */
    {1000150001, BVHD_VUID_03450, false, false}, /* SERIALIZATION_SIZE */
    {1000386000, BVHD_VUID_06733, false, true}, /* SERIALIZATION_BOTTOM_LEVEL_POINTERS */
    {1000386001, BVHD_VUID_06731, false, false}, /* SIZE */
};

/* Numbers below are core query types, and numbers of extensions are at least this. */
enum { QUERIES_OF_CORE = 3, QUERIES_OF_EXTENSIONS = 1000000000 };

static uint64_t value_of(const struct property *property, const struct structure_contents *contents)
{
    switch (property->type) {
    case 1000150001:
        return bvhd_blob_size(contents->blob);
    case 1000386000:
        return contents->handle_count;
    default:
        return contents->body_size;
    }
}

static const struct property *find(uint32_t type)
{
    for (size_t i = 0; i < sizeof properties_known / sizeof properties_known[0]; i++)
        if (properties_known[i].type == type)
            return &properties_known[i];
    return NULL;
}

static enum bvhd_status check_counts(const struct bvhd_structure_properties *properties, struct bvhd_error *error)
{
    if (properties->structure_count == 0)
        return bvhd_error_rule(error, BVHD_VUID_WriteProperties_accelerationStructureCount_arraylength,
                               "properties.structure_count", "0: there is nothing to ask about");
    enum bvhd_status status =
        structure_check_argument(properties->structures, "properties.structures",
                                 BVHD_VUID_WriteProperties_pAccelerationStructures_parameter, error);
    if (status != BVHD_OK)
        return status;
    if (properties->data_size == 0)
        return bvhd_error_rule(error, BVHD_VUID_WriteProperties_dataSize_arraylength, "properties.data_size",
                               "0: there is no room for an answer");
    return structure_check_argument(properties->data, "properties.data", BVHD_VUID_WriteProperties_pData_parameter,
                                    error);
}

static enum bvhd_status check_type(const struct bvhd_structure_properties *properties, struct bvhd_error *error)
{
    const uint32_t type = (uint32_t)properties->query_type;
    if (find(type))
        return BVHD_OK;
    const bool is_type = type < QUERIES_OF_CORE || type >= QUERIES_OF_EXTENSIONS;
    return bvhd_error_rule(error, is_type ? BVHD_VUID_06742 : BVHD_VUID_WriteProperties_queryType_parameter,
                           "properties.query_type", "%" PRIu32 " is no %s", type,
                           is_type ? "property of an acceleration structure" : "VkQueryType");
}

/* A stride below 8 would let answers overlap, and is no multiple of 8, unless it is 0. */
static enum bvhd_status check_room(const struct bvhd_structure_properties *properties, struct bvhd_error *error)
{
    uint64_t needed;
    if (properties->stride % sizeof(VkDeviceSize) != 0)
        return bvhd_error_rule(error, find((uint32_t)properties->query_type)->stride_rule, "properties.stride",
                               "%zu is no multiple of 8", properties->stride);
    bool fits = bytes_mul(properties->stride, properties->structure_count, &needed) && needed <= properties->data_size;
    if (!fits || properties->data_size < sizeof(VkDeviceSize))
        return bvhd_error_rule(error, BVHD_VUID_03452, "properties.data_size",
                               "%zu bytes have no room for %" PRIu32 " numbers", properties->data_size,
                               properties->structure_count);
    return BVHD_OK;
}

static enum bvhd_status check_structure(const struct bvhd_structure_properties *properties, uint32_t index,
                                        struct bvhd_error *error)
{
    const struct property *property = find((uint32_t)properties->query_type);
    const struct bvhd_structure *structure = structure_of(properties->structures[index]);
    const struct place where = place("structures[%" PRIu32 "]", index);
    if (!structure)
        return bvhd_error_rule(error, BVHD_VUID_WriteProperties_pAccelerationStructures_parameter, where.text,
                               "it is VK_NULL_HANDLE");
    if (!structure->contents.blob)
        return bvhd_error_rule(error, BVHD_VUID_04964, where.text, "nothing was built into it");
    if (property->needs_compaction && !(structure->contents.flags & BUILD_ALLOW_COMPACTION))
        return bvhd_error_rule(error, BVHD_VUID_03431, where.text, "it was built without ALLOW_COMPACTION");
    if (property->is_of_top && structure->contents.type != STRUCTURE_TOP)
        return bvhd_error_rule(error, BVHD_VUID_12425, where.text, "it is no top level");
    return BVHD_OK;
}

enum bvhd_status bvhd_structure_query(const struct bvhd_structure_properties *properties, struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {properties, "properties"});
    if (status == BVHD_OK)
        status = argument_check_size(properties, sizeof *properties, sizeof *properties, "properties",
                                     "bvhd_structure_properties", ret_error);
    if (status == BVHD_OK)
        status = check_counts(properties, ret_error);
    if (status == BVHD_OK)
        status = check_type(properties, ret_error);
    if (status == BVHD_OK)
        status = check_room(properties, ret_error);
    for (uint32_t i = 0; status == BVHD_OK && i < properties->structure_count; i++)
        status = check_structure(properties, i, ret_error);
    const struct property *property = status == BVHD_OK ? find((uint32_t)properties->query_type) : NULL;
    for (uint32_t i = 0; property && i < properties->structure_count; i++) {
        const VkDeviceSize value = value_of(property, &structure_of(properties->structures[i])->contents);
        memcpy((unsigned char *)properties->data + i * properties->stride, &value, sizeof value);
    }
    return status;
}

enum bvhd_status bvhd_structure_compatibility(const VkAccelerationStructureVersionInfoKHR *info,
                                              const struct bvhd_format *format,
                                              VkAccelerationStructureCompatibilityKHR *ret_compatibility,
                                              struct bvhd_error *ret_error)
{
    static const struct structure_head head = {VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_VERSION_INFO_KHR,
                                               BVHD_VUID_VersionInfo_sType_sType, BVHD_VUID_VersionInfo_pNext_pNext,
                                               "info"};
    enum bvhd_status status =
        structure_check_argument(info, "info", BVHD_VUID_Compatibility_pVersionInfo_parameter, ret_error);
    if (status == BVHD_OK)
        status = structure_check_argument(ret_compatibility, "ret_compatibility",
                                          BVHD_VUID_Compatibility_pCompatibility_parameter, ret_error);
    if (status == BVHD_OK)
        status = structure_check_head(&head, info, ret_error);
    if (status == BVHD_OK)
        status = structure_check_argument(info->pVersionData, "info.pVersionData",
                                          BVHD_VUID_VersionInfo_pVersionData_parameter, ret_error);
    if (status != BVHD_OK)
        return status;
    *ret_compatibility = structure_is_compatible(info->pVersionData, format)
                             ? VK_ACCELERATION_STRUCTURE_COMPATIBILITY_COMPATIBLE_KHR
                             : VK_ACCELERATION_STRUCTURE_COMPATIBILITY_INCOMPATIBLE_KHR;
    return BVHD_OK;
}
