/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_cancel - how long a build goes on after it was cancelled.
 *
 *     bench_cancel [--quality fast|balanced|high] [--triangles N] SCENE.ply
 *
 * The scene is repeated side by side until it has N triangles (2,000,000). One build runs to its end; then twenty are cancelled, at evenly
 * spaced moments of that time, and what passes between the flag and build()'s return is printed. Two threads.
 */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "build.h"
#include "ply_input.h"
#include "prepare.h"
#include "workers.h"

enum { MOMENTS = 20 };

struct cancelling {
    atomic_bool cancel;
    double after; /* ms */
    double at; /* when the flag was set */
};

static double milliseconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

static void fail(const char *what)
{
    fprintf(stderr, "bench_cancel: %s\n", what);
    exit(1);
}

/* Copies beside each other along x. */
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
        many->indices[i] =
            ply->indices[i % ((size_t)ply->triangle_count * 3)] + (uint32_t)(i / ((size_t)ply->triangle_count * 3)) * ply->vertex_count;
    ply_free(ply);
    return many;
}

static void *set_flag(void *context)
{
    struct cancelling *cancelling = context;
    struct timespec wait = {(time_t)(cancelling->after / 1e3), (long)(cancelling->after * 1e6) % 1000000000};
    nanosleep(&wait, NULL);
    cancelling->at = milliseconds();
    atomic_store(&cancelling->cancel, true);
    return NULL;
}

/* Returns the time of a whole build. */
static double build_once(const struct canonical *canonical, const struct build_input *input, struct build_context *context)
{
    struct build_stats stats;
    unsigned char *blob;
    double begin = milliseconds();
    if (build(canonical, &input->options, context, &blob, &stats, NULL) != BVHD_OK)
        fail("the build failed");
    double ms = milliseconds() - begin;
    memory_free(context->memory, blob);
    return ms;
}

/* Returns what passed after the flag, or a negative number when the build was done before. */
static double cancel_once(const struct canonical *canonical, const struct build_input *input, struct build_context *context,
                          double after)
{
    struct cancelling cancelling = {.after = after};
    struct build_stats stats;
    unsigned char *blob;
    pthread_t thread;
    context->cancel = &cancelling.cancel;
    if (pthread_create(&thread, NULL, set_flag, &cancelling) != 0)
        fail("no thread");
    enum bvhd_status status = build(canonical, &input->options, context, &blob, &stats, NULL);
    double end = milliseconds();
    pthread_join(thread, NULL);
    context->cancel = NULL;
    if (status == BVHD_OK)
        memory_free(context->memory, blob);
    return status == BVHD_CANCELLED ? end - cancelling.at : -1;
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void measure(const struct ply *ply, enum build_quality quality)
{
    struct bvhd_error error;
    struct limits limits = limits_default();
    struct memory memory;
    struct workers *workers;
    struct embree *embree = NULL;
    struct canonical canonical;
    struct geometry geometry;
    struct build_input input = ply_input(ply, quality, &geometry);
    double latencies[MOMENTS];
    int cancelled = 0;
    memory_init(&memory, UINT64_MAX);
    if (workers_create(2, &workers, &error) != BVHD_OK || embree_create(&embree, &error) != BVHD_OK)
        fail(error.text);
    struct build_context context = {.embree = embree, .memory = &memory, .parallel = workers_parallel(workers)};
    if (prepare(&input, 0, &limits, &context, &canonical, &error) != BVHD_OK)
        fail(error.text);
    double whole = build_once(&canonical, &input, &context);
    for (int i = 0; i < MOMENTS; i++) {
        double latency = cancel_once(&canonical, &input, &context, whole * i / MOMENTS);
        if (latency >= 0)
            latencies[cancelled++] = latency;
    }
    qsort(latencies, (size_t)cancelled, sizeof *latencies, by_value);
    printf("%u triangles, %s: a build takes %.1f ms; cancelled %d times, returned after %.2f ms (median), %.2f ms (most)\n",
           ply->triangle_count, build_quality_name(quality), whole, cancelled, cancelled ? latencies[cancelled / 2] : 0,
           cancelled ? latencies[cancelled - 1] : 0);
    prepare_finish(&canonical, &memory);
    embree_destroy(embree);
    workers_destroy(workers);
}

static enum build_quality quality_named(const char *name)
{
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
        if (strcmp(name, build_quality_name(quality)) == 0)
            return quality;
    fail("unknown quality");
    return QUALITY_UNSPECIFIED;
}

int main(int argc, char **argv)
{
    enum build_quality quality = QUALITY_BALANCED;
    long triangles = 2000000;
    int first = 1;
    for (; first + 1 < argc && strncmp(argv[first], "--", 2) == 0; first += 2) {
        if (strcmp(argv[first], "--quality") == 0)
            quality = quality_named(argv[first + 1]);
        else if (strcmp(argv[first], "--triangles") == 0)
            triangles = atol(argv[first + 1]);
        else
            break;
    }
    if (first + 1 != argc || triangles < 1 || triangles > 100000000) {
        fprintf(stderr, "usage: bench_cancel [--quality fast|balanced|high] [--triangles N] SCENE.ply\n");
        return 2;
    }
    struct ply *ply = ply_read(argv[first]);
    if (!ply)
        return 1;
    ply = repeat(ply, (uint32_t)triangles);
    measure(ply, quality);
    ply_free(ply);
    return 0;
}
