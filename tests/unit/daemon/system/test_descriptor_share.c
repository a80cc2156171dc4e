/* SPDX-License-Identifier: Apache-2.0 */
/* test_descriptor_share.c - tests that no user can take descriptors that others need, and that all are given back. */
#include "tests/support/unit.h"

#include <fcntl.h>
#include <unistd.h>

#include "daemon/system/release.h"
#include "tests/support/daemon/test_lingering.h"

enum { FREE = 60, LIMIT = FREE + DESCRIPTORS_RESERVE };

/* Takes as many descriptors as the user may hold. Returns their number. */
static uint32_t take_all(struct descriptor_share *share)
{
    uint32_t count = 0;
    for (; descriptor_share_has_room(share, 1); count++) {
        assert_true(descriptors_take(share->descriptors, 1, DESCRIPTORS_RESERVE));
        descriptor_share_add(share, 1);
    }
    return count;
}

/* The first user gets half, the second one half of the rest, and so on: there is always something left. */
static void everybody_gets_some(void **state)
{
    (void)state;
    struct descriptors descriptors = {.limit = LIMIT};
    struct descriptor_share *shares[3];
    for (uint32_t i = 0; i < 3; i++)
        assert_non_null(shares[i] = descriptor_share_open(&descriptors, 1000 + i));
    assert_int_equal(take_all(shares[0]), FREE / 2);
    assert_int_equal(take_all(shares[1]), FREE / 4);
    assert_in_range(take_all(shares[2]), FREE / 8, FREE / 8 + 1);
    assert_in_range(descriptors_left(&descriptors), DESCRIPTORS_RESERVE + 1, LIMIT);
    for (int i = 0; i < 3; i++) {
        descriptor_share_give(shares[i], shares[i]->used);
        descriptor_share_close(shares[i]);
    }
    assert_int_equal(descriptors_left(&descriptors), LIMIT);
}

/* Connections of one user have one share, and of another daemon another one. A share that nobody uses is used again. */
static void a_user_has_one_share(void **state)
{
    (void)state;
    struct descriptors descriptors = {.limit = LIMIT}, other = {.limit = LIMIT};
    struct descriptor_share *first = descriptor_share_open(&descriptors, 1),
                            *again = descriptor_share_open(&descriptors, 1);
    struct descriptor_share *second = descriptor_share_open(&descriptors, 2),
                            *elsewhere = descriptor_share_open(&other, 1);
    assert_ptr_equal(first, again);
    assert_ptr_not_equal(first, second);
    assert_ptr_not_equal(first, elsewhere);
    descriptor_share_close(first);
    assert_ptr_not_equal(descriptor_share_open(&descriptors, 3), first);
    descriptor_share_close(again);
    struct descriptor_share *reused = descriptor_share_open(&descriptors, 4);
    assert_ptr_equal(reused, first);
    assert_int_equal(reused->uid, 4);
    descriptor_share_close(reused);
    descriptor_share_close(second);
    descriptor_share_close(elsewhere);
}

static void unread_ones_are_shared_too(void **state)
{
    (void)state;
    struct descriptors descriptors = {.limit = 40};
    struct descriptor_share *first = descriptor_share_open(&descriptors, 1),
                            *second = descriptor_share_open(&descriptors, 2);
    for (int i = 0; i < 10; i++)
        assert_true(descriptor_share_send(first));
    assert_false(descriptor_share_send(first));
    for (int i = 0; i < 5; i++)
        assert_true(descriptor_share_send(second));
    assert_false(descriptor_share_send(second));
    descriptor_share_read(first, 10);
    assert_true(descriptor_share_send(second));
    descriptor_share_read(second, 6);
    assert_int_equal(descriptors.unread, 0);
    descriptor_share_close(first);
    descriptor_share_close(second);
}

/* What is not closed yet is still charged to the user, but no longer counted by the service, which may end. */
static void what_closes_slowly_is_charged(void **state)
{
    (void)state;
    struct descriptors descriptors = {.limit = LIMIT};
    struct descriptor_share *share = descriptor_share_open(&descriptors, 1);
    struct test_lingering pair = {-1, -1};
    if (!test_lingering_is_possible())
        skip();
    assert_true(test_lingering_make(&pair));
    assert_true(descriptors_take(&descriptors, 2, DESCRIPTORS_RESERVE));
    descriptor_share_add(share, 2);
    release_descriptor(share, pair.sender);
    release_descriptor(share, -1); /* not open */
    assert_int_equal(descriptors.used, 0);
    assert_int_equal(share->used, 1);
    assert_int_equal(descriptors_left(&descriptors), LIMIT - 1);
    test_lingering_end(&pair);
    for (int i = 0; i < 5000 && atomic_load(&share->used) > 0; i++)
        usleep(1000);
    assert_int_equal(share->used, 0);
    descriptor_share_close(share);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(everybody_gets_some),
        cmocka_unit_test(a_user_has_one_share),
        cmocka_unit_test(unread_ones_are_shared_too),
        cmocka_unit_test(what_closes_slowly_is_charged),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
