/* SPDX-License-Identifier: Apache-2.0 */
#include "portable_scene.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "serialized.h"

static enum bvhd_status handle_error(struct bvhd_error *error, uint64_t row, const struct bvhd_error *inner)
{
    char where[BVHD_WHERE_SIZE];
    snprintf(where, sizeof where, "handles[%" PRIu64 "]: %.80s", row, inner->where);
    return bvhd_error_set(error, inner->status, where, "%s", inner->text);
}

/* ---- packing ---- */

/* `leader` is the lowest row with the same bytes: there they are stored, and the row takes its offset. */
struct pack_entry {
    const unsigned char *data;
    uint32_t row, leader;
    uint64_t offset;
};

static int by_data(const void *a, const void *b)
{
    const struct pack_entry *x = a, *y = b;
    if (x->data != y->data)
        return x->data < y->data ? -1 : 1;
    return x->row < y->row ? -1 : x->row > y->row;
}

static int by_row(const void *a, const void *b)
{
    const struct pack_entry *x = a, *y = b;
    return x->row < y->row ? -1 : x->row > y->row;
}

/* Entries in any order on entry, by row on return. */
static void find_leaders(struct pack_entry *entries, uint32_t count)
{
    qsort(entries, count, sizeof *entries, by_data);
    for (uint32_t i = 0; i < count; i++)
        entries[i].leader = i > 0 && entries[i].data == entries[i - 1].data ? entries[i - 1].leader : entries[i].row;
    qsort(entries, count, sizeof *entries, by_row);
}

static enum bvhd_status lay_out(const struct bytes *blobs, struct pack_entry *entries, uint32_t count, uint64_t *ret_size,
                                struct bvhd_error *error)
{
    uint64_t end = 0;
    for (uint32_t row = 0; row < count; row++) {
        entries[row].offset =
            entries[row].leader == row ? bytes_align(end, PORTABLE_BODY_ALIGNMENT) : entries[entries[row].leader].offset;
        if (entries[row].leader == row && (!bytes_add(entries[row].offset, blobs[row].size, &end) || end > UINT64_MAX / 2))
            return bvhd_error_set(error, BVHD_TOO_LARGE, "blobs", "their sizes add up to more than memory can hold");
    }
    *ret_size = end;
    return BVHD_OK;
}

static void copy_blobs(const struct bytes *blobs, const struct pack_entry *entries, uint32_t count, unsigned char *buffer)
{
    uint64_t end = 0;
    for (uint32_t row = 0; row < count; row++) {
        if (entries[row].leader != row)
            continue;
        memset(buffer + end, 0, entries[row].offset - end);
        memcpy(buffer + entries[row].offset, blobs[row].data, blobs[row].size);
        end = entries[row].offset + blobs[row].size;
    }
    for (uint32_t row = 1; row < count; row++)
        bytes_put64(buffer + SERIALIZED_HANDLES + (uint64_t)8 * (row - 1), entries[row].offset);
}

static enum bvhd_status check_blobs(const struct bytes *blobs, uint32_t count, struct bvhd_error *error)
{
    struct serialized_header header;
    struct bvhd_error inner;
    if (count == 0)
        return bvhd_error_set(error, BVHD_INVALID, "blobs", "there is no structure");
    for (uint32_t i = 0; i < count; i++) {
        enum bvhd_status status = serialized_read(blobs[i], &header, &inner);
        if (status != BVHD_OK)
            return i == 0 ? bvhd_error_set(error, status, inner.where, "%s", inner.text) : handle_error(error, i - 1, &inner);
        if (i == 0 && header.handle_count != count - 1)
            return bvhd_error_set(error, BVHD_INVALID, "header.handleCount", "%" PRIu64 " handles, but %" PRIu32 " structures for them",
                                  header.handle_count, count - 1);
    }
    return BVHD_OK;
}

enum bvhd_status portable_pack(const struct bytes *blobs, uint32_t count, struct memory *memory, unsigned char **ret_buffer,
                               uint64_t *ret_size, struct bvhd_error *error)
{
    enum bvhd_status status = check_blobs(blobs, count, error);
    if (status != BVHD_OK)
        return status;
    struct pack_entry *entries = memory_array(memory, count, sizeof *entries);
    if (!entries)
        return bvhd_error_set(error, BVHD_NO_MEMORY, "pack", "no memory for %" PRIu32 " structures", count);
    for (uint32_t i = 0; i < count; i++)
        entries[i] = (struct pack_entry){blobs[i].data, i, i, 0};

    find_leaders(entries, count);

    uint64_t size = 0;
    unsigned char *buffer = NULL;
    status = lay_out(blobs, entries, count, &size, error);
    if (status == BVHD_OK && !(buffer = memory_alloc(memory, size)))
        status = bvhd_error_set(error, BVHD_NO_MEMORY, "pack", "no memory for %" PRIu64 " bytes", size);
    if (status == BVHD_OK) {
        copy_blobs(blobs, entries, count, buffer);
        *ret_buffer = buffer;
        *ret_size = size;
    }
    memory_free(memory, entries);
    return status;
}

/* ---- opening ---- */

/* The blob that starts at `offset`, as long as its own header says. */
static enum bvhd_status blob_at(struct bytes buffer, uint64_t offset, struct bytes *ret_blob, struct bvhd_error *error)
{
    if (offset % PORTABLE_BODY_ALIGNMENT != 0)
        return bvhd_error_set(error, BVHD_CORRUPT, "offset", "%" PRIu64 " is no multiple of %d", offset, PORTABLE_BODY_ALIGNMENT);
    if (!bytes_reach(buffer.size, offset, 0, 0, SERIALIZED_HANDLES))
        return bvhd_error_set(error, BVHD_CORRUPT, "offset", "%" PRIu64 " lies outside of the buffer", offset);
    uint64_t size = bytes_get64(buffer.data + offset + 32);
    if (!bytes_reach(buffer.size, offset, 0, 0, size))
        return bvhd_error_set(error, BVHD_CORRUPT, "header.serializedSize", "%" PRIu64 " bytes reach beyond the buffer", size);
    *ret_blob = (struct bytes){buffer.data + offset, size};
    return BVHD_OK;
}

/* A bottom level that starts at `offset`, not before *end; *end becomes its own. */
static enum bvhd_status open_bottom(struct bytes buffer, uint64_t offset, uint64_t *end, struct memory *memory,
                                    struct portable_view *ret_view, struct bvhd_error *error)
{
    struct bytes blob;
    if (offset < *end)
        return bvhd_error_set(error, BVHD_CORRUPT, "offset", "points into the structure before it");
    enum bvhd_status status = blob_at(buffer, offset, &blob, error);
    if (status == BVHD_OK)
        status = portable_open(blob, memory, ret_view, error);
    if (status == BVHD_OK && ret_view->header->content == PORTABLE_INSTANCES)
        status = bvhd_error_set(error, BVHD_CORRUPT, "header.content", "an instance of a top level");
    if (status == BVHD_OK)
        *end = offset + blob.size;
    return status;
}

struct handle_row {
    uint64_t offset;
    uint32_t row;
};

static int by_offset(const void *a, const void *b)
{
    const struct handle_row *x = a, *y = b;
    if (x->offset != y->offset)
        return x->offset < y->offset ? -1 : 1;
    return x->row < y->row ? -1 : x->row > y->row;
}

/*
 * Opens each distinct offset once, however many handles carry it. `rows` come sorted. Structures may not overlap, so that opening takes time in
 * proportion to the buffer.
 */
static enum bvhd_status open_bottoms(struct bytes buffer, const struct handle_row *rows, uint32_t count, uint64_t top_size,
                                     struct portable_scene *scene, struct bvhd_error *error)
{
    struct portable_view *view = scene->views;
    uint64_t end = top_size;
    for (uint32_t i = 0; i < count; i++) {
        if (i == 0 || rows[i].offset != rows[i - 1].offset) {
            struct bvhd_error inner;
            view += i > 0;
            enum bvhd_status status = open_bottom(buffer, rows[i].offset, &end, scene->memory, view, &inner);
            if (status != BVHD_OK)
                return handle_error(error, rows[i].row, &inner);
        }
        scene->bottoms[rows[i].row] = view;
    }
    return BVHD_OK;
}

static enum bvhd_status open_top(struct bytes buffer, uint64_t top_size, struct portable_scene *scene, struct bvhd_error *error)
{
    uint64_t count = scene->top.handle_count;
    scene->scene.top = &scene->top;
    if (count == 0)
        return BVHD_OK;
    scene->views = memory_array(scene->memory, count, sizeof *scene->views);
    scene->bottoms = memory_array(scene->memory, count, sizeof *scene->bottoms);
    struct handle_row *rows = memory_array(scene->memory, count, sizeof *rows);
    enum bvhd_status status;
    if (!scene->views || !scene->bottoms || !rows) {
        status = bvhd_error_set(error, BVHD_NO_MEMORY, "scene", "no memory for %" PRIu64 " handles", count);
    } else {
        for (uint32_t i = 0; i < count; i++)
            rows[i] = (struct handle_row){bytes_get64(scene->top.handles + (uint64_t)8 * i), i};
        qsort(rows, count, sizeof *rows, by_offset);
        status = open_bottoms(buffer, rows, (uint32_t)count, top_size, scene, error);
    }
    memory_free(scene->memory, rows);
    scene->scene.bottoms = scene->bottoms;
    scene->scene.bottom_count = (uint32_t)count;
    return status;
}

enum bvhd_status portable_scene_open(struct bytes buffer, struct memory *memory, struct portable_scene *ret_scene,
                                     struct bvhd_error *error)
{
    struct bytes first;
    enum bvhd_status status = blob_at(buffer, 0, &first, error);
    if (status != BVHD_OK)
        return status;
    memset(ret_scene, 0, sizeof *ret_scene);
    ret_scene->memory = memory;
    status = portable_open(first, memory, &ret_scene->top, error);
    if (status != BVHD_OK)
        return status;
    if (ret_scene->top.header->content == PORTABLE_INSTANCES) {
        status = open_top(buffer, first.size, ret_scene, error);
    } else {
        ret_scene->bottoms = memory_array(memory, 1, sizeof *ret_scene->bottoms);
        if (!ret_scene->bottoms)
            return bvhd_error_set(error, BVHD_NO_MEMORY, "scene", "no memory for a view");
        ret_scene->bottoms[0] = &ret_scene->top;
        ret_scene->scene = (struct scene){NULL, ret_scene->bottoms, 1};
    }
    if (status != BVHD_OK)
        portable_scene_finish(ret_scene);
    return status;
}

void portable_scene_finish(struct portable_scene *scene)
{
    if (!scene || !scene->memory)
        return;
    memory_free(scene->memory, scene->views);
    memory_free(scene->memory, scene->bottoms);
    memset(scene, 0, sizeof *scene);
}
