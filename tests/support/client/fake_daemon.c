/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/client/fake_daemon.h"

#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

enum {
    PATIENCE_MS = 10000,
    QUIET_MS = 20,
    INLINE_MAX = 64 * 1024,
    SEALS = F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_WRITE | F_SEAL_SEAL
};

__attribute__((noreturn)) static void fail(const char *what)
{
    perror(what);
    exit(1);
}

void fake_open_listener(struct fake_daemon *fake)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", fake->path);
    fake->listener = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (fake->listener < 0 || bind(fake->listener, (struct sockaddr *)&address, sizeof address) ||
        listen(fake->listener, 16))
        fail(fake->path);
}

void fake_start(struct fake_daemon *fake)
{
    memset(fake, 0, sizeof *fake);
    snprintf(fake->folder, sizeof fake->folder, "%s/bvhd-test-XXXXXX", P_tmpdir);
    if (!mkdtemp(fake->folder))
        fail(fake->folder);
    snprintf(fake->path, sizeof fake->path, "%s/s", fake->folder);
    fake->peer.socket = -1;
    fake->welcome = (struct control_welcome){.version = CONTROL_VERSION,
                                             .software = "fake daemon",
                                             .credits = 64,
                                             .max_items = 32,
                                             .max_control = FRAME_MAX_CONTROL,
                                             .max_inline = FRAME_MAX_INLINE,
                                             .max_pool = 64 << 20,
                                             .max_payload = UINT64_C(1) << 32};
    fake_open_listener(fake);
}

void fake_close_listener(struct fake_daemon *fake)
{
    if (fake->listener < 0)
        return;
    close(fake->listener);
    fake->listener = -1;
    unlink(fake->path);
}

static void unmap_pool(struct fake_daemon *fake)
{
    if (fake->pool)
        munmap((void *)(uintptr_t)fake->pool, fake->pool_size);
    fake->pool = NULL;
}

void fake_hang_up(struct fake_daemon *fake)
{
    raw_close(&fake->peer);
    unmap_pool(fake);
}

void fake_stop(struct fake_daemon *fake)
{
    fake_hang_up(fake);
    fake_close_listener(fake);
    rmdir(fake->folder);
}

bool fake_accept(struct fake_daemon *fake, struct raw_client *keep)
{
    struct pollfd poller = {.fd = fake->listener, .events = POLLIN};
    if (poll(&poller, 1, PATIENCE_MS) != 1)
        return false;
    if (keep) {
        *keep = fake->peer;
        keep->parser.memory = &keep->memory;
    } else {
        fake_hang_up(fake);
    }
    fake->peer = (struct raw_client){.socket = accept4(fake->listener, NULL, NULL, SOCK_CLOEXEC)};
    memory_init(&fake->peer.memory, UINT64_MAX);
    frame_parser_init(&fake->peer.parser, &fake->peer.memory, FRAME_MAX_CONTROL, FRAME_MAX_INLINE);
    return fake->peer.socket >= 0;
}

bool fake_expect(struct fake_daemon *fake, enum frame_type type, struct frame *ret_frame)
{
    return raw_receive(&fake->peer, PATIENCE_MS, ret_frame, NULL) && ret_frame->header.type == type;
}

bool fake_is_quiet(struct fake_daemon *fake)
{
    struct frame frame;
    return !raw_receive(&fake->peer, QUIET_MS, &frame, NULL);
}

static void send_frame(struct fake_daemon *fake, struct raw_frame *frame)
{
    raw_send_frame(&fake->peer, frame);
}

void fake_send(struct fake_daemon *fake, enum frame_type type, uint64_t request, struct bytes control)
{
    struct raw_frame frame = {.header = {.type = (uint16_t)type, .request = request}, .control = control};
    send_frame(fake, &frame);
}

/* Sends a packed message and frees it. */
static void send_packed(struct fake_daemon *fake, enum frame_type type, uint64_t request, enum bvhd_status status,
                        struct bytes control)
{
    if (status != BVHD_OK)
        fail("packing");
    fake_send(fake, type, request, control);
    memory_free(&fake->peer.memory, (void *)(uintptr_t)control.data);
}

void fake_send_welcome(struct fake_daemon *fake)
{
    struct bytes control = {NULL, 0};
    enum bvhd_status status = control_pack_welcome(&fake->welcome, &fake->peer.memory, &control, NULL);
    send_packed(fake, FRAME_WELCOME, 0, status, control);
}

bool fake_greet(struct fake_daemon *fake)
{
    struct frame frame;
    if (!fake_accept(fake, NULL) || !fake_expect(fake, FRAME_HELLO, &frame))
        return false;
    fake_send_welcome(fake);
    return true;
}

void fake_send_error(struct fake_daemon *fake, uint64_t request, enum bvhd_status status, const char *where,
                     const char *text)
{
    struct bvhd_error error;
    struct bytes control = {NULL, 0};
    bvhd_error_set(&error, status, where, "%s", text);
    send_packed(fake, FRAME_ERROR, request, control_pack_error(&error, &fake->peer.memory, &control, NULL), control);
}

void fake_send_busy(struct fake_daemon *fake, uint64_t request, uint32_t retry_ms)
{
    struct control_busy busy = {retry_ms};
    struct bytes control = {NULL, 0};
    enum bvhd_status status = control_pack_busy(&busy, &fake->peer.memory, &control, NULL);
    send_packed(fake, FRAME_BUSY, request, status, control);
}

void fake_send_prepared(struct fake_daemon *fake, uint64_t request, uint32_t first, uint32_t count)
{
    uint32_t numbers[CONTROL_MAX_ITEMS];
    struct control_items items = {count, numbers};
    struct bytes control = {NULL, 0};
    for (uint32_t i = 0; i < count; i++)
        numbers[i] = first + i;
    enum bvhd_status status = control_pack_items(&items, &fake->peer.memory, &control, NULL);
    send_packed(fake, FRAME_PREPARED, request, status, control);
}

void fake_send_result_with(struct fake_daemon *fake, uint64_t request, const struct control_result *result,
                           struct bytes inline_bytes, int descriptor)
{
    struct raw_frame frame = {
        .header = {.type = FRAME_RESULT, .request = request, .descriptors = descriptor >= 0},
        .inline_bytes = inline_bytes,
        .descriptors = &descriptor,
        .descriptor_count = descriptor >= 0,
    };
    if (control_pack_result(result, &fake->peer.memory, &frame.control, NULL) != BVHD_OK)
        fail("packing");
    send_frame(fake, &frame);
    memory_free(&fake->peer.memory, (void *)(uintptr_t)frame.control.data);
    if (descriptor >= 0)
        close(descriptor);
}

void fake_fill(unsigned char *bytes, uint64_t size)
{
    for (uint64_t i = 0; i < size; i++)
        bytes[i] = (unsigned char)(i % 251);
}

void fake_send_result(struct fake_daemon *fake, uint64_t request, uint32_t item, uint64_t size)
{
    struct control_result result = {
        .item = item, .size = size, .origin = ORIGIN_BUILT, .queued_ms = 1, .prepare_ms = 2, .build_ms = 3};
    result.summary = (struct summary){.primitives = 11,
                                      .triangles = 12,
                                      .depth = 13,
                                      .sah = 1.5,
                                      .build_ms = 4,
                                      .method = "binned",
                                      .bounds = {{1, 2, 3}, {4, 5, 6}}};
    memset(&result.key, 0xab, sizeof result.key);
    unsigned char *bytes = malloc(size);
    if (!bytes)
        fail("memory");
    fake_fill(bytes, size);
    if (size <= INLINE_MAX)
        fake_send_result_with(fake, request, &result, (struct bytes){bytes, size}, -1);
    else
        fake_send_result_with(fake, request, &result, (struct bytes){NULL, 0}, raw_memfd(bytes, size, SEALS));
    free(bytes);
}

void fake_send_failed(struct fake_daemon *fake, uint64_t request, uint32_t item, enum bvhd_status status,
                      const char *where)
{
    struct control_result result = {.item = item};
    bvhd_error_set(&result.error, status, where, "as the test wants it");
    fake_send_result_with(fake, request, &result, (struct bytes){NULL, 0}, -1);
}

struct control_build *fake_build(struct fake_daemon *fake, const struct frame *frame)
{
    struct control_build *build;
    if (control_unpack_build(frame->control, &fake->peer.memory, &build, NULL) != BVHD_OK)
        fail("BUILD");
    return build;
}

void fake_free(struct fake_daemon *fake, void *message)
{
    memory_free(&fake->peer.memory, message);
}

static void take_pool_of(struct fake_daemon *fake, const struct frame *frame)
{
    struct control_pool *pool;
    if (frame->header.descriptors != 1 ||
        control_unpack_pool(frame->control, &fake->peer.memory, &pool, NULL) != BVHD_OK)
        fail("POOL");
    unmap_pool(fake);
    void *mapped = mmap(NULL, pool->size, PROT_READ, MAP_SHARED, frame->descriptors[0], 0);
    if (mapped == MAP_FAILED)
        fail("the pool");
    fake->pool = mapped;
    fake->pool_size = pool->size;
    close(frame->descriptors[0]);
    memory_free(&fake->peer.memory, pool);
    fake_send(fake, FRAME_DONE, frame->header.request, (struct bytes){NULL, 0});
}

bool fake_take_pool(struct fake_daemon *fake)
{
    struct frame frame;
    if (!fake_expect(fake, FRAME_POOL, &frame))
        return false;
    take_pool_of(fake, &frame);
    return true;
}

static void answer_build(struct fake_daemon *fake, const struct frame *frame)
{
    struct control_build *build = fake_build(fake, frame);
    uint64_t request = frame->header.request;
    for (int i = 0; i < frame->header.descriptors; i++)
        close(frame->descriptors[i]);
    fake_send_prepared(fake, request, 0, build->item_count);
    for (uint32_t i = 0; i < build->item_count; i++) {
        uint64_t size = build->items[i].destination;
        fake_send_result(fake, request, i, size ? size : 100);
        atomic_fetch_add(&fake->answered, 1);
    }
    fake_free(fake, build);
}

static void answer_get(struct fake_daemon *fake, const struct frame *frame)
{
    struct control_get *get;
    if (control_unpack_get(frame->control, &fake->peer.memory, &get, NULL) != BVHD_OK)
        fail("GET");
    for (uint32_t i = 0; i < get->key_count; i++)
        if (get->keys[i].bytes[0] == 0)
            fake_send_failed(fake, frame->header.request, i, BVHD_NOT_FOUND, "");
        else
            fake_send_result(fake, frame->header.request, i, 100);
    fake_free(fake, get);
}

static void answer_stats(struct fake_daemon *fake, uint64_t request)
{
    struct control_counter all[2] = {{"builds_started", 7}, {"hits_memory", 8}};
    struct control_counters counters = {2, all, "9.8.7"};
    struct bytes control = {NULL, 0};
    enum bvhd_status status = control_pack_counters(&counters, &fake->peer.memory, &control, NULL);
    send_packed(fake, FRAME_COUNTERS, request, status, control);
}

/* Answers as a daemon does to a client that may not see everybody. */
static void answer_clients(struct fake_daemon *fake, const struct frame *frame)
{
    struct control_client row = {.connection = 3, .uid = 4, .pid = 5, .busy_ms = 6, .software = "a fake"};
    struct control_client_list list = {.total = 9, .hidden = 8, .count = 1, .clients = &row};
    struct bytes control = {NULL, 0};
    struct control_clients *asked;
    struct bvhd_error error;
    if (control_unpack_clients(frame->control, &fake->peer.memory, &asked, NULL) != BVHD_OK)
        return;
    bvhd_error_set(&error, BVHD_UNSUPPORTED, "clients", "not everybody");
    enum bvhd_status status = asked->all ? control_pack_error(&error, &fake->peer.memory, &control, NULL)
                                         : control_pack_client_list(&list, &fake->peer.memory, &control, NULL);
    send_packed(fake, asked->all ? FRAME_ERROR : FRAME_CLIENT_LIST, frame->header.request, status, control);
    fake_free(fake, asked);
}

/* Answers as a daemon does to a client that may not change anything. */
static void answer_cache(struct fake_daemon *fake, const struct frame *frame)
{
    const struct control_cache_state state = {"/a/b", true, 1, 2, 3, 4, 5, 6};
    struct bytes control = {NULL, 0};
    struct control_cache *asked;
    struct bvhd_error error;
    if (control_unpack_cache(frame->control, &fake->peer.memory, &asked, NULL) != BVHD_OK)
        return;
    bvhd_error_set(&error, BVHD_UNSUPPORTED, "cache.action", "%u to %d bytes", asked->action, (int)asked->bytes);
    enum bvhd_status status = asked->action ? control_pack_error(&error, &fake->peer.memory, &control, NULL)
                                            : control_pack_cache_state(&state, &fake->peer.memory, &control, NULL);
    send_packed(fake, asked->action ? FRAME_ERROR : FRAME_CACHE_STATE, frame->header.request, status, control);
    fake_free(fake, asked);
}

static void answer(struct fake_daemon *fake, const struct frame *frame)
{
    switch (frame->header.type) {
    case FRAME_HELLO:
        fake_send_welcome(fake);
        break;
    case FRAME_POOL:
        take_pool_of(fake, frame);
        break;
    case FRAME_BUILD:
        answer_build(fake, frame);
        break;
    case FRAME_GET:
        answer_get(fake, frame);
        break;
    case FRAME_STATS:
        answer_stats(fake, frame->header.request);
        break;
    case FRAME_CLIENTS:
        answer_clients(fake, frame);
        break;
    case FRAME_CACHE:
        answer_cache(fake, frame);
        break;
    case FRAME_PING:
        fake_send(fake, FRAME_PONG, frame->header.request, (struct bytes){NULL, 0});
        break;
    default: /* a CANCEL comes too late */
        break;
    }
}

static void *serve(void *context)
{
    struct fake_daemon *fake = context;
    while (!fake->stop) {
        struct pollfd poller = {.fd = fake->listener, .events = POLLIN};
        if (poll(&poller, 1, QUIET_MS) != 1 || !fake_accept(fake, NULL))
            continue;
        bool closed = false;
        while (!closed && !fake->stop) {
            struct frame frame;
            if (raw_receive(&fake->peer, QUIET_MS, &frame, &closed))
                answer(fake, &frame);
        }
    }
    return NULL;
}

void fake_serve(struct fake_daemon *fake)
{
    fake->stop = 0;
    if (pthread_create(&fake->thread, NULL, serve, fake) != 0)
        fail("thread");
}

void fake_serve_end(struct fake_daemon *fake)
{
    fake->stop = 1;
    pthread_join(fake->thread, NULL);
}
