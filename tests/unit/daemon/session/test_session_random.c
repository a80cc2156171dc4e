/* SPDX-License-Identifier: Apache-2.0 */
/* test_session_random.c - tests that random requests of several clients are all answered, and leave nothing behind. */
/*
 * The clients build few meshes, so that many builds are equal, send good and bad items, GET and CANCEL, come, go, or
 * read nothing for a while. In the end every item of a client that stayed has one PREPARED and one RESULT with the
 * right key. Then the same is done with every allocation failing once.
 */
#include "tests/support/unit.h"

#include "builder/update/batch.h"
#include "tests/support/random.h"
#include "tests/support/daemon/session_world.h"

enum { MESHES = 6, LIVING = 5, RECORDS = 4096 };

/* A request that a client has made. */
struct asked {
    uint64_t request;
    bool is_build;
    uint32_t count;
    int meshes[8]; /* -1: wrong on purpose */
    int sources[8]; /* of an update, the mesh that its source was built from, NO_MESH: of none; else NO_UPDATE */
};

enum { NO_UPDATE = -2, NO_MESH = -1 };

struct actor {
    struct world_client *client;
    struct asked asked[RECORDS];
    uint32_t asked_count;
    uint64_t last_request;
    uint64_t pool_size;
};

static struct session_world world;
static struct world_mesh meshes[MESHES];
static struct key keys[MESHES];
static struct actor actors[LIVING];
static struct random random_source;

static uint32_t below(uint32_t count)
{
    return (uint32_t)(random_next(&random_source) % count);
}

static void make_meshes(void)
{
    static const uint32_t sizes[MESHES] = {0, 1, 40, 300, 1500, 6000};
    struct memory memory;
    struct limits limits = limits_default();
    memory_init(&memory, UINT64_MAX);
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    for (uint32_t i = 0; i < MESHES; i++) {
        struct batch_item item;
        world_mesh_init(&meshes[i], sizes[i], i);
        meshes[i].input.flags = i % 3 == 0 ? 0 : BUILD_ALLOW_UPDATE;
        assert_int_equal(batch_build(&meshes[i].input, 1, &limits, &context, &item, NULL), BVHD_OK);
        keys[i] = item.key;
        batch_finish(&item, 1, &memory);
    }
}

static void finish_meshes(void)
{
    for (uint32_t i = 0; i < MESHES; i++)
        world_mesh_finish(&meshes[i]);
}

static bool is_open(const struct actor *actor)
{
    return actor->client && actor->client->session && !actor->client->failed;
}

/* Lets a new client join in the place of one that has gone. */
static void enter(struct actor *actor)
{
    *actor = (struct actor){0};
    actor->client = world_join_silent(&world);
    if (actor->client && world_say(actor->client, FRAME_HELLO, 0, NULL) != BVHD_OK)
        assert_true(actor->client->failed);
}

static struct asked *note(struct actor *actor, bool is_build, uint32_t count)
{
    assert_true(actor->asked_count < RECORDS);
    struct asked *asked = &actor->asked[actor->asked_count++];
    *asked = (struct asked){.request = ++actor->last_request, .is_build = is_build, .count = count};
    return asked;
}

/* Makes an update of an item, whose source was built from any mesh, or never. */
static void random_update(struct control_item *item, int *ret_source)
{
    *ret_source = below(6) ? (int)below(MESHES) : NO_MESH;
    item->mode = MODE_UPDATE;
    item->source = 1;
    item->source_key = *ret_source == NO_MESH ? (struct key){{(uint8_t)below(256)}} : keys[*ret_source];
}

/* All items lie in one block: inline when it is small, else a memfd. */
static void random_build(struct actor *actor)
{
    struct control_item items[8];
    struct asked *asked = note(actor, true, 1 + below(8));
    uint64_t offsets[8], size = 0;
    for (uint32_t i = 0; i < asked->count; i++) {
        asked->meshes[i] = below(8) ? (int)below(MESHES) : -1;
        offsets[i] = size;
        size += bytes_align(meshes[asked->meshes[i] < 0 ? 1 : asked->meshes[i]].size, 64);
    }
    bool in_frame = size <= FRAME_MAX_INLINE && below(2);
    unsigned char *block = malloc(size);
    assert_non_null(block);
    memset(block, 7, size);
    for (uint32_t i = 0; i < asked->count; i++) {
        const struct world_mesh *mesh = &meshes[asked->meshes[i] < 0 ? 1 : asked->meshes[i]];
        memcpy(block + offsets[i], mesh->payload, mesh->size);
        items[i] = world_item(&mesh->input, mesh->size, in_frame ? SOURCE_INLINE : SOURCE_MEMFD, offsets[i]);
        asked->sources[i] = NO_UPDATE;
        if (below(3) == 0)
            random_update(&items[i], &asked->sources[i]);
        if (asked->meshes[i] < 0 && below(2))
            items[i].payload_offset = UINT64_MAX;
        else if (asked->meshes[i] < 0)
            items[i].type = 77;
    }
    struct control_build build = {.priority = (int)below(5) - 2, .item_count = asked->count, .items = items};
    int descriptor = -1;
    if (!in_frame) {
        build.memfd_count = 1;
        build.memfd_sizes[0] = size;
        descriptor = world_memfd(block, size, WORLD_SEALS_ONCE);
    }
    world_build(actor->client, asked->request, &build, in_frame ? (struct bytes){block, size} : (struct bytes){0},
                &descriptor);
    free(block);
}

static void random_pool_build(struct actor *actor)
{
    int mesh = (int)below(MESHES);
    uint64_t pool = ++actor->last_request;
    world_pool(actor->client, pool, world_memfd(meshes[mesh].payload, meshes[mesh].size, WORLD_SEALS_POOL),
               meshes[mesh].size);
    if (!is_open(actor) || !world_find(actor->client, FRAME_DONE, pool, 0))
        return;
    struct asked *asked = note(actor, true, 1);
    struct control_item item = world_item(&meshes[mesh].input, meshes[mesh].size, SOURCE_POOL, 0);
    struct control_build build = {.item_count = 1, .items = &item};
    asked->meshes[0] = mesh;
    asked->sources[0] = NO_UPDATE;
    world_build(actor->client, asked->request, &build, (struct bytes){0}, NULL);
}

static void random_get(struct actor *actor)
{
    struct asked *asked = note(actor, false, 1 + below(4));
    struct key wanted[4];
    for (uint32_t i = 0; i < asked->count; i++) {
        asked->meshes[i] = below(5) ? (int)below(MESHES) : -1;
        asked->sources[i] = NO_UPDATE;
        wanted[i] = asked->meshes[i] < 0 ? (struct key){{(uint8_t)below(256)}} : keys[asked->meshes[i]];
    }
    world_get(actor->client, asked->request, wanted, asked->count);
}

static void random_cancel(struct actor *actor)
{
    if (actor->asked_count == 0)
        return;
    uint32_t recent = actor->asked_count < 4 ? actor->asked_count : 4;
    const struct asked *asked = &actor->asked[actor->asked_count - 1 - below(recent)];
    uint32_t item = below(asked->count);
    enum bvhd_status status = world_cancel(actor->client, asked->request, &item, below(2));
    assert_true(status == BVHD_OK || actor->client->failed);
}

/* An update succeeds only from a source of its own mesh, if that can be updated and is still there. */
static void check_update(const struct control_result *result, int mesh, int source)
{
    bool fits = mesh >= 0 && mesh == source && meshes[mesh].input.flags & BUILD_ALLOW_UPDATE;
    if (result->error.status == BVHD_OK) {
        assert_true(fits && result->summary.refits == 1);
        assert_false(key_equal(&result->key, &keys[mesh]));
    } else if (result->error.status == BVHD_INVALID) {
        assert_false(fits);
    } else if (result->error.status != BVHD_CANCELLED && result->error.status != BVHD_NO_MEMORY) {
        assert_true(result->error.status == BVHD_SOURCE_LOST || result->error.status == BVHD_BUSY);
    }
}

/* Checks one item of a client that stayed to the end. */
static void check_item(const struct actor *actor, const struct asked *asked, uint32_t item)
{
    const struct world_event *event = world_result(actor->client, asked->request, item);
    int mesh = asked->meshes[item];
    assert_non_null(event);
    assert_int_equal(world_prepared(actor->client, asked->request, item), asked->is_build);
    enum bvhd_status status = event->result->error.status;
    if (asked->sources[item] != NO_UPDATE) {
        check_update(event->result, mesh, asked->sources[item]);
        return;
    }
    if (status == BVHD_OK) {
        assert_true(mesh >= 0);
        assert_memory_equal(&event->result->key, &keys[mesh], sizeof keys[mesh]);
        return;
    }
    if (status == BVHD_CANCELLED || status == BVHD_NO_MEMORY || status == BVHD_BUSY)
        return;
    assert_true(mesh < 0 || (!asked->is_build && status == BVHD_NOT_FOUND));
}

static void check_actor(const struct actor *actor)
{
    const struct world_client *client = actor->client;
    for (uint32_t i = 0; i < actor->asked_count; i++) {
        const struct asked *asked = &actor->asked[i];
        if (world_find(client, FRAME_BUSY, asked->request, 0) || world_find(client, FRAME_ERROR, asked->request, 0)) {
            assert_null(world_find(client, FRAME_RESULT, asked->request, 0));
            continue;
        }
        for (uint32_t k = 0; k < asked->count; k++)
            check_item(actor, asked, k);
    }
}

static void act(struct actor *actor)
{
    if (!is_open(actor)) {
        if (world.client_count < WORLD_CLIENTS)
            enter(actor);
        return;
    }
    switch (below(16)) {
    case 0:
        actor->client->hold = !actor->client->hold;
        break;
    case 1:
    case 2:
        random_cancel(actor);
        break;
    case 3:
    case 4:
    case 5:
        random_get(actor);
        break;
    case 6:
        random_pool_build(actor);
        break;
    case 7:
    case 8:
    case 9:
        world_iterate(&world);
        break;
    default:
        random_build(actor);
    }
}

static bool is_said(void *context)
{
    (void)context;
    for (int i = 0; i < LIVING; i++)
        if (is_open(&actors[i]) && actors[i].client->session->request_count > 0)
            return false;
    return true;
}

static void end_actors(void)
{
    for (int i = 0; i < LIVING; i++) {
        if (!is_open(&actors[i]))
            continue;
        actors[i].client->hold = false;
    }
    world_await(&world, is_said, NULL);
    for (int i = 0; i < LIVING; i++)
        if (is_open(&actors[i]))
            check_actor(&actors[i]);
}

static void run_operations(uint64_t seed, uint32_t count, uint32_t lifetime)
{
    random_source = (struct random){seed};
    memset(actors, 0, sizeof actors);
    for (uint32_t i = 0; i < count; i++) {
        struct actor *actor = &actors[below(LIVING)];
        if (is_open(actor) && below(lifetime) == 0)
            world_leave(actor->client);
        act(actor);
    }
    end_actors();
}

static void test_random_operations(void **state)
{
    (void)state;
    struct service_options options = world_options();
    options.workers = 3;
    options.max_queue = 150;
    options.cache = 256 * 1024; /* too small for all results */
    for (uint64_t seed = 1; seed <= 4; seed++) {
        world_init(&world, &options);
        run_operations(seed, 600, 60);
        world_finish(&world);
    }
}

/* There is so little memory that most items have to wait, and some fail. */
static void test_random_operations_in_little_memory(void **state)
{
    (void)state;
    struct service_options options = world_options();
    options.memory = 1; /* is raised to the least that a service has */
    options.cache = 0;
    for (uint64_t seed = 11; seed <= 13; seed++) {
        world_init(&world, &options);
        struct memory *memory = &world.service->memory;
        void *block = memory_alloc(memory, memory->limit - 600 * 1024);
        run_operations(seed, 400, 100);
        memory_free(memory, block);
        world_finish(&world);
    }
}

/* ---- failing allocations ---- */

static struct memory *budget(struct service *service)
{
    return &service->memory;
}

static struct memory *replies(struct service *service)
{
    return &service->unlimited;
}

static struct memory *inlines(struct service *service)
{
    return &service->inlines;
}

/*
 * Two clients work while allocation number `after` fails; then everything works again. Returns true if there was no
 * allocation of that number.
 */
static bool run_with_failure(struct memory *(*which)(struct service *), int64_t after)
{
    struct service_options options = world_options();
    options.workers = 1;
    world_init(&world, &options);
    struct memory *memory = which(world.service);
    memset(actors, 0, sizeof actors);
    random_source = (struct random){(uint64_t)after + 100};
    atomic_store(&memory->fail_after, after);
    for (int i = 0; i < 2; i++)
        enter(&actors[i]);
    for (int round = 0; round < 2; round++)
        for (int i = 0; i < 2; i++) {
            if (is_open(&actors[i]))
                random_build(&actors[i]);
            if (is_open(&actors[i]))
                random_get(&actors[i]);
            if (is_open(&actors[i]))
                random_pool_build(&actors[i]);
        }
    end_actors();
    bool untouched = atomic_load(&memory->fail_after) >= 0;
    atomic_store(&memory->fail_after, -1);
    struct world_client *client = world_join(&world);
    world_build_mesh(client, 1, &meshes[3]);
    world_check_bytes(world_await_result(client, 1, 0), &meshes[3].input);
    world_finish(&world);
    return untouched;
}

static void fail_each(struct memory *(*which)(struct service *), int64_t step)
{
    int64_t after = 0;
    while (!run_with_failure(which, after)) {
        after += step;
        assert_true(after < 100000);
    }
    assert_true(after > 4);
}

static void test_failing_budget(void **state)
{
    (void)state;
    fail_each(budget, 1);
}

static void test_failing_replies(void **state)
{
    (void)state;
    fail_each(replies, 1);
}

static void test_failing_inline_copies(void **state)
{
    (void)state;
    for (int64_t after = 0; after < 4; after++)
        run_with_failure(inlines, after);
}

static int make_all(void **state)
{
    (void)state;
    make_meshes();
    return 0;
}

static int finish_all(void **state)
{
    (void)state;
    finish_meshes();
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_random_operations),     cmocka_unit_test(test_random_operations_in_little_memory),
        cmocka_unit_test(test_failing_budget),        cmocka_unit_test(test_failing_replies),
        cmocka_unit_test(test_failing_inline_copies),
    };
    return cmocka_run_group_tests(tests, make_all, finish_all);
}
