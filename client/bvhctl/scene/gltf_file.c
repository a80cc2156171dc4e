/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_file.h"

#include <stdio.h>
#include <string.h>

#include "client/bvhctl/scene/gltf_json.h"

enum { GLB_HEADER = 12, CHUNK_HEADER = 8, GLB_VERSION = 2 };
enum { GLB_MAGIC = 0x46546c67, CHUNK_JSON = 0x4e4f534a, CHUNK_BIN = 0x004e4942 };

const char *gltf_list_text(enum gltf_list_name list)
{
    static const char *const names[GLTF_LISTS] = {
        [GLTF_ACCESSORS] = "accessors", [GLTF_ANIMATIONS] = "animations", [GLTF_BUFFER_VIEWS] = "bufferViews",
        [GLTF_BUFFERS] = "buffers",     [GLTF_MATERIALS] = "materials",   [GLTF_MESHES] = "meshes",
        [GLTF_NODES] = "nodes",         [GLTF_SCENES] = "scenes",         [GLTF_SKINS] = "skins"};
    return names[list];
}

/* Returns the next chunk of a GLB and moves *at behind it. The text of an error names the chunk. */
static enum bvhd_status take_chunk(const struct gltf_file *file, uint64_t end, const char *name, uint64_t *at,
                                   uint32_t *ret_kind, struct bytes *ret_chunk)
{
    if (end - *at < CHUNK_HEADER)
        return gltf_refuse(file, BVHD_UNSUPPORTED, NULL, "GLB: the %s chunk is cut off", name);
    uint32_t size = bytes_get32(file->data.data + *at);
    *ret_kind = bytes_get32(file->data.data + *at + 4);
    *at += CHUNK_HEADER;
    if (size > end - *at)
        return gltf_refuse(file, BVHD_UNSUPPORTED, NULL, "GLB: the %s chunk has %u bytes, but only %llu follow", name,
                           size, (unsigned long long)(end - *at));
    *ret_chunk = (struct bytes){file->data.data + *at, size};
    *at += size;
    return BVHD_OK;
}

/* Counts what follows the BIN chunk. It is not needed, so it may also be broken. */
static void count_rest(const struct gltf_file *file, uint64_t length, uint64_t at)
{
    while (length - at >= CHUNK_HEADER) {
        uint32_t size = bytes_get32(file->data.data + at);
        if (size > length - at - CHUNK_HEADER)
            break;
        at += CHUNK_HEADER + (uint64_t)size;
        file->counts->unknown_chunks++;
    }
    file->counts->extra_bytes += file->data.size - at;
}

/* Finds the chunks of a GLB. Chunks of other kinds are skipped, as the format says, and counted. */
static enum bvhd_status read_chunks(struct gltf_file *file, struct bytes *ret_json)
{
    if (file->data.size < GLB_HEADER)
        return gltf_refuse(file, BVHD_UNSUPPORTED, NULL, "GLB: the header is cut off");
    uint32_t version = bytes_get32(file->data.data + 4), length = bytes_get32(file->data.data + 8);
    uint32_t kind = 0;
    file->is_old = version == 1;
    if (file->is_old)
        return BVHD_OK;
    if (version != GLB_VERSION)
        return gltf_refuse(file, BVHD_UNSUPPORTED, NULL, "GLB: version %u, but only 2 is known", version);
    if (length < GLB_HEADER || length > file->data.size)
        return gltf_refuse(file, BVHD_UNSUPPORTED, NULL, "GLB: the header says %u bytes, the file has %llu", length,
                           (unsigned long long)file->data.size);
    uint64_t at = GLB_HEADER;
    enum bvhd_status status = take_chunk(file, length, "JSON", &at, &kind, ret_json);
    if (!status && kind != CHUNK_JSON)
        return gltf_refuse(file, BVHD_UNSUPPORTED, NULL, "GLB: the first chunk is not JSON");
    while (!status && !file->has_bin && at < length) {
        struct bytes chunk;
        status = take_chunk(file, length, "BIN", &at, &kind, &chunk);
        file->has_bin = !status && kind == CHUNK_BIN;
        file->counts->unknown_chunks += !status && !file->has_bin;
        if (file->has_bin)
            file->bin = chunk;
    }
    if (!status)
        count_rest(file, length, at);
    return status;
}

/* Only blanks may follow the JSON; some writers pad a GLB's chunk with zeros. */
static bool is_blank(const char *text, const char *end)
{
    while (text < end && (*text == ' ' || *text == '\t' || *text == '\r' || *text == '\n' || *text == '\0'))
        text++;
    return text == end;
}

static enum bvhd_status parse_text(struct gltf_file *file, struct bytes text)
{
    const char *start = (const char *)text.data, *end = NULL;
    file->root = gltf_arena_parse(&file->arena, start, text.size, &end);
    if (file->arena.failed)
        return gltf_no_memory(file);
    if (!file->root && end && end > start && end < start + text.size)
        return gltf_refuse(file, BVHD_UNSUPPORTED, NULL, "no JSON from byte %llu on, or nested too deep",
                           (unsigned long long)(end - start));
    if (!file->root)
        return gltf_refuse(file, BVHD_UNSUPPORTED, NULL, "the JSON is not complete");
    if (!cJSON_IsObject(file->root) || !is_blank(end, start + text.size))
        return gltf_refuse(file, BVHD_UNSUPPORTED, NULL, "the JSON is not one object");
    return BVHD_OK;
}

/* Parses a copy, because cJSON reads texts twice, and the mapped file could change meanwhile. */
static enum bvhd_status parse(struct gltf_file *file, struct bytes text)
{
    unsigned char *copy = memory_alloc(file->memory, text.size + 1);
    if (!copy)
        return gltf_no_memory(file);
    if (text.size)
        memcpy(copy, text.data, text.size);
    enum bvhd_status status = parse_text(file, (struct bytes){copy, text.size});
    memory_free(file->memory, copy);
    return status;
}

/* Makes an array of a list, because cJSON's lists have to be walked from their start. */
static enum bvhd_status read_list(struct gltf_file *file, enum gltf_list_name name)
{
    struct gltf_value root = {.json = file->root, .index = -1}, array;
    enum bvhd_status status = gltf_array(file, &root, gltf_list_text(name), &array);
    if (status || !array.json)
        return status;
    struct gltf_list *list = &file->lists[name];
    list->items = memory_array(file->memory, (uint64_t)cJSON_GetArraySize(array.json) + 1, sizeof *list->items);
    if (!list->items)
        return gltf_no_memory(file);
    for (const cJSON *item = array.json->child; item && !status; item = item->next) {
        struct gltf_value value = gltf_element(&array, item, list->count);
        list->items[list->count++] = item;
        if (!cJSON_IsObject(item))
            status = gltf_refuse(file, BVHD_INVALID, &value, "not an object");
    }
    return status;
}

static enum bvhd_status read_lists(struct gltf_file *file)
{
    enum bvhd_status status = BVHD_OK;
    for (int i = 0; i < GLTF_LISTS && !status; i++)
        status = read_list(file, (enum gltf_list_name)i);
    if (status)
        return status;
    uint64_t buffers = file->lists[GLTF_BUFFERS].count, views = file->lists[GLTF_BUFFER_VIEWS].count;
    file->buffers = memory_array(file->memory, buffers + 1, sizeof *file->buffers);
    file->views = memory_array(file->memory, views + 1, sizeof *file->views);
    if (file->buffers)
        memset(file->buffers, 0, (buffers + 1) * sizeof *file->buffers);
    if (file->views)
        memset(file->views, 0, (views + 1) * sizeof *file->views);
    return file->buffers && file->views ? BVHD_OK : gltf_no_memory(file);
}

/* Reads the version of the format. Version 1 is another format; a newer minor version may have more, but no less. */
static enum bvhd_status check_version(struct gltf_file *file)
{
    struct gltf_value root = {.json = file->root, .index = -1}, asset = gltf_member(&root, "asset");
    const char *version = gltf_text(&asset, "version"), *least = gltf_text(&asset, "minVersion");
    struct gltf_value place = gltf_member(&asset, "version");
    if (!version)
        return gltf_refuse(file, BVHD_UNSUPPORTED, &place, "missing: this is no glTF file");
    file->is_old = !strncmp(version, "1.", 2) || !strcmp(version, "1");
    if (file->is_old)
        return BVHD_OK;
    if (strncmp(version, "2.", 2) && strcmp(version, "2"))
        return gltf_refuse(file, BVHD_UNSUPPORTED, &place, "'%.20s', but only 2.0 is known", version);
    place = gltf_member(&asset, "minVersion");
    if (least && strcmp(least, "2.0"))
        return gltf_refuse(file, BVHD_UNSUPPORTED, &place, "'%.20s', but only 2.0 is known", least);
    return BVHD_OK;
}

enum bvhd_status gltf_file_open(struct gltf_file *file)
{
    enum bvhd_status status = import_files_map(file->files, file->path, &file->data, file->error);
    if (status)
        return status;
    struct bytes json = file->data;
    if (file->data.size >= 4 && bytes_get32(file->data.data) == GLB_MAGIC)
        status = read_chunks(file, &json);
    if (status || file->is_old)
        return status;
    status = parse(file, json);
    if (!status)
        status = check_version(file);
    return status || file->is_old ? status : read_lists(file);
}

static void free_bytes(struct gltf_file *file, struct gltf_bytes *list, enum gltf_list_name name)
{
    for (uint32_t i = 0; list && i < file->lists[name].count; i++) {
        memory_free(file->memory, list[i].owned);
        import_files_unmap(list[i].mapped);
    }
    memory_free(file->memory, list);
}

void gltf_file_close(struct gltf_file *file)
{
    free_bytes(file, file->buffers, GLTF_BUFFERS);
    free_bytes(file, file->views, GLTF_BUFFER_VIEWS);
    for (int i = 0; i < GLTF_LISTS; i++)
        memory_free(file->memory, file->lists[i].items);
    gltf_arena_finish(&file->arena);
    import_files_unmap(file->data);
    file->root = NULL;
    file->data = (struct bytes){0};
    file->buffers = file->views = NULL;
    memset(file->lists, 0, sizeof file->lists);
}
