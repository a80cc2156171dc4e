/* SPDX-License-Identifier: Apache-2.0 */
/* test_memory_queue.c - tests which of the steps that wait for memory start, and what is promised to them. */
#include "tests/support/unit.h"

#include "daemon/service/memory_queue.h"

enum { LIMIT = 1600, CLIENTS = 2, STEPS = 2 * ADMISSION_ITERATION_STARTS };

struct step {
    struct memory_waiter waiter;
    bool started;
};

static struct admission admission;
static struct memory_queue queue;
static struct memory_lanes clients[CLIENTS];
static struct step steps[STEPS];

static void start(struct memory_waiter *waiter)
{
    struct step *step = (struct step *)(void *)waiter;
    assert_false(step->started);
    assert_null(waiter->entry.lane);
    step->started = true;
}

static void reset(enum admission_step step)
{
    admission = (struct admission){.limit = LIMIT};
    memset(clients, 0, sizeof clients);
    memset(steps, 0, sizeof steps);
    memory_queue_init(&queue, &admission, step);
}

static void add(int step, int client, struct admission_claim claim)
{
    steps[step].waiter = (struct memory_waiter){.start = start, .claim = claim};
    memory_queue_add(&queue, &clients[client], &steps[step].waiter);
}

static void expect_started(int first, int count)
{
    for (int i = first; i < first + count; i++)
        assert_true(steps[i].started);
    for (int i = first + count; i < STEPS; i++)
        assert_false(steps[i].started);
}

static void test_started_steps_hold_a_promise(void **state)
{
    (void)state;
    for (enum admission_step step = ADMISSION_PREPARE; step <= ADMISSION_BUILD; step++) {
        reset(step);
        add(0, 0, (struct admission_claim){300, ADMISSION_LARGE, 0});
        add(1, 1, (struct admission_claim){40, ADMISSION_SMALL, 0});
        assert_int_equal(memory_queue_count(&queue), 2);
        memory_queue_start(&queue);
        expect_started(0, 2);
        assert_int_equal(memory_queue_count(&queue), 0);
        assert_int_equal(admission_promised(&admission), 340);
        assert_int_equal(admission_share_of(&admission, step, ADMISSION_LARGE)->count, 1);
        assert_int_equal(admission_share_of(&admission, step, ADMISSION_SMALL)->bytes, 40);
    }
}

static void test_large_steps_wait_and_small_ones_do_not(void **state)
{
    (void)state;
    reset(ADMISSION_PREPARE);
    add(0, 0, (struct admission_claim){2 * LIMIT, ADMISSION_LARGE, 0}); /* alone, so it may try */
    add(1, 0, (struct admission_claim){1, ADMISSION_LARGE, 0});
    add(2, 0, (struct admission_claim){1, ADMISSION_SMALL, 0});
    memory_queue_start(&queue);
    assert_true(steps[0].started && !steps[1].started && steps[2].started);
    admission_end(&admission.prepares[ADMISSION_LARGE], 2 * LIMIT);
    memory_queue_start(&queue);
    assert_true(steps[1].started);
}

/* A build that is to be alone lets other builds go on until neither they nor copies of others are left. */
static void test_a_build_that_is_to_be_alone_waits_for_that(void **state)
{
    (void)state;
    reset(ADMISSION_BUILD);
    admission_give(&admission.prepares[ADMISSION_LARGE], 5); /* its own copy, and that of the build before it */
    admission_give(&admission.prepares[ADMISSION_LARGE], 5);
    admission.alone = admission.alone_copies = 1;
    add(0, 0, (struct admission_claim){10, ADMISSION_ALONE, 0});
    add(1, 0, (struct admission_claim){10, ADMISSION_LARGE, 0});
    add(2, 0, (struct admission_claim){10, ADMISSION_SMALL, 0});
    memory_queue_start(&queue);
    assert_true(!steps[0].started && steps[1].started && steps[2].started);
    struct admission_claim claim = {1, ADMISSION_LARGE, 1};
    assert_false(admission_may_start(&admission, ADMISSION_PREPARE, &claim));
    admission_end(&admission.builds[ADMISSION_LARGE], 10);
    memory_queue_start(&queue);
    assert_false(steps[0].started);
    admission_end(&admission.prepares[ADMISSION_LARGE], 5);
    memory_queue_start(&queue);
    assert_true(steps[0].started);
    add(3, 0, (struct admission_claim){10, ADMISSION_LARGE, 0});
    memory_queue_start(&queue);
    assert_false(steps[3].started);
    admission_end(&admission.builds[ADMISSION_ALONE], 10);
    memory_queue_start(&queue);
    assert_true(steps[3].started);
}

static void start_and_expect(struct memory_waiter *waiter)
{
    start(waiter);
    admission_expect(&admission, waiter->claim.class, waiter->claim.build);
}

/* A large prepare starts only if the largest build to come would fit beside all copies. */
static void test_every_build_to_come_fits(void **state)
{
    (void)state;
    reset(ADMISSION_PREPARE);
    uint64_t large = LIMIT - LIMIT / 4, copy = large / 10;
    const uint64_t builds[] = {large / 2, large / 10, large, large / 10, large / 10, large / 10};
    for (int i = 0; i < 6; i++) {
        add(i, i % CLIENTS, (struct admission_claim){copy, ADMISSION_LARGE, builds[i]});
        steps[i].waiter.start = start_and_expect;
    }
    memory_queue_start(&queue);
    expect_started(0, 2); /* the third one's build takes everything: it is prepared when no copy is left */
    admission_end(&admission.prepares[ADMISSION_LARGE], copy);
    admission_expect_end(&admission, ADMISSION_LARGE, builds[0]);
    memory_queue_start(&queue);
    expect_started(0, 2);
    admission_end(&admission.prepares[ADMISSION_LARGE], copy);
    admission_expect_end(&admission, ADMISSION_LARGE, builds[1]);
    memory_queue_start(&queue);
    expect_started(0, 3);
    admission_end(&admission.prepares[ADMISSION_LARGE], copy);
    admission_expect_end(&admission, ADMISSION_LARGE, builds[2]);
    memory_queue_start(&queue);
    expect_started(0, 6);
    assert_in_range(largest_get(&admission.to_come), large / 10, large / 8);
}

static void test_one_iteration_starts_a_limited_number(void **state)
{
    (void)state;
    reset(ADMISSION_PREPARE);
    for (int i = 0; i < STEPS; i++)
        add(i, 0, (struct admission_claim){0, ADMISSION_SMALL, 0});
    memory_queue_start(&queue);
    expect_started(0, ADMISSION_ITERATION_STARTS);
    assert_true(admission_is_exhausted(&admission));
    memory_queue_start(&queue);
    expect_started(0, ADMISSION_ITERATION_STARTS);
    admission_begin_iteration(&admission);
    assert_false(admission_is_exhausted(&admission));
    memory_queue_start(&queue);
    expect_started(0, STEPS);
}

static void test_held_clients_and_removed_steps_do_not_start(void **state)
{
    (void)state;
    reset(ADMISSION_PREPARE);
    for (int i = 0; i < 4; i++)
        add(i, i % 2, (struct admission_claim){1, i < 2 ? ADMISSION_SMALL : ADMISSION_LARGE, 0});
    memory_queue_hold(&queue, &clients[0], true);
    assert_true(memory_lanes_are_held(&clients[0]) && !memory_lanes_are_held(&clients[1]));
    memory_queue_remove(&queue, &steps[1].waiter);
    memory_queue_remove(&queue, &steps[1].waiter);
    memory_queue_start(&queue);
    assert_true(!steps[0].started && !steps[1].started && !steps[2].started && steps[3].started);
    assert_int_equal(memory_queue_count(&queue), 2);
    memory_queue_hold(&queue, &clients[0], false);
    memory_queue_start(&queue);
    assert_true(steps[0].started && !steps[1].started && steps[2].started);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_started_steps_hold_a_promise),
        cmocka_unit_test(test_large_steps_wait_and_small_ones_do_not),
        cmocka_unit_test(test_a_build_that_is_to_be_alone_waits_for_that),
        cmocka_unit_test(test_every_build_to_come_fits),
        cmocka_unit_test(test_one_iteration_starts_a_limited_number),
        cmocka_unit_test(test_held_clients_and_removed_steps_do_not_start),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
