/* SPDX-License-Identifier: Apache-2.0 */
/*
 * store.h - keeps results on disk, for this process, for later ones and for others of the same user: bytes by key,
 * within a budget.
 *
 * An entry is a plain file, DIRECTORY/GENERATION/SHARD/KEY, where the shard is the first two digits of the key. It has
 * a header with a checksum (entry_header.h). A file is written under another name beside its place, synced, and then
 * renamed, so an entry is either there as a whole or not there. What is read is verified every time, while it is
 * copied; a damaged entry is set aside in DIRECTORY/GENERATION/damaged, counts as missing, and is built and written
 * again by the caller. Files are never handed out.
 *
 * Several processes may use a directory at the same time, without a lock: a file that another process removes is no
 * error, a reader keeps what it has opened, and two that write one entry write the same. Each process estimates what
 * the directory holds, and counts it again from time to time (store_trim).
 *
 * The least recently used entries go first; an entry's time of modification says when it was used. The time is
 * refreshed at most once in STORE_REFRESH_SECONDS. All files of the directory count, whatever their generation, so the
 * entries of old versions leave as their times are never refreshed.
 *
 * The caller stores results only: no errors, no shortages, and no results of updates.
 *
 * All functions may be called from any thread and block it; there are no threads of the store. Between calls it holds
 * no descriptors, and in a call at most STORE_DESCRIPTORS of them.
 */
#ifndef BVHD_STORE_H
#define BVHD_STORE_H

#include <stdatomic.h>
#include <stdbool.h>

#include "proto/base/bytes.h"
#include "proto/base/key.h"
#include "proto/base/memory.h"
#include "proto/base/parallel.h"
#include "proto/base/status.h"

enum { STORE_SUMMARY_MAX = 4096, STORE_DESCRIPTORS = 6, STORE_REFRESH_SECONDS = 60 };

/* As keep_free: a twentieth of the file system, at most 1 GiB. */
#define STORE_KEEP_FREE_DEFAULT UINT64_MAX

/* The budget where the user names none. */
#define STORE_BUDGET_DEFAULT (UINT64_C(10) << 30)

struct store;

struct store_options {
    const char *directory; /* created if it is missing; it must belong to the user, and nobody else may write it */
    const char *generation; /* which entries are one's own: store_generation(), or another name of that form */
    uint64_t budget; /* bytes of files in whole pages of 4 KiB, damaged ones included */
    uint64_t keep_free; /* bytes of the file system that stay free: entries leave until they are */
    /* Ends scans, trims and the trims of store_put soon, with BVHD_CANCELLED; NULL: they are never cancelled. */
    const atomic_bool *cancel;
};

struct store_entry {
    struct key key;
    struct bytes summary; /* at most STORE_SUMMARY_MAX bytes about the result; the store does not read them */
    uint64_t size; /* bytes of the payload */
};

/*
 * Takes an entry that is read: `begin` once, then `write` in order and in pieces of at most 64 KiB. `room` may return
 * memory for the next piece, or for the next ones if it is asked for more than 64 KiB: they are read there, verified
 * there, and given to `write`. After NULL they come in memory of the store, as the first piece always does. Nothing is
 * verified until store_get returns BVHD_OK, except that the file has room for entry->size bytes; the receiver therefore
 * checks the summary as it checks other hostile bytes. The summary is valid during `begin`. A status other than BVHD_OK
 * ends the reading; with BVHD_CORRUPT the receiver says that it cannot use the entry, which is then set aside.
 */
struct store_sink {
    enum bvhd_status (*begin)(struct store_sink *sink, const struct store_entry *entry, struct bvhd_error *error);
    unsigned char *(*room)(struct store_sink *sink, uint64_t size);
    enum bvhd_status (*write)(struct store_sink *sink, const void *bytes, uint64_t size, struct bvhd_error *error);
};

/*
 * Opens a directory; this takes the same time however much is in it. `memory` must outlive the store; the strings of
 * `options` are copied. BVHD_INVALID for a generation that is no such name, and for a directory that belongs to another
 * user (root may open it) or that others may write. BVHD_IO, BVHD_NO_MEMORY. End with store_close, which accepts NULL.
 */
enum bvhd_status store_open(const struct store_options *options, struct memory *memory, struct store **ret_store,
                            struct bvhd_error *error);
void store_close(struct store *store);

/*
 * Reads an entry; a long one on half of the threads of `parallel`, up to 4. BVHD_NOT_FOUND: there is none, or none that
 * is whole; damage has been counted and set aside then. Another status is the sink's, or says why the entry could not
 * be read: BVHD_IO, BVHD_NO_MEMORY. After any status but BVHD_OK the receiver throws away what it got.
 */
enum bvhd_status store_get(struct store *store, const struct key *key, const struct parallel *parallel,
                           struct store_sink *sink, struct bvhd_error *error);

/*
 * Writes an entry, and trims the store before that if there is no room for it. An entry of the same key is replaced.
 * After a failure it is not there, or whole if only its folder could not be synced: BVHD_TOO_LARGE when the entry would
 * exceed an eighth of the budget, BVHD_IO (also when the disk is full, which changes nothing for the entries that are
 * there), BVHD_NO_MEMORY.
 */
enum bvhd_status store_put(struct store *store, const struct store_entry *entry, const void *payload,
                           struct bvhd_error *error);

/*
 * Counts what is there, and removes what writers that died have left behind. A process that lives for long calls it at
 * its start; in others store_put counts after a random amount of writing. BVHD_OK, BVHD_CANCELLED, BVHD_IO.
 */
enum bvhd_status store_scan(struct store *store, struct bvhd_error *error);

/*
 * Returns whether the store should be trimmed: it is over its budget, it has written a sixteenth of its budget since it
 * counted last, or less of the file system is free than should stay free. Costs a system call.
 */
bool store_needs_trim(const struct store *store);

/*
 * Counts the entries as store_scan does, and removes the least recently used ones if they exceed the budget or its file
 * system is short of room, until they fit into nine tenths of the budget and leave room. store_trim_to removes them
 * until at most `bytes` are left. BVHD_OK, BVHD_CANCELLED, BVHD_IO, BVHD_NO_MEMORY.
 */
enum bvhd_status store_trim(struct store *store, struct bvhd_error *error);
enum bvhd_status store_trim_to(struct store *store, uint64_t bytes, struct bvhd_error *error);

/* Removes all entries of all generations, and folders that become empty. */
enum bvhd_status store_clear(struct store *store, struct bvhd_error *error);

/* The counts of files are estimates while others write to the directory. */
struct store_state {
    bool counted; /* store_scan or a trim has run; `entries` and `bytes` are what this process wrote before */
    uint64_t entries, bytes; /* of all generations; the bytes include damaged files */
    uint64_t budget;
    uint64_t written, read, damaged, evicted; /* entries, by this process */
    uint64_t write_errors; /* entries that could not be written, by this process */
};

struct store_state store_state(const struct store *store);

/* Returns the directory, as an absolute path without symbolic links. */
const char *store_directory(const struct store *store);

#endif
