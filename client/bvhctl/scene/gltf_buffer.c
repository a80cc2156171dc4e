/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_buffer.h"

#include <stdio.h>
#include <string.h>

#include "client/bvhctl/scene/gltf_meshopt.h"
#include "client/bvhctl/scene/gltf_uri.h"

static const uint64_t most_bytes = UINT64_C(1) << 40; /* of a buffer */

/* Loads what the URI of a buffer names. */
static enum bvhd_status load_uri(struct gltf_file *file, const struct gltf_value *buffer, const char *uri,
                                 struct gltf_bytes *bytes)
{
    struct gltf_value place = gltf_member(buffer, "uri");
    uint64_t size = 0;
    enum gltf_uri_kind kind = gltf_uri_kind(uri);
    if (kind == GLTF_URI_REMOTE)
        return gltf_refuse(file, BVHD_UNSUPPORTED, &place, "only files and data: URIs are read, not '%.60s'", uri);
    if (kind == GLTF_URI_DATA) {
        enum bvhd_status status = gltf_uri_decode(uri, file->memory, &bytes->owned, &size);
        if (status)
            return status == BVHD_NO_MEMORY ? gltf_no_memory(file)
                                            : gltf_refuse(file, status, &place, "not a data: URI with base64");
    } else {
        char *path = gltf_uri_path(file->path, uri, file->memory);
        if (!path)
            return gltf_no_memory(file);
        enum bvhd_status status = import_files_map(file->files, path, &bytes->mapped, file->error);
        memory_free(file->memory, path);
        bytes->bytes = bytes->mapped;
        return status;
    }
    bytes->bytes = (struct bytes){bytes->owned, size};
    return BVHD_OK;
}

static enum bvhd_status load_buffer(struct gltf_file *file, uint32_t index, struct gltf_bytes *bytes)
{
    struct gltf_value buffer = gltf_item(file, GLTF_BUFFERS, index), place = gltf_member(&buffer, "byteLength");
    struct gltf_value uri = gltf_member(&buffer, "uri");
    uint64_t size;
    enum bvhd_status status =
        gltf_integer(file, &buffer, "byteLength", (struct gltf_range){0, most_bytes, true, 0}, &size);
    if (status)
        return status;
    if (uri.json && !cJSON_IsString(uri.json))
        return gltf_refuse(file, BVHD_INVALID, &uri, "not a text");
    if (uri.json)
        status = load_uri(file, &buffer, uri.json->valuestring, bytes);
    else if (index == 0 && file->has_bin)
        bytes->bytes = file->bin;
    else
        return gltf_refuse(file, BVHD_INVALID, &uri, "missing, and there is no BIN chunk for this buffer");
    if (status)
        return status;
    if (bytes->bytes.size < size)
        return gltf_refuse(file, BVHD_INVALID, &place, "%llu bytes, but only %llu are there", (unsigned long long)size,
                           (unsigned long long)bytes->bytes.size);
    bytes->bytes.size = size;
    return BVHD_OK;
}

enum bvhd_status gltf_buffer(struct gltf_file *file, uint32_t index, struct bytes *ret_bytes)
{
    struct gltf_bytes *bytes = &file->buffers[index];
    enum bvhd_status status = bytes->is_loaded ? BVHD_OK : load_buffer(file, index, bytes);
    bytes->is_loaded = !status;
    *ret_bytes = bytes->bytes;
    return status;
}

enum bvhd_status gltf_buffer_part(struct gltf_file *file, const struct gltf_value *object, struct bytes *ret_bytes)
{
    uint32_t index = 0;
    bool found;
    uint64_t offset = 0, size = 0;
    struct bytes bytes = {0};
    enum bvhd_status status = gltf_reference(file, object, "buffer", GLTF_BUFFERS, &index, &found);
    if (!status && !found) {
        struct gltf_value place = gltf_member(object, "buffer");
        return gltf_refuse(file, BVHD_INVALID, &place, "missing");
    }
    if (!status)
        status = gltf_integer(file, object, "byteOffset", (struct gltf_range){0, most_bytes, false, 0}, &offset);
    if (!status)
        status = gltf_integer(file, object, "byteLength", (struct gltf_range){0, most_bytes, true, 0}, &size);
    if (!status)
        status = gltf_buffer(file, index, &bytes);
    if (status)
        return status;
    if (!bytes_reach(bytes.size, offset, 0, 0, size)) {
        struct gltf_value place = gltf_member(object, "byteLength");
        return gltf_refuse(file, BVHD_INVALID, &place, "from %llu on %llu bytes, but buffers[%u] has %llu",
                           (unsigned long long)offset, (unsigned long long)size, index, (unsigned long long)bytes.size);
    }
    *ret_bytes = (struct bytes){size ? bytes.data + offset : NULL, size};
    return BVHD_OK;
}

enum { LONGEST_STRIDE = 252 };

enum bvhd_status gltf_buffer_view(struct gltf_file *file, uint32_t index, struct gltf_view *ret_view)
{
    struct gltf_value view = gltf_item(file, GLTF_BUFFER_VIEWS, index), extensions, compressed;
    struct gltf_bytes *decoded = &file->views[index];
    uint64_t stride = 0, offset = 0;
    enum bvhd_status status =
        gltf_integer(file, &view, "byteStride", (struct gltf_range){1, LONGEST_STRIDE, false, 0}, &stride);
    if (!status)
        status = gltf_integer(file, &view, "byteOffset", (struct gltf_range){0, most_bytes, false, 0}, &offset);
    *ret_view = (struct gltf_view){.stride = (uint32_t)stride, .offset = offset};
    compressed = gltf_extension(&view, "EXT_meshopt_compression", &extensions);
    if (!compressed.json)
        compressed = gltf_extension(&view, "KHR_meshopt_compression", &extensions);
    if (status || !compressed.json)
        return status ? status : gltf_buffer_part(file, &view, &ret_view->bytes);
    if (!decoded->is_loaded)
        status = gltf_meshopt_decode(file, &view, &compressed, decoded);
    decoded->is_loaded = !status;
    ret_view->bytes = decoded->bytes;
    ret_view->offset = 0;
    return status;
}
