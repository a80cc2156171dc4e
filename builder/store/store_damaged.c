/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/store/store_internal.h"

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <sys/stat.h>
#include <unistd.h>

/*
 * Damaged files are kept so that the cause of the damage can be looked for: at most DAMAGED_MOST of them, which take at
 * most the budget divided by DAMAGED_SHARE.
 */
enum { DAMAGED_MOST = 16, DAMAGED_SHARE = 64 };

/* Describes the folder of damaged files: how many there are, their bytes, and the oldest one. */
struct damaged {
    uint32_t count;
    uint64_t bytes, oldest_bytes;
    struct timespec oldest_time;
    char oldest[KEY_TEXT_SIZE];
};

static bool is_before(struct timespec a, struct timespec b)
{
    return a.tv_sec != b.tv_sec ? a.tv_sec < b.tv_sec : a.tv_nsec < b.tv_nsec;
}

static void add(struct damaged *damaged, const char *name, const struct stat *about)
{
    uint64_t bytes = store_bytes_of((uint64_t)about->st_size);
    if (damaged->count == 0 || is_before(about->st_ctim, damaged->oldest_time)) {
        damaged->oldest_time = about->st_ctim;
        damaged->oldest_bytes = bytes;
        snprintf(damaged->oldest, sizeof damaged->oldest, "%s", name);
    }
    damaged->count++;
    damaged->bytes += bytes;
}

static struct damaged look(DIR *folder)
{
    struct damaged damaged = {0};
    struct stat about;
    rewinddir(folder);
    for (const struct dirent *entry; (entry = readdir(folder));)
        if (entry->d_name[0] != '.' && strlen(entry->d_name) < KEY_TEXT_SIZE &&
            fstatat(dirfd(folder), entry->d_name, &about, AT_SYMLINK_NOFOLLOW) == 0)
            add(&damaged, entry->d_name, &about);
    return damaged;
}

/* Removes a file, or what somebody has put into its place. */
static bool remove_file(int folder, const char *name)
{
    return unlinkat(folder, name, 0) == 0 || unlinkat(folder, name, AT_REMOVEDIR) == 0;
}

/* Removes the oldest ones of too many. */
static void bound(struct store *store, DIR *folder)
{
    struct damaged damaged = look(folder);
    while (damaged.count > DAMAGED_MOST || damaged.bytes > store->budget / DAMAGED_SHARE) {
        if (!remove_file(dirfd(folder), damaged.oldest))
            return;
        store_estimate(&store->bytes, -(int64_t)damaged.oldest_bytes);
        damaged = look(folder);
    }
}

/* Moves the file and returns whether that was possible. */
static bool move(struct store *store, int shard, const char *name)
{
    int descriptor = store_folder_open(store, store->generation, STORE_DAMAGED, true);
    if (descriptor < 0)
        return false;
    bool moved = renameat(shard, name, descriptor, name) == 0;
    DIR *folder = fdopendir(descriptor);
    if (!folder) {
        close(descriptor);
        return moved;
    }
    bound(store, folder);
    closedir(folder);
    return moved;
}

void store_set_aside(struct store *store, int shard, const char *name, const struct stat *about)
{
    struct stat now;
    atomic_fetch_add_explicit(&store->damaged, 1, memory_order_relaxed);
    if (fstatat(shard, name, &now, AT_SYMLINK_NOFOLLOW) != 0 || now.st_ino != about->st_ino ||
        now.st_dev != about->st_dev)
        return;
    store_estimate(&store->entries, -1);
    if (!move(store, shard, name) && remove_file(shard, name))
        store_estimate(&store->bytes, -(int64_t)store_bytes_of((uint64_t)now.st_size));
}
