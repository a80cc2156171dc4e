/* SPDX-License-Identifier: Apache-2.0 */
/*
 * user.h - what belongs to a user before it belongs to one of the user's connections: shares of what the service has
 * (share.h), turns in the queues for memory (fair_queue.h), threads' time (pool.h).
 *
 * A user is a uid, as the kernel reports it. One exists while a session of that uid does. A member is one connection of
 * a user. Members whose results are too far ahead of what their clients read are held: none of their items starts. If
 * the members of a user are that together, none of its large items starts, and further ahead none at all. For the loop
 * thread only.
 */
#ifndef BVHD_USER_H
#define BVHD_USER_H

#include "daemon/pool/pool.h"
#include "daemon/service/memory_queue.h"
#include "daemon/service/share.h"
#include "proto/base/list.h"
#include "proto/base/memory.h"

struct user {
    uint32_t uid;
    uint32_t members;
    struct list_link link; /* in users->all */
    struct share share;
    struct memory_turns preparing, building;
    struct pool_flow *flow; /* around the flows of its members */
    uint64_t promised; /* bytes of results that its members may hold */
};

/* A connection's side of its user. It is a member of its owner's struct; zeroed means that it belongs to none. */
struct user_member {
    struct users *users;
    struct user *user;
    struct share share;
    struct memory_lanes preparing, building;
    struct pool_flow *flow;
    struct list_link held_link; /* in users->held, while its lanes for preparing are held */
    uint64_t promised; /* bytes of results that its client may hold */
};

struct users {
    /* filled before the first call */
    struct share root; /* with its limits */
    struct memory *memory;
    struct pool *pool;
    struct memory_queue *preparing;
    /* ---- its own ---- */
    struct list all;
    struct list held; /* members */
    bool freed; /* results were read or released since the last review */
};

/* Makes the connection a member of its user. On failure (BVHD_NO_MEMORY) it is none. */
enum bvhd_status user_join(struct users *users, uint32_t uid, struct user_member *member, struct bvhd_error *error);

/* The connection has ended: its jobs have no client any more. What workers still use of its shares stays counted. */
void user_end_flow(struct user_member *member);

/* Nothing of the member's shares may be in use, and nothing of it may wait. */
void user_leave(struct user_member *member);

bool user_fits(const struct user_member *member, enum share_kind kind, uint64_t amount);

/*
 * Count in the member's shares. With SHARE_AHEAD they also decide whether the member and its user are held. Others
 * that are held may be released by what one gives back: users_review decides about them.
 */
void user_take(struct user_member *member, enum share_kind kind, uint64_t amount);
void user_give(struct user_member *member, enum share_kind kind, uint64_t amount);

/*
 * Promises a member that its client may hold results: the part 1 / `divisor` of what the user has room for beside what
 * was promised to its other members, which is returned, and is not 0. So however many connections a user has, what they
 * may hold does not keep the user from more. A divisor of 0 takes the promise back, and returns 0.
 */
uint64_t user_promise(struct user_member *member, uint32_t divisor);

/* Decides again about a member that gets something to do. */
void user_review(struct user_member *member);

/* Releases all that are held and need not be any more. To be called before waiting steps are started. */
void users_review(struct users *users);

#endif
