/* SPDX-License-Identifier: Apache-2.0 */
/* test_request.c - tests items of requests: each source of payloads, each error, a cancellation in each state. */
#include "tests/support/unit.h"

#include "tests/support/builder/inputs.h"
#include "tests/support/daemon/session_world.h"

static struct session_world world;

static int set_up(void **state)
{
    (void)state;
    world_init(&world, NULL);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    return 0;
}

static void check_item(struct world_client *client, uint64_t request, uint32_t item, const struct build_input *input,
                       enum result_origin origin)
{
    const struct world_event *event = world_await_result(client, request, item);
    world_check_bytes(event, input);
    assert_int_equal(event->result->origin, origin);
    assert_true(event->result->queued_ms >= 0 && event->result->prepare_ms > 0);
    assert_int_equal(event->result->build_ms > 0, origin == ORIGIN_BUILT);
    assert_true(event->result->summary.build_ms > 0);
    assert_int_equal(event->result->summary.peak_bytes > 0, event->result->summary.primitives > 0);
    assert_int_equal(world_prepared(client, request, item), 1);
}

/* ---- payloads ---- */

static void test_inline_payloads(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 500, 1);
    world_build_mesh(client, 1, &mesh);
    check_item(client, 1, 0, &mesh.input, ORIGIN_BUILT);
    world_settle(&world);
    assert_null(session_find(client->session, 1));
    world_mesh_finish(&mesh);
}

static void test_pool_payloads(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh meshes[3];
    unsigned char *pool = calloc(1, 1 << 20);
    struct control_item items[3];
    uint64_t at = 0;
    for (uint32_t i = 0; i < 3; i++) {
        world_mesh_init(&meshes[i], 2000 + i, i);
        memcpy(pool + at, meshes[i].payload, meshes[i].size);
        items[i] = world_item(&meshes[i].input, meshes[i].size, SOURCE_POOL, at);
        at += bytes_align(meshes[i].size, 64);
    }
    world_pool(client, 1, world_memfd(pool, 1 << 20, WORLD_SEALS_POOL), 1 << 20);
    struct control_build build = {.item_count = 3, .items = items};
    world_build(client, 2, &build, (struct bytes){0}, NULL);
    for (uint32_t i = 0; i < 3; i++)
        check_item(client, 2, i, &meshes[i].input, ORIGIN_BUILT);
    for (uint32_t i = 0; i < 3; i++)
        world_mesh_finish(&meshes[i]);
    free(pool);
}

/* Two items share one memfd; the blob is large enough for a descriptor of its own. */
static void test_memfd_payloads(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh first, second;
    world_mesh_init(&first, 4000, 1);
    world_mesh_init(&second, 10, 2);
    uint64_t offset = bytes_align(first.size, 64), size = offset + second.size;
    unsigned char *both = calloc(1, size);
    memset(both, 1, size);
    memcpy(both, first.payload, first.size);
    memcpy(both + offset, second.payload, second.size);
    struct control_item items[] = {world_item(&first.input, first.size, SOURCE_MEMFD, 0),
                                   world_item(&second.input, second.size, SOURCE_MEMFD, offset)};
    struct control_build build = {.memfd_count = 1, .memfd_sizes = {size}, .item_count = 2, .items = items};
    int descriptor = world_memfd(both, size, WORLD_SEALS_ONCE);
    world_build(client, 1, &build, (struct bytes){0}, &descriptor);
    check_item(client, 1, 0, &first.input, ORIGIN_BUILT);
    check_item(client, 1, 1, &second.input, ORIGIN_BUILT);
    assert_true(world_result(client, 1, 0)->result->size > BLOB_INLINE_MAX);
    world_settle(&world);
    assert_int_equal(client->event_count > 0, 1);
    free(both);
    world_mesh_finish(&first);
    world_mesh_finish(&second);
}

/* Boxes, instances and an empty structure are built as triangles are. */
static void test_every_kind_of_structure(void **state)
{
    (void)state;
    static void (*const makers[])(struct test_input *) = {inputs_triangles, inputs_aabbs, inputs_instances};
    struct world_client *client = world_join(&world);
    struct test_input test;
    for (uint32_t i = 0; i <= 3; i++) {
        makers[i % 3](&test);
        if (i == 3)
            test.input.geometry_count = 0;
        uint64_t size;
        unsigned char *payload = world_payload(&test.input, &size);
        struct control_item item = world_item(&test.input, size, SOURCE_INLINE, 0);
        struct control_build build = {.item_count = 1, .items = &item};
        world_build(client, i + 1, &build, (struct bytes){payload, size}, NULL);
        check_item(client, i + 1, 0, &test.input, ORIGIN_BUILT);
        free(payload);
    }
}

/* The payloads of one request lie inline, in the pool and in a memfd. */
static void test_payloads_of_each_source_together(void **state)
{
    (void)state;
    static const enum control_source sources[] = {SOURCE_INLINE, SOURCE_POOL, SOURCE_MEMFD};
    struct world_client *client = world_join(&world);
    struct world_mesh meshes[3];
    struct control_item items[3];
    for (uint32_t i = 0; i < 3; i++) {
        world_mesh_init(&meshes[i], 20 + i, i);
        items[i] = world_item(&meshes[i].input, meshes[i].size, sources[i], 0);
    }
    struct control_build build = {.memfd_count = 1, .memfd_sizes = {meshes[2].size}, .item_count = 3, .items = items};
    int descriptor = world_memfd(meshes[2].payload, meshes[2].size, WORLD_SEALS_ONCE);
    world_pool(client, 1, world_memfd(meshes[1].payload, meshes[1].size, WORLD_SEALS_POOL), meshes[1].size);
    world_build(client, 2, &build, (struct bytes){meshes[0].payload, meshes[0].size}, &descriptor);
    for (uint32_t i = 0; i < 3; i++) {
        check_item(client, 2, i, &meshes[i].input, ORIGIN_BUILT);
        world_mesh_finish(&meshes[i]);
    }
}

static void test_memfds_under_way_have_a_limit(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_gate *gates[] = {world_shut(&world), world_shut(&world)};
    struct world_mesh mesh;
    world_mesh_init(&mesh, 5, 1);
    struct control_item item = world_item(&mesh.input, mesh.size, SOURCE_MEMFD, 0);
    struct control_build build = {
        .memfd_count = 4, .memfd_sizes = {mesh.size, mesh.size, mesh.size, mesh.size}, .item_count = 1, .items = &item};
    uint64_t request = 0, refused = 0;
    for (int round = 0; round < 70; round++) {
        int files[4];
        for (int i = 0; i < 4; i++)
            files[i] = world_memfd(mesh.payload, mesh.size, WORLD_SEALS_ONCE);
        world_build(client, ++request, &build, (struct bytes){0}, files);
        assert_int_equal(world_cancel(client, request, NULL, 0), BVHD_OK); /* gives credits back, but no memfds */
        refused += world_find(client, FRAME_BUSY, request, 0) != NULL;
    }
    assert_int_equal(refused, 70 - 64);
    world_open(gates[0]);
    world_open(gates[1]);
    while (client->session->request_count > 0)
        world_iterate(&world);
    int files[4];
    for (int i = 0; i < 4; i++)
        files[i] = world_memfd(mesh.payload, mesh.size, WORLD_SEALS_ONCE);
    world_build(client, ++request, &build, (struct bytes){0}, files);
    check_item(client, request, 0, &mesh.input, ORIGIN_BUILT);
    world_mesh_finish(&mesh);
}

static void build_boxes(struct world_client *client, uint64_t request, struct test_input *test, uint32_t count)
{
    uint64_t size;
    inputs_aabbs(test);
    test->geometries[0].aabbs.stride = 0;
    test->geometries[0].range.primitive_count = count;
    unsigned char *payload = world_payload(&test->input, &size);
    struct control_item item = world_item(&test->input, size, SOURCE_INLINE, 0);
    struct control_build build = {.item_count = 1, .items = &item};
    world_build(client, request, &build, (struct bytes){payload, size}, NULL);
    free(payload);
}

/*
 * A few bytes of payload stand for many boxes. Such an item is queued again when its need is known, and refused if that
 * exceeds the budget.
 */
static void test_items_are_larger_than_their_payloads(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct test_input test;
    build_boxes(client, 1, &test, 60000);
    check_item(client, 1, 0, &test.input, ORIGIN_BUILT);
    assert_int_equal(world_counters(&world).prepares_started, 2);
    build_boxes(client, 2, &test, 500000000); /* 12 GB */
    assert_int_equal(world_await_result(client, 2, 0)->result->error.status, BVHD_TOO_LARGE);
    world_settle(&world);
    assert_int_equal(world_prepared(client, 2, 0), 1);
    assert_true(world_counters(&world).memory_peak < 64 << 20);
}

static void test_a_worker_checks_memfds(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100, 1);
    struct control_item items[2];
    for (int i = 0; i < 2; i++)
        items[i] = world_item(&mesh.input, mesh.size, SOURCE_MEMFD, 0);
    items[1].memfd = 1;
    struct control_build build = {
        .memfd_count = 2, .memfd_sizes = {mesh.size, mesh.size}, .item_count = 2, .items = items};
    int descriptors[] = {world_memfd(mesh.payload, mesh.size, 0),
                         world_memfd(mesh.payload, mesh.size, WORLD_SEALS_ONCE)};
    world_build(client, 1, &build, (struct bytes){0}, descriptors);
    assert_int_equal(world_await_result(client, 1, 0)->result->error.status, BVHD_INVALID);
    assert_string_equal(world_result(client, 1, 0)->result->error.where, "memfds[0]");
    check_item(client, 1, 1, &mesh.input, ORIGIN_BUILT);
    assert_int_equal(world_prepared(client, 1, 0), 1);
    world_mesh_finish(&mesh);
}

/* ---- errors of single items ---- */

static void test_bad_items_fail_alone(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100, 1);
    enum {
        GOOD,
        BEYOND,
        OVERFLOW,
        NO_POOL,
        NO_MEMFD,
        NO_SOURCE,
        ROWS,
        COUNT,
        TYPE,
        QUALITY,
        TARGET,
        UPDATE,
        SHORT,
        ITEMS
    };
    struct control_item items[ITEMS];
    static const enum bvhd_status wanted[ITEMS] = {
        [BEYOND] = BVHD_INVALID,     [OVERFLOW] = BVHD_INVALID,      [NO_POOL] = BVHD_INVALID,
        [NO_MEMFD] = BVHD_INVALID,   [NO_SOURCE] = BVHD_UNSUPPORTED, [ROWS] = BVHD_CORRUPT,
        [COUNT] = BVHD_CORRUPT,      [TYPE] = BVHD_INVALID,          [QUALITY] = BVHD_INVALID,
        [TARGET] = BVHD_UNSUPPORTED, [UPDATE] = BVHD_INVALID,        [SHORT] = BVHD_CORRUPT,
    };
    for (int i = 0; i < ITEMS; i++)
        items[i] = world_item(&mesh.input, mesh.size, SOURCE_INLINE, 0);
    items[BEYOND].payload_offset = 1;
    items[OVERFLOW].payload_offset = UINT64_MAX - 8;
    items[NO_POOL].payload_source = SOURCE_POOL;
    items[NO_MEMFD].payload_source = SOURCE_MEMFD;
    items[NO_SOURCE].payload_source = 17;
    items[ROWS].geometry_size = 8;
    items[COUNT].geometry_count = UINT32_MAX;
    items[TYPE].type = 99;
    items[QUALITY].quality = 99;
    items[TARGET].target = 99;
    items[UPDATE].mode = MODE_UPDATE;
    items[SHORT].payload_size = 16;
    struct control_build build = {.item_count = ITEMS, .items = items};
    world_build(client, 1, &build, (struct bytes){mesh.payload, mesh.size}, NULL);
    world_settle(&world);
    for (uint32_t i = 1; i < ITEMS; i++) {
        const struct world_event *event = world_result(client, 1, i);
        char place[32];
        assert_non_null(event);
        if (event->result->error.status != wanted[i])
            fail_msg("item %u: %s: %s", i, event->result->error.where, event->result->error.text);
        snprintf(place, sizeof place, "infos[%u]", i);
        assert_memory_equal(event->result->error.where, place, strlen(place));
        assert_int_equal(world_prepared(client, 1, i), 1);
    }
    check_item(client, 1, GOOD, &mesh.input, ORIGIN_BUILT);
    assert_null(session_find(client->session, 1));
    world_mesh_finish(&mesh);
}

static void test_rules_between_items(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    struct test_input top;
    world_mesh_init(&mesh, 10, 1);
    inputs_instances(&top);
    uint64_t top_size, offset = bytes_align(mesh.size, 64);
    unsigned char *payload = world_payload(&top.input, &top_size), *both = calloc(1, offset + top_size);
    memcpy(both, mesh.payload, mesh.size);
    memcpy(both + offset, payload, top_size);
    struct control_item items[5];
    for (int i = 0; i < 4; i++)
        items[i] = world_item(&mesh.input, mesh.size, SOURCE_INLINE, 0);
    items[0].destination = items[1].destination = 5;
    items[2].destination = 55; /* which the top level refers to */
    items[3].mode = MODE_UPDATE;
    items[3].source = 5;
    items[4] = world_item(&top.input, top_size, SOURCE_INLINE, offset);
    items[4].destination = 6;
    struct control_build build = {.item_count = 5, .items = items};
    world_build(client, 1, &build, (struct bytes){both, offset + top_size}, NULL);
    world_settle(&world);
    static const enum bvhd_vuid wanted[] = {BVHD_VUID_03698, BVHD_VUID_03698, BVHD_VUID_NONE, BVHD_VUID_03403,
                                            BVHD_VUID_03407};
    for (uint32_t i = 0; i < 5; i++)
        assert_int_equal(world_result(client, 1, i)->result->error.vuid, wanted[i]);
    world_check_bytes(world_result(client, 1, 2), &mesh.input);
    assert_string_equal(world_result(client, 1, 4)->result->error.where, "infos[4].references[1]");
    free(both);
    free(payload);
    world_mesh_finish(&mesh);
}

/* ---- cancellation ---- */

static void hold_workers(struct world_gate *ret_gates[2])
{
    ret_gates[0] = world_shut(&world);
    ret_gates[1] = world_shut(&world);
}

static void release_workers(struct world_gate *gates[2])
{
    world_open(gates[0]);
    world_open(gates[1]);
}

/* Promises the whole share of both classes, and takes it back. */
static void take_all(struct admission_share shares[ADMISSION_CLASSES])
{
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        admission_give(&shares[class], world.service->admission.limit);
}

static void give_all(struct admission_share shares[ADMISSION_CLASSES])
{
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        admission_end(&shares[class], world.service->admission.limit);
}

/* A small item waits neither for large ones nor for memory that they hold. */
static void test_small_ones_pass_large_ones(void **state)
{
    (void)state;
    struct world_client *clients[2] = {world_join(&world), world_join(&world)};
    struct service *service = world.service;
    struct world_mesh small, large;
    world_mesh_init(&small, 100, 1);
    world_mesh_init(&large, 1500, 2);
    struct control_item item = world_item(&large.input, large.size, SOURCE_INLINE, 0);
    void *block = memory_alloc(&service->large, service->large.limit);
    assert_non_null(block);
    service->admission.limit =
        (preparation_guess(&item) - 1) * ADMISSION_SMALL_DIVISOR; /* a little too much to be small */
    admission_give(&service->admission.prepares[ADMISSION_LARGE], service->admission.limit);
    world_build_mesh(clients[0], 1, &large);
    world_await_state(clients[0], 1, 0, ITEM_WAITING);
    world_build_mesh(clients[1], 1, &small);
    check_item(clients[1], 1, 0, &small.input, ORIGIN_BUILT);
    world_await_state(clients[0], 1, 0, ITEM_WAITING);
    admission_end(&service->admission.prepares[ADMISSION_LARGE], service->admission.limit);
    service_collect(service);
    assert_int_equal(world_await_result(clients[0], 1, 0)->result->error.status, BVHD_NO_MEMORY);
    memory_free(&service->large, block);
    world_build_mesh(clients[0], 2, &large);
    check_item(clients[0], 2, 0, &large.input, ORIGIN_BUILT);
    world_mesh_finish(&small);
    world_mesh_finish(&large);
}

static void check_cancelled(struct world_client *client, uint64_t request)
{
    assert_int_equal(world_status(client, request, 0), BVHD_CANCELLED);
    world_settle(&world);
    assert_int_equal(world_counters(&world).cancelled, 1);
}

static bool is_gone(void *context)
{
    const struct world_client *client = context;
    return client->session->request_count == 0;
}

static void test_cancel_while_it_waits_for_memory(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100, 1);
    take_all(world.service->admission.prepares);
    world_build_mesh(client, 1, &mesh);
    world_await_state(client, 1, 0, ITEM_WAITING);
    assert_int_equal(world_counters(&world).prepares_waiting, 1);
    assert_int_equal(world_cancel(client, 1, NULL, 0), BVHD_OK);
    check_cancelled(client, 1);
    assert_int_equal(world_prepared(client, 1, 0), 1);
    assert_null(session_find(client->session, 1));
    assert_int_equal(world_counters(&world).prepares_started, 0);
    give_all(world.service->admission.prepares);
    world_mesh_finish(&mesh);
}

static void test_cancel_while_a_worker_prepares(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_gate *gates[2];
    struct world_mesh mesh;
    hold_workers(gates);
    world_mesh_init(&mesh, 100, 1);
    world_build_mesh(client, 1, &mesh);
    world_await_state(client, 1, 0, ITEM_PREPARING);
    assert_int_equal(world_cancel(client, 1, NULL, 0), BVHD_OK);
    check_cancelled(client, 1); /* at once, without the worker */
    assert_int_equal(world_cancel(client, 1, NULL, 0), BVHD_OK);
    release_workers(gates);
    world_await(&world, is_gone, client);
    assert_int_equal(world_prepared(client, 1, 0), 1);
    world_build_mesh(client, 2, &mesh);
    check_item(client, 2, 0, &mesh.input, ORIGIN_BUILT);
    world_mesh_finish(&mesh);
}

static void test_cancel_while_it_waits_for_its_build(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100, 1);
    take_all(world.service->admission.builds);
    world_build_mesh(client, 1, &mesh);
    world_await_state(client, 1, 0, ITEM_JOINED);
    assert_int_equal(world_counters(&world).builds_waiting, 1);
    assert_int_equal(world_cancel(client, 1, NULL, 0), BVHD_OK);
    check_cancelled(client, 1);
    assert_int_equal(world_counters(&world).builds_waiting, 0);
    assert_int_equal(world_prepared(client, 1, 0), 1);
    give_all(world.service->admission.builds);
    assert_int_equal(world_counters(&world).builds_started, 0);
    world_mesh_finish(&mesh);
}

static bool builds_run(void *context)
{
    (void)context;
    return world_counters(&world).builds_running > 0 && world_counters(&world).jobs_running > 0;
}

static void test_cancel_while_it_is_built(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 200000, 1);
    struct control_item item = world_item(&mesh.input, mesh.size, SOURCE_MEMFD, 0);
    struct control_build build = {.memfd_count = 1, .memfd_sizes = {mesh.size}, .item_count = 1, .items = &item};
    int descriptor = world_memfd(mesh.payload, mesh.size, WORLD_SEALS_ONCE);
    world_build(client, 1, &build, (struct bytes){0}, &descriptor);
    world_await(&world, builds_run, NULL);
    assert_int_equal(world_cancel(client, 1, (const uint32_t[]){0}, 1), BVHD_OK);
    check_cancelled(client, 1);
    assert_null(session_find(client->session, 1));
    world_mesh_finish(&mesh);
}

static void test_cancel_of_what_is_unknown_or_over(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 100, 1);
    assert_int_equal(world_cancel(client, 77, NULL, 0), BVHD_OK);
    client->hold = true;
    world_build_mesh(client, 1, &mesh);
    world_await_result(client, 1, 0);
    assert_int_equal(world_cancel(client, 1, NULL, 0), BVHD_OK);
    client->hold = false;
    world_check_bytes(world_result(client, 1, 0), &mesh.input);
    world_mesh_finish(&mesh);
}

static void test_cancel_of_single_items(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_gate *gates[2];
    struct world_mesh mesh;
    struct control_item items[3];
    world_mesh_init(&mesh, 100, 1);
    for (int i = 0; i < 3; i++)
        items[i] = world_item(&mesh.input, mesh.size, SOURCE_INLINE, 0);
    struct control_build build = {.item_count = 3, .items = items};
    hold_workers(gates);
    world_build(client, 1, &build, (struct bytes){mesh.payload, mesh.size}, NULL);
    assert_int_equal(world_cancel(client, 1, (const uint32_t[]){2, 0, 2}, 3), BVHD_OK);
    assert_int_equal(world_status(client, 1, 0), BVHD_CANCELLED);
    assert_int_equal(world_status(client, 1, 2), BVHD_CANCELLED);
    assert_null(world_result(client, 1, 1));
    release_workers(gates);
    check_item(client, 1, 1, &mesh.input, ORIGIN_BUILT);
    world_await(&world, is_gone, client);
    for (uint32_t i = 0; i < 3; i++)
        assert_int_equal(world_prepared(client, 1, i), 1);
    world_mesh_finish(&mesh);
}

static void test_cancel_of_items_that_never_were_ends_the_connection(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    struct world_gate *gates[2];
    struct world_mesh mesh;
    hold_workers(gates);
    world_mesh_init(&mesh, 100, 1);
    world_build_mesh(client, 1, &mesh);
    assert_int_equal(world_cancel(client, 1, (const uint32_t[]){0, 1}, 2), BVHD_INVALID);
    assert_null(world_result(client, 1, 0));
    release_workers(gates);
    world_mesh_finish(&mesh);
}

/* ---- GET ---- */

static void test_get_of_known_and_unknown_keys(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world), *other = world_join(&world);
    struct world_mesh mesh;
    world_mesh_init(&mesh, 1500, 1);
    world_build_mesh(client, 1, &mesh);
    check_item(client, 1, 0, &mesh.input, ORIGIN_BUILT);
    struct key keys[] = {{{1, 2, 3}}, world_result(client, 1, 0)->result->key};
    world_get(other, 1, keys, 2);
    assert_int_equal(world_status(other, 1, 0), BVHD_NOT_FOUND);
    world_check_bytes(world_result(other, 1, 1), &mesh.input);
    assert_int_equal(world_result(other, 1, 1)->result->origin, ORIGIN_MEMORY);
    assert_int_equal(world_prepared(other, 1, 0) + world_prepared(other, 1, 1), 0);
    assert_null(session_find(other->session, 1));
    struct counters counters = world_counters(&world);
    assert_int_equal(counters.hits_memory, 1);
    assert_int_equal(counters.misses, 2);
    world_build_mesh(other, 2, &mesh);
    check_item(other, 2, 0, &mesh.input, ORIGIN_MEMORY);
    world_settle(&world);
    assert_int_equal(world_counters(&world).builds_started, 1);
    world_mesh_finish(&mesh);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(test_inline_payloads),
        TEST(test_pool_payloads),
        TEST(test_memfd_payloads),
        TEST(test_every_kind_of_structure),
        TEST(test_payloads_of_each_source_together),
        TEST(test_memfds_under_way_have_a_limit),
        TEST(test_items_are_larger_than_their_payloads),
        TEST(test_a_worker_checks_memfds),
        TEST(test_bad_items_fail_alone),
        TEST(test_rules_between_items),
        TEST(test_small_ones_pass_large_ones),
        TEST(test_cancel_while_it_waits_for_memory),
        TEST(test_cancel_while_a_worker_prepares),
        TEST(test_cancel_while_it_waits_for_its_build),
        TEST(test_cancel_while_it_is_built),
        TEST(test_cancel_of_what_is_unknown_or_over),
        TEST(test_cancel_of_single_items),
        TEST(test_cancel_of_items_that_never_were_ends_the_connection),
        TEST(test_get_of_known_and_unknown_keys),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
