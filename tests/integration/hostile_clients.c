/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile_clients.c - tests a real daemon, on a real socket, against clients that break every rule of the protocol.
 * After each of them the daemon serves another client, and has released what the hostile one held.
 *
 *     hostile_clients BVHD [CASE...]
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/support/daemon/hostile.h"
#include "tests/support/random.h"

enum {
    SEALS_POOL = F_SEAL_SHRINK | F_SEAL_GROW,
    SEALS_ONCE = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL
};

static struct hostile hostile;

static void connect_well(struct raw_client *client)
{
    if (!raw_connect(client, hostile.service.socket)) {
        fputs("the daemon is gone\n", stderr);
        exit(1);
    }
    raw_hello(client);
}

/* ---- floods: control messages that need far more memory than their length ---- */

static size_t fill_empty_messages(unsigned char *at, size_t size, int field)
{
    for (size_t i = 0; i + 2 <= size; i += 2) {
        at[i] = (unsigned char)(field << 3 | 2);
        at[i + 1] = 0;
    }
    return size / 2 * 2;
}

static size_t put_varint(unsigned char *at, uint64_t value)
{
    size_t size = 0;
    do {
        at[size++] = (unsigned char)((value & 0x7f) | (value > 0x7f ? 0x80 : 0));
        value >>= 7;
    } while (value);
    return size;
}

/* Field 1 within field 1 within ..., written from the inside out. */
static size_t fill_nested(unsigned char *at, size_t size)
{
    unsigned char *scratch = calloc(1, size);
    size_t used = 0;
    while (scratch && used + 12 < size) {
        unsigned char head[12] = {0x0a};
        size_t head_size = 1 + put_varint(head + 1, used);
        memmove(scratch + head_size, scratch, used);
        memcpy(scratch, head, head_size);
        used += head_size;
    }
    if (scratch)
        memcpy(at, scratch, used);
    free(scratch);
    return used;
}

static void send_flood(enum frame_type type, struct bytes control, const char *what)
{
    struct raw_client client;
    struct raw_frame frame = {.header = {.type = type, .request = 1}, .control = control};
    struct frame answer;
    bool closed = false;
    if (type == FRAME_HELLO) {
        if (!raw_connect(&client, hostile.service.socket))
            return;
    } else {
        connect_well(&client);
    }
    raw_send_frame(&client, &frame);
    bool answered = raw_receive(&client, 5000, &answer, &closed);
    hostile_expect(answered || closed, "%s of frame type %d: no answer", what, type);
    raw_close(&client);
}

static void case_floods(void)
{
    static const enum frame_type types[] = {FRAME_HELLO,  FRAME_POOL,  FRAME_BUILD, FRAME_GET,
                                            FRAME_CANCEL, FRAME_STATS, FRAME_PING,  FRAME_CLIENTS};
    unsigned char *control = calloc(1, FRAME_MAX_CONTROL);
    uint64_t before = service_process_resident(&hostile.service);
    for (size_t t = 0; t < sizeof types / sizeof *types; t++) {
        for (int field = 1; field <= 15; field++)
            send_flood(types[t], (struct bytes){control, fill_empty_messages(control, FRAME_MAX_CONTROL, field)},
                       "empty messages");
        send_flood(types[t], (struct bytes){control, fill_nested(control, 40 * 1024)}, "nesting");
        memset(control, 0xff, FRAME_MAX_CONTROL);
        send_flood(types[t], (struct bytes){control, FRAME_MAX_CONTROL}, "ones");
    }
    uint64_t after = service_process_resident(&hostile.service);
    hostile_expect(after < before + 32 * 1024 * 1024, "floods: grew from %llu to %llu bytes",
                   (unsigned long long)before, (unsigned long long)after);
    free(control);
}

/* ---- descriptors of a wrong kind ---- */

static unsigned char *payload;
static uint64_t payload_size;

static int make_memfd(uint64_t size, unsigned flags, unsigned seals)
{
    int descriptor = memfd_create("hostile", MFD_CLOEXEC | MFD_ALLOW_SEALING | flags);
    if (descriptor < 0 || ftruncate(descriptor, (off_t)size) || (seals && fcntl(descriptor, F_ADD_SEALS, seals))) {
        if (descriptor >= 0)
            close(descriptor);
        return -1;
    }
    return descriptor;
}

static int make_pipe(void)
{
    int ends[2];
    if (pipe2(ends, O_CLOEXEC))
        return -1;
    close(ends[1]);
    return ends[0];
}

static int make_file(void)
{
    FILE *file = tmpfile();
    if (!file)
        return -1;
    int descriptor = dup(fileno(file));
    fwrite(payload, 1, payload_size, file);
    fclose(file);
    return descriptor;
}

enum kind {
    K_UNSEALED,
    K_NO_GROW,
    K_SPARSE,
    K_SHORT,
    K_LONG,
    K_EMPTY,
    K_HUGE,
    K_HUGETLB,
    K_PIPE,
    K_FILE,
    K_DIRECTORY,
    K_SOCKET,
    K_ZERO,
    K_PATH,
    KINDS
};

static const char *const kind_names[KINDS] = {"unsealed",
                                              "not sealed against growing",
                                              "sparse",
                                              "shorter than declared",
                                              "longer than declared",
                                              "empty",
                                              "terabytes",
                                              "huge pages",
                                              "a pipe",
                                              "a file",
                                              "a directory",
                                              "a socket",
                                              "/dev/zero",
                                              "a path only"};

/* Makes a descriptor. *ret_size is the size that the client declares. Returns -1 where this machine cannot make one. */
static int make_descriptor(enum kind kind, unsigned seals, uint64_t *ret_size)
{
    *ret_size = payload_size;
    switch (kind) {
    case K_UNSEALED:
        return raw_memfd(payload, payload_size, 0);
    case K_NO_GROW:
        return raw_memfd(payload, payload_size, seals & ~(unsigned)F_SEAL_SHRINK & ~(unsigned)F_SEAL_SEAL);
    case K_SPARSE:
        *ret_size = UINT64_C(1) << 30;
        return make_memfd(*ret_size, 0, seals);
    case K_SHORT:
        return make_memfd(payload_size / 2, 0, seals);
    case K_LONG:
        return make_memfd(payload_size * 2, 0, seals);
    case K_EMPTY:
        return make_memfd(0, 0, seals);
    case K_HUGE:
        *ret_size = UINT64_C(1) << 42;
        return make_memfd(*ret_size, 0, seals);
    case K_HUGETLB:
        *ret_size = UINT64_C(2) << 20;
        return make_memfd(*ret_size, MFD_HUGETLB, seals);
    case K_PIPE:
        return make_pipe();
    case K_FILE:
        return make_file();
    case K_DIRECTORY:
        return open("/", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    case K_SOCKET:
        return socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    case K_ZERO:
        return open("/dev/zero", O_RDONLY | O_CLOEXEC);
    case K_PATH:
        return open("/", O_PATH | O_CLOEXEC);
    default:
        return -1;
    }
}

/* Expects an error: for the request, for the item, or for the connection. */
static void expect_refusal(struct raw_client *client, const char *what, const char *name)
{
    struct frame frame;
    bool closed = false, refused = false;
    while (!refused && !closed && raw_receive(client, 5000, &frame, &closed)) {
        struct control_result *result = raw_result(client, &frame);
        refused = frame.header.type == FRAME_ERROR || frame.header.type == FRAME_BUSY ||
                  (result && result->error.status != BVHD_OK);
        bool wrong = (result && result->error.status == BVHD_OK) || frame.header.type == FRAME_DONE;
        hostile_expect(!wrong, "%s that is %s was taken", what, name);
        memory_free(&client->memory, result);
        if (wrong)
            break;
    }
    hostile_expect(refused || closed, "%s that is %s: no answer", what, name);
}

static void try_pool(enum kind kind)
{
    struct raw_client client;
    struct control_pool pool;
    int descriptor = make_descriptor(kind, SEALS_POOL, &pool.size);
    if (descriptor < 0) {
        printf("skipped: a pool that is %s\n", kind_names[kind]);
        return;
    }
    /* A pool may have holes, because its pages are allocated when they are used. */
    if (kind == K_SPARSE) {
        close(descriptor);
        return;
    }
    connect_well(&client);
    struct raw_frame frame = {.header = {.type = FRAME_POOL, .request = ++client.last_request, .descriptors = 1},
                              .descriptors = &descriptor,
                              .descriptor_count = 1};
    control_pack_pool(&pool, &client.memory, &frame.control, NULL);
    raw_send_frame(&client, &frame);
    expect_refusal(&client, "a pool", kind_names[kind]);
    memory_free(&client.memory, (void *)(uintptr_t)frame.control.data);
    close(descriptor);
    raw_close(&client);
}

static void try_memfd(enum kind kind)
{
    struct raw_client client;
    uint64_t size;
    int descriptor = make_descriptor(kind, SEALS_ONCE, &size);
    if (descriptor < 0) {
        printf("skipped: a memfd that is %s\n", kind_names[kind]);
        return;
    }
    connect_well(&client);
    struct control_item item = raw_item(0, payload_size, SOURCE_MEMFD);
    raw_build(&client, &item, 1, (struct bytes){0}, &descriptor, &size, 1);
    expect_refusal(&client, "a payload", kind_names[kind]);
    close(descriptor);
    raw_close(&client);
}

static void case_descriptors(void)
{
    for (int kind = 0; kind < KINDS; kind++) {
        try_pool(kind);
        try_memfd(kind);
    }
}

/* ---- more or fewer descriptors than declared ---- */

static void send_counts(uint8_t declared, uint32_t sent)
{
    int descriptors[64];
    uint64_t sizes[FRAME_MAX_DESCRIPTORS];
    struct raw_client client;
    for (uint32_t i = 0; i < sent; i++)
        descriptors[i] = raw_memfd(payload, payload_size, SEALS_ONCE);
    for (int i = 0; i < FRAME_MAX_DESCRIPTORS; i++)
        sizes[i] = payload_size;
    struct control_item item = raw_item(0, payload_size, SOURCE_MEMFD);
    struct control_build build = {.memfd_count = declared > FRAME_MAX_DESCRIPTORS ? FRAME_MAX_DESCRIPTORS : declared,
                                  .item_count = 1,
                                  .items = &item};
    memcpy(build.memfd_sizes, sizes, sizeof sizes);
    connect_well(&client);
    struct raw_frame frame = {.header = {.type = FRAME_BUILD, .request = 1, .descriptors = declared},
                              .descriptors = descriptors,
                              .descriptor_count = sent};
    control_pack_build(&build, &client.memory, &frame.control, NULL);
    raw_send_frame(&client, &frame);
    struct raw_frame ping = {.header = {.type = FRAME_PING, .request = 2}};
    raw_send_frame(&client, &ping);
    hostile_expect(raw_await_close(&client, 5000, NULL), "%u descriptors declared, %u sent: the connection lives",
                   declared, sent);
    memory_free(&client.memory, (void *)(uintptr_t)frame.control.data);
    for (uint32_t i = 0; i < sent; i++)
        close(descriptors[i]);
    raw_close(&client);
}

static void case_counts(void)
{
    static const uint8_t pairs[][2] = {{1, 0}, {0, 1}, {2, 1},   {1, 2},  {4, 3},
                                       {0, 4}, {5, 5}, {255, 0}, {0, 40}, {1, 40}};
    for (size_t i = 0; i < sizeof pairs / sizeof *pairs; i++)
        send_counts(pairs[i][0], pairs[i][1]);
}

/* ---- a descriptor with the bytes of another frame: it is legal, because the socket is a stream ---- */

static void case_middle(void)
{
    struct raw_client client;
    struct frame frame;
    struct control_item item = raw_item(0, payload_size, SOURCE_MEMFD);
    struct control_build build = {.memfd_count = 1, .memfd_sizes = {payload_size}, .item_count = 1, .items = &item};
    int descriptor = raw_memfd(payload, payload_size, SEALS_ONCE);
    connect_well(&client);
    struct raw_frame ping = {.header = {.type = FRAME_PING, .request = 1}};
    struct raw_frame second = {.header = {.type = FRAME_BUILD, .request = 2, .descriptors = 1}};
    control_pack_build(&build, &client.memory, &second.control, NULL);
    size_t ping_size, second_size;
    unsigned char *first_bytes = raw_frame_bytes(&ping, &ping_size),
                  *second_bytes = raw_frame_bytes(&second, &second_size);
    unsigned char *both = malloc(ping_size + second_size);
    memcpy(both, first_bytes, ping_size);
    memcpy(both + ping_size, second_bytes, second_size);
    raw_send(&client, both, 10, NULL, 0);
    raw_send(&client, both + 10, ping_size + second_size - 10, &descriptor, 1);
    hostile_expect(raw_await(&client, FRAME_PONG, 5000, &frame), "a descriptor with another frame's bytes: no PONG");
    bool came = raw_await(&client, FRAME_RESULT, 5000, &frame);
    struct control_result *result = came ? raw_result(&client, &frame) : NULL;
    hostile_expect(result && result->error.status == BVHD_OK, "a descriptor with another frame's bytes: no result");
    memory_free(&client.memory, result);
    memory_free(&client.memory, (void *)(uintptr_t)second.control.data);
    free(first_bytes);
    free(second_bytes);
    free(both);
    close(descriptor);
    raw_close(&client);
}

/* ---- garbage ---- */

static void case_garbage(void)
{
    struct random random = {11};
    for (int i = 0; i < 400; i++) {
        unsigned char bytes[512];
        struct raw_client client;
        size_t size = 1 + random_next(&random) % sizeof bytes;
        for (size_t k = 0; k < size; k++)
            bytes[k] = (unsigned char)random_next(&random);
        if (i % 4)
            connect_well(&client);
        else if (!raw_connect(&client, hostile.service.socket))
            break;
        if (i % 2) { /* a frame with a correct header */
            struct raw_frame frame = {
                .header = {.type = (uint16_t)(random_next(&random) % 12), .request = random_next(&random) % 3},
                .control = {bytes, size}};
            raw_send_frame(&client, &frame);
        } else {
            raw_send(&client, bytes, size, NULL, 0);
        }
        if (i % 8 == 0)
            raw_await_close(&client, 20, NULL);
        raw_close(&client);
    }
}

/* ---- a client that dies after every byte, in every state ---- */

/* Makes the bytes of a whole conversation: HELLO, BUILD of two inline items, CANCEL, GET, STATS. */
static unsigned char *make_conversation(struct memory *memory, size_t *ret_size)
{
    struct control_hello hello = {.version_min = CONTROL_VERSION, .version_max = CONTROL_VERSION, .software = "dying"};
    struct control_item items[2] = {raw_item(0, payload_size, SOURCE_INLINE), raw_item(0, payload_size, SOURCE_INLINE)};
    struct control_build build = {.item_count = 2, .items = items};
    struct control_items cancel = {0};
    struct key key = {{1}};
    struct control_get get = {1, &key};
    struct raw_frame frames[] = {
        {.header = {.type = FRAME_HELLO}},
        {.header = {.type = FRAME_BUILD, .request = 1}, .inline_bytes = {payload, payload_size}},
        {.header = {.type = FRAME_CANCEL, .request = 1}},
        {.header = {.type = FRAME_GET, .request = 2}},
        {.header = {.type = FRAME_STATS, .request = 3}},
    };
    control_pack_hello(&hello, memory, &frames[0].control, NULL);
    control_pack_build(&build, memory, &frames[1].control, NULL);
    control_pack_items(&cancel, memory, &frames[2].control, NULL);
    control_pack_get(&get, memory, &frames[3].control, NULL);
    unsigned char *all = NULL;
    *ret_size = 0;
    for (size_t i = 0; i < sizeof frames / sizeof *frames; i++) {
        size_t size;
        unsigned char *bytes = raw_frame_bytes(&frames[i], &size);
        all = realloc(all, *ret_size + size);
        memcpy(all + *ret_size, bytes, size);
        *ret_size += size;
        free(bytes);
        memory_free(memory, (void *)(uintptr_t)frames[i].control.data);
    }
    return all;
}

static void case_deaths(void)
{
    struct memory memory;
    size_t size;
    memory_init(&memory, UINT64_MAX);
    unsigned char *conversation = make_conversation(&memory, &size);
    for (size_t length = 0; length <= size; length += length < 400 || length + 400 > size ? 3 : 101) {
        struct raw_client client;
        if (!raw_connect(&client, hostile.service.socket))
            break;
        raw_send(&client, conversation, length, NULL, 0);
        if (length % 2)
            shutdown(client.socket, SHUT_WR);
        raw_close(&client);
    }
    free(conversation);
}

/* ---- clients that never read ---- */

static struct key build_key(uint32_t triangles, struct raw_client *client)
{
    uint64_t size;
    struct frame frame;
    struct key key = {{0}};
    unsigned char *bytes = raw_payload(triangles, 77, &size);
    int descriptor = raw_memfd(bytes, size, SEALS_ONCE);
    struct control_item item = raw_item(0, size, SOURCE_MEMFD);
    raw_build(client, &item, 1, (struct bytes){0}, &descriptor, &size, 1);
    struct control_result *result = raw_await(client, FRAME_RESULT, 20000, &frame) ? raw_result(client, &frame) : NULL;
    hostile_expect(result && result->error.status == BVHD_OK, "a build of %u triangles failed", triangles);
    for (int i = 0; result && i < frame.header.descriptors; i++)
        close(frame.descriptors[i]);
    if (result)
        key = result->key;
    memory_free(&client->memory, result);
    close(descriptor);
    free(bytes);
    return key;
}

static void ask_without_reading(struct raw_client *client, const struct key *key, int times)
{
    struct control_get get = {1, (struct key *)(uintptr_t)key};
    fcntl(client->socket, F_SETFL, O_NONBLOCK);
    for (int i = 0; i < times; i++) {
        struct raw_frame frame = {.header = {.type = FRAME_GET, .request = ++client->last_request}};
        control_pack_get(&get, &client->memory, &frame.control, NULL);
        bool sent = raw_send_frame(client, &frame);
        memory_free(&client->memory, (void *)(uintptr_t)frame.control.data);
        if (!sent)
            break;
    }
}

static void stall(int clients, uint32_t triangles, const char *what)
{
    struct raw_client *stalled = calloc((size_t)clients, sizeof *stalled), reader;
    connect_well(&reader);
    struct key key = build_key(triangles, &reader);
    for (int i = 0; i < clients; i++) {
        connect_well(&stalled[i]);
        ask_without_reading(&stalled[i], &key, 64);
    }
    hostile_serves(&hostile, what, 2000);
    struct frame frame;
    struct control_get get = {1, &key};
    struct raw_frame question = {.header = {.type = FRAME_GET, .request = ++reader.last_request}};
    control_pack_get(&get, &reader.memory, &question.control, NULL);
    raw_send_frame(&reader, &question);
    bool came = raw_await(&reader, FRAME_RESULT, 5000, &frame);
    hostile_expect(came, "%s: somebody else gets no result", what);
    for (int i = 0; came && i < frame.header.descriptors; i++)
        close(frame.descriptors[i]);
    memory_free(&reader.memory, (void *)(uintptr_t)question.control.data);
    for (int i = 0; i < clients; i++)
        raw_close(&stalled[i]);
    raw_close(&reader);
    free(stalled);
}

static void case_never_reads(void)
{
    stall(8, 1000, "clients that never read");
}

static void case_stalled_receivers(void)
{
    stall(65, 20000, "65 receivers of descriptors that never read");
    hostile.descriptors_base++; /* the cache keeps the result */
}

static const struct {
    const char *name;
    void (*run)(void);
} cases[] = {
    {"floods", case_floods},           {"descriptors", case_descriptors},
    {"counts", case_counts},           {"middle", case_middle},
    {"garbage", case_garbage},         {"deaths", case_deaths},
    {"never-reads", case_never_reads}, {"stalled-receivers", case_stalled_receivers},
};

int main(int argc, char **argv)
{
    static const char *const options[] = {"--workers", "2", NULL};
    if (argc < 2)
        return 2;
    payload = raw_payload(200, 5, &payload_size);
    hostile_begin(&hostile, argv[1], options);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        bool chosen = argc == 2;
        for (int k = 2; k < argc; k++)
            chosen |= !strcmp(argv[k], cases[i].name);
        if (!chosen)
            continue;
        double begin = hostile_now();
        cases[i].run();
        hostile_serves(&hostile, cases[i].name, 2000);
        hostile_expect_clean(&hostile, cases[i].name, 2000);
        printf("%-18s %.0f ms\n", cases[i].name, hostile_now() - begin);
        fflush(stdout);
    }
    int failures = hostile_end(&hostile);
    free(payload);
    return failures ? 1 : 0;
}
