/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_request.c - fuzzes the way of a request through the daemon, from a client's frame to the result: two clients of
 * one service send frames, workers build and update, and in the end nothing is left over.
 *
 * The input is a list of steps. A step is eight bytes - the frame's type, flags (enum flag), the request's number,
 * descriptors (bits 0-2: how many; bits 3 and 4: their seals), and two bytes each for the sizes of the control message
 * and of the payload - followed by the control message and the payload. The payload lies in the frame, or, if there are
 * descriptors, in each of them.
 */
#include "tests/support/unit.h"

#include "tests/fuzz/fuzz.h"

#include "daemon/system/log.h"
#include "proto/base/validate_shape.h"
#include "tests/support/builder/inputs_micromap.h"
#include "tests/support/daemon/session_world.h"
#include "tests/support/proto/messages.h"

enum { STEP = 8, CLIENTS = 2, SEALS_POOL = 8, SEALS_NONE = 16 };

enum flag {
    FLAG_CLIENT = 1, /* the second client sends */
    FLAG_SETTLE = 2, /* before that, everything under way ends */
    FLAG_HOLD = 4, /* the client does not read its replies */
    FLAG_KEY = 8, /* sources of updates, micromaps of triangles, and the keys of GET, are that of the latest result */
    FLAG_INLINE = 16, /* the payload lies in the frame, too, if there are descriptors */
    FLAG_LATE = 32, /* before that, all deadlines pass, and progress is reported */
    FLAG_LEAVE = 64, /* before that, the client leaves, and another one comes */
};

struct step {
    uint8_t type, flags, request, descriptors;
    struct bytes control, payload;
};

static struct session_world world;
static struct world_client *clients[CLIENTS];
static struct memory memory = {.limit = 64 << 20, .fail_after = -1};

/* ---- the service ---- */

static struct service_options small_options(void)
{
    struct service_options options = world_options();
    options.cache = 64 * 1024;
    options.credits = 8;
    options.max_pool = 1 << 20;
    options.limits = (struct limits){
        .max_geometries = 100, .max_instances = 1000, .max_primitives = 1000, .max_canonical_bytes = 1 << 20};
    return options;
}

static bool has_ended(void *context)
{
    (void)context;
    const struct counters now = world_counters(&world);
    return now.sessions == 0 && now.queue_depth == 0 && now.prepares_waiting == 0 && now.builds_waiting == 0 &&
           now.builds_running == 0 && now.jobs_queued == 0 && now.jobs_running == 0 && now.results_held_bytes == 0 &&
           now.memory_promised == 0 && now.pool_bytes == 0 && now.live_results == now.cache_entries;
}

/*
 * Awaits that the counters of what is under way return to zero. Every attempt at a build or an update must have ended.
 */
static void finish_world(void)
{
    for (int i = 0; i < CLIENTS; i++)
        if (clients[i])
            world_leave(clients[i]);
    world_await(&world, has_ended, NULL);
    const struct counters end = world_counters(&world);
    FUZZ_CHECK(end.builds_started == end.builds_done + end.builds_failed + end.builds_cancelled + end.builds_retried);
    FUZZ_CHECK(end.refits_started == end.refits_done + end.refits_failed + end.refits_cancelled + end.refits_retried);
    world_finish(&world);
    FUZZ_CHECK(memory.live == 0);
}

/* Whether every item has its result, and no worker has any of them any more. */
static bool is_settled(void *context)
{
    (void)context;
    bool settled = service_pending(world.service) == 0;
    for (int i = 0; i < CLIENTS; i++)
        settled = settled && (!clients[i] || !clients[i]->session || clients[i]->session->request_count == 0);
    return settled;
}

static void settle(void)
{
    for (int i = 0; i < CLIENTS; i++)
        if (clients[i])
            clients[i]->hold = false;
    world_await(&world, is_settled, NULL);
}

/* ---- one step ---- */

/* Returns whether any client has got a result; *ret_key is the latest one of the last client that has. */
static bool find_key(struct key *ret_key)
{
    bool found = false;
    for (uint32_t i = 0; i < world.client_count; i++)
        for (uint32_t k = 0; k < world.clients[i].event_count; k++) {
            const struct control_result *result = world.clients[i].events[k].result;
            if (result && result->error.status == BVHD_OK) {
                *ret_key = result->key;
                found = true;
            }
        }
    return found;
}

/* Makes the control message again, with that key. Returns no bytes if the message has none. */
static struct bytes with_key(uint8_t type, struct bytes control, const struct key *key)
{
    struct bytes packed = {NULL, 0};
    struct control_build *build;
    struct control_get *get;
    if (type == FRAME_BUILD && control_unpack_build(control, &memory, &build, NULL) == BVHD_OK) {
        for (uint32_t i = 0; i < build->item_count; i++)
            if (build->items[i].mode == MODE_UPDATE)
                build->items[i].source_key = *key;
        FUZZ_CHECK(control_pack_build(build, &memory, &packed, NULL) == BVHD_OK);
        memory_free(&memory, build);
    } else if (type == FRAME_GET && control_unpack_get(control, &memory, &get, NULL) == BVHD_OK) {
        for (uint32_t i = 0; i < get->key_count; i++)
            get->keys[i] = *key;
        FUZZ_CHECK(control_pack_get(get, &memory, &packed, NULL) == BVHD_OK);
        memory_free(&memory, get);
    }
    return packed;
}

/* Gives the references of an item that are micromaps that key, where its payload has them. */
static void name_micromaps(const struct control_item *item, unsigned char *payload, uint64_t size,
                           const struct key *key)
{
    const uint64_t first = item->payload_offset + (uint64_t)item->geometry_count * item->geometry_size;
    for (uint32_t i = 0; i < item->reference_count; i++) {
        const uint64_t at = first + (uint64_t)i * item->reference_size;
        if (at < first || at > size || size - at < ROWS_REFERENCE_LEAST)
            return;
        if (bytes_get32(payload + at + offsetof(struct reference_row, kind)) == REFERENCE_MICROMAP)
            memcpy(payload + at + offsetof(struct reference_row, key), key->bytes, KEY_SIZE);
    }
}

/* The payload is a copy of the step's own. */
static void name_all_micromaps(const struct step *step, const struct key *key)
{
    struct control_build *build;
    if (step->type != FRAME_BUILD || control_unpack_build(step->control, &memory, &build, NULL) != BVHD_OK)
        return;
    for (uint32_t i = 0; i < build->item_count; i++)
        name_micromaps(&build->items[i], (unsigned char *)(uintptr_t)step->payload.data, step->payload.size, key);
    memory_free(&memory, build);
}

/* Returns the client that sends, or NULL when there is no room for another one. The second one is root. */
static struct world_client *client_of(uint8_t flags)
{
    struct world_client **client = &clients[flags & FLAG_CLIENT];
    if (*client && (*client)->session && ((*client)->failed || flags & FLAG_LEAVE))
        world_leave(*client);
    if ((!*client || !(*client)->session) && world.client_count < WORLD_CLIENTS)
        *client = world_join_silent_as(&world, flags & FLAG_CLIENT ? 0 : 1000);
    return *client && (*client)->session ? *client : NULL;
}

static void pass_time(const struct world_client *client)
{
    session_check_deadlines(client->session, UINT64_MAX);
    session_report_progress(client->session, UINT64_MAX / 2);
}

static void open_descriptors_of(const struct step *step, struct frame *frame)
{
    const unsigned seals = step->descriptors & SEALS_NONE   ? 0
                           : step->descriptors & SEALS_POOL ? WORLD_SEALS_POOL
                                                            : WORLD_SEALS_ONCE;
    frame->header.descriptors = step->descriptors % 8 % (FRAME_MAX_DESCRIPTORS + 1);
    for (uint32_t i = 0; i < frame->header.descriptors; i++)
        frame->descriptors[i] = world_memfd(step->payload.data, step->payload.size, seals);
}

/* A session that refuses a frame ends, as its connection would. */
static void send(struct world_client *client, const struct step *step, struct bytes control)
{
    struct frame frame = {.header = {.type = step->type, .request = step->request}, .control = control};
    struct bvhd_error error;
    open_descriptors_of(step, &frame);
    if (frame.header.descriptors == 0 || step->flags & FLAG_INLINE)
        frame.inline_bytes = step->payload;
    frame.header.control_size = (uint32_t)frame.control.size;
    frame.header.inline_size = (uint32_t)frame.inline_bytes.size;
    client->hold = step->flags & FLAG_HOLD;
    const enum bvhd_status status = world_send(client, &frame, &error);
    if (status != BVHD_OK) {
        FUZZ_CHECK(error.status == status && error.text[0]);
        world_leave(client);
    }
}

static void take_step(const struct step *step)
{
    struct bytes packed = {NULL, 0};
    struct key key;
    if (step->flags & FLAG_SETTLE)
        settle();
    struct world_client *client = client_of(step->flags);
    if (!client)
        return;
    if (step->flags & FLAG_LATE)
        pass_time(client);
    if (step->flags & FLAG_KEY && find_key(&key)) {
        packed = with_key(step->type, step->control, &key);
        name_all_micromaps(step, &key);
    }
    send(client, step, packed.data ? packed : step->control);
    messages_free(packed, &memory);
    world_iterate(&world);
}

/* ---- the input ---- */

/* Copies bytes to a block of exactly their size, as aligned as a frame's. */
static struct bytes copy_of(const uint8_t *data, size_t size)
{
    void *copy;
    FUZZ_CHECK(posix_memalign(&copy, 64, size ? size : 1) == 0);
    if (size > 0)
        memcpy(copy, data, size);
    return (struct bytes){copy, size};
}

static size_t read_step(const uint8_t *data, size_t size, struct step *ret_step)
{
    const size_t rest = size - STEP, control = bytes_get16(data + 4) < rest ? bytes_get16(data + 4) : rest,
                 most = rest - control, payload = bytes_get16(data + 6) < most ? bytes_get16(data + 6) : most;
    *ret_step = (struct step){
        data[0], data[1], data[2], data[3], copy_of(data + STEP, control), copy_of(data + STEP + control, payload)};
    return STEP + control + payload;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const struct service_options options = small_options();
    validate_micromaps = true;
    memset(clients, 0, sizeof clients);
    log_set_level(LOG_ERROR);
    world_init(&world, &options);
    while (size >= STEP) {
        struct step step;
        const size_t used = read_step(data, size, &step);
        take_step(&step);
        free((void *)(uintptr_t)step.control.data);
        free((void *)(uintptr_t)step.payload.data);
        data += used;
        size -= used;
    }
    settle();
    finish_world();
    return 0;
}

/* ---- samples ---- */

struct program {
    uint8_t *bytes;
    size_t size;
};

/* Adds a step, and frees the control message. */
static void add(struct program *program, struct step step)
{
    uint8_t *at = program->bytes + program->size;
    const uint16_t sizes[2] = {(uint16_t)step.control.size, (uint16_t)step.payload.size};
    FUZZ_CHECK(program->size + STEP + step.control.size + step.payload.size <= FUZZ_ROOM);
    memcpy(at, (const uint8_t[]){step.type, step.flags, step.request, step.descriptors}, 4);
    memcpy(at + 4, sizes, sizeof sizes);
    if (step.control.size > 0)
        memcpy(at + STEP, step.control.data, step.control.size);
    if (step.payload.size > 0)
        memcpy(at + STEP + step.control.size, step.payload.data, step.payload.size);
    program->size += STEP + step.control.size + step.payload.size;
    messages_free(step.control, &memory);
}

static void add_plain(struct program *program, enum frame_type type, uint8_t flags, uint8_t request)
{
    add(program, (struct step){.type = (uint8_t)type, .flags = flags, .request = request});
}

static void add_hello(struct program *program, uint8_t flags)
{
    const struct control_hello hello = {CONTROL_VERSION, CONTROL_VERSION, "a fuzzer", 250, true};
    struct step step = {.type = FRAME_HELLO, .flags = flags};
    FUZZ_CHECK(control_pack_hello(&hello, &memory, &step.control, NULL) == BVHD_OK);
    add(program, step);
}

/* How samples build: where the payload lies, and what for. */
struct way {
    enum control_source source;
    uint8_t flags, request;
    bool is_update;
    enum target target;
};

static void add_build(struct program *program, const struct way *way, struct build_input *const *inputs, uint32_t count)
{
    static unsigned char payload[FUZZ_ROOM];
    struct control_item items[16];
    struct control_build build = {.item_count = count, .items = items, .deadline_ms = 60000};
    struct step step = {.type = FRAME_BUILD, .flags = way->flags, .request = way->request};
    uint64_t end = 0, size;
    for (uint32_t i = 0; i < count; i++) {
        struct build_input input = *inputs[i];
        input.flags = input.type == STRUCTURE_MICROMAP ? 0 : BUILD_ALLOW_UPDATE;
        input.mode = way->is_update ? MODE_UPDATE : MODE_BUILD;
        input.source = way->is_update;
        input.options.target = way->target;
        input.options.device.variant = way->target == TARGET_LAVAPIPE;
        FUZZ_CHECK(rows_payload_size(&input, &size) && end + size <= sizeof payload);
        rows_write(&input, payload + end);
        items[i] = world_item(&input, size, way->source, end);
        end = bytes_align(end + size, 64);
    }
    step.payload = (struct bytes){payload, way->source == SOURCE_POOL ? 0 : end};
    if (way->source == SOURCE_MEMFD) {
        build.memfd_count = step.descriptors = 1;
        build.memfd_sizes[0] = end;
    }
    FUZZ_CHECK(control_pack_build(&build, &memory, &step.control, NULL) == BVHD_OK);
    add(program, step);
}

static void add_pool(struct program *program, const struct build_input *input)
{
    static unsigned char payload[FUZZ_ROOM];
    struct step step = {.type = FRAME_POOL, .request = 9, .descriptors = 1 | SEALS_POOL};
    struct control_pool pool;
    FUZZ_CHECK(rows_payload_size(input, &pool.size) && pool.size <= sizeof payload);
    rows_write(input, payload);
    step.payload = (struct bytes){payload, pool.size};
    FUZZ_CHECK(control_pack_pool(&pool, &memory, &step.control, NULL) == BVHD_OK);
    add(program, step);
}

static void add_get(struct program *program, uint8_t flags, uint8_t request)
{
    struct key keys[2] = {{{1}}, {{2}}};
    const struct control_get get = {2, keys};
    struct step step = {.type = FRAME_GET, .flags = flags, .request = request};
    FUZZ_CHECK(control_pack_get(&get, &memory, &step.control, NULL) == BVHD_OK);
    add(program, step);
}

static void add_cancel(struct program *program, uint8_t flags, uint8_t request)
{
    uint32_t item = 0;
    const struct control_items items = {1, &item};
    struct step step = {.type = FRAME_CANCEL, .flags = flags, .request = request};
    FUZZ_CHECK(control_pack_items(&items, &memory, &step.control, NULL) == BVHD_OK);
    add(program, step);
}

/* Adds the frames that ask about the daemon, or change its caches. */
static void add_questions(struct program *program, uint8_t flags)
{
    const struct control_clients all = {true};
    const struct control_cache cache = {CACHE_TRIM, 1000};
    const struct control_released released = {0};
    struct step steps[] = {{.type = FRAME_CLIENTS}, {.type = FRAME_CACHE}, {.type = FRAME_RELEASED}};
    FUZZ_CHECK(control_pack_clients(&all, &memory, &steps[0].control, NULL) == BVHD_OK);
    FUZZ_CHECK(control_pack_cache(&cache, &memory, &steps[1].control, NULL) == BVHD_OK);
    FUZZ_CHECK(control_pack_released(&released, &memory, &steps[2].control, NULL) == BVHD_OK);
    for (size_t i = 0; i < sizeof steps / sizeof steps[0]; i++) {
        steps[i].flags = flags;
        steps[i].request = (uint8_t)(70 + i);
        add(program, steps[i]);
    }
    add_plain(program, FRAME_STATS, flags, 77);
    add_plain(program, FRAME_PING, flags, 78);
}

/* Builds a micromap, and then triangles that name it by its key. */
static void add_micromap(struct program *program, enum control_source source, enum target target)
{
    static struct test_input micromap, triangles;
    struct build_input *inputs[] = {&micromap.input, &triangles.input};
    inputs_micromap(&micromap);
    inputs_triangles_with_micromap(&triangles);
    struct way way = {.source = source, .request = 11, .target = target};
    add_build(program, &way, &inputs[0], 1);
    way = (struct way){.source = source, .flags = FLAG_SETTLE | FLAG_KEY, .request = 12, .target = target};
    add_build(program, &way, &inputs[1], 1);
}

/*
 * Each sample builds one kind of structure in one way, updates it, asks for it by its key, and has a second client that
 * asks for the same, cancels, and leaves its replies unread.
 */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    static const enum control_source sources[] = {SOURCE_INLINE, SOURCE_MEMFD, SOURCE_POOL};
    enum { KINDS = 9, WAYS = 3 * KINDS };
    static struct test_input triangles, boxes, instances, spheres, swept_spheres, moving_triangles, moving_instances;
    static struct test_input micromap, baked;
    struct build_input *inputs[KINDS] = {&triangles.input,        &boxes.input,         &instances.input,
                                         &spheres.input,          &swept_spheres.input, &moving_triangles.input,
                                         &moving_instances.input, &micromap.input,      &baked.input};
    struct program program = {ret_bytes, 0};
    if (index >= 2 * WAYS)
        return 0;
    inputs_triangles(&triangles);
    inputs_aabbs(&boxes);
    inputs_instances(&instances);
    inputs_spheres(&spheres);
    inputs_swept_spheres(&swept_spheres);
    inputs_mixed_triangles(&moving_triangles);
    inputs_motion_instances(&moving_instances);
    inputs_micromap(&micromap);
    inputs_baked_micromap(&baked);
    struct build_input **own = &inputs[index % KINDS];
    struct way way = {
        .source = sources[index / KINDS % 3], .request = 1, .target = index < WAYS ? TARGET_PORTABLE : TARGET_LAVAPIPE};
    add_hello(&program, 0);
    if (way.source == SOURCE_POOL)
        add_pool(&program, *own);
    add_build(&program, &way, own, 1);
    way = (struct way){way.source == SOURCE_POOL ? SOURCE_INLINE : way.source, FLAG_SETTLE | FLAG_KEY, 2, true,
                       way.target};
    add_build(&program, &way, own, 1);
    add_get(&program, FLAG_SETTLE | FLAG_KEY, 3);
    add_hello(&program, FLAG_CLIENT);
    way = (struct way){SOURCE_MEMFD, FLAG_CLIENT | FLAG_HOLD, 4, false, way.target};
    add_build(&program, &way, inputs, index % 2 ? KINDS : 2);
    add_micromap(&program, way.source, way.target);
    add_cancel(&program, FLAG_CLIENT | (index % 2 ? FLAG_HOLD : FLAG_LATE), 4);
    add_questions(&program, FLAG_CLIENT);
    return program.size;
}
