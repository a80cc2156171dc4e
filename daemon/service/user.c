/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/user.h"

#include "proto/base/container_of.h"

static struct user *member_of(struct list_link *link)
{
    return container_of(link, struct user, link);
}

static struct user *find(struct users *users, uint32_t uid)
{
    for (struct list_link *link = users->all.first; link; link = link->next)
        if (member_of(link)->uid == uid)
            return member_of(link);
    return NULL;
}

static void destroy(struct users *users, struct user *user)
{
    pool_flow_end(users->pool, user->flow);
    share_leave(&user->share);
    list_remove(&users->all, &user->link);
    memory_free(users->memory, user);
}

static struct user *create(struct users *users, uint32_t uid)
{
    struct user *user = memory_alloc(users->memory, sizeof *user);
    struct pool_flow *flow = user ? pool_flow_create(users->pool, NULL) : NULL;
    if (!flow) {
        memory_free(users->memory, user);
        return NULL;
    }
    *user = (struct user){.uid = uid, .flow = flow};
    share_join(&user->share, &users->root);
    list_prepend(&users->all, &user->link);
    return user;
}

enum bvhd_status user_join(struct users *users, uint32_t uid, struct user_member *member, struct bvhd_error *error)
{
    struct user *user = find(users, uid);
    if (!user)
        user = create(users, uid);
    struct pool_flow *flow = user ? pool_flow_create(users->pool, user->flow) : NULL;
    if (!flow) {
        if (user && user->members == 0)
            destroy(users, user);
        return bvhd_error_no_memory(error, "", "no memory for another client");
    }
    *member = (struct user_member){.users = users, .user = user, .flow = flow};
    user->members++;
    share_join(&member->share, &user->share);
    memory_lanes_share(&member->preparing, &user->preparing);
    memory_lanes_share(&member->building, &user->building);
    return BVHD_OK;
}

void user_end_flow(struct user_member *member)
{
    pool_flow_end(member->users->pool, member->flow);
    member->flow = NULL;
}

static void hold_member(struct user_member *member, bool held)
{
    struct users *users = member->users;
    if (memory_lanes_are_held(&member->preparing) == held)
        return;
    memory_queue_hold(users->preparing, &member->preparing, held);
    if (held)
        list_append(&users->held, &member->held_link);
    else
        list_remove(&users->held, &member->held_link);
}

void user_leave(struct user_member *member)
{
    struct user *user = member->user;
    hold_member(member, false);
    share_leave(&member->share);
    if (--user->members == 0)
        destroy(member->users, user);
    member->user = NULL;
}

bool user_fits(const struct user_member *member, enum share_kind kind, uint64_t amount)
{
    return share_fits(&member->share, kind, amount);
}

/*
 * Small steps of a user start even while its large results are too far ahead, until nothing is left: a connection that
 * reads what it gets is not stopped at once by others of its user that do not. A newcomer does not get an equal part
 * of results that others do not give back, since the sum of such parts has no limit. It always gets one result.
 */
static void review_user(struct users *users, struct user *user)
{
    uint64_t used = user->share.used[SHARE_AHEAD], left = share_left(&user->share, SHARE_AHEAD);
    memory_queue_hold_turns(users->preparing, ADMISSION_LARGE, &user->preparing, used > left - left / 4);
    memory_queue_hold_turns(users->preparing, ADMISSION_SMALL, &user->preparing, used > left);
}

void user_review(struct user_member *member)
{
    const struct share *share = &member->share;
    hold_member(member, share->used[SHARE_AHEAD] > share_room(share, SHARE_AHEAD));
    review_user(member->users, member->user);
}

void user_take(struct user_member *member, enum share_kind kind, uint64_t amount)
{
    share_take(&member->share, kind, amount);
    if (kind == SHARE_AHEAD)
        user_review(member);
}

void user_give(struct user_member *member, enum share_kind kind, uint64_t amount)
{
    share_give(&member->share, kind, amount);
    if (kind != SHARE_AHEAD || amount == 0)
        return;
    user_review(member);
    member->users->freed = true;
}

uint64_t user_promise(struct user_member *member, uint32_t divisor)
{
    struct user *user = member->user;
    user->promised -= member->promised;
    uint64_t room = share_room(&user->share, SHARE_RESULTS);
    uint64_t left = room > user->promised ? room - user->promised : 0;
    member->promised = divisor > 0 ? left / divisor + 1 : 0;
    user->promised += member->promised;
    return member->promised;
}

void users_review(struct users *users)
{
    if (!users->freed)
        return;
    users->freed = false;
    for (struct list_link *link = users->all.first; link; link = link->next)
        review_user(users, member_of(link));
    for (struct list_link *link = users->held.first, *next; link; link = next) {
        next = link->next;
        user_review(container_of(link, struct user_member, held_link));
    }
}
