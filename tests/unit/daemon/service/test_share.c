/* SPDX-License-Identifier: Apache-2.0 */
/* test_share.c - tests the rooms of shares: how much one may have alone, what is left for others, equal parts. */
#include "tests/support/unit.h"

#include "daemon/service/share.h"

enum { LIMIT = 1600, USERS = 6 };

static struct share root, users[USERS], connections[USERS][USERS];

static int set_up(void **state)
{
    (void)state;
    memset(users, 0, sizeof users);
    memset(connections, 0, sizeof connections);
    root = (struct share){.limit = {[SHARE_POOL] = LIMIT, [SHARE_ITEMS] = LIMIT}};
    return 0;
}

/* Takes one after the other as long as there is room. Returns how many. */
static uint64_t fill(struct share *share, enum share_kind kind)
{
    uint64_t count = 0;
    for (; share_fits(share, kind, 1); count++)
        share_take(share, kind, 1);
    return count;
}

static void test_one_alone_leaves_a_quarter(void **state)
{
    (void)state;
    share_join(&users[0], &root);
    share_join(&connections[0][0], &users[0]);
    assert_int_equal(share_room(&users[0], SHARE_POOL), 1200);
    assert_int_equal(fill(&connections[0][0], SHARE_POOL), 900);
    assert_int_equal(root.used[SHARE_POOL], 900);
    assert_false(share_is_over(&connections[0][0], SHARE_POOL));
    share_take(&connections[0][0], SHARE_POOL, 1);
    assert_true(share_is_over(&connections[0][0], SHARE_POOL));
    assert_false(share_is_over(&users[0], SHARE_POOL));
    share_give(&connections[0][0], SHARE_POOL, 901);
    assert_int_equal(root.used[SHARE_POOL], 0);
}

/* A user with many connections has no more than one with a single connection. */
static void test_connections_do_not_multiply_a_user(void **state)
{
    (void)state;
    uint64_t taken = 0;
    for (int i = 0; i < 2; i++)
        share_join(&users[i], &root);
    for (int i = 0; i < USERS; i++) {
        share_join(&connections[0][i], &users[0]);
        taken += fill(&connections[0][i], SHARE_POOL);
    }
    assert_int_equal(taken, users[0].used[SHARE_POOL]);
    assert_in_range(taken, 1100, 1200);
    share_join(&connections[1][0], &users[1]);
    assert_true(fill(&connections[1][0], SHARE_POOL) >= (LIMIT - 1200) / 2);
    assert_true(root.used[SHARE_POOL] <= LIMIT);
}

/* Whatever is taken never exceeds the limit, and whoever has most gives way when it gives something back. */
static void test_users_come_to_equal_parts(void **state)
{
    (void)state;
    for (int i = 0; i < USERS; i++) {
        share_join(&users[i], &root);
        fill(&users[i], SHARE_POOL);
        assert_true(root.used[SHARE_POOL] <= LIMIT);
    }
    for (int round = 0; round < LIMIT; round++)
        for (int i = 0; i < USERS; i++) {
            if (users[i].used[SHARE_POOL] > 0)
                share_give(&users[i], SHARE_POOL, 1);
            while (share_fits(&users[i], SHARE_POOL, 1))
                share_take(&users[i], SHARE_POOL, 1);
            assert_true(root.used[SHARE_POOL] <= LIMIT);
        }
    for (int i = 0; i < USERS; i++)
        assert_in_range(users[i].used[SHARE_POOL], LIMIT / (USERS + 1), LIMIT / USERS + LIMIT / (USERS + 1));
}

/* A newcomer has its equal part of the queue at once, though the queue grows longer by it. */
static void test_the_queue_is_open_to_a_newcomer(void **state)
{
    (void)state;
    share_join(&users[0], &root);
    share_join(&connections[0][0], &users[0]);
    fill(&connections[0][0], SHARE_ITEMS);
    for (int i = 1; i < USERS; i++) {
        share_join(&connections[0][i], &users[0]);
        assert_true(fill(&connections[0][i], SHARE_ITEMS) >= 1200 / (unsigned)(i + 2));
    }
    share_join(&users[1], &root);
    assert_true(fill(&users[1], SHARE_ITEMS) >= LIMIT / 3);
    assert_true(root.used[SHARE_ITEMS] <= 3 * LIMIT);
}

static void test_large_amounts_do_not_overflow(void **state)
{
    (void)state;
    share_join(&users[0], &root);
    share_take(&users[0], SHARE_POOL, 1);
    assert_false(share_fits(&users[0], SHARE_POOL, UINT64_MAX));
    share_give(&users[0], SHARE_POOL, 1);
    share_leave(&users[0]);
    share_leave(&users[0]);
    assert_int_equal(root.members, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(test_one_alone_leaves_a_quarter, set_up),
        cmocka_unit_test_setup(test_connections_do_not_multiply_a_user, set_up),
        cmocka_unit_test_setup(test_users_come_to_equal_parts, set_up),
        cmocka_unit_test_setup(test_the_queue_is_open_to_a_newcomer, set_up),
        cmocka_unit_test_setup(test_large_amounts_do_not_overflow, set_up),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
