/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_query.c - tests our structures in a driver against the driver's own of the same scene.
 *
 *     driver_query [--rays N] [--seed S] [--quality NAME] [--cases LIST] [DIR...]
 *
 * Both are traced with the same rays, by ray queries and by ray-tracing pipelines, with all flags, masks and decisions
 * about candidates. For each ray all values that the driver reports are equal to the last bit, or it is a tie: both
 * primitives have the same t, which is checked by tracing each primitive alone in the other structure.
 *
 * Without a DIR it uses generated scenes, one of them also with structures that were updated. A DIR is the output of
 * `bvhctl build` for the portable target; its scene is built again for the device.
 *
 * It prints one line for each scene, and for scenes of a DIR one for each case. The exit status is 3 when there is a
 * difference, and 77 where no device loads our structures.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/bench/bench_vulkan_rays.h"
#include "tests/bench/bench_vulkan_scene.h"
#include "builder/build.h"
#include "tests/support/driver/driver_judge.h"
#include "tests/support/driver/driver_world.h"
#include "tests/support/builder/builders.h"
#include "tests/support/driver/gpu_bed.h"
#include "builder/workers.h"

#define MUST(call) driver_scene_must((call), &error)

struct run {
    uint32_t rays;
    uint64_t seed;
    enum build_quality quality; /* of scenes from a DIR */
    const char *cases; /* of scenes from a DIR; NULL: all */
    struct memory memory;
    struct workers *workers;
    struct gpu *gpu;
    struct bvhd_format format;
    uint64_t worlds; /* that were built */
    bool has_failed;
};

/* Whether the comma-separated list of cases contains a name. Without a list all cases are chosen. */
static bool is_chosen(const struct run *run, const char *name)
{
    size_t length = strlen(name);
    for (const char *at = run->cases; at; at = strchr(at, ',')) {
        at += *at == ',';
        if (!strncmp(at, name, length) && (at[length] == ',' || !at[length]))
            return true;
    }
    return !run->cases;
}

static void print_tally(const char *scene, const char *what, const struct driver_tally *tally)
{
    printf("%-14s %-36s rays %8" PRIu64 " hits %8" PRIu64 " same %8" PRIu64 " tied %6" PRIu64 " another %6" PRIu64
           " lost %3" PRIu64 " wrong %" PRIu64,
           scene, what, tally->rays, tally->hits, tally->same, tally->tied, tally->another, tally->lost, tally->other);
    if (tally->candidates)
        printf(", candidates %" PRIu64 ", repeated %" PRIu64, tally->candidates, tally->repeated);
    printf("\n");
    fflush(stdout);
}

static void add(struct driver_tally *to, const struct driver_tally *tally)
{
    to->rays += tally->rays;
    to->hits += tally->hits;
    to->same += tally->same;
    to->tied += tally->tied;
    to->another += tally->another;
    to->lost += tally->lost;
    to->other += tally->other;
    to->candidates += tally->candidates;
    to->repeated += tally->repeated;
}

/* ---- Generated scenes ---- */

static void judge_world(struct run *run, struct driver_judge *judge, const struct driver_world *world, struct ray *rays)
{
    for (int kind = 0; kind < DRIVER_RAYS; kind++) {
        char what[64];
        driver_world_rays(world, (enum driver_rays)kind, run->seed + (uint64_t)kind, run->rays, rays);
        for (uint32_t i = 0; i < driver_case_count; i++) {
            snprintf(what, sizeof what, "%s, %s, query", world->name, driver_rays_names[kind]);
            driver_judge_queries(judge, what, &driver_cases[i], rays, run->rays);
            snprintf(what, sizeof what, "%s, %s, pipeline", world->name, driver_rays_names[kind]);
            driver_judge_pipelines(judge, what, &driver_cases[i], rays, run->rays);
        }
    }
}

static void run_world(struct run *run, const struct driver_world *world, enum build_quality quality, bool updates)
{
    struct driver_scene scene;
    struct driver_judge judge;
    const struct driver_scene_options options = {.gpu = run->gpu,
                                                 .format = &run->format,
                                                 .bottoms = world->bottoms,
                                                 .bottom_count = world->bottom_count,
                                                 .driver_bottoms = world->driver_bottoms,
                                                 .top = &world->top,
                                                 .quality = quality,
                                                 .builder = builders_turn(++run->worlds),
                                                 .updates = updates,
                                                 .parallel = workers_parallel(run->workers)};
    struct ray *rays = calloc(run->rays, sizeof *rays);
    driver_scene_init(&scene, &options);
    driver_judge_init(&judge, &scene, VK_NULL_HANDLE);
    judge.tells_repeated = quality == QUALITY_HIGH && !updates;
    judge_world(run, &judge, world, rays);
    print_tally(world->name, updates ? "updated" : build_quality_name(quality), &judge.tally);
    /*
     * A run that hits hardly anything tests nothing. Lost hits are accepted for a few rays, which lie in faces of
     * boxes.
     */
    run->has_failed = run->has_failed || judge.tally.other || judge.tally.lost * 100 > judge.tally.rays ||
                      judge.tally.hits * 20 < judge.tally.rays || !judge.tally.candidates;
    driver_judge_finish(&judge);
    driver_scene_finish(&scene);
    free(rays);
}

static void run_generated(struct run *run)
{
    static const struct {
        const char *name;
        uint32_t size;
        enum build_quality quality;
    } meshes[] = {{"sphere", 800, QUALITY_BALANCED}, {"grid", 800, QUALITY_FAST},  {"dup", 30, QUALITY_BALANCED},
                  {"slivers", 800, QUALITY_HIGH},    {"strip", 800, QUALITY_FAST}, {"stadium-like", 800, QUALITY_HIGH}};
    struct driver_world world;
    driver_world_init(&world, run->seed);
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
        run_world(run, &world, quality, false);
    run_world(run, &world, QUALITY_BALANCED, true);
    driver_world_finish(&world);
    for (size_t i = 0; i < sizeof meshes / sizeof *meshes; i++) {
        driver_world_init_mesh(&world, meshes[i].name, meshes[i].size, run->seed);
        run_world(run, &world, meshes[i].quality, false);
        driver_world_finish(&world);
    }
}

/* ---- Scenes from directories ---- */

typedef void (*judge_function)(struct driver_judge *, const char *, const struct driver_case *, const struct ray *,
                               uint32_t);

/* Judges one case and one kind of rays, by queries or by pipelines. Prints nothing where these do not apply. */
static void judge_some(struct driver_judge *judge, const char *scene, const char *what, judge_function function,
                       const struct driver_case *shared, const struct ray *rays, uint32_t count,
                       struct driver_tally *sum)
{
    judge->tally = (struct driver_tally){0};
    function(judge, what, shared, rays, count);
    if (judge->tally.rays)
        print_tally(scene, what, &judge->tally);
    add(sum, &judge->tally);
}

static void judge_files(struct run *run, const char *name, struct driver_judge *judge, const struct bench_rays *rays)
{
    static const enum bench_rays_kind kinds[] = {RAYS_PRIMARY, RAYS_RANDOM};
    struct driver_tally queries = {0}, pipelines = {0};
    for (uint32_t i = 0; i < driver_case_count; i++)
        for (int k = 0; k < 2 && is_chosen(run, driver_cases[i].name); k++) {
            char what[64];
            const struct ray *some = rays->rays[kinds[k]];
            uint32_t count = rays->count[kinds[k]];
            snprintf(what, sizeof what, "%s, %s, query", driver_cases[i].name, bench_rays_names[kinds[k]]);
            judge_some(judge, name, what, driver_judge_queries, &driver_cases[i], some, count, &queries);
            snprintf(what, sizeof what, "%s, %s, pipeline", driver_cases[i].name, bench_rays_names[kinds[k]]);
            judge_some(judge, name, what, driver_judge_pipelines, &driver_cases[i], some, count, &pipelines);
        }
    print_tally(name, "ALL, by queries", &queries);
    print_tally(name, "ALL, by pipelines", &pipelines);
    run->has_failed = run->has_failed || queries.other || pipelines.other;
}

static void run_files(struct run *run, const char *directory)
{
    struct bvhd_error error;
    struct bench_scene files;
    struct bench_rays rays;
    struct driver_scene scene;
    struct driver_judge judge;
    const struct parallel *parallel = workers_parallel(run->workers);
    const struct bench_scene_options from = {.directory = directory};
    MUST(bench_scene_open(&from, &run->memory, parallel, &files, &error));
    if (!files.given.has_top) {
        fprintf(stderr, "driver_query: %s: no top level\n", directory);
        exit(1);
    }
    const struct bench_rays_options wanted = {.count = run->rays,
                                              .kinds = {[RAYS_PRIMARY] = true, [RAYS_RANDOM] = true}};
    MUST(bench_rays_make(&files, &wanted, parallel, &run->memory, &rays, &error));
    const struct driver_scene_options options = {.gpu = run->gpu,
                                                 .format = &run->format,
                                                 .bottoms = files.bottoms,
                                                 .bottom_count = files.given.bottom_count,
                                                 .top = &files.top,
                                                 .quality = run->quality,
                                                 .parallel = parallel};
    driver_scene_init(&scene, &options);
    driver_judge_init(&judge, &scene, VK_NULL_HANDLE);
    judge.tells_repeated = options.quality == QUALITY_HIGH;
    judge_files(run, files.given.name, &judge, &rays);
    driver_judge_finish(&judge);
    driver_scene_finish(&scene);
    bench_rays_finish(&rays);
    bench_scene_close(&files);
}

/* ---- The command line ---- */

static void usage(void)
{
    fprintf(stderr,
            "usage: driver_query [--rays N] [--seed S] [--quality fast|balanced|high] [--cases LIST] [DIR...]\n");
    exit(2);
}

static enum build_quality quality_of(const char *name)
{
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
        if (!strcmp(name, build_quality_name(quality)))
            return quality;
    usage();
    return QUALITY_UNSPECIFIED;
}

/* Returns the index of the first argument that is no option. */
static int take_options(struct run *run, int argc, char **argv)
{
    int at = 1;
    for (; at + 1 < argc && argv[at][0] == '-'; at += 2)
        if (!strcmp(argv[at], "--rays"))
            run->rays = (uint32_t)strtoul(argv[at + 1], NULL, 10);
        else if (!strcmp(argv[at], "--seed"))
            run->seed = strtoull(argv[at + 1], NULL, 10);
        else if (!strcmp(argv[at], "--quality"))
            run->quality = quality_of(argv[at + 1]);
        else if (!strcmp(argv[at], "--cases"))
            run->cases = argv[at + 1];
        else
            usage();
    if ((at < argc && argv[at][0] == '-') || run->rays == 0)
        usage();
    return at;
}

int main(int argc, char **argv)
{
    static struct run run = {.rays = 500, .seed = 1, .quality = QUALITY_BALANCED};
    struct bvhd_error error;
    int at = take_options(&run, argc, argv);
    memory_init(&run.memory, UINT64_MAX);
    if (!driver_scene_device(&run.memory, &run.gpu, &run.format))
        return GPU_BED_SKIPPED;
    MUST(workers_create(0, &run.workers, &error));
    if (at == argc)
        run_generated(&run);
    for (; at < argc; at++)
        run_files(&run, argv[at]);
    gpu_close(run.gpu);
    workers_destroy(run.workers);
    if (gpu_messages()) {
        fprintf(stderr, "driver_query: %u messages of validation layers\n", gpu_messages());
        run.has_failed = true;
    }
    return run.has_failed || run.memory.live ? 3 : 0;
}
