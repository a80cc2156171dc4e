/* SPDX-License-Identifier: Apache-2.0 */
/* test_arena.c - tests that ranges are taken at the lowest place, joined again when given back, and never overlap. */
#include "tests/support/unit.h"

#include "client/arena.h"

static struct memory memory;

static void test_lowest_place(void **state)
{
    (void)state;
    struct arena arena;
    uint64_t a = 1, b = 1, c = 1, d = 1;
    assert_true(arena_init(&arena, &memory, 1000));
    assert_true(arena_take(&arena, 1, &a) && arena_take(&arena, 65, &b) && arena_take(&arena, 64, &c));
    assert_int_equal(a, 0);
    assert_int_equal(b, 64);
    assert_int_equal(c, 192);
    arena_give(&arena, b, 65);
    assert_true(arena_take(&arena, 129, &d));
    assert_int_equal(d, 256);
    assert_true(arena_take(&arena, 64, &b));
    assert_int_equal(b, 64);
    assert_int_equal(arena.taken, 4);
    arena_finish(&arena);
}

static void test_refuses(void **state)
{
    (void)state;
    struct arena arena;
    uint64_t at = 77;
    assert_true(arena_init(&arena, &memory, 64 * 10 + 63));
    assert_false(arena_take(&arena, 0, &at));
    assert_false(arena_take(&arena, 641, &at));
    assert_false(arena_take(&arena, UINT64_MAX, &at));
    assert_int_equal(at, 77);
    assert_true(arena_take(&arena, 640, &at));
    assert_false(arena_take(&arena, 1, &at));
    arena_give(&arena, at, 640);
    assert_true(arena_take(&arena, 1, &at));
    arena_finish(&arena);
    assert_true(arena_init(&arena, &memory, 63));
    assert_false(arena_take(&arena, 1, &at));
    arena_finish(&arena);
}

/* Three neighbours that are given back in any order become one range again. */
static void test_joins(void **state)
{
    (void)state;
    static const int orders[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    for (int order = 0; order < 6; order++) {
        struct arena arena;
        uint64_t places[3], at;
        assert_true(arena_init(&arena, &memory, 64 * 3));
        for (int i = 0; i < 3; i++)
            assert_true(arena_take(&arena, 64, &places[i]));
        for (int i = 0; i < 3; i++)
            arena_give(&arena, places[orders[order][i]], 64);
        assert_int_equal(arena.count, 1);
        assert_true(arena_take(&arena, 64 * 3, &at));
        arena_finish(&arena);
    }
}

/* A map of units is the model: the test searches it for the first gap that is long enough. */
enum { UNITS = 200, PLACES = 80 };

struct model {
    unsigned char used[UNITS];
    struct {
        uint64_t offset, size; /* size 0: not taken */
    } places[PLACES];
};

static int find_gap(const struct model *model, uint64_t units)
{
    for (uint64_t at = 0; at + units <= UNITS; at++) {
        uint64_t length = 0;
        while (length < units && !model->used[at + length])
            length++;
        if (length == units)
            return (int)at;
    }
    return -1;
}

static void mark(struct model *model, uint64_t offset, uint64_t size, unsigned char used)
{
    memset(model->used + offset / 64, used, (size + 63) / 64);
}

static void step(struct model *model, struct arena *arena, int i)
{
    if (model->places[i].size) {
        arena_give(arena, model->places[i].offset, model->places[i].size);
        mark(model, model->places[i].offset, model->places[i].size, 0);
        model->places[i].size = 0;
        return;
    }
    uint64_t size = 1 + (uint64_t)rand() % 1000, offset;
    int gap = find_gap(model, (size + 63) / 64);
    assert_int_equal(arena_take(arena, size, &offset), gap >= 0);
    if (gap < 0)
        return;
    assert_int_equal(offset, 64 * gap);
    model->places[i].offset = offset;
    model->places[i].size = size;
    mark(model, offset, size, 1);
}

static void test_random(void **state)
{
    (void)state;
    struct model model = {{0}, {{0, 0}}};
    struct arena arena;
    srand(1);
    assert_true(arena_init(&arena, &memory, UNITS * 64));
    for (int i = 0; i < 50000; i++)
        step(&model, &arena, rand() % PLACES);
    for (int i = 0; i < PLACES; i++)
        if (model.places[i].size)
            arena_give(&arena, model.places[i].offset, model.places[i].size);
    assert_int_equal(arena.count, 1);
    assert_int_equal(arena.taken, 0);
    assert_int_equal(arena.free_ranges[0].size, UNITS * 64);
    arena_finish(&arena);
}

/* Taking can fail for lack of memory; giving back needs none. */
static void test_failing_allocations(void **state)
{
    (void)state;
    struct arena arena;
    uint64_t places[100];
    memory.fail_after = 0;
    assert_false(arena_init(&arena, &memory, 6400));
    assert_true(arena_init(&arena, &memory, 6400));
    memory.fail_after = 0;
    int taken = 0;
    while (taken < 100 && arena_take(&arena, 64, &places[taken]))
        taken++;
    assert_in_range(taken, 1, 99);
    for (; taken < 100; taken++)
        assert_true(arena_take(&arena, 64, &places[taken]));
    memory.limit = 0;
    for (int i = 0; i < 100; i += 2)
        arena_give(&arena, places[i], 64);
    for (int i = 1; i < 100; i += 2)
        arena_give(&arena, places[i], 64);
    memory.limit = UINT64_MAX;
    assert_int_equal(arena.count, 1);
    arena_finish(&arena);
}

static int check_leaks(void **state)
{
    (void)state;
    assert_int_equal(memory.live, 0);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(test_lowest_place, check_leaks),
        cmocka_unit_test_teardown(test_refuses, check_leaks),
        cmocka_unit_test_teardown(test_joins, check_leaks),
        cmocka_unit_test_teardown(test_random, check_leaks),
        cmocka_unit_test_teardown(test_failing_allocations, check_leaks),
    };
    memory_init(&memory, UINT64_MAX);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
