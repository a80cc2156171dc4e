/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>

#include "client/bvhctl/commands.h"
#include "client/bvhctl/service/connect.h"
#include "client/bvhctl/service/connections_view.h"

static bool print(const struct options *options, const struct bvhd_connections *connections, struct memory *memory)
{
    struct json json;
    if (!options->json) {
        connections_view_print(connections, UINT32_MAX);
        return report_flush();
    }
    json_init(&json, memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    connections_view_write(connections, &json);
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

enum exit_code command_clients(const struct options *options)
{
    struct memory memory;
    struct connect connect = {0};
    struct bvhd_connections *connections = NULL;
    struct bvhd_error error;
    uint32_t flags = options->all ? BVHD_CONNECTIONS_ALL : 0;
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = connect_find(options, &memory, &connect, &error);
    if (status == BVHD_OK)
        status = bvhd_client_connections(connect.client, flags, (int)options->connect_timeout_ms, &connections, &error);
    enum exit_code code;
    if (status != BVHD_OK)
        code = report_failure(options->json, "clients", &error);
    else
        code = print(options, connections, &memory) ? EXIT_DONE : EXIT_FAILED;
    bvhd_connections_destroy(connections);
    connect_close(&connect);
    return code;
}
