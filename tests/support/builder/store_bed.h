/* SPDX-License-Identifier: Apache-2.0 */
/*
 * store_bed.h - a store in the scratch folder, with entries whose bytes follow from a number, for tests. Included after
 * unit.h and scratch.h.
 */
#ifndef BVHD_STORE_BED_H
#define BVHD_STORE_BED_H

#include <fcntl.h>
#include <limits.h>
#include <sys/stat.h>
#include <time.h>

#include "builder/store/store_internal.h"
#include "tests/support/random.h"

#define BED_GENERATION "development-test1"

static struct memory bed_memory;
static struct store *bed_store;
static atomic_bool bed_cancel;

static inline void bed_open_with(const char *directory, const char *generation, uint64_t budget, uint64_t keep_free)
{
    struct store_options options = {directory, generation, budget, keep_free, &bed_cancel};
    struct bvhd_error error = {0};
    assert_int_equal(store_open(&options, &bed_memory, &bed_store, &error), BVHD_OK);
}

/* Opens a store with that budget in the scratch folder, where another one may have been. */
static inline void bed_open(uint64_t budget)
{
    char path[96];
    snprintf(path, sizeof path, "%s/cache", scratch_folder);
    bed_open_with(path, BED_GENERATION, budget, 0);
}

static inline void bed_close(void)
{
    store_close(bed_store);
    bed_store = NULL;
    assert_int_equal(atomic_load(&bed_memory.live), 0);
}

/* Test set-up and tear-down: a scratch folder with an open store of 1 GiB. */
static inline int bed_begin(void **state)
{
    if (scratch_make_in_memory(state) != 0)
        return -1;
    memory_init(&bed_memory, UINT64_MAX);
    atomic_store(&bed_cancel, false);
    bed_open(UINT64_C(1) << 30);
    return 0;
}

static inline int bed_end(void **state)
{
    bed_close();
    return scratch_remove(state);
}

static inline struct key bed_key(uint32_t number)
{
    struct key key;
    struct random random = {number + UINT64_C(77)};
    for (int i = 0; i < KEY_SIZE; i++)
        key.bytes[i] = (uint8_t)random_next(&random);
    return key;
}

/* The bytes of an entry. The caller frees them. */
static inline unsigned char *bed_payload(uint32_t number, uint64_t size)
{
    unsigned char *bytes = malloc(size + 8);
    struct random random = {number};
    assert_non_null(bytes);
    for (uint64_t i = 0; i < size; i += 8)
        bytes_put64(bytes + i, random_next(&random));
    return bytes;
}

static inline enum bvhd_status bed_try_put(uint32_t number, uint64_t size, struct bvhd_error *error)
{
    char summary[32];
    int length = snprintf(summary, sizeof summary, "entry %u", number);
    unsigned char *payload = bed_payload(number, size);
    struct store_entry entry = {bed_key(number), {(const unsigned char *)summary, (uint64_t)length}, size};
    enum bvhd_status status = store_put(bed_store, &entry, payload, error);
    free(payload);
    return status;
}

static inline void bed_put(uint32_t number, uint64_t size)
{
    struct bvhd_error error = {0};
    assert_int_equal(bed_try_put(number, size, &error), BVHD_OK);
}

/* Threads for reading. */
static const struct parallel *bed_parallel = &parallel_serial;

/* Takes an entry into memory. */
struct bed_sink {
    struct store_sink sink;
    char summary[STORE_SUMMARY_MAX + 1];
    unsigned char *bytes;
    uint64_t size, got;
    bool has_no_room; /* pieces come in memory of the store, and not where this sink keeps them */
    enum bvhd_status begin_status, write_status; /* what it answers */
};

static inline enum bvhd_status bed_sink_begin(struct store_sink *sink, const struct store_entry *entry,
                                              struct bvhd_error *error)
{
    struct bed_sink *bed = (struct bed_sink *)sink;
    memcpy(bed->summary, entry->summary.data, entry->summary.size);
    bed->summary[entry->summary.size] = '\0';
    bed->bytes = malloc(entry->size + 1);
    assert_non_null(bed->bytes);
    bed->size = entry->size;
    return bed->begin_status == BVHD_OK ? BVHD_OK : bvhd_error_set(error, bed->begin_status, "begin", "refused");
}

static inline unsigned char *bed_sink_room(struct store_sink *sink, uint64_t size)
{
    struct bed_sink *bed = (struct bed_sink *)sink;
    assert_true(size > 0 && size <= bed->size - bed->got);
    return bed->has_no_room ? NULL : bed->bytes + bed->got;
}

static inline enum bvhd_status bed_sink_write(struct store_sink *sink, const void *bytes, uint64_t size,
                                              struct bvhd_error *error)
{
    struct bed_sink *bed = (struct bed_sink *)sink;
    assert_true(size > 0 && size <= STORE_PIECE && size <= bed->size - bed->got);
    if (bytes != bed->bytes + bed->got)
        memcpy(bed->bytes + bed->got, bytes, size);
    bed->got += size;
    return bed->write_status == BVHD_OK ? BVHD_OK : bvhd_error_set(error, bed->write_status, "write", "refused");
}

/* Reads an entry. If that succeeds, it must be the one that bed_put has written, of any size. */
static inline enum bvhd_status bed_get(uint32_t number, struct bvhd_error *error)
{
    struct bed_sink sink = {.sink = {bed_sink_begin, bed_sink_room, bed_sink_write}};
    struct key key = bed_key(number);
    enum bvhd_status status = store_get(bed_store, &key, bed_parallel, &sink.sink, error);
    if (status == BVHD_OK) {
        char summary[32];
        snprintf(summary, sizeof summary, "entry %u", number);
        assert_string_equal(sink.summary, summary);
        assert_int_equal(sink.got, sink.size);
        unsigned char *payload = bed_payload(number, sink.size);
        assert_memory_equal(sink.bytes, payload, sink.size);
        free(payload);
    }
    free(sink.bytes);
    return status;
}

static inline bool bed_has(uint32_t number)
{
    struct bvhd_error error = {0};
    enum bvhd_status status = bed_get(number, &error);
    assert_true(status == BVHD_OK || status == BVHD_NOT_FOUND);
    return status == BVHD_OK;
}

/* The path of an entry's file below the store's directory. */
struct bed_name {
    char text[STORE_PATH_SIZE];
};

static inline struct bed_name bed_name(uint32_t number)
{
    struct bed_name name;
    char text[KEY_TEXT_SIZE];
    struct key key = bed_key(number);
    key_to_text(&key, text);
    snprintf(name.text, sizeof name.text, BED_GENERATION "/%.2s/%s", text, text);
    return name;
}

/* Runs a shell command in the store's directory, where $E is the file of an entry. Returns the number it prints. */
static inline long bed_shell(uint32_t number, const char *command)
{
    char line[4096], answer[64] = "";
    int size = snprintf(line, sizeof line, "cd '%s' && E=%s && { %s; }", store_directory(bed_store),
                        bed_name(number).text, command);
    assert_true(size > 0 && size < (int)sizeof line);
    FILE *output = popen(line, "r");
    assert_non_null(output);
    bool printed = fgets(answer, sizeof answer, output) != NULL;
    assert_int_equal(pclose(output), 0);
    return printed ? strtol(answer, NULL, 10) : 0;
}

/* How many files there are, except for the tag. */
static inline long bed_files(void)
{
    return bed_shell(0, "find . -type f ! -name CACHEDIR.TAG | wc -l");
}

/* Opens an entry's file. */
static inline int bed_file(uint32_t number, int flags)
{
    char path[PATH_MAX];
    int size = snprintf(path, sizeof path, "%s/%s", store_directory(bed_store), bed_name(number).text);
    assert_true(size < (int)sizeof path);
    int file = open(path, flags, S_IRUSR | S_IWUSR);
    assert_true(file >= 0);
    return file;
}

/* Says that an entry was used so many seconds ago. */
static inline void bed_age(uint32_t number, int64_t age)
{
    int file = bed_file(number, O_RDONLY);
    const struct timespec time_of[2] = {{.tv_nsec = UTIME_OMIT}, {.tv_sec = (time_t)(time(NULL) - age)}};
    assert_int_equal(futimens(file, time_of), 0);
    close(file);
}

#endif
