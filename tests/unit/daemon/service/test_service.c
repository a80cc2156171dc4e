/* SPDX-License-Identifier: Apache-2.0 */
/* test_service.c - tests the start, the limits and the end of a service, and iterations of its loop. */
#include "tests/support/unit.h"

#include <unistd.h>

#include "proto/base/clock.h"
#include "daemon/system/machine.h"
#include "tests/support/daemon/session_world.h"

static void wake(void *context)
{
    (void)context;
}

static struct service *create(const struct service_options *options)
{
    struct service *service;
    struct bvhd_error error;
    if (service_create(options, wake, NULL, &service, &error) != BVHD_OK)
        fail_msg("%s", error.text);
    return service;
}

static void test_defaults_suit_the_machine(void **state)
{
    (void)state;
    struct service_options options = service_options_default();
    struct service *service = create(&options);
    uint64_t all = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE);
    assert_true(machine_memory() > 0 && machine_memory() <= all);
    assert_int_equal(service->memory.limit, machine_memory() / 2);
    assert_int_equal(pool_threads(service->pool) > 0, 1);
    assert_int_equal(service_pending(service), 0);
    service_destroy(service);
    service_destroy(NULL);
}

static void test_little_memory_is_raised(void **state)
{
    (void)state;
    struct service_options options = world_options();
    options.memory = 1;
    options.max_pool = UINT64_MAX;
    struct service *service = create(&options);
    assert_int_equal(service->memory.limit, 16 << 20);
    assert_int_equal(service->options.max_pool, 2 << 20);
    service_destroy(service);
}

static void test_a_service_that_cannot_start_leaves_nothing(void **state)
{
    (void)state;
    struct service_options options = world_options();
    struct service *service;
    struct bvhd_error error;
    options.workers = POOL_MAX_THREADS + 1;
    assert_int_not_equal(service_create(&options, wake, NULL, &service, &error), BVHD_OK);
    assert_true(error.text[0] != '\0');
    options.workers = 1;
    options.memory = 16 << 20;
    options.max_queue = 1 << 24; /* needs a table that exceeds the budget */
    assert_int_equal(service_create(&options, wake, NULL, &service, &error), BVHD_NO_MEMORY);
}

/* Running jobs are told to stop, and service_destroy waits for them. */
static void test_it_ends_while_workers_are_busy(void **state)
{
    (void)state;
    static struct session_world world;
    struct service_options options = world_options();
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100000, 1);
    for (int iterations = 0; iterations < 40; iterations += 13) {
        world_init(&world, &options);
        struct world_client *client = world_join(&world);
        struct control_item item = world_item(&mesh.input, mesh.size, SOURCE_MEMFD, 0);
        struct control_build build = {.memfd_count = 1, .memfd_sizes = {mesh.size}, .item_count = 1, .items = &item};
        int descriptor = world_memfd(mesh.payload, mesh.size, WORLD_SEALS_ONCE);
        world_build(client, 1, &build, (struct bytes){0}, &descriptor);
        for (int i = 0; i < iterations; i++) {
            world_iterate(&world);
            usleep(1000);
        }
        world_leave(client);
        world_finish(&world);
    }
    world_mesh_finish(&mesh);
}

/* Disposes of a canonical copy as a cache hit does. */
static void dispose_of_a_large_copy(struct service *service)
{
    const struct control_item item = {.type = STRUCTURE_BOTTOM};
    const struct preparation_source source = {0};
    struct preparation *preparation = preparation_create(&item, 0, &source, &service->memory);
    assert_non_null(preparation);
    preparation->class = ADMISSION_LARGE;
    preparation->promised = preparation->entry.canonical.size = 2 << 20;
    preparation->entry.canonical.owned = memory_alloc(&preparation->memory, preparation->entry.canonical.size);
    admission_give(&service->admission.prepares[ADMISSION_LARGE], preparation->promised);
    admission_expect(&service->admission, ADMISSION_LARGE, preparation->promised_build);
    disposals_add(&service->disposals, preparation);
    assert_int_equal(service->disposals.running, 1);
}

/* The disposal ends at any moment of service_destroy, also between its checks. */
static void test_it_ends_while_copies_are_freed(void **state)
{
    (void)state;
    struct service_options options = world_options();
    for (int i = 0; i < 300; i++) {
        struct service *service = create(&options);
        dispose_of_a_large_copy(service);
        for (uint64_t until = clock_ns() + (uint64_t)(i % 100) * 1000; clock_ns() < until;)
            continue;
        service_destroy(service);
    }
}

static void test_pending_counts_what_has_not_left(void **state)
{
    (void)state;
    static struct session_world world;
    struct service_options options = world_options();
    struct world_mesh mesh;
    world_init(&world, &options);
    world_mesh_init(&mesh, 100, 1);
    struct world_client *client = world_join(&world), *other = world_join(&world);
    client->hold = other->hold = true;
    world_build_mesh(client, 1, &mesh);
    world_build_mesh(other, 1, &mesh);
    assert_int_equal(service_pending(world.service), 2);
    world_await_result(client, 1, 0);
    world_await_result(other, 1, 0);
    assert_int_equal(service_pending(world.service), 2);
    client->hold = false;
    world_iterate(&world);
    assert_int_equal(service_pending(world.service), 1);
    world_leave(other);
    assert_int_equal(service_pending(world.service), 0);
    world_mesh_finish(&mesh);
    world_finish(&world);
}

/* A request of many items starts only some of them in one iteration of the loop, and wakes it for another. */
static void test_items_start_in_several_iterations(void **state)
{
    (void)state;
    enum { ITEMS = 2 * ADMISSION_ITERATION_STARTS + 10 };
    static struct session_world world;
    static struct control_item items[ITEMS];
    struct service_options options = world_options();
    struct world_mesh mesh;
    options.credits = ITEMS;
    world_init(&world, &options);
    world_mesh_init(&mesh, 10, 1);
    struct world_client *client = world_join(&world);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    for (int i = 0; i < ITEMS; i++)
        items[i] = world_item(&mesh.input, mesh.size, SOURCE_INLINE, 0);
    world_iterate(&world);
    while (sem_trywait(&world.woken) == 0)
        ;
    struct control_build build = {.item_count = ITEMS, .items = items};
    world_build(client, 1, &build, (struct bytes){mesh.payload, mesh.size}, NULL);
    for (int iteration = 1; iteration <= 3; iteration++) {
        uint32_t started = iteration < 3 ? iteration * ADMISSION_ITERATION_STARTS : ITEMS;
        assert_int_equal(world_counters(&world).prepares_started, started);
        assert_int_equal(world_counters(&world).prepares_waiting, ITEMS - started);
        assert_int_equal(sem_trywait(&world.woken) == 0, iteration < 3);
        world_iterate(&world);
    }
    world_open(gates[0]);
    world_open(gates[1]);
    world_settle(&world);
    for (uint32_t i = 0; i < ITEMS; i++)
        assert_int_equal(world_status(client, 1, i), BVHD_OK);
    world_mesh_finish(&mesh);
    world_finish(&world);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_defaults_suit_the_machine),
        cmocka_unit_test(test_little_memory_is_raised),
        cmocka_unit_test(test_a_service_that_cannot_start_leaves_nothing),
        cmocka_unit_test(test_it_ends_while_workers_are_busy),
        cmocka_unit_test(test_it_ends_while_copies_are_freed),
        cmocka_unit_test(test_pending_counts_what_has_not_left),
        cmocka_unit_test(test_items_start_in_several_iterations),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
