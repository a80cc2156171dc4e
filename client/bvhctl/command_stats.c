/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>

#include "client/bvhctl/commands.h"
#include "client/bvhctl/service/connect.h"
#include "client/bvhctl/service/counters_view.h"

static bool print_counters(const struct options *options, const struct bvhd_counters *counters, struct memory *memory)
{
    struct json json;
    if (!options->json) {
        counters_view_print(counters);
        printf("\n");
        for (uint32_t i = 0; i < bvhd_counters_count(counters); i++)
            printf("%-24s %llu\n", bvhd_counters_name(counters, i),
                   (unsigned long long)bvhd_counters_value(counters, i));
        return report_flush();
    }
    json_init(&json, memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    counters_view_write(counters, &json);
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

static int timeout(const struct options *options)
{
    return (int)options->connect_timeout_ms;
}

enum exit_code command_stats(const struct options *options)
{
    struct memory memory;
    struct connect connect = {0};
    struct bvhd_counters *counters = NULL;
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = connect_find(options, &memory, &connect, &error);
    if (status == BVHD_OK)
        status = bvhd_client_counters(connect.client, timeout(options), &counters, &error);
    enum exit_code code;
    if (status != BVHD_OK)
        code = report_failure(options->json, "stats", &error);
    else
        code = print_counters(options, counters, &memory) ? EXIT_DONE : EXIT_FAILED;
    bvhd_counters_destroy(counters);
    connect_close(&connect);
    return code;
}

static bool print_ping(const struct options *options, const struct connect *connect, double ms, struct memory *memory)
{
    struct json json;
    if (!options->json) {
        printf("%s answers in %.3f ms%s\n", connect->path, ms, connect->is_private ? ": a private daemon" : "");
        return report_flush();
    }
    json_init(&json, memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    json_text(&json, "socket", connect->path);
    json_number(&json, "ms", ms);
    json_bool(&json, "private", connect->is_private);
    json_bool(&json, "started", connect->is_started);
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

enum exit_code command_ping(const struct options *options)
{
    struct memory memory;
    struct connect connect = {0};
    struct bvhd_error error;
    double ms = 0;
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = connect_find(options, &memory, &connect, &error);
    if (status == BVHD_OK)
        status = bvhd_client_ping(connect.client, timeout(options), &ms, &error);
    enum exit_code code;
    if (status != BVHD_OK)
        code = report_failure(options->json, "ping", &error);
    else
        code = print_ping(options, &connect, ms, &memory) ? EXIT_DONE : EXIT_FAILED;
    connect_close(&connect);
    return code;
}
