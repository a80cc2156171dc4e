/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>

#include "builder/format/lavapipe.h"
#include "builder/format/portable.h"
#include "builder/format/record_kind.h"
#include "builder/format/serialized.h"
#include "client/library.h"
#include "client/structure/structure.h"

static bool is_portable(const uint8_t uuids[2 * VK_UUID_SIZE])
{
    return memcmp(uuids, portable_driver_uuid, VK_UUID_SIZE) == 0;
}

bool structure_is_compatible(const uint8_t uuids[2 * VK_UUID_SIZE], const struct bvhd_format *format)
{
    if (is_portable(uuids))
        return portable_version_of(uuids + VK_UUID_SIZE) > 0;
    return format && memcmp(uuids, format->driver_uuid, VK_UUID_SIZE) == 0 &&
           memcmp(uuids + VK_UUID_SIZE, format->compatibility_uuid, VK_UUID_SIZE) == 0;
}

static enum bvhd_status read_portable(struct bytes bytes, struct structure_contents *contents, struct bvhd_error *error)
{
    struct portable_view view;
    enum bvhd_status status = portable_open(bytes, &library_memory, &view, error);
    if (status != BVHD_OK)
        return status;
    contents->target = TARGET_PORTABLE;
    contents->type = record_kind_is_top(view.header->content) ? STRUCTURE_TOP : STRUCTURE_BOTTOM;
    contents->flags = view.header->build_flags;
    if (view.header->content == PORTABLE_MOVING_INSTANCES)
        contents->motion_instances = view.header->primitive_count;
    contents->layout_flags = record_kind_of(view.header->content)->layout_flag;
    if (!(contents->flags & BUILD_ALLOW_DATA_ACCESS))
        return BVHD_OK;
    return positions_of_portable(bytes, &view, &library_memory, &contents->positions, error);
}

/* An empty structure may be of either type. */
static enum bvhd_status read_native(struct bytes bytes, struct structure_contents *contents, struct bvhd_error *error)
{
    struct lavapipe_view view;
    enum bvhd_status status = lavapipe_open_any(bytes, &library_memory, &view, error);
    if (status != BVHD_OK)
        return status;
    contents->target = TARGET_LAVAPIPE;
    contents->flags = 0;
    contents->type = view.handle_count > 0  ? STRUCTURE_TOP
                     : view.leaf_count == 0 ? STRUCTURE_GENERIC
                                            : STRUCTURE_BOTTOM;
    return positions_of_lavapipe(bytes, &view, &library_memory, &contents->positions, error);
}

enum bvhd_status structure_read(struct bvhd_blob *blob, struct structure_contents *ret_contents,
                                struct bvhd_error *error)
{
    const struct bytes bytes = {bvhd_blob_data(blob), bvhd_blob_size(blob)};
    struct serialized_header header;
    struct structure_contents contents = {.blob = blob};
    enum bvhd_status status = serialized_read(bytes, &header, error);
    if (status == BVHD_OK)
        status =
            is_portable(bytes.data) ? read_portable(bytes, &contents, error) : read_native(bytes, &contents, error);
    if (status != BVHD_OK)
        return status;
    contents.body_size = header.deserialized_size;
    contents.handle_count = header.handle_count;
    contents.body_offset = portable_body_of(&header);
    *ret_contents = contents;
    return BVHD_OK;
}
