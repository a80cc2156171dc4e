/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/disk.h"

#include "builder/content_key.h"
#include "builder/store/generation.h"
#include "builder/summary.h"
#include "daemon/service/disk_writer.h"
#include "proto/base/container_of.h"
#include "proto/base/request_limits.h"
#include "proto/wire/control.h"

enum { READY_IDLE_MS = 500 };

struct disk {
    struct store *store;
    struct disk_writer *writer;
    struct ready_memfds *ready; /* for entries that are read */
    struct blob_account *account;
    atomic_bool closing; /* ends long calls of the store */
    _Atomic uint64_t read_errors;
};

/* Each call of the store may open some. Those of the writer are taken for as long as it lives. */
static bool take_descriptors(struct blob_account *account, struct bvhd_error *error)
{
    if (descriptors_take(account->descriptors, STORE_DESCRIPTORS, DESCRIPTORS_RESERVE))
        return true;
    bvhd_error_set(error, BVHD_BUSY, "cache", "too many open descriptors");
    return false;
}

static void give_descriptors(struct blob_account *account)
{
    descriptors_give(account->descriptors, STORE_DESCRIPTORS);
}

/* The directory is told to clients whole, or not used. */
static enum bvhd_status check_length(const struct disk *disk, struct bvhd_error *error)
{
    size_t length = strlen(store_directory(disk->store));
    if (length < CONTROL_PATH_SIZE)
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_TOO_LARGE, "cache", "its absolute path has %zu bytes, over %d", length,
                          CONTROL_PATH_SIZE - 1);
}

/* To prepare takes as long as to read, so there is time for it while at most half of the readers read. */
static enum bvhd_status create_ready(struct disk *disk, const struct disk_options *options, struct bvhd_error *error)
{
    const struct ready_options ready = {
        .memory = disk->account->memory,
        .descriptors = disk->account->descriptors,
        .budget = options->ready,
        .most_readers = options->readers / 2,
        .idle_ms = READY_IDLE_MS,
    };
    return ready_memfds_create(&ready, &disk->ready, error);
}

enum bvhd_status disk_open(const struct disk_options *options, struct blob_account *account, struct disk **ret_disk,
                           struct bvhd_error *error)
{
    struct disk *disk = memory_alloc(account->memory, sizeof *disk);
    if (!disk)
        return bvhd_error_no_memory(error, "cache", "no memory for the cache on disk");
    if (!take_descriptors(account, error)) {
        memory_free(account->memory, disk);
        return error->status;
    }
    *disk = (struct disk){.account = account};
    const struct store_options store = {
        .directory = options->directory,
        .generation = store_generation(),
        .budget = options->budget,
        .keep_free = STORE_KEEP_FREE_DEFAULT,
        .cancel = &disk->closing,
    };
    enum bvhd_status status = store_open(&store, account->memory, &disk->store, error);
    if (status == BVHD_OK)
        status = check_length(disk, error);
    if (status == BVHD_OK)
        status = disk_writer_create(disk->store, options->queue, account->memory, &disk->writer, error);
    if (status == BVHD_OK)
        status = create_ready(disk, options, error);
    if (status == BVHD_OK)
        *ret_disk = disk;
    else
        disk_close(disk);
    return status;
}

void disk_close(struct disk *disk)
{
    if (!disk)
        return;
    atomic_store_explicit(&disk->closing, true, memory_order_relaxed);
    disk_writer_destroy(disk->writer, DISK_CLOSE_MS);
    store_close(disk->store);
    ready_memfds_destroy(disk->ready);
    give_descriptors(disk->account);
    memory_free(disk->account->memory, disk);
}

/* ---- reading ---- */

/* One entry that is read into a blob. */
struct reading {
    struct store_sink sink;
    const atomic_bool *cancel;
    struct ready_memfds *ready;
    struct blob_writer writer;
    struct summary summary;
    uint64_t room; /* the most bytes that are read */
    uint64_t size; /* of the result */
};

static struct reading *reading_of(struct store_sink *sink)
{
    return container_of(sink, struct reading, sink);
}

static enum bvhd_status begin(struct store_sink *sink, const struct store_entry *entry, struct bvhd_error *error)
{
    struct reading *reading = reading_of(sink);
    if (entry->summary.size == 0)
        return bvhd_error_set(error, BVHD_NOT_FOUND, "summary", "the entry is the record of a result");
    enum bvhd_status status = summary_read(entry->summary, &reading->summary, error);
    if (status == BVHD_OK && entry->size == 0)
        status = bvhd_error_set(error, BVHD_CORRUPT, "size", "an empty result");
    reading->size = entry->size;
    if (status == BVHD_OK && entry->size > reading->room)
        status = bvhd_error_set(error, BVHD_TOO_LARGE, "size", "there is no room for the result");
    return status == BVHD_OK ? blob_writer_begin(&reading->writer, entry->size, reading->ready, error) : status;
}

static unsigned char *room(struct store_sink *sink, uint64_t size)
{
    return blob_writer_room(&reading_of(sink)->writer, size);
}

static enum bvhd_status append(struct store_sink *sink, const void *bytes, uint64_t size, struct bvhd_error *error)
{
    struct reading *reading = reading_of(sink);
    if (atomic_load_explicit(reading->cancel, memory_order_relaxed))
        return bvhd_error_set(error, BVHD_CANCELLED, "", "cancelled");
    return blob_writer_append(&reading->writer, bytes, size, error);
}

static enum bvhd_status finish(struct reading *reading, const struct key *key, struct blob **ret_blob,
                               struct bvhd_error *error)
{
    struct blob *blob;
    enum bvhd_status status = blob_writer_finish(&reading->writer, &blob, error);
    if (status != BVHD_OK)
        return status;
    blob->key = *key;
    blob->summary = reading->summary;
    blob->is_from_disk = true;
    *ret_blob = blob;
    return BVHD_OK;
}

static enum bvhd_status read_entry(struct disk *disk, const struct key *key, const struct parallel *parallel,
                                   struct reading *reading, struct blob **ret_blob, struct bvhd_error *error)
{
    reading->sink = (struct store_sink){begin, room, append};
    reading->ready = disk->ready;
    blob_writer_init(&reading->writer, disk->account);
    enum bvhd_status status = store_get(disk->store, key, parallel, &reading->sink, error);
    if (status == BVHD_OK)
        return finish(reading, key, ret_blob, error);
    blob_writer_discard(&reading->writer);
    return status;
}

static enum bvhd_status end_reading(struct disk *disk, enum bvhd_status status)
{
    if (status != BVHD_OK && status != BVHD_NOT_FOUND && status != BVHD_CANCELLED && status != BVHD_TOO_LARGE)
        atomic_fetch_add_explicit(&disk->read_errors, 1, memory_order_relaxed);
    return status;
}

static enum bvhd_status read_result(struct disk *disk, const struct key *key, const struct parallel *parallel,
                                    struct reading *reading, struct blob **ret_blob, struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_BUSY;
    if (take_descriptors(disk->account, error)) {
        ready_memfds_enter(disk->ready);
        status = read_entry(disk, key, parallel, reading, ret_blob, error);
        ready_memfds_leave(disk->ready);
        give_descriptors(disk->account);
    }
    return end_reading(disk, status);
}

enum bvhd_status disk_read(struct disk *disk, const struct key *key, const struct parallel *parallel,
                           const atomic_bool *cancel, struct blob **ret_blob, struct bvhd_error *error)
{
    struct reading reading = {.cancel = cancel, .room = UINT64_MAX};
    return read_result(disk, key, parallel, &reading, ret_blob, error);
}

enum bvhd_status disk_read_within(struct disk *disk, const struct key *key, const atomic_bool *cancel,
                                  struct disk_result *result, struct bvhd_error *error)
{
    struct reading reading = {.cancel = cancel, .room = result->room};
    result->blob = NULL;
    enum bvhd_status status = read_result(disk, key, &parallel_serial, &reading, &result->blob, error);
    result->size = reading.size;
    return status;
}

void disk_rest(struct disk *disk)
{
    ready_memfds_prepare(disk->ready);
}

/* ---- records ---- */

/* One record that is read. */
struct record_reading {
    struct store_sink sink;
    const atomic_bool *cancel;
    struct disk_record *record;
    unsigned char *bytes;
    uint64_t size, filled;
};

/* A record has a bit for each primitive and a row for each geometry, so that no larger entry is one. */
static bool may_be_record(const struct store_entry *entry)
{
    const uint64_t most = ((uint64_t)LIMIT_MAX_GEOMETRIES + 1) * 128 + LIMIT_MAX_PRIMITIVES / 8;
    return entry->summary.size == 0 && entry->size > 0 && entry->size <= most;
}

static enum bvhd_status begin_record(struct store_sink *sink, const struct store_entry *entry, struct bvhd_error *error)
{
    struct record_reading *reading = container_of(sink, struct record_reading, sink);
    if (!may_be_record(entry))
        return bvhd_error_set(error, BVHD_CORRUPT, "record", "the entry is none");
    if (entry->size > reading->record->room) {
        reading->record->size = entry->size;
        return bvhd_error_set(error, BVHD_TOO_LARGE, "record", "there is no room for it");
    }
    reading->bytes = memory_alloc(reading->record->memory, entry->size);
    reading->size = entry->size;
    return reading->bytes ? BVHD_OK : bvhd_error_no_memory(error, "record", "no memory to read it");
}

static unsigned char *room_of_record(struct store_sink *sink, uint64_t size)
{
    const struct record_reading *reading = container_of(sink, struct record_reading, sink);
    return size <= reading->size - reading->filled ? reading->bytes + reading->filled : NULL;
}

static enum bvhd_status append_record(struct store_sink *sink, const void *bytes, uint64_t size,
                                      struct bvhd_error *error)
{
    struct record_reading *reading = container_of(sink, struct record_reading, sink);
    if (atomic_load_explicit(reading->cancel, memory_order_relaxed))
        return bvhd_error_set(error, BVHD_CANCELLED, "", "cancelled");
    if (bytes != reading->bytes + reading->filled)
        memcpy(reading->bytes + reading->filled, bytes, size);
    reading->filled += size;
    return BVHD_OK;
}

static enum bvhd_status read_record(struct disk *disk, const struct key *key, struct record_reading *reading,
                                    struct bvhd_error *error)
{
    struct key own;
    enum bvhd_status status = content_key_of_record(key, &own, error);
    if (status == BVHD_OK)
        status = store_get(disk->store, &own, &parallel_serial, &reading->sink, error);
    if (status != BVHD_OK)
        memory_free(reading->record->memory, reading->bytes);
    return status;
}

enum bvhd_status disk_read_record(struct disk *disk, const struct key *key, const atomic_bool *cancel,
                                  struct disk_record *record, struct bvhd_error *error)
{
    struct record_reading reading = {
        .sink = {begin_record, room_of_record, append_record}, .cancel = cancel, .record = record};
    enum bvhd_status status = BVHD_BUSY;
    if (take_descriptors(disk->account, error)) {
        status = read_record(disk, key, &reading, error);
        give_descriptors(disk->account);
    }
    if (status == BVHD_OK)
        record->bytes = (struct bytes){reading.bytes, reading.size};
    return end_reading(disk, status);
}

/* ---- the rest ---- */

void disk_keep(struct disk *disk, struct blob *blob)
{
    disk_writer_add(disk->writer, blob);
}

enum bvhd_status disk_trim(struct disk *disk, uint64_t bytes, struct bvhd_error *error)
{
    if (!take_descriptors(disk->account, error))
        return error->status;
    disk_writer_flush(disk->writer);
    enum bvhd_status status = store_trim_to(disk->store, bytes, error);
    give_descriptors(disk->account);
    return status;
}

enum bvhd_status disk_clear(struct disk *disk, struct bvhd_error *error)
{
    if (!take_descriptors(disk->account, error))
        return error->status;
    disk_writer_flush(disk->writer);
    enum bvhd_status status = store_clear(disk->store, error);
    give_descriptors(disk->account);
    return status;
}

struct disk_state disk_state(const struct disk *disk)
{
    struct disk_writer_load load = disk_writer_load(disk->writer);
    return (struct disk_state){
        .store = store_state(disk->store),
        .read_errors = atomic_load_explicit(&disk->read_errors, memory_order_relaxed),
        .dropped = load.dropped,
        .queued = load.queued,
        .queued_bytes = load.queued_bytes,
        .ready_bytes = ready_memfds_load(disk->ready).bytes,
    };
}

const char *disk_directory(const struct disk *disk)
{
    return store_directory(disk->store);
}
