/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_blob.h - reads what a loader has to know about a serialized structure: which of its bytes go to the device,
 * and where in them the loader has to write references to bottom levels. It reads headers and handles alone;
 * bvhd_vulkan_check checks the rest.
 */
#ifndef BVHD_VULKAN_BLOB_H
#define BVHD_VULKAN_BLOB_H

#include <stdbool.h>

#include <bvhd/bvhd_vulkan.h>

#include "proto/base/bytes.h"
#include "builder/format/serialized.h"
#include "client/vulkan/vulkan_device.h"

/* The records of a top level: their size, and where in each of them a loader reads and writes. All in bytes. */
struct vulkan_records {
    uint64_t size, handle, location;
};

/* A serialized structure whose header has been read. It points to the program's bytes. */
struct vulkan_blob {
    struct bytes bytes;
    struct serialized_header header;
    enum bvhd_target target;
    VkAccelerationStructureTypeKHR type; /* as in struct bvhd_vulkan_requirements */
    uint32_t reference_count; /* the highest handle: handle v means references[v - 1] */
    struct bytes body; /* the deserialized_size bytes that are stored on the device */
    uint64_t record_offset; /* portable: offset of the instance records in the body */
    uint32_t record_count; /* portable, top level */
    const struct vulkan_records *records; /* portable, top level; else NULL */
};

/*
 * Reads a hostile blob. Afterwards the functions below stay inside of it. Fails with BVHD_CORRUPT, BVHD_INCOMPATIBLE
 * (it does not have the shape or the version of a known target), BVHD_TOO_LARGE, or BVHD_INVALID if there is no data.
 */
enum bvhd_status vulkan_blob_read(struct bytes bytes, struct vulkan_blob *ret_blob, struct bvhd_error *error);

/* Returns what to create for the structure on the device. */
struct bvhd_vulkan_requirements vulkan_blob_requirements(const struct vulkan_blob *blob,
                                                         const struct bvhd_vulkan_device *device);

/* Returns the handle at position `row` of the blob's table, from 0. A handle is a number from 1 to reference_count. */
static inline uint64_t vulkan_blob_handle(const struct vulkan_blob *blob, uint64_t row)
{
    return bytes_get64(blob->bytes.data + SERIALIZED_HANDLES + 8 * row);
}

/*
 * Checks that each handle v has a reference: v <= reference_count, and references[v - 1] is not `none`, the value that
 * stands for a missing structure. Otherwise it returns BVHD_INVALID with a place such as "references[7]".
 */
enum bvhd_status vulkan_blob_check_references(const struct vulkan_blob *blob, const uint64_t *references,
                                              uint32_t reference_count, uint64_t none, struct bvhd_error *error);

/*
 * Writes the bytes from which a native structure is deserialized: the whole blob, with references in place of handles.
 */
void vulkan_blob_fill_native(const struct vulkan_blob *blob, const uint64_t *references, unsigned char *dest);

/*
 * Writes bytes [begin, end) of a portable body, with references in the instances. Both are multiples of 64, except for
 * the body's end. Returns BVHD_CORRUPT if an instance has no handle.
 */
enum bvhd_status vulkan_blob_fill_portable(const struct vulkan_blob *blob, const uint64_t *references, uint64_t begin,
                                           uint64_t end, unsigned char *dest, struct bvhd_error *error);

#endif
