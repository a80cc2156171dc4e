/* SPDX-License-Identifier: Apache-2.0 */
/* test_content_key.c - tests that keys are as the header defines them, and change with whatever matters. */
#include "tests/support/unit.h"

#include <openssl/crypto.h>
#include <openssl/sha.h>

#include "builder/build.h"
#include "builder/content_key.h"
#include "builder/piece/embree.h"
#include "tests/support/builder/builders.h"
#include "builder/format/lavapipe.h"
#include "builder/workers.h"

enum { LEAF = 1 << 16, LARGEST = 3 * LEAF + 5 };

struct fixture {
    unsigned char *bytes;
    struct memory memory;
};

static int set_up(void **state)
{
    static struct fixture fixture;
    fixture.bytes = malloc(LARGEST);
    for (uint32_t i = 0; i < LARGEST; i++)
        fixture.bytes[i] = (unsigned char)(i * 2654435761u >> 24);
    memory_init(&fixture.memory, UINT64_MAX);
    *state = &fixture;
    return 0;
}

static int tear_down(void **state)
{
    struct fixture *fixture = *state;
    free(fixture->bytes);
    return fixture->memory.live != 0;
}

static struct key key_for(struct fixture *fixture, uint64_t size, const struct build_options *options,
                          const struct parallel *parallel)
{
    struct canonical canonical = {.bytes = size ? fixture->bytes : NULL, .size = size};
    const struct build_context context = {.memory = &fixture->memory, .parallel = parallel};
    struct key key;
    assert_int_equal(content_key(&canonical, options, &context, &key, NULL), BVHD_OK);
    return key;
}

static struct key key_of(struct fixture *fixture, uint64_t size, enum build_quality quality, uint32_t layout_flags,
                         const struct parallel *parallel)
{
    const struct build_options options = {.quality = quality, .target = TARGET_PORTABLE, .layout_flags = layout_flags};
    return key_for(fixture, size, &options, parallel);
}

/*
 * The definition in the header, computed independently: the root is one string of bytes, hashed by another interface of
 * the library.
 */
static struct key expected_key(const unsigned char *bytes, size_t size, const struct build_options *options)
{
    static unsigned char leaf[24 + LEAF], root[16 + 28 + 36 + 8 + 4 * 32];
    memcpy(root, options->builder ? "bvhd key embree\0" : "bvhd key root 2", 16);
    const uint32_t fields[7] = {(uint32_t)size,
                                0,
                                BUILD_VERSION,
                                options->target,
                                layout_find(options->target)->version(GEOMETRY_TRIANGLES),
                                options->layout_flags,
                                (uint32_t)options->quality};
    memcpy(root + 16, fields, 28);
    memset(root + 44, 0, 36);
    if (options->target != TARGET_PORTABLE)
        memcpy(root + 44, &options->device, 36);
    size_t end = 16 + 28 + 36;
    struct embree_identity embree;
    if (options->builder == BUILDER_EMBREE) {
        assert_int_equal(embree_identify(&embree, NULL), BVHD_OK);
        memcpy(root + end, &embree, 8);
        end += 8;
    }
    for (size_t done = 0; done < size; done += LEAF, end += 32) {
        uint64_t length = size - done < LEAF ? size - done : LEAF;
        memcpy(leaf, "bvhd key leaf 1", 16);
        memcpy(leaf + 16, &length, 8);
        memcpy(leaf + 24, bytes + done, length);
        SHA256(leaf, 24 + length, root + end);
    }
    struct key key;
    SHA256(root, end, key.bytes);
    return key;
}

static const uint64_t sizes[] = {0, 1, 63, 64, 1000, LEAF - 1, LEAF, LEAF + 1, 2 * LEAF, LARGEST};

enum { SIZE_COUNT = sizeof sizes / sizeof sizes[0] };

static const struct device_format device = {
    .driver_uuid = "driver", .compatibility_uuid = "compatibility", .variant = LAVAPIPE_COMPACTED};

static void keys_are_as_defined(void **state)
{
    struct fixture *fixture = *state;
    const struct build_options options[] = {
        {QUALITY_HIGH, TARGET_PORTABLE, PORTABLE_FAST_TRIANGLES, device, 0, BUILDER_OWN},
        {QUALITY_HIGH, TARGET_LAVAPIPE, 0, device, 1, BUILDER_OWN},
        {QUALITY_HIGH, TARGET_PORTABLE, PORTABLE_FAST_TRIANGLES, device, 0, builders_last()},
    };
    for (int i = 0; i < 3 * SIZE_COUNT; i++) {
        struct key key = key_for(fixture, sizes[i / 3], &options[i % 3], &parallel_serial);
        struct key expected = expected_key(fixture->bytes, sizes[i / 3], &options[i % 3]);
        assert_true(key_equal(&key, &expected));
    }
}

static void threads_do_not_matter(void **state)
{
    static const unsigned threads[] = {1, 2, 8};
    for (int t = 0; t < 3; t++) {
        struct workers *workers;
        assert_int_equal(workers_create(threads[t], &workers, NULL), BVHD_OK);
        for (int i = 0; i < SIZE_COUNT; i++) {
            struct key key = key_of(*state, sizes[i], QUALITY_FAST, 0, workers_parallel(workers));
            struct key expected = key_of(*state, sizes[i], QUALITY_FAST, 0, &parallel_serial);
            assert_true(key_equal(&key, &expected));
        }
        workers_destroy(workers);
    }
}

static void every_option_matters(void **state)
{
    struct key keys[5] = {
        key_of(*state, 1000, QUALITY_FAST, 0, &parallel_serial),
        key_of(*state, 1000, QUALITY_BALANCED, 0, &parallel_serial),
        key_of(*state, 1000, QUALITY_HIGH, 0, &parallel_serial),
        key_of(*state, 1000, QUALITY_FAST, PORTABLE_FAST_TRIANGLES, &parallel_serial),
        key_of(*state, 1001, QUALITY_FAST, 0, &parallel_serial),
    };
    for (int i = 0; i < 5; i++)
        for (int j = 0; j < i; j++)
            assert_false(key_equal(&keys[i], &keys[j]));
}

/* The definition in the header, computed by another interface of the library. */
/* The version of the layout is that of the kind, so that equal bytes of kinds of other versions have other keys. */
static void kinds_matter_by_their_version(void **state)
{
    struct fixture *fixture = *state;
    const struct build_context context = {.memory = &fixture->memory, .parallel = &parallel_serial};
    const struct build_options options = {.quality = QUALITY_FAST, .target = TARGET_PORTABLE};
    static const uint32_t types[4] = {GEOMETRY_TRIANGLES, GEOMETRY_AABBS, GEOMETRY_SPHERES, GEOMETRY_SWEPT_SPHERES};
    struct key keys[4], updates[4], source = {{7}};
    for (int i = 0; i < 4; i++) {
        struct canonical_geometry geometry = {.type = types[i]};
        struct canonical canonical = {.bytes = fixture->bytes,
                                      .size = LEAF,
                                      .type = STRUCTURE_BOTTOM,
                                      .geometry_count = 1,
                                      .geometries = &geometry};
        assert_int_equal(content_key(&canonical, &options, &context, &keys[i], NULL), BVHD_OK);
        assert_int_equal(content_key_update(&canonical, &options, &source, &context, &updates[i], NULL), BVHD_OK);
    }
    for (int i = 1; i < 4; i++) {
        assert_int_equal(memcmp(&keys[i], &keys[0], sizeof keys[0]) == 0, i < 2);
        assert_int_equal(memcmp(&updates[i], &updates[0], sizeof updates[0]) == 0, i < 2);
    }
    assert_memory_equal(&keys[2], &keys[3], sizeof keys[2]);
}

static void updates_are_named_by_their_source(void **state)
{
    struct fixture *fixture = *state;
    const struct build_options options = {QUALITY_HIGH, TARGET_PORTABLE, PORTABLE_FAST_TRIANGLES, {{0}, {0}, 0}, 0,
                                          BUILDER_OWN};
    const struct canonical canonical = {.bytes = fixture->bytes, .size = 1000};
    const struct build_context context = {.memory = &fixture->memory, .parallel = &parallel_serial};
    unsigned char leaf[24 + 1000] = "bvhd key leaf 1", root[16 + 52 + 32] = "bvhd key update";
    const uint32_t fields[5] = {1000, 0, REFIT_VERSION, TARGET_PORTABLE, 1};
    const uint64_t length = 1000;
    struct key source, key, expected, other;
    memset(&source, 0x5a, sizeof source);
    memcpy(leaf + 16, &length, 8);
    memcpy(leaf + 24, fixture->bytes, 1000);
    memcpy(root + 16, &source, 32);
    memcpy(root + 48, fields, 20);
    SHA256(leaf, sizeof leaf, root + 68);
    SHA256(root, sizeof root, expected.bytes);
    assert_int_equal(content_key_update(&canonical, &options, &source, &context, &key, NULL), BVHD_OK);
    assert_true(key_equal(&key, &expected));
    source.bytes[31] ^= 1;
    assert_int_equal(content_key_update(&canonical, &options, &source, &context, &other, NULL), BVHD_OK);
    assert_false(key_equal(&key, &other));
    const struct build_options unknown = {.target = (enum target)9};
    assert_int_equal(content_key_update(&canonical, &unknown, &source, &context, &key, NULL), BVHD_UNSUPPORTED);
}

/* Vulkan's flags and AUTO lead to the key of the quality that is built. */
static void the_quality_is_the_one_that_is_built(void **state)
{
    struct key balanced = key_of(*state, 1000, QUALITY_BALANCED, 0, &parallel_serial);
    struct key automatic = key_of(*state, 1000, QUALITY_AUTO, 0, &parallel_serial);
    struct key unspecified = key_of(*state, 1000, QUALITY_UNSPECIFIED, 0, &parallel_serial);
    assert_true(key_equal(&balanced, &automatic) && key_equal(&balanced, &unspecified));
}

/*
 * For a native target every byte of the device's identity changes the key; a layout that does not depend on the device
 * has one key for all.
 */
static void devices_matter_to_native_targets_alone(void **state)
{
    struct build_options options = {QUALITY_HIGH, TARGET_LAVAPIPE, 0, device, 0, BUILDER_OWN};
    struct key before = key_for(*state, 1000, &options, &parallel_serial);
    for (size_t i = 0; i < sizeof device; i++) {
        ((unsigned char *)&options.device)[i] ^= 1;
        struct key after = key_for(*state, 1000, &options, &parallel_serial);
        ((unsigned char *)&options.device)[i] ^= 1;
        assert_false(key_equal(&before, &after));
    }
    options.target = TARGET_PORTABLE;
    struct key portable = key_for(*state, 1000, &options, &parallel_serial);
    struct key plain = key_of(*state, 1000, QUALITY_HIGH, 0, &parallel_serial);
    assert_true(key_equal(&portable, &plain));
    assert_false(key_equal(&portable, &before));
}

static void builders_are_checked(void **state)
{
    struct fixture *fixture = *state;
    const struct build_options options = {
        .quality = QUALITY_FAST, .target = TARGET_PORTABLE, .builder = (enum build_builder)2};
    const struct canonical canonical = {.bytes = fixture->bytes, .size = 1000};
    const struct build_context context = {.memory = &fixture->memory, .parallel = &parallel_serial};
    struct bvhd_error error;
    struct key key;
    assert_int_equal(content_key(&canonical, &options, &context, &key, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.where, "build.builder");
}

/* Checks the first and last byte of every leaf, and some between. */
static void every_byte_matters(void **state)
{
    struct fixture *fixture = *state;
    static const uint32_t places[] = {0,        77,           LEAF - 1, LEAF,       2 * LEAF - 1,
                                      2 * LEAF, 3 * LEAF - 1, 3 * LEAF, LARGEST - 1};
    struct key before = key_of(fixture, LARGEST, QUALITY_FAST, 0, &parallel_serial);
    for (size_t i = 0; i < sizeof places / sizeof places[0]; i++) {
        fixture->bytes[places[i]] ^= 0x40;
        struct key after = key_of(fixture, LARGEST, QUALITY_FAST, 0, &parallel_serial);
        fixture->bytes[places[i]] ^= 0x40;
        assert_false(key_equal(&before, &after));
    }
}

/* Swaps two leaves: their order counts. */
static void order_of_leaves_matters(void **state)
{
    struct fixture *fixture = *state;
    struct key before = key_of(fixture, 2 * LEAF, QUALITY_FAST, 0, &parallel_serial);
    for (uint32_t i = 0; i < LEAF; i++) {
        unsigned char byte = fixture->bytes[i];
        fixture->bytes[i] = fixture->bytes[LEAF + i];
        fixture->bytes[LEAF + i] = byte;
    }
    struct key after = key_of(fixture, 2 * LEAF, QUALITY_FAST, 0, &parallel_serial);
    assert_false(key_equal(&before, &after));
}

static void an_unknown_target_is_unsupported(void **state)
{
    struct fixture *fixture = *state;
    struct canonical canonical = {.bytes = fixture->bytes, .size = 100};
    const struct build_context context = {.memory = &fixture->memory, .parallel = &parallel_serial};
    struct key key = {{1, 2, 3}}, untouched = key;
    const struct build_options options = {.quality = QUALITY_FAST, .target = (enum target)99};
    struct bvhd_error error;
    assert_int_equal(content_key(&canonical, &options, &context, &key, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.where, "target");
    assert_true(key_equal(&key, &untouched));
}

static void failing_allocations_are_reported(void **state)
{
    struct fixture *fixture = *state;
    struct canonical canonical = {.bytes = fixture->bytes, .size = LARGEST};
    const struct build_context context = {.memory = &fixture->memory, .parallel = &parallel_serial};
    struct key key = {{1, 2, 3}}, untouched = key;
    const struct build_options options = {.quality = QUALITY_FAST, .target = TARGET_PORTABLE};
    int failures = 0;
    for (;; failures++) {
        fixture->memory.fail_after = failures;
        struct bvhd_error error;
        enum bvhd_status status = content_key(&canonical, &options, &context, &key, &error);
        assert_int_equal(fixture->memory.live, 0);
        if (status == BVHD_OK)
            break;
        assert_int_equal(status, BVHD_NO_MEMORY);
        assert_true(key_equal(&key, &untouched));
    }
    fixture->memory.fail_after = -1;
    assert_true(failures > 0);
}

/* How many more allocations of the hash library succeed; negative: all do. Other tests allocate on several threads. */
static atomic_int hash_allocations = -1;

static bool may_allocate(void)
{
    int left = atomic_load(&hash_allocations);
    if (left > 0)
        atomic_fetch_sub(&hash_allocations, 1);
    return left != 0;
}

static void *hash_malloc(size_t size, const char *file, int line)
{
    (void)file;
    (void)line;
    return may_allocate() ? malloc(size) : NULL;
}

static void *hash_realloc(void *old, size_t size, const char *file, int line)
{
    (void)file;
    (void)line;
    return may_allocate() ? realloc(old, size) : NULL;
}

static void hash_free(void *block, const char *file, int line)
{
    (void)file;
    (void)line;
    free(block);
}

/* A hash library without memory is a shortage, and no defect of ours. */
static void failing_allocations_of_the_hash_library_are_reported(void **state)
{
    struct fixture *fixture = *state;
    struct canonical canonical = {.bytes = fixture->bytes, .size = LARGEST};
    const struct build_context context = {.memory = &fixture->memory, .parallel = &parallel_serial};
    const struct build_options options = {.quality = QUALITY_FAST, .target = TARGET_PORTABLE};
    enum bvhd_status status = BVHD_NO_MEMORY;
    int failures = 0;
    for (; status != BVHD_OK; failures++) {
        struct key key;
        struct bvhd_error error;
        hash_allocations = failures;
        status = content_key(&canonical, &options, &context, &key, &error);
        hash_allocations = -1;
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        assert_int_equal(fixture->memory.live, 0);
    }
    assert_true(failures > 1);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(keys_are_as_defined),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(every_option_matters),
        cmocka_unit_test(kinds_matter_by_their_version),
        cmocka_unit_test(updates_are_named_by_their_source),
        cmocka_unit_test(the_quality_is_the_one_that_is_built),
        cmocka_unit_test(devices_matter_to_native_targets_alone),
        cmocka_unit_test(builders_are_checked),
        cmocka_unit_test(every_byte_matters),
        cmocka_unit_test(order_of_leaves_matters),
        cmocka_unit_test(an_unknown_target_is_unsupported),
        cmocka_unit_test(failing_allocations_are_reported),
        cmocka_unit_test(failing_allocations_of_the_hash_library_are_reported),
    };
    if (!CRYPTO_set_mem_functions(hash_malloc, hash_realloc, hash_free))
        return 1;
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
