/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/service/local_cache.h"

#include <stdlib.h>
#include <string.h>

#include "builder/content_key.h"
#include "builder/store/generation.h"
#include "builder/store/store.h"
#include "builder/update/batch.h"
#include "client/bvhctl/base/report.h"
#include "client/bvhctl/service/cache_place.h"
#include "proto/base/container_of.h"

/* A copy of a result, or of its record, that is to be written. */
struct local_cache_entry {
    struct local_cache_entry *next;
    struct key key;
    unsigned char summary[SUMMARY_SIZE];
    uint64_t summary_size; /* 0: it is a record */
    uint64_t size;
    unsigned char *bytes;
    struct bvhd_error error; /* why it was not written; BVHD_OK if it was */
};

struct local_cache {
    struct batch_cache cache;
    struct memory memory; /* of the store and of the copies */
    const struct parallel *parallel;
    struct store *store;
    struct local_cache_entry *pending; /* the entries that were not written yet */
    uint64_t pending_count, pending_bytes;
};

/* Takes an entry of the store into a new block. */
struct reading {
    struct store_sink sink;
    struct memory *memory;
    bool is_record;
    struct summary summary; /* of a result */
    unsigned char *bytes;
    uint64_t at;
};

static enum bvhd_status begin(struct store_sink *sink, const struct store_entry *entry, struct bvhd_error *error)
{
    struct reading *reading = container_of(sink, struct reading, sink);
    enum bvhd_status status = BVHD_OK;
    if ((entry->summary.size == 0) != reading->is_record)
        return bvhd_error_set(error, BVHD_NOT_FOUND, "summary", "the entry is %s",
                              reading->is_record ? "no record" : "the record of a result");
    if (!reading->is_record)
        status = summary_read(entry->summary, &reading->summary, error);
    if (status != BVHD_OK)
        return status;
    reading->bytes = memory_alloc(reading->memory, entry->size);
    return reading->bytes ? BVHD_OK : bvhd_error_no_memory(error, "cache", "no memory for a result on disk");
}

static unsigned char *room(struct store_sink *sink, uint64_t size)
{
    const struct reading *reading = container_of(sink, struct reading, sink);
    (void)size;
    return reading->bytes + reading->at;
}

static enum bvhd_status take(struct store_sink *sink, const void *bytes, uint64_t size, struct bvhd_error *error)
{
    struct reading *reading = container_of(sink, struct reading, sink);
    (void)error;
    if (bytes != reading->bytes + reading->at)
        memcpy(reading->bytes + reading->at, bytes, size);
    reading->at += size;
    return BVHD_OK;
}

/* After a failure it holds no memory. */
static bool read_entry(struct local_cache *cache, const struct key *key, struct reading *reading)
{
    struct bvhd_error error;
    reading->sink = (struct store_sink){begin, room, take};
    enum bvhd_status status = store_get(cache->store, key, &parallel_serial, &reading->sink, &error);
    if (status == BVHD_OK)
        return true;
    memory_free(reading->memory, reading->bytes);
    if (status != BVHD_NOT_FOUND)
        report_detail("build", "a result on disk cannot be read: %s: %s", error.where, error.text);
    return false;
}

static bool read_record(struct local_cache *cache, const struct key *key, struct memory *memory,
                        struct bytes *ret_record)
{
    struct reading reading = {.memory = memory, .is_record = true};
    struct record record;
    struct key own;
    if (content_key_of_record(key, &own, NULL) != BVHD_OK || !read_entry(cache, &own, &reading))
        return false;
    *ret_record = (struct bytes){reading.bytes, reading.at};
    if (record_open(*ret_record, &record, NULL) == BVHD_OK)
        return true;
    memory_free(memory, reading.bytes);
    return false;
}

static bool get(struct batch_cache *batch, const struct key *key, bool wants_record, struct memory *memory,
                struct batch_cached *ret_cached)
{
    struct local_cache *cache = container_of(batch, struct local_cache, cache);
    struct reading reading = {.memory = memory};
    struct bytes record = {NULL, 0};
    if (wants_record && !read_record(cache, key, memory, &record))
        return false;
    if (!read_entry(cache, key, &reading)) {
        memory_free(memory, (void *)(uintptr_t)record.data);
        return false;
    }
    *ret_cached = (struct batch_cached){reading.bytes, reading.at, record, reading.summary};
    return true;
}

static void write_entry(struct local_cache *cache, struct local_cache_entry *entry)
{
    const struct store_entry stored = {entry->key, {entry->summary, entry->summary_size}, entry->size};
    if (store_put(cache->store, &stored, entry->bytes, &entry->error) == BVHD_OK)
        entry->error.status = BVHD_OK;
}

/* The entries that several threads write. */
struct writing {
    struct local_cache *cache;
    struct local_cache_entry **entries;
};

static void write_task(void *context, size_t index)
{
    const struct writing *writing = context;
    write_entry(writing->cache, writing->entries[index]);
}

static void write_entries(struct local_cache *cache)
{
    uint64_t count = 0;
    struct writing writing = {cache, memory_array(&cache->memory, cache->pending_count, sizeof *writing.entries)};
    for (struct local_cache_entry *entry = cache->pending; entry; entry = entry->next)
        if (writing.entries)
            writing.entries[count++] = entry;
        else
            write_entry(cache, entry);
    parallel_for(cache->parallel, count, write_task, &writing);
    memory_free(&cache->memory, writing.entries);
}

/* Writes and frees the copies. One message is enough for a disk that is full. */
static void flush(struct local_cache *cache)
{
    uint64_t failed = 0;
    struct bvhd_error error = {0};
    write_entries(cache);
    while (cache->pending) {
        struct local_cache_entry *entry = cache->pending;
        cache->pending = entry->next;
        if (entry->error.status != BVHD_OK && entry->error.status != BVHD_TOO_LARGE && failed++ == 0)
            error = entry->error;
        memory_free(&cache->memory, entry->bytes);
        memory_free(&cache->memory, entry);
    }
    cache->pending_count = cache->pending_bytes = 0;
    if (failed)
        report_note("build", "%llu results are not kept on disk: %s: %s", (unsigned long long)failed, error.where,
                    error.text);
}

/* Queues a copy; without memory for it the bytes are not kept. `summary` is NULL for a record. */
static void add(struct local_cache *cache, const struct key *key, struct bytes bytes, const struct summary *summary)
{
    if (cache->pending_bytes + bytes.size > LOCAL_CACHE_PENDING)
        flush(cache);
    struct local_cache_entry *entry = memory_alloc(&cache->memory, sizeof *entry);
    unsigned char *copy = memory_alloc(&cache->memory, bytes.size);
    if (!entry || !copy) {
        memory_free(&cache->memory, entry);
        memory_free(&cache->memory, copy);
        report_detail("build", "a result is not kept on disk: no memory for a copy");
        return;
    }
    *entry = (struct local_cache_entry){.next = cache->pending, .key = *key, .size = bytes.size, .bytes = copy};
    memcpy(copy, bytes.data, bytes.size);
    if (summary) {
        summary_write(summary, entry->summary);
        entry->summary_size = SUMMARY_SIZE;
    }
    cache->pending = entry;
    cache->pending_count++;
    cache->pending_bytes += bytes.size;
}

static void put(struct batch_cache *batch, const struct key *key, struct bytes blob, struct bytes record,
                const struct summary *summary)
{
    struct local_cache *cache = container_of(batch, struct local_cache, cache);
    struct key own;
    add(cache, key, blob, summary);
    if (record.size > 0 && content_key_of_record(key, &own, NULL) == BVHD_OK)
        add(cache, &own, record, NULL);
}

/* If a directory that the user did not name cannot be used, that is no error. */
static enum bvhd_status open_store(struct local_cache *cache, const struct options *options, const char *directory,
                                   struct bvhd_error *error)
{
    const struct store_options place = {.directory = directory,
                                        .generation = store_generation(),
                                        .budget = options->disk_cache_size,
                                        .keep_free = STORE_KEEP_FREE_DEFAULT};
    enum bvhd_status status = store_open(&place, &cache->memory, &cache->store, error);
    if (status == BVHD_OK || options->cache)
        return status;
    report_detail("build", "results are not kept on disk: %s: %s", error->where, error->text);
    return BVHD_OK;
}

enum bvhd_status local_cache_open(const struct options *options, const struct parallel *parallel,
                                  struct local_cache **ret_cache, struct bvhd_error *error)
{
    char *directory = NULL;
    struct local_cache *cache = calloc(1, sizeof *cache);
    if (!cache)
        return bvhd_error_no_memory(error, "cache", "no memory for the cache on disk");
    cache->cache = (struct batch_cache){get, put};
    cache->parallel = parallel;
    memory_init(&cache->memory, UINT64_MAX);
    enum bvhd_status status = cache_place_find(options, &cache->memory, &directory, error);
    if (status == BVHD_OK && directory)
        status = open_store(cache, options, directory, error);
    memory_free(&cache->memory, directory);
    if (!cache->store) {
        free(cache);
        cache = NULL;
    }
    if (status == BVHD_OK)
        *ret_cache = cache;
    return status;
}

struct batch_cache *local_cache_of(struct local_cache *cache)
{
    return cache ? &cache->cache : NULL;
}

void local_cache_close(struct local_cache *cache)
{
    if (!cache)
        return;
    flush(cache);
    struct store_state state = store_state(cache->store);
    if (state.damaged)
        report_note("build", "%llu damaged results in %s were set aside and built again",
                    (unsigned long long)state.damaged, store_directory(cache->store));
    store_close(cache->store);
    free(cache);
}
