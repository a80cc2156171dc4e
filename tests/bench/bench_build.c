/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_build - measures how fast structures are built, beside rtcBuildBVH in the same run (MEDIUM, and LOW with
 * eight-wide nodes), and how good they are.
 *
 *     bench_build [--builder own|embree] [--quality fast|balanced|high] [--runs N] [--threads N] SCENE.ply...
 *
 * It measures with N threads, or else with 2 threads and with 1. For each scene it prints medians of N runs (5), in
 * which our build and Embree's alternate. "build" is the time of build(): boxes, splitting, pieces, joining, depth,
 * collapse and writing of the layout; "prepare" is listed separately. The SAH cost of the binary trees, by one formula,
 * is beside that of MEDIUM and of a full sweep. Ratios of rates are by wall-clock time, and by processor time, which
 * says more while others use the machine.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/build.h"
#include "tests/bench/ply_input.h"
#include "builder/input/prepare.h"
#include "builder/input/primitive.h"
#include "tests/bench/bvhd_bench/embree_tree.h"
#include "tests/bench/bvhd_bench/stopwatch.h"
#include "tests/bench/bvhd_bench/sweep.h"
#include "builder/workers.h"

enum { MAX_RUNS = 101, VALUES = 14, MAX_SCENES = 64 };

/* The columns of times, in ms. */
enum {
    PREPARE,
    BOXES,
    SPLIT,
    PIECES,
    JOIN,
    DEPTH,
    COLLAPSE,
    WRITE,
    BUILD,
    BUILD_CPU,
    MEDIUM,
    MEDIUM_CPU,
    LOW,
    LOW_CPU
};

struct options {
    enum build_builder builder;
    enum build_quality quality;
    int runs;
    unsigned threads; /* 0: two, and one */
};

struct row {
    const char *name;
    double triangles;
    double ms[VALUES]; /* medians */
    double sah, medium_sah, sweep_sah;
    struct build_stats stats;
};

struct bench {
    const struct options *options;
    unsigned threads;
    struct memory memory;
    const struct parallel *parallel;
};

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, by_value);
    return count % 2 ? values[count / 2] : (values[count / 2 - 1] + values[count / 2]) / 2;
}

static void fail(const char *what, const struct bvhd_error *error)
{
    fprintf(stderr, "bench_build: %s: %s\n", what, error->text);
    exit(1);
}

static void run_ours(struct bench *bench, const struct build_input *input, struct row *row, double times[VALUES])
{
    struct bvhd_error error;
    struct limits limits = limits_default();
    const struct build_context context = {.memory = &bench->memory, .parallel = bench->parallel};
    struct canonical canonical;
    unsigned char *blob;
    double begin = stopwatch_wall_ms();
    if (prepare(input, 0, &limits, &context, &canonical, &error) != BVHD_OK)
        fail(row->name, &error);
    times[PREPARE] = stopwatch_wall_ms() - begin;
    begin = stopwatch_wall_ms();
    double cpu_begin = stopwatch_cpu_ms();
    if (build(&canonical, &input->options, &context, &blob, &row->stats, &error) != BVHD_OK)
        fail(row->name, &error);
    times[BUILD] = stopwatch_wall_ms() - begin;
    times[BUILD_CPU] = stopwatch_cpu_ms() - cpu_begin;
    memory_free(&bench->memory, blob);
    prepare_finish(&canonical, &bench->memory);
    const struct build_times *ms = &row->stats.ms;
    const double stages[] = {ms->boxes, ms->split, ms->pieces, ms->join, ms->depth, ms->collapse, ms->write};
    memcpy(times + BOXES, stages, sizeof stages);
}

/* Calls rtcBuildBVH with one of bvhd-bench's methods. */
static struct embree_tree_result run_embree(const char *method, const struct ply *ply,
                                            const struct primitive_refs *refs, unsigned threads)
{
    struct embree_tree_result result;
    const struct embree_tree_request request = {
        .method = method_find(method), .mesh = ply, .refs = refs, .threads = threads, .want_tree = true};
    const char *failure = embree_tree_build(&request, &result);
    if (failure) {
        fprintf(stderr, "bench_build: rtcBuildBVH: %s\n", failure);
        exit(1);
    }
    return result;
}

static double sweep_sah(const struct primitive_refs *refs)
{
    struct tree tree = sweep_build(refs->refs, refs->count);
    double sah = tree_sah(&tree);
    tree_finish(&tree);
    return sah;
}

static void run_references(struct bench *bench, const struct build_input *input, const struct ply *ply, struct row *row,
                           double times[VALUES])
{
    struct bvhd_error error;
    struct limits limits = limits_default();
    const struct build_context context = {.memory = &bench->memory, .parallel = bench->parallel};
    struct canonical canonical;
    struct primitive_refs refs;
    if (prepare(input, 0, &limits, &context, &canonical, &error) != BVHD_OK ||
        primitive_collect_blocks(&canonical, NULL, &context, &refs, &error) != BVHD_OK ||
        !primitive_close_gaps(&refs, &context))
        fail(row->name, &error);
    struct embree_tree_result medium = run_embree("embree/bvh-medium-2", ply, &refs, bench->threads),
                              low = run_embree("embree/bvh-low-8", ply, &refs, bench->threads);
    if (row->sweep_sah == 0)
        row->sweep_sah = sweep_sah(&refs);
    memory_free(&bench->memory, refs.refs);
    prepare_finish(&canonical, &bench->memory);
    row->medium_sah = tree_sah(&medium.tree);
    times[MEDIUM] = medium.ms;
    times[MEDIUM_CPU] = medium.cpu_ms;
    times[LOW] = low.ms;
    times[LOW_CPU] = low.cpu_ms;
    tree_finish(&medium.tree);
    tree_finish(&low.tree);
}

static struct row measure(struct bench *bench, const char *path)
{
    const char *slash = strrchr(path, '/');
    struct row row = {.name = slash ? slash + 1 : path};
    double samples[VALUES][MAX_RUNS], times[VALUES];
    struct ply *ply = ply_read(path);
    struct geometry geometry;
    if (!ply)
        exit(1);
    struct build_input input = ply_input(ply, bench->options->quality, &geometry);
    input.options.builder = bench->options->builder;
    row.triangles = ply->triangle_count;
    for (int run = 0; run < bench->options->runs; run++) {
        run_ours(bench, &input, &row, times);
        run_references(bench, &input, ply, &row, times);
        for (int i = 0; i < VALUES; i++)
            samples[i][run] = times[i];
    }
    for (int i = 0; i < VALUES; i++)
        row.ms[i] = median(samples[i], bench->options->runs);
    row.sah = row.stats.sah;
    ply_free(ply);
    return row;
}

static double rate(const struct row *row, int column)
{
    return row->triangles / row->ms[column] * 1e-3;
}

static void print_row(const struct row *row)
{
    printf("%-18s %8.0f |", row->name, row->triangles);
    for (int i = PREPARE; i <= BUILD; i++)
        printf(" %7.2f", row->ms[i]);
    const struct layout_sizes *sizes = &row->stats.sizes;
    printf(" | %6.2f %6.2f %6.2f %5.2f %5.2f | %5.2f %5.2f | %7.2f %7.2f %7.2f | %5.1f %5.1f %5.1f %5.1f | %3u %s\n",
           rate(row, BUILD), rate(row, MEDIUM), rate(row, LOW), rate(row, BUILD) / rate(row, MEDIUM),
           rate(row, BUILD) / rate(row, LOW), row->ms[MEDIUM_CPU] / row->ms[BUILD_CPU],
           row->ms[LOW_CPU] / row->ms[BUILD_CPU], row->sah, row->medium_sah, row->sweep_sah,
           (double)sizes->nodes / row->triangles, (double)sizes->records / row->triangles,
           (double)sizes->vertices / row->triangles, (double)sizes->total / row->triangles, row->stats.depth,
           row->stats.method);
}

/* Prints the geometric mean of a figure, and the scene where it is worst. */
static void print_mean(const char *what, const struct row *rows, int count, double (*figure)(const struct row *row),
                       bool low_is_bad)
{
    double sum = 0;
    int worst = 0;
    for (int i = 0; i < count; i++) {
        sum += log(figure(&rows[i]));
        double own = figure(&rows[i]), other = figure(&rows[worst]);
        worst = (low_is_bad ? own < other : own > other) ? i : worst;
    }
    printf("  %-34s %8.3f   worst %8.3f (%s)\n", what, exp(sum / count), figure(&rows[worst]), rows[worst].name);
}

static double own_rate(const struct row *row)
{
    return rate(row, BUILD);
}

static double medium_rate(const struct row *row)
{
    return rate(row, MEDIUM);
}

static double low_rate(const struct row *row)
{
    return rate(row, LOW);
}

static double over_medium(const struct row *row)
{
    return row->ms[MEDIUM] / row->ms[BUILD];
}

static double over_low(const struct row *row)
{
    return row->ms[LOW] / row->ms[BUILD];
}

static double over_medium_cpu(const struct row *row)
{
    return row->ms[MEDIUM_CPU] / row->ms[BUILD_CPU];
}

static double over_low_cpu(const struct row *row)
{
    return row->ms[LOW_CPU] / row->ms[BUILD_CPU];
}

static double sah_over_medium(const struct row *row)
{
    return row->sah / row->medium_sah;
}

static double sah_over_sweep(const struct row *row)
{
    return row->sah / row->sweep_sah;
}

static double bytes_a_triangle(const struct row *row)
{
    return (double)row->stats.sizes.total / row->triangles;
}

static void bench_threads(const struct options *options, unsigned threads, char **paths, int count)
{
    struct bench bench = {.options = options, .threads = threads};
    struct bvhd_error error;
    struct workers *workers;
    struct row rows[MAX_SCENES];
    memory_init(&bench.memory, UINT64_MAX);
    if (workers_create(threads, &workers, &error) != BVHD_OK)
        fail("start", &error);
    bench.parallel = workers_parallel(workers);
    printf("%u thread%s, builder %s, %s; times in ms, rates in million triangles a second, bytes a triangle\n", threads,
           threads == 1 ? "" : "s", build_builder_name(options->builder), build_quality_name(options->quality));
    printf("%-18s %8s | %7s %7s %7s %7s %7s %7s %7s %7s %7s | %6s %6s %6s %5s %5s | %5s %5s | %7s %7s %7s | %5s %5s "
           "%5s %5s | %s\n",
           "scene", "tris", "prepare", "boxes", "split", "pieces", "join", "depth", "collaps", "write", "build", "rate",
           "MEDIUM", "LOW8", "/MED", "/LOW8", "cpu/M", "cpu/L", "SAH", "MEDIUM", "sweep", "nodes", "recs", "verts",
           "all", "depth, method");
    for (int i = 0; i < count; i++) {
        rows[i] = measure(&bench, paths[i]);
        print_row(&rows[i]);
        fflush(stdout);
    }
    printf("geometric means:\n");
    print_mean("rate", rows, count, own_rate, true);
    print_mean("rtcBuildBVH MEDIUM", rows, count, medium_rate, true);
    print_mean("rtcBuildBVH LOW, 8-wide", rows, count, low_rate, true);
    print_mean("rate / MEDIUM", rows, count, over_medium, true);
    print_mean("rate / LOW, 8-wide", rows, count, over_low, true);
    print_mean("rate / MEDIUM, processor time", rows, count, over_medium_cpu, true);
    print_mean("rate / LOW, 8-wide, processor time", rows, count, over_low_cpu, true);
    print_mean("SAH / MEDIUM", rows, count, sah_over_medium, false);
    print_mean("SAH / full sweep", rows, count, sah_over_sweep, false);
    print_mean("bytes a triangle", rows, count, bytes_a_triangle, false);
    workers_destroy(workers);
}

static int usage(void)
{
    fprintf(stderr, "usage: bench_build [--builder own|embree] [--quality fast|balanced|high] [--runs N] "
                    "[--threads N] SCENE.ply...\n");
    return 2;
}

static bool parse(struct options *options, const char *name, const char *value)
{
    if (strcmp(name, "--runs") == 0) {
        options->runs = atoi(value);
        return options->runs >= 1 && options->runs <= MAX_RUNS;
    }
    if (strcmp(name, "--threads") == 0) {
        options->threads = (unsigned)atoi(value);
        return options->threads >= 1 && options->threads <= WORKERS_MAX_THREADS;
    }
    if (strcmp(name, "--builder") == 0)
        return build_builder_from_name(value, &options->builder);
    if (strcmp(name, "--quality") != 0)
        return false;
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
        if (strcmp(value, build_quality_name(quality)) == 0) {
            options->quality = quality;
            return true;
        }
    return false;
}

int main(int argc, char **argv)
{
    struct options options = {BUILDER_OWN, QUALITY_BALANCED, 5, 0};
    int first = 1;
    for (; first + 1 < argc && strncmp(argv[first], "--", 2) == 0; first += 2)
        if (!parse(&options, argv[first], argv[first + 1]))
            return usage();
    if (first >= argc || argc - first > MAX_SCENES)
        return usage();
    memory_keep();
    bench_threads(&options, options.threads ? options.threads : 2, argv + first, argc - first);
    if (options.threads == 0)
        bench_threads(&options, 1, argv + first, argc - first);
    return 0;
}
