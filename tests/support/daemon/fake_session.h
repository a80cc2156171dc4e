/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fake_session.h - sessions and a service without builds, in place of the real ones, for tests of connections. A
 * frame's type says what a session does: HELLO opens it, PING gives PONG, GET gives as many results as its request
 * number says, each with a descriptor, STATS an inline result of 64 KiB, POOL closes what descriptors came; FAKE_WRONG
 * breaks the protocol, FAKE_FAIL has the session fail a moment later, FAKE_FAIL_SENT gives PONG and has it fail when
 * that leaves; FAKE_COSTLY takes FAKE_COSTLY_MS.
 */
#ifndef BVHD_FAKE_SESSION_H
#define BVHD_FAKE_SESSION_H

#include "daemon/session/session.h"

enum { FAKE_WRONG = 200, FAKE_FAIL = 201, FAKE_COSTLY = 202, FAKE_FAIL_SENT = 203, FAKE_COSTLY_MS = 3 };

struct fake_service {
    struct memory memory;
    struct descriptors descriptors;
    uint32_t connections; /* as last told */
    uint32_t opened, closed; /* sessions */
    uint32_t frames, sent; /* frames taken; replies that have left */
    bool refuse; /* session_open fails */
};

/* Descriptors: those that are free now. */
void fake_service_init(struct fake_service *service);

static inline struct service *fake_service_face(struct fake_service *service)
{
    return (struct service *)(void *)service;
}

#endif
