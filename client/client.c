/* SPDX-License-Identifier: Apache-2.0 */
#include "client/client.h"

#include "client/argument.h"
#include "client/client_deadline.h"
#include "client/client_link.h"
#include "client/client_wait.h"
#include "client/incoming.h"
#include "client/outgoing.h"

#define OPTIONS_WITHOUT_LOCAL offsetof(struct bvhd_client_options, local)
#define DEFAULT_CONNECT_TIMEOUT_MS 5000
#define DEFAULT_LOST_AFTER_MS 10000
#define MAX_POOL_SIZE (UINT64_C(64) << 20)

void client_look(struct bvhd_client *client)
{
    uint64_t now = clock_ns();
    incoming_receive(client, now);
    client_link_check(client, now);
    client_deadline_check(client, now);
}

void client_advance(struct bvhd_client *client)
{
    client_look(client);
    client_link_connect(client, clock_ns());
    outgoing_pump(client);
    local_builds_wake(client);
    client_link_tidy(client);
}

static uint64_t ns_or(uint32_t ms, uint32_t standard)
{
    return (ms ? ms : standard) * LIBRARY_MS;
}

/* Reads options of this version or an older one, whose fields that are missing count as 0. NULL is allowed. */
static enum bvhd_status read_options(const struct bvhd_client_options *options, struct bvhd_client_options *ret_options,
                                     struct bvhd_error *error)
{
    struct bvhd_client_options copy = {.struct_size = sizeof copy};
    size_t size = options ? options->struct_size : 0;
    size_t least = size == OPTIONS_WITHOUT_LOCAL ? size : sizeof copy;
    enum bvhd_status status =
        options ? argument_check_size(options, least, sizeof copy, "options", "bvhd_client_options", error) : BVHD_OK;
    if (status != BVHD_OK)
        return status;
    if (options)
        memcpy(&copy, options, size < sizeof copy ? size : sizeof copy);
    if ((unsigned)copy.local > BVHD_LOCAL_ALWAYS)
        return bvhd_error_set(error, BVHD_INVALID, "options.local", "%d is no value of enum bvhd_local",
                              (int)copy.local);
    *ret_options = copy;
    return BVHD_OK;
}

enum bvhd_status bvhd_client_create(const struct bvhd_client_options *options, struct bvhd_client **ret_client,
                                    struct bvhd_error *ret_error)
{
    struct bvhd_client_options given = {0};
    enum bvhd_status status = ARGUMENTS_CHECK(ret_error, {ret_client, "ret_client"});
    if (status == BVHD_OK)
        status = read_options(options, &given, ret_error);
    if (status != BVHD_OK)
        return status;
    options = &given;
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
    if (!address_init(&client->address, options->socket_path))
        status = bvhd_error_no_memory(ret_error, "client", "no memory for it");
    if (status == BVHD_OK)
        status = client_wait_init(client, ret_error);
    if (status == BVHD_OK) {
        local_builds_init(&client->local, options);
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
    local_builds_finish(client);
    placement_finish(&client->placement);
    address_finish(&client->address);
    client_wait_finish(client);
    memory_free(&library_memory, client);
}

int bvhd_client_descriptor(const struct bvhd_client *client)
{
    struct bvhd_client *own = (struct bvhd_client *)(uintptr_t)client;
    if (!client)
        return -1;
    client_lock(own);
    if (!own->wakeups.has_loop)
        client_stir(own); /* changes before this moment were not signalled */
    own->wakeups.has_loop = true;
    client_unlock(own);
    return client->wakeups.epoll;
}

void bvhd_client_dispatch(struct bvhd_client *client)
{
    if (!client)
        return;
    client_lock(client);
    client_wait_heard(client);
    client_advance(client);
    callback_run(client);
    client_unlock_dispatched(client);
}
