/* SPDX-License-Identifier: Apache-2.0 */
/*
 * session_world.h - a service with real threads, and clients without sockets, for tests of the daemon's logic: frames
 * go in as structs, and replies are kept as a list of events.
 *
 * For test programs only: an unexpected failure fails the running test.
 */
#ifndef BVHD_SESSION_WORLD_H
#define BVHD_SESSION_WORLD_H

#include <semaphore.h>

#include "daemon/session/request.h"
#include "proto/wire/rows.h"
#include "daemon/session/session.h"
#include "daemon/session/session_internal.h"

enum { WORLD_CLIENTS = 16, WORLD_GATES = 64 };

/* A reply as the client sees it. Only the pointers that belong to its type are not NULL. */
struct world_event {
    enum frame_type type;
    uint64_t request;
    struct control_welcome *welcome;
    struct control_result *result;
    struct control_items *prepared;
    struct control_progress *progress;
    struct control_counters *counters;
    struct control_client_list *clients;
    struct control_cache_state *cache;
    struct control_busy *busy;
    struct bvhd_error *error;
    unsigned char *bytes; /* of a result */
};

struct world_client {
    struct session_world *world;
    struct session *session; /* NULL once it was closed */
    struct descriptor_share *share;
    struct memory memory;
    struct world_event *events;
    uint32_t event_count, event_capacity;
    struct reply *first_held, **end_held; /* replies that have not been reported by session_sent */
    bool hold; /* the client reads nothing, so no reply leaves */
    bool failed; /* the session has asked to end the connection */
};

/* A job that occupies a worker until it is opened. */
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
    int descriptors; /* of the process, open at the start */
};

/* The options of most tests: two workers, 256 MiB of memory, a cache of 64 MiB. */
struct service_options world_options(void);

/* `options`: NULL for world_options(). */
void world_init(struct session_world *world, const struct service_options *options);
/* Ends the world, and begins another one whose service has that much memory. */
void world_restart(struct session_world *world, uint64_t memory);

/* Closes everything, and checks that no items, memory or descriptors are left. */
void world_finish(struct session_world *world);

/* One iteration of the loop: collects what workers have done, and lets replies leave. */
void world_iterate(struct session_world *world);

/* Iterates until `reached` returns true; fails the test after 30 s. */
void world_await(struct session_world *world, bool (*reached)(void *context), void *context);

/* Iterates until no item of any client is under way. */
void world_settle(struct session_world *world);

/* Lets no build or update start until world_release_builds. */
static inline void world_hold_builds(struct session_world *world)
{
    struct admission *admission = &world->service->admission;
    admission_give(&admission->builds[ADMISSION_SMALL], admission->limit);
    admission_give(&admission->builds[ADMISSION_ALONE], 0); /* no large one starts beside it */
}

static inline void world_release_builds(struct session_world *world)
{
    struct admission *admission = &world->service->admission;
    admission_end(&admission->builds[ADMISSION_SMALL], admission->limit);
    admission_end(&admission->builds[ADMISSION_ALONE], 0);
}

/* Occupies one worker until world_open, and returns when it is occupied. */
struct world_gate *world_shut(struct session_world *world);
/* The worker's time counts for that flow. */
struct world_gate *world_shut_for(struct session_world *world, struct pool_flow *flow);
/* Releases the worker. */
void world_open(struct world_gate *gate);

/*
 * Adds a client. world_join and world_join_as also say HELLO; the silent ones do not, and may return NULL. The user is
 * 1000, unless it is given.
 */
struct world_client *world_join(struct session_world *world);
struct world_client *world_join_as(struct session_world *world, uint32_t uid);
struct world_client *world_join_silent(struct session_world *world);
struct world_client *world_join_silent_as(struct session_world *world, uint32_t uid);
void world_leave(struct world_client *client);

/* Gives a frame to the session, which takes the descriptors. */
enum bvhd_status world_send(struct world_client *client, const struct frame *frame, struct bvhd_error *error);

/* Send a frame of each type, correctly packed. */
enum bvhd_status world_say(struct world_client *client, enum frame_type type, uint64_t request,
                           struct bvhd_error *error);
void world_pool(struct world_client *client, uint64_t request, int descriptor, uint64_t size);
void world_build(struct world_client *client, uint64_t request, const struct control_build *build,
                 struct bytes inline_bytes, const int *descriptors);
void world_get(struct world_client *client, uint64_t request, const struct key *keys, uint32_t count);
enum bvhd_status world_cancel(struct world_client *client, uint64_t request, const uint32_t *items, uint32_t count);

/* Returns the event of that type and request, after skipping `skip` of them; NULL when there is none. */
const struct world_event *world_find(const struct world_client *client, enum frame_type type, uint64_t request,
                                     uint32_t skip);
/* Returns the only result of that item, or NULL. More than one fails the test. */
const struct world_event *world_result(const struct world_client *client, uint64_t request, uint32_t item);
/* Returns the status of the error in that result. */
enum bvhd_status world_status(const struct world_client *client, uint64_t request, uint32_t item);
/* Returns how often the item was reported as prepared. */
uint32_t world_prepared(const struct world_client *client, uint64_t request, uint32_t item);

/* Returns the counters of the service. */
struct counters world_counters(const struct session_world *world);

/* Iterates until that item has its result. */
const struct world_event *world_await_result(struct world_client *client, uint64_t request, uint32_t item);
/* Iterates until the item has that state. */
void world_await_state(struct world_client *client, uint64_t request, uint32_t item, enum item_state state);

/* Creates a memfd with these bytes and seals (F_SEAL_). SEALS_POOL is what a pool needs, SEALS_ONCE an attachment. */
int world_memfd(const void *bytes, uint64_t size, unsigned seals);
enum { WORLD_SEALS_POOL = 0x6, WORLD_SEALS_ONCE = 0xf };

/* Random triangles, which depend only on the seed, and their payload. */
struct world_mesh {
    struct geometry geometry;
    struct build_input input;
    float *vertices;
    unsigned char *payload;
    uint64_t size;
};

void world_mesh_init(struct world_mesh *mesh, uint32_t triangles, uint64_t seed);
void world_mesh_finish(struct world_mesh *mesh);
/* Makes the payload of any input; freed with free(). */
unsigned char *world_payload(const struct build_input *input, uint64_t *ret_size);
/* Makes an item for a payload at `offset` of its source. */
struct control_item world_item(const struct build_input *input, uint64_t size, enum control_source source,
                               uint64_t offset);
/* Sends a BUILD of one mesh, with its payload inline. */
void world_build_mesh(struct world_client *client, uint64_t request, const struct world_mesh *mesh);
/* Checks that the bytes of the event are equal to those that are built in process. */
void world_check_bytes(const struct world_event *event, const struct build_input *input);

/* Waits until that many descriptors are open: other threads close what clients sent, which may take a moment. */
void world_await_descriptors(int count);

#endif
