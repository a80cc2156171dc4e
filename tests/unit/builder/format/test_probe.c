/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_probe.c - tests that probes are packed and unpacked, that hostile ones are refused, and which target matches
 * them.
 */
#include "tests/support/unit.h"

#include "builder/format/lavapipe.h"
#include "proto/base/parallel.h"
#include "builder/format/probe.h"
#include "tests/support/builder/synthetic_probe.h"

enum { NAMES = 24, HANDLES = NAMES + 2 * PROBE_NAME_SIZE, SIZES = HANDLES + 24, HEADER = SIZES + 24 };

struct fixture {
    struct memory memory;
    unsigned char *data;
    uint64_t size;
    struct probe probe; /* unpacked from data */
};

static void fixture_init(struct fixture *f, enum lavapipe_variant variant)
{
    struct bvhd_error error;
    memory_init(&f->memory, UINT64_MAX);
    synthetic_probe(variant, 7, &f->memory, &f->data, &f->size);
    assert_int_equal(probe_unpack((struct bytes){f->data, f->size}, &f->probe, &error), BVHD_OK);
}

static void fixture_finish(struct fixture *f)
{
    memory_free(&f->memory, f->data);
    assert_int_equal(f->memory.live, 0);
}

/* ---- The request ---- */

static struct box box_of(const struct canonical *canonical)
{
    struct box box = box_empty();
    for (uint32_t g = 0; g < canonical->geometry_count; g++) {
        const struct canonical_geometry *geometry = &canonical->geometries[g];
        for (uint32_t i = 0; geometry->positions && i < geometry->vertex_count; i++)
            box_add_point(&box, geometry->positions + 3 * (size_t)i);
        for (uint32_t i = 0; geometry->boxes && i < 2 * geometry->primitive_count; i++)
            box_add_point(&box, geometry->boxes + 3 * (size_t)i);
    }
    return box;
}

static void requests_are_consistent(void **state)
{
    (void)state;
    struct probe_request requests[PROBE_COUNT];
    for (int which = 0; which < PROBE_COUNT; which++) {
        const struct canonical *canonical = &requests[which].canonical;
        probe_request_init(&requests[which], (enum probe_structure)which);
        assert_int_equal(canonical->type, which == PROBE_INSTANCES ? STRUCTURE_TOP : STRUCTURE_BOTTOM);
        assert_int_equal(canonical->geometry_count, which == PROBE_INSTANCES ? 1 : 2);
        uint32_t primitives = 0, vertices = 0;
        for (uint32_t g = 0; g < canonical->geometry_count; g++) {
            const struct canonical_geometry *geometry = &canonical->geometries[g];
            assert_int_equal(geometry->type, which);
            assert_int_equal(geometry->first_primitive, primitives);
            assert_int_equal(geometry->first_vertex, vertices);
            assert_int_equal(geometry->vertex_count, which == PROBE_TRIANGLES ? 3 * geometry->primitive_count : 0);
            assert_true(geometry->primitive_count > 0 && !geometry->indices);
            primitives += geometry->primitive_count;
            vertices += geometry->vertex_count;
        }
        assert_int_equal(canonical->primitive_count, primitives);
        assert_int_equal(canonical->vertex_count, vertices);
    }
    const struct canonical *top = &requests[PROBE_INSTANCES].canonical;
    assert_int_equal(top->primitive_count, 2);
    assert_int_equal(top->reference_count, 2);
    for (uint32_t i = 0; i < 2; i++) {
        struct box box = box_of(&requests[i].canonical);
        assert_memory_equal(&box, &top->references[i].bounds, sizeof box);
        assert_int_equal(canonical_instance(&top->geometries[0], i).reference, i + 1);
    }
}

/* ---- The block ---- */

static void packing_and_unpacking(void **state)
{
    (void)state;
    struct fixture f;
    fixture_init(&f, LAVAPIPE_PLAIN);
    struct probe again;
    struct bvhd_error error;
    unsigned char *data;
    uint64_t size;
    assert_int_equal(probe_pack(&f.probe, &f.memory, &data, &size, &error), BVHD_OK);
    assert_int_equal(size, f.size);
    assert_memory_equal(data, f.data, size);
    assert_int_equal(probe_unpack((struct bytes){data, size}, &again, &error), BVHD_OK);
    assert_string_equal(again.device, f.probe.device);
    assert_string_equal(again.driver, f.probe.driver);
    assert_memory_equal(again.handles, f.probe.handles, sizeof again.handles);
    for (int i = 0; i < PROBE_COUNT; i++)
        assert_int_equal(again.structures[i].size, f.probe.structures[i].size);
    memory_free(&f.memory, data);
    fixture_finish(&f);
}

/* The block is as FORMATS.md documents it. */
static void the_block_is_as_documented(void **state)
{
    (void)state;
    struct fixture f;
    struct probe probe = {.device = "a device", .driver = "a driver", .handles = {1, 2, 0x123456789abcdef0}};
    static const unsigned char bytes[11] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
    unsigned char *data;
    uint64_t size;
    memory_init(&f.memory, UINT64_MAX);
    for (uint64_t i = 0; i < PROBE_COUNT; i++)
        probe.structures[i] = (struct bytes){bytes, 7 + 2 * i}; /* 7, 9, 11 bytes */
    assert_int_equal(probe_pack(&probe, &f.memory, &data, &size, NULL), BVHD_OK);
    assert_int_equal(size, HEADER + 8 + 16 + 16);
    assert_memory_equal(data, "bvhdprob\1\0\0\0\3\0\0\0", 16);
    assert_int_equal(bytes_get64(data + 16), size);
    assert_string_equal((const char *)data + 24, "a device");
    assert_string_equal((const char *)data + 280, "a driver");
    assert_int_equal(bytes_get64(data + 552), 0x123456789abcdef0);
    assert_int_equal(bytes_get64(data + 560), 7);
    assert_int_equal(bytes_get64(data + 576), 11);
    assert_memory_equal(data + 584, "\1\2\3\4\5\6\7\0\1\2\3\4\5\6\7\10\11\0\0\0\0\0\0\0\1", 25);
    memory_free(&f.memory, data);
    probe.structures[1].size = PROBE_MAX_STRUCTURE + 1;
    assert_int_equal(probe_pack(&probe, &f.memory, &data, &size, NULL), BVHD_TOO_LARGE);
    probe.structures[1].size = 0;
    assert_int_equal(probe_pack(&probe, &f.memory, &data, &size, NULL), BVHD_TOO_LARGE);
    assert_int_equal(f.memory.live, 0);
}

static void spoil(struct fixture *f, uint64_t at, uint64_t value, enum bvhd_status status, const char *where)
{
    uint64_t old = bytes_get64(f->data + at);
    struct probe probe;
    struct bvhd_error error;
    bytes_put64(f->data + at, value);
    assert_int_equal(probe_unpack((struct bytes){f->data, f->size}, &probe, &error), status);
    assert_string_equal(error.where, where);
    bytes_put64(f->data + at, old);
}

static void hostile_blocks_are_refused(void **state)
{
    (void)state;
    struct fixture f;
    fixture_init(&f, LAVAPIPE_PLAIN);
    spoil(&f, 0, 0, BVHD_CORRUPT, "probe");
    spoil(&f, 8, (uint64_t)3 << 32 | 2, BVHD_INCOMPATIBLE, "probe.version");
    spoil(&f, 8, (uint64_t)2 << 32 | 1, BVHD_CORRUPT, "probe.structures");
    spoil(&f, 16, f.size - 8, BVHD_CORRUPT, "probe.size");
    spoil(&f, NAMES + PROBE_NAME_SIZE - 8, 1, BVHD_CORRUPT, "probe.device");
    spoil(&f, HANDLES - 8, UINT64_MAX, BVHD_CORRUPT, "probe.driver");
    spoil(&f, SIZES, 0, BVHD_CORRUPT, "probe.structures[0]");
    spoil(&f, SIZES + 8, PROBE_MAX_STRUCTURE, BVHD_CORRUPT, "probe.structures[1]");
    spoil(&f, SIZES + 8, PROBE_MAX_STRUCTURE + 1, BVHD_CORRUPT, "probe.structures[1]");
    spoil(&f, SIZES + 16, UINT64_MAX, BVHD_CORRUPT, "probe.structures[2]");
    spoil(&f, SIZES + 16, bytes_get64(f.data + SIZES + 16) - 8, BVHD_CORRUPT, "probe");
    fixture_finish(&f);
}

static void a_name_without_an_end(void **state)
{
    (void)state;
    struct fixture f;
    fixture_init(&f, LAVAPIPE_PLAIN);
    struct probe probe;
    memset(f.data + NAMES, 'x', PROBE_NAME_SIZE);
    assert_int_equal(probe_unpack((struct bytes){f.data, f.size}, &probe, NULL), BVHD_CORRUPT);
    f.data[NAMES + PROBE_NAME_SIZE - 1] = 0;
    assert_int_equal(probe_unpack((struct bytes){f.data, f.size}, &probe, NULL), BVHD_OK);
    assert_int_equal(strlen(probe.device), PROBE_NAME_SIZE - 1);
    fixture_finish(&f);
}

static void every_truncation_and_an_extra_byte(void **state)
{
    (void)state;
    struct fixture f;
    struct probe probe;
    fixture_init(&f, LAVAPIPE_COMPACTED);
    for (uint64_t size = 0; size <= f.size + 1; size++) {
        unsigned char *cut = calloc(1, size + !size);
        assert_non_null(cut);
        memcpy(cut, f.data, size < f.size ? size : f.size);
        for (int agrees = 0; agrees < 2; agrees++) {
            if (agrees && size >= 24)
                bytes_put64(cut + 16, size);
            enum bvhd_status status = probe_unpack((struct bytes){cut, size}, &probe, NULL);
            assert_int_equal(status, size == f.size ? BVHD_OK : BVHD_CORRUPT);
        }
        free(cut);
    }
    fixture_finish(&f);
}

/* ---- Matching ---- */

static enum bvhd_status match(struct fixture *f, enum target *ret_target, struct device_format *ret_format,
                              struct bvhd_error *error)
{
    uint64_t live = f->memory.live;
    enum bvhd_status status = probe_match(&f->probe, &f->memory, ret_target, ret_format, error);
    assert_int_equal(f->memory.live, live);
    return status;
}

static void each_variant_is_found(void **state)
{
    (void)state;
    for (int variant = 1; variant <= LAVAPIPE_VARIANTS; variant++) {
        struct fixture f;
        struct device_format format, expected = synthetic_format((enum lavapipe_variant)variant, 7);
        enum target target;
        struct bvhd_error error;
        fixture_init(&f, (enum lavapipe_variant)variant);
        if (match(&f, &target, &format, &error) != BVHD_OK)
            fail_msg("%s: %s", error.where, error.text);
        assert_int_equal(target, TARGET_LAVAPIPE);
        assert_memory_equal(&format, &expected, sizeof format);
        fixture_finish(&f);
    }
}

/*
 * Returns whether byte `at` of a structure belongs to a float of a box in a top level, where roundings may differ, or
 * to a UUID, which the probe is there to find.
 */
static bool may_differ(const struct probe *probe, int structure, uint64_t at)
{
    if (structure != PROBE_INSTANCES)
        return false;
    uint64_t body = 56 + 8 * 2, box = body + LAVAPIPE_HEADER;
    (void)probe;
    return (at >= body && at < body + 24) || (at >= box && at < box + 48);
}

/* Any other changed bit of a structure means another layout, and the text says where. */
static void every_bit_counts(void **state)
{
    (void)state;
    static const char *const names[] = {"PROBE_TRIANGLES", "PROBE_AABBS", "PROBE_INSTANCES"};
    for (int variant = 1; variant <= LAVAPIPE_VARIANTS; variant++) {
        struct fixture f;
        fixture_init(&f, (enum lavapipe_variant)variant);
        for (int i = 0; i < PROBE_COUNT; i++) {
            unsigned char *bytes = (unsigned char *)(uintptr_t)f.probe.structures[i].data;
            for (uint64_t at = 0; at < f.probe.structures[i].size; at++) {
                struct device_format format = {.variant = 77};
                enum target target = (enum target)77;
                struct bvhd_error error;
                unsigned char flip = (unsigned char)(1u << at % 8);
                if (may_differ(&f.probe, i, at))
                    flip = 0x80; /* another sign or exponent is not a rounding difference */
                bytes[at] ^= flip;
                enum bvhd_status status = match(&f, &target, &format, &error);
                bytes[at] ^= flip;
                if (status == BVHD_OK && may_differ(&f.probe, i, at))
                    continue;
                assert_int_equal(status, BVHD_UNSUPPORTED);
                assert_int_equal(target, 77);
                assert_int_equal(format.variant, 77);
                if (at >= 56 && i > 0)
                    assert_non_null(strstr(error.text, names[i]));
            }
        }
        fixture_finish(&f);
    }
}

static void differences_are_named(void **state)
{
    (void)state;
    struct fixture f;
    struct device_format format;
    enum target target;
    struct bvhd_error error;
    fixture_init(&f, LAVAPIPE_PLAIN);
    unsigned char *bytes = (unsigned char *)(uintptr_t)f.probe.structures[PROBE_AABBS].data;
    uint64_t last = f.probe.structures[PROBE_AABBS].size - 1;
    bytes[last] ^= 1;
    assert_int_equal(match(&f, &target, &format, &error), BVHD_UNSUPPORTED);
    char expected[64];
    snprintf(expected, sizeof expected, "PROBE_AABBS differs at byte %llu", (unsigned long long)last);
    assert_non_null(strstr(error.text, expected));
    bytes[last] ^= 1;
    f.probe.handles[0] ^= 1; /* an address that no instance names */
    assert_int_equal(match(&f, &target, &format, &error), BVHD_UNSUPPORTED);
    assert_non_null(strstr(error.text, "PROBE_INSTANCES"));
    f.probe.handles[0] ^= 1;
    assert_int_equal(match(&f, &target, &format, &error), BVHD_OK);
    fixture_finish(&f);
}

/* The bounds of instances may differ in the last place, as different drivers round them. */
static void bounds_of_instances_may_be_rounded(void **state)
{
    (void)state;
    struct fixture f;
    struct device_format format;
    enum target target;
    struct bvhd_error error;
    fixture_init(&f, LAVAPIPE_PLAIN);
    unsigned char *bytes = (unsigned char *)(uintptr_t)f.probe.structures[PROBE_INSTANCES].data;
    unsigned char *bound = bytes + 56 + 16 + LAVAPIPE_HEADER;
    bytes_put32(bound, bytes_get32(bound) + 2);
    assert_int_equal(match(&f, &target, &format, &error), BVHD_OK);
    bytes_put32(bound, bytes_get32(bound) + 200);
    assert_int_equal(match(&f, &target, &format, &error), BVHD_UNSUPPORTED);
    fixture_finish(&f);
}

static void other_structures_match_nothing(void **state)
{
    (void)state;
    struct fixture f, other;
    struct device_format format;
    enum target target;
    struct bvhd_error error;
    fixture_init(&f, LAVAPIPE_PLAIN);
    fixture_init(&other, LAVAPIPE_COMPACTED);
    struct bytes own = f.probe.structures[PROBE_AABBS];
    f.probe.structures[PROBE_AABBS] = other.probe.structures[PROBE_AABBS]; /* then the structures are of two variants */
    assert_int_equal(match(&f, &target, &format, &error), BVHD_UNSUPPORTED);
    f.probe.structures[PROBE_AABBS] = f.probe.structures[PROBE_TRIANGLES];
    assert_int_equal(match(&f, &target, &format, &error), BVHD_UNSUPPORTED);
    f.probe.structures[PROBE_AABBS] = own;
    own = f.probe.structures[PROBE_TRIANGLES];
    f.probe.structures[PROBE_TRIANGLES] = f.probe.structures[PROBE_INSTANCES];
    assert_int_equal(match(&f, &target, &format, &error), BVHD_UNSUPPORTED);
    for (uint64_t size = 0; size < own.size; size++) {
        f.probe.structures[PROBE_TRIANGLES] = (struct bytes){own.data, size};
        assert_int_equal(match(&f, &target, &format, &error), BVHD_UNSUPPORTED);
    }
    fixture_finish(&other);
    fixture_finish(&f);
}

static void failing_allocations_are_reported(void **state)
{
    (void)state;
    struct fixture f;
    struct device_format format = {.variant = 77};
    enum target target;
    unsigned char *data;
    uint64_t size;
    int failures = 0;
    fixture_init(&f, LAVAPIPE_COMPACTED);
    f.memory.fail_after = 0;
    assert_int_equal(probe_pack(&f.probe, &f.memory, &data, &size, NULL), BVHD_NO_MEMORY);
    for (;; failures++) {
        struct bvhd_error error;
        f.memory.fail_after = failures;
        enum bvhd_status status = match(&f, &target, &format, &error);
        if (status == BVHD_OK)
            break;
        assert_int_equal(status, BVHD_NO_MEMORY);
        assert_int_equal(error.status, BVHD_NO_MEMORY);
        assert_int_equal(format.variant, 77);
    }
    f.memory.fail_after = -1;
    assert_true(failures > 9);
    fixture_finish(&f);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(requests_are_consistent),        cmocka_unit_test(packing_and_unpacking),
        cmocka_unit_test(the_block_is_as_documented),     cmocka_unit_test(hostile_blocks_are_refused),
        cmocka_unit_test(a_name_without_an_end),          cmocka_unit_test(every_truncation_and_an_extra_byte),
        cmocka_unit_test(each_variant_is_found),          cmocka_unit_test(every_bit_counts),
        cmocka_unit_test(differences_are_named),          cmocka_unit_test(bounds_of_instances_may_be_rounded),
        cmocka_unit_test(other_structures_match_nothing), cmocka_unit_test(failing_allocations_are_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
