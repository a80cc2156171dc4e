/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_blob.h - what a loader has to know of a serialized structure: where its bytes go, and where places lie that it
 * fills. Reads heads and handles alone; whether the rest is sound is bvhd_vulkan_check's question.
 */
#ifndef BVHD_VULKAN_BLOB_H
#define BVHD_VULKAN_BLOB_H

#include <stdbool.h>

#include <bvhd/bvhd_vulkan.h>

#include "proto/base/bytes.h"
#include "builder/format/serialized.h"
#include "client/vulkan/vulkan_device.h"

struct vulkan_blob {
    struct bytes bytes;
    struct serialized_header header;
    enum bvhd_target target;
    VkAccelerationStructureTypeKHR type; /* as in struct bvhd_vulkan_requirements */
    uint32_t reference_count; /* the highest handle: handle v stands for references[v - 1] */
    struct bytes body; /* what lies on the device: deserialized_size bytes */
    uint64_t record_offset; /* portable: instance records, from the body's start */
    uint32_t record_count; /* portable, top level */
};

/*
 * Of a hostile blob: afterwards the functions below stay inside of it. BVHD_CORRUPT; BVHD_INCOMPATIBLE, when it has the
 * shape of no known target, or the version of none; BVHD_TOO_LARGE.
 */
enum bvhd_status vulkan_blob_read(struct bytes bytes, struct vulkan_blob *ret_blob, struct bvhd_error *error);

/* What to create for it on the device. */
struct bvhd_vulkan_requirements vulkan_blob_requirements(const struct vulkan_blob *blob,
                                                         const struct bvhd_vulkan_device *device);

/* Handle `row`, from 1. */
static inline uint64_t vulkan_blob_handle(const struct vulkan_blob *blob, uint64_t row)
{
    return bytes_get64(blob->bytes.data + SERIALIZED_HANDLES + 8 * row);
}

/* Every row that a handle names has a reference that is not `none`: BVHD_INVALID, "references[7]". */
enum bvhd_status vulkan_blob_check_references(const struct vulkan_blob *blob, const uint64_t *references,
                                              uint32_t reference_count, uint64_t none, struct bvhd_error *error);

/*
 * Writes what native structures are deserialized from: the whole blob, with references for handles.
 */
void vulkan_blob_fill_native(const struct vulkan_blob *blob, const uint64_t *references, unsigned char *dest);

/*
 * Writes bytes [begin, end) of a portable body, multiples of 64 but for the body's end, with references in the
 * instances. BVHD_CORRUPT when an instance has no handle.
 */
enum bvhd_status vulkan_blob_fill_portable(const struct vulkan_blob *blob, const uint64_t *references, uint64_t begin,
                                           uint64_t end, unsigned char *dest, struct bvhd_error *error);

#endif
