/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>

#include "client/argument.h"
#include "client/library.h"
#include "client/structure/structure.h"
#include "proto/base/place.h"
#include "proto/base/validate_shape.h"

typedef VkAccelerationStructureBuildRangeInfoKHR range_info;

/* Addresses and strides of ranges are multiples of this. */
enum { INDIRECT_ALIGNMENT = 4 };

static enum bvhd_status check_arrays(const struct bvhd_indirect *indirect, struct bvhd_error *error)
{
    enum bvhd_status status =
        structure_check_argument(indirect->infos, "indirect.infos", BVHD_VUID_Indirect_pInfos_parameter, error);
    if (status == BVHD_OK)
        status = structure_check_argument(indirect->addresses, "indirect.addresses",
                                          BVHD_VUID_Indirect_pIndirectDeviceAddresses_parameter, error);
    if (status == BVHD_OK)
        status = structure_check_argument(indirect->strides, "indirect.strides",
                                          BVHD_VUID_Indirect_pIndirectStrides_parameter, error);
    if (status == BVHD_OK)
        status = structure_check_argument(indirect->max_primitive_counts, "indirect.max_primitive_counts",
                                          BVHD_VUID_Indirect_ppMaxPrimitiveCounts_parameter, error);
    return status;
}

/* Checks where the ranges of one info are, before any is read. */
static enum bvhd_status check_info(const struct bvhd_indirect *indirect, uint32_t index, struct bvhd_error *error)
{
    const VkAccelerationStructureBuildGeometryInfoKHR *info = &indirect->infos[index];
    const struct limits limits = limits_default();
    const struct place address = place("indirect.addresses[%u]", index),
                       maxima = place("indirect.max_primitive_counts[%u]", index);
    if ((uintptr_t)indirect->addresses[index] % INDIRECT_ALIGNMENT != 0)
        return bvhd_error_rule(error, BVHD_VUID_03648, address.text, "the address is no multiple of 4");
    if (indirect->strides[index] % INDIRECT_ALIGNMENT != 0)
        return bvhd_error_rule(error, BVHD_VUID_03787, place("indirect.strides[%u]", index).text,
                               "%u is no multiple of 4", indirect->strides[index]);
    if (info->geometryCount == 0)
        return BVHD_OK;
    enum bvhd_status status = validate_geometry_count((uint32_t)info->type, info->geometryCount, index, &limits, error);
    if (status == BVHD_OK)
        status = structure_check_argument(indirect->addresses[index], address.text,
                                          BVHD_VUID_Indirect_pIndirectDeviceAddresses_parameter, error);
    if (status == BVHD_OK)
        status = structure_check_argument(indirect->max_primitive_counts[index], maxima.text,
                                          BVHD_VUID_Indirect_ppMaxPrimitiveCounts_parameter, error);
    return status;
}

static enum bvhd_status read_info(const struct bvhd_indirect *indirect, uint32_t index, range_info *ret_ranges,
                                  struct bvhd_error *error)
{
    const unsigned char *at = indirect->addresses[index];
    const uint32_t *maxima = indirect->max_primitive_counts[index];
    for (uint32_t i = 0; i < indirect->infos[index].geometryCount; i++) {
        memcpy(&ret_ranges[i], at + (uint64_t)indirect->strides[index] * i, sizeof *ret_ranges);
        if (ret_ranges[i].primitiveCount > maxima[i])
            return bvhd_error_rule(
                error, BVHD_VUID_03653, place("indirect.max_primitive_counts[%u][%u]", index, i).text,
                "%u primitives were read, and the maximum is %u", ret_ranges[i].primitiveCount, maxima[i]);
    }
    return BVHD_OK;
}

/* Makes one block of the pointers and of the ranges behind them. */
static enum bvhd_status read_all(const struct bvhd_indirect *indirect, const range_info ***ret_pointers,
                                 struct bvhd_error *error)
{
    uint64_t count = 0;
    for (uint32_t i = 0; i < indirect->info_count; i++)
        count += indirect->infos[i].geometryCount;
    const uint64_t size = indirect->info_count * sizeof(range_info *) + count * sizeof(range_info);
    const range_info **pointers = memory_alloc(&library_memory, size + 1);
    if (!pointers)
        return bvhd_error_no_memory(error, "indirect", "no memory for %llu ranges", (unsigned long long)count);
    range_info *ranges = (range_info *)(void *)(pointers + indirect->info_count);
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; status == BVHD_OK && i < indirect->info_count; i++) {
        pointers[i] = ranges;
        status = read_info(indirect, i, ranges, error);
        ranges += indirect->infos[i].geometryCount;
    }
    if (status == BVHD_OK)
        *ret_pointers = pointers;
    else
        memory_free(&library_memory, pointers);
    return status;
}

enum bvhd_status bvhd_indirect_read(const struct bvhd_indirect *indirect,
                                    const VkAccelerationStructureBuildRangeInfoKHR *const **ret_ranges,
                                    struct bvhd_error *ret_error)
{
    const range_info **pointers = NULL;
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {indirect, "indirect"}, {ret_ranges, "ret_ranges"});
    if (status == BVHD_OK)
        status =
            argument_check_size(indirect, sizeof *indirect, sizeof *indirect, "indirect", "bvhd_indirect", ret_error);
    if (status == BVHD_OK && indirect->info_count > 0)
        status = check_arrays(indirect, ret_error);
    for (uint32_t i = 0; status == BVHD_OK && i < indirect->info_count; i++)
        status = check_info(indirect, i, ret_error);
    if (status == BVHD_OK)
        status = read_all(indirect, &pointers, ret_error);
    if (status == BVHD_OK)
        *ret_ranges = pointers;
    return status;
}

void bvhd_indirect_free(const VkAccelerationStructureBuildRangeInfoKHR *const *ranges)
{
    memory_free(&library_memory, (void *)(uintptr_t)ranges);
}
