/* SPDX-License-Identifier: Apache-2.0 */
/* service_cost.c - bench_service's sections `cost` and `hits`. */
#include <stdlib.h>
#include <string.h>

#include "builder/build.h"
#include "tests/support/scene/ply.h"
#include "builder/input/prepare.h"
#include "tests/bench/service_bench.h"
#include "client/vulkan_input.h"
#include "builder/workers.h"

/* The resources of builds in this process. */
struct local {
    struct memory memory;
    struct workers *workers;
    struct build_context context;
};

static void local_init(struct local *local, unsigned threads)
{
    struct bvhd_error error;
    *local = (struct local){0};
    memory_init(&local->memory, UINT64_MAX);
    if (workers_create(threads, &local->workers, &error) != BVHD_OK)
        bench_fail("%s", error.text);
    local->context.memory = &local->memory;
    local->context.parallel = workers_parallel(local->workers);
}

static void local_finish(struct local *local)
{
    workers_destroy(local->workers);
}

/*
 * Builds from the same views over the same canonical copy to the same blob, without key and socket, and reads one byte
 * of each page. Returns milliseconds.
 */
static double local_build(struct local *local, const struct terrain *terrain)
{
    static volatile unsigned char sink;
    struct build_options options = {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE};
    struct limits limits = limits_default();
    struct vulkan_input *input;
    struct canonical canonical;
    struct build_stats stats;
    struct bvhd_error error = {0};
    unsigned char *blob;
    double begin = bench_now();
    if (vulkan_input_create(&terrain->info, 1, &terrain->ranges, NULL, 0, &options, &input, &error) != BVHD_OK ||
        prepare(vulkan_input_entries(input), 0, &limits, &local->context, &canonical, &error) != BVHD_OK ||
        build(&canonical, &options, &local->context, &blob, &stats, &error) != BVHD_OK)
        bench_fail("%s: %s", error.where, error.text);
    for (uint64_t at = 0; at < stats.sizes.total; at += 4096)
        sink = blob[at];
    (void)sink;
    double ms = bench_now() - begin;
    memory_free(&local->memory, blob);
    prepare_finish(&canonical, &local->memory);
    vulkan_input_destroy(input);
    return ms;
}

static void cost_of(const struct bench *bench, struct bvhd_client *client, struct local *local, const char *name,
                    const struct terrain *terrain)
{
    double *service = calloc((size_t)bench->runs, sizeof *service), *alone = calloc((size_t)bench->runs, sizeof *alone);
    double queued = 0, prepared = 0, built = 0;
    if (!service || !alone)
        bench_fail("no memory");
    for (int i = 0; i < bench->runs; i++) {
        alone[i] = local_build(local, terrain);
        double begin = bench_now();
        struct bvhd_batch *batch = bench_submit(client, terrain);
        bvhd_batch_wait(batch, -1);
        const struct bvhd_result *result = bvhd_batch_result(batch, 0);
        queued += result->queued_ms / bench->runs;
        prepared += result->prepare_ms / bench->runs;
        built += result->build_ms / bench->runs;
        bench_finish(batch);
        service[i] = bench_now() - begin;
    }
    double s = bench_quantile(service, bench->runs, 0.5), a = bench_quantile(alone, bench->runs, 0.5);
    bench_line(name,
               "service %.1f ms, in process %.1f ms: ratio %.3f, %+.1f ms (mean in the service: queued %.1f, prepare "
               "and key %.1f, build %.1f)",
               s, a, s / a, s - a, queued, prepared, built);
    free(service);
    free(alone);
}

void bench_cost(const struct bench *bench)
{
    struct service_process process;
    struct local local;
    bench_start(bench, 0, "0", &process);
    struct bvhd_client *client = bench_client(&process);
    local_init(&local, bench->workers);
    for (int i = 0; i < bench->scene_count; i++) {
        struct ply *ply = ply_read(bench->scenes[i]);
        struct terrain terrain;
        if (!ply)
            bench_fail("%s cannot be read", bench->scenes[i]);
        terrain_wrap(&terrain, ply->positions, ply->vertex_count, ply->indices, ply->triangle_count);
        const char *slash = strrchr(bench->scenes[i], '/');
        cost_of(bench, client, &local, slash ? slash + 1 : bench->scenes[i], &terrain);
        ply_free(ply);
    }
    for (uint32_t size = 2000; size <= 800000 && bench->scene_count == 0; size *= 20) {
        struct terrain terrain;
        terrain_init(&terrain, size, 1);
        cost_of(bench, client, &local,
                size == 2000    ? "cost of 2,000 triangles"
                : size == 40000 ? "cost of 40,000"
                                : "cost of 800,000",
                &terrain);
        terrain_finish(&terrain);
    }
    local_finish(&local);
    bvhd_client_destroy(client);
    bench_stop(&process);
}

static void hits_by_key(struct bvhd_client *client, uint32_t triangles, const char *what, const char *goal)
{
    enum { TIMES = 2000 };
    static double us[TIMES];
    struct terrain terrain;
    uint64_t size;
    terrain_init(&terrain, triangles, 7);
    struct bvhd_key key = bench_key(client, &terrain, &size);
    for (int i = 0; i < TIMES; i++) {
        struct bvhd_batch *batch;
        struct bvhd_error error;
        double begin = bench_now();
        if (bvhd_batch_fetch(client, 1, &key, &batch, &error) != BVHD_OK)
            bench_fail("%s", error.text);
        bench_finish(batch);
        us[i] = (bench_now() - begin) * 1e3;
    }
    double p99 = bench_quantile(us, TIMES, 0.99), p50 = bench_quantile(us, TIMES, 0.5);
    bench_line(what, "%.1f KiB: p50 %.0f us, p99 %.0f us (goal: p50 %s)", (double)size / 1024, p50, p99, goal);
    terrain_finish(&terrain);
}

static void hits_by_geometry(struct bvhd_client *client, uint32_t triangles)
{
    enum { TIMES = 500 };
    static double us[TIMES];
    struct terrain terrain;
    uint64_t size;
    double prepared = 0;
    terrain_init(&terrain, triangles, 8);
    bench_key(client, &terrain, &size);
    for (int i = 0; i < TIMES; i++) {
        double begin = bench_now();
        struct bvhd_batch *batch = bench_submit(client, &terrain);
        bvhd_batch_wait(batch, -1);
        prepared += bvhd_batch_result(batch, 0)->prepare_ms / TIMES;
        bench_finish(batch);
        us[i] = (bench_now() - begin) * 1e3;
    }
    double p99 = bench_quantile(us, TIMES, 0.99), p50 = bench_quantile(us, TIMES, 0.5);
    bench_line("hit by geometry",
               "%.1f KiB: p50 %.0f us, p99 %.0f us; prepare and key %.0f us of it (goal: p50 1,000 us)",
               (double)size / 1024, p50, p99, prepared * 1e3);
    terrain_finish(&terrain);
}

void bench_hits(const struct bench *bench)
{
    struct service_process process;
    bench_start(bench, 0, "1G", &process);
    struct bvhd_client *client = bench_client(&process);
    hits_by_key(client, 18, "hit by key", "100 us");
    hits_by_key(client, 36000, "hit by key", "200 us");
    hits_by_geometry(client, 36000);
    bvhd_client_destroy(client);
    bench_stop(&process);
}
