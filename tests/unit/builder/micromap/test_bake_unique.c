/* SPDX-License-Identifier: Apache-2.0 */
/* test_bake_unique.c - tests that triangles that are alike are found, and equal states are stored once. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/micromap/bake_unique.h"
#include "tests/support/random.h"

enum { VERTICES = 12, TRIANGLES = 500 };

static struct memory memory;
static const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};

static void test_gather(void **state)
{
    (void)state;
    struct random random = {1};
    float coordinates[VERTICES][2], weights[TRIANGLES];
    uint32_t indices[3 * TRIANGLES];
    for (int i = 0; i < VERTICES; i++) {
        coordinates[i][0] = (float)(i / 2); /* two vertices each are alike */
        coordinates[i][1] = i == 3 ? NAN : 1;
    }
    for (int i = 0; i < 3 * TRIANGLES; i++)
        indices[i] = (uint32_t)(random_next(&random) % VERTICES);
    for (int i = 0; i < TRIANGLES; i++)
        weights[i] = (float)(i % 4);
    const struct bake_request request = {.coordinates = (const float(*)[2])coordinates,
                                         .coordinate_count = VERTICES,
                                         .indices = indices,
                                         .triangle_count = TRIANGLES,
                                         .weights = weights};
    struct bake_uniques uniques;
    assert_int_equal(bake_unique_gather(&request, &context, &uniques, NULL), BVHD_OK);
    double weight = 0;
    uint32_t uses = 0, next = 0;
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        float expected[3][2];
        for (int corner = 0; corner < 3; corner++)
            memcpy(expected[corner], coordinates[indices[3 * i + (uint32_t)corner]], sizeof expected[corner]);
        assert_true(uniques.of[i] <= next); /* in the order of the first use */
        next += uniques.of[i] == next;
        assert_memory_equal(uniques.items[uniques.of[i]].coordinates, expected, sizeof expected);
    }
    assert_int_equal(next, uniques.count);
    for (uint32_t i = 0; i < uniques.count; i++) {
        weight += uniques.items[i].weight;
        uses += uniques.items[i].uses;
        for (uint32_t j = 0; j < i; j++)
            assert_memory_not_equal(uniques.items[i].coordinates, uniques.items[j].coordinates, 24);
    }
    assert_true(weight == 750 && uses == TRIANGLES);
    bake_unique_finish(&uniques, &memory);
    assert_int_equal(memory.live, 0);
}

static void test_refusals(void **state)
{
    (void)state;
    const float coordinates[3][2] = {{0, 0}, {1, 0}, {0, 1}};
    uint32_t indices[6] = {0, 1, 2, 2, 1, 3};
    float weights[2] = {1, 1};
    struct bake_request request = {
        .coordinates = coordinates, .coordinate_count = 3, .indices = indices, .triangle_count = 2, .weights = weights};
    struct bake_uniques uniques;
    struct bvhd_error error;
    assert_int_equal(bake_unique_gather(&request, &context, &uniques, &error), BVHD_INVALID);
    assert_string_equal(error.where, "triangles[1]");
    indices[5] = 0;
    weights[1] = -1;
    assert_int_equal(bake_unique_gather(&request, &context, &uniques, &error), BVHD_INVALID);
    weights[1] = NAN;
    assert_int_equal(bake_unique_gather(&request, &context, &uniques, &error), BVHD_INVALID);
    assert_string_equal(error.where, "weights[1]");
    weights[1] = 1;
    request.indices = NULL; /* needs 6 coordinates */
    assert_int_equal(bake_unique_gather(&request, &context, &uniques, &error), BVHD_INVALID);
    request.indices = indices;
    for (int i = 0; i < 3; i++) {
        memory.fail_after = i;
        assert_int_equal(bake_unique_gather(&request, &context, &uniques, &error), BVHD_NO_MEMORY);
    }
    memory.fail_after = -1;
    atomic_bool cancel = true;
    struct build_context cancelled = context;
    cancelled.cancel = &cancel;
    assert_int_equal(bake_unique_gather(&request, &cancelled, &uniques, &error), BVHD_CANCELLED);
    assert_int_equal(memory.live, 0);
}

/* Items with states of one of a few kinds, of two levels, some with a special index. */
static void test_share(void **state)
{
    (void)state;
    enum { ITEMS = 300, KINDS = 7 };
    struct bake_unique items[ITEMS] = {{.level = 0}};
    unsigned char data[ITEMS * 64], old[ITEMS * 64];
    uint64_t filled = 0;
    struct random random = {2};
    for (int i = 0; i < ITEMS; i++) {
        const uint64_t kind = random_next(&random) % KINDS;
        items[i].level = kind % 2 ? 4 : 2;
        items[i].offset = filled;
        if (kind == 0) {
            items[i].index = -2;
            continue;
        }
        const uint32_t size = micro_triangle_bytes(MICRO_4_STATE, items[i].level);
        memset(data + filled, (int)(kind / 2), size);
        /* A wrong hash must not share what differs: all kinds have one of two. */
        items[i].hash = kind / 2 % 2;
        filled += size;
    }
    memcpy(old, data, filled);
    uint64_t offsets[ITEMS], size;
    for (int i = 0; i < ITEMS; i++)
        offsets[i] = items[i].offset;
    struct bake_uniques uniques = {.items = items, .count = ITEMS};
    uint32_t count;
    assert_int_equal(bake_unique_share(&uniques, MICRO_4_STATE, data, &context, &size, &count, NULL), BVHD_OK);
    assert_int_equal(count, KINDS - 1);
    assert_int_equal(size, 3 * 64 + 3 * 4);
    for (int i = 0; i < ITEMS; i++) {
        if (items[i].index < 0)
            continue;
        assert_true((uint32_t)items[i].index < count);
        assert_memory_equal(data + items[i].offset, old + offsets[i],
                            micro_triangle_bytes(MICRO_4_STATE, items[i].level));
    }
    memory.fail_after = 0;
    assert_int_equal(bake_unique_share(&uniques, MICRO_4_STATE, data, &context, &size, &count, NULL), BVHD_NO_MEMORY);
    memory.fail_after = -1;
}

static void test_hash(void **state)
{
    (void)state;
    unsigned char bytes[40] = {0};
    const uint64_t zero = bake_unique_hash(bytes, 40);
    assert_true(zero == bake_unique_hash(bytes, 40));
    assert_true(zero != bake_unique_hash(bytes, 39));
    for (int i = 0; i < 40; i++) {
        bytes[i] = 1;
        assert_true(bake_unique_hash(bytes, 40) != zero);
        bytes[i] = 0;
    }
}

int main(void)
{
    memory_init(&memory, UINT64_MAX);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_gather),
        cmocka_unit_test(test_refusals),
        cmocka_unit_test(test_share),
        cmocka_unit_test(test_hash),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
