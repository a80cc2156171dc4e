/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/service_bench.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { PAGE = 4096 };

/* Keeps the compiler from removing the reads of pages. */
static volatile unsigned char sink;

double bench_now(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

void bench_fail(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    fputs("bench_service: ", stderr);
    vfprintf(stderr, format, arguments);
    fputc('\n', stderr);
    va_end(arguments);
    exit(1);
}

void bench_line(const char *what, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    printf("%-34s ", what);
    vprintf(format, arguments);
    putchar('\n');
    fflush(stdout);
    va_end(arguments);
}

static int compare(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

double bench_quantile(double *values, int count, double share)
{
    qsort(values, (size_t)count, sizeof *values, compare);
    int at = (int)(share * count);
    return values[at < count ? at : count - 1];
}

void bench_start(const struct bench *bench, unsigned workers, const char *cache, struct service_process *ret_service)
{
    char count[16];
    snprintf(count, sizeof count, "%u", workers ? workers : bench->workers);
    const char *const all[] = {"--cache-size", cache, "--workers", count, NULL};
    const char *const some[] = {"--cache-size", cache, NULL};
    service_process_start(ret_service, bench->program, workers || bench->workers ? all : some);
}

void bench_stop(struct service_process *service)
{
    if (!service_process_stop(service))
        bench_fail("the daemon did not exit cleanly");
}

struct bvhd_client *bench_client(const struct service_process *service)
{
    struct bvhd_client_options options = {
        .struct_size = sizeof options, .socket_path = service->socket, .local = BVHD_LOCAL_NEVER};
    struct bvhd_client *client;
    struct bvhd_error error;
    if (bvhd_client_create(&options, &client, &error) != BVHD_OK || bvhd_client_connect(client, &error) != BVHD_OK)
        bench_fail("%s: %s", error.where, error.text);
    return client;
}

struct bvhd_batch *bench_submit(struct bvhd_client *client, const struct terrain *terrain)
{
    struct bvhd_build build = {.struct_size = sizeof build,
                               .info_count = 1,
                               .infos = &terrain->info,
                               .ranges = &terrain->ranges,
                               .quality = BVHD_QUALITY_BALANCED,
                               .target = BVHD_TARGET_PORTABLE};
    struct bvhd_batch *batch;
    struct bvhd_error error;
    if (bvhd_batch_submit(client, &build, &batch, &error) != BVHD_OK)
        bench_fail("%s: %s", error.where, error.text);
    return batch;
}

void bench_finish(struct bvhd_batch *batch)
{
    bvhd_batch_wait(batch, -1);
    for (uint32_t i = 0; i < bvhd_batch_count(batch); i++) {
        const struct bvhd_result *result = bvhd_batch_result(batch, i);
        if (result->error.status != BVHD_OK)
            bench_fail("item %u: %s: %s: %s", i, bvhd_status_name(result->error.status), result->error.where,
                       result->error.text);
        for (uint64_t at = 0; at < result->size; at += PAGE)
            sink = ((const unsigned char *)result->data)[at];
    }
    bvhd_batch_destroy(batch);
}

struct bvhd_key bench_key(struct bvhd_client *client, const struct terrain *terrain, uint64_t *ret_size)
{
    struct bvhd_batch *batch = bench_submit(client, terrain);
    bvhd_batch_wait(batch, -1);
    struct bvhd_key key = bvhd_batch_result(batch, 0)->key;
    *ret_size = bvhd_batch_result(batch, 0)->size;
    bench_finish(batch);
    return key;
}

uint64_t bench_counter(struct bvhd_client *client, const char *name)
{
    struct bvhd_counters *counters;
    struct bvhd_error error;
    if (bvhd_client_counters(client, -1, &counters, &error) != BVHD_OK)
        bench_fail("%s: %s", error.where, error.text);
    for (uint32_t i = 0; i < bvhd_counters_count(counters); i++)
        if (!strcmp(bvhd_counters_name(counters, i), name)) {
            uint64_t value = bvhd_counters_value(counters, i);
            bvhd_counters_destroy(counters);
            return value;
        }
    bench_fail("there is no counter '%s'", name);
}
