/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/system/descriptor_share.h"

#include <assert.h>
#include <stdlib.h>

/* Every share there is. Global, because descriptors belong to the process. */
static struct descriptor_share *all;

/* The acquire pairs with the release of the last descriptor: what its thread read of the share was read before. */
static bool is_free(const struct descriptor_share *share)
{
    return share->holders == 0 && share->unread == 0 && atomic_load_explicit(&share->used, memory_order_acquire) == 0;
}

/* Returns the user's share, else one that is free, else NULL. */
static struct descriptor_share *find(const struct descriptors *descriptors, uint32_t uid)
{
    struct descriptor_share *free_one = NULL;
    for (struct descriptor_share *share = all; share; share = share->next) {
        if (is_free(share))
            free_one = share;
        else if (share->descriptors == descriptors && share->uid == uid)
            return share;
    }
    return free_one;
}

static struct descriptor_share *create(void)
{
    struct descriptor_share *share = calloc(1, sizeof *share);
    if (share) {
        share->next = all;
        all = share;
    }
    return share;
}

struct descriptor_share *descriptor_share_open(struct descriptors *descriptors, uint32_t uid)
{
    struct descriptor_share *share = find(descriptors, uid);
    if (!share)
        share = create();
    if (!share)
        return NULL;
    if (is_free(share)) {
        share->descriptors = descriptors;
        share->uid = uid;
    }
    share->holders++;
    return share;
}

void descriptor_share_close(struct descriptor_share *share)
{
    assert(share->holders > 0);
    share->holders--;
}

bool descriptor_share_has_room(const struct descriptor_share *share, uint32_t count)
{
    uint64_t used = atomic_load_explicit(&share->used, memory_order_relaxed);
    return used + count + DESCRIPTORS_RESERVE <= descriptors_left(share->descriptors);
}

void descriptor_share_add(struct descriptor_share *share, uint32_t count)
{
    atomic_fetch_add_explicit(&share->used, count, memory_order_relaxed);
}

static void subtract(struct descriptor_share *share, uint32_t count)
{
    uint32_t before = atomic_fetch_sub_explicit(&share->used, count, memory_order_release);
    assert(before >= count);
    (void)before;
}

void descriptor_share_give(struct descriptor_share *share, uint32_t count)
{
    descriptors_give(share->descriptors, count);
    subtract(share, count);
}

void descriptor_share_linger(struct descriptor_share *share)
{
    descriptors_linger();
    if (share)
        descriptors_give(share->descriptors, 1);
}

void descriptor_share_lingered(struct descriptor_share *share)
{
    descriptors_lingered();
    if (share)
        subtract(share, 1);
}

bool descriptor_share_send(struct descriptor_share *share)
{
    if (share->unread + 1 > descriptors_sendable(share->descriptors) || !descriptors_send(share->descriptors, 1))
        return false;
    share->unread++;
    return true;
}

void descriptor_share_read(struct descriptor_share *share, uint32_t count)
{
    descriptors_read(share->descriptors, count);
    share->unread -= count;
}
