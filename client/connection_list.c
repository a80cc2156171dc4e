/* SPDX-License-Identifier: Apache-2.0 */
#include "client/connection_list.h"

#include "client/library.h"

struct bvhd_connections {
    struct control_client_list *message; /* has the texts */
    struct bvhd_connection rows[];
};

static struct bvhd_connection row_of(const struct control_client *client)
{
    return (struct bvhd_connection){
        .number = client->connection,
        .uid = client->uid,
        .pid = client->pid,
        .connected_ms = client->connected_ms,
        .busy_ms = client->busy_ms,
        .memory_bytes = client->memory_bytes,
        .result_bytes = client->result_bytes,
        .pool_bytes = client->pool_bytes,
        .requests = client->requests,
        .items = client->items,
        .waiting = client->waiting,
        .threads = client->threads,
        .descriptors = client->descriptors,
        .software = client->software,
    };
}

struct bvhd_connections *connection_list_create(struct control_client_list *message)
{
    struct bvhd_connections *connections =
        memory_alloc(&library_memory, sizeof *connections + (uint64_t)message->count * sizeof *connections->rows);
    if (!connections) {
        memory_free(&library_memory, message);
        return NULL;
    }
    connections->message = message;
    for (uint32_t i = 0; i < message->count; i++)
        connections->rows[i] = row_of(&message->clients[i]);
    return connections;
}

uint32_t bvhd_connections_count(const struct bvhd_connections *connections)
{
    return connections ? connections->message->count : 0;
}

const struct bvhd_connection *bvhd_connections_get(const struct bvhd_connections *connections, uint32_t index)
{
    return connections && index < connections->message->count ? &connections->rows[index] : NULL;
}

uint32_t bvhd_connections_total(const struct bvhd_connections *connections)
{
    return connections ? connections->message->total : 0;
}

uint32_t bvhd_connections_hidden(const struct bvhd_connections *connections)
{
    return connections ? connections->message->hidden : 0;
}

void bvhd_connections_destroy(struct bvhd_connections *connections)
{
    if (!connections)
        return;
    memory_free(&library_memory, connections->message);
    memory_free(&library_memory, connections);
}
