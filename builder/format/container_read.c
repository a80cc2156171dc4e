/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <string.h>

#include "builder/format/container_internal.h"
#include "builder/format/serialized.h"
#include "proto/base/place.h"
#include "proto/base/utf8.h"

static enum bvhd_status corrupt(struct bvhd_error *error, const char *member, const char *text)
{
    return bvhd_error_set(error, BVHD_CORRUPT, place("container.%s", member).text, "%s", text);
}

static enum bvhd_status corrupt_row(struct bvhd_error *error, uint32_t row, const char *member, const char *text)
{
    return bvhd_error_set(error, BVHD_CORRUPT, place("container.structures[%" PRIu32 "].%s", row, member).text, "%s",
                          text);
}

bool container_is(struct bytes file)
{
    return file.size >= sizeof container_magic && memcmp(file.data, container_magic, sizeof container_magic) == 0;
}

/* Sets where the parts of the directory are. They follow each other without a gap, up to the end of the file. */
static enum bvhd_status find_parts(struct container *container, struct bvhd_error *error)
{
    const unsigned char *header = container->file.data;
    uint64_t directory = bytes_get64(header + HEADER_DIRECTORY), references, end;
    uint64_t texts = bytes_get64(header + HEADER_TEXTS), manifest = bytes_get64(header + HEADER_MANIFEST);
    if (directory < CONTAINER_HEADER || directory % CONTAINER_ALIGN != 0)
        return corrupt(error, "directory", "its offset is not a multiple of 64 behind the header");
    bool fits = bytes_mul(bytes_get64(header + HEADER_REFERENCES), 4, &references) &&
                bytes_add(directory, (uint64_t)container->count * CONTAINER_ROW, &end) &&
                bytes_add(end, references, &end) && bytes_add(end, texts, &end) && bytes_add(end, manifest, &end) &&
                bytes_add(end, 1, &end);
    if (!fits || end != container->file.size)
        return corrupt(error, "directory", "the sizes of its parts do not add up to that of the file");
    container->table = header + directory;
    container->references =
        (const uint32_t *)(const void *)(container->table + (uint64_t)container->count * CONTAINER_ROW);
    container->texts = (const char *)container->references + references;
    container->manifest = (struct bytes){(const unsigned char *)container->texts + texts, manifest};
    return BVHD_OK;
}

static enum bvhd_status read_header(struct container *container, struct bvhd_error *error)
{
    struct bytes file = container->file;
    if (!container_is(file))
        return bvhd_error_set(error, BVHD_CORRUPT, "container", "this is no container of structures");
    if (file.size < CONTAINER_HEADER)
        return bvhd_error_set(error, BVHD_CORRUPT, "container", "%" PRIu64 " bytes are too few", file.size);
    container->version = bytes_get32(file.data + HEADER_VERSION);
    container->count = bytes_get32(file.data + HEADER_COUNT);
    if (container->version != CONTAINER_VERSION)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, "container.version",
                              "%" PRIu32 "; this version of bvhd reads %d", container->version, CONTAINER_VERSION);
    if (bytes_get64(file.data + HEADER_SIZE) != file.size)
        return bvhd_error_set(error, BVHD_CORRUPT, "container.size", "says %" PRIu64 " bytes, but there are %" PRIu64,
                              bytes_get64(file.data + HEADER_SIZE), file.size);
    return find_parts(container, error);
}

/* The directory is summed in the parts in which it is written. */
static enum bvhd_status check_directory(const struct container *container, struct bvhd_error *error)
{
    const unsigned char *texts = (const unsigned char *)container->texts, *manifest = container->manifest.data;
    const unsigned char *references = (const unsigned char *)container->references;
    const struct bytes parts[] = {{container->table, (uint64_t)(references - container->table)},
                                  {references, (uint64_t)(texts - references)},
                                  {texts, (uint64_t)(manifest - texts)},
                                  container->manifest,
                                  {manifest + container->manifest.size, 1}};
    uint64_t sum = container_header_seed(container->file.data);
    for (size_t i = 0; i < sizeof parts / sizeof parts[0]; i++)
        sum = checksum(parts[i], sum);
    if (sum != bytes_get64(container->file.data + HEADER_CHECKSUM))
        return corrupt(error, "checksum", "its directory is damaged");
    if (manifest != texts && manifest[-1] != 0)
        return corrupt(error, "texts", "the last one does not end");
    if (manifest[container->manifest.size] != 0 || memchr(manifest, 0, container->manifest.size))
        return corrupt(error, "manifest", "it does not end with its only zero byte");
    return BVHD_OK;
}

static const unsigned char *row_at(const struct container *container, uint32_t row)
{
    return container->table + (uint64_t)row * CONTAINER_ROW;
}

static struct bytes row_blob(const struct container *container, const unsigned char *row)
{
    return (struct bytes){container->file.data + bytes_get64(row + ROW_OFFSET), bytes_get64(row + ROW_SIZE)};
}

/* A row names bytes of its own, which begin at *at or after the padding there, or those of an earlier row. */
static enum bvhd_status check_place(const struct container *container, uint32_t index, uint64_t *at,
                                    struct bvhd_error *error)
{
    const unsigned char *row = row_at(container, index), *file = container->file.data;
    uint64_t directory = bytes_get64(file + HEADER_DIRECTORY), begin = bytes_align(*at, CONTAINER_ALIGN), end;
    uint32_t stored = bytes_get32(row + ROW_STORED);
    if (stored < index) {
        const unsigned char *other = row_at(container, stored);
        bool is_same = bytes_get32(other + ROW_STORED) == stored && memcmp(row, other, ROW_BOUNDS) == 0;
        return is_same ? BVHD_OK : corrupt_row(error, index, "stored", "the row that it names has other bytes");
    }
    if (stored > index)
        return corrupt_row(error, index, "stored", "it names a row behind it");
    if (bytes_get64(row + ROW_OFFSET) != begin)
        return corrupt_row(error, index, "offset", "it does not begin where the one before it ends");
    if (!bytes_add(begin, bytes_get64(row + ROW_SIZE), &end) || end > directory)
        return corrupt_row(error, index, "size", "it reaches beyond the directory's offset");
    for (; *at < begin; ++*at)
        if (file[*at])
            return corrupt_row(error, index, "offset", "the padding in front of it is not zero");
    *at = end;
    return BVHD_OK;
}

/* References of a row follow those of the row before, and name bottom levels of the same target in earlier rows. */
static enum bvhd_status check_references(const struct container *container, uint32_t index, uint64_t *at,
                                         struct bvhd_error *error)
{
    const unsigned char *row = row_at(container, index);
    uint32_t count = bytes_get32(row + ROW_REFERENCE_COUNT), target = bytes_get32(row + ROW_TARGET);
    uint64_t total = bytes_get64(container->file.data + HEADER_REFERENCES);
    if (bytes_get32(row + ROW_FIRST_REFERENCE) != *at || count > total - *at)
        return corrupt_row(error, index, "references", "they do not follow those of the row before");
    if (count && bytes_get32(row + ROW_TYPE) != STRUCTURE_TOP)
        return corrupt_row(error, index, "references", "only a top level has any");
    for (uint32_t i = 0; i < count; i++) {
        uint32_t other = container->references[*at + i];
        if (other >= index || bytes_get32(row_at(container, other) + ROW_TYPE) != STRUCTURE_BOTTOM ||
            bytes_get32(row_at(container, other) + ROW_TARGET) != target)
            return corrupt_row(error, index, "references", "one is no bottom level of its target in an earlier row");
    }
    *at += count;
    return BVHD_OK;
}

/* Returns whether a text begins at *at, and moves *at behind it. Texts follow each other, so that each is read once. */
static bool take_text(const struct container *container, uint32_t offset, uint64_t *at)
{
    uint64_t size = (uint64_t)((const char *)container->manifest.data - container->texts);
    if (offset != *at || *at >= size || !utf8_is_valid(container->texts + offset))
        return false;
    *at += strlen(container->texts + offset) + 1;
    return true;
}

static bool is_file_name(const char *name)
{
    return *name && !strchr(name, '/') && strcmp(name, ".") != 0 && strcmp(name, "..") != 0;
}

/* A row has the scene's text of the row before, or one of its own in front of its other texts. */
static enum bvhd_status check_texts(const struct container *container, uint32_t index, uint64_t *at,
                                    struct bvhd_error *error)
{
    const unsigned char *row = row_at(container, index);
    uint32_t scene = bytes_get32(row + ROW_SCENE), file = bytes_get32(row + ROW_FILE);
    bool has_scene = index > 0 && scene == bytes_get32(row_at(container, index - 1) + ROW_SCENE);
    if (!has_scene && !take_text(container, scene, at))
        return corrupt_row(error, index, "scene", "not the next text, or not in UTF-8");
    if (!take_text(container, file, at) || !is_file_name(container->texts + file))
        return corrupt_row(error, index, "file", "not the next text, or not the name of a file");
    if (!take_text(container, bytes_get32(row + ROW_NAME), at))
        return corrupt_row(error, index, "name", "not the next text, or not in UTF-8");
    return BVHD_OK;
}

static enum bvhd_status check_kind(const struct container *container, uint32_t index, struct bvhd_error *error)
{
    const unsigned char *row = row_at(container, index);
    uint32_t type = bytes_get32(row + ROW_TYPE), target = bytes_get32(row + ROW_TARGET);
    struct serialized_header header;
    if (type != STRUCTURE_TOP && type != STRUCTURE_BOTTOM)
        return corrupt_row(error, index, "type", "neither a top level nor a bottom level");
    if (target != TARGET_PORTABLE && target != TARGET_LAVAPIPE)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, place("container.structures[%" PRIu32 "].target", index).text,
                              "%" PRIu32 " is no target that this version of bvhd knows", target);
    if (serialized_read(row_blob(container, row), &header, NULL) != BVHD_OK)
        return corrupt_row(error, index, "size", "not the size that the structure itself says");
    return BVHD_OK;
}

static enum bvhd_status check_rows(const struct container *container, struct bvhd_error *error)
{
    uint64_t at = CONTAINER_HEADER, reference = 0, text = 0;
    const unsigned char *file = container->file.data;
    for (uint32_t i = 0; i < container->count; i++) {
        enum bvhd_status status = check_place(container, i, &at, error);
        if (status == BVHD_OK)
            status = check_kind(container, i, error);
        if (status == BVHD_OK)
            status = check_references(container, i, &reference, error);
        if (status == BVHD_OK)
            status = check_texts(container, i, &text, error);
        if (status != BVHD_OK)
            return status;
    }
    if (reference != bytes_get64(file + HEADER_REFERENCES))
        return corrupt(error, "references", "some belong to no structure");
    if (text != bytes_get64(file + HEADER_TEXTS))
        return corrupt(error, "texts", "some belong to no structure");
    if (bytes_align(at, CONTAINER_ALIGN) != bytes_get64(file + HEADER_DIRECTORY))
        return corrupt(error, "directory", "it does not begin where the structures end");
    for (; at < bytes_get64(file + HEADER_DIRECTORY); at++)
        if (file[at])
            return corrupt(error, "directory", "the padding in front of it is not zero");
    return BVHD_OK;
}

enum bvhd_status container_open(struct bytes file, struct container *ret_container, struct bvhd_error *error)
{
    struct container container = {.file = file};
    enum bvhd_status status = read_header(&container, error);
    if (status == BVHD_OK)
        status = check_directory(&container, error);
    if (status == BVHD_OK)
        status = check_rows(&container, error);
    if (status == BVHD_OK)
        *ret_container = container;
    return status;
}

struct container_structure container_structure(const struct container *container, uint32_t row)
{
    const unsigned char *at = row_at(container, row);
    struct container_structure structure = {
        .blob = row_blob(container, at),
        .type = bytes_get32(at + ROW_TYPE),
        .target = (enum target)bytes_get32(at + ROW_TARGET),
        .file = container->texts + bytes_get32(at + ROW_FILE),
        .name = container->texts + bytes_get32(at + ROW_NAME),
        .scene = container->texts + bytes_get32(at + ROW_SCENE),
        .references = container->references + bytes_get32(at + ROW_FIRST_REFERENCE),
        .reference_count = bytes_get32(at + ROW_REFERENCE_COUNT),
    };
    memcpy(structure.key.bytes, at + ROW_KEY, KEY_SIZE);
    memcpy(structure.bounds, at + ROW_BOUNDS, sizeof structure.bounds);
    memcpy(structure.slabs, at + ROW_SLABS, sizeof structure.slabs);
    return structure;
}

enum bvhd_status container_check(const struct container *container, uint32_t row, struct bvhd_error *error)
{
    const unsigned char *at = row_at(container, row);
    if (checksum(row_blob(container, at), 0) != bytes_get64(at + ROW_CHECKSUM))
        return corrupt_row(error, row, "checksum", "its bytes are damaged");
    return BVHD_OK;
}
