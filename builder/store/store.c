/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/store/store_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "builder/store/walk.h"

static enum bvhd_status make_folders(char *path, struct bvhd_error *error)
{
    for (char *at = path + 1;; at++) {
        if (*at != '/' && *at != '\0')
            continue;
        char end = *at;
        *at = '\0';
        int result = mkdir(path, S_IRWXU);
        if (result != 0 && errno != EEXIST && end == '\0')
            return bvhd_error_set(error, BVHD_IO, path, "the cache's directory cannot be made: %s", strerror(errno));
        *at = end;
        if (end == '\0')
            return BVHD_OK;
    }
}

/* Makes the directory if it is missing, and finds its path without symbolic links. */
static enum bvhd_status find_directory(const char *directory, char ret_path[PATH_MAX], struct bvhd_error *error)
{
    char path[PATH_MAX];
    if (!directory[0] || strlen(directory) >= PATH_MAX - STORE_PATH_SIZE)
        return bvhd_error_set(error, BVHD_INVALID, directory, "the name of the cache's directory is empty or too long");
    strcpy(path, directory);
    if (access(path, F_OK) != 0) {
        enum bvhd_status status = make_folders(path, error);
        if (status != BVHD_OK)
            return status;
    }
    if (!realpath(path, ret_path))
        return bvhd_error_set(error, BVHD_IO, directory, "the cache's directory cannot be found: %s", strerror(errno));
    if (strlen(ret_path) >= PATH_MAX - STORE_PATH_SIZE)
        return bvhd_error_set(error, BVHD_INVALID, directory, "the path of the cache's directory is too long");
    return BVHD_OK;
}

/* Files that others could have written are not to be trusted, and their checksums are no signatures. */
static enum bvhd_status check_directory(const char *path, uid_t *ret_owner, struct bvhd_error *error)
{
    struct stat about;
    if (stat(path, &about) != 0)
        return bvhd_error_set(error, BVHD_IO, path, "the cache's directory: %s", strerror(errno));
    if (!S_ISDIR(about.st_mode))
        return bvhd_error_set(error, BVHD_INVALID, path, "the cache's directory is no directory");
    if (about.st_uid != geteuid() && geteuid() != 0)
        return bvhd_error_set(error, BVHD_INVALID, path, "the cache's directory belongs to user %u, not to user %u",
                              (unsigned)about.st_uid, (unsigned)geteuid());
    if (about.st_mode & (S_IWGRP | S_IWOTH))
        return bvhd_error_set(error, BVHD_INVALID, path,
                              "others may write the cache's directory (mode %03o); chmod go-w mends that",
                              (unsigned)(about.st_mode & 0777));
    *ret_owner = about.st_uid;
    return BVHD_OK;
}

/* Says to programs that make backups that this is a cache, by the convention of https://bford.info/cachedir/. */
static void tag_directory(const char *path)
{
    static const char text[] = "Signature: 8a477f597d28d172789f06886806bc55\n"
                               "# This directory is the cache of bvhd; see https://bford.info/cachedir/\n";
    char name[PATH_MAX + 16];
    snprintf(name, sizeof name, "%s/CACHEDIR.TAG", path);
    int file = open(name, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, S_IRUSR | S_IWUSR);
    if (file < 0)
        return;
    if (write(file, text, sizeof text - 1) < 0)
        unlink(name);
    close(file);
}

static uint64_t free_by_default(const char *path)
{
    struct statvfs system;
    const uint64_t most = UINT64_C(1) << 30;
    if (statvfs(path, &system) != 0)
        return most;
    uint64_t share = (uint64_t)system.f_blocks * system.f_frsize / 20;
    return share < most ? share : most;
}

/*
 * A process that lives for a short time and never counts the files writes a random amount before it does. So many such
 * processes together count them about as often as one that lives long.
 */
static uint64_t random_patience(uint64_t budget)
{
    uint64_t number = 0;
    ssize_t size = getrandom(&number, sizeof number, GRND_NONBLOCK);
    return size == sizeof number && budget >= STORE_RECOUNT ? number % (budget / STORE_RECOUNT) : 0;
}

static struct store *make_store(const struct store_options *options, const char *path, struct memory *memory)
{
    struct store *store = memory_alloc(memory, sizeof *store);
    char *directory = memory_alloc(memory, strlen(path) + 1);
    if (!store || !directory || pthread_mutex_init(&store->cleaning, NULL) != 0) {
        memory_free(memory, store);
        memory_free(memory, directory);
        return NULL;
    }
    store->memory = memory;
    store->directory = strcpy(directory, path);
    strcpy(store->generation, options->generation);
    store->budget = options->budget;
    store->keep_free = options->keep_free == STORE_KEEP_FREE_DEFAULT ? free_by_default(path) : options->keep_free;
    store->cancel = options->cancel;
    atomic_init(&store->counted, false);
    atomic_init(&store->patience, random_patience(store->budget));
    _Atomic uint64_t *counts[] = {&store->entries, &store->bytes,   &store->written_since, &store->written,
                                  &store->read,    &store->damaged, &store->evicted,       &store->write_errors};
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++)
        atomic_init(counts[i], 0);
    return store;
}

enum bvhd_status store_open(const struct store_options *options, struct memory *memory, struct store **ret_store,
                            struct bvhd_error *error)
{
    char path[PATH_MAX];
    uid_t owner = 0;
    if (!walk_is_generation(options->generation))
        return bvhd_error_set(error, BVHD_INVALID, options->generation, "is no name of a generation of the cache");
    enum bvhd_status status = find_directory(options->directory, path, error);
    if (status == BVHD_OK)
        status = check_directory(path, &owner, error);
    if (status != BVHD_OK)
        return status;
    struct store *store = make_store(options, path, memory);
    if (!store)
        return bvhd_error_no_memory(error, path, "no memory for the cache on disk");
    if (owner == geteuid())
        tag_directory(path);
    store->owner = owner;
    *ret_store = store;
    return BVHD_OK;
}

void store_close(struct store *store)
{
    if (!store)
        return;
    pthread_mutex_destroy(&store->cleaning);
    memory_free(store->memory, store->directory);
    memory_free(store->memory, store);
}

const char *store_directory(const struct store *store)
{
    return store->directory;
}

static uint64_t value(const _Atomic uint64_t *count)
{
    return atomic_load_explicit(count, memory_order_relaxed);
}

struct store_state store_state(const struct store *store)
{
    return (struct store_state){.counted = atomic_load_explicit(&store->counted, memory_order_relaxed),
                                .entries = value(&store->entries),
                                .bytes = value(&store->bytes),
                                .budget = store->budget,
                                .written = value(&store->written),
                                .read = value(&store->read),
                                .damaged = value(&store->damaged),
                                .evicted = value(&store->evicted),
                                .write_errors = value(&store->write_errors)};
}

void store_estimate(_Atomic uint64_t *estimate, int64_t change)
{
    uint64_t before = atomic_load_explicit(estimate, memory_order_relaxed), after;
    do {
        after = change < 0 && before < (uint64_t)-change ? 0 : before + (uint64_t)change;
    } while (
        !atomic_compare_exchange_weak_explicit(estimate, &before, after, memory_order_relaxed, memory_order_relaxed));
}

enum bvhd_status store_failed(const struct store *store, const char *name, const char *what, struct bvhd_error *error)
{
    int number = errno;
    return bvhd_error_set(error, BVHD_IO, store->directory, "%s of %s: %s", what, name, strerror(number));
}
