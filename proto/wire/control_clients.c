/* SPDX-License-Identifier: Apache-2.0 */
/* The control messages that list the daemon's clients: CLIENTS, CLIENT_LIST. */
#include "proto/wire/control_codec.h"

#include "proto/wire/bvhd.pb-c.h"
#include "proto/wire/rows.h"

/*
 * A client in its wire format. Later versions may append fields: a reader skips what it does not know. PROTOCOL.md has
 * the table.
 */
struct client_row {
    uint64_t connection;
    uint32_t uid;
    int32_t pid;
    uint64_t connected_ms, busy_ms;
    uint64_t memory_bytes, result_bytes, pool_bytes;
    uint32_t requests, items, waiting, threads, descriptors;
    uint32_t reserved;
    char software[CONTROL_NAME_SIZE]; /* ends in NUL */
};

_Static_assert(sizeof(struct client_row) == 144, "wire format");

enum bvhd_status control_pack_clients(const struct control_clients *clients, struct memory *memory,
                                      struct bytes *ret_bytes, struct bvhd_error *error)
{
    Bvhd__Clients message;
    bvhd__clients__init(&message);
    message.all = clients->all;
    return control_encode(&message.base, memory, ret_bytes, error);
}

static void fill_clients(const void *from, void *ret_plain)
{
    const Bvhd__Clients *message = from;
    struct control_clients *clients = ret_plain;
    clients->all = message->all != 0;
}

static const struct control_kind clients_kind = {"clients", &bvhd__clients__descriptor, sizeof(struct control_clients),
                                                 NULL, fill_clients};
CONTROL_UNPACK(clients, struct control_clients)

static struct client_row client_to_row(const struct control_client *client)
{
    struct client_row row = {
        .connection = client->connection,
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
    };
    control_copy_text(client->software, sizeof row.software, row.software);
    return row;
}

static struct control_client row_to_client(struct client_row *row)
{
    struct control_client client = {
        .connection = row->connection,
        .uid = row->uid,
        .pid = row->pid,
        .connected_ms = row->connected_ms,
        .busy_ms = row->busy_ms,
        .memory_bytes = row->memory_bytes,
        .result_bytes = row->result_bytes,
        .pool_bytes = row->pool_bytes,
        .requests = row->requests,
        .items = row->items,
        .waiting = row->waiting,
        .threads = row->threads,
        .descriptors = row->descriptors,
    };
    row->software[sizeof row->software - 1] = 0;
    control_copy_text(row->software, sizeof client.software, client.software);
    return client;
}

enum bvhd_status control_pack_client_list(const struct control_client_list *list, struct memory *memory,
                                          struct bytes *ret_bytes, struct bvhd_error *error)
{
    if (list->count > CONTROL_MAX_CLIENTS)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "client_list.clients", "%u, over %u", list->count,
                              CONTROL_MAX_CLIENTS);
    struct client_row *rows = memory_array(memory, list->count, sizeof *rows);
    if (list->count > 0 && !rows)
        return bvhd_error_no_memory(error, "client_list.clients", "%u clients", list->count);
    for (uint32_t i = 0; i < list->count; i++)
        rows[i] = client_to_row(&list->clients[i]);
    Bvhd__ClientList message;
    bvhd__client_list__init(&message);
    message.client_size = list->count > 0 ? sizeof *rows : 0;
    message.clients = (ProtobufCBinaryData){list->count * sizeof *rows, (uint8_t *)rows};
    message.total = list->total;
    message.hidden = list->hidden;
    enum bvhd_status status = control_encode(&message.base, memory, ret_bytes, error);
    memory_free(memory, rows);
    return status;
}

static enum bvhd_status check_client_list(const void *from, uint64_t *ret_extra, struct bvhd_error *error)
{
    const Bvhd__ClientList *message = from;
    uint64_t bytes = message->clients.len;
    uint32_t size = message->client_size;
    *ret_extra = 0;
    if (bytes == 0)
        return BVHD_OK;
    if (size < sizeof(struct client_row) || bytes % size != 0)
        return bvhd_error_set(error, BVHD_CORRUPT, "client_list.clients", "%llu bytes in rows of %u",
                              (unsigned long long)bytes, size);
    if (size > ROWS_MAX_SIZE || bytes / size > CONTROL_MAX_CLIENTS)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "client_list.clients", "%llu rows of %u bytes",
                              (unsigned long long)(bytes / size), size);
    *ret_extra = bytes / size * sizeof(struct control_client);
    return BVHD_OK;
}

static void fill_client_list(const void *from, void *ret_plain)
{
    const Bvhd__ClientList *message = from;
    struct control_client_list *list = ret_plain;
    list->total = message->total;
    list->hidden = message->hidden;
    list->clients = (struct control_client *)(list + 1);
    list->count = message->clients.len > 0 ? (uint32_t)(message->clients.len / message->client_size) : 0;
    for (uint32_t i = 0; i < list->count; i++) {
        struct client_row row;
        memcpy(&row, message->clients.data + (uint64_t)i * message->client_size, sizeof row);
        list->clients[i] = row_to_client(&row);
    }
}

static const struct control_kind client_list_kind = {"client_list", &bvhd__client_list__descriptor,
                                                     sizeof(struct control_client_list), check_client_list,
                                                     fill_client_list};
CONTROL_UNPACK(client_list, struct control_client_list)
