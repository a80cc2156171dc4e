/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan/vulkan_blob.h"

#include <inttypes.h>
#include <stdio.h>

#include "builder/format/lavapipe.h"
#include "builder/format/portable.h"
#include "builder/format/record_kind.h"

/*
 * Where an instance's handle is in the records of a top level, and where the location of its bottom level is stored.
 * Motion instances have room for a location at a multiple of 8 after their first reserved word.
 */
enum {
    LOCATION = offsetof(struct portable_instance, reserved),
    MOVING_LOCATION = offsetof(struct portable_moving_instance, reserved) + sizeof(uint32_t),
};
_Static_assert(LOCATION % 8 == 0 && MOVING_LOCATION % 8 == 0 && PORTABLE_BODY_ALIGNMENT % 8 == 0,
               "a location lies on one side of a cut between portions");
_Static_assert(sizeof(struct portable_instance) % 8 == 0 && sizeof(struct portable_moving_instance) % 8 == 0, "so too");

static const struct vulkan_records instance_records = {
    .size = sizeof(struct portable_instance),
    .handle = offsetof(struct portable_instance, handle),
    .location = LOCATION,
};

static const struct vulkan_records moving_records = {
    .size = sizeof(struct portable_moving_instance),
    .handle = offsetof(struct portable_moving_instance, handle),
    .location = MOVING_LOCATION,
};

/* The newest version of the portable layout that is loaded: structures with micromaps are not. */
enum { LOADED_NEWEST = 2 };

static enum bvhd_status read_portable(struct vulkan_blob *blob, struct bvhd_error *error)
{
    struct portable_header header;
    const uint32_t version = portable_version_of(blob->header.compatibility_uuid);
    if (version == 0 || version > LOADED_NEWEST)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, "header.compatibilityUUID",
                              "a portable structure of version %u, this library loads versions 1 to %d",
                              blob->header.compatibility_uuid[15], LOADED_NEWEST);
    uint64_t offset = portable_body_offset(blob->header.handle_count);
    if (offset > blob->bytes.size || blob->bytes.size - offset < sizeof header)
        return bvhd_error_set(error, BVHD_CORRUPT, "body", "too short");
    blob->body = (struct bytes){blob->bytes.data + offset, blob->bytes.size - offset};
    memcpy(&header, blob->body.data, sizeof header);
    if (blob->header.deserialized_size != blob->body.size || header.body_size != blob->body.size)
        return bvhd_error_set(error, BVHD_CORRUPT, "header.deserializedSize", "not the size of the body");
    blob->target = BVHD_TARGET_PORTABLE;
    blob->type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR;
    if (!record_kind_is_top(header.content))
        return BVHD_OK;
    blob->type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
    blob->record_offset = header.record_offset;
    blob->record_count = header.record_count;
    blob->records = header.content == PORTABLE_MOVING_INSTANCES ? &moving_records : &instance_records;
    if (header.record_offset % 16 != 0 ||
        !bytes_reach(blob->body.size, header.record_offset, blob->records->size, header.record_count, 0))
        return bvhd_error_set(error, BVHD_CORRUPT, "body.recordOffset", "records are misplaced");
    return BVHD_OK;
}

/* A structure without handles is a bottom level, unless it is empty: then its bytes do not reveal its type. */
static VkAccelerationStructureTypeKHR native_type(const struct vulkan_blob *blob)
{
    struct lavapipe_box root;
    if (blob->header.handle_count > 0)
        return VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
    memcpy(&root, blob->body.data + LAVAPIPE_HEADER, sizeof root);
    bool is_empty = root.children[0] == LAVAPIPE_NONE && root.children[1] == LAVAPIPE_NONE;
    return is_empty ? VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR : VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR;
}

static enum bvhd_status read_native(struct vulkan_blob *blob, struct bvhd_error *error)
{
    if (blob->header.micromap_count > 0)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, "header.handleCount", "native structures have no micromaps");
    uint64_t offset = SERIALIZED_HANDLES + 8 * blob->header.handle_count;
    blob->body = (struct bytes){blob->bytes.data + offset, blob->bytes.size - offset};
    if (blob->header.deserialized_size != blob->body.size ||
        blob->body.size < LAVAPIPE_HEADER + sizeof(struct lavapipe_box))
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, "header.deserializedSize",
                              "the shape of no target that this library knows");
    blob->target = BVHD_TARGET_LAVAPIPE;
    blob->type = native_type(blob);
    return BVHD_OK;
}

static enum bvhd_status read_handles(struct vulkan_blob *blob, struct bvhd_error *error)
{
    uint64_t highest = 0;
    for (uint64_t row = 0; row < blob->header.handle_count; row++) {
        uint64_t handle = vulkan_blob_handle(blob, row);
        if (handle == 0 || handle > UINT32_MAX) {
            char where[48];
            snprintf(where, sizeof where, "header.handles[%" PRIu64 "]", row);
            return bvhd_error_set(error, BVHD_CORRUPT, where, "not the row of a reference");
        }
        highest = handle > highest ? handle : highest;
    }
    blob->reference_count = (uint32_t)highest;
    return BVHD_OK;
}

enum bvhd_status vulkan_blob_read(struct bytes bytes, struct vulkan_blob *ret_blob, struct bvhd_error *error)
{
    struct vulkan_blob blob = {.bytes = bytes};
    if (!bytes.data)
        return bvhd_error_set(error, BVHD_INVALID, "data", "there is no structure");
    enum bvhd_status status = serialized_read(bytes, &blob.header, error);
    if (status != BVHD_OK)
        return status;
    if (blob.header.handle_count > UINT32_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "header.handleCount", "more than 32 bits");
    bool is_portable = memcmp(blob.header.driver_uuid, portable_driver_uuid, SERIALIZED_UUID_SIZE) == 0;
    status = is_portable ? read_portable(&blob, error) : read_native(&blob, error);
    if (status == BVHD_OK)
        status = read_handles(&blob, error);
    if (status == BVHD_OK)
        *ret_blob = blob;
    return status;
}

static struct bvhd_vulkan_requirements portable_requirements(const struct bvhd_vulkan_device *device)
{
    uint64_t alignment = device->limits.storage_alignment;
    struct bvhd_vulkan_requirements requirements = {
        .staging_alignment = 16,
        .staging_usage = VK_BUFFER_USAGE_TRANSFER_SRC_BIT,
        .storage_alignment = alignment > PORTABLE_BODY_ALIGNMENT ? alignment : PORTABLE_BODY_ALIGNMENT,
        .storage_usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT,
    };
    if (device->has_addresses)
        requirements.storage_usage |= VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT;
    return requirements;
}

/* Both alignments are required by Vulkan: of the address that is copied from, and of a structure in its buffer. */
static const struct bvhd_vulkan_requirements native_requirements = {
    .staging_alignment = 256,
    .staging_usage = VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT,
    .storage_alignment = 256,
    .storage_usage = VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT,
};

struct bvhd_vulkan_requirements vulkan_blob_requirements(const struct vulkan_blob *blob,
                                                         const struct bvhd_vulkan_device *device)
{
    bool is_portable = blob->target == BVHD_TARGET_PORTABLE;
    struct bvhd_vulkan_requirements requirements = is_portable ? portable_requirements(device) : native_requirements;
    requirements.target = blob->target;
    requirements.type = blob->type;
    requirements.handle_count = (uint32_t)blob->header.handle_count;
    requirements.reference_count = blob->reference_count;
    requirements.staging_size = is_portable ? blob->body.size : blob->bytes.size;
    requirements.storage_size = blob->body.size;
    return requirements;
}

enum bvhd_status vulkan_blob_check_references(const struct vulkan_blob *blob, const uint64_t *references,
                                              uint32_t reference_count, uint64_t none, struct bvhd_error *error)
{
    for (uint64_t row = 0; row < blob->header.handle_count; row++) {
        uint64_t handle = vulkan_blob_handle(blob, row);
        if (handle <= reference_count && references && references[handle - 1] != none)
            continue;
        char where[48];
        snprintf(where, sizeof where, "references[%" PRIu64 "]", handle - 1);
        return bvhd_error_set(error, BVHD_INVALID, where, "an instance names it, but there is no structure");
    }
    return BVHD_OK;
}

void vulkan_blob_fill_native(const struct vulkan_blob *blob, const uint64_t *references, unsigned char *dest)
{
    memcpy(dest, blob->bytes.data, SERIALIZED_HANDLES);
    for (uint64_t row = 0; row < blob->header.handle_count; row++)
        bytes_put64(dest + SERIALIZED_HANDLES + 8 * row, references[vulkan_blob_handle(blob, row) - 1]);
    memcpy(dest + (blob->body.data - blob->bytes.data), blob->body.data, blob->body.size);
}

enum bvhd_status vulkan_blob_fill_portable(const struct vulkan_blob *blob, const uint64_t *references, uint64_t begin,
                                           uint64_t end, unsigned char *dest, struct bvhd_error *error)
{
    memcpy(dest, blob->body.data + begin, end - begin);
    const struct vulkan_records *records = blob->records;
    uint64_t first = records && begin > blob->record_offset ? (begin - blob->record_offset) / records->size : 0;
    for (uint64_t i = first; i < blob->record_count; i++) {
        uint64_t record = blob->record_offset + i * records->size, at = record + records->location;
        if (at >= end)
            break;
        if (at < begin)
            continue;
        uint32_t handle = bytes_get32(blob->body.data + record + records->handle);
        if (handle >= blob->header.handle_count)
            return bvhd_error_set(error, BVHD_CORRUPT, "records", "an instance without a handle");
        bytes_put64(dest + (at - begin), references[vulkan_blob_handle(blob, handle) - 1]);
    }
    return BVHD_OK;
}
