/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_probe_source.c - tests that the format to build for is found from a probe's file, which may contain anything,
 * and that a machine without devices is an error.
 */
#include "tests/support/unit.h"

#include <unistd.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/gpu/probe_source.h"
#include "tests/support/builder/synthetic_probe.h"

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static char directory[64], path[128];
static unsigned char *probe;
static uint64_t probe_size;

static int enter(void **state)
{
    (void)state;
    strcpy(directory, "/tmp/bvhd-test-probe-XXXXXX");
    if (!mkdtemp(directory))
        return -1;
    snprintf(path, sizeof path, "%s/a probe", directory);
    synthetic_probe(LAVAPIPE_COMPACTED, 9, &memory, &probe, &probe_size);
    return 0;
}

static int leave(void **state)
{
    (void)state;
    memory_free(&memory, probe);
    unlink(path);
    return rmdir(directory);
}

static void put(const unsigned char *data, uint64_t size)
{
    assert_int_equal(files_write(path, (struct bytes){data, size}, &memory, NULL, NULL), BVHD_OK);
}

static enum bvhd_status read_probe(enum target target, struct bvhd_format *ret_format, struct bvhd_error *error)
{
    struct probe_source source = {path, target};
    uint64_t live = memory.live;
    enum bvhd_status status = probe_source_read(&source, &memory, ret_format, error);
    assert_int_equal(memory.live, live);
    return status;
}

static void test_good(void **state)
{
    (void)state;
    struct bvhd_format format;
    struct device_format want = synthetic_format(LAVAPIPE_COMPACTED, 9);
    put(probe, probe_size);
    for (int named = 0; named < 2; named++) {
        memset(&format, 0, sizeof format);
        assert_int_equal(read_probe(named ? TARGET_LAVAPIPE : (enum target)0, &format, NULL), BVHD_OK);
        assert_int_equal(format.struct_size, sizeof format);
        assert_int_equal(format.target, BVHD_TARGET_LAVAPIPE);
        assert_int_equal(format.variant, LAVAPIPE_COMPACTED);
        assert_memory_equal(format.driver_uuid, want.driver_uuid, 16);
        assert_memory_equal(format.compatibility_uuid, want.compatibility_uuid, 16);
    }
}

static void refuse(enum bvhd_status want)
{
    struct bvhd_error error = {0};
    struct bvhd_format format = {.variant = 77};
    enum bvhd_status status = read_probe(TARGET_LAVAPIPE, &format, &error);
    if (status != want)
        fail_msg("%s: %s: %s", bvhd_status_name(status), error.where, error.text);
    assert_int_equal(error.status, want);
    assert_string_equal(error.where, path);
    assert_true(*error.text);
    assert_int_equal(format.variant, 77);
}

/* Files that are not probes are refused: a probe truncated anywhere or with a byte more, a text, an empty file. */
static void test_no_probes(void **state)
{
    (void)state;
    unsigned char *longer = malloc(probe_size + 1);
    for (uint64_t size = 0; size < probe_size; size += 1 + size / 50) {
        put(probe, size);
        refuse(BVHD_CORRUPT);
    }
    memcpy(longer, probe, probe_size);
    longer[probe_size] = 0;
    put(longer, probe_size + 1);
    refuse(BVHD_CORRUPT);
    put((const unsigned char *)"not a probe, but a text\n", 24);
    refuse(BVHD_CORRUPT);
    free(longer);
    unlink(path);
    refuse(BVHD_NOT_FOUND);
}

/* A probe that no layout reproduces. An id differs in it, because another order of the boxes would be a valid probe. */
static void test_unknown_layout(void **state)
{
    (void)state;
    unsigned char *other = malloc(probe_size);
    memcpy(other, probe, probe_size);
    other[probe_size - 1] ^= 1; /* in the last matrix of the last instance */
    put(other, probe_size);
    refuse(BVHD_UNSUPPORTED);
    free(other);
}

static void test_no_memory(void **state)
{
    (void)state;
    struct bvhd_format format;
    enum bvhd_status status = BVHD_NO_MEMORY;
    put(probe, probe_size);
    for (int64_t after = 0; status == BVHD_NO_MEMORY; after++) {
        atomic_store(&memory.fail_after, after);
        status = read_probe(TARGET_LAVAPIPE, &format, &(struct bvhd_error){0});
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        assert_true(after < 100);
    }
    atomic_store(&memory.fail_after, -1);
}

/* There is no driver: the loader, if this machine has one, searches in a place without drivers. */
static void test_no_device(void **state)
{
    (void)state;
    struct probe_source source = {NULL, TARGET_LAVAPIPE};
    struct bvhd_format format = {.variant = 77};
    struct bvhd_error error;
    uint64_t live = memory.live;
    setenv("VK_DRIVER_FILES", "/nonexistent", 1);
    setenv("VK_ICD_FILENAMES", "/nonexistent", 1);
    assert_int_equal(probe_source_read(&source, &memory, &format, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.where, "--target");
    assert_non_null(strstr(error.text, "no Vulkan device here loads lavapipe structures ("));
    assert_non_null(strstr(error.text, "); use --probe FILE"));
    assert_int_equal(format.variant, 77);
    assert_int_equal(memory.live, live);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_good),      cmocka_unit_test(test_no_probes), cmocka_unit_test(test_unknown_layout),
        cmocka_unit_test(test_no_memory), cmocka_unit_test(test_no_device),
    };
    return cmocka_run_group_tests_name("probe_source", tests, enter, leave);
}
