/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/built.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/manifest.h"
#include "client/bvhctl/scene/output.h"

static const uint64_t manifest_limit = UINT64_C(1) << 34, file_limit = UINT64_C(1) << 40;

struct built_name {
    const char *file;
    uint32_t row;
};

static int compare_names(const void *a, const void *b)
{
    const struct built_name *x = a, *y = b;
    int order = strcmp(x->file, y->file);
    return order ? order : (x->row > y->row) - (x->row < y->row);
}

static bool sort_names(struct built *built)
{
    uint32_t count = built->container.count;
    built->names = memory_array(built->memory, (uint64_t)count + 1, sizeof *built->names);
    if (!built->names)
        return false;
    for (uint32_t i = 0; i < count; i++)
        built->names[i] = (struct built_name){container_structure(&built->container, i).file, i};
    qsort(built->names, count, sizeof *built->names, compare_names);
    return true;
}

/* Puts the file's name before the place in it. */
static enum bvhd_status in_file(const char *path, enum bvhd_status status, const struct bvhd_error *inner,
                                struct bvhd_error *error)
{
    char where[BVHD_WHERE_SIZE + 64];
    snprintf(where, sizeof where, "%.60s: %s", path, inner->where);
    return bvhd_error_set(error, status, where, "%s", inner->text);
}

bool built_is_container(const char *path)
{
    struct stat about;
    unsigned char start[8] = {0};
    if (stat(path, &about) != 0 || !S_ISREG(about.st_mode))
        return false;
    FILE *file = fopen(path, "rb");
    size_t got = file ? fread(start, 1, sizeof start, file) : 0;
    if (file)
        fclose(file);
    return output_is_container(path) || container_is((struct bytes){start, got});
}

static enum bvhd_status open_container(struct built *built, struct bvhd_error *error)
{
    static const unsigned char nothing[CONTAINER_ALIGN] __attribute__((aligned(CONTAINER_ALIGN)));
    uint64_t size;
    struct bvhd_error inner;
    enum bvhd_status status = files_read(built->path, file_limit, built->memory, &built->data, &size, error);
    if (status != BVHD_OK)
        return status;
    struct bytes file = {built->data ? built->data : nothing, size};
    if (!container_is(file) && !output_is_container(built->path))
        return bvhd_error_set(error, BVHD_IO, built->path, "neither a directory nor a container of structures");
    status = container_open(file, &built->container, &inner);
    if (status != BVHD_OK)
        return in_file(built->path, status, &inner, error);
    return sort_names(built) ? BVHD_OK : bvhd_error_no_memory(error, built->path, "no memory to open it");
}

enum bvhd_status built_open(const char *path, struct memory *memory, struct built *ret_built, struct bvhd_error *error)
{
    struct stat about;
    struct built built = {.path = path, .memory = memory};
    built.is_container = stat(path, &about) == 0 && S_ISREG(about.st_mode);
    enum bvhd_status status = built.is_container ? open_container(&built, error) : BVHD_OK;
    if (status != BVHD_OK)
        built_close(&built);
    else
        *ret_built = built;
    return status;
}

void built_close(struct built *built)
{
    if (!built || !built->memory)
        return;
    memory_free(built->memory, built->names);
    memory_free(built->memory, built->data);
    *built = (struct built){0};
}

static enum bvhd_status read_file(const struct built *built, const char *file, uint64_t limit,
                                  struct built_bytes *ret_bytes, struct bvhd_error *error)
{
    static const unsigned char nothing[CONTAINER_ALIGN] __attribute__((aligned(CONTAINER_ALIGN)));
    struct built_bytes bytes = {0};
    char *path = files_join(built->memory, built->path, file);
    if (!path)
        return bvhd_error_no_memory(error, file, "no memory for its path");
    enum bvhd_status status = files_read(path, limit, built->memory, &bytes.owned, &bytes.bytes.size, error);
    memory_free(built->memory, path);
    if (status != BVHD_OK)
        return status;
    bytes.bytes.data = bytes.owned ? bytes.owned : nothing;
    *ret_bytes = bytes;
    return BVHD_OK;
}

enum bvhd_status built_manifest(const struct built *built, struct built_bytes *ret_manifest, char *ret_where,
                                struct bvhd_error *error)
{
    snprintf(ret_where, BVHD_WHERE_SIZE, "%s%s%s", built->path, built->is_container ? ": " : "/", MANIFEST_NAME);
    if (!built->is_container)
        return read_file(built, MANIFEST_NAME, manifest_limit, ret_manifest, error);
    *ret_manifest = (struct built_bytes){built->container.manifest, NULL};
    return BVHD_OK;
}

enum bvhd_status built_read(const struct built *built, const char *file, struct built_bytes *ret_bytes,
                            struct bvhd_error *error)
{
    if (!built->is_container)
        return read_file(built, file, file_limit, ret_bytes, error);
    uint32_t low = 0, high = built->container.count;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (strcmp(built->names[middle].file, file) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    if (low == built->container.count || strcmp(built->names[low].file, file) != 0)
        return bvhd_error_set(error, BVHD_CORRUPT, built->path, "it has no structure '%s', which its manifest names",
                              file);
    struct bvhd_error inner;
    enum bvhd_status status = container_check(&built->container, built->names[low].row, &inner);
    if (status != BVHD_OK)
        return in_file(file, status, &inner, error);
    *ret_bytes = (struct built_bytes){container_structure(&built->container, built->names[low].row).blob, NULL};
    return BVHD_OK;
}
