/* SPDX-License-Identifier: Apache-2.0 */
#include <ctype.h>
#include <inttypes.h>
#include <stdio.h>

#include "builder/format/lavapipe.h"
#include "client/argument.h"
#include "client/library.h"
#include "builder/format/portable.h"
#include "client/vulkan/vulkan_blob.h"
#include "client/vulkan/vulkan_device.h"

struct check {
    const struct bvhd_vulkan_device *device;
    const struct bvhd_format *format; /* may be NULL */
    struct vulkan_blob blob;
    struct bvhd_error *error;
};

enum { UUID_TEXT = 2 * SERIALIZED_UUID_SIZE + 1 };

/* Some drivers write a readable version there; otherwise the text is hexadecimal. */
static void uuid_to_text(const uint8_t uuid[SERIALIZED_UUID_SIZE], char ret_text[UUID_TEXT])
{
    int length = 0;
    while (length < SERIALIZED_UUID_SIZE && uuid[length] < 0x80 && isgraph(uuid[length]))
        length++;
    if (length == SERIALIZED_UUID_SIZE)
        snprintf(ret_text, UUID_TEXT, "%.*s", length, (const char *)uuid);
    else
        for (int i = 0; i < SERIALIZED_UUID_SIZE; i++)
            snprintf(ret_text + 2 * i, 3, "%02x", uuid[i]);
}

static const char *target_name(enum bvhd_target target)
{
    const char *name = bvhd_target_name(target);
    return name ? name : "an unknown one";
}

/* ---- Portable structures ---- */

/* Shaders that use addresses find the words of a structure with signed 32-bit indices. */
static const uint64_t reach_of_addresses = UINT64_C(4) << 31;

static enum bvhd_status check_portable(const struct check *check)
{
    struct portable_view view;
    uint64_t size = check->blob.body.size, range = check->device->limits.storage_range;
    if (check->device->has_addresses && size > reach_of_addresses)
        return bvhd_error_set(check->error, BVHD_TOO_LARGE, "data",
                              "%" PRIu64 " bytes, shaders reach %" PRIu64 " of a structure", size, reach_of_addresses);
    if (!check->device->has_addresses && size > range)
        return bvhd_error_set(check->error, BVHD_TOO_LARGE, "data",
                              "%" PRIu64 " bytes, a shader of this device sees %" PRIu64
                              " at once, and it has no buffer addresses",
                              size, range);
    return portable_open(check->blob.bytes, &library_memory, &view, check->error);
}

/* ---- Native structures ---- */

static enum bvhd_status incompatible(const struct check *check)
{
    char needed[UUID_TEXT], found[UUID_TEXT];
    struct lavapipe_view view;
    bool is_known = lavapipe_open_any(check->blob.bytes, &library_memory, &view, NULL) == BVHD_OK;
    bool same_driver = memcmp(check->blob.header.driver_uuid, check->format->driver_uuid, SERIALIZED_UUID_SIZE) == 0;
    uuid_to_text(same_driver ? check->blob.header.compatibility_uuid : check->blob.header.driver_uuid, found);
    uuid_to_text(same_driver ? check->format->compatibility_uuid : check->format->driver_uuid, needed);
    return bvhd_error_set(check->error, BVHD_INCOMPATIBLE,
                          same_driver ? "header.compatibilityUUID" : "header.driverUUID",
                          "for target %s, driver %s; this device needs target %s, driver %s, or portable",
                          is_known ? "lavapipe" : "unknown", found, target_name(check->format->target), needed);
}

/* Two versions of a driver can have the same UUIDs. */
static enum bvhd_status other_variant(const struct check *check, const struct lavapipe_view *view)
{
    return bvhd_error_set(check->error, BVHD_INCOMPATIBLE, "format.variant",
                          "for target lavapipe in its variant %d; this device needs target %s in variant %" PRIu32
                          ", or portable",
                          (int)view->device.variant, target_name(check->format->target), check->format->variant);
}

/* Asks the driver about the first bytes: a format may belong to another device, or date from before a driver update. */
static enum bvhd_status ask_driver(const struct check *check)
{
    const struct bvhd_vulkan_device *device = check->device;
    const VkAccelerationStructureVersionInfoKHR version = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_VERSION_INFO_KHR, .pVersionData = check->blob.bytes.data};
    VkAccelerationStructureCompatibilityKHR answer = VK_ACCELERATION_STRUCTURE_COMPATIBILITY_INCOMPATIBLE_KHR;
    char found[UUID_TEXT];
    device->vk.GetDeviceAccelerationStructureCompatibilityKHR(device->handle, &version, &answer);
    if (answer == VK_ACCELERATION_STRUCTURE_COMPATIBILITY_COMPATIBLE_KHR)
        return BVHD_OK;
    uuid_to_text(check->blob.header.driver_uuid, found);
    return bvhd_error_set(check->error, BVHD_INCOMPATIBLE, "format",
                          "the device is of another driver than %s: probe it again", found);
}

static enum bvhd_status check_native_limits(const struct check *check, const struct lavapipe_view *view)
{
    const struct vulkan_limits *limits = &check->device->limits;
    bool is_top = view->handle_count > 0;
    uint64_t count = is_top ? view->handle_count : view->leaf_count,
             most = is_top ? limits->instances : limits->primitives;
    if (count > most)
        return bvhd_error_set(check->error, BVHD_TOO_LARGE, "data", "%" PRIu64 " %s, the device takes %" PRIu64, count,
                              is_top ? "instances" : "primitives", most);
    return BVHD_OK;
}

static enum bvhd_status check_native(const struct check *check)
{
    const struct serialized_header *header = &check->blob.header;
    const struct bvhd_format *format = check->format;
    struct lavapipe_view view;
    if (!check->device->has_structures)
        return bvhd_error_set(
            check->error, BVHD_UNSUPPORTED, "header.driverUUID",
            "a native structure, but this device has no acceleration structures: it needs target portable");
    if (!format)
        return bvhd_error_set(check->error, BVHD_INVALID, "format",
                              "a native structure needs the format that the device's probe gave");
    if (memcmp(header->driver_uuid, format->driver_uuid, SERIALIZED_UUID_SIZE) != 0 ||
        memcmp(header->compatibility_uuid, format->compatibility_uuid, SERIALIZED_UUID_SIZE) != 0)
        return incompatible(check);
    enum bvhd_status status = ask_driver(check);
    if (status != BVHD_OK)
        return status;
    status =
        lavapipe_open(check->blob.bytes, (enum lavapipe_variant)format->variant, &library_memory, &view, check->error);
    if ((status == BVHD_CORRUPT || status == BVHD_INCOMPATIBLE) &&
        lavapipe_open_any(check->blob.bytes, &library_memory, &view, NULL) == BVHD_OK &&
        view.device.variant != format->variant)
        return other_variant(check, &view);
    return status == BVHD_OK ? check_native_limits(check, &view) : status;
}

static enum bvhd_status check_format(const struct bvhd_format *format, struct bvhd_error *error)
{
    if (!format)
        return BVHD_OK;
    enum bvhd_status status =
        argument_check_size(format, sizeof *format, sizeof *format, "format", "bvhd_format", error);
    if (status != BVHD_OK)
        return status;
    if (format->target == BVHD_TARGET_LAVAPIPE && (format->variant == 0 || format->variant > LAVAPIPE_VARIANTS))
        return bvhd_error_set(error, BVHD_INVALID, "format", "variant %" PRIu32 " of target lavapipe is not known",
                              format->variant);
    return BVHD_OK;
}

static enum bvhd_status check_size(const struct check *check)
{
    const struct vulkan_limits *limits = &check->device->limits;
    uint64_t limit = limits->buffer < limits->allocation ? limits->buffer : limits->allocation;
    if (check->blob.bytes.size > limit)
        return bvhd_error_set(check->error, BVHD_TOO_LARGE, "data",
                              "%" PRIu64 " bytes, the device has buffers of at most %" PRIu64, check->blob.bytes.size,
                              limit);
    return BVHD_OK;
}

enum bvhd_status bvhd_vulkan_check(struct bvhd_vulkan_device *device, const struct bvhd_format *format,
                                   const void *data, uint64_t size, struct bvhd_error *ret_error)
{
    struct check check = {.device = device, .format = format, .error = ret_error};
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {device, "device"}, {data, "data"});
    if (status == BVHD_OK)
        status = check_format(format, ret_error);
    if (status == BVHD_OK && (uintptr_t)data % 16 != 0)
        status = bvhd_error_set(ret_error, BVHD_INVALID, "data", "its address is no multiple of 16 bytes");
    if (status == BVHD_OK)
        status = vulkan_blob_read((struct bytes){data, size}, &check.blob, ret_error);
    if (status == BVHD_OK)
        status = check_size(&check);
    if (status != BVHD_OK)
        return status;
    return check.blob.target == BVHD_TARGET_PORTABLE ? check_portable(&check) : check_native(&check);
}

enum bvhd_status bvhd_vulkan_requirements(struct bvhd_vulkan_device *device, const void *data, uint64_t size,
                                          struct bvhd_vulkan_requirements *ret_requirements,
                                          struct bvhd_error *ret_error)
{
    struct vulkan_blob blob;
    enum bvhd_status status =
        ARGUMENTS_CHECK(ret_error, {device, "device"}, {data, "data"}, {ret_requirements, "ret_requirements"});
    if (status == BVHD_OK)
        status = vulkan_blob_read((struct bytes){data, size}, &blob, ret_error);
    if (status == BVHD_OK)
        *ret_requirements = vulkan_blob_requirements(&blob, device);
    return status;
}
