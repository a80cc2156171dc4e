/* SPDX-License-Identifier: Apache-2.0 */
/*
 * endurance_descriptors.c - tests that many requests of all kinds, right and wrong ones, leave no descriptor behind: in
 * the daemon, and in the process of clients.
 *
 *     endurance_descriptors BVHD [REQUESTS [SEED]]
 */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <bvhd/bvhd.h>

#include "tests/support/daemon/hostile.h"
#include "tests/support/daemon/process_view.h"
#include "tests/support/daemon/wrong_frames.h"
#include "tests/support/random.h"
#include "tests/support/scene/terrain.h"
#include "tests/support/scratch.h"

enum { CLIENTS = 4, WRONG = 4, HELD = 24, MOST_INFOS = 4, PATIENCE_MS = 60000 };

/* Payloads inside of frames, in the pool, and in memfds where the pool is small. */
enum { SIZES = 3 };
static const uint32_t triangles[SIZES] = {50, 800, 4000};

static struct hostile hostile;
static struct random randomness;
static struct terrain meshes[SIZES];
static struct bvhd_client *clients[CLIENTS];
static struct bvhd_blob *held[HELD];
static struct bvhd_key keys[HELD]; /* of results */
static struct wrong_frames wrong;
static struct raw_client wrong_clients[WRONG];
static uint64_t requests, good_results, late_results, refused_results, broken_connections;

static uint32_t below(uint32_t bound)
{
    return (uint32_t)(random_next(&randomness) % bound);
}

/* Half of the clients have so little shared memory that most payloads need a memfd. */
static void make_client(uint32_t index)
{
    struct bvhd_client_options options = {.struct_size = sizeof options,
                                          .socket_path = hostile.service.socket,
                                          .pool_size = index % 2 ? 16 << 10 : 0,
                                          .local = BVHD_LOCAL_NEVER};
    if (bvhd_client_create(&options, &clients[index], NULL) != BVHD_OK)
        exit(1);
}

/* Requests a few meshes, some of which were built before. `break_it` breaks a rule of Vulkan. */
static struct bvhd_batch *submit(uint32_t client, bool break_it, uint32_t deadline_ms)
{
    VkAccelerationStructureBuildGeometryInfoKHR infos[MOST_INFOS];
    const VkAccelerationStructureBuildRangeInfoKHR *ranges[MOST_INFOS];
    uint32_t count = 1 + below(MOST_INFOS);
    for (uint32_t i = 0; i < count; i++) {
        struct terrain *mesh = &meshes[below(16) < 13 ? below(2) : 2];
        infos[i] = mesh->info;
        ranges[i] = mesh->ranges;
        mesh->positions[2] = below(3) ? (float)below(1 << 20) : 0;
    }
    if (break_it)
        infos[below(count)].geometryCount = 0x7fffffff;
    struct bvhd_build build = {.struct_size = sizeof build,
                               .info_count = count,
                               .infos = infos,
                               .ranges = ranges,
                               .quality = BVHD_QUALITY_FAST,
                               .deadline_ms = deadline_ms};
    struct bvhd_batch *batch = NULL;
    requests++;
    hostile_expect(bvhd_batch_submit(clients[client], &build, &batch, NULL) == BVHD_OK, "submit");
    bvhd_batch_wait_copied(batch, -1); /* the meshes will change */
    return batch;
}

/* Waits for the results, and keeps some of them for a while. */
static void take(struct bvhd_batch *batch, bool may_fail)
{
    hostile_expect(bvhd_batch_wait(batch, PATIENCE_MS) == BVHD_OK, "a batch is not done after a minute");
    for (uint32_t i = 0; i < bvhd_batch_count(batch); i++) {
        const struct bvhd_result *result = bvhd_batch_result(batch, i);
        if (result->error.status == BVHD_OK) {
            uint32_t slot = below(HELD);
            bvhd_blob_unref(held[slot]);
            held[slot] = bvhd_blob_ref(result->blob);
            keys[slot] = result->key;
            good_results++;
        } else if (result->error.status == BVHD_CANCELLED) {
            late_results++;
        } else {
            refused_results++;
        }
        hostile_expect(may_fail || result->error.status == BVHD_OK, "%s: %s", result->error.where, result->error.text);
    }
    bvhd_batch_destroy(batch);
}

static void build(uint32_t client)
{
    take(submit(client, false, 0), false);
}

static void break_a_rule(uint32_t client)
{
    take(submit(client, true, 0), true);
}

static void be_late(uint32_t client)
{
    take(submit(client, false, 1), true);
}

static void fetch(uint32_t client)
{
    struct bvhd_key asked[2] = {keys[below(HELD)], {{1, 2, 3}}};
    struct bvhd_batch *batch = NULL;
    requests++;
    hostile_expect(bvhd_batch_fetch(clients[client], 2, asked, &batch, NULL) == BVHD_OK, "fetch");
    take(batch, true);
}

static void cancel(uint32_t client)
{
    struct bvhd_batch *batch = submit(client, false, 0);
    if (below(2))
        bvhd_batch_cancel(batch);
    else
        bvhd_batch_cancel_item(batch, 0);
    take(batch, true);
}

/* Ends a client, or only its batch, while the daemon works for it. */
static void leave(uint32_t client)
{
    struct bvhd_batch *batch = submit(client, false, 0);
    bvhd_batch_destroy(batch);
    if (below(4))
        return;
    bvhd_client_destroy(clients[client]);
    make_client(client);
}

static void question(uint32_t client)
{
    struct bvhd_counters *counters = NULL;
    struct bvhd_connections *connections = NULL;
    struct bvhd_cache_state *state = NULL;
    requests += 4;
    bool answered = bvhd_client_ping(clients[client], PATIENCE_MS, NULL, NULL) == BVHD_OK &&
                    bvhd_client_counters(clients[client], PATIENCE_MS, &counters, NULL) == BVHD_OK &&
                    bvhd_client_connections(clients[client], 0, PATIENCE_MS, &connections, NULL) == BVHD_OK &&
                    bvhd_client_cache(clients[client], BVHD_CACHE_SHOW, 0, PATIENCE_MS, &state, NULL) == BVHD_OK;
    hostile_expect(answered, "a question is not answered");
    bvhd_counters_destroy(counters);
    bvhd_connections_destroy(connections);
    bvhd_cache_state_destroy(state);
}

/* Sends a frame with something wrong, on a connection that ends sooner or later. */
static void be_wrong(uint32_t index)
{
    struct raw_client *client = &wrong_clients[index % WRONG];
    requests++;
    if (client->socket < 0 && !wrong_connect(&wrong, client, hostile.service.socket))
        client->socket = -1;
    else if (!wrong_send(&wrong, client)) {
        raw_close(client);
        client->socket = -1;
    }
}

/* Leaves in the middle of a good frame with descriptors, some of which have arrived. */
static void break_off(uint32_t index)
{
    struct raw_client client;
    int descriptors[2] = {wrong.sealed_file, wrong.sealed_file};
    uint64_t sizes[2] = {wrong.payload_size, wrong.payload_size};
    (void)index;
    requests++;
    if (!raw_connect(&client, hostile.service.socket) || !raw_try_hello(&client))
        return;
    struct control_item item = raw_item(0, wrong.payload_size, SOURCE_MEMFD);
    struct control_build message = {
        .memfd_count = 2, .memfd_sizes = {sizes[0], sizes[1]}, .item_count = 1, .items = &item};
    struct raw_frame frame = {.header = {.type = FRAME_BUILD, .request = 1, .descriptors = 2}};
    size_t size;
    control_pack_build(&message, &client.memory, &frame.control, NULL);
    unsigned char *bytes = raw_frame_bytes(&frame, &size);
    raw_send(&client, bytes, 1 + below((uint32_t)size - 1), descriptors, 1 + below(2));
    free(bytes);
    memory_free(&client.memory, (void *)(uintptr_t)frame.control.data);
    raw_close(&client);
}

/* Sends bytes that are no frame, for which the daemon ends the connection. */
static void break_protocol(uint32_t index)
{
    struct raw_client client;
    unsigned char bytes[FRAME_HEADER_SIZE] = {0};
    (void)index;
    requests++;
    if (!raw_connect(&client, hostile.service.socket))
        return;
    if (raw_try_hello(&client)) {
        raw_send(&client, bytes, sizeof bytes, NULL, 0);
        hostile_expect(raw_await_close(&client, PATIENCE_MS, NULL), "bytes that are no frame are accepted");
        broken_connections++;
    }
    raw_close(&client);
}

/* Makes requests: one of each kind first, so that none is missing, and then random ones. */
static void run(uint64_t count)
{
    static const struct {
        void (*run)(uint32_t index);
        uint32_t weight;
    } kinds[] = {{build, 8},   {fetch, 4},    {cancel, 3},    {leave, 2},     {break_a_rule, 2},
                 {be_late, 2}, {question, 1}, {be_wrong, 12}, {break_off, 2}, {break_protocol, 1}};
    uint32_t weights = 0;
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        kinds[i].run(below(CLIENTS));
        weights += kinds[i].weight;
    }
    while (requests < count) {
        size_t kind = 0;
        for (uint32_t at = below(weights); at >= kinds[kind].weight; kind++)
            at -= kinds[kind].weight;
        kinds[kind].run(below(CLIENTS));
    }
}

static void open_all(uint64_t seed)
{
    for (uint32_t i = 0; i < SIZES; i++)
        terrain_init(&meshes[i], triangles[i], i + 1);
    for (uint32_t i = 0; i < CLIENTS; i++)
        make_client(i);
    for (uint32_t i = 0; i < WRONG; i++)
        wrong_clients[i].socket = -1;
    randomness.state = seed;
}

/* Removes all results of the daemon's caches, which may hold descriptors. */
static void close_all(void)
{
    struct bvhd_cache_state *state = NULL;
    for (uint32_t i = 0; i < HELD; i++)
        bvhd_blob_unref(held[i]);
    for (uint32_t i = 0; i < WRONG; i++)
        if (wrong_clients[i].socket >= 0)
            raw_close(&wrong_clients[i]);
    hostile_expect(bvhd_client_cache(clients[0], BVHD_CACHE_CLEAR, 0, PATIENCE_MS, &state, NULL) == BVHD_OK,
                   "the cache is not cleared");
    bvhd_cache_state_destroy(state);
    for (uint32_t i = 0; i < CLIENTS; i++)
        bvhd_client_destroy(clients[i]);
    for (uint32_t i = 0; i < SIZES; i++)
        terrain_finish(&meshes[i]);
}

static void pause_shortly(void)
{
    nanosleep(&(struct timespec){.tv_nsec = 10000000}, NULL);
}

/* Looks at a process until it has the same descriptors for a while: what has ended may still be being closed. */
static struct process_descriptors settled(pid_t pid)
{
    struct process_descriptors last = process_descriptors(pid), now;
    for (int equal = 0; equal < 5; last = now) {
        pause_shortly();
        now = process_descriptors(pid);
        equal = memcmp(&now, &last, sizeof now) ? 0 : equal + 1;
    }
    return last;
}

static bool has_more(const struct process_descriptors *now, const struct process_descriptors *before)
{
    for (int kind = 0; kind < PROCESS_KINDS; kind++)
        if (now->count[kind] > before->count[kind])
            return true;
    return false;
}

/* Compares descriptors with those of before, and waits a while for what is still being closed. */
static void expect_no_more(const char *who, pid_t pid, const struct process_descriptors *before)
{
    char texts[2][160];
    struct process_descriptors now = process_descriptors(pid);
    for (double begin = hostile_now(); has_more(&now, before) && hostile_now() - begin < 10000; pause_shortly())
        now = process_descriptors(pid);
    process_descriptors_text(before, texts[0]);
    process_descriptors_text(&now, texts[1]);
    printf("%s: before %s; after %s\n", who, texts[0], texts[1]);
    hostile_expect(!has_more(&now, before), "%s has more descriptors than before", who);
}

int main(int argc, char **argv)
{
    const char *const options[] = {"--workers", "2",       "--cache-size", "8M", "--disk-cache-size", "64M", "--memory",
                                   "256M",      "--cache", scratch_folder, NULL};
    uint64_t count = argc > 2 ? strtoull(argv[2], NULL, 10) : 2000, seed = argc > 3 ? strtoull(argv[3], NULL, 10) : 1;
    if (argc < 2 || scratch_make_in_memory(NULL) != 0)
        return 2;
    signal(SIGPIPE, SIG_IGN);
    wrong_init(&wrong, seed);
    hostile_begin(&hostile, argv[1], options);
    struct process_descriptors daemon = settled(hostile.service.pid), own = settled(getpid());
    double begin = hostile_now();
    open_all(seed);
    run(count);
    static const char *const counted[] = {"requests", "items", "cancelled", "protocol_errors", "request_errors"};
    for (size_t i = 0; i < sizeof counted / sizeof *counted; i++) {
        uint64_t value = hostile_counter(&hostile, counted[i]);
        printf("%s%llu %s", i > 0 ? ", " : "the daemon counts ", (unsigned long long)value, counted[i]);
        hostile_expect(value > 0, "no %s", counted[i]);
    }
    hostile_expect(hostile_counter(&hostile, "protocol_errors") >= broken_connections,
                   "a broken protocol is not counted");
    printf("\n%llu requests in %.0f ms: %llu results, %llu cancelled or late, %llu refused\n",
           (unsigned long long)requests, hostile_now() - begin, (unsigned long long)good_results,
           (unsigned long long)late_results, (unsigned long long)refused_results);
    hostile_expect(good_results > 0 && late_results > 0 && refused_results > 0, "a kind of request is missing");
    close_all();
    hostile_expect_clean(&hostile, "all clients have left", 10000);
    expect_no_more("the daemon", hostile.service.pid, &daemon);
    expect_no_more("this process", getpid(), &own);
    int failures = hostile_end(&hostile);
    return scratch_remove(NULL) != 0 || failures ? 1 : 0;
}
