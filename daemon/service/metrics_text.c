/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/metrics_text.h"

#include <assert.h>
#include <stdarg.h>
#include <stdio.h>

#include "daemon/service/service_internal.h"

struct writing {
    char *text;
    uint64_t size;
};

__attribute__((format(printf, 2, 3))) static void put(struct writing *writing, const char *format, ...)
{
    uint64_t room = METRICS_TEXT_SIZE - writing->size;
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(writing->text + writing->size, room, format, arguments);
    va_end(arguments);
    assert(length >= 0 && (uint64_t)length < room);
    writing->size += (uint64_t)length;
}

static void put_sum(struct writing *writing, const char *name, uint64_t value)
{
    put(writing, "# TYPE bvhd_%s_total counter\nbvhd_%s_total %llu\n", name, name, (unsigned long long)value);
}

static void put_level(struct writing *writing, const char *name, uint64_t value)
{
    put(writing, "# TYPE bvhd_%s gauge\nbvhd_%s %llu\n", name, name, (unsigned long long)value);
}

/* Buckets of shorter times are left out, since they would be many and nobody needs them. */
enum { FIRST_POWER = 5 };

static void put_latency(struct writing *writing, const char *stage, const struct latency *latency)
{
    uint64_t sum = 0;
    for (unsigned i = 0; i < LATENCY_POWERS; i++) {
        sum += latency->powers[i];
        if (i >= FIRST_POWER)
            put(writing, "bvhd_latency_seconds_bucket{stage=\"%s\",le=\"%.9g\"} %llu\n", stage,
                (double)(UINT64_C(2) << i) / 1e6, (unsigned long long)sum);
    }
    put(writing,
        "bvhd_latency_seconds_bucket{stage=\"%s\",le=\"+Inf\"} %llu\nbvhd_latency_seconds_sum{stage=\"%s\"} %.6f\n"
        "bvhd_latency_seconds_count{stage=\"%s\"} %llu\n",
        stage, (unsigned long long)latency->count, stage, (double)latency->sum_us / 1e6, stage,
        (unsigned long long)latency->count);
}

static void put_all(struct writing *writing, const struct service *service)
{
    const struct counters counters = service_counters(service);
    put(writing, "# TYPE bvhd_info gauge\nbvhd_info{version=\"%s\"} 1\n", BVHD_DAEMON_VERSION);
#define PUT(name) put_sum(writing, #name, counters.name);
    COUNTERS_OF_SUMS(PUT)
#undef PUT
#define PUT(name) put_level(writing, #name, counters.name);
    COUNTERS_OF_LEVELS(PUT)
#undef PUT
    put(writing, "# TYPE bvhd_latency_seconds histogram\n");
#define PUT(stage) put_latency(writing, #stage, &service->latencies[LATENCY_##stage]);
    LATENCY_STAGES(PUT)
#undef PUT
}

char *metrics_text(const struct service *service, struct memory *memory, uint64_t *ret_size)
{
    struct writing writing = {.text = memory_alloc(memory, METRICS_TEXT_SIZE)};
    if (!writing.text)
        return NULL;
    put_all(&writing, service);
    *ret_size = writing.size;
    return writing.text;
}
