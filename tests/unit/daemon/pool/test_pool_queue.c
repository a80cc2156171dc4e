/* SPDX-License-Identifier: Apache-2.0 */
/* test_pool_queue.c - tests that the queue of a flow keeps its order, and finds small jobs behind large ones. */
#include "tests/support/unit.h"

#include "daemon/pool/pool_queue.h"

enum { MOST = 400 };

/* A queue, and a plain list of the jobs that are in it, to compare with. */
struct model {
    struct pool_queue queue;
    struct pool_job jobs[MOST];
    bool is_in[MOST];
    uint64_t orders;
    uint32_t random;
};

static uint32_t draw(struct model *model, uint32_t range)
{
    model->random = model->random * 1664525u + 1013904223u;
    return (model->random >> 8) % range;
}

static void put(struct model *model, int index, int priority, uint64_t size)
{
    model->jobs[index] = (struct pool_job){.priority = priority, .size = size, .order = model->orders++};
    model->is_in[index] = true;
    pool_queue_put(&model->queue, &model->jobs[index]);
}

static struct pool_job *expected_first(struct model *model, uint64_t most)
{
    struct pool_job *first = NULL;
    for (int i = 0; i < MOST; i++)
        if (model->is_in[i] && model->jobs[i].size <= most && (!first || pool_queue_before(&model->jobs[i], first)))
            first = &model->jobs[i];
    return first;
}

static void take(struct model *model, struct pool_job *job)
{
    pool_queue_remove(&model->queue, job);
    model->is_in[job - model->jobs] = false;
}

static void empty_has_nothing(void **state)
{
    (void)state;
    struct pool_queue queue = {0};
    assert_null(pool_queue_first(&queue));
    assert_null(pool_queue_first_small(&queue, UINT64_MAX));
    assert_null(pool_queue_first_small(&queue, 0));
}

static void priority_then_age(void **state)
{
    (void)state;
    struct model model = {0};
    static const int priorities[] = {0, 5, INT32_MIN, 5, INT32_MAX, 0, -1};
    static const int order[] = {4, 1, 3, 0, 5, 6, 2};
    for (int i = 0; i < 7; i++)
        put(&model, i, priorities[i], (uint64_t)1 << (9 * i));
    for (int i = 0; i < 7; i++) {
        struct pool_job *job = pool_queue_first(&model.queue);
        assert_ptr_equal(job, &model.jobs[order[i]]);
        take(&model, job);
    }
    assert_null(pool_queue_first(&model.queue));
}

static void small_ones_are_found_behind_large_ones(void **state)
{
    (void)state;
    struct model model = {0};
    put(&model, 0, 9, UINT64_MAX);
    put(&model, 1, 0, 100);
    put(&model, 2, 1, 0);
    put(&model, 3, 2, 127);
    assert_ptr_equal(pool_queue_first(&model.queue), &model.jobs[0]);
    assert_ptr_equal(pool_queue_first_small(&model.queue, UINT64_MAX), &model.jobs[0]);
    assert_ptr_equal(pool_queue_first_small(&model.queue, UINT64_MAX - 1), &model.jobs[3]);
    assert_ptr_equal(pool_queue_first_small(&model.queue, 127), &model.jobs[3]);
    assert_ptr_equal(pool_queue_first_small(&model.queue, 63), &model.jobs[2]);
    assert_ptr_equal(pool_queue_first_small(&model.queue, 1), &model.jobs[2]);
    assert_null(pool_queue_first_small(&model.queue, 0));
    /*
     * The first job in the class of 100 is too large. Jobs behind it may be missed, but none that is too large may be
     * found.
     */
    assert_ptr_equal(pool_queue_first_small(&model.queue, 100), &model.jobs[2]);
    assert_int_equal(pool_queue_class(0), 0);
    assert_int_equal(pool_queue_class(127), 6);
    assert_int_equal(pool_queue_class(128), 7);
    assert_int_equal(pool_queue_class(UINT64_MAX), 63);
}

static void check_against_model(struct model *model)
{
    uint64_t whole_classes = ((uint64_t)1 << draw(model, 64)) - 1, any = whole_classes / (1 + draw(model, 5));
    assert_ptr_equal(pool_queue_first(&model->queue), expected_first(model, UINT64_MAX));
    /* `whole_classes` is the largest size of its class, so no job of this class can be missed. */
    if (whole_classes > 0)
        assert_true(expected_first(model, whole_classes) == pool_queue_first_small(&model->queue, whole_classes));
    struct pool_job *small = pool_queue_first_small(&model->queue, any);
    assert_true(!small || (small->size <= any && model->is_in[small - model->jobs]));
}

static void random_puts_and_removals(void **state)
{
    (void)state;
    for (uint32_t seed = 1; seed <= 8; seed++) {
        struct model model = {.random = seed};
        for (int round = 0; round < 3000; round++) {
            int index = (int)draw(&model, MOST);
            if (model.is_in[index])
                take(&model, &model.jobs[index]);
            else
                put(&model, index, (int)draw(&model, 1 + seed),
                    (uint64_t)draw(&model, 1000) << draw(&model, seed % 2 ? 2 : 50));
            if (draw(&model, 3) == 0 && pool_queue_first(&model.queue))
                take(&model, pool_queue_first(&model.queue));
            if (round % 8 == 0)
                check_against_model(&model);
        }
        for (struct pool_job *job; (job = expected_first(&model, UINT64_MAX)); take(&model, job))
            assert_ptr_equal(pool_queue_first(&model.queue), job);
        assert_int_equal(model.queue.filled, 0);
    }
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(empty_has_nothing),
        cmocka_unit_test(priority_then_age),
        cmocka_unit_test(small_ones_are_found_behind_large_ones),
        cmocka_unit_test(random_puts_and_removals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
