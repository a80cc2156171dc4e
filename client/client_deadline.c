/* SPDX-License-Identifier: Apache-2.0 */
#include "client/client_deadline.h"

#include "client/client_batch.h"
#include "proto/base/container_of.h"

static struct bvhd_batch *batch_of(struct list_link *link)
{
    return link ? container_of(link, struct bvhd_batch, timed) : NULL;
}

uint64_t client_deadline_of(const struct bvhd_batch *batch)
{
    return batch->deadline_ms > 0 ? library_after(batch->submitted_at, batch->deadline_ms) : LIBRARY_NEVER;
}

/* The list is sorted. Most programs use one deadline for all of their batches, whose place is at the end. */
void client_deadline_add(struct bvhd_batch *batch)
{
    struct list *list = &batch->client->timed;
    struct list_link *before = list->last;
    if (batch->deadline_ms == 0 || batch->remaining == 0)
        return;
    while (before && client_deadline_of(batch_of(before)) > client_deadline_of(batch))
        before = before->previous;
    list_insert_after(list, before, &batch->timed);
    batch->is_timed = true;
}

void client_deadline_remove(struct bvhd_batch *batch)
{
    if (batch->is_timed)
        list_remove(&batch->client->timed, &batch->timed);
    batch->is_timed = false;
}

uint32_t client_deadline_left_ms(const struct bvhd_batch *batch, uint64_t now)
{
    uint64_t deadline = client_deadline_of(batch);
    if (deadline == LIBRARY_NEVER)
        return 0;
    return now + LIBRARY_MS < deadline ? (uint32_t)((deadline - now) / LIBRARY_MS) : 1;
}

void client_deadline_check(struct bvhd_client *client, uint64_t now)
{
    struct bvhd_batch *batch;
    while ((batch = batch_of(client->timed.first)) && now >= client_deadline_of(batch)) {
        struct bvhd_error error;
        bvhd_error_deadline(&error, batch->deadline_ms);
        client_batch_end(batch, &error);
    }
}

uint64_t client_deadline_next(const struct bvhd_client *client)
{
    struct bvhd_batch *first = batch_of(client->timed.first);
    return first ? client_deadline_of(first) : LIBRARY_NEVER;
}
