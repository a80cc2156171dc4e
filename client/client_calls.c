/* SPDX-License-Identifier: Apache-2.0 */
/* client_calls.c - the calls that wait for the daemon itself: connect, ping, counters, connections, caches. */
#include "client/argument.h"
#include "client/client_link.h"
#include "client/client_wait.h"

/* The state of one waiting call. */
struct waiting_call {
    struct bvhd_client *client;
    uint64_t failures; /* client->failures when the call began to look for a daemon */
    struct exchange_waiter waiter;
};

static bool is_decided(const void *context)
{
    const struct waiting_call *call = context;
    return client_link_open(call->client) || call->client->failures != call->failures;
}

static bool is_answered(const void *context)
{
    const struct waiting_call *call = context;
    return call->waiter.done;
}

/* Reports why there is no connection. */
static enum bvhd_status tell(const struct bvhd_client *client, struct bvhd_error *error)
{
    const struct bvhd_error *last = &client->last_error;
    if (last->status == BVHD_OK || last->status == BVHD_BUSY)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, client->address.places[0].path, "the daemon does not answer");
    return bvhd_error_set(error, last->status, last->where, "%s", last->text);
}

static enum bvhd_status await_connection(struct waiting_call *call, uint64_t moment, struct bvhd_error *error)
{
    struct bvhd_client *client = call->client;
    struct client_wait wait = {.is_true = is_decided, .context = call};
    if (client->local.policy == BVHD_LOCAL_ALWAYS)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, "options.local",
                              "this client uses no daemon, it always builds "
                              "in its own process");
    client_look(client); /* a connection that was lost before this call is not this call's failure */
    call->failures = client->failures;
    client->wanted++;
    client_advance(client);
    client_wait_until(client, moment, &wait);
    client->wanted--;
    return client_link_open(client) ? BVHD_OK : tell(client, error);
}

enum bvhd_status bvhd_client_connect(struct bvhd_client *client, struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {client, "client"});
    if (status != BVHD_OK)
        return status;
    client_lock(client);
    struct waiting_call call = {.client = client};
    status = await_connection(&call, clock_ns() + client->connect_timeout, ret_error);
    client_unlock(client);
    return status;
}

/* The thread waits no longer: an answer that comes later is dropped. */
static void forget(struct waiting_call *call)
{
    struct connection *connections[] = {call->client->current, call->client->leaving};
    for (int c = 0; c < 2; c++)
        for (uint32_t i = 0; connections[c] && i < connections[c]->table.capacity; i++)
            if (connections[c]->table.slots[i] && connections[c]->table.slots[i]->waiter == &call->waiter)
                connections[c]->table.slots[i]->waiter = NULL;
}

/*
 * Sends a request that consists of a control message, which is taken over, and waits for its answer, both within the
 * timeout.
 */
static enum bvhd_status ask(struct waiting_call *call, enum frame_type type, struct bytes control, int timeout_ms,
                            struct bvhd_error *error)
{
    struct bvhd_client *client = call->client;
    uint64_t now = clock_ns(), moment = library_after(now, timeout_ms), hope = now + client->connect_timeout;
    enum bvhd_status status = await_connection(call, moment < hope ? moment : hope, error);
    if (status != BVHD_OK) {
        memory_free(&library_memory, (void *)(uintptr_t)control.data);
        return status;
    }
    struct client_wait wait = {.is_true = is_answered, .context = call};
    if (!connection_ask(client_link_open(client), type, control, &call->waiter, clock_ns()))
        return bvhd_error_no_memory(error, "client", "no memory for a request");
    if (!client_wait_until(client, moment, &wait)) {
        forget(call);
        return bvhd_error_set(error, BVHD_UNAVAILABLE, "client", "no answer within %d ms", timeout_ms);
    }
    const struct bvhd_error *result = &call->waiter.error;
    return result->status == BVHD_OK ? BVHD_OK
                                     : bvhd_error_set(error, result->status, result->where, "%s", result->text);
}

static const struct bytes nothing;

enum bvhd_status bvhd_client_ping(struct bvhd_client *client, int timeout_ms, double *ret_ms,
                                  struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {client, "client"});
    if (status != BVHD_OK)
        return status;
    client_lock(client);
    struct waiting_call call = {.client = client};
    uint64_t start = clock_ns();
    status = ask(&call, FRAME_PING, nothing, timeout_ms, ret_error);
    uint64_t end = clock_ns();
    client_unlock(client);
    if (status == BVHD_OK && ret_ms)
        *ret_ms = (double)(end - start) / (double)LIBRARY_MS;
    return status;
}

enum bvhd_status bvhd_client_counters(struct bvhd_client *client, int timeout_ms, struct bvhd_counters **ret_counters,
                                      struct bvhd_error *ret_error)
{
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {client, "client"}, {ret_counters, "ret_counters"});
    if (status != BVHD_OK)
        return status;
    client_lock(client);
    struct waiting_call call = {.client = client};
    status = ask(&call, FRAME_STATS, nothing, timeout_ms, ret_error);
    client_unlock(client);
    if (status == BVHD_OK && !call.waiter.counters)
        status = bvhd_error_set(ret_error, BVHD_CORRUPT, "counters", "the daemon sent an error that is none");
    if (status == BVHD_OK)
        *ret_counters = call.waiter.counters;
    return status;
}

enum bvhd_status bvhd_client_connections(struct bvhd_client *client, uint32_t flags, int timeout_ms,
                                         struct bvhd_connections **ret_connections, struct bvhd_error *ret_error)
{
    const struct control_clients message = {.all = flags & BVHD_CONNECTIONS_ALL};
    struct bytes control;
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {client, "client"}, {ret_connections, "ret_connections"});
    if (status == BVHD_OK && (flags & ~(uint32_t)BVHD_CONNECTIONS_ALL) != 0)
        status = bvhd_error_set(ret_error, BVHD_INVALID, "flags", "%#x has bits that mean nothing", flags);
    if (status == BVHD_OK)
        status = control_pack_clients(&message, &library_memory, &control, ret_error);
    if (status != BVHD_OK)
        return status;
    client_lock(client);
    struct waiting_call call = {.client = client};
    status = ask(&call, FRAME_CLIENTS, control, timeout_ms, ret_error);
    client_unlock(client);
    if (status == BVHD_OK && !call.waiter.connections)
        status = bvhd_error_set(ret_error, BVHD_CORRUPT, "connections", "the daemon sent an error that is none");
    if (status == BVHD_OK)
        *ret_connections = call.waiter.connections;
    return status;
}

enum bvhd_status bvhd_client_cache(struct bvhd_client *client, enum bvhd_cache_action action, uint64_t bytes,
                                   int timeout_ms, struct bvhd_cache_state **ret_state, struct bvhd_error *ret_error)
{
    const struct control_cache message = {(uint32_t)action, action == BVHD_CACHE_TRIM ? bytes : 0};
    struct bytes control;
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {client, "client"}, {ret_state, "ret_state"});
    if (status == BVHD_OK && (uint32_t)action > BVHD_CACHE_CLEAR)
        status = bvhd_error_set(ret_error, BVHD_INVALID, "action", "%u is no action", (unsigned)action);
    if (status == BVHD_OK)
        status = control_pack_cache(&message, &library_memory, &control, ret_error);
    if (status != BVHD_OK)
        return status;
    client_lock(client);
    struct waiting_call call = {.client = client};
    status = ask(&call, FRAME_CACHE, control, timeout_ms, ret_error);
    client_unlock(client);
    if (status == BVHD_OK && !call.waiter.cache)
        status = bvhd_error_set(ret_error, BVHD_CORRUPT, "cache", "the daemon sent an error that is none");
    if (status == BVHD_OK)
        *ret_state = call.waiter.cache;
    return status;
}
