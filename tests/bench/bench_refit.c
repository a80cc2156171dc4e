/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_refit - measures how fast structures are updated, beside a build of the same geometry.
 *
 *     bench_refit [--target portable|lavapipe] [--runs N] [--threads N] SCENE.ply...
 *
 * For each scene it prints medians of N runs (5), in which a balanced build and an update alternate, with 2 threads
 * unless told otherwise. Both write into memory that was touched before. "record" is what ALLOW_UPDATE adds to either:
 * what the rules of updates compare; "measure" is what it adds to a build. Each update moves every vertex a little.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "builder/build.h"
#include "builder/input/prepare.h"
#include "builder/update/refit.h"
#include "builder/update/update_rules.h"
#include "builder/workers.h"
#include "tests/bench/ply_input.h"

enum { MAX_RUNS = 101 };

/* The columns of times, in ms. */
enum { BUILD, MEASURE, RECORD, REFIT, TREE, OUTLINE, VALUES };

struct bench {
    struct memory memory;
    struct workers *workers;
    struct build_context context;
    struct build_options options;
    int runs;
};

/* Memory that every blob of one kind is written to, so that no page of it is new. */
struct warm_output {
    struct build_output output;
    unsigned char *bytes;
    uint64_t room;
};

/* The last structure and its record. */
struct source {
    struct warm_output warm;
    uint64_t size;
    struct record record;
};

static double milliseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, by_value);
    return count % 2 ? values[count / 2] : (values[count / 2 - 1] + values[count / 2]) / 2;
}

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "bench_refit: %s: %s\n", error->where, error->text);
    exit(1);
}

static unsigned char *give(struct build_output *output, uint64_t size)
{
    struct warm_output *warm = (struct warm_output *)output;
    if (size > warm->room) {
        free(warm->bytes);
        warm->room = (size + size / 8 + 64) / 64 * 64;
        warm->bytes = aligned_alloc(64, warm->room);
        if (!warm->bytes)
            exit(1);
        memset(warm->bytes, 1, warm->room);
    }
    return warm->bytes;
}

static void keep(struct build_output *output, unsigned char *bytes)
{
    (void)output;
    (void)bytes;
}

static void build_source(const struct bench *bench, const struct canonical *canonical, struct source *source,
                         double times[VALUES])
{
    struct build_context context = bench->context;
    struct build_stats stats;
    struct bvhd_error error;
    unsigned char *blob;
    context.output = &source->warm.output;
    double begin = milliseconds();
    must(build(canonical, &bench->options, &context, &blob, &stats, &error), &error);
    times[BUILD] = milliseconds() - begin;
    source->size = stats.sizes.total;
    begin = milliseconds();
    must(record_make(canonical, &bench->options, &context, &source->record, &error), &error);
    times[RECORD] = milliseconds() - begin;
    begin = milliseconds();
    must(refit_measure((struct bytes){blob, source->size}, &stats, &context, &source->record, &error), &error);
    times[MEASURE] = milliseconds() - begin;
}

static double update(const struct bench *bench, const struct canonical *canonical, const struct source *source,
                     struct warm_output *warm, double times[VALUES])
{
    struct build_context context = bench->context;
    struct build_stats stats;
    struct refit_result result;
    struct record record;
    struct bvhd_error error;
    unsigned char *blob;
    context.output = &warm->output;
    must(record_make(canonical, &bench->options, &context, &record, &error), &error);
    must(update_rules_check(&source->record, &record, 0, &error), &error);
    const struct refit_request request = {{source->warm.bytes, source->size}, &source->record, canonical, &record};
    const double begin = milliseconds();
    must(refit(&request, &context, &blob, &stats, &result, &error), &error);
    times[REFIT] = milliseconds() - begin;
    times[TREE] = stats.ms.write;
    times[OUTLINE] = stats.ms.boxes;
    record_finish(&record, context.memory);
    return result.decay;
}

/* Shears the mesh along x, by the more the higher a vertex is. */
static void move(struct ply *ply, float amount)
{
    for (uint32_t i = 0; i < ply->vertex_count; i++)
        ply->positions[3 * i] += amount * ply->positions[3 * i + 1];
}

static struct canonical copy_of(const struct bench *bench, const struct build_input *input)
{
    const struct limits limits = limits_default();
    struct canonical canonical;
    struct bvhd_error error;
    must(prepare(input, 0, &limits, &bench->context, &canonical, &error), &error);
    return canonical;
}

static void measure(struct bench *bench, const char *path)
{
    const char *slash = strrchr(path, '/');
    double samples[VALUES][MAX_RUNS], times[VALUES], decay = 0;
    struct ply *ply = ply_read(path);
    struct geometry geometry;
    if (!ply)
        exit(1);
    struct build_input input = ply_input(ply, QUALITY_BALANCED, &geometry);
    struct source source = {.warm = {.output = {give, keep}}};
    struct warm_output warm = {.output = {give, keep}};
    input.flags = BUILD_ALLOW_UPDATE;
    for (int run = 0; run < bench->runs; run++) {
        struct canonical canonical = copy_of(bench, &input);
        build_source(bench, &canonical, &source, times);
        prepare_finish(&canonical, &bench->memory);
        move(ply, 0.01f);
        canonical = copy_of(bench, &input);
        decay = update(bench, &canonical, &source, &warm, times);
        prepare_finish(&canonical, &bench->memory);
        record_finish(&source.record, &bench->memory);
        for (int i = 0; i < VALUES; i++)
            samples[i][run] = times[i];
    }
    for (int i = 0; i < VALUES; i++)
        times[i] = median(samples[i], bench->runs);
    printf("%-18s %8u | %8.2f %7.2f %7.2f | %7.2f %7.2f %7.2f | %6.2f %6.2f | %6.3f\n", slash ? slash + 1 : path,
           ply->triangle_count, times[BUILD], times[MEASURE], times[RECORD], times[REFIT], times[TREE], times[OUTLINE],
           times[BUILD] / times[REFIT], times[BUILD] / times[TREE], decay);
    free(source.warm.bytes);
    free(warm.bytes);
    ply_free(ply);
}

static int usage(void)
{
    fprintf(stderr, "usage: bench_refit [--target portable|lavapipe] [--runs N] [--threads N] SCENE.ply...\n");
    return 2;
}

static bool parse(struct bench *bench, unsigned *threads, const char *name, const char *value)
{
    if (strcmp(name, "--runs") == 0) {
        bench->runs = atoi(value);
        return bench->runs >= 1 && bench->runs <= MAX_RUNS;
    }
    if (strcmp(name, "--threads") == 0) {
        *threads = (unsigned)atoi(value);
        return *threads >= 1 && *threads <= WORKERS_MAX_THREADS;
    }
    const struct layout *layout = strcmp(name, "--target") == 0 ? layout_find_name(value) : NULL;
    if (layout)
        bench->options.target = layout->target;
    bench->options.device.variant = layout && layout->variants > 0 ? 1 : 0;
    return layout != NULL;
}

int main(int argc, char **argv)
{
    struct bench bench = {.runs = 5, .options = {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE}};
    struct bvhd_error error;
    unsigned threads = 2;
    int first = 1;
    for (; first + 1 < argc && strncmp(argv[first], "--", 2) == 0; first += 2)
        if (!parse(&bench, &threads, argv[first], argv[first + 1]))
            return usage();
    if (first >= argc)
        return usage();
    memory_keep();
    memory_init(&bench.memory, UINT64_MAX);
    must(workers_create(threads, &bench.workers, &error), &error);
    bench.context = (struct build_context){.memory = &bench.memory, .parallel = workers_parallel(bench.workers)};
    printf("%u threads, balanced, %s; times in ms\n", threads, layout_find(bench.options.target)->name);
    printf("%-18s %8s | %8s %7s %7s | %7s %7s %7s | %6s %6s | %s\n", "scene", "tris", "build", "measure", "record",
           "refit", "tree", "outline", "/refit", "/tree", "decay");
    for (int i = first; i < argc; i++) {
        measure(&bench, argv[i]);
        fflush(stdout);
    }
    workers_destroy(bench.workers);
    return 0;
}
