/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_meshopt.h"

#include <meshoptimizer.h>
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/scene/gltf_buffer.h"

/* The most bytes that one compressed byte can become: the codec of vertices spends 2 bits on 16 equal bytes. */
enum { MOST_GAIN = 64 };

enum meshopt_mode { MODE_ATTRIBUTES, MODE_TRIANGLES, MODE_INDICES };
enum filter { FILTER_NONE, FILTER_OCTAHEDRAL, FILTER_QUATERNION, FILTER_EXPONENTIAL };

struct compressed_view {
    struct bytes bytes;
    uint64_t count, stride;
    uint32_t mode, filter;
};

/* Reads a member that is one of some names, or `fallback` if there is none. */
static enum bvhd_status read_name(const struct gltf_file *file, const struct gltf_value *object, const char *member,
                                  const char *const *names, uint32_t count, const char *fallback, uint32_t *ret_number)
{
    struct gltf_value value = gltf_member(object, member);
    const char *text = value.json ? gltf_text(object, member) : fallback;
    for (*ret_number = 0; text && *ret_number < count; ++*ret_number)
        if (!strcmp(text, names[*ret_number]))
            return BVHD_OK;
    return gltf_refuse(file, BVHD_UNSUPPORTED, &value, "'%.40s' is not known", text ? text : "");
}

static enum bvhd_status check_stride(const struct gltf_file *file, const struct gltf_value *compressed,
                                     const struct compressed_view *view)
{
    bool ok = view->mode == MODE_ATTRIBUTES ? view->stride % 4 == 0 : view->stride == 2 || view->stride == 4;
    if (view->filter == FILTER_OCTAHEDRAL)
        ok &= view->stride == 4 || view->stride == 8;
    else if (view->filter == FILTER_QUATERNION)
        ok &= view->stride == 8;
    struct gltf_value place = gltf_member(compressed, "byteStride");
    if (!ok)
        return gltf_refuse(file, BVHD_INVALID, &place, "%u does not go with the mode and the filter",
                           (unsigned)view->stride);
    place = gltf_member(compressed, "filter");
    if (view->filter != FILTER_NONE && view->mode != MODE_ATTRIBUTES)
        return gltf_refuse(file, BVHD_INVALID, &place, "only ATTRIBUTES have one");
    return BVHD_OK;
}

static enum bvhd_status check_count(const struct gltf_file *file, const struct gltf_value *view,
                                    const struct gltf_value *compressed, const struct compressed_view *source)
{
    struct gltf_value place = gltf_member(compressed, "count");
    if (source->mode == MODE_TRIANGLES && source->count % 3)
        return gltf_refuse(file, BVHD_INVALID, &place, "not a multiple of 3");
    if (source->count * source->stride / MOST_GAIN > source->bytes.size)
        return gltf_refuse(file, BVHD_INVALID, &place, "%llu elements do not come from %llu bytes",
                           (unsigned long long)source->count, (unsigned long long)source->bytes.size);
    uint64_t length;
    enum bvhd_status status =
        gltf_integer(file, view, "byteLength", (struct gltf_range){0, UINT32_MAX * UINT64_C(256), true, 0}, &length);
    place = gltf_member(view, "byteLength");
    if (!status && length != source->count * source->stride)
        return gltf_refuse(file, BVHD_INVALID, &place, "not the number of bytes that the compressed view has");
    return status;
}

static enum bvhd_status read_view(struct gltf_file *file, const struct gltf_value *view,
                                  const struct gltf_value *compressed, struct compressed_view *ret_view)
{
    static const char *const modes[] = {"ATTRIBUTES", "TRIANGLES", "INDICES"};
    static const char *const filters[] = {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"};
    enum bvhd_status status = gltf_buffer_part(file, compressed, &ret_view->bytes);
    if (!status)
        status = gltf_integer(file, compressed, "byteStride", (struct gltf_range){2, 256, true, 0}, &ret_view->stride);
    if (!status)
        status = gltf_integer(file, compressed, "count", (struct gltf_range){0, UINT32_MAX, true, 0}, &ret_view->count);
    if (!status)
        status = read_name(file, compressed, "mode", modes, 3, NULL, &ret_view->mode);
    if (!status)
        status = read_name(file, compressed, "filter", filters, 4, "NONE", &ret_view->filter);
    if (!status)
        status = check_stride(file, compressed, ret_view);
    return status ? status : check_count(file, view, compressed, ret_view);
}

static int decode(const struct compressed_view *view, unsigned char *data)
{
    const struct bytes *bytes = &view->bytes;
    switch ((enum meshopt_mode)view->mode) {
    case MODE_TRIANGLES:
        return meshopt_decodeIndexBuffer(data, view->count, view->stride, bytes->data, bytes->size);
    case MODE_INDICES:
        return meshopt_decodeIndexSequence(data, view->count, view->stride, bytes->data, bytes->size);
    default:
        return meshopt_decodeVertexBuffer(data, view->count, view->stride, bytes->data, bytes->size);
    }
}

static void apply_filter(const struct compressed_view *view, unsigned char *data)
{
    if (view->filter == FILTER_OCTAHEDRAL)
        meshopt_decodeFilterOct(data, view->count, view->stride);
    else if (view->filter == FILTER_QUATERNION)
        meshopt_decodeFilterQuat(data, view->count, view->stride);
    else if (view->filter == FILTER_EXPONENTIAL)
        meshopt_decodeFilterExp(data, view->count, view->stride);
}

/*
 * Says why bytes were not decoded. Their first byte has the codec above and its version below; the versions that this
 * library knows are those of its own encoders.
 */
static enum bvhd_status refuse(const struct gltf_file *file, const struct gltf_value *compressed,
                               const struct compressed_view *view)
{
    static const unsigned newest[] = {
        [MODE_ATTRIBUTES] = MESHOPTIMIZER_VERSION >= 230, [MODE_TRIANGLES] = 1, [MODE_INDICES] = 1};
    unsigned version = view->bytes.size ? view->bytes.data[0] & 0x0fu : 0;
    if (version <= newest[view->mode])
        return gltf_refuse(file, BVHD_INVALID, compressed, "meshoptimizer cannot decode it");
    return gltf_refuse(file, BVHD_UNSUPPORTED, compressed,
                       "version %u of its codec, which libmeshoptimizer %d.%d does not decode; version 1 of ATTRIBUTES "
                       "needs 0.23",
                       version, MESHOPTIMIZER_VERSION / 1000, MESHOPTIMIZER_VERSION / 10 % 100);
}

enum bvhd_status gltf_meshopt_decode(struct gltf_file *file, const struct gltf_value *view,
                                     const struct gltf_value *compressed, struct gltf_bytes *ret_bytes)
{
    struct compressed_view source = {0};
    enum bvhd_status status = read_view(file, view, compressed, &source);
    if (status)
        return status;
    uint64_t size = source.count * source.stride;
    unsigned char *data = memory_alloc(file->memory, size + 1);
    if (!data)
        return gltf_no_memory(file);
    if (source.count && decode(&source, data)) {
        memory_free(file->memory, data);
        return refuse(file, compressed, &source);
    }
    if (source.count)
        apply_filter(&source, data);
    ret_bytes->owned = data;
    ret_bytes->bytes = (struct bytes){data, size};
    return BVHD_OK;
}
