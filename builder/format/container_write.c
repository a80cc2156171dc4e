/* SPDX-License-Identifier: Apache-2.0 */
#include <string.h>

#include "builder/format/container_internal.h"

static enum bvhd_status no_memory(struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, "container", "no memory for its directory");
}

/* Makes room for `size` more bytes at the end of a list. Returns NULL when there is no memory. */
static unsigned char *extend(struct container_list *list, uint64_t size, struct memory *memory)
{
    if (list->capacity - list->size < size) {
        uint64_t capacity = list->capacity * 2 + size + 256;
        unsigned char *data = memory_resize(memory, list->data, capacity);
        if (!data)
            return NULL;
        list->data = data;
        list->capacity = capacity;
    }
    list->size += size;
    return list->data + list->size - size;
}

void container_writer_init(struct container_writer *writer, struct memory *memory,
                           bool (*sink)(void *context, struct bytes data), void *context)
{
    *writer = (struct container_writer){
        .memory = memory, .sink = sink, .context = context, .size = CONTAINER_HEADER, .last_scene = UINT32_MAX};
}

void container_writer_finish(struct container_writer *writer)
{
    if (!writer || !writer->memory)
        return;
    memory_free(writer->memory, writer->table.data);
    memory_free(writer->memory, writer->references.data);
    memory_free(writer->memory, writer->texts.data);
    memory_free(writer->memory, writer->slots);
    *writer = (struct container_writer){0};
}

static enum bvhd_status put(struct container_writer *writer, struct bytes data, struct bvhd_error *error)
{
    if (data.size && !writer->sink(writer->context, data))
        return bvhd_error_set(error, BVHD_IO, "container", "it cannot be written");
    writer->size += data.size;
    return BVHD_OK;
}

static enum bvhd_status put_padding(struct container_writer *writer, struct bvhd_error *error)
{
    static const unsigned char zeros[CONTAINER_ALIGN];
    return put(writer, (struct bytes){zeros, bytes_align(writer->size, CONTAINER_ALIGN) - writer->size}, error);
}

static const unsigned char *row_at(const struct container_writer *writer, uint32_t row)
{
    return writer->table.data + (uint64_t)row * CONTAINER_ROW;
}

/* Returns the slot of a key: the one that has its row, or the empty one where it belongs. Keys are hashes already. */
static uint32_t *find_slot(const struct container_writer *writer, const unsigned char *key)
{
    uint64_t mask = writer->slot_count - 1, slot = bytes_get64(key) & mask;
    while (writer->slots[slot] && memcmp(row_at(writer, writer->slots[slot] - 1) + ROW_KEY, key, KEY_SIZE) != 0)
        slot = (slot + 1) & mask;
    return &writer->slots[slot];
}

/* Keeps at least half of the slots empty. */
static bool grow_slots(struct container_writer *writer)
{
    if (writer->slot_count / 2 > writer->count)
        return true;
    uint64_t count = writer->slot_count ? writer->slot_count * 2 : 64;
    uint32_t *slots = memory_array(writer->memory, count, sizeof *slots);
    if (!slots)
        return false;
    memset(slots, 0, count * sizeof *slots);
    memory_free(writer->memory, writer->slots);
    writer->slots = slots;
    writer->slot_count = count;
    for (uint32_t i = 0; i < writer->count; i++)
        if (bytes_get32(row_at(writer, i) + ROW_STORED) == i)
            *find_slot(writer, row_at(writer, i) + ROW_KEY) = i + 1;
    return true;
}

static enum bvhd_status add_text(struct container_writer *writer, const char *text, uint32_t *ret_offset,
                                 struct bvhd_error *error)
{
    uint64_t size = strlen(text) + 1;
    if (writer->texts.size + size > UINT32_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "container", "more than 4 GiB of names");
    uint32_t offset = (uint32_t)writer->texts.size;
    unsigned char *at = extend(&writer->texts, size, writer->memory);
    if (!at)
        return no_memory(error);
    memcpy(at, text, size);
    *ret_offset = offset;
    return BVHD_OK;
}

/* The text of a scene is stored once for all its structures that follow each other. */
static enum bvhd_status add_scene(struct container_writer *writer, const char *scene, struct bvhd_error *error)
{
    uint32_t last = writer->last_scene;
    if (last != UINT32_MAX && strcmp((const char *)writer->texts.data + last, scene) == 0)
        return BVHD_OK;
    return add_text(writer, scene, &writer->last_scene, error);
}

static enum bvhd_status add_texts(struct container_writer *writer, const struct container_structure *structure,
                                  unsigned char *row, struct bvhd_error *error)
{
    uint32_t file, name;
    enum bvhd_status status = add_scene(writer, structure->scene, error);
    if (status == BVHD_OK)
        status = add_text(writer, structure->file, &file, error);
    if (status == BVHD_OK)
        status = add_text(writer, structure->name, &name, error);
    if (status != BVHD_OK)
        return status;
    bytes_put32(row + ROW_FILE, file);
    bytes_put32(row + ROW_NAME, name);
    bytes_put32(row + ROW_SCENE, writer->last_scene);
    return BVHD_OK;
}

static enum bvhd_status add_references(struct container_writer *writer, const struct container_structure *structure,
                                       unsigned char *row, struct bvhd_error *error)
{
    uint64_t first = writer->references.size / 4, count = structure->reference_count;
    if (first + count > UINT32_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "container", "more than 2^32 - 1 references");
    unsigned char *at = count ? extend(&writer->references, 4 * count, writer->memory) : NULL;
    if (count && !at)
        return no_memory(error);
    for (uint64_t i = 0; i < count; i++)
        bytes_put32(at + 4 * i, structure->references[i]);
    bytes_put32(row + ROW_FIRST_REFERENCE, (uint32_t)first);
    bytes_put32(row + ROW_REFERENCE_COUNT, (uint32_t)count);
    return BVHD_OK;
}

/* Writes the bytes of a structure, unless those of an earlier one with the same key are there. */
static enum bvhd_status store(struct container_writer *writer, const struct container_structure *structure,
                              unsigned char *row, struct bvhd_error *error)
{
    if (!grow_slots(writer))
        return no_memory(error);
    uint32_t *slot = find_slot(writer, structure->key.bytes);
    const unsigned char *earlier = *slot ? row_at(writer, *slot - 1) : NULL;
    if (earlier && bytes_get64(earlier + ROW_SIZE) == structure->blob.size) {
        memcpy(row + ROW_OFFSET, earlier + ROW_OFFSET, ROW_TYPE - ROW_OFFSET);
        bytes_put32(row + ROW_STORED, *slot - 1);
        return BVHD_OK;
    }
    enum bvhd_status status = put_padding(writer, error);
    if (status != BVHD_OK)
        return status;
    bytes_put64(row + ROW_OFFSET, writer->size);
    bytes_put64(row + ROW_SIZE, structure->blob.size);
    bytes_put64(row + ROW_CHECKSUM, checksum(structure->blob, 0));
    bytes_put32(row + ROW_STORED, writer->count);
    *slot = writer->count + 1;
    return put(writer, structure->blob, error);
}

enum bvhd_status container_writer_add(struct container_writer *writer, const struct container_structure *structure,
                                      struct bvhd_error *error)
{
    unsigned char row[CONTAINER_ROW];
    if (writer->count == UINT32_MAX - 1)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "container", "too many structures");
    memcpy(row + ROW_KEY, structure->key.bytes, KEY_SIZE);
    bytes_put32(row + ROW_TYPE, structure->type);
    bytes_put32(row + ROW_TARGET, structure->target);
    memcpy(row + ROW_BOUNDS, structure->bounds, sizeof structure->bounds);
    memcpy(row + ROW_SLABS, structure->slabs, sizeof structure->slabs);
    enum bvhd_status status = add_texts(writer, structure, row, error);
    if (status == BVHD_OK)
        status = add_references(writer, structure, row, error);
    if (status == BVHD_OK)
        status = store(writer, structure, row, error);
    if (status != BVHD_OK)
        return status;
    unsigned char *at = extend(&writer->table, CONTAINER_ROW, writer->memory);
    if (!at)
        return no_memory(error);
    memcpy(at, row, sizeof row);
    writer->count++;
    return BVHD_OK;
}

static void write_header(const struct container_writer *writer, uint64_t directory, uint64_t manifest_size,
                         unsigned char *header)
{
    memcpy(header, container_magic, sizeof container_magic);
    bytes_put32(header + HEADER_VERSION, CONTAINER_VERSION);
    bytes_put32(header + HEADER_COUNT, writer->count);
    bytes_put64(header + HEADER_SIZE,
                directory + writer->table.size + writer->references.size + writer->texts.size + manifest_size + 1);
    bytes_put64(header + HEADER_DIRECTORY, directory);
    bytes_put64(header + HEADER_REFERENCES, writer->references.size / 4);
    bytes_put64(header + HEADER_TEXTS, writer->texts.size);
    bytes_put64(header + HEADER_MANIFEST, manifest_size);
}

enum bvhd_status container_writer_end(struct container_writer *writer, struct bytes manifest,
                                      unsigned char ret_header[CONTAINER_HEADER], struct bvhd_error *error)
{
    unsigned char header[CONTAINER_HEADER];
    static const unsigned char zero[1];
    enum bvhd_status status = put_padding(writer, error);
    write_header(writer, writer->size, manifest.size, header);
    const struct bytes parts[] = {{writer->table.data, writer->table.size},
                                  {writer->references.data, writer->references.size},
                                  {writer->texts.data, writer->texts.size},
                                  manifest,
                                  {zero, 1}};
    uint64_t sum = container_header_seed(header);
    for (size_t i = 0; i < sizeof parts / sizeof parts[0] && status == BVHD_OK; i++) {
        sum = checksum(parts[i], sum);
        status = put(writer, parts[i], error);
    }
    if (status != BVHD_OK)
        return status;
    bytes_put64(header + HEADER_CHECKSUM, sum);
    memcpy(ret_header, header, sizeof header);
    return BVHD_OK;
}
