/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/share.h"

#include <assert.h>
#include <stddef.h>

void share_join(struct share *share, struct share *parent)
{
    share->parent = parent;
    parent->members++;
}

void share_leave(struct share *share)
{
    if (!share->parent)
        return;
    for (int kind = 0; kind < SHARE_KINDS; kind++)
        assert(share->used[kind] == 0);
    share->parent->members--;
    share->parent = NULL;
}

uint64_t share_left(const struct share *share, enum share_kind kind)
{
    const struct share *parent = share->parent;
    if (!parent)
        return share->limit[kind];
    uint64_t whole = share_room(parent, kind), others = parent->used[kind] - share->used[kind];
    return whole > others ? whole - others : 0;
}

uint64_t share_room(const struct share *share, enum share_kind kind)
{
    const struct share *parent = share->parent;
    uint64_t left = share_left(share, kind);
    if (!parent)
        return left;
    uint64_t most = left - left / 4, part = share_room(parent, kind) / (parent->members + 1);
    return most > part ? most : part;
}

bool share_fits(const struct share *share, enum share_kind kind, uint64_t amount)
{
    for (; share; share = share->parent) {
        uint64_t room = share_room(share, kind);
        if (amount > room || share->used[kind] > room - amount)
            return false;
        if (kind == SHARE_ITEMS)
            break;
    }
    return true;
}

bool share_is_over(const struct share *share, enum share_kind kind)
{
    for (; share; share = share->parent)
        if (share->used[kind] > share_room(share, kind))
            return true;
    return false;
}

void share_take(struct share *share, enum share_kind kind, uint64_t amount)
{
    for (; share; share = share->parent)
        share->used[kind] += amount;
}

void share_give(struct share *share, enum share_kind kind, uint64_t amount)
{
    for (; share; share = share->parent) {
        assert(share->used[kind] >= amount);
        share->used[kind] -= amount;
    }
}
