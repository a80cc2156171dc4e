/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/commands.h"
#include "client/bvhctl/service/connect.h"

static void write_counters(const struct bvhd_counters *counters, struct json *json)
{
    json_object(json, NULL);
    json_integer(json, "schema", 1);
    for (uint32_t i = 0; i < bvhd_counters_count(counters); i++)
        json_integer(json, bvhd_counters_name(counters, i), bvhd_counters_value(counters, i));
    json_object_end(json);
}

/* Returns the value of a counter, or 0 if this daemon does not have it. */
static uint64_t value_of(const struct bvhd_counters *counters, const char *name)
{
    for (uint32_t i = 0; i < bvhd_counters_count(counters); i++)
        if (!strcmp(bvhd_counters_name(counters, i), name))
            return bvhd_counters_value(counters, i);
    return 0;
}

static double megabytes(const struct bvhd_counters *counters, const char *name)
{
    return (double)value_of(counters, name) / 1e6;
}

static const char *plural(uint64_t count)
{
    return count == 1 ? "" : "s";
}

/* Prints the figures that matter most. */
static void print_summary(const struct bvhd_counters *counters)
{
    uint64_t hits = value_of(counters, "hits_memory") + value_of(counters, "hits_disk");
    uint64_t coalesced = value_of(counters, "coalesced"), misses = value_of(counters, "misses"),
             all = hits + coalesced + misses;
    uint64_t running = value_of(counters, "builds_running"), workers = value_of(counters, "workers"),
             connections = value_of(counters, "connections");
    printf("hits     %.1f %% of %llu structure%s; %llu waited for another's build, %llu %s new\n",
           all ? 100 * (double)hits / (double)all : 0, (unsigned long long)all, plural(all),
           (unsigned long long)coalesced, (unsigned long long)misses, misses == 1 ? "was" : "were");
    printf("queue    %llu under way, %llu build%s running, %llu worker%s, %llu connection%s\n",
           (unsigned long long)value_of(counters, "queue_depth"), (unsigned long long)running, plural(running),
           (unsigned long long)workers, plural(workers), (unsigned long long)connections, plural(connections));
    printf("memory   %.1f of %.1f MB; kept results %.1f of %.1f MB\n\n", megabytes(counters, "memory_live"),
           megabytes(counters, "memory_limit"), megabytes(counters, "cache_bytes"),
           megabytes(counters, "cache_budget"));
}

static bool print_counters(const struct options *options, const struct bvhd_counters *counters, struct memory *memory)
{
    struct json json;
    if (!options->json) {
        print_summary(counters);
        for (uint32_t i = 0; i < bvhd_counters_count(counters); i++)
            printf("%-24s %llu\n", bvhd_counters_name(counters, i),
                   (unsigned long long)bvhd_counters_value(counters, i));
        return report_flush();
    }
    json_init(&json, memory, false);
    write_counters(counters, &json);
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
