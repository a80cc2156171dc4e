/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/daemon/session_world.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

#include "builder/update/batch.h"
#include "proto/base/container_of.h"
#include "tests/support/open_descriptors.h"
#include "tests/support/random.h"
#include "tests/support/unit.h"

struct service_options world_options(void)
{
    struct service_options options = service_options_default();
    options.workers = 2;
    options.memory = 256 << 20;
    options.cache = 64 << 20;
    options.credits = 64;
    options.max_pool = 4 << 20;
    return options;
}

static void wake(void *context)
{
    struct session_world *world = context;
    sem_post(&world->woken);
}

void world_init(struct session_world *world, const struct service_options *options)
{
    struct service_options usual = world_options();
    struct bvhd_error error;
    memset(world, 0, sizeof *world);
    sem_init(&world->woken, 0, 0);
    world->descriptors = open_descriptors();
    if (service_create(options ? options : &usual, wake, world, &world->service, &error) != BVHD_OK)
        fail_msg("no service: %s", error.text);
}

static void record(struct world_client *client, const struct reply *reply)
{
    struct world_event event = {.type = (enum frame_type)reply->header.type, .request = reply->header.request};
    struct memory *memory = &client->memory;
    enum bvhd_status status = BVHD_OK;
    if (event.type == FRAME_WELCOME)
        status = control_unpack_welcome(reply->control, memory, &event.welcome, NULL);
    if (event.type == FRAME_RESULT)
        status = control_unpack_result(reply->control, memory, &event.result, NULL);
    if (event.type == FRAME_PREPARED)
        status = control_unpack_items(reply->control, memory, &event.prepared, NULL);
    if (event.type == FRAME_PROGRESS)
        status = control_unpack_progress(reply->control, memory, &event.progress, NULL);
    if (event.type == FRAME_COUNTERS)
        status = control_unpack_counters(reply->control, memory, &event.counters, NULL);
    if (event.type == FRAME_CLIENT_LIST)
        status = control_unpack_client_list(reply->control, memory, &event.clients, NULL);
    if (event.type == FRAME_CACHE_STATE)
        status = control_unpack_cache_state(reply->control, memory, &event.cache, NULL);
    if (event.type == FRAME_BUSY)
        status = control_unpack_busy(reply->control, memory, &event.busy, NULL);
    if (event.type == FRAME_ERROR)
        status = control_unpack_error(reply->control, memory, &event.error, NULL);
    assert_int_equal(status, BVHD_OK);
    if (reply->blob) {
        assert_int_equal(reply->blob->size, event.result->size);
        event.bytes = memory_alloc(memory, reply->blob->size);
        if (reply->blob->descriptor >= 0)
            assert_int_equal(pread(reply->blob->descriptor, event.bytes, reply->blob->size, 0), reply->blob->size);
        else
            memcpy(event.bytes, reply->blob->bytes, reply->blob->size);
        assert_int_equal(reply->header.descriptors, reply->blob->descriptor >= 0);
        assert_int_equal(reply->header.inline_size, reply->blob->descriptor >= 0 ? 0 : reply->blob->size);
    }
    if (client->event_count == client->event_capacity) {
        client->event_capacity = 2 * client->event_capacity + 64;
        client->events = realloc(client->events, client->event_capacity * sizeof *client->events);
        assert_non_null(client->events);
    }
    client->events[client->event_count++] = event;
}

static void keep(void *context, struct reply *reply)
{
    struct world_client *client = context;
    assert_non_null(client->session);
    record(client, reply);
    reply->next = NULL;
    *client->end_held = reply;
    client->end_held = &reply->next;
}

static void note_failure(void *context, const struct bvhd_error *error)
{
    struct world_client *client = context;
    assert_true(error->status == BVHD_NO_MEMORY || error->status == BVHD_TOO_LARGE);
    client->failed = true;
}

static void let_replies_leave(struct world_client *client)
{
    while (client->first_held) {
        struct reply *reply = client->first_held;
        client->first_held = reply->next;
        if (!client->first_held)
            client->end_held = &client->first_held; /* now, because the calls below may make the session reply */
        if (client->session)
            session_sent(client->session, reply);
        if (client->session && reply->header.descriptors > 0)
            session_read(client->session, reply->blob->size);
        reply_destroy(reply);
    }
}

void world_iterate(struct session_world *world)
{
    service_collect(world->service);
    for (uint32_t i = 0; i < world->client_count; i++) {
        struct world_client *client = &world->clients[i];
        if (client->session && !client->hold)
            let_replies_leave(client);
    }
}

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + (double)now.tv_nsec * 1e-9;
}

void world_await(struct session_world *world, bool (*reached)(void *context), void *context)
{
    double begin = seconds();
    for (;;) {
        world_iterate(world);
        if (reached(context))
            return;
        if (seconds() - begin > 30)
            fail_msg("waited for 30 s");
        struct timespec until;
        clock_gettime(CLOCK_REALTIME, &until);
        until.tv_nsec += 2000000;
        until.tv_sec += until.tv_nsec / 1000000000;
        until.tv_nsec %= 1000000000;
        sem_timedwait(&world->woken, &until);
    }
}

static bool is_settled(void *context)
{
    struct session_world *world = context;
    return service_pending(world->service) == 0;
}

void world_settle(struct session_world *world)
{
    world_await(world, is_settled, world);
}

void world_await_descriptors(int count)
{
    for (double begin = seconds(); open_descriptors() != count && seconds() - begin < 5;)
        usleep(1000);
    assert_int_equal(open_descriptors(), count);
}

/* Whether no worker has anything of any client any more. */
static bool is_idle(void *context)
{
    struct session_world *world = context;
    struct service *service = world->service;
    struct pool_load load = pool_load(service->pool);
    bool requests = false;
    for (struct list_link *link = service->sessions.all.first; link; link = link->next)
        requests = requests || container_of(link, struct session, in_service)->request_count > 0;
    bool is_flying = service->flights.looking > 0 || service->flights.running > 0 || service->disposals.running > 0 ||
                     service->cache_tasks > 0;
    return load.queued == 0 && load.running == 0 && !is_flying && service->sessions.closing == 0 && !requests;
}

void world_finish(struct session_world *world)
{
    struct service *service = world->service;
    for (uint32_t i = 0; i < world->gate_count; i++)
        world_open(&world->gates[i]);
    for (uint32_t i = 0; i < world->client_count; i++)
        world_leave(&world->clients[i]);
    world_await(world, is_idle, world);
    assert_int_equal(service_uses(service, SHARE_ITEMS), 0);
    for (int class = 0; class < ADMISSION_CLASSES; class ++) {
        assert_int_equal(service->admission.prepares[class].count, 0);
        assert_int_equal(service->admission.prepares[class].bytes, 0);
        assert_int_equal(service->admission.builds[class].count, 0);
        assert_int_equal(service->admission.builds[class].bytes, 0);
    }
    assert_int_equal(atomic_load(&service->large.live), 0);
    assert_int_equal(service_uses(service, SHARE_POOL), 0);
    assert_int_equal(service_uses(service, SHARE_AHEAD), 0);
    assert_int_equal(atomic_load(&service->inlines.live), 0);
    service_destroy(service); /* asserts that no memory is left */
    for (uint32_t i = 0; i < world->client_count; i++) {
        struct world_client *client = &world->clients[i];
        for (uint32_t k = 0; k < client->event_count; k++) {
            struct world_event *event = &client->events[k];
            void *const blocks[] = {event->welcome, event->result, event->prepared, event->progress, event->counters,
                                    event->clients, event->cache,  event->busy,     event->error,    event->bytes};
            for (size_t j = 0; j < sizeof blocks / sizeof *blocks; j++)
                memory_free(&client->memory, blocks[j]);
        }
        free(client->events);
        assert_int_equal(atomic_load(&client->memory.live), 0);
    }
    for (uint32_t i = 0; i < world->gate_count; i++)
        sem_destroy(&world->gates[i].opened);
    sem_destroy(&world->woken);
    world_await_descriptors(world->descriptors);
}

void world_restart(struct session_world *world, uint64_t memory)
{
    struct service_options options = world_options();
    options.memory = memory;
    world_finish(world);
    world_init(world, &options);
}

static void gate_run(struct pool_job *job, const struct parallel *parallel)
{
    struct world_gate *gate = (void *)job;
    (void)parallel;
    atomic_store(&gate->running, true);
    while (sem_wait(&gate->opened) != 0)
        ;
}

static void gate_done(struct pool_job *job)
{
    struct world_gate *gate = (void *)job;
    gate->done = true;
}

struct world_gate *world_shut(struct session_world *world)
{
    return world_shut_for(world, world->service->disposals.flow);
}

struct world_gate *world_shut_for(struct session_world *world, struct pool_flow *flow)
{
    assert_true(world->gate_count < WORLD_GATES);
    struct world_gate *gate = &world->gates[world->gate_count++];
    gate->job = (struct pool_job){.run = gate_run, .done = gate_done, .flow = flow};
    sem_init(&gate->opened, 0, 0);
    pool_submit(world->service->pool, &gate->job);
    while (!atomic_load(&gate->running))
        usleep(50);
    return gate;
}

void world_open(struct world_gate *gate)
{
    sem_post(&gate->opened);
}

struct world_client *world_join_silent_as(struct session_world *world, uint32_t uid)
{
    struct bvhd_error error;
    assert_true(world->client_count < WORLD_CLIENTS);
    struct world_client *client = &world->clients[world->client_count++];
    *client = (struct world_client){.world = world};
    client->end_held = &client->first_held;
    memory_init(&client->memory, UINT64_MAX);
    const struct session_link link = {.send = keep, .fail = note_failure, .context = client};
    struct descriptor_share *share = descriptor_share_open(service_descriptors(world->service), uid);
    assert_non_null(share);
    const struct session_peer peer = {uid, 4711, world->client_count, share};
    if (session_open(world->service, &peer, &link, &client->session, &error) != BVHD_OK) {
        descriptor_share_close(share);
        world->client_count--;
        return NULL;
    }
    client->share = share;
    return client;
}

void world_leave(struct world_client *client)
{
    struct session *session = client->session;
    if (!session)
        return;
    client->session = NULL;
    let_replies_leave(client);
    session_close(session);
    descriptor_share_close(client->share);
}

struct world_client *world_join_silent(struct session_world *world)
{
    return world_join_silent_as(world, 1000);
}

struct world_client *world_join(struct session_world *world)
{
    return world_join_as(world, 1000);
}

struct world_client *world_join_as(struct session_world *world, uint32_t uid)
{
    struct world_client *client = world_join_silent_as(world, uid);
    assert_non_null(client);
    assert_int_equal(world_say(client, FRAME_HELLO, 0, NULL), BVHD_OK);
    assert_true(session_is_open(client->session));
    return client;
}

enum bvhd_status world_send(struct world_client *client, const struct frame *frame, struct bvhd_error *error)
{
    struct descriptors *descriptors = service_descriptors(client->world->service);
    assert_true(descriptors_take(descriptors, frame->header.descriptors, 0));
    descriptor_share_add(client->share, frame->header.descriptors);
    enum bvhd_status status = session_frame(client->session, frame, error);
    client->failed |= status == BVHD_NO_MEMORY;
    if (!client->hold)
        let_replies_leave(client);
    return status;
}

static enum bvhd_status send_packed(struct world_client *client, struct frame *frame, enum bvhd_status packed,
                                    struct bvhd_error *error)
{
    assert_int_equal(packed, BVHD_OK);
    frame->header.control_size = (uint32_t)frame->control.size;
    frame->header.inline_size = (uint32_t)frame->inline_bytes.size;
    enum bvhd_status status = world_send(client, frame, error);
    memory_free(&client->memory, (void *)(uintptr_t)frame->control.data);
    return status;
}

enum bvhd_status world_say(struct world_client *client, enum frame_type type, uint64_t request,
                           struct bvhd_error *error)
{
    struct frame frame = {.header = {.type = (uint16_t)type, .request = request}};
    struct control_hello hello = {CONTROL_VERSION, CONTROL_VERSION, "a test", 250, false};
    enum bvhd_status packed = BVHD_OK;
    if (type == FRAME_HELLO)
        packed = control_pack_hello(&hello, &client->memory, &frame.control, NULL);
    return send_packed(client, &frame, packed, error);
}

void world_pool(struct world_client *client, uint64_t request, int descriptor, uint64_t size)
{
    struct frame frame = {.header = {.type = FRAME_POOL, .request = request, .descriptors = 1},
                          .descriptors = {descriptor}};
    struct control_pool pool = {size};
    enum bvhd_status packed = control_pack_pool(&pool, &client->memory, &frame.control, NULL);
    if (send_packed(client, &frame, packed, NULL) != BVHD_OK)
        assert_true(client->failed);
}

void world_build(struct world_client *client, uint64_t request, const struct control_build *build,
                 struct bytes inline_bytes, const int *descriptors)
{
    struct frame frame = {
        .header = {.type = FRAME_BUILD, .request = request, .descriptors = (uint8_t)build->memfd_count},
        .inline_bytes = inline_bytes};
    for (uint32_t i = 0; i < build->memfd_count; i++)
        frame.descriptors[i] = descriptors[i];
    enum bvhd_status packed = control_pack_build(build, &client->memory, &frame.control, NULL);
    if (send_packed(client, &frame, packed, NULL) != BVHD_OK)
        assert_true(client->failed);
}

void world_get(struct world_client *client, uint64_t request, const struct key *keys, uint32_t count)
{
    struct frame frame = {.header = {.type = FRAME_GET, .request = request}};
    struct key copies[64];
    assert_true(count <= 64);
    if (count > 0)
        memcpy(copies, keys, count * sizeof *keys);
    struct control_get get = {count, copies};
    enum bvhd_status packed = control_pack_get(&get, &client->memory, &frame.control, NULL);
    if (send_packed(client, &frame, packed, NULL) != BVHD_OK)
        assert_true(client->failed);
}

enum bvhd_status world_cancel(struct world_client *client, uint64_t request, const uint32_t *items, uint32_t count)
{
    struct frame frame = {.header = {.type = FRAME_CANCEL, .request = request}};
    uint32_t copies[64];
    assert_true(count <= 64);
    if (count > 0)
        memcpy(copies, items, count * sizeof *items);
    struct control_items message = {count, copies};
    enum bvhd_status packed = control_pack_items(&message, &client->memory, &frame.control, NULL);
    return send_packed(client, &frame, packed, NULL);
}

const struct world_event *world_find(const struct world_client *client, enum frame_type type, uint64_t request,
                                     uint32_t skip)
{
    for (uint32_t i = 0; i < client->event_count; i++)
        if (client->events[i].type == type && client->events[i].request == request && skip-- == 0)
            return &client->events[i];
    return NULL;
}

const struct world_event *world_result(const struct world_client *client, uint64_t request, uint32_t item)
{
    const struct world_event *found = NULL;
    for (uint32_t i = 0; i < client->event_count; i++) {
        const struct world_event *event = &client->events[i];
        if (event->type != FRAME_RESULT || event->request != request || event->result->item != item)
            continue;
        if (found)
            fail_msg("request %llu item %u has two results", (unsigned long long)request, item);
        found = event;
    }
    return found;
}

enum bvhd_status world_status(const struct world_client *client, uint64_t request, uint32_t item)
{
    const struct world_event *event = world_result(client, request, item);
    if (!event)
        fail_msg("request %llu item %u has no result", (unsigned long long)request, item);
    return event->result->error.status;
}

uint32_t world_prepared(const struct world_client *client, uint64_t request, uint32_t item)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < client->event_count; i++) {
        const struct world_event *event = &client->events[i];
        if (event->type != FRAME_PREPARED || event->request != request)
            continue;
        for (uint32_t k = 0; k < event->prepared->count; k++)
            count += event->prepared->items[k] == item;
    }
    return count;
}

struct counters world_counters(const struct session_world *world)
{
    return service_counters(world->service);
}

struct awaited {
    const struct world_client *client;
    uint64_t request;
    uint32_t item;
    enum item_state state;
};

static bool has_result(void *context)
{
    const struct awaited *awaited = context;
    return world_result(awaited->client, awaited->request, awaited->item) != NULL;
}

const struct world_event *world_await_result(struct world_client *client, uint64_t request, uint32_t item)
{
    struct awaited awaited = {client, request, item, ITEM_ANSWERED};
    world_await(client->world, has_result, &awaited);
    return world_result(client, request, item);
}

static bool has_state(void *context)
{
    const struct awaited *awaited = context;
    const struct request *request = session_find(awaited->client->session, awaited->request);
    assert_non_null(request);
    return request->items[awaited->item].state == awaited->state;
}

void world_await_state(struct world_client *client, uint64_t request, uint32_t item, enum item_state state)
{
    struct awaited awaited = {client, request, item, state};
    world_await(client->world, has_state, &awaited);
}

int world_memfd(const void *bytes, uint64_t size, unsigned seals)
{
    int descriptor = memfd_create("world", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    assert_true(descriptor >= 0);
    assert_int_equal(write(descriptor, bytes, size), size);
    assert_int_equal(fcntl(descriptor, F_ADD_SEALS, seals), 0);
    return descriptor;
}

void world_mesh_init(struct world_mesh *mesh, uint32_t triangles, uint64_t seed)
{
    struct random random = {seed};
    uint64_t count = (uint64_t)9 * triangles;
    mesh->vertices = malloc(count * sizeof *mesh->vertices + 1);
    assert_non_null(mesh->vertices);
    for (uint64_t i = 0; i < count; i += 9) {
        double corner[3], side[3];
        random_point(&random, corner);
        for (uint64_t k = 0; k < 9; k += 3) {
            random_point(&random, side);
            for (uint64_t axis = 0; axis < 3; axis++)
                mesh->vertices[i + k + axis] = (float)(corner[axis] + 0.01 * side[axis]);
        }
    }
    mesh->geometry = (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .flags = GEOMETRY_OPAQUE,
        .triangles = {.vertex_format = 106,
                      .max_vertex = triangles ? 3 * triangles - 1 : 0,
                      .vertex_stride = 12,
                      .index_type = INDEX_NONE,
                      .vertices = {(const unsigned char *)mesh->vertices, count * sizeof *mesh->vertices}},
        .range = {.primitive_count = triangles},
    };
    mesh->input = (struct build_input){.type = STRUCTURE_BOTTOM,
                                       .geometry_count = 1,
                                       .geometries = &mesh->geometry,
                                       .options = {.target = TARGET_PORTABLE}};
    mesh->payload = world_payload(&mesh->input, &mesh->size);
}

void world_mesh_finish(struct world_mesh *mesh)
{
    free(mesh->payload);
    free(mesh->vertices);
}

unsigned char *world_payload(const struct build_input *input, uint64_t *ret_size)
{
    assert_true(rows_payload_size(input, ret_size));
    unsigned char *payload = aligned_alloc(64, bytes_align(*ret_size + 1, 64));
    assert_non_null(payload);
    rows_write(input, payload);
    return payload;
}

struct control_item world_item(const struct build_input *input, uint64_t size, enum control_source source,
                               uint64_t offset)
{
    return (struct control_item){
        .type = input->type,
        .flags = input->flags,
        .mode = input->mode,
        .destination = input->destination,
        .source = input->source,
        .quality = input->options.quality,
        .target = input->options.target,
        .layout_flags = input->options.layout_flags,
        .geometry_count = input->geometry_count,
        .geometry_size = rows_geometry_size(input),
        .reference_count = input->reference_count,
        .reference_size = ROWS_REFERENCE_SIZE,
        .payload_source = source,
        .payload_offset = offset,
        .payload_size = size,
        .device = input->options.device,
        .rays_per_primitive = input->options.rays_per_primitive,
    };
}

void world_build_mesh(struct world_client *client, uint64_t request, const struct world_mesh *mesh)
{
    struct control_item item = world_item(&mesh->input, mesh->size, SOURCE_INLINE, 0);
    struct control_build build = {.item_count = 1, .items = &item};
    world_build(client, request, &build, (struct bytes){mesh->payload, mesh->size}, NULL);
}

void world_check_bytes(const struct world_event *event, const struct build_input *input)
{
    struct memory memory;
    struct batch_item item;
    struct bvhd_error error;
    struct limits limits = limits_default();
    memory_init(&memory, UINT64_MAX);
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    assert_int_equal(batch_build(input, 1, &limits, &context, &item, &error), BVHD_OK);
    assert_int_equal(item.status, BVHD_OK);
    assert_int_equal(event->result->error.status, BVHD_OK);
    assert_int_equal(event->result->size, item.size);
    assert_memory_equal(event->bytes, item.blob, item.size);
    assert_memory_equal(&event->result->key, &item.key, sizeof item.key);
    assert_int_equal(event->result->summary.refs, item.summary.refs);
    assert_true(event->result->summary.sah == item.summary.sah);
    assert_int_equal(event->result->summary.target, input->options.target);
    batch_finish(&item, 1, &memory);
}
