/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/store/store_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "builder/store/entry_header.h"

/*
 * Bytes of the first piece. It is short, because its bytes of the result are copied once more than those of the others.
 */
enum { HEAD = 8192 };
_Static_assert((int)HEAD >= (int)ENTRY_HEAD_MAX, "the first piece has the whole header");

/*
 * Bytes that several threads read before the receiver is asked whether to go on, the fewest for which waking other
 * threads pays, and the most threads that read one entry.
 */
enum { WINDOW = 4 << 20, WINDOW_MIN = 256 << 10, READERS_MOST = 4 };

/* A file that is being read. */
struct reading {
    struct store *store;
    struct store_sink *sink;
    const struct parallel *parallel;
    char name[KEY_TEXT_SIZE];
    int shard, file; /* -1: not open */
    struct stat about;
    unsigned char *piece; /* STORE_PIECE bytes */
};

static enum bvhd_status missing(const struct reading *reading, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_NOT_FOUND, reading->name, "is not in the cache on disk");
}

/* Returns whether it is a file that the store may have written, and that nobody else can write. */
static bool is_ours(const struct reading *reading)
{
    const struct stat *about = &reading->about;
    return S_ISREG(about->st_mode) && about->st_uid == reading->store->owner &&
           (about->st_mode & (S_IWGRP | S_IWOTH)) == 0;
}

/* Looks at the file; what cannot be opened as one, such as a symbolic link or a socket, is looked at by its name. */
static bool look(struct reading *reading)
{
    if (reading->file >= 0)
        return fstat(reading->file, &reading->about) == 0;
    return (errno == ELOOP || errno == ENXIO) &&
           fstatat(reading->shard, reading->name, &reading->about, AT_SYMLINK_NOFOLLOW) == 0;
}

/* O_NONBLOCK is for a name that leads to a FIFO or a device. */
static enum bvhd_status open_file(struct reading *reading, const struct key *key, struct bvhd_error *error)
{
    const int flags = O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY | O_CLOEXEC;
    reading->shard = store_shard_open(reading->store, key, false, reading->name);
    if (reading->shard < 0)
        return store_is_absent(errno) ? missing(reading, error)
                                      : store_failed(reading->store, reading->name, "opening the folder", error);
    reading->file = openat(reading->shard, reading->name, flags);
    if (!look(reading))
        return errno == ENOENT ? missing(reading, error)
                               : store_failed(reading->store, reading->name, "opening", error);
    if (!is_ours(reading))
        return bvhd_error_set(error, BVHD_CORRUPT, reading->name, "is no file that only its owner may write");
    return BVHD_OK;
}

/* Reads as many bytes of the file as are there, at most `size`. Unreadable bytes of a disk are damage. */
static enum bvhd_status read_piece(const struct reading *reading, uint64_t offset, uint64_t size,
                                   unsigned char *ret_piece, uint64_t *ret_size, struct bvhd_error *error)
{
    uint64_t done = *ret_size = 0;
    while (done < size) {
        ssize_t count = pread(reading->file, ret_piece + done, size - done, (off_t)(offset + done));
        if (count == 0)
            break;
        if (count > 0)
            done += (uint64_t)count;
        else if (errno == EIO)
            return bvhd_error_set(error, BVHD_CORRUPT, reading->name, "the disk cannot read it");
        else if (errno != EINTR)
            return store_failed(reading->store, reading->name, "reading", error);
    }
    *ret_size = done;
    return BVHD_OK;
}

static uint64_t smaller(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

/*
 * Pieces that several threads read to where they stay, each the next one that is left. One of the threads also hashes
 * them, in their order.
 */
struct window {
    const struct reading *reading;
    struct entry_hash *hash;
    unsigned char *room;
    uint64_t offset, size;
    uint64_t hashed; /* bytes from the start of the window on */
    atomic_size_t taken; /* pieces that are read, or were */
    atomic_bool is_read[WINDOW / STORE_PIECE];
};

static struct bytes piece_of(const struct window *window, size_t index)
{
    uint64_t at = (uint64_t)index * STORE_PIECE;
    return (struct bytes){window->room + at, smaller(STORE_PIECE, window->size - at)};
}

/* Hashes the next piece. Returns false if it has not been read, or if there is none. */
static bool hash_piece(struct window *window)
{
    size_t index = window->hashed / STORE_PIECE;
    if (window->hashed == window->size || !atomic_load_explicit(&window->is_read[index], memory_order_acquire))
        return false;
    struct bytes piece = piece_of(window, index);
    entry_hash_add(window->hash, piece);
    window->hashed += piece.size;
    return true;
}

/* Reads a piece. Returns false if none is left. */
static bool take_piece(struct window *window)
{
    size_t index = atomic_fetch_add_explicit(&window->taken, 1, memory_order_relaxed);
    uint64_t at = (uint64_t)index * STORE_PIECE, size;
    if (at >= window->size)
        return false;
    uint64_t wanted = piece_of(window, index).size;
    enum bvhd_status status = read_piece(window->reading, window->offset + at, wanted, window->room + at, &size, NULL);
    atomic_store_explicit(&window->is_read[index], status == BVHD_OK && size == wanted, memory_order_release);
    return true;
}

static void read_pieces(void *context, size_t task)
{
    struct window *window = context;
    while ((task == 0 && hash_piece(window)) || take_piece(window))
        continue;
}

static size_t readers_of(const struct parallel *parallel)
{
    return parallel->threads / 2 < READERS_MOST ? parallel->threads / 2 : READERS_MOST;
}

/*
 * Reads and hashes the next pieces if several threads may do it. Returns how many bytes are hashed then, which are at
 * *ret_room. These are fewer than `size` if some cannot be read; reading the next one again says why.
 */
static uint64_t read_window(const struct reading *reading, struct entry_hash *hash, uint64_t offset, uint64_t size,
                            unsigned char **ret_room)
{
    struct window window = {.reading = reading, .hash = hash, .offset = offset, .size = size};
    size_t readers = readers_of(reading->parallel);
    if (readers < 2 || size < WINDOW_MIN)
        return 0;
    window.room = reading->sink->room(reading->sink, size);
    if (!window.room)
        return 0;
    parallel_for(reading->parallel, readers, read_pieces, &window);
    while (hash_piece(&window))
        continue;
    *ret_room = window.room;
    return window.hashed;
}

/* Reads one piece where the sink wants it, and hashes it. */
static enum bvhd_status read_and_hash(const struct reading *reading, struct entry_hash *hash, uint64_t at,
                                      unsigned char *ret_piece, uint64_t *ret_size, struct bvhd_error *error)
{
    uint64_t wanted = smaller(STORE_PIECE, (uint64_t)reading->about.st_size - at);
    enum bvhd_status status = read_piece(reading, at, wanted, ret_piece, ret_size, error);
    if (status == BVHD_OK && *ret_size == 0)
        status = bvhd_error_set(error, BVHD_CORRUPT, reading->name, "the file has become shorter");
    if (status == BVHD_OK)
        entry_hash_add(hash, (struct bytes){ret_piece, *ret_size});
    return status;
}

/* Hashes and passes on what follows the first piece, of which `at` bytes have been read. */
static enum bvhd_status copy_rest(const struct reading *reading, struct entry_hash *hash, uint64_t at,
                                  struct bvhd_error *error)
{
    uint64_t end = (uint64_t)reading->about.st_size, hashed = at, size;
    unsigned char *piece = NULL;
    for (; at < end; at += size, piece += size) {
        enum bvhd_status status = BVHD_OK;
        if (at == hashed)
            hashed += read_window(reading, hash, at, smaller(WINDOW, end - at), &piece);
        size = smaller(STORE_PIECE, (at < hashed ? hashed : end) - at);
        if (at == hashed) {
            unsigned char *room = reading->sink->room(reading->sink, size);
            piece = room ? room : reading->piece;
            status = read_and_hash(reading, hash, at, piece, &size, error);
            hashed += size;
        }
        if (status == BVHD_OK)
            status = reading->sink->write(reading->sink, piece, size, error);
        if (status != BVHD_OK)
            return status;
    }
    return BVHD_OK;
}

/* Passes on the entry, whose first `head` bytes have been read, and compares its checksum at the end. */
static enum bvhd_status copy(const struct reading *reading, const struct store_entry *entry, uint64_t head,
                             struct entry_hash *hash, struct bvhd_error *error)
{
    struct store_sink *sink = reading->sink;
    const struct entry_checksum wanted = entry_header_checksum(reading->piece);
    uint64_t begin = ENTRY_HEADER + entry->summary.size;
    entry_hash_add(hash, (struct bytes){reading->piece + ENTRY_HEADER, head - ENTRY_HEADER});
    enum bvhd_status status = sink->begin(sink, entry, error);
    if (status == BVHD_OK && head > begin)
        status = sink->write(sink, reading->piece + begin, head - begin, error);
    if (status == BVHD_OK)
        status = copy_rest(reading, hash, head, error);
    if (status != BVHD_OK)
        return status;
    struct entry_checksum sum = entry_hash_get(hash);
    if (sum.low != wanted.low || sum.high != wanted.high)
        return bvhd_error_set(error, BVHD_CORRUPT, reading->name, "the checksum does not agree with the bytes");
    return BVHD_OK;
}

static enum bvhd_status read_entry(struct reading *reading, const struct key *key, struct bvhd_error *error)
{
    struct store_entry entry;
    struct entry_hash hash;
    uint64_t size = (uint64_t)reading->about.st_size, head;
    reading->piece = memory_alloc(reading->store->memory, STORE_PIECE);
    if (!reading->piece)
        return bvhd_error_no_memory(error, reading->name, "no memory to read the cache on disk");
    enum bvhd_status status = read_piece(reading, 0, smaller(HEAD, size), reading->piece, &head, error);
    if (status == BVHD_OK)
        status = entry_header_read((struct bytes){reading->piece, head}, size, key, &entry, error);
    if (status != BVHD_OK)
        return status;
    if (!entry_hash_begin(&hash, reading->piece))
        return bvhd_error_no_memory(error, reading->name, "no memory to check the cache on disk");
    status = copy(reading, &entry, head, &hash, error);
    entry_hash_finish(&hash);
    return status;
}

/* Notes that the entry was used now. A time in the future, by a clock that jumped, counts as old, too. */
static void refresh(const struct reading *reading)
{
    time_t now = time(NULL), used = reading->about.st_mtime;
    if (used > now || now - used >= STORE_REFRESH_SECONDS)
        futimens(reading->file, NULL);
}

static enum bvhd_status finish(struct reading *reading, enum bvhd_status status, struct bvhd_error *error)
{
    if (status == BVHD_CORRUPT) {
        store_set_aside(reading->store, reading->shard, reading->name, &reading->about);
        status = bvhd_error_set(error, BVHD_NOT_FOUND, reading->name, "was damaged in the cache on disk: %s",
                                error ? error->text : "");
    } else if (status == BVHD_OK) {
        refresh(reading);
        atomic_fetch_add_explicit(&reading->store->read, 1, memory_order_relaxed);
    }
    memory_free(reading->store->memory, reading->piece);
    if (reading->file >= 0)
        close(reading->file);
    if (reading->shard >= 0)
        close(reading->shard);
    return status;
}

enum bvhd_status store_get(struct store *store, const struct key *key, const struct parallel *parallel,
                           struct store_sink *sink, struct bvhd_error *error)
{
    struct reading reading = {.store = store, .sink = sink, .parallel = parallel, .shard = -1, .file = -1};
    enum bvhd_status status = open_file(&reading, key, error);
    if (status == BVHD_OK)
        status = read_entry(&reading, key, error);
    return finish(&reading, status, error);
}
