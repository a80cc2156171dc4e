/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/micromap_source.h"

#include <stdlib.h>
#include <sys/mman.h>

#include "builder/format/portable_micromap.h"
#include "proto/base/place.h"

static bool is_micromap(const struct reference *reference)
{
    return reference->kind == REFERENCE_MICROMAP && reference->has_key;
}

static uint32_t count_named(const struct build_input *input)
{
    uint32_t count = 0;
    for (uint32_t i = 0; input->type == STRUCTURE_BOTTOM && i < input->reference_count; i++)
        count += is_micromap(&input->references[i]);
    return count;
}

bool micromap_sources_are_named(const struct build_input *input)
{
    return count_named(input) > 0;
}

static int compare(const void *a, const void *b)
{
    return memcmp(((const struct micromap_source *)a)->key.bytes, ((const struct micromap_source *)b)->key.bytes,
                  KEY_SIZE);
}

/* Returns how many rows are left when each key is there once. */
static uint32_t keep_one_each(struct micromap_source *rows, uint32_t count)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++)
        if (kept == 0 || !key_equal(&rows[kept - 1].key, &rows[i].key))
            rows[kept++] = rows[i];
    return kept;
}

enum bvhd_status micromap_sources_list(struct micromap_sources *sources, const struct build_input *input,
                                       uint32_t index, struct bvhd_error *error)
{
    const uint32_t count = count_named(input);
    struct place where = place("infos[%u].references", index);
    uint32_t listed = 0;
    if (count > MICROMAP_SOURCES_MOST)
        return bvhd_error_set(error, BVHD_TOO_LARGE, where.text, "%u opacity micromaps, at most %d", count,
                              MICROMAP_SOURCES_MOST);
    struct micromap_source *rows = memory_array(sources->memory, count, sizeof *rows);
    if (!rows)
        return bvhd_error_no_memory(error, where.text, "no memory for the keys of opacity micromaps");
    for (uint32_t i = 0; i < input->reference_count; i++)
        if (is_micromap(&input->references[i]))
            rows[listed++] = (struct micromap_source){.key = input->references[i].key};
    qsort(rows, listed, sizeof *rows, compare);
    sources->rows = rows;
    sources->count = keep_one_each(rows, listed);
    return BVHD_OK;
}

static void take_blob(void *context, struct blob *blob)
{
    struct micromap_source *row = context;
    row->blob = blob ? blob_ref(blob) : NULL;
}

void micromap_sources_look_up(struct micromap_sources *sources, struct cache *cache)
{
    for (uint32_t i = 0; i < sources->count; i++)
        if (!sources->rows[i].blob)
            cache_get(cache, &sources->rows[i].key, take_blob, &sources->rows[i]);
}

static bool is_shortage_or_cancelled(enum bvhd_status status)
{
    return status == BVHD_NO_MEMORY || status == BVHD_BUSY || status == BVHD_CANCELLED;
}

/* Bytes that are found are added to *size. */
static enum bvhd_status read_row(const struct micromap_sources *sources, struct micromap_source *row, uint64_t room,
                                 const atomic_bool *cancel, uint64_t *size, struct bvhd_error *error)
{
    struct disk_result result = {.room = *size < room ? room - *size : 0};
    enum bvhd_status status = disk_read_within(sources->disk, &row->key, cancel, &result, error);
    if (is_shortage_or_cancelled(status))
        return status;
    if ((status == BVHD_OK || status == BVHD_TOO_LARGE) && !bytes_add(*size, result.size, size))
        *size = UINT64_MAX;
    row->blob = result.blob;
    row->is_read = status == BVHD_OK;
    return BVHD_OK;
}

/* What is in memory comes first, so that each of those on disk is read only where there is room for it. */
enum bvhd_status micromap_sources_read(struct micromap_sources *sources, uint64_t room, const atomic_bool *cancel,
                                       uint64_t *ret_size, struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    uint64_t size = 0;
    for (uint32_t i = 0; i < sources->count; i++)
        size += sources->rows[i].blob ? sources->rows[i].blob->size : 0;
    for (uint32_t i = 0; i < sources->count && status == BVHD_OK && sources->disk; i++)
        if (!sources->rows[i].blob)
            status = read_row(sources, &sources->rows[i], room, cancel, &size, error);
    if (status == BVHD_OK)
        *ret_size = size;
    return status;
}

/* Maps a row's blob unless its bytes lie in memory. */
static bool map(struct micromap_source *row)
{
    const struct blob *blob = row->blob;
    if (!blob || blob->descriptor < 0 || row->mapped)
        return true;
    void *mapped = mmap(NULL, blob->size, PROT_READ, MAP_PRIVATE, blob->descriptor, 0);
    row->mapped = mapped == MAP_FAILED ? NULL : mapped;
    return row->mapped;
}

static struct bytes bytes_of(const struct micromap_sources *sources, const struct key *key)
{
    const struct micromap_source wanted = {.key = *key};
    const struct micromap_source *row =
        sources->count > 0 ? bsearch(&wanted, sources->rows, sources->count, sizeof wanted, compare) : NULL;
    if (!row || !row->blob)
        return (struct bytes){NULL, 0};
    return (struct bytes){row->mapped ? row->mapped : row->blob->bytes, row->blob->size};
}

/* Other structures have other bytes there; prepare() checks all of a micromap. */
static bool is_other_structure(struct bytes blob)
{
    return blob.data && (blob.size < PORTABLE_MICROMAP_BODY + sizeof(struct portable_micromap_header) ||
                         bytes_get32(blob.data + PORTABLE_MICROMAP_BODY) != PORTABLE_MICROMAP_MAGIC);
}

static enum bvhd_status open_all(struct micromap_sources *sources, struct reference *references, uint32_t count,
                                 uint32_t index, struct bvhd_error *error)
{
    for (uint32_t i = 0; i < sources->count; i++)
        if (!map(&sources->rows[i]))
            return bvhd_error_no_memory(error, place("infos[%u].references", index).text,
                                        "no address space for opacity micromaps");
    for (uint32_t i = 0; i < count; i++) {
        if (!is_micromap(&references[i]))
            continue;
        references[i].blob = bytes_of(sources, &references[i].key);
        if (is_other_structure(references[i].blob))
            return bvhd_error_set(error, BVHD_INVALID, place("infos[%u].references[%u]", index, i).text,
                                  "the key is that of a structure which is no opacity micromap");
    }
    return BVHD_OK;
}

enum bvhd_status micromap_sources_open(struct micromap_sources *sources, struct reference *references, uint32_t count,
                                       uint32_t index, struct bvhd_error *error)
{
    enum bvhd_status status = open_all(sources, references, count, index, error);
    if (status != BVHD_OK)
        micromap_sources_close(sources);
    return status;
}

void micromap_sources_close(struct micromap_sources *sources)
{
    for (uint32_t i = 0; i < sources->count; i++) {
        struct micromap_source *row = &sources->rows[i];
        if (row->mapped)
            munmap((void *)(uintptr_t)row->mapped, row->blob->size);
        row->mapped = NULL;
    }
}

static void drop(struct micromap_source *row)
{
    blob_unref(row->blob);
    row->blob = NULL;
    row->is_read = false;
}

void micromap_sources_keep(struct micromap_sources *sources, struct cache *cache)
{
    for (uint32_t i = 0; i < sources->count; i++) {
        if (sources->rows[i].is_read)
            cache_put(cache, sources->rows[i].blob);
        drop(&sources->rows[i]);
    }
}

void micromap_sources_finish(struct micromap_sources *sources)
{
    for (uint32_t i = 0; i < sources->count; i++)
        drop(&sources->rows[i]);
    memory_free(sources->memory, sources->rows);
    sources->rows = NULL;
    sources->count = 0;
}
