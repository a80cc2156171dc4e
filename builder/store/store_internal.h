/* SPDX-License-Identifier: Apache-2.0 */
/* store_internal.h - what the files of the store share: the opened directory, its counts, and its names of files. */
#ifndef BVHD_STORE_INTERNAL_H
#define BVHD_STORE_INTERNAL_H

#include <pthread.h>
#include <sys/types.h>

#include "builder/store/store.h"

/* Bytes of a piece that is read or written at once: it stays in the processor's second cache while it is hashed. */
enum { STORE_PIECE = 64 * 1024 };

/* Bytes of the longest name of a generation, of a folder in it, and of a path below the directory, with their NULs. */
enum {
    STORE_GENERATION_SIZE = 65,
    STORE_FOLDER_SIZE = 8,
    STORE_PATH_SIZE = STORE_GENERATION_SIZE + STORE_FOLDER_SIZE + KEY_TEXT_SIZE
};

/* The files are counted again when this fraction of the budget has been written. */
enum { STORE_RECOUNT = 16 };

/* Names in the directory. */
#define STORE_DAMAGED "damaged" /* the folder of damaged files, beside the shards */
#define STORE_TEMPORARY ".new-" /* how the names of unfinished files begin */

struct store {
    struct memory *memory;
    char *directory;
    char generation[STORE_GENERATION_SIZE];
    uint64_t budget, keep_free;
    const atomic_bool *cancel;
    uid_t owner; /* of the directory, and so of every file that is used */
    pthread_mutex_t cleaning; /* one scan, trim or clear at a time */
    atomic_bool counted;
    _Atomic uint64_t entries, bytes; /* estimates */
    /* bytes written since the files were counted last, and how many there may be before they are counted again */
    _Atomic uint64_t written_since, patience;
    _Atomic uint64_t written, read, damaged, evicted, write_errors;
};

/* Returns the bytes that a file of `file_size` bytes counts for in the budget: whole pages. */
static inline uint64_t store_bytes_of(uint64_t file_size)
{
    return bytes_align(file_size, 4096);
}

/* Adds to an estimate, or subtracts from it; it does not fall below 0. */
void store_estimate(_Atomic uint64_t *estimate, int64_t change);

/* Returns whether errno says that a file or its folder is not there, or is not what it should be. */
bool store_is_absent(int number);

/* Returns BVHD_IO with the path of a file, what failed, and errno. */
enum bvhd_status store_failed(const struct store *store, const char *name, const char *what, struct bvhd_error *error);

/*
 * Opens a folder of a generation: a shard or STORE_DAMAGED. Returns a descriptor, or -1 with errno. With `create`,
 * folders that are missing are made.
 */
int store_folder_open(const struct store *store, const char *generation, const char *folder, bool create);

/* Opens the folder of a key's file in the same way, and writes the file's name. */
int store_shard_open(const struct store *store, const struct key *key, bool create, char ret_name[KEY_TEXT_SIZE]);

/* Closes a descriptor, and leaves errno alone. */
void store_close_quietly(int descriptor);

/*
 * Moves the damaged file of this name to STORE_DAMAGED, or removes it if that cannot be done, and counts it. The file
 * is left alone if it is not the one that `about` describes any more.
 */
struct stat;
void store_set_aside(struct store *store, int shard, const char *name, const struct stat *about);

/* Makes room for a file of that size, or fails with BVHD_IO. */
enum bvhd_status store_make_room(struct store *store, uint64_t size, struct bvhd_error *error);

#endif
