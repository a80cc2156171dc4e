/* SPDX-License-Identifier: Apache-2.0 */
#include "client/client.h"

#include "client/client_link.h"
#include "client/client_wait.h"
#include "client/incoming.h"
#include "client/outgoing.h"

#define DEFAULT_CONNECT_TIMEOUT_MS 5000
#define DEFAULT_LOST_AFTER_MS 10000
#define MAX_POOL_SIZE (UINT64_C(64) << 20)

void client_look(struct bvhd_client *client)
{
    uint64_t now = clock_ns();
    incoming_receive(client, now);
    client_link_check(client, now);
}

void client_advance(struct bvhd_client *client)
{
    client_look(client);
    client_link_connect(client, clock_ns());
    outgoing_pump(client);
    client_link_tidy(client);
}

static uint64_t ns_or(uint32_t ms, uint32_t standard)
{
    return (ms ? ms : standard) * LIBRARY_MS;
}

enum bvhd_status bvhd_client_create(const struct bvhd_client_options *options, struct bvhd_client **ret_client,
                                    struct bvhd_error *ret_error)
{
    static const struct bvhd_client_options standard = {.struct_size = sizeof standard};
    if (!options)
        options = &standard;
    if (options->struct_size < sizeof *options)
        return bvhd_error_set(ret_error, BVHD_INVALID, "options.struct_size",
                              "%zu bytes instead of sizeof(struct bvhd_client_options)", options->struct_size);
    struct bvhd_client *client = memory_alloc(&library_memory, sizeof *client);
    if (!client)
        return bvhd_error_no_memory(ret_error, "client", "no memory for it");
    *client = (struct bvhd_client){
        .connect_timeout = ns_or(options->connect_timeout_ms, DEFAULT_CONNECT_TIMEOUT_MS),
        .lost_after = ns_or(options->lost_after_ms, DEFAULT_LOST_AFTER_MS),
        .random = (uint32_t)clock_ns(),
    };
    uint64_t pool_size = options->pool_size && options->pool_size < MAX_POOL_SIZE ? options->pool_size : MAX_POOL_SIZE;
    placement_init(&client->placement, &library_memory, pool_size);
    enum bvhd_status status = BVHD_OK;
    if (!address_init(&client->address, options->socket_path))
        status = bvhd_error_no_memory(ret_error, "client", "no memory for it");
    if (status == BVHD_OK)
        status = client_wait_init(client, ret_error);
    if (status == BVHD_OK) {
        *ret_client = client;
        return BVHD_OK;
    }
    address_finish(&client->address);
    memory_free(&library_memory, client);
    return status;
}

void bvhd_client_destroy(struct bvhd_client *client)
{
    if (!client)
        return;
    struct bvhd_error error;
    bvhd_error_set(&error, BVHD_CANCELLED, "client", "destroyed");
    client_lock(client);
    if (client->leaving)
        client_link_lose(client, client->leaving, &error);
    if (client->current)
        client_link_lose(client, client->current, &error);
    client_unlock(client);
    placement_finish(&client->placement);
    address_finish(&client->address);
    client_wait_finish(client);
    memory_free(&library_memory, client);
}

int bvhd_client_descriptor(const struct bvhd_client *client)
{
    struct bvhd_client *own = (struct bvhd_client *)(uintptr_t)client;
    client_lock(own);
    if (!own->wakeups.has_loop)
        client_stir(own); /* changes before this moment were not signalled */
    own->wakeups.has_loop = true;
    client_unlock(own);
    return client->wakeups.epoll;
}

void bvhd_client_dispatch(struct bvhd_client *client)
{
    client_lock(client);
    client_wait_heard(client);
    client_advance(client);
    client_unlock_dispatched(client);
}
