/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/gpu/probe_source.h"

#include <stdio.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/gpu/gpu.h"

enum { LARGEST_FILE = 16 << 20, WHY_SIZE = 127 /* leaves room in the text for the advice after it */ };

static const char *name_of(enum bvhd_target target)
{
    const char *name = bvhd_target_name(target);
    return name ? name : "unknown";
}

static enum bvhd_status read_file(const struct probe_source *source, struct memory *memory,
                                  struct bvhd_format *ret_format, struct bvhd_error *error)
{
    unsigned char *data = NULL;
    uint64_t size = 0;
    struct bvhd_format format;
    struct bvhd_error inner = {0};
    enum bvhd_status status = files_read(source->file, LARGEST_FILE, memory, &data, &size, error);
    if (status != BVHD_OK)
        return status;
    /* An empty file has no block of bytes, but its error is that of any other file which is not a probe. */
    status = bvhd_format_from_probe(size > 0 ? (const void *)data : "", size, &format, &inner);
    memory_free(memory, data);
    if (status != BVHD_OK)
        return bvhd_error_set(error, status, source->file, "%s%s%s", inner.where, *inner.where ? ": " : "", inner.text);
    if (source->target && (enum bvhd_target)source->target != format.target)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "--target", "the device of %s loads %s structures, not %s",
                              source->file, name_of(format.target), name_of((enum bvhd_target)source->target));
    *ret_format = format;
    return BVHD_OK;
}

enum bvhd_status probe_source_ask(struct gpu *gpu, struct bvhd_format *ret_format, struct bvhd_error *error)
{
    void *probe;
    uint64_t size;
    enum bvhd_status status = bvhd_vulkan_probe(gpu->library, &gpu->queue, &probe, &size, error);
    if (status != BVHD_OK)
        return status;
    status = bvhd_format_from_probe(probe, size, ret_format, error);
    bvhd_vulkan_free(probe);
    return status;
}

static enum bvhd_status probe_device(const struct gpu_properties *properties, enum bvhd_target target,
                                     struct memory *memory, struct bvhd_format *ret_format, struct bvhd_error *error)
{
    struct gpu *gpu;
    struct bvhd_format format;
    if (!properties->has_acceleration_structure)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "", "no acceleration structures");
    enum bvhd_status status = gpu_open(properties->number, memory, &gpu, error);
    if (status != BVHD_OK)
        return status;
    status = probe_source_ask(gpu, &format, error);
    gpu_close(gpu);
    if (status == BVHD_OK && format.target != target)
        status = bvhd_error_set(error, BVHD_UNSUPPORTED, "", "it loads %s", name_of(format.target));
    if (status == BVHD_OK)
        *ret_format = format;
    return status;
}

/* A lack of memory keeps its status, because it says nothing about the devices. */
static enum bvhd_status refuse(enum bvhd_target target, enum bvhd_status status, const char *why,
                               struct bvhd_error *error)
{
    return bvhd_error_set(error, status == BVHD_NO_MEMORY ? status : BVHD_UNSUPPORTED, "--target",
                          "no Vulkan device here loads %s structures (%.*s); use --probe FILE", name_of(target),
                          WHY_SIZE, why);
}

static enum bvhd_status ask_devices(enum bvhd_target target, struct memory *memory, struct bvhd_format *ret_format,
                                    struct bvhd_error *error)
{
    struct gpu_properties *list = NULL;
    uint32_t count = 0;
    struct bvhd_error inner = {0};
    char why[WHY_SIZE + 1] = "there is none";
    enum bvhd_status status = gpu_list(memory, &list, &count, &inner);
    if (status != BVHD_OK)
        return refuse(target, status, inner.text, error);
    status = BVHD_UNSUPPORTED;
    for (uint32_t i = 0; i < count && status != BVHD_OK && status != BVHD_NO_MEMORY; i++) {
        status = probe_device(&list[i], target, memory, ret_format, &inner);
        snprintf(why, sizeof why, "%.50s: %.75s", list[i].name, inner.text);
    }
    memory_free(memory, list);
    return status != BVHD_OK ? refuse(target, status, why, error) : BVHD_OK;
}

enum bvhd_status probe_source_read(const struct probe_source *source, struct memory *memory,
                                   struct bvhd_format *ret_format, struct bvhd_error *error)
{
    if (source->file)
        return read_file(source, memory, ret_format, error);
    return ask_devices((enum bvhd_target)source->target, memory, ret_format, error);
}
