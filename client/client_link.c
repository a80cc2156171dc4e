/* SPDX-License-Identifier: Apache-2.0 */
#include "client/client_link.h"

#include "client/client_batch.h"
#include "client/client_deadline.h"
#include "client/client_wait.h"
#include "client/search.h"

enum { FIRST_BACKOFF_MS = 5, MAX_BACKOFF_MS = 100, STARVED_MS = 5 };

struct connection *client_link_open(const struct bvhd_client *client)
{
    return client->current && client->current->state == CONNECTION_OPEN ? client->current : NULL;
}

static bool is_wanted(const struct bvhd_client *client)
{
    return client->queue || client->wanted > 0;
}

static void give_up(struct bvhd_client *client, const struct bvhd_error *error)
{
    client->failures++;
    while (client->queue)
        client_batch_fail_unsent(client->queue, error);
    client_stir(client);
}

static void try_later(struct bvhd_client *client, uint64_t now)
{
    uint32_t twice = client->backoff_ms * 2;
    client->backoff_ms = twice < FIRST_BACKOFF_MS ? FIRST_BACKOFF_MS : twice > MAX_BACKOFF_MS ? MAX_BACKOFF_MS : twice;
    client->retry_at = library_after(now, client->backoff_ms);
}

/* Fails what a batch has not sent, or builds it in this process. */
static void end_search(struct bvhd_batch *batch, const struct bvhd_error *error)
{
    if (batch->client->local.policy == BVHD_LOCAL_IF_NO_DAEMON)
        local_builds_take(batch);
    else
        client_batch_fail_unsent(batch, error);
}

/*
 * Nobody listens. That is final where no socket was named, unless a daemon has just left: its successor may come. On a
 * named socket a daemon may be about to listen, and what cannot be built here waits for it.
 */
static void find_nobody(struct bvhd_client *client, uint64_t now)
{
    struct bvhd_error error = client->last_error;
    if (client->local.policy == BVHD_LOCAL_IF_NO_DAEMON)
        local_builds_take_all(client);
    if (client->address.is_named || client->leaving)
        try_later(client, now);
    else
        give_up(client, &error);
}

void client_link_connect(struct bvhd_client *client, uint64_t now)
{
    if (client->current || !is_wanted(client) || now < client->retry_at)
        return;
    enum bvhd_status status = search_connect(&client->address, now, &client->current, &client->last_error);
    client_stir(client);
    if (status == BVHD_OK)
        return;
    struct bvhd_error error = client->last_error;
    if (status == BVHD_UNAVAILABLE)
        find_nobody(client, now);
    else
        try_later(client, now);
    if (status != BVHD_UNAVAILABLE && status != BVHD_BUSY)
        give_up(client, &error);
}

void client_link_end(struct bvhd_client *client, struct connection *connection, struct exchange *exchange)
{
    for (uint32_t i = 0; i < exchange->count; i++)
        placement_release(&client->placement, &exchange->entries[i].held);
    if (exchange->batch)
        exchange->batch->exchanges--;
    exchange_table_remove(&connection->table, exchange);
    exchange_destroy(exchange);
}

static void fail_exchange(struct exchange *exchange, const struct bvhd_error *error)
{
    for (uint32_t i = 0; exchange->batch && i < exchange->count; i++)
        if (!exchange->entries[i].answered && !exchange->entries[i].cancelled)
            client_batch_fail_item(exchange->batch, exchange->entries[i].item, error);
    if (exchange->waiter) {
        exchange->waiter->error = *error;
        exchange->waiter->done = true;
    }
}

/* Returns the error that the program sees for the loss of a connection. */
static struct bvhd_error outward(const struct bvhd_error *error)
{
    struct bvhd_error told = *error;
    bool is_named = error->status == BVHD_NO_MEMORY || error->status == BVHD_INCOMPATIBLE;
    told.status = is_named ? error->status : BVHD_UNAVAILABLE;
    told.vuid = BVHD_VUID_NONE;
    return told;
}

void client_link_lose(struct bvhd_client *client, struct connection *connection, const struct bvhd_error *error)
{
    struct bvhd_error told = outward(error);
    bool is_current = connection == client->current;
    bool try_again =
        connection->state == CONNECTION_HELLO && (error->status == BVHD_UNAVAILABLE || error->status == BVHD_BUSY);
    if (is_current)
        client->current = NULL;
    else
        client->leaving = NULL;
    connection_silence(connection);
    for (uint32_t i = 0; i < connection->table.capacity; i++) {
        struct exchange *exchange = connection->table.slots[i];
        if (!exchange)
            continue;
        fail_exchange(exchange, &told);
        client_link_end(client, connection, exchange);
    }
    client_wait_forget(client, connection);
    connection_destroy(connection);
    client_stir(client);
    if (!is_current)
        return;
    client->last_error = told;
    if (try_again)
        try_later(client, clock_ns());
    else
        give_up(client, &told);
}

void client_link_leave(struct bvhd_client *client, struct connection *connection, uint64_t now)
{
    if (connection->state == CONNECTION_LEAVING)
        return;
    if (client->leaving) {
        struct bvhd_error error;
        bvhd_error_set(&error, BVHD_UNAVAILABLE, "connection", "the daemon took too long to leave");
        client_link_lose(client, client->leaving, &error);
    }
    connection->state = CONNECTION_LEAVING;
    client->leaving = connection;
    client->current = NULL;
    client->retry_at = now;
    for (struct bvhd_batch *batch = client->queue; batch; batch = batch->next)
        batch->connect_by = now + client->connect_timeout;
    client_stir(client);
}

void client_link_tidy(struct bvhd_client *client)
{
    struct connection *connection = client->leaving;
    if (!connection || connection->table.count > 0)
        return;
    client->leaving = NULL;
    client_wait_forget(client, connection);
    connection_destroy(connection);
    client_stir(client);
}

static void lose_silent(struct bvhd_client *client, struct connection *connection, const char *text)
{
    struct bvhd_error error;
    bvhd_error_set(&error, BVHD_UNAVAILABLE, "connection", "%s", text);
    client_link_lose(client, connection, &error);
}

/*
 * Anything that the daemon sends proves that it lives. After half of lost_after without a byte a PING is sent, and the
 * daemon has the other half to answer.
 */
static void check_silence(struct bvhd_client *client, struct connection *connection, uint64_t now)
{
    uint64_t quiet = client->lost_after / 2;
    if (connection->state == CONNECTION_HELLO) {
        if (now - connection->opened_at >= client->connect_timeout)
            lose_silent(client, connection, "the daemon does not answer HELLO");
    } else if (connection->table.count > 0 && connection->pinged_at == 0 && now - connection->heard_at >= quiet) {
        connection_ask(connection, FRAME_PING, (struct bytes){NULL, 0}, NULL, now);
        connection->pinged_at = now;
    } else if (connection->table.count > 0 && connection->pinged_at > 0 &&
               now - connection->pinged_at >= client->lost_after - quiet) {
        lose_silent(client, connection, "the daemon is silent");
    }
}

static void expire(struct bvhd_client *client, uint64_t now)
{
    struct bvhd_error error = client->last_error;
    if (error.status == BVHD_OK)
        bvhd_error_set(&error, BVHD_UNAVAILABLE, client->address.places[0].path, "the daemon does not answer");
    error.status = BVHD_UNAVAILABLE;
    for (struct bvhd_batch *batch = client->queue, *next; batch; batch = next) {
        next = batch->next;
        if (now >= batch->connect_by)
            end_search(batch, &error);
    }
}

void client_link_check(struct bvhd_client *client, uint64_t now)
{
    if (client->leaving)
        check_silence(client, client->leaving, now);
    if (client->current)
        check_silence(client, client->current, now);
    if (!client_link_open(client))
        expire(client, now);
}

static uint64_t earlier(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

static uint64_t connection_deadline(const struct bvhd_client *client, const struct connection *connection)
{
    uint64_t deadline = LIBRARY_NEVER, quiet = client->lost_after / 2;
    if (connection->state == CONNECTION_HELLO)
        deadline = connection->opened_at + client->connect_timeout;
    else if (connection->table.count > 0)
        deadline =
            connection->pinged_at ? connection->pinged_at + client->lost_after - quiet : connection->heard_at + quiet;
    if (connection->busy_until)
        deadline = earlier(deadline, connection->busy_until);
    if (connection->is_starved)
        deadline = earlier(deadline, library_after(clock_ns(), STARVED_MS));
    return deadline;
}

uint64_t client_link_deadline(const struct bvhd_client *client)
{
    uint64_t deadline = client->leaving ? connection_deadline(client, client->leaving) : LIBRARY_NEVER;
    if (client->current)
        deadline = earlier(deadline, connection_deadline(client, client->current));
    else if (is_wanted(client))
        deadline = earlier(deadline, client->retry_at);
    for (struct bvhd_batch *batch = client->queue; batch && !client_link_open(client); batch = batch->next)
        deadline = earlier(deadline, batch->connect_by);
    return earlier(deadline, client_deadline_next(client));
}
