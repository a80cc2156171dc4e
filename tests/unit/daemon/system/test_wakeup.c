/* SPDX-License-Identifier: Apache-2.0 */
/* test_wakeup.c - tests that the loop learns of everything that other threads send, and leaves no descriptor behind. */
#include <pthread.h>
#include <sys/resource.h>
#include <unistd.h>

#include "daemon/system/wakeup.h"
#include "tests/support/unit.h"

enum { SENDERS = 3, WORKS = 20000 };

struct world {
    uv_loop_t loop;
    struct wakeup wakeup;
    atomic_uint done; /* pieces of work */
    unsigned seen, calls;
};

static void collect(void *context)
{
    struct world *world = context;
    world->seen = atomic_load_explicit(&world->done, memory_order_relaxed);
    world->calls++;
    if (world->seen == SENDERS * WORKS)
        uv_close((uv_handle_t *)&world->wakeup.poll, NULL);
}

static void *work(void *context)
{
    struct world *world = context;
    for (int i = 0; i < WORKS; i++) {
        atomic_fetch_add_explicit(&world->done, 1, memory_order_relaxed);
        wakeup_send(&world->wakeup);
    }
    return NULL;
}

/* The loop would not end if it missed the last piece of work. */
static void nothing_is_missed(void **state)
{
    (void)state;
    static struct world world;
    pthread_t threads[SENDERS];
    assert_int_equal(uv_loop_init(&world.loop), 0);
    assert_true(wakeup_init(&world.wakeup, &world.loop, collect, &world));
    for (int i = 0; i < SENDERS; i++)
        assert_int_equal(pthread_create(&threads[i], NULL, work, &world), 0);
    uv_run(&world.loop, UV_RUN_DEFAULT);
    for (int i = 0; i < SENDERS; i++)
        pthread_join(threads[i], NULL);
    assert_int_equal(world.seen, SENDERS * WORKS);
    assert_in_range(world.calls, 1, SENDERS * WORKS);
    int descriptor = world.wakeup.descriptor;
    wakeup_finish(&world.wakeup);
    assert_int_equal(close(descriptor), -1);
    assert_int_equal(uv_loop_close(&world.loop), 0);
}

/* Several calls before the loop looks are one. */
static void many_are_one(void **state)
{
    (void)state;
    static struct world world;
    assert_int_equal(uv_loop_init(&world.loop), 0);
    assert_true(wakeup_init(&world.wakeup, &world.loop, collect, &world));
    for (int i = 0; i < 5; i++)
        wakeup_send(&world.wakeup);
    uv_run(&world.loop, UV_RUN_NOWAIT);
    uv_run(&world.loop, UV_RUN_NOWAIT);
    assert_int_equal(world.calls, 1);
    wakeup_send(&world.wakeup);
    uv_run(&world.loop, UV_RUN_NOWAIT);
    assert_int_equal(world.calls, 2);
    uv_close((uv_handle_t *)&world.wakeup.poll, NULL);
    uv_run(&world.loop, UV_RUN_DEFAULT);
    wakeup_finish(&world.wakeup);
    assert_int_equal(uv_loop_close(&world.loop), 0);
}

static void no_descriptor(void **state)
{
    (void)state;
    static struct world world;
    struct rlimit before, none;
    assert_int_equal(uv_loop_init(&world.loop), 0);
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &before), 0);
    none = (struct rlimit){0, before.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &none), 0);
    bool has_one = wakeup_init(&world.wakeup, &world.loop, collect, &world);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &before), 0);
    assert_false(has_one);
    wakeup_finish(&world.wakeup);
    assert_int_equal(uv_loop_close(&world.loop), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_is_missed),
        cmocka_unit_test(many_are_one),
        cmocka_unit_test(no_descriptor),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
