/* SPDX-License-Identifier: Apache-2.0 */
/* test_container_of.c - tests that a struct is found from each of its members. */
#include "tests/support/unit.h"

#include "proto/base/container_of.h"

struct owner {
    char first;
    int numbers[3];
    struct {
        double value;
    } inner;
};

static void every_member_leads_to_its_owner(void **state)
{
    (void)state;
    struct owner owners[2];
    for (int i = 0; i < 2; i++) {
        assert_ptr_equal(container_of(&owners[i].first, struct owner, first), &owners[i]);
        assert_ptr_equal(container_of(&owners[i].numbers[2], struct owner, numbers[2]), &owners[i]);
        assert_ptr_equal(container_of(&owners[i].inner, struct owner, inner), &owners[i]);
        assert_ptr_equal(container_of(&owners[i].inner.value, struct owner, inner.value), &owners[i]);
    }
}

/* An argument with a side effect is evaluated exactly once. */
static void argument_is_evaluated_once(void **state)
{
    (void)state;
    struct owner owner;
    char *members[] = {&owner.first, NULL};
    char **next = members;
    assert_ptr_equal(container_of(*next++, struct owner, first), &owner);
    assert_ptr_equal(next, members + 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_member_leads_to_its_owner),
        cmocka_unit_test(argument_is_evaluated_once),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
