/* SPDX-License-Identifier: Apache-2.0 */
/* test_reference_rows.c - tests that handles become reference rows, in the order of first use. */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/builder/inputs.h"
#include "tests/support/builder/prepare_bed.h"
#include "builder/input/prepare.h"
#include "tests/support/random.h"
#include "builder/input/reference_rows.h"
#include "proto/base/validate_shape.h"

static void instances_are_copied(void **state)
{
    (void)state;
    struct test_input test;
    inputs_instances(&test);
    struct canonical canonical = bed_make(&test);
    static const uint64_t rows[INPUTS_RECORDS] = {1, 0, 2, 1};
    assert_int_equal(canonical.type, STRUCTURE_TOP);
    assert_int_equal(canonical.reference_count, 2);
    for (uint32_t i = 0; i < INPUTS_RECORDS; i++) {
        struct canonical_instance instance = canonical_instance(canonical.geometries, i);
        assert_int_equal(instance.reference, rows[i]);
        assert_int_equal(instance.custom_index, 0x123450 + i);
        assert_int_equal(instance.sbt_offset, 0x54321 + i);
        assert_memory_equal(canonical.geometries[0].instances + (ptrdiff_t)64 * i, test.records[i], 56);
    }
    /* Handle 77 is used first and has bounds only; 55 has a key; 33 is not named. */
    struct key none = {{0}};
    assert_true(key_equal(&canonical.references[0].key, &none));
    assert_memory_equal(&canonical.references[0].bounds, &test.references[2].bounds, sizeof(struct box));
    assert_true(key_equal(&canonical.references[1].key, &test.references[1].key));
    bed_finish(&canonical);
}

/*
 * The values of handles and unnamed references do not change the bytes; two handles give two rows, whatever they name.
 */
static void references_are_canonical(void **state)
{
    (void)state;
    struct test_input test, other;
    inputs_instances(&test);
    inputs_instances(&other);
    other.references[0] = test.references[2];
    other.references[1] = test.references[1];
    other.references[0].handle = 1;
    other.references[1].handle = UINT64_MAX;
    other.input.reference_count = 2;
    static const uint64_t handles[INPUTS_RECORDS] = {1, 0, UINT64_MAX, 1};
    for (int i = 0; i < INPUTS_RECORDS; i++)
        memcpy(other.records[i] + 14, &handles[i], 8);
    bed_compare(&test, &other, true);

    other.references[2] = other.references[0];
    other.references[2].handle = 2;
    other.input.reference_count = 3;
    bed_compare(&test, &other, true);
    memcpy(other.records[3] + 14, &other.references[2].handle, 8);
    bed_compare(&test, &other, false);
    memcpy(other.records[3] + 14, &other.references[0].handle, 8);

    /* An empty structure has only one form. */
    test.references[2].bounds = box_empty();
    other.references[0].bounds = (struct box){{1, 1, 1}, {0, 5, 5}};
    bed_compare(&test, &other, true);
    other.references[0].slabs.max[3] = 1; /* slabs of an empty structure */
    bed_compare(&test, &other, true);
    other.references[1].slabs.min[3] = -0.0f; /* unknown, written in another form */
    bed_compare(&test, &other, true);
    other.references[1].slabs.min[3] = -1;
    bed_compare(&test, &other, false);
}

/* Many references, some of which differ only in their handles: each one that is named has its own row. */
static void many_references_are_told_apart(void **state)
{
    (void)state;
    enum { COUNT = 400 };
    struct random random = {3};
    static struct reference references[COUNT];
    static uint32_t records[COUNT * 2][16];
    struct test_input test;
    inputs_instances(&test);
    static uint64_t handles[COUNT]; /* the handle of each row */
    for (uint64_t i = 0; i < COUNT; i++) {
        references[i] = test.references[2];
        references[i].handle = random_next(&random) | 1;
        references[i].bounds.max[0] = (float)(random_next(&random) % 60);
        references[i].has_key = i % 3 == 0;
        references[i].key.bytes[9] = (uint8_t)(random_next(&random) % 5);
        references[i].slabs.max[i % SLABS_COUNT] = (float)(i % 50);
    }
    for (uint64_t i = 0; i < 2 * COUNT; i++) {
        memcpy(records[i], test.records[0], 64);
        uint64_t handle = i % 7 ? references[random_next(&random) % COUNT].handle : 0;
        memcpy(records[i] + 14, &handle, 8);
    }
    test.input.references = references;
    test.input.reference_count = COUNT;
    test.geometries[0].instances.records = (struct bytes){(const unsigned char *)records, sizeof records};
    test.geometries[0].range.primitive_count = 2 * COUNT;

    struct canonical canonical = bed_make(&test);
    uint64_t seen = 0;
    for (uint32_t i = 0; i < 2 * COUNT; i++) {
        uint64_t handle, row = canonical_instance(canonical.geometries, i).reference;
        memcpy(&handle, records[i] + 14, 8);
        assert_int_equal(row == 0, handle == 0);
        if (row == 0)
            continue;
        assert_true(row <= seen + 1);
        if (row > seen) {
            seen = row;
            handles[row - 1] = handle;
        }
        assert_true(handles[row - 1] == handle);
        const struct reference *reference = references;
        while (reference->handle != handle)
            reference++;
        struct key none = {{0}};
        const struct canonical_reference *got = &canonical.references[row - 1];
        assert_true(key_equal(&got->key, reference->has_key ? &reference->key : &none));
        assert_memory_equal(&got->bounds, &reference->bounds, sizeof(struct box));
        assert_memory_equal(&got->slabs, &reference->slabs, sizeof(struct slabs));
    }
    assert_int_equal(seen, canonical.reference_count);
    for (uint32_t i = 0; i < canonical.reference_count; i++)
        for (uint32_t j = 0; j < i; j++)
            assert_true(handles[i] != handles[j]);
    bed_finish(&canonical);
}

static void references_are_checked(void **state)
{
    (void)state;
    struct test_input test;
    inputs_instances(&test);
    test.references[1].handle = 0;
    bed_refuse(&test, BVHD_INVALID, "", "infos[2].references[1]");
    inputs_instances(&test);
    test.references[2].handle = 33;
    bed_refuse(&test, BVHD_INVALID, "", "infos[2].references[2]");
    inputs_instances(&test);
    test.references[0].bounds.max[1] = INFINITY;
    bed_refuse(&test, BVHD_INVALID, "", "infos[2].references[0]");
    inputs_instances(&test);
    test.references[0].slabs.min[9] = -INFINITY;
    bed_refuse(&test, BVHD_INVALID, "", "infos[2].references[0]");
    inputs_instances(&test);
    test.references[0].slabs.min[9] = NAN;
    bed_refuse(&test, BVHD_INVALID, "", "infos[2].references[0]");
    inputs_instances(&test);
    test.references[0].slabs.min[4] = 1;
    bed_refuse(&test, BVHD_INVALID, "", "infos[2].references[0]");
    inputs_instances(&test);
    test.references[0].kind = (enum reference_kind)2;
    bed_refuse(&test, BVHD_UNSUPPORTED, "", "infos[2].references[0]");
    inputs_instances(&test);
    test.input.references = NULL;
    bed_refuse(&test, BVHD_INVALID, "", "infos[2].references");
}

/* A top level that names a structure that moves has to move itself; whether it does is no part of the copy. */
static void only_what_moves_names_what_moves(void **state)
{
    (void)state;
    struct test_input test, other;
    inputs_instances(&test);
    test.references[0].moves = true; /* which no instance names */
    inputs_instances(&other);
    bed_compare(&test, &other, true);
    test.references[1].moves = true;
    bed_refuse(&test, BVHD_INVALID, "", "infos[2].geometries[0].instances[2].accelerationStructureReference");
    memset(test.records[2] + 14, 0, 8); /* an inactive instance names nothing */
    struct canonical canonical = bed_make(&test);
    bed_finish(&canonical);
    inputs_motion_instances(&test);
    inputs_motion_instances(&other);
    for (int i = 0; i < 3; i++)
        test.references[i].moves = true;
    bed_compare(&test, &other, true);
}

static void micromaps_are_disabled_where_that_is_allowed(void **state)
{
    (void)state;
    struct test_input test;
    validate_micromaps = true;
    inputs_instances(&test);
    test.records[1][13] |= UINT32_C(0x20) << 24; /* inactive, so that it names nothing */
    test.records[2][13] |= UINT32_C(0x10) << 24;
    struct canonical canonical = bed_make(&test);
    assert_int_equal(canonical_instance(canonical.geometries, 2).flags & 0x30, INSTANCE_FORCE_MICROMAP_2_STATE);
    bed_finish(&canonical);
    test.records[2][13] |= UINT32_C(0x20) << 24;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureInstanceKHR-flags-11581",
               "infos[2].geometries[0].instances[2].flags");
    test.references[1].may_disable_micromaps = true;
    canonical = bed_make(&test);
    assert_int_equal(canonical_instance(canonical.geometries, 2).flags & 0x30, 0x30);
    bed_finish(&canonical);
    test.records[3][13] |= UINT32_C(0x20) << 24; /* names another structure */
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureInstanceKHR-flags-11581",
               "infos[2].geometries[0].instances[3].flags");
    validate_micromaps = false;
}

static void failing_allocations_hold_nothing(void **state)
{
    (void)state;
    struct test_input test;
    for (int failures = 0; failures < 3; failures++) {
        struct reference_rows rows = {NULL, 7};
        inputs_instances(&test);
        for (uint64_t i = 0; i < INPUTS_RECORDS; i++)
            memcpy(test.records[i] + 14, &(uint64_t){i % 4}, 8);
        atomic_store(&bed_memory.fail_after, failures);
        const struct reference_records records = {2, GEOMETRY_INSTANCES, INPUTS_RECORDS, (unsigned char *)test.records};
        enum bvhd_status status = reference_rows_make(&records, test.references, 3, &bed_context, &rows, NULL);
        assert_int_equal(status, failures < 2 ? BVHD_NO_MEMORY : BVHD_OK);
        assert_int_equal(rows.count, failures < 2 ? 7 : 3);
        memory_free(&bed_memory, rows.rows);
        assert_int_equal(bed_memory.live, 0);
    }
    atomic_store(&bed_memory.fail_after, -1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(instances_are_copied),
        cmocka_unit_test(references_are_canonical),
        cmocka_unit_test(many_references_are_told_apart),
        cmocka_unit_test(references_are_checked),
        cmocka_unit_test(only_what_moves_names_what_moves),
        cmocka_unit_test(micromaps_are_disabled_where_that_is_allowed),
        cmocka_unit_test(failing_allocations_hold_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
