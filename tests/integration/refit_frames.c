/* SPDX-License-Identifier: Apache-2.0 */
/*
 * refit_frames.c - tests updates of one mesh to others with the same triangles, in every layout.
 *
 *     refit_frames [SOURCE.ply FRAME.ply...]
 *
 * The source is built once for each quality and layout, and updated to each frame. Rays through the result are compared
 * with brute force over the frame. One line a quality, frame and layout tells the decay, and how much more the updated
 * tree costs than one that is built for the frame. Without files the source is a sheet, which is twisted and torn
 * apart.
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/input/prepare.h"
#include "builder/traverse/lavapipe_traverse.h"
#include "builder/update/refit.h"
#include "builder/update/update_rules.h"
#include "client/bvhctl/oracle/rays.h"
#include "tests/bench/ply_input.h"
#include "tests/support/random.h"

enum { RAYS = 400, SIDE = 48, FRAMES = 3, LAYOUTS = 4 };

static const enum build_quality qualities[] = {QUALITY_FAST, QUALITY_BALANCED, QUALITY_HIGH};

static const char *const quality_names[] = {"fast", "balanced", "high"};

struct run {
    int quality; /* the index of the one that is built */
    struct build_options layouts[LAYOUTS]; /* in that quality */
    struct memory memory;
    struct build_context context;
    uint64_t wrong, hits;
};

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "refit_frames: %s: %s\n", error->where, error->text);
    exit(1);
}

/* ---- meshes ---- */

/* Makes a sheet with two triangles a cell. Frame 0 is flat but for waves, 1 and 2 are twisted, 3 is torn apart. */
static struct ply *make_sheet(int frame)
{
    static const double turns[] = {0, 1, 4, 0};
    struct ply *ply = calloc(1, sizeof *ply);
    struct random random = {99};
    ply->vertex_count = SIDE * SIDE;
    ply->triangle_count = 2 * (SIDE - 1) * (SIDE - 1);
    ply->positions = calloc(ply->vertex_count, 12);
    ply->indices = calloc(ply->triangle_count, 12);
    for (uint32_t i = 0; i < ply->vertex_count; i++) {
        const double x = (double)(i % SIDE) / SIDE - 0.5, y = (double)(i / SIDE) / SIDE, z = 0.05 * sin(20 * x + 9 * y),
                     angle = 6.283185307 * turns[frame] * y;
        const double place[3] = {x * cos(angle) - z * sin(angle), y, x * sin(angle) + z * cos(angle)};
        for (int axis = 0; axis < 3; axis++)
            ply->positions[3 * i + (uint32_t)axis] =
                (float)(frame == FRAMES ? random_between(&random, -1, 1) : place[axis]);
    }
    for (uint32_t i = 0; i < ply->triangle_count; i++) {
        const uint32_t cell = i / 2, a = cell / (SIDE - 1) * SIDE + cell % (SIDE - 1);
        const uint32_t corners[2][3] = {{a, a + 1, a + SIDE}, {a + 1, a + SIDE + 1, a + SIDE}};
        memcpy(ply->indices + 3 * (size_t)i, corners[i % 2], sizeof corners[0]);
    }
    return ply;
}

static void free_sheet(struct ply *ply)
{
    free(ply->positions);
    free(ply->indices);
    free(ply);
}

/* ---- one frame in one layout ---- */

static const struct build_options all_layouts[LAYOUTS] = {
    {.target = TARGET_PORTABLE},
    {.target = TARGET_PORTABLE, .layout_flags = PORTABLE_FAST_TRIANGLES},
    {.target = TARGET_LAVAPIPE, .device.variant = LAVAPIPE_PLAIN},
    {.target = TARGET_LAVAPIPE, .device.variant = LAVAPIPE_COMPACTED},
};

static const char *const layout_names[LAYOUTS] = {"portable", "portable, fast triangles", "lavapipe plain",
                                                  "lavapipe compacted"};

/* A structure with its record; `cost` is that of its tree. */
struct built {
    struct canonical canonical;
    struct record record;
    unsigned char *blob;
    struct build_stats stats;
    double cost, decay;
};

static void start(struct run *run, const struct ply *ply, const struct build_options *options, struct built *ret)
{
    const struct limits limits = limits_default();
    struct geometry geometry;
    struct bvhd_error error;
    struct build_input input = ply_input(ply, options->quality, &geometry);
    input.flags = BUILD_ALLOW_UPDATE;
    *ret = (struct built){.decay = 1};
    must(prepare(&input, 0, &limits, &run->context, &ret->canonical, &error), &error);
    must(record_make(&ret->canonical, options, &run->context, &ret->record, &error), &error);
}

static struct built build_frame(struct run *run, const struct ply *ply, const struct build_options *options)
{
    struct built built;
    struct bvhd_error error;
    start(run, ply, options, &built);
    must(build(&built.canonical, options, &run->context, &built.blob, &built.stats, &error), &error);
    must(refit_measure((struct bytes){built.blob, built.stats.sizes.total}, &built.stats, &run->context, &built.record,
                       &error),
         &error);
    built.cost = built.record.header->cost;
    if (built.stats.quality != options->quality)
        run->wrong++;
    return built;
}

static struct built update_frame(struct run *run, const struct ply *ply, const struct build_options *options,
                                 const struct built *source)
{
    struct built built;
    struct refit_result result;
    struct bvhd_error error;
    start(run, ply, options, &built);
    must(update_rules_check(&source->record, &built.record, 0, &error), &error);
    const struct refit_request request = {
        {source->blob, source->stats.sizes.total}, &source->record, &built.canonical, &built.record};
    must(refit(&request, &run->context, &built.blob, &built.stats, &result, &error), &error);
    built.cost = built.stats.sah;
    built.decay = result.decay;
    return built;
}

static void finish(struct run *run, struct built *built)
{
    record_finish(&built->record, &run->memory);
    prepare_finish(&built->canonical, &run->memory);
    memory_free(&run->memory, built->blob);
}

static uint64_t judge(struct run *run, const struct built *built, bool is_native, const struct ray *rays,
                      const struct oracle_answer *answers)
{
    const struct bytes blob = {built->blob, built->stats.sizes.total};
    struct portable_view view;
    struct lavapipe_view native;
    const struct portable_view *views[1] = {&view};
    const struct lavapipe_view *natives[1] = {&native};
    const struct scene scene = {.bottoms = views, .bottom_count = 1};
    const struct lavapipe_scene native_scene = {.bottoms = natives, .bottom_count = 1};
    struct bvhd_error error;
    uint64_t wrong = 0;
    must(is_native ? lavapipe_open_any(blob, &run->memory, &native, &error)
                   : portable_open(blob, &run->memory, &view, &error),
         &error);
    for (uint32_t i = 0; i < RAYS; i++) {
        struct ray_hit hit;
        bool is_hit = is_native ? lavapipe_traverse(&native_scene, &rays[i], NULL, &hit, NULL)
                                : traverse(&scene, &rays[i], NULL, &hit, NULL);
        run->hits += is_hit;
        wrong += oracle_judge(&answers[i], is_hit ? &hit : NULL, NULL) > ORACLE_UNDECIDED;
    }
    return wrong;
}

static void run_frame(struct run *run, const struct built sources[LAYOUTS], const struct ply *ply, const char *name)
{
    const struct oracle_mesh mesh = {.positions = ply->positions,
                                     .indices = ply->indices,
                                     .primitive_count = ply->triangle_count,
                                     .instance = RAY_NO_INSTANCE};
    struct ray rays[RAYS];
    struct oracle_answer answers[RAYS];
    struct bvhd_error error;
    rays_make(&mesh, 1, 5, RAYS, rays);
    must(oracle_trace(&mesh, 1, rays, RAYS, &run->memory, &parallel_serial, NULL, NULL, answers, &error), &error);
    for (int i = 0; i < LAYOUTS; i++) {
        struct built updated = update_frame(run, ply, &run->layouts[i], &sources[i]),
                     fresh = build_frame(run, ply, &run->layouts[i]);
        uint64_t wrong = judge(run, &updated, run->layouts[i].target == TARGET_LAVAPIPE, rays, answers);
        run->wrong += wrong;
        printf("%-8s %-20s %-24s decay %8.3f, against a build %8.3f, %u rays, %llu wrong\n",
               quality_names[run->quality], name, layout_names[i], updated.decay, updated.cost / fresh.cost, RAYS,
               (unsigned long long)wrong);
        finish(run, &updated);
        finish(run, &fresh);
    }
    oracle_finish(answers, RAYS, &run->memory);
}

static struct ply *read_frame(int argc, char **argv, int frame)
{
    struct ply *ply = argc > 1 ? ply_read(argv[1 + frame]) : make_sheet(frame);
    if (!ply)
        exit(1);
    return ply;
}

static void run_quality(struct run *run, int argc, char **argv)
{
    static const char *const names[] = {"", "one turn", "four turns", "torn apart"};
    struct built sources[LAYOUTS];
    const int frames = argc > 1 ? argc - 2 : FRAMES;
    struct ply *first = read_frame(argc, argv, 0);
    memcpy(run->layouts, all_layouts, sizeof all_layouts);
    for (int i = 0; i < LAYOUTS; i++)
        run->layouts[i].quality = qualities[run->quality];
    for (int i = 0; i < LAYOUTS; i++)
        sources[i] = build_frame(run, first, &run->layouts[i]);
    for (int frame = 1; frame <= frames; frame++) {
        struct ply *ply = read_frame(argc, argv, frame);
        const char *slash = argc > 1 ? strrchr(argv[1 + frame], '/') : NULL;
        run_frame(run, sources, ply, slash ? slash + 1 : argc > 1 ? argv[1 + frame] : names[frame]);
        (argc > 1 ? ply_free : free_sheet)(ply);
    }
    for (int i = 0; i < LAYOUTS; i++)
        finish(run, &sources[i]);
    (argc > 1 ? ply_free : free_sheet)(first);
}

int main(int argc, char **argv)
{
    struct run run = {.wrong = 0};
    memory_init(&run.memory, UINT64_MAX);
    run.context = (struct build_context){.memory = &run.memory, .parallel = &parallel_serial};
    for (; run.quality < (int)(sizeof qualities / sizeof *qualities); run.quality++)
        run_quality(&run, argc, argv);
    if (run.memory.live)
        fprintf(stderr, "refit_frames: %llu bytes are left\n", (unsigned long long)run.memory.live);
    return run.wrong > 0 || run.memory.live > 0 || run.hits < 300;
}
