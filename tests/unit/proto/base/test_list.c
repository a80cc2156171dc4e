/* SPDX-License-Identifier: Apache-2.0 */
/* test_list.c - tests that lists keep their order in both directions, whatever is added and removed. */
#include "tests/support/unit.h"

#include "proto/base/container_of.h"
#include "proto/base/list.h"
#include "tests/support/random.h"

enum { ITEMS = 6 };

struct item {
    int name;
    struct list_link link;
};

/* Checks that the list has exactly these items, in this order, read from either end. */
static void assert_items(const struct list *list, const struct item *const items[], size_t count)
{
    struct list_link *link = list->first;
    for (size_t i = 0; i < count; i++, link = link->next) {
        assert_non_null(link);
        assert_ptr_equal(container_of(link, struct item, link), items[i]);
        assert_ptr_equal(link->previous, i > 0 ? &items[i - 1]->link : NULL);
    }
    assert_null(link);
    assert_ptr_equal(list->last, count > 0 ? &items[count - 1]->link : NULL);
}

static void zero_is_empty(void **state)
{
    (void)state;
    struct list list = {0};
    assert_items(&list, NULL, 0);
    assert_null(list_take_first(&list));
}

static void items_keep_their_order(void **state)
{
    (void)state;
    struct list list = {0};
    struct item a, b, c;
    list_append(&list, &b.link);
    assert_items(&list, (const struct item *[]){&b}, 1);
    list_append(&list, &c.link);
    assert_items(&list, (const struct item *[]){&b, &c}, 2);
    list_prepend(&list, &a.link);
    assert_items(&list, (const struct item *[]){&a, &b, &c}, 3);
    list_remove(&list, &b.link);
    assert_items(&list, (const struct item *[]){&a, &c}, 2);
    assert_ptr_equal(list_take_first(&list), &a.link);
    assert_ptr_equal(list_take_first(&list), &c.link);
    assert_items(&list, NULL, 0);
    list_prepend(&list, &c.link);
    assert_items(&list, (const struct item *[]){&c}, 1);
}

static void items_are_put_between_others(void **state)
{
    (void)state;
    struct list list = {0};
    struct item a, b, c, d;
    list_insert_after(&list, NULL, &c.link);
    assert_items(&list, (const struct item *[]){&c}, 1);
    list_insert_after(&list, NULL, &a.link);
    list_insert_after(&list, &a.link, &b.link);
    list_insert_after(&list, &c.link, &d.link);
    assert_items(&list, (const struct item *[]){&a, &b, &c, &d}, 4);
}

/* The list equals an array from which items are cut out, for many random steps. */
static void list_equals_an_array(void **state)
{
    (void)state;
    struct random random = {7};
    struct list list = {0};
    struct item items[ITEMS];
    const struct item *present[ITEMS];
    size_t count = 0;
    for (int step = 0; step < 5000; step++) {
        struct item *item = &items[random_next(&random) % ITEMS];
        size_t at = 0;
        while (at < count && present[at] != item)
            at++;
        if (at < count) {
            list_remove(&list, &item->link);
            memmove(&present[at], &present[at + 1], (--count - at) * sizeof present[0]);
        } else if (random_next(&random) % 2) {
            list_append(&list, &item->link);
            present[count++] = item;
        } else {
            list_prepend(&list, &item->link);
            memmove(&present[1], &present[0], count++ * sizeof present[0]);
            present[0] = item;
        }
        assert_items(&list, present, count);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(zero_is_empty),
        cmocka_unit_test(items_keep_their_order),
        cmocka_unit_test(items_are_put_between_others),
        cmocka_unit_test(list_equals_an_array),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
