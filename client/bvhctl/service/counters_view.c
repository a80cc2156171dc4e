/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/service/counters_view.h"

#include <stdio.h>
#include <string.h>

typedef unsigned long long ull;

uint64_t counters_view_value(const struct bvhd_counters *counters, const char *name)
{
    for (uint32_t i = 0; i < bvhd_counters_count(counters); i++)
        if (!strcmp(bvhd_counters_name(counters, i), name))
            return bvhd_counters_value(counters, i);
    return 0;
}

static ull value(const struct bvhd_counters *counters, const char *name)
{
    return counters_view_value(counters, name);
}

static double megabytes(const struct bvhd_counters *counters, const char *name)
{
    return (double)value(counters, name) / 1e6;
}

static const char *plural(ull count)
{
    return count == 1 ? "" : "s";
}

/* Structures that were requested. */
static ull requested(const struct bvhd_counters *counters)
{
    return value(counters, "hits_memory") + value(counters, "hits_disk") + value(counters, "coalesced") +
           value(counters, "misses");
}

/* The share of structures that did not have to be built for the request, because there was a result. */
static double hit_ratio(const struct bvhd_counters *counters)
{
    ull all = requested(counters);
    return all ? (double)(value(counters, "hits_memory") + value(counters, "hits_disk")) / (double)all : 0;
}

static void print_daemon(const struct bvhd_counters *counters)
{
    const char *version = bvhd_counters_version(counters);
    ull seconds = value(counters, "uptime_ms") / 1000, workers = value(counters, "workers"),
        connections = value(counters, "connections");
    printf("bvhd     %s%sprocess %llu, up %llu d %llu:%02llu:%02llu, %llu worker%s, %llu connection%s\n", version,
           *version ? ", " : "", value(counters, "pid"), seconds / 86400, seconds / 3600 % 24, seconds / 60 % 60,
           seconds % 60, workers, plural(workers), connections, plural(connections));
}

static void print_work(const struct bvhd_counters *counters)
{
    ull all = requested(counters), misses = value(counters, "misses"), running = value(counters, "builds_running");
    printf("hits     %.1f %% of %llu structure%s; %llu from memory, %llu from disk; %llu waited for another's build, "
           "%llu %s new\n",
           100 * hit_ratio(counters), all, plural(all), value(counters, "hits_memory"), value(counters, "hits_disk"),
           value(counters, "coalesced"), misses, misses == 1 ? "was" : "were");
    printf("queue    %llu under way, %llu build%s running; waiting for memory: %llu to be prepared, %llu to be built\n",
           value(counters, "queue_depth"), running, plural(running), value(counters, "prepares_waiting"),
           value(counters, "builds_waiting"));
    printf("refused  %llu for lack of room, %llu wrong requests; %llu clients, and %llu that broke the protocol\n",
           value(counters, "refused"), value(counters, "request_errors"), value(counters, "connections_refused"),
           value(counters, "protocol_errors"));
}

static void print_memory(const struct bvhd_counters *counters)
{
    printf("memory   %.1f of %.1f MB; kept results %.1f of %.1f MB, %llu were dropped\n",
           megabytes(counters, "memory_live"), megabytes(counters, "memory_limit"), megabytes(counters, "cache_bytes"),
           megabytes(counters, "cache_budget"), value(counters, "cache_evicted"));
    if (value(counters, "disk_budget") > 0)
        printf("disk     %.1f of %.1f MB in %llu results; %llu were written, %llu dropped, %llu damaged\n",
               megabytes(counters, "disk_bytes"), megabytes(counters, "disk_budget"), value(counters, "disk_entries"),
               value(counters, "disk_written"), value(counters, "disk_evicted"), value(counters, "disk_damaged"));
    printf("bytes    %.1f MB of geometry came, %.1f MB of results went\n", megabytes(counters, "payload_bytes"),
           megabytes(counters, "result_bytes"));
}

/* Prints a counter of microseconds as milliseconds. */
static void print_ms(const struct bvhd_counters *counters, const char *stage, const char *which)
{
    char name[64];
    snprintf(name, sizeof name, "latency_%s_%s_us", stage, which);
    printf(" %11.3f", (double)value(counters, name) / 1000);
}

static void print_latencies(const struct bvhd_counters *counters)
{
    static const char *const stages[] = {"waiting", "prepare", "disk", "build", "total"};
    static const char *const which[] = {"p50", "p90", "p99", "max"};
    printf("latency  of the last minutes, in ms\n  %-9s %10s", "stage", "items");
    for (size_t k = 0; k < sizeof which / sizeof *which; k++)
        printf(" %11s", which[k]);
    printf("\n");
    for (size_t i = 0; i < sizeof stages / sizeof *stages; i++) {
        char name[64];
        snprintf(name, sizeof name, "latency_%s_items", stages[i]);
        printf("  %-9s %10llu", stages[i], value(counters, name));
        for (size_t k = 0; k < sizeof which / sizeof *which; k++)
            print_ms(counters, stages[i], which[k]);
        printf("\n");
    }
}

void counters_view_print(const struct bvhd_counters *counters)
{
    print_daemon(counters);
    print_work(counters);
    print_memory(counters);
    print_latencies(counters);
}

/* Returns what a sum has grown by; 0 after a restart of the daemon. */
static double growth(const struct bvhd_counters *before, const struct bvhd_counters *now, const char *name)
{
    ull first = value(before, name), last = value(now, name);
    return last > first ? (double)(last - first) : 0;
}

void counters_view_print_rates(const struct bvhd_counters *before, const struct bvhd_counters *now)
{
    double seconds = growth(before, now, "uptime_ms") / 1000;
    double workers = (double)value(now, "workers");
    if (seconds <= 0)
        return;
    printf("rates    %.1f structures, %.1f builds, %.1f MB of results a second; %.0f %% of the workers' time\n",
           growth(before, now, "items") / seconds, growth(before, now, "builds_done") / seconds,
           growth(before, now, "result_bytes") / seconds / 1e6,
           workers > 0 ? 100 * growth(before, now, "busy_ns") / seconds / 1e9 / workers : 0);
}

void counters_view_write(const struct bvhd_counters *counters, struct json *json)
{
    json_text(json, "version", bvhd_counters_version(counters));
    json_number(json, "hit_ratio", hit_ratio(counters));
    for (uint32_t i = 0; i < bvhd_counters_count(counters); i++)
        json_integer(json, bvhd_counters_name(counters, i), bvhd_counters_value(counters, i));
}
