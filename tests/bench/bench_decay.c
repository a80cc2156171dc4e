/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_decay - measures what updates cost in rays a second as a mesh is twisted, beside a build of each pose.
 *
 *     bench_decay [--quality NAME] [--size N] [--picture N] [--runs N] [--threads N] [--from DEGREES] [-o DIR]
 *                 SCENE...
 *
 * A scene is a PLY file or the name of a generated scene (bvhd_bench/scene_source.h) of N triangles (50,000). It is
 * built once, twisted by DEGREES (0), and updated from there to each angle: the two ends of its longest axis are then
 * turned against each other by that angle. Rays are those of a picture of N x N pixels (192), and as many diffuse ones,
 * through the CPU traversal. Times are medians of N runs (5), in processor time with one thread (the default), and in
 * wall-clock time with more. NAME is fast, balanced (the default) or high. A table goes to stdout, and then what the
 * rule of builder/update/decay.h rests on and what it loses; DIR gets decay.csv, and the chart as decay.svg and .png.
 */
#include "tests/bench/bench_decay.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/input/prepare.h"
#include "builder/update/decay.h"
#include "builder/update/refit.h"
#include "builder/update/update_rules.h"
#include "tests/bench/bvhd_bench/ray_sets.h"
#include "tests/bench/bvhd_bench/scene_source.h"
#include "tests/bench/bvhd_bench/statistic.h"
#include "tests/bench/bvhd_bench/stopwatch.h"
#include "tests/bench/bvhd_bench/subject.h"
#include "tests/bench/ply_input.h"

struct options {
    uint32_t size, picture;
    unsigned threads;
    int runs;
    double from;
    const struct method *method;
    const char *directory;
};

static const double angles[DECAY_ANGLES] = {0, 10, 20, 30, 45, 60, 90, 135, 180, 270, 360, 540, 720, 1440};

static const enum ray_kind kinds[DECAY_KINDS] = {RAYS_PRIMARY, RAYS_DIFFUSE};

/* A structure of one pose, and its record. */
struct pose {
    struct canonical canonical;
    struct record record;
    struct subject subject;
    double cost, decay;
};

double decay_slowdown(const struct decay_row *row)
{
    return row->fresh_rate[1] / row->rate[1];
}

double decay_break_even(const struct decay_scene *scene, const struct decay_row *row)
{
    const double saved_us = 1 / row->rate[1] - 1 / row->fresh_rate[1];
    return saved_us > 0 ? 1e3 * (row->build_ms - row->update_ms) / saved_us / scene->triangles : INFINITY;
}

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "bench_decay: %s: %s\n", error->where, error->text);
    exit(1);
}

/* ---- meshes ---- */

static int longest_axis(const struct ply *mesh, float ret_low[3], float ret_high[3])
{
    int longest = 0;
    for (int axis = 0; axis < 3; axis++) {
        ret_low[axis] = INFINITY;
        ret_high[axis] = -INFINITY;
        for (uint32_t i = 0; i < mesh->vertex_count; i++) {
            ret_low[axis] = fminf(ret_low[axis], mesh->positions[3 * (size_t)i + (size_t)axis]);
            ret_high[axis] = fmaxf(ret_high[axis], mesh->positions[3 * (size_t)i + (size_t)axis]);
        }
        if (ret_high[axis] - ret_low[axis] > ret_high[longest] - ret_low[longest])
            longest = axis;
    }
    return longest;
}

/* Returns the mesh with other positions, which the caller frees. */
static struct ply twisted(const struct ply *mesh, double degrees)
{
    float low[3], high[3];
    const int axis = longest_axis(mesh, low, high), u = (axis + 1) % 3, v = (axis + 2) % 3;
    const double u_middle = (low[u] + high[u]) / 2, v_middle = (low[v] + high[v]) / 2;
    struct ply pose = *mesh;
    pose.positions = tree_need(mesh->vertex_count, 3 * sizeof *pose.positions);
    for (uint32_t i = 0; i < mesh->vertex_count; i++) {
        const float *from = mesh->positions + 3 * (size_t)i;
        float *to = pose.positions + 3 * (size_t)i;
        const double turn = degrees * (M_PI / 180) * ((from[axis] - low[axis]) / (high[axis] - low[axis]) - 0.5),
                     x = from[u] - u_middle, y = from[v] - v_middle;
        to[axis] = from[axis];
        to[u] = (float)(u_middle + x * cos(turn) - y * sin(turn));
        to[v] = (float)(v_middle + x * sin(turn) + y * cos(turn));
    }
    return pose;
}

/* ---- structures ---- */

static struct build_context context_of(struct bench *bench)
{
    return (struct build_context){.memory = &bench->memory, .parallel = bench->parallel};
}

static struct pose start(struct bench *bench, const struct method *method, const struct ply *mesh,
                         struct build_options *ret_options)
{
    const struct limits limits = limits_default();
    const struct build_context context = context_of(bench);
    struct pose pose = {.subject = {.method = method, .memory = &bench->memory}, .decay = 1};
    struct geometry geometry;
    struct bvhd_error error;
    struct build_input input = ply_input(mesh, method->quality, &geometry);
    input.flags = BUILD_ALLOW_UPDATE;
    *ret_options = input.options;
    must(prepare(&input, 0, &limits, &context, &pose.canonical, &error), &error);
    must(record_make(&pose.canonical, ret_options, &context, &pose.record, &error), &error);
    return pose;
}

static void open_pose(struct pose *pose)
{
    struct bvhd_error error;
    pose->subject.bytes = pose->subject.stats.sizes.total;
    must(portable_open((struct bytes){pose->subject.blob, pose->subject.bytes}, pose->subject.memory,
                       &pose->subject.portable, &error),
         &error);
}

static struct pose build_pose(struct bench *bench, const struct method *method, const struct ply *mesh)
{
    const struct build_context context = context_of(bench);
    struct build_options options;
    struct bvhd_error error;
    struct pose pose = start(bench, method, mesh, &options);
    struct subject *subject = &pose.subject;
    const double begin = stopwatch_ms(bench->threads);
    must(build(&pose.canonical, &options, &context, &subject->blob, &subject->stats, &error), &error);
    subject->ms = stopwatch_ms(bench->threads) - begin;
    open_pose(&pose);
    must(refit_measure((struct bytes){subject->blob, subject->bytes}, &subject->stats, &context, &pose.record, &error),
         &error);
    pose.cost = pose.record.header->cost;
    return pose;
}

static struct pose update_pose(struct bench *bench, const struct ply *mesh, const struct pose *source)
{
    const struct build_context context = context_of(bench);
    struct build_options options;
    struct refit_result result;
    struct bvhd_error error;
    struct pose pose = start(bench, source->subject.method, mesh, &options);
    struct subject *subject = &pose.subject;
    must(update_rules_check(&source->record, &pose.record, 0, &error), &error);
    const struct refit_request request = {
        {source->subject.blob, source->subject.bytes}, &source->record, &pose.canonical, &pose.record};
    const double begin = stopwatch_ms(bench->threads);
    must(refit(&request, &context, &subject->blob, &subject->stats, &result, &error), &error);
    subject->ms = stopwatch_ms(bench->threads) - begin;
    open_pose(&pose);
    pose.cost = subject->stats.sah;
    pose.decay = result.decay;
    return pose;
}

static void finish_pose(struct bench *bench, struct pose *pose)
{
    record_finish(&pose->record, &bench->memory);
    prepare_finish(&pose->canonical, &bench->memory);
    subject_finish(&pose->subject);
}

/* ---- measuring ---- */

static void time_rays(const struct pose *pose, const struct ray_sets *rays, enum ray_kind kind,
                      struct statistic *ret_rate)
{
    uint32_t hits = 0;
    struct ray_hit hit;
    const double begin = stopwatch_of(CLOCK_THREAD_CPUTIME_ID);
    for (uint32_t i = 0; i < rays->counts[kind]; i++)
        hits += subject_trace(&pose->subject, &rays->rays[kind][i], &hit, NULL);
    const double ms = stopwatch_of(CLOCK_THREAD_CPUTIME_ID) - begin;
    if (hits <= rays->counts[kind] && ms > 0)
        statistic_add(ret_rate, 1e-3 * rays->counts[kind] / ms);
}

static void measure_rays(const struct options *options, const struct ply *mesh, const struct pose *updated,
                         const struct pose *fresh, struct decay_row *row)
{
    struct ray_sets rays = ray_sets_make(&fresh->subject, mesh, options->picture);
    for (int kind = 0; kind < DECAY_KINDS; kind++) {
        struct statistic rate = {.count = 0}, fresh_rate = {.count = 0};
        for (int run = 0; run < options->runs; run++) {
            time_rays(updated, &rays, kinds[kind], &rate);
            time_rays(fresh, &rays, kinds[kind], &fresh_rate);
        }
        row->rate[kind] = statistic_median(&rate);
        row->fresh_rate[kind] = statistic_median(&fresh_rate);
    }
    ray_sets_finish(&rays);
}

static struct decay_row measure_angle(struct bench *bench, const struct options *options, const struct ply *mesh,
                                      const struct pose *source, double angle)
{
    struct decay_row row = {.angle = angle};
    struct statistic update_ms = {.count = 0}, build_ms = {.count = 0};
    struct ply moved = twisted(mesh, angle);
    for (int run = 0; run < options->runs; run++) {
        struct pose updated = update_pose(bench, &moved, source), fresh = build_pose(bench, options->method, &moved);
        statistic_add(&update_ms, updated.subject.ms);
        statistic_add(&build_ms, fresh.subject.ms);
        if (run + 1 == options->runs) {
            row.decay = updated.decay;
            row.cost = updated.cost;
            row.fresh_cost = fresh.cost;
            measure_rays(options, &moved, &updated, &fresh, &row);
        }
        finish_pose(bench, &updated);
        finish_pose(bench, &fresh);
    }
    row.update_ms = statistic_median(&update_ms);
    row.build_ms = statistic_median(&build_ms);
    free(moved.positions);
    return row;
}

static void print_row(FILE *file, const char *format, const struct decay_scene *scene, const struct decay_row *row)
{
    fprintf(file, format, scene->name, row->angle, row->decay, row->cost, row->fresh_cost, row->cost / row->fresh_cost,
            row->rate[0], row->fresh_rate[0], row->rate[0] / row->fresh_rate[0], row->rate[1], row->fresh_rate[1],
            row->rate[1] / row->fresh_rate[1], row->update_ms, row->build_ms, decay_break_even(scene, row));
}

static bool measure(struct bench *bench, const struct options *options, const char *path, struct decay_scene *ret_scene)
{
    const char *slash = strrchr(path, '/');
    struct ply *mesh = scene_source_open(path, options->size, 1);
    if (!mesh)
        return false;
    struct ply first = twisted(mesh, options->from);
    struct pose source = build_pose(bench, options->method, &first);
    *ret_scene = (struct decay_scene){.name = slash ? slash + 1 : path, .triangles = mesh->triangle_count};
    for (int i = 0; i < DECAY_ANGLES; i++) {
        ret_scene->rows[i] = measure_angle(bench, options, mesh, &source, angles[i]);
        print_row(stdout,
                  "%-16s %5.0f | %7.3f %8.2f %8.2f %6.3f | %6.3f %6.3f %6.3f | %6.3f %6.3f %6.3f | %7.2f %7.2f | "
                  "%8.2f\n",
                  ret_scene, &ret_scene->rows[i]);
        fflush(stdout);
    }
    finish_pose(bench, &source);
    free(first.positions);
    ply_free(mesh);
    return true;
}

/* ---- the rule ---- */

static void print_build_in_rays(const struct decay_scene *scene)
{
    struct statistic value = {.count = 0};
    for (int i = 0; i < DECAY_ANGLES; i++)
        statistic_add(&value, 1e3 * scene->rows[i].build_ms * scene->rows[i].fresh_rate[1] / scene->triangles);
    printf("%-16s a build takes as long as %.3f diffuse rays for each primitive (%.3f to %.3f)\n", scene->name,
           statistic_median(&value), statistic_least(&value), statistic_most(&value));
}

/* Returns how much longer the rule's choice takes than the better of updating and building, as a share. */
static double loss_of(const struct decay_results *results, const struct decay_scene *scene, const struct decay_row *row,
                      double rays)
{
    const double updated = row->update_ms + 1e-3 * rays * scene->triangles / row->rate[1],
                 built = row->build_ms + 1e-3 * rays * scene->triangles / row->fresh_rate[1];
    const bool builds = row->decay > decay_to_rebuild(results->quality, rays);
    return (builds ? built : updated) / fmin(updated, built) - 1;
}

static void print_loss(const struct decay_results *results, double rays)
{
    double sum = 0, most = 0;
    for (int i = 0; i < results->scene_count; i++)
        for (int k = 0; k < DECAY_ANGLES; k++) {
            const double loss = loss_of(results, &results->scenes[i], &results->scenes[i].rows[k], rays);
            sum += loss;
            most = fmax(most, loss);
        }
    printf("with %g rays a primitive the rule loses %.1f %% on average, and %.1f %% at most\n", rays,
           100 * sum / (DECAY_ANGLES * results->scene_count), 100 * most);
}

static void print_rule(const struct decay_results *results)
{
    static const double rays[] = {0.1, 0.3, 1, 3, 10, 30};
    for (int i = 0; i < results->scene_count; i++)
        print_build_in_rays(&results->scenes[i]);
    for (size_t i = 0; i < sizeof rays / sizeof *rays; i++)
        print_loss(results, rays[i]);
}

/* ---- the program ---- */

static bool write_table(const struct decay_results *results, const char *directory)
{
    char path[4200];
    snprintf(path, sizeof path, "%s/decay.csv", directory);
    FILE *file = fopen(path, "w");
    if (!file) {
        fprintf(stderr, "bench_decay: %s: %s\n", path, strerror(errno));
        return false;
    }
    fprintf(file, "scene,angle,decay,cost,fresh_cost,cost_ratio,primary_mrays_s,fresh_primary_mrays_s,primary_ratio,"
                  "diffuse_mrays_s,fresh_diffuse_mrays_s,diffuse_ratio,update_ms,build_ms,break_even_rays\n");
    for (int i = 0; i < results->scene_count; i++)
        for (int k = 0; k < DECAY_ANGLES; k++)
            print_row(file, "%s,%g,%g,%g,%g,%g,%g,%g,%g,%g,%g,%g,%g,%g,%g\n", &results->scenes[i],
                      &results->scenes[i].rows[k]);
    return fclose(file) == 0;
}

static int usage(void)
{
    fprintf(stderr,
            "usage: bench_decay [--quality NAME] [--size N] [--picture N] [--runs N] [--threads N] "
            "[--from DEGREES] [-o DIR] SCENE...\n       (at most 8 scenes; the picture's size is a multiple of 8)\n");
    return 2;
}

static bool parse(struct options *options, const char *name, const char *value)
{
    if (strcmp(name, "-o") == 0)
        options->directory = value;
    else if (strcmp(name, "--quality") == 0)
        options->method = strchr(value, '/') ? NULL : method_find(value);
    else if (strcmp(name, "--from") == 0)
        options->from = atof(value);
    else if (strcmp(name, "--size") == 0)
        options->size = (uint32_t)atoi(value);
    else if (strcmp(name, "--picture") == 0)
        options->picture = (uint32_t)atoi(value);
    else if (strcmp(name, "--runs") == 0)
        options->runs = atoi(value);
    else if (strcmp(name, "--threads") == 0)
        options->threads = (unsigned)atoi(value);
    else
        return false;
    return options->method && options->method->kind == METHOD_OWN && options->size >= 100 && options->picture >= 8 &&
           options->picture % 8 == 0 && options->picture <= 4096 && options->runs >= 1 &&
           options->runs <= STATISTIC_MAX && options->threads >= 1 && options->threads <= WORKERS_MAX_THREADS;
}

int main(int argc, char **argv)
{
    struct options options = {.size = 50000, .picture = 192, .runs = 5, .threads = 1};
    options.method = method_find("balanced");
    static struct decay_results results;
    struct bench bench;
    int first = 1;
    for (; first + 1 < argc && argv[first][0] == '-'; first += 2)
        if (!parse(&options, argv[first], argv[first + 1]))
            return usage();
    if (first >= argc || argc - first > DECAY_SCENES)
        return usage();
    if (!bench_start(options.threads, &bench))
        return 1;
    results.from = options.from;
    results.quality = options.method->quality;
    printf("%u threads, %s, portable, built at %g degrees; rates in Mray/s, times in ms\n", options.threads,
           options.method->name, options.from);
    printf("%-16s %5s | %7s %8s %8s %6s | %6s %6s %6s | %6s %6s %6s | %7s %7s | %s\n", "scene", "angle", "decay",
           "cost", "fresh", "ratio", "prim.", "fresh", "ratio", "diff.", "fresh", "ratio", "update", "build",
           "rays a primitive");
    for (int i = first; i < argc; i++)
        if (!measure(&bench, &options, argv[i], &results.scenes[results.scene_count++]))
            return 1;
    bench_stop(&bench);
    print_rule(&results);
    if (!options.directory)
        return 0;
    return write_table(&results, options.directory) && decay_chart(&results, options.directory) ? 0 : 1;
}
