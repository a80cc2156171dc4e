/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_micromap_source.c - tests that the opacity micromaps that triangles name are found in memory and on disk, are
 * open while they are needed, and that no more of them is read than was promised.
 */
#include "tests/support/unit.h"

#include <unistd.h>

#include "builder/format/portable_micromap.h"
#include "daemon/service/preparation.h"
#include "proto/base/validate_shape.h"
#include "tests/support/builder/inputs_micromap.h"
#include "tests/support/scratch.h"

enum { SMALL = 1000, LARGE = BLOB_INLINE_MAX + 1, NAMES = 4, OTHER = 4, INDEX = 3 };

static struct memory memory, blob_memory;
static struct descriptors descriptors;
static struct blob_account account;
static struct cache *cache;
static struct disk *disk;
static struct test_input test;
static struct reference references[NAMES + 1];
static const atomic_bool go_on = false;

static void open_disk(void)
{
    const struct disk_options options = {
        .directory = scratch_folder, .budget = 64 << 20, .queue = 64 << 20, .readers = 1};
    struct bvhd_error error;
    if (disk_open(&options, &account, &disk, &error) != BVHD_OK)
        fail_msg("%s", error.text);
}

/* Makes triangles whose table names the keys 1 .. NAMES, the last of them twice. */
static void name_micromaps(void)
{
    inputs_triangles_with_micromap(&test);
    for (uint32_t i = 0; i <= NAMES; i++) {
        references[i] = test.references[0];
        references[i].handle += i;
        memset(&references[i].key, (int)(i < NAMES ? NAMES - i : 1), sizeof references[i].key);
    }
    test.input.references = references;
    test.input.reference_count = NAMES + 1;
}

static int set_up(void **state)
{
    (void)state;
    validate_micromaps = true;
    memory_init(&memory, UINT64_MAX);
    memory_init(&blob_memory, UINT64_MAX);
    descriptors = (struct descriptors){.limit = 1000};
    blob_account_init(&account, &blob_memory, &descriptors);
    cache = cache_create(64 << 20, &memory);
    open_disk();
    name_micromaps();
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    cache_destroy(cache);
    disk_close(disk);
    return memory.live || blob_memory.live || account.live_blobs ? -1 : 0;
}

/* Makes the blob of key `name`, whose bytes are all that number; but for OTHER, it says that it is a micromap. */
static struct blob *make_blob(uint32_t name, uint64_t size)
{
    struct blob_writer writer;
    struct blob *blob = NULL;
    struct bvhd_error error;
    blob_writer_init(&writer, &account);
    unsigned char *bytes = writer.output.allocate(&writer.output, size);
    assert_non_null(bytes);
    memset(bytes, (int)name, size);
    if (name != OTHER)
        bytes_put32(bytes + PORTABLE_MICROMAP_BODY, PORTABLE_MICROMAP_MAGIC);
    assert_int_equal(blob_writer_finish(&writer, &blob, &error), BVHD_OK);
    memset(&blob->key, (int)name, sizeof blob->key);
    blob->summary.target = TARGET_PORTABLE;
    blob->summary.quality = QUALITY_FAST;
    strcpy(blob->summary.method, "none");
    return blob;
}

static void put_in_memory(uint32_t name, uint64_t size)
{
    struct blob *blob = make_blob(name, size);
    cache_put(cache, blob);
    blob_unref(blob);
}

/* The disk is closed, so that all is written, and opened again. */
static void put_on_disk(uint32_t name, uint64_t size)
{
    struct blob *blob = make_blob(name, size);
    disk_keep(disk, blob);
    blob_unref(blob);
    disk_close(disk);
    open_disk();
}

static struct micromap_sources list(void)
{
    struct micromap_sources sources = {.memory = &memory, .disk = disk};
    assert_true(micromap_sources_are_named(&test.input));
    assert_int_equal(micromap_sources_list(&sources, &test.input, INDEX, NULL), BVHD_OK);
    return sources;
}

static uint64_t read_all(struct micromap_sources *sources, uint64_t room)
{
    uint64_t size = 4711;
    assert_int_equal(micromap_sources_read(sources, room, &go_on, &size, NULL), BVHD_OK);
    return size;
}

/* Expects the bytes of key `name` in all references of that key; `size` 0: there are none. */
static void expect(uint32_t name, uint64_t size)
{
    for (uint32_t i = 0; i <= NAMES; i++) {
        const struct bytes *blob = &references[i].blob;
        if (references[i].key.bytes[0] != name)
            continue;
        assert_int_equal(blob->size, size);
        assert_int_equal(blob->data == NULL, size == 0);
        for (uint64_t k = 0; k < size; k += 999)
            assert_int_equal(blob->data[k], name);
        assert_true((uintptr_t)blob->data % 16 == 0);
    }
}

static void keys_are_listed_once(void **state)
{
    (void)state;
    struct micromap_sources sources = list();
    assert_int_equal(sources.count, NAMES);
    for (uint32_t i = 0; i < NAMES; i++)
        assert_int_equal(sources.rows[i].key.bytes[KEY_SIZE - 1], i + 1);
    micromap_sources_finish(&sources);
    micromap_sources_finish(&sources);
    for (uint32_t i = 0; i <= NAMES; i++)
        references[i].kind = REFERENCE_BLAS;
    assert_false(micromap_sources_are_named(&test.input));
    references[0].kind = REFERENCE_MICROMAP;
    references[0].has_key = false;
    assert_false(micromap_sources_are_named(&test.input));
    references[0].has_key = true;
    test.input.type = STRUCTURE_TOP;
    assert_false(micromap_sources_are_named(&test.input));
}

static void too_many_are_refused(void **state)
{
    (void)state;
    struct micromap_sources sources = {.memory = &memory};
    struct bvhd_error error;
    struct reference *many = calloc(MICROMAP_SOURCES_MOST + 1, sizeof *many);
    for (uint32_t i = 0; i <= MICROMAP_SOURCES_MOST; i++)
        many[i] = references[i % NAMES];
    test.input.references = many;
    test.input.reference_count = MICROMAP_SOURCES_MOST + 1;
    assert_int_equal(micromap_sources_list(&sources, &test.input, INDEX, &error), BVHD_TOO_LARGE);
    assert_string_equal(error.where, "infos[3].references");
    assert_null(sources.rows);
    test.input.reference_count--;
    memory.fail_after = 0;
    assert_int_equal(micromap_sources_list(&sources, &test.input, INDEX, &error), BVHD_NO_MEMORY);
    memory.fail_after = -1;
    assert_int_equal(micromap_sources_list(&sources, &test.input, INDEX, &error), BVHD_OK);
    assert_int_equal(sources.count, NAMES);
    micromap_sources_finish(&sources);
    free(many);
}

/* One lies in memory, one in a descriptor, one on disk, and one is missing. */
static void what_is_there_is_found(void **state)
{
    (void)state;
    put_in_memory(1, SMALL);
    put_in_memory(2, LARGE);
    put_on_disk(3, LARGE + 5);
    struct micromap_sources sources = list();
    micromap_sources_look_up(&sources, cache);
    assert_int_equal(read_all(&sources, UINT64_MAX), SMALL + LARGE + LARGE + 5);
    assert_int_equal(read_all(&sources, UINT64_MAX), SMALL + LARGE + LARGE + 5);
    assert_int_equal(micromap_sources_open(&sources, references, NAMES + 1, INDEX, NULL), BVHD_OK);
    expect(1, SMALL);
    expect(2, LARGE);
    expect(3, LARGE + 5);
    expect(4, 0);
    micromap_sources_close(&sources);
    assert_int_equal(cache_load(cache).entries, 2);
    micromap_sources_keep(&sources, cache);
    assert_int_equal(cache_load(cache).entries, 3);
    for (uint32_t i = 0; i < NAMES; i++)
        assert_null(sources.rows[i].blob);
    micromap_sources_look_up(&sources, cache);
    cache_clear(cache);
    while (cache_trim(cache)) {
    }
    assert_int_equal(read_all(&sources, 0), SMALL + LARGE + LARGE + 5);
    micromap_sources_finish(&sources);
}

/* Without a disk nothing is missed that the memory has. */
static void a_disk_is_not_needed(void **state)
{
    (void)state;
    put_in_memory(3, SMALL);
    struct micromap_sources sources = list();
    sources.disk = NULL;
    micromap_sources_look_up(&sources, cache);
    assert_int_equal(read_all(&sources, UINT64_MAX), SMALL);
    assert_int_equal(micromap_sources_open(&sources, references, NAMES + 1, INDEX, NULL), BVHD_OK);
    expect(3, SMALL);
    expect(1, 0);
    micromap_sources_close(&sources);
    micromap_sources_finish(&sources);
}

/* With less room than all take nothing is read that exceeds it, and the bytes of all are told. */
static void no_more_is_read_than_was_promised(void **state)
{
    (void)state;
    const uint64_t all = SMALL + 3 * (uint64_t)LARGE;
    put_in_memory(1, SMALL);
    for (uint32_t name = 2; name <= NAMES; name++)
        put_on_disk(name, LARGE);
    static const struct {
        uint64_t room;
        uint32_t read;
    } cases[] = {{0, 0},
                 {SMALL + LARGE - 1, 0},
                 {SMALL + LARGE, 1},
                 {SMALL + 3 * (uint64_t)LARGE - 1, 2},
                 {SMALL + 3 * (uint64_t)LARGE, 3}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct micromap_sources sources = list();
        uint32_t read = 0;
        micromap_sources_look_up(&sources, cache);
        assert_int_equal(read_all(&sources, cases[i].room), all);
        for (uint32_t k = 0; k < NAMES; k++)
            read += sources.rows[k].is_read;
        assert_int_equal(read, cases[i].read);
        assert_int_equal(disk_state(disk).read_errors, 0);
        micromap_sources_finish(&sources);
    }
}

/* Of the structures of these keys, one is no micromap. */
static void other_structures_are_refused(void **state)
{
    (void)state;
    struct bvhd_error error;
    put_in_memory(2, LARGE);
    put_in_memory(OTHER, SMALL);
    struct micromap_sources sources = list();
    micromap_sources_look_up(&sources, cache);
    assert_int_equal(micromap_sources_open(&sources, references, NAMES + 1, INDEX, &error), BVHD_INVALID);
    assert_string_equal(error.where, "infos[3].references[0]");
    for (uint32_t i = 0; i < NAMES; i++)
        assert_null(sources.rows[i].mapped);
    micromap_sources_finish(&sources);
}

static void a_cancelled_reading_ends(void **state)
{
    (void)state;
    const atomic_bool cancel = true;
    struct bvhd_error error;
    uint64_t size = 4711;
    put_on_disk(2, LARGE);
    struct micromap_sources sources = list();
    assert_int_equal(micromap_sources_read(&sources, UINT64_MAX, &cancel, &size, &error), BVHD_CANCELLED);
    assert_int_equal(size, 4711);
    descriptors.limit = descriptors.used;
    assert_int_equal(micromap_sources_read(&sources, UINT64_MAX, &go_on, &size, &error), BVHD_BUSY);
    micromap_sources_finish(&sources);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(keys_are_listed_once, set_up, tear_down),
        cmocka_unit_test_setup_teardown(too_many_are_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(what_is_there_is_found, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_disk_is_not_needed, set_up, tear_down),
        cmocka_unit_test_setup_teardown(no_more_is_read_than_was_promised, set_up, tear_down),
        cmocka_unit_test_setup_teardown(other_structures_are_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(a_cancelled_reading_ends, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, scratch_make, scratch_remove);
}
