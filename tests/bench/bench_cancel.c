/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_cancel - measures how long a build continues after it was cancelled.
 *
 *     bench_cancel [--builder own|embree] [--quality fast|balanced|high] [--triangles N] [--cancels N] [--threads N]
 *                  [--seconds N] SCENE.ply
 *
 * The scene is repeated side by side until it has N triangles (2,000,000). One build, with preparation and key, runs to
 * its end; then builds are cancelled (200 times) at moments spread evenly over that time. Printed is the time between
 * setting the flag and the return, by which nothing may be held any more. By default two threads build each quality for
 * at most 60 s; the moments reached by then are evenly spread, too. The processor time that all threads spent after the
 * flag is printed beside it; it says more on a machine that is busy otherwise. Without --builder the cancelled builds
 * of all builders that there are alternate.
 */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "builder/build.h"
#include "builder/content_key.h"
#include "builder/method.h"
#include "tests/bench/ply_input.h"
#include "builder/input/prepare.h"
#include "builder/workers.h"

enum { BUILDERS = BUILDER_EMBREE + 1 };

struct options {
    uint32_t builders; /* a bit for each */
    long quality; /* 0: each quality */
    long triangles, cancels, threads, seconds;
};

/* The measurements of one cancelled build. */
struct sample {
    double moment, latency; /* ms from the start to the flag, and from the flag to the return */
    double cpu; /* ms of all threads after the flag */
};

struct cancelling {
    atomic_bool cancel;
    double after; /* ms to wait before setting the flag */
    double at, cpu; /* clock and processor time when the flag was set */
};

static double read_clock(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

static double milliseconds(void)
{
    return read_clock(CLOCK_MONOTONIC);
}

static void fail(const char *what)
{
    fprintf(stderr, "bench_cancel: %s\n", what);
    exit(1);
}

/* Copies the mesh beside itself along x, until there are `triangles` triangles. Frees `ply`. */
static struct ply *repeat(struct ply *ply, uint32_t triangles)
{
    uint32_t copies = (triangles + ply->triangle_count - 1) / ply->triangle_count;
    struct ply *many = calloc(1, sizeof *many);
    float least = ply->positions[0], most = least;
    if (!many)
        fail("no memory");
    many->vertex_count = ply->vertex_count * copies;
    many->triangle_count = ply->triangle_count * copies;
    many->positions = malloc((size_t)many->vertex_count * 12);
    many->indices = malloc((size_t)many->triangle_count * 12);
    if (!many->positions || !many->indices)
        fail("no memory");
    for (size_t i = 0; i < ply->vertex_count; i++) {
        least = ply->positions[3 * i] < least ? ply->positions[3 * i] : least;
        most = ply->positions[3 * i] > most ? ply->positions[3 * i] : most;
    }
    for (size_t i = 0; i < (size_t)many->vertex_count * 3; i++) {
        size_t copy = i / ((size_t)ply->vertex_count * 3), own = i % ((size_t)ply->vertex_count * 3);
        many->positions[i] = ply->positions[own] + (own % 3 == 0 ? (float)copy * (most - least) : 0);
    }
    for (size_t i = 0; i < (size_t)many->triangle_count * 3; i++)
        many->indices[i] = ply->indices[i % ((size_t)ply->triangle_count * 3)] +
                           (uint32_t)(i / ((size_t)ply->triangle_count * 3)) * ply->vertex_count;
    ply_free(ply);
    return many;
}

static void *set_flag(void *context)
{
    struct cancelling *cancelling = context;
    struct timespec wait = {(time_t)(cancelling->after / 1e3), (long)(cancelling->after * 1e6) % 1000000000};
    nanosleep(&wait, NULL);
    cancelling->at = milliseconds();
    cancelling->cpu = read_clock(CLOCK_PROCESS_CPUTIME_ID);
    atomic_store(&cancelling->cancel, true);
    return NULL;
}

/* Does everything that a service does for one structure. Nothing is held afterwards. */
static enum bvhd_status run_all(const struct build_input *input, const struct build_context *context)
{
    struct limits limits = limits_default();
    struct canonical canonical;
    struct build_stats stats;
    struct key key;
    unsigned char *blob = NULL;
    enum bvhd_status status = prepare(input, 0, &limits, context, &canonical, NULL);
    if (status != BVHD_OK)
        return status;
    status = content_key(&canonical, &input->options, context, &key, NULL);
    if (status == BVHD_OK)
        status = build(&canonical, &input->options, context, &blob, &stats, NULL);
    memory_free(context->memory, blob);
    prepare_finish(&canonical, context->memory);
    return status;
}

/* Returns false when the build had ended before it was cancelled. */
static bool cancel_once(const struct build_input *input, struct build_context *context, double after,
                        struct sample *ret_sample)
{
    struct cancelling cancelling = {.after = after};
    pthread_t thread;
    context->cancel = &cancelling.cancel;
    if (pthread_create(&thread, NULL, set_flag, &cancelling) != 0)
        fail("no thread");
    double begin = milliseconds();
    enum bvhd_status status = run_all(input, context);
    double end = milliseconds(), cpu = read_clock(CLOCK_PROCESS_CPUTIME_ID);
    pthread_join(thread, NULL);
    context->cancel = NULL;
    if (atomic_load(&context->memory->live) != 0)
        fail("memory is still held after the return");
    *ret_sample = (struct sample){cancelling.at - begin, end - cancelling.at, cpu - cancelling.cpu};
    return status == BVHD_CANCELLED;
}

static int by_cpu(const void *a, const void *b)
{
    double x = ((const struct sample *)a)->cpu, y = ((const struct sample *)b)->cpu;
    return (x > y) - (x < y);
}

static int by_latency(const void *a, const void *b)
{
    double x = ((const struct sample *)a)->latency, y = ((const struct sample *)b)->latency;
    return (x > y) - (x < y);
}

/* Builds of one builder that are cancelled. */
struct series {
    struct build_input input;
    double whole; /* ms of a build that is not cancelled */
    struct sample *samples;
    long count;
};

static void print(const struct ply *ply, const struct series *series)
{
    const long count = series->count;
    struct sample *samples = series->samples;
    printf("%u triangles, %s, builder %s: prepare, key and build take %.1f ms; cancelled %ld times",
           ply->triangle_count, build_quality_name(series->input.options.quality),
           build_builder_name(series->input.options.builder), series->whole, count);
    if (count > 0) {
        const long p99 = (count * 99 + 99) / 100 - 1;
        qsort(samples, (size_t)count, sizeof *samples, by_latency);
        printf("\n    returned after %.2f ms (p50), %.2f (p99), %.2f (most)", samples[count / 2].latency,
               samples[p99].latency, samples[count - 1].latency);
        qsort(samples, (size_t)count, sizeof *samples, by_cpu);
        printf("\n    processor time %.2f ms (p50), %.2f (p99), most:", samples[count / 2].cpu, samples[p99].cpu);
        for (long i = count - 1; i >= 0 && i >= count - 6; i--)
            printf(" %.2f (at %.1f)", samples[i].cpu, samples[i].moment);
    }
    printf("\n");
    fflush(stdout);
}

static double time_whole(const struct build_input *input, const struct build_context *context)
{
    double begin = milliseconds();
    if (run_all(input, context) != BVHD_OK)
        fail("the build failed");
    return milliseconds() - begin;
}

/* A sequence of multiples of the golden ratio, modulo 1: it is evenly spread wherever it ends. */
static double share_of(long i)
{
    double turns = 0.5 + 0.6180339887498949 * (double)i;
    return turns - (double)(long)turns;
}

static struct series start_series(const struct build_input *input, enum build_builder builder, long cancels,
                                  const struct build_context *context)
{
    struct series series = {.input = *input, .samples = calloc((size_t)cancels, sizeof *series.samples)};
    if (!series.samples)
        fail("no memory");
    series.input.options.builder = builder;
    time_whole(&series.input, context);
    series.whole = time_whole(&series.input, context);
    return series;
}

static void measure(const struct ply *ply, enum build_quality quality, const struct options *options)
{
    struct memory memory;
    struct workers *workers;
    struct bvhd_error error;
    struct geometry geometry;
    const struct build_input input = ply_input(ply, quality, &geometry);
    struct series series[BUILDERS] = {{.count = 0}};
    memory_init(&memory, UINT64_MAX);
    if (workers_create((unsigned)options->threads, &workers, &error) != BVHD_OK)
        fail(error.text);
    struct build_context context = {.memory = &memory, .parallel = workers_parallel(workers)};
    const double begin = milliseconds();
    for (int b = 0; b < BUILDERS; b++)
        if (options->builders >> b & 1)
            series[b] = start_series(&input, (enum build_builder)b, options->cancels, &context);
    for (long i = 0; i < options->cancels && milliseconds() - begin < 1e3 * (double)options->seconds; i++)
        for (struct series *each = series; each < series + BUILDERS; each++)
            if (each->samples)
                each->count +=
                    cancel_once(&each->input, &context, each->whole * share_of(i), &each->samples[each->count]);
    for (struct series *each = series; each < series + BUILDERS; each++) {
        if (each->samples)
            print(ply, each);
        free(each->samples);
    }
    workers_destroy(workers);
}

static uint32_t builders_named(const char *name)
{
    enum build_builder builder;
    if (!build_builder_from_name(name, &builder))
        fail("unknown builder");
    if (!(method_builders() >> builder & 1))
        fail("there is no Embree");
    return 1U << builder;
}

static long quality_named(const char *name)
{
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
        if (strcmp(name, build_quality_name(quality)) == 0)
            return quality;
    fail("unknown quality");
    return 0;
}

/* Returns the index of the first argument that is no option. */
static int read_options(int argc, char **argv, struct options *options)
{
    const struct {
        const char *name;
        long *value;
    } numbers[] = {{"--triangles", &options->triangles},
                   {"--cancels", &options->cancels},
                   {"--threads", &options->threads},
                   {"--seconds", &options->seconds}};
    int at = 1;
    for (; at + 1 < argc && strncmp(argv[at], "--", 2) == 0; at += 2) {
        if (strcmp(argv[at], "--quality") == 0)
            options->quality = quality_named(argv[at + 1]);
        if (strcmp(argv[at], "--builder") == 0)
            options->builders = builders_named(argv[at + 1]);
        for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
            if (strcmp(argv[at], numbers[i].name) == 0)
                *numbers[i].value = atol(argv[at + 1]);
    }
    return at;
}

int main(int argc, char **argv)
{
    struct options options = {
        .builders = method_builders(), .triangles = 2000000, .cancels = 200, .threads = 2, .seconds = 60};
    int first = read_options(argc, argv, &options);
    if (first + 1 != argc || options.triangles < 1 || options.triangles > 100000000 || options.cancels < 1 ||
        options.cancels > 1000000 || options.threads < 1 || options.threads > 1024) {
        fprintf(stderr, "usage: bench_cancel [--builder own|embree] [--quality fast|balanced|high] [--triangles N] "
                        "[--cancels N] [--threads N] [--seconds N] SCENE.ply\n");
        return 2;
    }
    struct ply *ply = ply_read(argv[first]);
    if (!ply)
        return 1;
    ply = repeat(ply, (uint32_t)options.triangles);
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
        if (!options.quality || quality == (enum build_quality)options.quality)
            measure(ply, quality, &options);
    ply_free(ply);
    return 0;
}
