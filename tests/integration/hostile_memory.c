/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile_memory.c - tests a daemon against a client that writes into its payloads while the daemon prepares them.
 *
 *     hostile_memory BVHD [TRIES]
 *
 * The pool holds mesh A, and a thread keeps writing A and B over each other. The daemon makes a canonical copy of what
 * it reads and computes the key of that. Therefore the daemon must survive; a result with A's key must have A's bytes,
 * and with B's key B's; and so must the results that an honest client gets under these keys afterwards.
 */
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "tests/support/daemon/hostile.h"

enum { TRIANGLES = 200, SLOTS = 64, BATCH = 64 };

struct mesh_bytes {
    unsigned char *payload;
    struct key key;
    unsigned char *blob; /* the bytes that an honest client got first */
    uint64_t blob_size;
};

static struct hostile hostile;
static struct mesh_bytes meshes[2];
static uint64_t payload_size, slot_size;
static unsigned char *pool;
static atomic_bool stop;
static uint64_t other_keys, equal_results;

/* Builds inline as an honest client. Every result but the first must have the same bytes as the first. */
static void build_honestly(struct mesh_bytes *mesh, bool first)
{
    struct raw_client client;
    struct frame frame;
    struct control_item item = raw_item(0, payload_size, SOURCE_INLINE);
    if (!raw_connect(&client, hostile.service.socket)) {
        hostile_expect(false, "the daemon is gone");
        return;
    }
    raw_hello(&client);
    raw_build(&client, &item, 1, (struct bytes){mesh->payload, payload_size}, NULL, NULL, 0);
    struct control_result *result =
        raw_await(&client, FRAME_RESULT, 20000, &frame) ? raw_result(&client, &frame) : NULL;
    hostile_expect(result && result->error.status == BVHD_OK, "an honest build failed");
    if (result && first) {
        mesh->key = result->key;
        mesh->blob_size = frame.inline_bytes.size;
        mesh->blob = malloc(mesh->blob_size);
        memcpy(mesh->blob, frame.inline_bytes.data, mesh->blob_size);
    } else if (result) {
        hostile_expect(key_equal(&result->key, &mesh->key) && frame.inline_bytes.size == mesh->blob_size &&
                           !memcmp(frame.inline_bytes.data, mesh->blob, mesh->blob_size),
                       "an honest client got other bytes than before");
    }
    memory_free(&client.memory, result);
    raw_close(&client);
}

/* Overwrites the payloads all the time. The geometry rows change rarely, so that most requests reach the build. */
static void *scribble(void *unused)
{
    (void)unused;
    uint64_t round = 0;
    while (!atomic_load_explicit(&stop, memory_order_relaxed)) {
        const unsigned char *source = meshes[round++ % 2].payload;
        for (int slot = 0; slot < SLOTS; slot++) {
            unsigned char *at = pool + (uint64_t)slot * slot_size;
            if (round % 64 == 0)
                memset(at, (int)round, ROWS_GEOMETRY_LEAST);
            memcpy(at, source, payload_size);
        }
    }
    return NULL;
}

static void judge(struct raw_client *client, const struct frame *frame)
{
    struct control_result *result = raw_result(client, frame);
    if (!result)
        return;
    bool known = false;
    for (int i = 0; i < 2 && result->error.status == BVHD_OK; i++) {
        if (!key_equal(&result->key, &meshes[i].key))
            continue;
        known = true;
        hostile_expect(frame->inline_bytes.size == meshes[i].blob_size &&
                           !memcmp(frame->inline_bytes.data, meshes[i].blob, meshes[i].blob_size),
                       "mesh %c's key with other bytes", 'A' + i);
    }
    equal_results += known;
    other_keys += !known;
    memory_free(&client->memory, result);
}

static void open_pool(struct raw_client *client)
{
    struct control_pool message = {slot_size * SLOTS};
    struct frame frame;
    int descriptor = memfd_create("scribbled", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (descriptor < 0 || ftruncate(descriptor, (off_t)message.size) ||
        fcntl(descriptor, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW))
        hostile_expect(false, "no pool");
    pool = mmap(NULL, message.size, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    for (int slot = 0; slot < SLOTS; slot++)
        memcpy(pool + (uint64_t)slot * slot_size, meshes[0].payload, payload_size);
    struct raw_frame request = {.header = {.type = FRAME_POOL, .request = ++client->last_request, .descriptors = 1},
                                .descriptors = &descriptor,
                                .descriptor_count = 1};
    control_pack_pool(&message, &client->memory, &request.control, NULL);
    raw_send_frame(client, &request);
    hostile_expect(raw_await(client, FRAME_DONE, 5000, &frame), "the pool was not taken");
    memory_free(&client->memory, (void *)(uintptr_t)request.control.data);
    close(descriptor);
}

static void send_tries(struct raw_client *client, long tries)
{
    for (long sent = 0; sent < tries; sent += BATCH) {
        struct control_item items[BATCH];
        for (int i = 0; i < BATCH; i++)
            items[i] = raw_item((uint64_t)(i % SLOTS) * slot_size, payload_size, SOURCE_POOL);
        if (!raw_build(client, items, BATCH, (struct bytes){0}, NULL, NULL, 0)) {
            hostile_expect(false, "the daemon has closed the connection");
            return;
        }
        for (int results = 0; results < BATCH; results++) {
            struct frame frame;
            if (!raw_await(client, FRAME_RESULT, 20000, &frame)) {
                hostile_expect(false, "a result did not come");
                return;
            }
            judge(client, &frame);
        }
        if (sent / BATCH % 100 == 0) {
            build_honestly(&meshes[0], false);
            build_honestly(&meshes[1], false);
        }
    }
}

int main(int argc, char **argv)
{
    static const char *const options[] = {"--workers", "2", "--cache-size", "256K", NULL};
    const char *fewer = getenv("TRIES"); /* TRIES is set where everything is slow */
    long tries = fewer ? atol(fewer) : argc > 2 ? atol(argv[2]) : 100000;
    struct raw_client client;
    pthread_t thread;
    if (argc < 2)
        return 2;
    hostile_begin(&hostile, argv[1], options);
    for (uint32_t i = 0; i < 2; i++) {
        meshes[i].payload = raw_payload(TRIANGLES, i + 1, &payload_size);
        build_honestly(&meshes[i], true);
    }
    slot_size = bytes_align(payload_size, 4096);
    if (!raw_connect(&client, hostile.service.socket))
        return 1;
    raw_hello(&client);
    open_pool(&client);
    pthread_create(&thread, NULL, scribble, NULL);
    double begin = hostile_now();
    send_tries(&client, tries);
    atomic_store(&stop, true);
    pthread_join(thread, NULL);
    raw_close(&client);
    build_honestly(&meshes[0], false);
    build_honestly(&meshes[1], false);
    hostile_expect_clean(&hostile, "scribbling", 2000);
    hostile_expect(other_keys > 0, "nothing was ever mixed: the test shows nothing");
    printf("%ld tries: %llu results under the two keys, %llu mixed or refused, %.0f ms\n", tries,
           (unsigned long long)equal_results, (unsigned long long)other_keys, hostile_now() - begin);
    munmap(pool, slot_size * SLOTS);
    int failures = hostile_end(&hostile);
    for (int i = 0; i < 2; i++) {
        free(meshes[i].payload);
        free(meshes[i].blob);
    }
    return failures ? 1 : 0;
}
