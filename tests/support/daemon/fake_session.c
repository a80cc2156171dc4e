/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/daemon/fake_session.h"

#include <stdlib.h>
#include <sys/mman.h>
#include <time.h>
#include <unistd.h>

struct session {
    struct fake_service *service;
    struct descriptor_share *share;
    struct session_link link;
    bool open, fails_when_sent;
    uint64_t frame_bytes;
};

static struct fake_service *fake(struct service *service)
{
    return (struct fake_service *)(void *)service;
}

void fake_service_init(struct fake_service *service)
{
    *service = (struct fake_service){.connections = 0};
    memory_init(&service->memory, 64 << 20);
    descriptors_init(&service->descriptors);
}

struct memory *service_frame_memory(struct service *service)
{
    return &fake(service)->memory;
}

struct descriptors *service_descriptors(struct service *service)
{
    return &fake(service)->descriptors;
}

void service_count_connections(struct service *service, uint32_t open)
{
    fake(service)->connections = open;
}

void service_count_refusal(struct service *service)
{
    fake(service)->refused++;
}

bool service_is_building(const struct service *service)
{
    (void)service;
    return false;
}

bool service_has_deadlines(const struct service *service)
{
    (void)service;
    return false;
}

enum bvhd_status session_open(struct service *service, const struct session_peer *peer, const struct session_link *link,
                              struct session **ret_session, struct bvhd_error *error)
{
    if (fake(service)->refuse)
        return bvhd_error_no_memory(error, "session", "told to refuse");
    struct session *session = calloc(1, sizeof *session);
    *session = (struct session){.service = fake(service), .share = peer->share, .link = *link};
    session->service->opened++;
    *ret_session = session;
    return BVHD_OK;
}

static void answer(struct session *session, enum frame_type type, uint64_t request, struct blob *blob)
{
    struct reply *reply = reply_create(type, request, (struct bytes){NULL, 0}, &session->service->memory);
    if (!reply)
        abort();
    reply->blob = blob;
    reply->header.descriptors = blob && blob->descriptor >= 0;
    reply->header.inline_size = blob && blob->descriptor < 0 ? (uint32_t)blob->size : 0;
    session->link.send(session->link.context, reply);
}

static struct blob *make_blob(struct session *session, uint64_t size)
{
    static struct blob_account account;
    account.memory = &session->service->memory;
    account.descriptors = &session->service->descriptors;
    struct blob_writer writer;
    struct blob *blob;
    blob_writer_init(&writer, &account);
    unsigned char *bytes = writer.output.allocate(&writer.output, size);
    if (!bytes)
        abort();
    for (uint64_t i = 0; i < size; i++)
        bytes[i] = (unsigned char)(i * 7);
    if (blob_writer_finish(&writer, &blob, NULL) != BVHD_OK)
        abort();
    return blob;
}

static void close_descriptors(struct session *session, const struct frame *frame)
{
    for (int i = 0; i < frame->header.descriptors; i++)
        close(frame->descriptors[i]);
    descriptor_share_give(session->share, frame->header.descriptors);
}

static void take_long(void)
{
    struct timespec begin, now;
    clock_gettime(CLOCK_MONOTONIC, &begin);
    do
        clock_gettime(CLOCK_MONOTONIC, &now);
    while ((now.tv_sec - begin.tv_sec) * 1000000000 + now.tv_nsec - begin.tv_nsec < FAKE_COSTLY_MS * 1000000);
}

static void fail(struct session *session)
{
    struct bvhd_error error;
    bvhd_error_no_memory(&error, "session", "told to fail");
    session->link.fail(session->link.context, &error);
}

void session_count_broken(struct session *session, enum bvhd_status status)
{
    session->service->broken += status != BVHD_NO_MEMORY;
}

enum bvhd_status session_frame(struct session *session, const struct frame *frame, struct bvhd_error *error)
{
    session->service->frames++;
    close_descriptors(session, frame);
    switch (frame->header.type) {
    case FRAME_HELLO:
        session->open = true;
        answer(session, FRAME_WELCOME, 0, NULL);
        break;
    case FRAME_PING:
        answer(session, FRAME_PONG, frame->header.request, NULL);
        break;
    case FRAME_GET:
        for (uint64_t i = 0; i < frame->header.request; i++)
            answer(session, FRAME_RESULT, i + 1, make_blob(session, 2 * BLOB_INLINE_MAX));
        break;
    case FRAME_STATS:
        answer(session, FRAME_RESULT, frame->header.request, make_blob(session, BLOB_INLINE_MAX));
        break;
    case FAKE_FAIL:
        fail(session);
        break;
    case FAKE_FAIL_SENT:
        session->fails_when_sent = true;
        answer(session, FRAME_PONG, frame->header.request, NULL);
        break;
    case FAKE_COSTLY:
        take_long();
        answer(session, FRAME_PONG, frame->header.request, NULL);
        break;
    case FAKE_WRONG:
        return bvhd_error_set(error, BVHD_INVALID, "frame.type", "told to be wrong");
    default:
        break;
    }
    return BVHD_OK;
}

void session_sent(struct session *session, const struct reply *reply)
{
    (void)reply;
    session->service->sent++;
    if (session->fails_when_sent)
        fail(session);
    session->fails_when_sent = false;
}

void session_read(struct session *session, uint64_t bytes)
{
    session->service->read_bytes += bytes;
}

void session_check_deadlines(struct session *session, uint64_t now_ns)
{
    (void)session;
    (void)now_ns;
}

bool session_is_talkative(const struct session *session)
{
    return session->service->is_talkative;
}

bool session_is_behind(const struct session *session)
{
    return session->service->is_behind;
}

bool session_is_idle(const struct session *session)
{
    return session->open && !session->service->is_behind;
}

bool session_set_frame(struct session *session, uint64_t bytes)
{
    if (bytes > FRAME_KEEP && bytes > session->frame_bytes && session->service->has_no_frames)
        return false;
    session->service->frame_bytes += bytes - session->frame_bytes;
    session->frame_bytes = bytes;
    return true;
}

uint32_t session_siblings(const struct session *session)
{
    return session->share->holders;
}

void session_goodbye(struct session *session, const struct bvhd_error *reason)
{
    (void)reason;
    answer(session, FRAME_GOODBYE, 0, NULL);
}

void session_report_progress(struct session *session, uint64_t now_ms)
{
    (void)session;
    (void)now_ms;
}

bool session_is_open(const struct session *session)
{
    return session->open;
}

void session_close(struct session *session)
{
    if (!session)
        return;
    session->service->closed++;
    session->service->frame_bytes -= session->frame_bytes;
    free(session);
}
