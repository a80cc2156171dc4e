/* SPDX-License-Identifier: Apache-2.0 */
#include "client/callback.h"

#include "client/client_batch.h"
#include "client/client_wait.h"

void callback_init(struct callbacks *callbacks)
{
    *callbacks = (struct callbacks){.first = NULL};
    pthread_cond_init(&callbacks->returned, NULL);
}

void callback_finish(struct callbacks *callbacks)
{
    pthread_cond_destroy(&callbacks->returned);
}

void callback_add(struct bvhd_batch *batch)
{
    struct callbacks *callbacks = &batch->client->callbacks;
    if (!batch->callback || batch->has_called)
        return;
    batch->has_called = true;
    batch->next_called = NULL;
    if (callbacks->first)
        callbacks->last->next_called = batch;
    else
        callbacks->first = batch;
    callbacks->last = batch;
    client_stir(batch->client);
}

static void remove_batch(struct callbacks *callbacks, const struct bvhd_batch *batch)
{
    struct bvhd_batch *before = NULL;
    for (struct bvhd_batch *at = callbacks->first; at; before = at, at = at->next_called) {
        if (at != batch)
            continue;
        if (before)
            before->next_called = at->next_called;
        else
            callbacks->first = at->next_called;
        if (callbacks->last == at)
            callbacks->last = before;
        return;
    }
}

static void remove_call(struct callbacks *callbacks, const struct callback_call *call)
{
    struct callback_call **at = &callbacks->running;
    while (*at != call)
        at = &(*at)->next;
    *at = call->next;
}

/* Afterwards the batch may be gone. */
static void call_first(struct bvhd_client *client)
{
    struct callbacks *callbacks = &client->callbacks;
    struct bvhd_batch *batch = callbacks->first;
    struct callback_call call = {callbacks->running, batch, pthread_self()};
    bvhd_batch_callback callback = batch->callback;
    void *user = batch->user;
    callbacks->running = &call;
    remove_batch(callbacks, batch);
    client_unlock(client);
    callback(batch, user);
    client_lock(client);
    remove_call(callbacks, &call);
    pthread_cond_broadcast(&callbacks->returned);
}

bool callback_run(struct bvhd_client *client)
{
    bool any = client->callbacks.first != NULL;
    while (client->callbacks.first)
        call_first(client);
    return any;
}

/* Returns whether another thread is in the batch's function; what this thread is in is forgotten. */
static bool is_called_elsewhere(const struct callbacks *callbacks, const struct bvhd_batch *batch)
{
    bool elsewhere = false;
    for (struct callback_call *call = callbacks->running; call; call = call->next) {
        if (call->batch != batch)
            continue;
        if (pthread_equal(call->thread, pthread_self()))
            call->batch = NULL;
        else
            elsewhere = true;
    }
    return elsewhere;
}

void callback_forget(struct bvhd_batch *batch)
{
    struct bvhd_client *client = batch->client;
    batch->callback = NULL;
    remove_batch(&client->callbacks, batch);
    while (is_called_elsewhere(&client->callbacks, batch))
        pthread_cond_wait(&client->callbacks.returned, &client->lock);
}

void bvhd_batch_set_callback(struct bvhd_batch *batch, bvhd_batch_callback callback, void *user)
{
    if (!batch)
        return;
    struct bvhd_client *client = batch->client;
    client_lock(client);
    remove_batch(&client->callbacks, batch);
    batch->callback = callback;
    batch->user = user;
    batch->has_called = false;
    if (batch->remaining == 0)
        callback_add(batch);
    client_unlock(client);
}

void *bvhd_batch_user(struct bvhd_batch *batch)
{
    if (!batch)
        return NULL;
    client_lock(batch->client);
    void *user = batch->user;
    client_unlock(batch->client);
    return user;
}
