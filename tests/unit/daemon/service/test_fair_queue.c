/* SPDX-License-Identifier: Apache-2.0 */
/* test_fair_queue.c - tests who is next: fair shares between lanes, priority and age within one, held lanes. */
#include "tests/support/unit.h"

#include "daemon/service/fair_queue.h"
#include "tests/support/random.h"

static void test_an_empty_queue_has_nobody(void **state)
{
    (void)state;
    struct fair_queue queue = {0};
    struct fair_entry entry = {0};
    assert_null(fair_queue_peek(&queue));
    fair_queue_remove(&queue, &entry);
    assert_int_equal(queue.count, 0);
}

static void test_equal_lanes_alternate(void **state)
{
    (void)state;
    struct fair_queue queue = {0};
    struct fair_lane lanes[3] = {0};
    struct fair_entry entries[3][4] = {0};
    for (int lane = 0; lane < 3; lane++)
        for (int i = 0; i < 4 - lane; i++)
            fair_queue_add(&queue, &lanes[lane], &entries[lane][i], 1);
    static const int want[][2] = {{0, 0}, {1, 0}, {2, 0}, {0, 1}, {1, 1}, {2, 1}, {0, 2}, {1, 2}, {0, 3}};
    for (size_t i = 0; i < sizeof want / sizeof *want; i++) {
        assert_ptr_equal(fair_queue_peek(&queue), &entries[want[i][0]][want[i][1]]);
        fair_queue_pop(&queue, 1);
    }
    assert_null(fair_queue_peek(&queue));
    assert_int_equal(queue.count, 0);
}

/* A lane that comes later is neither ahead of the others for what they were given before, nor behind them. */
static void test_a_new_lane_starts_level(void **state)
{
    (void)state;
    struct fair_queue queue = {0};
    struct fair_lane lanes[2] = {0};
    struct fair_entry entries[10] = {0}, late[2] = {0};
    for (int i = 0; i < 10; i++)
        fair_queue_add(&queue, &lanes[0], &entries[i], 1);
    for (int i = 0; i < 5; i++)
        fair_queue_pop(&queue, 100);
    fair_queue_add(&queue, &lanes[1], &late[0], 1);
    fair_queue_add(&queue, &lanes[1], &late[1], 1);
    struct fair_entry *const want[] = {&late[0], &entries[5], &late[1], &entries[6], &entries[7]};
    for (size_t i = 0; i < sizeof want / sizeof *want; i++) {
        assert_ptr_equal(fair_queue_peek(&queue), want[i]);
        fair_queue_pop(&queue, 100);
    }
}

/* Many small entries of one lane go between two large ones of another. */
static void test_lanes_are_given_equally_much(void **state)
{
    (void)state;
    struct fair_queue queue = {0};
    struct fair_lane large_lane = {0}, small_lane = {0};
    struct fair_entry large[4] = {0}, small[400] = {0};
    uint64_t given[2] = {0};
    for (int i = 0; i < 4; i++)
        fair_queue_add(&queue, &large_lane, &large[i], 1);
    for (int i = 0; i < 400; i++)
        fair_queue_add(&queue, &small_lane, &small[i], 1);
    while (small_lane.count > 0 && large_lane.count > 0) {
        const struct fair_entry *next = fair_queue_peek(&queue);
        bool is_large = next >= large && next < large + 4;
        fair_queue_pop(&queue, is_large ? 1000 : 10);
        given[is_large] += is_large ? 1000 : 10;
        assert_true(given[0] <= given[1] + 10 && given[1] <= given[0] + 1000);
    }
}

static void test_priority_goes_before_age_within_a_lane(void **state)
{
    (void)state;
    struct fair_queue queue = {0};
    struct fair_lane lanes[2] = {0};
    struct fair_entry low = {0}, normal = {0}, high = {0}, second = {0}, other = {0};
    fair_queue_add(&queue, &lanes[0], &low, 2);
    fair_queue_add(&queue, &lanes[1], &other, 2);
    fair_queue_add(&queue, &lanes[0], &normal, 1);
    fair_queue_add(&queue, &lanes[0], &high, 0);
    fair_queue_add(&queue, &lanes[0], &second, 0);
    struct fair_entry *const want[] = {&high, &other, &second, &normal, &low};
    for (size_t i = 0; i < sizeof want / sizeof *want; i++) {
        assert_ptr_equal(fair_queue_peek(&queue), want[i]);
        fair_queue_pop(&queue, 1);
    }
}

/* A held lane keeps its entries, which come when it is released. It does not appear if it empties meanwhile. */
static void test_a_held_lane_is_passed_over(void **state)
{
    (void)state;
    struct fair_queue queue = {0};
    struct fair_lane lanes[2] = {0};
    struct fair_entry entries[2][2] = {0};
    for (int lane = 0; lane < 2; lane++)
        fair_queue_add(&queue, &lanes[lane], &entries[lane][0], 1);
    fair_queue_hold(&queue, &lanes[0].node, true);
    fair_queue_hold(&queue, &lanes[0].node, true);
    fair_queue_add(&queue, &lanes[0], &entries[0][1], 1);
    assert_ptr_equal(fair_queue_peek(&queue), &entries[1][0]);
    fair_queue_pop(&queue, 1);
    assert_null(fair_queue_peek(&queue));
    assert_int_equal(queue.count, 2);
    fair_queue_remove(&queue, &entries[0][0]);
    fair_queue_hold(&queue, &lanes[0].node, false);
    assert_ptr_equal(fair_queue_peek(&queue), &entries[0][1]);
    fair_queue_hold(&queue, &lanes[0].node, true);
    fair_queue_remove(&queue, &entries[0][1]);
    fair_queue_hold(&queue, &lanes[0].node, false);
    assert_null(fair_queue_peek(&queue));
    assert_int_equal(queue.count, 0);
}

/* A user with ten lanes is given as much as one with one, whichever lane's turn it is; lanes of a user alternate. */
static void test_users_share_before_their_lanes(void **state)
{
    (void)state;
    enum { LANES = 10, EACH = 6 };
    struct fair_queue queue = {0};
    struct fair_node crowd = {0}, single = {0};
    struct fair_lane lanes[LANES] = {0}, lane = {.node.parent = &single};
    struct fair_entry entries[LANES][EACH] = {0}, own[LANES * EACH] = {0};
    uint64_t given[2] = {0};
    for (int i = 0; i < LANES; i++) {
        lanes[i].node.parent = &crowd;
        for (int k = 0; k < EACH; k++)
            fair_queue_add(&queue, &lanes[i], &entries[i][k], 1);
    }
    for (int i = 0; i < LANES * EACH; i++)
        fair_queue_add(&queue, &lane, &own[i], 1);
    for (int i = 0; i < LANES * EACH; i++) {
        struct fair_lane *next = fair_queue_peek(&queue)->lane;
        if (next != &lane)
            assert_ptr_equal(next, &lanes[given[1] % LANES]);
        given[next != &lane]++;
        fair_queue_pop(&queue, 10);
    }
    assert_int_equal(given[0], given[1]);
    fair_queue_hold(&queue, &lane.node, true);
    while (fair_queue_peek(&queue))
        fair_queue_pop(&queue, 10);
    assert_int_equal(queue.count, lane.count);
    assert_null(crowd.ring);
    for (int i = 0; i < LANES * EACH; i++)
        fair_queue_remove(&queue, &own[i]);
    assert_null(single.ring);
}

/* A user is held as a whole; lanes below it may be held and released, filled and emptied meanwhile. */
static void test_a_held_user_is_passed_over(void **state)
{
    (void)state;
    struct fair_queue queue = {0};
    struct fair_node user = {0};
    struct fair_lane lanes[2] = {{.node.parent = &user}, {.node.parent = &user}}, other = {0};
    struct fair_entry entries[2] = {0}, free = {0};
    fair_queue_hold(&queue, &user, true);
    fair_queue_add(&queue, &lanes[0], &entries[0], 1);
    assert_null(fair_queue_peek(&queue));
    fair_queue_add(&queue, &other, &free, 1);
    assert_ptr_equal(fair_queue_peek(&queue), &free);
    fair_queue_hold(&queue, &lanes[0].node, true);
    fair_queue_hold(&queue, &user, false);
    fair_queue_remove(&queue, &free);
    assert_null(fair_queue_peek(&queue));
    fair_queue_add(&queue, &lanes[1], &entries[1], 1);
    assert_ptr_equal(fair_queue_peek(&queue), &entries[1]);
    fair_queue_hold(&queue, &user, true);
    fair_queue_remove(&queue, &entries[1]);
    fair_queue_hold(&queue, &lanes[0].node, false);
    assert_null(fair_queue_peek(&queue));
    fair_queue_hold(&queue, &user, false);
    assert_ptr_equal(fair_queue_peek(&queue), &entries[0]);
    fair_queue_pop(&queue, 1);
    assert_int_equal(queue.count, 0);
    assert_false(user.ready || queue.root.ready);
}

static void test_the_earlier_of_two_lanes_is_known(void **state)
{
    (void)state;
    struct fair_queue queue = {0};
    struct fair_node users[2] = {0};
    struct fair_lane lanes[3] = {{.node.parent = &users[0]}, {.node.parent = &users[0]}, {.node.parent = &users[1]}};
    struct fair_entry entries[3] = {0}, more = {0};
    assert_false(fair_queue_is_earlier(&queue, &lanes[0], &lanes[2]));
    fair_queue_add(&queue, &lanes[0], &entries[0], 1);
    fair_queue_add(&queue, &lanes[0], &more, 1);
    fair_queue_pop(&queue, 10); /* lane 0 and its user have been given something */
    for (int i = 0; i < 3; i++) {
        bool is_behind = i == 0;
        assert_int_equal(fair_queue_is_earlier(&queue, &lanes[i], &lanes[0]), !is_behind);
        assert_false(fair_queue_is_earlier(&queue, &lanes[0], &lanes[i]));
    }
    assert_true(fair_queue_is_earlier(&queue, &lanes[2], &lanes[1]));
    fair_queue_remove(&queue, &more);
}

/* Each entry that is next is compared with a list in the order of arrival. */
static void test_random_operations_match_a_list(void **state)
{
    (void)state;
    enum { LANES = 5, ENTRIES = 40, STEPS = 20000 };
    struct fair_queue queue = {0};
    struct fair_lane lanes[LANES] = {0};
    struct fair_entry entries[ENTRIES] = {0};
    struct fair_lane *where[ENTRIES] = {0};
    uint64_t arrived[ENTRIES] = {0}, clock = 0;
    struct random random = {7};
    for (int step = 0; step < STEPS; step++) {
        uint32_t pick = (uint32_t)(random_next(&random) % ENTRIES), count = 0;
        if (!where[pick]) {
            where[pick] = &lanes[random_next(&random) % LANES];
            arrived[pick] = ++clock;
            fair_queue_add(&queue, where[pick], &entries[pick], (uint32_t)(random_next(&random) % FAIR_PRIORITIES));
        } else if (random_next(&random) % 2) {
            fair_queue_remove(&queue, &entries[pick]);
            where[pick] = NULL;
        } else {
            struct fair_entry *next = fair_queue_peek(&queue);
            int at = (int)(next - entries);
            for (int i = 0; i < ENTRIES; i++)
                if (where[i] == where[at] && i != at)
                    assert_true(entries[i].priority > next->priority ||
                                (entries[i].priority == next->priority && arrived[i] > arrived[at]));
            fair_queue_pop(&queue, 1);
            where[at] = NULL;
        }
        for (int i = 0; i < ENTRIES; i++) {
            count += where[i] != NULL;
            assert_ptr_equal(entries[i].lane, where[i]);
        }
        assert_int_equal(queue.count, count);
        assert_int_equal(fair_queue_peek(&queue) != NULL, count > 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_an_empty_queue_has_nobody),
        cmocka_unit_test(test_equal_lanes_alternate),
        cmocka_unit_test(test_a_new_lane_starts_level),
        cmocka_unit_test(test_lanes_are_given_equally_much),
        cmocka_unit_test(test_priority_goes_before_age_within_a_lane),
        cmocka_unit_test(test_a_held_lane_is_passed_over),
        cmocka_unit_test(test_users_share_before_their_lanes),
        cmocka_unit_test(test_a_held_user_is_passed_over),
        cmocka_unit_test(test_the_earlier_of_two_lanes_is_known),
        cmocka_unit_test(test_random_operations_match_a_list),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
