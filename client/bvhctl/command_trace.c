/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/picture/agreement.h"
#include "proto/base/clock.h"
#include "client/bvhctl/command_trace.h"
#include "client/bvhctl/commands.h"
#include "builder/format/layout.h"
#include "client/bvhctl/service/local.h"
#include "client/bvhctl/picture/picture.h"

/*
 * Limits for the camera rays of a picture by the CPU that are compared with brute force: the number of rays, on a
 * square of CHECKED_SIDE rays a side, and of pairs of a ray and a triangle.
 */
enum { CHECKED_RAYS = 1024, CHECKED_SIDE = 32 };
static const double checked_pairs = 4e8;

/* Samples at once. Devices need more, to keep many threads busy. */
enum { CPU_BATCH = 1 << 14, DEVICE_BATCH = 1 << 18 };

/* How long brute force judges answers of a device that differ from the CPU's. */
static const double judge_seconds = 30;

enum { RAYS_A_PIXEL = 20 };
static const double affordable_tests = 2e10;

/* The state of `bvhctl trace`. */
struct trace_command {
    const struct options *options;
    tracer_chooser choose;
    struct local local;
    struct structures structures;
    struct tracer_choice choice;
    struct surfaces surfaces;
    struct stage stage;
    struct camera camera;
    struct picture picture;
    struct agreement agreement;
    double wall_ms;
    bool is_misnamed; /* no device has the name that the options give */
};

/*
 * Refuses scenes in which every ray would test every triangle, so that a picture would take days. That happens where
 * boxes do not separate triangles: if there are many copies of one, or coordinates are near the smallest floats.
 */
static enum bvhd_status check_cost(const struct trace_command *run, struct bvhd_error *error)
{
    double tests = stage_cost(&run->stage) * RAYS_A_PIXEL * run->options->width * run->options->height;
    if (tests <= affordable_tests)
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_TOO_LARGE, run->structures.name,
                          "about %.0e triangle tests for this picture; a smaller --size may do", tests);
}

static enum bvhd_status choose_camera(struct trace_command *run, struct bvhd_error *error)
{
    uint64_t rays;
    struct camera_options options = {.aspect = (double)run->options->width / run->options->height};
    return camera_choose(&run->stage, &options, run->local.parallel, &run->local.memory, &run->camera, &rays, error);
}

static enum bvhd_status render(struct trace_command *run, struct bvhd_error *error)
{
    struct light light;
    light_init(&light, &run->stage, &run->surfaces, &run->camera);
    struct picture_options options = {.light = &light,
                                      .tracer = run->choice.tracer,
                                      .parallel = run->local.parallel,
                                      .width = run->options->width,
                                      .height = run->options->height,
                                      .batch = run->choice.is_cpu ? CPU_BATCH : DEVICE_BATCH,
                                      .watch = run->choice.is_cpu ? NULL : agreement_watch,
                                      .watch_context = &run->agreement,
                                      .progress = progress_update,
                                      .progress_context = &run->local.progress};
    double start = clock_ms();
    progress_begin(&run->local.progress, "tracing", run->structures.name);
    enum bvhd_status status = picture_render(&options, &run->local.memory, &run->picture, error);
    progress_end(&run->local.progress);
    run->wall_ms = clock_ms() - start;
    return status;
}

/* Makes rays of the picture's camera that are spread over the picture. */
static void make_checked_rays(const struct trace_command *run, uint32_t count, struct ray *rays)
{
    double step = (double)CHECKED_RAYS / count;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t cell = (uint32_t)(i * step);
        struct vector direction = camera_direction(&run->camera, (cell % CHECKED_SIDE + 0.5) / CHECKED_SIDE,
                                                   (cell / CHECKED_SIDE + 0.5) / CHECKED_SIDE);
        rays[i] = stage_ray(run->camera.origin, direction);
    }
}

static enum bvhd_status doubt_cpu(struct trace_command *run, struct bvhd_error *error)
{
    struct memory *memory = &run->local.memory;
    double affordable = checked_pairs / (double)(run->stage.triangle_count + 1);
    uint32_t count = affordable < 16 ? 16 : affordable > CHECKED_RAYS ? CHECKED_RAYS : (uint32_t)affordable;
    struct ray *rays = memory_array(memory, CHECKED_RAYS, sizeof *rays);
    struct tracer_hit *hits = memory_array(memory, CHECKED_RAYS, sizeof *hits);
    enum bvhd_status status = BVHD_OK;
    if (!rays || !hits)
        status = bvhd_error_no_memory(error, "trace", "no memory for the rays");
    if (status == BVHD_OK) {
        make_checked_rays(run, count, rays);
        status = run->choice.tracer->trace(run->choice.tracer, rays, count, hits, NULL, error);
    }
    if (status == BVHD_OK)
        status = agreement_doubt(&run->agreement, rays, hits, count, error);
    memory_free(memory, hits);
    memory_free(memory, rays);
    return status;
}

static enum bvhd_status check(struct trace_command *run, struct bvhd_error *error)
{
    enum bvhd_status status = run->choice.is_cpu ? doubt_cpu(run, error) : BVHD_OK;
    if (status != BVHD_OK)
        return status;
    progress_begin(&run->local.progress, "checking", run->structures.name);
    status = agreement_judge(&run->agreement, run->choice.is_cpu ? INFINITY : judge_seconds, progress_update,
                             &run->local.progress, error);
    progress_end(&run->local.progress);
    return status;
}

static double mrays_s(const struct trace_command *run)
{
    return (double)run->picture.rays / run->picture.seconds / 1e6;
}

static bool print_json(struct trace_command *run)
{
    struct json json;
    json_init(&json, &run->local.memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    json_text(&json, "device", run->choice.tracer->device);
    json_text(&json, "target", layout_find(run->structures.target)->name);
    json_text(&json, "scene", run->structures.name);
    json_text(&json, "picture", run->options->output);
    json_integer(&json, "rays", run->picture.rays);
    json_number(&json, "mrays_s", mrays_s(run));
    json_number(&json, "wall_ms", run->wall_ms);
    json_integer(&json, "checked", run->agreement.checked);
    if (!run->choice.is_cpu)
        json_integer(&json, "differing", run->agreement.differing);
    json_integer(&json, "mismatches", run->agreement.mismatches);
    json_integer(&json, "uncertain", run->agreement.uncertain);
    if (!run->choice.is_cpu)
        json_integer(&json, "differ", run->agreement.differing);
    json_integer(&json, "judged", run->agreement.judged);
    json_integer(&json, "unjudged", run->agreement.differing - run->agreement.judged);
    json_integer(&json, "wrong", run->agreement.mismatches);
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

static void print_differences(const struct agreement *agreement)
{
    printf("%llu of them compared with the CPU: %llu differ", (unsigned long long)agreement->checked,
           (unsigned long long)agreement->differing);
    if (agreement->differing > agreement->judged)
        printf(", of which brute force judged %llu, chosen at random", (unsigned long long)agreement->judged);
    printf(": ");
}

/*
 * Ends the line. If none of n random ones is wrong, fewer than 3/n of all are, with a confidence of 95 %, because
 * (1 - 3/n)^n < 0.05.
 */
static void print_unjudged(const struct agreement *agreement)
{
    uint64_t unjudged = agreement->differing - agreement->judged;
    if (unjudged)
        printf("; %llu not judged", (unsigned long long)unjudged);
    if (unjudged && agreement->mismatches == 0 && agreement->judged > 3)
        printf(", fewer than 1 in %llu of which are wrong, with 95 %% confidence",
               (unsigned long long)(agreement->judged / 3));
    printf("\n");
}

static bool print_text(const struct trace_command *run)
{
    const struct agreement *agreement = &run->agreement;
    if (report_volume() == REPORT_ERRORS)
        return true;
    printf("%s: %u x %u of %s, %.1f million rays on %s at %.2f Mray/s; ", run->options->output, run->picture.width,
           run->picture.height, run->structures.name, (double)run->picture.rays / 1e6, run->choice.tracer->device,
           mrays_s(run));
    if (run->choice.is_cpu)
        printf("%llu of them checked: ", (unsigned long long)agreement->checked);
    else
        print_differences(agreement);
    printf("%llu wrong, %llu uncertain", (unsigned long long)agreement->mismatches,
           (unsigned long long)agreement->uncertain);
    print_unjudged(agreement);
    return report_flush();
}

static enum bvhd_status open_scene(struct trace_command *run, struct bvhd_error *error)
{
    struct memory *memory = &run->local.memory;
    const struct options *options = run->options;
    enum bvhd_status status = structures_open(options->operands[0], options->scene, memory, &run->structures, error);
    if (status == BVHD_OK) {
        status = run->choose(options->device, &run->structures, run->local.parallel, memory, &run->choice, error);
        run->is_misnamed = status == BVHD_NOT_FOUND;
    }
    if (status == BVHD_OK)
        status = stage_init(&run->stage, &run->structures, options->up[0], memory, error);
    if (status == BVHD_OK)
        status = check_cost(run, error);
    if (status == BVHD_OK)
        status = surfaces_init(&run->surfaces, &run->structures, memory, error);
    return status;
}

static enum bvhd_status make_picture(struct trace_command *run, struct bvhd_error *error)
{
    progress_begin(&run->local.progress, "opening", run->options->operands[0]);
    enum bvhd_status status = open_scene(run, error);
    progress_end(&run->local.progress);
    if (status != BVHD_OK)
        return status;
    uint64_t pixels = (uint64_t)run->options->width * run->options->height;
    agreement_init(&run->agreement, &run->surfaces, pixels, run->local.parallel, &run->local.memory);
    progress_begin(&run->local.progress, "choosing a view of", run->structures.name);
    status = choose_camera(run, error);
    progress_end(&run->local.progress);
    if (status == BVHD_OK)
        status = render(run, error);
    if (status == BVHD_OK)
        status = check(run, error);
    if (status == BVHD_OK)
        status = picture_write_png(&run->picture, run->options->output, error);
    return status;
}

static void release(struct trace_command *run)
{
    picture_finish(&run->picture);
    agreement_finish(&run->agreement);
    surfaces_finish(&run->surfaces);
    stage_finish(&run->stage);
    tracer_choice_finish(&run->choice);
    structures_close(&run->structures);
    local_close(&run->local);
}

/* EXIT_NO_DAEMON is not for this command, which uses no daemon. */
static enum exit_code fail(const struct trace_command *run, const struct bvhd_error *error)
{
    report_failure(run->options->json, "trace", error);
    return run->is_misnamed ? EXIT_USAGE : EXIT_FAILED;
}

static enum exit_code finish(struct trace_command *run)
{
    if (!(run->options->json ? print_json(run) : print_text(run)))
        return EXIT_FAILED;
    return run->agreement.mismatches ? EXIT_WRONG : EXIT_DONE;
}

enum exit_code command_trace_by(const struct options *options, tracer_chooser choose)
{
    struct trace_command run = {.options = options, .choose = choose};
    struct bvhd_error error;
    if (local_open(&run.local, options->threads, options->memory, &error) != BVHD_OK)
        return fail(&run, &error);
    enum exit_code code = make_picture(&run, &error) != BVHD_OK ? fail(&run, &error) : finish(&run);
    release(&run);
    return code;
}

enum exit_code command_trace(const struct options *options)
{
    return command_trace_by(options, tracer_choose);
}
