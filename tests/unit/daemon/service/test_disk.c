/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_disk.c - tests that results outlive the service on disk: who is answered from there and how, lookups that are
 * joined and left, damaged files, and directories that cannot be used.
 */
#include "tests/support/unit.h"

#include <fcntl.h>
#include <sys/stat.h>

#include "builder/store/generation.h"
#include "daemon/service/disk_writer.h"
#include "daemon/system/machine.h"
#include "tests/support/daemon/session_world.h"
#include "tests/support/scratch.h"

static struct session_world world;
static struct service_options options;
static struct world_mesh mesh;
static struct key key; /* of the mesh */
static char directory[128];

static int set_up(void **state)
{
    static int count;
    (void)state;
    snprintf(directory, sizeof directory, "%s/%d", scratch_folder, count++);
    options = world_options();
    options.disk_directory = directory;
    options.disk_budget = 64 << 20;
    world_init(&world, &options);
    world_mesh_init(&mesh, 5000, 1); /* its structure has a descriptor */
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    world_finish(&world);
    world_mesh_finish(&mesh);
    return 0;
}

/* The service ends, writes what is queued, and starts again with nothing in memory. */
static void begin_again(void)
{
    world_finish(&world);
    world_init(&world, &options);
}

static void ask(struct world_client *client, uint64_t request, const struct world_mesh *asked)
{
    struct control_item item = world_item(&asked->input, asked->size, SOURCE_MEMFD, 0);
    struct control_build build = {.memfd_count = 1, .memfd_sizes = {asked->size}, .item_count = 1, .items = &item};
    int descriptor = world_memfd(asked->payload, asked->size, WORLD_SEALS_ONCE);
    world_build(client, request, &build, (struct bytes){0}, &descriptor);
}

static void expect_origin(const struct world_event *event, enum result_origin origin)
{
    world_check_bytes(event, &mesh.input);
    assert_int_equal(event->result->origin, origin);
}

/* Has the mesh built and written to disk by a service that ends then. */
static void keep_mesh(void)
{
    struct world_client *client = world_join(&world);
    ask(client, 1, &mesh);
    expect_origin(world_await_result(client, 1, 0), ORIGIN_BUILT);
    key = world_result(client, 1, 0)->result->key;
    begin_again();
}

static void results_outlive_the_service(void **state)
{
    (void)state;
    struct world_mesh small; /* its structure is sent inside frames */
    world_mesh_init(&small, 10, 2);
    struct world_client *client = world_join(&world);
    ask(client, 1, &mesh);
    ask(client, 2, &small);
    const struct control_result built = *world_await_result(client, 1, 0)->result;
    world_await_result(client, 2, 0);
    assert_int_equal(world_counters(&world).misses, 2);
    begin_again();
    client = world_join(&world);
    ask(client, 1, &mesh);
    ask(client, 2, &small);
    expect_origin(world_await_result(client, 1, 0), ORIGIN_DISK);
    world_check_bytes(world_await_result(client, 2, 0), &small.input);
    const struct control_result *kept = world_result(client, 1, 0)->result;
    assert_memory_equal(&kept->key, &built.key, sizeof kept->key);
    assert_memory_equal(&kept->summary, &built.summary, sizeof kept->summary);
    assert_true(kept->build_ms == 0);
    ask(client, 3, &mesh);
    expect_origin(world_await_result(client, 3, 0), ORIGIN_MEMORY);
    struct counters counters = world_counters(&world);
    assert_int_equal(counters.hits_disk, 2);
    assert_int_equal(counters.latency_disk_items, 2);
    assert_int_equal(counters.hits_memory, 1);
    assert_int_equal(counters.misses, 0);
    assert_int_equal(counters.builds_started, 0);
    world_mesh_finish(&small);
}

static bool are_written(void *context)
{
    const uint32_t *count = context;
    return world_counters(&world).disk_written == *count;
}

static bool is_counted(void *context)
{
    (void)context;
    return world_counters(&world).disk_entries == 1;
}

static void counters_say_what_is_there(void **state)
{
    (void)state;
    struct world_client *client = world_join(&world);
    ask(client, 1, &mesh);
    world_await_result(client, 1, 0);
    world_await(&world, are_written, &(uint32_t){1});
    assert_int_equal(world_counters(&world).disk_budget, options.disk_budget);
    begin_again();
    world_await(&world, is_counted, NULL);
    assert_true(world_counters(&world).disk_bytes >= world_counters(&world).disk_entries * 4096);
    assert_int_equal(world_counters(&world).disk_written, 0);
    assert_int_equal(world_counters(&world).disk_queue_bytes, 0);
}

/* ---- GET ---- */

static void get_finds_what_is_on_disk(void **state)
{
    (void)state;
    keep_mesh();
    struct world_client *client = world_join(&world);
    struct key keys[2] = {key, key};
    keys[1].bytes[0] ^= 1;
    world_get(client, 1, keys, 2);
    expect_origin(world_await_result(client, 1, 0), ORIGIN_DISK);
    const struct bvhd_error *error = &world_await_result(client, 1, 1)->result->error;
    assert_int_equal(error->status, BVHD_NOT_FOUND);
    assert_string_equal(error->where, "keys[1]");
    assert_int_equal(world_counters(&world).hits_disk, 1);
    assert_int_equal(world_counters(&world).misses, 1);
    assert_int_equal(world_counters(&world).builds_started, 0);
}

/* ---- lookups that are joined and left ---- */

/* Keeps both workers busy, so that lookups wait for a thread. */
struct gates {
    struct world_gate *gates[2];
};

static struct gates stop_workers(void)
{
    return (struct gates){{world_shut(&world), world_shut(&world)}};
}

static void let_workers_go(struct gates gates)
{
    world_open(gates.gates[0]);
    world_open(gates.gates[1]);
}

static void check_joiners(bool is_kept)
{
    struct world_client *clients[3] = {world_join(&world), world_join(&world), world_join(&world)};
    struct gates gates = stop_workers();
    for (uint64_t i = 0; i < 3; i++)
        world_get(clients[i], 1, &key, 1);
    struct flight *flight = flights_find(&world.service->flights, &key);
    assert_non_null(flight);
    for (int i = 0; i < 3; i++)
        assert_int_equal(session_find(clients[i]->session, 1)->items[0].state, ITEM_JOINED);
    assert_int_equal(world.service->flights.looking, 1);
    let_workers_go(gates);
    for (int i = 0; i < 3; i++) {
        const struct world_event *event = world_await_result(clients[i], 1, 0);
        if (is_kept)
            expect_origin(event, ORIGIN_DISK);
        else
            assert_int_equal(event->result->error.status, BVHD_NOT_FOUND);
    }
    struct counters counters = world_counters(&world);
    assert_int_equal(counters.hits_disk, is_kept ? 3 : 0);
    assert_int_equal(counters.misses, is_kept ? 0 : 3);
    assert_int_equal(counters.coalesced, 0);
}

static void who_joins_a_lookup_is_answered_by_it(void **state)
{
    (void)state;
    keep_mesh();
    check_joiners(true);
}

static void who_joins_a_lookup_in_vain_is_told(void **state)
{
    (void)state;
    memset(&key, 7, sizeof key);
    check_joiners(false);
}

/* The key of the mesh, which a service without a disk has built. */
static void learn_key(void)
{
    world_finish(&world);
    struct service_options plain = world_options();
    world_init(&world, &plain);
    struct world_client *client = world_join(&world);
    ask(client, 1, &mesh);
    key = world_await_result(client, 1, 0)->result->key;
    begin_again();
}

/*
 * A lookup that GET has started gets something to build from an item of BUILD that joins it. `leaves` is whether that
 * item's client leaves then: GET waits for the build all the same.
 */
static void check_get_then_build(bool leaves)
{
    learn_key();
    struct world_client *getter = world_join(&world), *builder = world_join(&world);
    ask(builder, 1, &mesh);
    while (pool_load(world.service->pool).jobs_done == 0) /* it is prepared, and the loop does not know that yet */
        usleep(100);
    struct gates gates = stop_workers();
    world_get(getter, 1, &key, 1);
    assert_null(session_find(builder->session, 1)->items[0].waiter.flight);
    world_await_state(builder, 1, 0, ITEM_JOINED);
    assert_int_equal(world.service->flights.looking, 1);
    if (leaves)
        world_leave(builder);
    let_workers_go(gates);
    expect_origin(world_await_result(getter, 1, 0), ORIGIN_COALESCED);
    if (!leaves)
        expect_origin(world_await_result(builder, 1, 0), ORIGIN_BUILT);
    assert_int_equal(world_counters(&world).builds_started, 1);
    assert_int_equal(world_counters(&world).misses, 1);
    assert_int_equal(world_counters(&world).coalesced, leaves ? 0 : 1);
}

static void a_build_joins_a_get(void **state)
{
    (void)state;
    check_get_then_build(false);
}

static void a_get_keeps_a_build(void **state)
{
    (void)state;
    check_get_then_build(true);
}

/* The last waiter leaves while the lookup waits for a thread; the key is free again at once. */
static void lookups_can_be_left(void **state)
{
    (void)state;
    keep_mesh();
    struct world_client *canceller = world_join(&world), *dying = world_join(&world), *stayer = world_join(&world);
    struct gates gates = stop_workers();
    world_get(canceller, 1, &key, 1);
    assert_int_equal(world_cancel(canceller, 1, NULL, 0), BVHD_OK);
    assert_null(flights_find(&world.service->flights, &key));
    world_get(dying, 1, &key, 1);
    world_leave(dying);
    assert_null(flights_find(&world.service->flights, &key));
    world_get(stayer, 1, &key, 1);
    let_workers_go(gates);
    expect_origin(world_await_result(stayer, 1, 0), ORIGIN_DISK);
    assert_int_equal(world_status(canceller, 1, 0), BVHD_CANCELLED);
    assert_int_equal(world_counters(&world).hits_disk, 1);
}

static bool holds_results(void *context)
{
    return ((struct world_client *)context)->first_held != NULL;
}

/* A client that reads nothing does not get all that it asks for into memory. */
static void lookups_wait_for_who_does_not_read(void **state)
{
    (void)state;
    enum { KEYS = 48, TRIANGLES = 8000 }; /* structures of 0.25 MiB and more */
    struct key keys[KEYS];
    world_finish(&world);
    options.memory = 16 << 20;
    options.disk_budget = 1 << 30;
    world_init(&world, &options);
    struct world_client *client = world_join(&world);
    for (uint32_t i = 0; i < KEYS; i++) {
        struct world_mesh each;
        world_mesh_init(&each, TRIANGLES, 100 + i);
        ask(client, 1 + i, &each);
        keys[i] = world_await_result(client, 1 + i, 0)->result->key;
        world_await(&world, are_written, &(uint32_t){i + 1});
        world_mesh_finish(&each);
    }
    options.cache = 0;
    begin_again();
    client = world_join(&world);
    client->hold = true;
    world_get(client, 1, keys, KEYS);
    world_await(&world, holds_results, client);
    for (int i = 0; i < 50; i++) {
        world_iterate(&world);
        usleep(1000);
    }
    assert_true(atomic_load(&world.service->account.live_bytes) < options.memory / 2);
    client->hold = false;
    world_settle(&world);
    for (uint32_t i = 0; i < KEYS; i++)
        assert_int_equal(world_result(client, 1, i)->result->origin, ORIGIN_DISK);
}

static void a_lookup_that_waits_can_be_cancelled(void **state)
{
    (void)state;
    keep_mesh();
    struct world_client *client = world_join(&world);
    struct user_member *member = &client->session->client.member;
    user_take(member, SHARE_AHEAD, options.memory); /* as if it had read nothing of as much */
    world_get(client, 1, &key, 1);
    assert_int_equal(session_find(client->session, 1)->items[0].state, ITEM_WAITING);
    assert_int_equal(world_cancel(client, 1, NULL, 0), BVHD_OK);
    assert_int_equal(world_status(client, 1, 0), BVHD_CANCELLED);
    assert_null(session_find(client->session, 1));
    user_give(member, SHARE_AHEAD, options.memory);
}

/* ---- what can be wrong with a disk ---- */

static void path_of_entry(char ret_path[512])
{
    char text[KEY_TEXT_SIZE];
    key_to_text(&key, text);
    snprintf(ret_path, 512, "%s/%s/%.2s/%s", directory, store_generation(), text, text);
}

/* Changes the last byte of the entry. */
static void damage_entry(void)
{
    char path[512];
    unsigned char byte;
    path_of_entry(path);
    int file = open(path, O_RDWR);
    assert_true(file >= 0);
    off_t at = lseek(file, -1, SEEK_END);
    assert_int_equal(pread(file, &byte, 1, at), 1);
    byte ^= 0x10;
    assert_int_equal(pwrite(file, &byte, 1, at), 1);
    close(file);
}

static void what_is_damaged_is_built_again(void **state)
{
    (void)state;
    keep_mesh();
    damage_entry();
    struct world_client *client = world_join(&world);
    ask(client, 1, &mesh);
    expect_origin(world_await_result(client, 1, 0), ORIGIN_BUILT);
    struct counters counters = world_counters(&world);
    assert_int_equal(counters.disk_damaged, 1);
    assert_int_equal(counters.disk_read_errors, 0);
    assert_int_equal(counters.misses, 1);
    begin_again();
    client = world_join(&world);
    ask(client, 1, &mesh);
    expect_origin(world_await_result(client, 1, 0), ORIGIN_DISK);
}

/* Without memory for the result, BUILD builds it, and GET says so. */
static void an_entry_that_cannot_be_read_costs_a_build(void **state)
{
    (void)state;
    keep_mesh();
    struct world_client *client = world_join(&world);
    struct descriptors *descriptors = &world.service->descriptors;
    struct gates gates = stop_workers();
    world_get(client, 1, &key, 1);
    uint32_t taken = 0;
    while (descriptors_take(descriptors, 1, DESCRIPTORS_RESERVE))
        taken++;
    let_workers_go(gates);
    assert_int_equal(world_await_result(client, 1, 0)->result->error.status, BVHD_BUSY);
    descriptors_give(descriptors, taken);
    ask(client, 2, &mesh);
    expect_origin(world_await_result(client, 2, 0), ORIGIN_DISK);
    assert_int_equal(world_counters(&world).disk_read_errors, 1);
}

/* The service works without a disk if the directory cannot be one. */
static void a_directory_that_cannot_be_used_is_done_without(void **state)
{
    (void)state;
    char path[160];
    world_finish(&world);
    snprintf(path, sizeof path, "%s/file", scratch_folder);
    int file = open(path, O_WRONLY | O_CREAT, 0600);
    assert_true(file >= 0);
    close(file);
    options.disk_directory = path;
    world_init(&world, &options);
    assert_null(world.service->disk);
    struct world_client *client = world_join(&world);
    ask(client, 1, &mesh);
    expect_origin(world_await_result(client, 1, 0), ORIGIN_BUILT);
    assert_int_equal(world_counters(&world).disk_budget, 0);
}

/* ---- the writer ---- */

static struct blob *make_blob(struct blob_account *account, uint64_t number)
{
    struct blob_writer writer;
    struct blob *blob;
    blob_writer_init(&writer, account);
    memset(writer.output.allocate(&writer.output, 100), (int)number, 100);
    assert_int_equal(blob_writer_finish(&writer, &blob, NULL), BVHD_OK);
    memset(&blob->key, 0, sizeof blob->key);
    bytes_put64(blob->key.bytes, number);
    blob->summary = (struct summary){.target = TARGET_PORTABLE, .method = "none", .quality = QUALITY_FAST};
    return blob;
}

/* A queue for one result: each of many is either written or counted as dropped. */
static void the_queue_is_bounded(void **state)
{
    (void)state;
    enum { BLOBS = 300 };
    struct blob_account *account = &world.service->account;
    struct store *store;
    struct disk_writer *writer;
    const struct store_options own = {.directory = directory, .generation = store_generation(), .budget = 64 << 20};
    assert_int_equal(store_open(&own, account->memory, &store, NULL), BVHD_OK);
    assert_int_equal(disk_writer_create(store, 1, account->memory, &writer, NULL), BVHD_OK);
    for (uint64_t i = 0; i < BLOBS; i++) {
        struct blob *blob = make_blob(account, i);
        disk_writer_add(writer, blob);
        blob_unref(blob);
        assert_true(disk_writer_load(writer).queued <= 1);
    }
    uint64_t dropped = disk_writer_load(writer).dropped;
    disk_writer_destroy(writer, 60000);
    assert_int_equal(store_state(store).written + dropped, BLOBS);
    assert_true(store_state(store).written >= 1);
    store_close(store);
    assert_int_equal(account->live_blobs, 0);
}

/* Without patience nothing is awaited, and nothing leaks. */
static void the_writer_ends_when_it_has_to(void **state)
{
    (void)state;
    struct blob_account *account = &world.service->account;
    struct store *store;
    struct disk_writer *writer;
    const struct store_options own = {.directory = directory, .generation = store_generation(), .budget = 64 << 20};
    assert_int_equal(store_open(&own, account->memory, &store, NULL), BVHD_OK);
    assert_int_equal(disk_writer_create(store, 64 << 20, account->memory, &writer, NULL), BVHD_OK);
    for (uint64_t i = 0; i < 100; i++) {
        struct blob *blob = make_blob(account, i);
        disk_writer_add(writer, blob);
        blob_unref(blob);
    }
    assert_int_equal(disk_writer_load(writer).dropped, 0);
    disk_writer_destroy(writer, 0);
    assert_int_equal(account->live_blobs, 0);
    store_close(store);
    disk_writer_destroy(NULL, 0);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    struct memory memory;
    struct blob_account account;
    struct disk *disk = NULL;
    enum bvhd_status status = BVHD_NO_MEMORY;
    memory_init(&memory, UINT64_MAX);
    blob_account_init(&account, &memory, &world.service->descriptors);
    const struct disk_options own = {directory, 64 << 20, 1 << 20, 1 << 20, 2};
    for (int failures = 0; status != BVHD_OK; failures++) {
        struct bvhd_error error;
        memory.fail_after = failures;
        status = disk_open(&own, &account, &disk, &error);
        memory.fail_after = -1;
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        assert_true(status == BVHD_OK || memory.live == 0);
    }
    disk_close(disk);
    disk_close(NULL);
    assert_int_equal(memory.live, 0);
}

/* A directory is told to clients whole, so one that is too long for that is refused by its length. */
static void a_directory_that_cannot_be_told_is_refused(void **state)
{
    (void)state;
    struct memory memory;
    struct blob_account account;
    struct disk *disk = NULL;
    struct bvhd_error error;
    char path[CONTROL_PATH_SIZE + 1];
    size_t length = (size_t)snprintf(path, sizeof path, "%s", directory);
    memory_init(&memory, UINT64_MAX);
    blob_account_init(&account, &memory, &world.service->descriptors);
    for (; length < CONTROL_PATH_SIZE; length++)
        path[length] = length % 200 == 0 || length == sizeof directory ? '/' : 'd';
    path[CONTROL_PATH_SIZE] = 0;
    path[CONTROL_PATH_SIZE - 1] = 'e';
    for (char *slash = path + 1; (slash = strchr(slash, '/')); *slash++ = '/') {
        *slash = 0;
        mkdir(path, 0700);
    }
    const struct disk_options own = {path, 64 << 20, 1 << 20, 1 << 20, 2};
    assert_int_equal(disk_open(&own, &account, &disk, &error), BVHD_TOO_LARGE);
    assert_string_equal(error.where, "cache");
    path[CONTROL_PATH_SIZE - 1] = 0;
    assert_int_equal(disk_open(&own, &account, &disk, &error), BVHD_OK);
    assert_int_equal(strlen(disk_directory(disk)), CONTROL_PATH_SIZE - 1);
    disk_close(disk);
    assert_int_equal(memory.live, 0);
}

/* By default, results take at most a quarter of the memory that the process may use. */
static void the_cache_in_memory_follows_the_machine(void **state)
{
    (void)state;
    uint64_t quarter = machine_memory() / 4, most = UINT64_C(1) << 30;
    assert_int_equal(service_options_default().cache, quarter < most ? quarter : most);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(results_outlive_the_service),
        TEST(a_directory_that_cannot_be_told_is_refused),
        TEST(counters_say_what_is_there),
        TEST(get_finds_what_is_on_disk),
        TEST(who_joins_a_lookup_is_answered_by_it),
        TEST(who_joins_a_lookup_in_vain_is_told),
        TEST(a_build_joins_a_get),
        TEST(a_get_keeps_a_build),
        TEST(lookups_can_be_left),
        TEST(lookups_wait_for_who_does_not_read),
        TEST(a_lookup_that_waits_can_be_cancelled),
        TEST(what_is_damaged_is_built_again),
        TEST(an_entry_that_cannot_be_read_costs_a_build),
        TEST(a_directory_that_cannot_be_used_is_done_without),
        TEST(the_queue_is_bounded),
        TEST(the_writer_ends_when_it_has_to),
        TEST(every_allocation_may_fail),
        cmocka_unit_test(the_cache_in_memory_follows_the_machine),
    };
    return cmocka_run_group_tests_name("disk", tests, scratch_make, scratch_remove);
}
