/* SPDX-License-Identifier: Apache-2.0 */
/* test_watchdog.c - tests that the watchdog tells a stuck pool from a working one. */
#include <pthread.h>
#include <time.h>

#include "tests/support/unit.h"

#include "daemon/pool/pool_internal.h"
#include "daemon/pool/watchdog.h"

enum { MAX_STUCK = 8, PATIENCE_MS = 20000 };

static pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;

static void no_wake(void *context)
{
    (void)context;
}

static void wait_at_gate(struct pool_job *job, const struct parallel *parallel)
{
    (void)job;
    (void)parallel;
    pthread_mutex_lock(&gate);
    pthread_mutex_unlock(&gate);
}

static void ended(struct pool_job *job)
{
    job->run = NULL;
}

static void collect_for(struct pool *pool, int ms)
{
    for (int i = 0; i < ms; i++) {
        pool_collect(pool);
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    }
}

/* Collects until the probe is back. */
static void await_answer(struct pool *pool, const struct watchdog *watchdog)
{
    for (int ms = 0; watchdog->under_way && ms < PATIENCE_MS; ms++)
        collect_for(pool, 1);
}

/* Collects until `count` jobs run. */
static void await_running(struct pool *pool, uint32_t count)
{
    for (int ms = 0; pool_load(pool).running < count && ms < PATIENCE_MS; ms++)
        collect_for(pool, 1);
}

static void test_idle_pool(void **state)
{
    struct pool *pool;
    struct watchdog watchdog;
    (void)state;
    assert_int_equal(pool_create(1, no_wake, NULL, &pool, NULL), BVHD_OK);
    assert_int_equal(watchdog_init(&watchdog, pool, 100, NULL), BVHD_OK);
    for (uint64_t now = 0; now < 2000; now += 50) {
        assert_true(watchdog_is_alive(&watchdog, now));
        await_answer(pool, &watchdog);
    }
    watchdog_finish(&watchdog);
    pool_destroy(pool);
}

/*
 * While jobs hold every thread, spare ones included, the pool counts as stuck once the patience is over. When they have
 * ended, it counts as alive again.
 */
static void test_stuck_pool(void **state)
{
    struct pool *pool;
    struct watchdog watchdog;
    struct pool_job jobs[MAX_STUCK] = {0};
    (void)state;
    assert_int_equal(pool_create(1, no_wake, NULL, &pool, NULL), BVHD_OK);
    assert_int_equal(watchdog_init(&watchdog, pool, 100, NULL), BVHD_OK);
    struct pool_flow *flow = pool_flow_create(pool, NULL);
    pthread_mutex_lock(&gate);
    uint64_t size = UINT64_C(1) << 40; /* each small enough beside the one before for a spare thread */
    for (int i = 0; i < MAX_STUCK; i++, size /= 2 * POOL_SPARE_RATIO) {
        jobs[i] = (struct pool_job){.run = wait_at_gate, .done = ended, .flow = flow, .size = size};
        pool_submit(pool, &jobs[i]);
    }
    await_running(pool, 1 + POOL_SPARE_THREADS);
    assert_true(watchdog_is_alive(&watchdog, 1000));
    collect_for(pool, 20);
    assert_true(watchdog_is_alive(&watchdog, 1099));
    assert_false(watchdog_is_alive(&watchdog, 1100));
    assert_false(watchdog_is_alive(&watchdog, 5000));
    pthread_mutex_unlock(&gate);
    await_answer(pool, &watchdog);
    assert_true(watchdog_is_alive(&watchdog, 6000));
    watchdog_finish(&watchdog); /* while its job may be under way */
    for (int i = 0; i < MAX_STUCK; i++)
        while (jobs[i].run)
            collect_for(pool, 1);
    pool_flow_end(pool, flow);
    pool_destroy(pool);
}

static void test_finish(void **state)
{
    struct watchdog watchdog = {0};
    (void)state;
    watchdog_finish(NULL);
    watchdog_finish(&watchdog);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_idle_pool),
        cmocka_unit_test(test_stuck_pool),
        cmocka_unit_test(test_finish),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
