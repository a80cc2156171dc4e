/* SPDX-License-Identifier: Apache-2.0 */
/*
 * session_world.h - a service with real threads and clients without sockets: frames go in as structs, replies are kept
 * as a list of events.
 *
 * For test programs only: what must not fail fails the running test.
 */
#ifndef BVHD_SESSION_WORLD_H
#define BVHD_SESSION_WORLD_H

#include <semaphore.h>

#include "daemon/session/request.h"
#include "proto/wire/rows.h"
#include "daemon/session/session.h"
#include "daemon/session/session_internal.h"

enum { WORLD_CLIENTS = 16, WORLD_GATES = 64 };

/* A reply as the client sees it. Pointers that do not belong to its type are NULL. */
struct world_event {
    enum frame_type type;
    uint64_t request;
    struct control_welcome *welcome;
    struct control_result *result;
    struct control_items *prepared;
    struct control_counters *counters;
    struct control_busy *busy;
    struct bvhd_error *error;
    unsigned char *bytes; /* of a result */
};

struct world_client {
    struct session_world *world;
    struct session *session; /* NULL once it was closed */
    struct memory memory;
    struct world_event *events;
    uint32_t event_count, event_capacity;
    struct reply *first_held, **end_held; /* replies that have not left */
    bool hold; /* nothing leaves */
    bool failed; /* the session asked for an end of the connection */
};

/* Occupies a thread until it is opened. */
struct world_gate {
    struct pool_job job;
    sem_t opened;
    atomic_bool running;
    bool done;
};

struct session_world {
    struct service *service;
    sem_t woken;
    struct world_client clients[WORLD_CLIENTS];
    uint32_t client_count;
    struct world_gate gates[WORLD_GATES];
    uint32_t gate_count;
    int descriptors; /* open at the start */
};

/* What tests work with: two workers, 256 MiB, a cache of 64 MiB. */
struct service_options world_options(void);

void world_init(struct session_world *world, const struct service_options *options);

/* Closes what is open, and checks that nothing is left: items, memory, descriptors. */
void world_finish(struct session_world *world);

/* Lets replies leave, takes up what workers have done. */
void world_iterate(struct session_world *world);

/* Turns until `reached` says yes; fails the test after 30 s. */
void world_await(struct session_world *world, bool (*reached)(void *context), void *context);

/* Turns until no item of anybody is under way. */
void world_settle(struct session_world *world);

/* Occupies one thread; returns when it does. */
struct world_gate *world_shut(struct session_world *world);
void world_open(struct world_gate *gate);

/* Another client, which has said HELLO or not. */
struct world_client *world_join(struct session_world *world);
struct world_client *world_join_silent(struct session_world *world);
void world_leave(struct world_client *client);

/* Gives a frame to the session; descriptors are counted here, and the session's from then on. */
enum bvhd_status world_send(struct world_client *client, const struct frame *frame, struct bvhd_error *error);

/* Frames of each kind; sent rightly unless the message is wrong. */
enum bvhd_status world_say(struct world_client *client, enum frame_type type, uint64_t request,
                           struct bvhd_error *error);
void world_pool(struct world_client *client, uint64_t request, int descriptor, uint64_t size);
void world_build(struct world_client *client, uint64_t request, const struct control_build *build,
                 struct bytes inline_bytes, const int *descriptors);
void world_get(struct world_client *client, uint64_t request, const struct key *keys, uint32_t count);
enum bvhd_status world_cancel(struct world_client *client, uint64_t request, const uint32_t *items, uint32_t count);

/* The event of that type and request that comes `skip` after the first; NULL when there is none. */
const struct world_event *world_find(const struct world_client *client, enum frame_type type, uint64_t request,
                                     uint32_t skip);
/* The only result of that item, or NULL; more than one fails the test. */
const struct world_event *world_result(const struct world_client *client, uint64_t request, uint32_t item);
enum bvhd_status world_status(const struct world_client *client, uint64_t request, uint32_t item);
/* How often the item was said to be prepared. */
uint32_t world_prepared(const struct world_client *client, uint64_t request, uint32_t item);

/* The service's counters now. */
struct counters world_counters(const struct session_world *world);

/* Turns until that item has its result. */
const struct world_event *world_await_result(struct world_client *client, uint64_t request, uint32_t item);
/* Turns until its state is that one. */
void world_await_state(struct world_client *client, uint64_t request, uint32_t item, enum item_state state);

/* A memfd with these bytes and seals. */
int world_memfd(const void *bytes, uint64_t size, unsigned seals);
enum { WORLD_SEALS_POOL = 0x6, WORLD_SEALS_ONCE = 0xf };

/* Random triangles, the same for a seed, as a payload. */
struct world_mesh {
    struct geometry geometry;
    struct build_input input;
    float *vertices;
    unsigned char *payload;
    uint64_t size;
};

void world_mesh_init(struct world_mesh *mesh, uint32_t triangles, uint64_t seed);
void world_mesh_finish(struct world_mesh *mesh);
/* The payload of any description; freed with free(). */
unsigned char *world_payload(const struct build_input *input, uint64_t *ret_size);
/* An item for it at `offset` of its source. */
struct control_item world_item(const struct build_input *input, uint64_t size, enum control_source source,
                               uint64_t offset);
/* BUILD of one mesh, inline. */
void world_build_mesh(struct world_client *client, uint64_t request, const struct world_mesh *mesh);
/* The event's bytes are those that are built in process. */
void world_check_bytes(const struct world_event *event, const struct build_input *input);

/* Open descriptors of the process. */
int world_descriptors(void);
/* Waits until there are so many: what clients sent is closed by other threads, a moment later. */
void world_await_descriptors(int count);

#endif
