/* SPDX-License-Identifier: Apache-2.0 */
/* test_level_choice.c - tests the choice of levels against all choices, and its limits. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/micromap/level_choice.h"
#include "tests/support/random.h"

enum { TRIANGLES = 5, LAST = 3 };

static struct memory memory;
static const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};

static uint64_t bytes_at(unsigned level)
{
    return level == 0 ? 0 : micro_triangle_bytes(MICRO_4_STATE, level) + 8;
}

static void make_facts(struct random *random, struct level_facts facts[TRIANGLES])
{
    for (int i = 0; i < TRIANGLES; i++) {
        double decided = 0;
        for (unsigned level = 0; level <= MICRO_LEVEL_MAX; level++) {
            facts[i].decided[level] = (uint32_t)(decided * MICRO_COUNT_MAX);
            decided += (1 - decided) * random_between(random, 0, 0.7);
        }
        facts[i].weight = (double)(random_next(random) % 3);
    }
}

static double worth_of(const struct level_facts facts[TRIANGLES], const unsigned char *levels, uint64_t *ret_bytes)
{
    double worth = 0;
    *ret_bytes = 0;
    for (int i = 0; i < TRIANGLES; i++) {
        worth += facts[i].weight * facts[i].decided[levels[i]] / MICRO_COUNT_MAX;
        *ret_bytes += bytes_at(levels[i]);
    }
    return worth;
}

/* No choice of as many bytes or fewer decides more. */
static void check_best(const struct level_facts facts[TRIANGLES], const unsigned char *chosen)
{
    uint64_t chosen_bytes, bytes;
    const double decided = worth_of(facts, chosen, &chosen_bytes);
    unsigned char levels[TRIANGLES];
    for (unsigned code = 0; code < 1u << 2 * TRIANGLES; code++) {
        for (int i = 0; i < TRIANGLES; i++)
            levels[i] = (unsigned char)(code >> 2 * i & 3);
        const double other = worth_of(facts, levels, &bytes);
        assert_true(bytes > chosen_bytes || other <= decided + 1e-9);
    }
}

static void test_best(void **state)
{
    (void)state;
    struct random random = {1};
    unsigned char levels[TRIANGLES];
    for (int round = 0; round < 200; round++) {
        struct level_facts facts[TRIANGLES];
        make_facts(&random, facts);
        struct level_limits limits = {.format = MICRO_4_STATE, .last = LAST, .worth = 0, .budget = UINT64_MAX};
        limits.worth = pow(10, random_between(&random, -5, 0));
        assert_int_equal(level_choice_make(facts, TRIANGLES, &limits, &context, levels, NULL), BVHD_OK);
        check_best(facts, levels);
        /* A budget of exactly the bytes of some first steps gives these. */
        limits.worth = 0;
        limits.budget = random_next(&random) % 100;
        uint64_t bytes;
        assert_int_equal(level_choice_make(facts, TRIANGLES, &limits, &context, levels, NULL), BVHD_OK);
        worth_of(facts, levels, &bytes);
        assert_true(bytes <= limits.budget);
        check_best(facts, levels);
    }
    assert_int_equal(memory.live, 0);
}

/* Steps end where a byte decides less than asked for; those without any gain are never taken. */
static void test_worth(void **state)
{
    (void)state;
    struct level_facts facts = {.weight = 1};
    for (unsigned level = 0; level <= MICRO_LEVEL_MAX; level++) /* the undecided rest halves with each level */
        facts.decided[level] = MICRO_COUNT_MAX - (MICRO_COUNT_MAX >> level);
    struct level_limits limits = {
        .format = MICRO_4_STATE, .last = MICRO_LEVEL_MAX, .worth = 0.03125 / 192, .budget = UINT64_MAX};
    unsigned char level;
    assert_int_equal(level_choice_make(&facts, 1, &limits, &context, &level, NULL), BVHD_OK);
    assert_int_equal(level, 5); /* from 64 to 256 bytes for 1/16 - 1/32 of the triangle */
    limits.worth *= 1.01;
    assert_int_equal(level_choice_make(&facts, 1, &limits, &context, &level, NULL), BVHD_OK);
    assert_int_equal(level, 4);
    limits.last = 2;
    assert_int_equal(level_choice_make(&facts, 1, &limits, &context, &level, NULL), BVHD_OK);
    assert_int_equal(level, 2);
    limits.worth = 0;
    facts.weight = 0;
    for (unsigned i = 0; i <= MICRO_LEVEL_MAX; i++)
        facts.decided[i] = 77;
    assert_int_equal(level_choice_make(&facts, 1, &limits, &context, &level, NULL), BVHD_OK);
    assert_int_equal(level, 0);
    assert_int_equal(level_choice_make(&facts, 0, &limits, &context, &level, NULL), BVHD_OK);
}

/* A level that decides nothing more is passed over when a later one does. */
static void test_late_gain(void **state)
{
    (void)state;
    struct level_facts facts = {.weight = 1};
    for (unsigned level = 3; level <= MICRO_LEVEL_MAX; level++)
        facts.decided[level] = MICRO_COUNT_MAX;
    const struct level_limits limits = {.format = MICRO_2_STATE, .last = 6, .worth = 1e-3, .budget = UINT64_MAX};
    unsigned char level;
    assert_int_equal(level_choice_make(&facts, 1, &limits, &context, &level, NULL), BVHD_OK);
    assert_int_equal(level, 3);
}

/* Of steps of one worth the first triangles get them, as far as the budget reaches. */
static void test_ties(void **state)
{
    (void)state;
    enum { COUNT = 40 };
    struct level_facts facts[COUNT];
    unsigned char levels[COUNT];
    for (int i = 0; i < COUNT; i++) {
        facts[i] = (struct level_facts){.weight = i == 30 ? 2 : 1};
        for (unsigned level = 2; level <= MICRO_LEVEL_MAX; level++)
            facts[i].decided[level] = MICRO_COUNT_MAX / 2;
    }
    const struct level_limits limits = {.format = MICRO_4_STATE, .last = 5, .worth = 0, .budget = 12 * 11 + 3};
    assert_int_equal(level_choice_make(facts, COUNT, &limits, &context, levels, NULL), BVHD_OK);
    for (int i = 0; i < COUNT; i++)
        assert_int_equal(levels[i], i < 10 || i == 30 ? 2 : 0);
}

static void test_failures(void **state)
{
    (void)state;
    struct random random = {4};
    struct level_facts facts[TRIANGLES];
    unsigned char levels[TRIANGLES];
    make_facts(&random, facts);
    facts[0].weight = 1;
    const struct level_limits limits = {.format = MICRO_4_STATE, .last = LAST, .worth = 0, .budget = UINT64_MAX};
    memory.fail_after = 0;
    assert_int_equal(level_choice_make(facts, TRIANGLES, &limits, &context, levels, NULL), BVHD_NO_MEMORY);
    memory.fail_after = -1;
    atomic_bool cancel = true;
    struct build_context cancelled = context;
    cancelled.cancel = &cancel;
    assert_int_equal(level_choice_make(facts, TRIANGLES, &limits, &cancelled, levels, NULL), BVHD_CANCELLED);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    memory_init(&memory, UINT64_MAX);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_best), cmocka_unit_test(test_worth),    cmocka_unit_test(test_late_gain),
        cmocka_unit_test(test_ties), cmocka_unit_test(test_failures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
