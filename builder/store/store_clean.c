/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/store/store_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

#include "builder/store/victims.h"
#include "builder/store/walk.h"
#include "proto/base/container_of.h"

/* A file without a name to come is left over when nobody holds its lock: its writer has ended. */
static void remove_left_over(const struct walk_file *file)
{
    int descriptor = openat(file->descriptor, file->name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (descriptor < 0)
        return;
    if (flock(descriptor, LOCK_EX | LOCK_NB) == 0)
        unlinkat(file->descriptor, file->name, 0);
    close(descriptor);
}

/* Counts the files of a directory and collects the oldest ones. */
struct counting {
    struct walk walk;
    struct victims *victims; /* NULL: none are collected */
    int64_t now_ns; /* since the epoch */
    uint64_t entries, bytes;
};

/*
 * Collects a file. A time in the future comes from a clock that was wrong: such files would stay for as long as the
 * clock was ahead, so they count as older than all others. The ones that are used get a new time anyway.
 */
static void collect(struct counting *counting, const struct walk_file *file)
{
    const int64_t hour_ns = INT64_C(3600) * 1000000000;
    struct walk_file collected = *file;
    if (file->used_ns > counting->now_ns + hour_ns)
        collected.used_ns -= INT64_C(1) << 62;
    victims_offer(counting->victims, &collected);
}

static enum bvhd_status count_file(struct walk *walk, const struct walk_file *file, struct bvhd_error *error)
{
    struct counting *counting = container_of(walk, struct counting, walk);
    (void)error;
    if (file->kind == WALK_TEMPORARY) {
        remove_left_over(file);
        return BVHD_OK;
    }
    counting->entries += file->kind == WALK_ENTRY;
    counting->bytes += file->bytes;
    if (counting->victims)
        collect(counting, file);
    return BVHD_OK;
}

/* Replaces the estimates by what is counted, and adds what other threads have changed in the meantime. */
static enum bvhd_status count(struct store *store, struct victims *victims, struct bvhd_error *error)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    struct counting counting = {
        .walk = {.visit = count_file}, .victims = victims, .now_ns = now.tv_sec * INT64_C(1000000000) + now.tv_nsec};
    uint64_t entries = atomic_load(&store->entries), bytes = atomic_load(&store->bytes);
    atomic_store(&store->written_since, 0);
    atomic_store(&store->patience, store->budget / STORE_RECOUNT);
    enum bvhd_status status = walk_run(&counting.walk, store, error);
    if (status != BVHD_OK)
        return status;
    store_estimate(&store->entries, (int64_t)(counting.entries - entries));
    store_estimate(&store->bytes, (int64_t)(counting.bytes - bytes));
    atomic_store(&store->counted, true);
    return BVHD_OK;
}

enum bvhd_status store_scan(struct store *store, struct bvhd_error *error)
{
    pthread_mutex_lock(&store->cleaning);
    enum bvhd_status status = count(store, NULL, error);
    pthread_mutex_unlock(&store->cleaning);
    return status;
}

/* Returns how many bytes are missing to keep_free once `size` more bytes are written. */
static uint64_t shortage(const struct store *store, uint64_t size)
{
    struct statvfs system;
    if (store->keep_free == 0 || statvfs(store->directory, &system) != 0)
        return 0;
    uint64_t room = (uint64_t)system.f_bavail * system.f_frsize, wanted = store->keep_free + size;
    return room < wanted ? wanted - room : 0;
}

static bool is_over(const struct store *store, uint64_t size)
{
    return atomic_load(&store->bytes) + size > store->budget;
}

/* Other processes may write as much as this one does, so the estimate becomes worse as it writes. */
static bool is_stale(const struct store *store)
{
    return atomic_load(&store->written_since) > atomic_load(&store->patience);
}

bool store_needs_trim(const struct store *store)
{
    bool any = !atomic_load(&store->counted) || atomic_load(&store->entries) > 0;
    return is_over(store, 0) || is_stale(store) || (any && shortage(store, 0) > 0);
}

/* Removes a file that walk_run has found, which may have vanished since. */
static enum bvhd_status evict(struct store *store, const struct victim *victim, struct bvhd_error *error)
{
    int folder = store_folder_open(store, victim->generation, victim->folder, false);
    int result = folder < 0 ? -1 : unlinkat(folder, victim->name, 0);
    if (folder >= 0)
        store_close_quietly(folder);
    if (result != 0 && !store_is_absent(errno))
        return store_failed(store, victim->name, "removing", error);
    store_estimate(&store->bytes, -(int64_t)victim->bytes);
    store_estimate(&store->entries, victim->kind == WALK_ENTRY ? -1 : 0);
    atomic_fetch_add_explicit(&store->evicted, victim->kind == WALK_ENTRY, memory_order_relaxed);
    return BVHD_OK;
}

/* Evicts the oldest of the files that were collected, until at most `most` bytes are left. */
static enum bvhd_status evict_some(struct store *store, struct victims *victims, uint64_t most,
                                   struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    victims_sort(victims);
    for (uint32_t i = 0; status == BVHD_OK && i < victims->count && atomic_load(&store->bytes) > most; i++)
        status = evict(store, &victims->items[i], error);
    return status;
}

static uint64_t less(uint64_t a, uint64_t b)
{
    return a > b ? a - b : 0;
}

/*
 * Returns how many bytes may stay when `size` more are to be written. It is less than what would just do, so that the
 * next trim is some time away.
 */
static uint64_t bytes_that_may_stay(const struct store *store, uint64_t size)
{
    uint64_t bytes = atomic_load(&store->bytes), missing = shortage(store, size);
    uint64_t by_budget = is_over(store, size) ? less(store->budget - store->budget / 10, size) : UINT64_MAX;
    uint64_t by_room = missing > 0 ? less(bytes, missing + bytes / 10) : UINT64_MAX;
    return by_budget < by_room ? by_budget : by_room;
}

/* Trims to `most` bytes, or if that is NULL, so that a file of `size` bytes may be written. */
static enum bvhd_status trim(struct store *store, const uint64_t *most, uint64_t size, struct bvhd_error *error)
{
    struct victims victims;
    enum bvhd_status status = victims_init(&victims, store->memory, error);
    if (status != BVHD_OK)
        return status;
    pthread_mutex_lock(&store->cleaning);
    status = count(store, &victims, error);
    const uint64_t may_stay = most ? *most : bytes_that_may_stay(store, size);
    while (status == BVHD_OK && atomic_load(&store->bytes) > may_stay && victims.count > 0) {
        status = evict_some(store, &victims, may_stay, error);
        victims_clear(&victims);
        if (status == BVHD_OK && atomic_load(&store->bytes) > may_stay)
            status = count(store, &victims, error);
    }
    pthread_mutex_unlock(&store->cleaning);
    victims_finish(&victims);
    return status;
}

enum bvhd_status store_trim(struct store *store, struct bvhd_error *error)
{
    return trim(store, NULL, 0, error);
}

enum bvhd_status store_trim_to(struct store *store, uint64_t bytes, struct bvhd_error *error)
{
    return trim(store, &bytes, 0, error);
}

enum bvhd_status store_make_room(struct store *store, uint64_t size, struct bvhd_error *error)
{
    bool any = !atomic_load(&store->counted) || atomic_load(&store->entries) > 0;
    enum bvhd_status status = BVHD_OK;
    if (is_over(store, size) || is_stale(store) || (any && shortage(store, size) > 0))
        status = trim(store, NULL, size, error);
    if (status == BVHD_OK && shortage(store, size) > 0)
        return bvhd_error_set(error, BVHD_IO, store->directory,
                              "no room: %" PRIu64 " bytes of the file system are to stay free", store->keep_free);
    return status;
}

static enum bvhd_status remove_file(struct walk *walk, const struct walk_file *file, struct bvhd_error *error)
{
    (void)walk;
    if (file->kind == WALK_TEMPORARY)
        remove_left_over(file);
    else if (unlinkat(file->descriptor, file->name, 0) != 0 && errno != ENOENT)
        return bvhd_error_set(error, BVHD_IO, file->name, "cannot be removed: %s", strerror(errno));
    return BVHD_OK;
}

enum bvhd_status store_clear(struct store *store, struct bvhd_error *error)
{
    struct walk walk = {.visit = remove_file, .all = true};
    pthread_mutex_lock(&store->cleaning);
    enum bvhd_status status = walk_run(&walk, store, error);
    if (status == BVHD_OK)
        status = count(store, NULL, error);
    pthread_mutex_unlock(&store->cleaning);
    return status;
}
