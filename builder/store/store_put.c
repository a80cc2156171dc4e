/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/store/store_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <sys/file.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include "builder/store/entry_header.h"

/* A file that is being written. */
struct writing {
    struct store *store;
    const struct store_entry *entry;
    struct bytes payload;
    char name[KEY_TEXT_SIZE], temporary[32];
    int shard, file; /* -1: not open */
    struct bvhd_error *error;
};

static enum bvhd_status failed(const struct writing *writing, const char *what)
{
    return store_failed(writing->store, writing->name, what, writing->error);
}

static uint64_t file_size(const struct store_entry *entry)
{
    return ENTRY_HEADER + entry->summary.size + entry->size;
}

static enum bvhd_status open_new(struct writing *writing)
{
    uint64_t number;
    if (getrandom(&number, sizeof number, 0) != sizeof number)
        return failed(writing, "choosing a name for the file");
    snprintf(writing->temporary, sizeof writing->temporary, STORE_TEMPORARY "%016" PRIx64, number);
    writing->file = openat(writing->shard, writing->temporary, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC,
                           S_IRUSR | S_IWUSR);
    return writing->file >= 0 ? BVHD_OK : failed(writing, "making the file");
}

/*
 * Makes an empty file under a name of its own, and locks it as long as this process lives, by which store_scan knows
 * that it is not left over. A scan may find it before it is locked, and remove it: then another one is made. Where
 * there are no locks, files that are left over stay.
 */
static enum bvhd_status make_file(struct writing *writing)
{
    struct stat about;
    for (int tries = 0; tries < 8; tries++) {
        enum bvhd_status status = open_new(writing);
        if (status != BVHD_OK)
            return status;
        flock(writing->file, LOCK_EX); /* a scan holds the lock for a moment only */
        if (fstat(writing->file, &about) != 0 || about.st_nlink > 0)
            return BVHD_OK;
        close(writing->file);
        writing->file = -1;
    }
    errno = EBUSY;
    return failed(writing, "making the file");
}

/* Reserves the room, so that a full disk is found before anything is written. Some file systems cannot do that. */
static enum bvhd_status reserve(const struct writing *writing)
{
    int result;
    do {
        result = fallocate(writing->file, 0, 0, (off_t)file_size(writing->entry));
    } while (result != 0 && errno == EINTR);
    return result == 0 || errno == EOPNOTSUPP ? BVHD_OK : failed(writing, "reserving room");
}

static enum bvhd_status write_at(const struct writing *writing, uint64_t offset, struct bytes bytes)
{
    for (uint64_t done = 0; done < bytes.size;) {
        ssize_t count = pwrite(writing->file, bytes.data + done, bytes.size - done, (off_t)(offset + done));
        if (count > 0)
            done += (uint64_t)count;
        else if (count == 0 || errno != EINTR)
            return failed(writing, "writing");
    }
    return BVHD_OK;
}

/* Hashes and writes the payload in pieces, and its header last. */
static enum bvhd_status write_bytes(const struct writing *writing)
{
    const struct store_entry *entry = writing->entry;
    unsigned char header[ENTRY_HEADER];
    struct entry_hash hash;
    entry_header_write(entry, header);
    if (!entry_hash_begin(&hash, header))
        return bvhd_error_no_memory(writing->error, writing->name, "no memory for a checksum");
    entry_hash_add(&hash, entry->summary);
    enum bvhd_status status = write_at(writing, ENTRY_HEADER, entry->summary);
    for (uint64_t at = 0; status == BVHD_OK && at < entry->size; at += STORE_PIECE) {
        uint64_t left = entry->size - at;
        struct bytes piece = {writing->payload.data + at, left < STORE_PIECE ? left : STORE_PIECE};
        entry_hash_add(&hash, piece);
        status = write_at(writing, ENTRY_HEADER + entry->summary.size + at, piece);
    }
    entry_header_seal(header, entry_hash_get(&hash));
    entry_hash_finish(&hash);
    return status == BVHD_OK ? write_at(writing, 0, (struct bytes){header, ENTRY_HEADER}) : status;
}

/* Gives the file its name once its bytes are on the disk, and writes the name to the disk, too. */
static enum bvhd_status publish(const struct writing *writing)
{
    if (fdatasync(writing->file) != 0)
        return failed(writing, "syncing");
    struct stat before;
    bool replaces = fstatat(writing->shard, writing->name, &before, AT_SYMLINK_NOFOLLOW) == 0;
    if (renameat(writing->shard, writing->temporary, writing->shard, writing->name) != 0)
        return failed(writing, "naming");
    struct store *store = writing->store;
    uint64_t size = store_bytes_of(file_size(writing->entry));
    store_estimate(&store->bytes, (int64_t)size - (replaces ? (int64_t)store_bytes_of((uint64_t)before.st_size) : 0));
    store_estimate(&store->entries, replaces ? 0 : 1);
    store_estimate(&store->written_since, (int64_t)size);
    return fsync(writing->shard) == 0 ? BVHD_OK : failed(writing, "syncing the folder");
}

static enum bvhd_status write_file(struct writing *writing)
{
    writing->shard = store_shard_open(writing->store, &writing->entry->key, true, writing->name);
    if (writing->shard < 0)
        return failed(writing, "making the folder");
    enum bvhd_status status = make_file(writing);
    if (status == BVHD_OK)
        status = reserve(writing);
    if (status == BVHD_OK)
        status = write_bytes(writing);
    if (status == BVHD_OK)
        status = publish(writing);
    if (status != BVHD_OK && writing->file >= 0)
        unlinkat(writing->shard, writing->temporary, 0);
    if (writing->file >= 0)
        close(writing->file);
    close(writing->shard);
    return status;
}

static enum bvhd_status check(const struct store *store, const struct store_entry *entry, struct bvhd_error *error)
{
    if (entry->summary.size > STORE_SUMMARY_MAX || entry->size > store->budget / 8)
        return bvhd_error_set(error, BVHD_TOO_LARGE, store->directory,
                              "%" PRIu64 " bytes are more than an eighth of the cache's %" PRIu64, entry->size,
                              store->budget);
    if (geteuid() != store->owner)
        return bvhd_error_set(error, BVHD_INVALID, store->directory, "only its owner, user %u, writes to the cache",
                              (unsigned)store->owner);
    return BVHD_OK;
}

enum bvhd_status store_put(struct store *store, const struct store_entry *entry, const void *payload,
                           struct bvhd_error *error)
{
    struct writing writing = {
        .store = store, .entry = entry, .payload = {payload, entry->size}, .shard = -1, .file = -1, .error = error};
    enum bvhd_status status = check(store, entry, error);
    if (status == BVHD_OK)
        status = store_make_room(store, file_size(entry), error);
    if (status == BVHD_OK)
        status = write_file(&writing);
    atomic_fetch_add_explicit(status == BVHD_OK ? &store->written : &store->write_errors, 1, memory_order_relaxed);
    return status;
}
