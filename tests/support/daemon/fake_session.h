/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fake_session.h - sessions and a service without builds, in place of the real ones, for tests of connections. The type
 * of a frame selects what a session does:
 *   HELLO            opens the session
 *   PING             replies PONG
 *   GET              replies as many results as the request number says, each with a descriptor
 *   STATS            replies an inline result of 64 KiB
 *   POOL             closes the descriptors of the frame
 *   FAKE_WRONG       reports a violation of the protocol
 *   FAKE_FAIL        makes the session fail a moment later
 *   FAKE_FAIL_SENT   replies PONG, and makes the session fail when that has been sent
 *   FAKE_COSTLY      takes FAKE_COSTLY_MS
 */
#ifndef BVHD_FAKE_SESSION_H
#define BVHD_FAKE_SESSION_H

#include "daemon/session/session.h"

enum { FAKE_WRONG = 200, FAKE_FAIL = 201, FAKE_COSTLY = 202, FAKE_FAIL_SENT = 203, FAKE_COSTLY_MS = 3 };

struct fake_service {
    struct memory memory;
    struct descriptors descriptors;
    uint32_t connections; /* as reported last */
    uint32_t refused; /* clients that were turned away */
    uint32_t opened, closed; /* numbers of sessions */
    uint32_t frames, sent; /* frames received; replies that have been sent */
    uint32_t broken; /* connections whose clients broke the protocol before a frame was whole */
    uint64_t read_bytes; /* of results whose descriptors clients have read */
    uint64_t frame_bytes; /* of frames that have not arrived completely, as the connections say */
    bool has_no_frames; /* session_set_frame refuses large ones */
    bool refuse; /* session_open fails */
    bool is_behind, is_talkative; /* the answers of session_is_behind and session_is_talkative */
};

/* Initialises the service. Its limit of descriptors is the number that are free now. */
void fake_service_init(struct fake_service *service);

static inline struct service *fake_service_face(struct fake_service *service)
{
    return (struct service *)(void *)service;
}

#endif
