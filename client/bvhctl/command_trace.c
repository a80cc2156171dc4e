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
#include "client/bvhctl/picture/scene_source.h"

/*
 * Limits for the camera rays of a picture by the CPU that are compared with brute force: the number of rays, on a
 * square of CHECKED_SIDE rays a side, and of pairs of a ray and a triangle. They have few times.
 */
enum { CHECKED_RAYS = 1024, CHECKED_SIDE = 32, CHECKED_TIMES = 8 };
static const double checked_pairs = 4e8;

/* Samples at once. Devices need more, to keep many threads busy. */
enum { CPU_BATCH = 1 << 14, DEVICE_BATCH = 1 << 18 };

/* How long brute force judges answers of a device that differ from the CPU's. */
static const double judge_seconds = 30;

enum { RAYS_A_SAMPLE = 5 };
static const double affordable_tests = 2e10;

/* The state of `bvhctl trace`. */
struct trace_command {
    const struct options *options;
    tracer_chooser choose;
    struct local local;
    struct structures structures;
    struct scene_source source;
    struct appearance appearance;
    bool has_appearance;
    struct tracer_choice choice;
    struct surfaces surfaces;
    struct stage stage;
    struct camera camera;
    struct agreement agreement;
    uint64_t rays; /* of all pictures, as the next two */
    double seconds;
    double wall_ms;
    bool is_misnamed; /* no device has the name that the options give */
};

/*
 * Refuses scenes in which every ray would test every triangle, so that a picture would take days. That happens where
 * boxes do not separate triangles: if there are many copies of one, or coordinates are near the smallest floats.
 */
static enum bvhd_status check_cost(const struct trace_command *run, struct bvhd_error *error)
{
    double samples = picture_samples(&run->stage, run->options->view.samples).all;
    double tests = stage_cost(&run->stage) * RAYS_A_SAMPLE * samples * run->options->width * run->options->height;
    if (tests <= affordable_tests)
        return BVHD_OK;
    return bvhd_error_set(
        error, BVHD_TOO_LARGE, run->structures.name,
        "this picture needs about %.0e triangle tests, and the limit is %.0e; a smaller --size may do", tests,
        affordable_tests);
}

static bool is_gltf(const struct trace_command *run)
{
    return run->source.is_gltf || (run->has_appearance && run->appearance.import.reader == IMPORT_BY_GLTF);
}

static struct vector vector_of(const double at[3])
{
    return vector_make(at[0], at[1], at[2]);
}

static enum bvhd_status choose_camera(struct trace_command *run, struct bvhd_error *error)
{
    uint64_t rays;
    const struct view_options *view = &run->options->view;
    struct camera_options options = {.aspect = (double)run->options->width / run->options->height,
                                     .fov = view->fov * 3.14159265358979323846 / 180,
                                     .has_eye = view->has_eye,
                                     .has_target = view->has_look_at,
                                     .eye = vector_of(view->eye),
                                     .target = vector_of(view->look_at),
                                     .knows_front = is_gltf(run) && run->stage.up.y > 0,
                                     .turns = view->turn > 0};
    return camera_choose(&run->stage, &options, run->local.parallel, &run->local.memory, &run->camera, &rays, error);
}

/* Renders what a camera sees to a file. The exposure is that of the first picture, if it is not 0. */
static enum bvhd_status render(struct trace_command *run, const struct camera *camera, const char *path,
                               double *exposure, struct bvhd_error *error)
{
    struct light light;
    struct picture picture;
    light_init(&light, &run->stage, &run->surfaces, run->has_appearance ? &run->appearance : NULL, camera,
               run->options->height);
    struct picture_options options = {.light = &light,
                                      .tracer = run->choice.tracer,
                                      .parallel = run->local.parallel,
                                      .width = run->options->width,
                                      .height = run->options->height,
                                      .exposure = *exposure,
                                      .samples = run->options->view.samples,
                                      .batch = run->choice.is_cpu ? CPU_BATCH : DEVICE_BATCH,
                                      .watch = run->choice.is_cpu ? NULL : agreement_watch,
                                      .watch_context = &run->agreement,
                                      .progress = progress_update,
                                      .progress_context = &run->local.progress};
    double start = clock_ms();
    progress_begin(&run->local.progress, "tracing", run->structures.name);
    enum bvhd_status status = picture_render(&options, &run->local.memory, &picture, error);
    progress_end(&run->local.progress);
    run->wall_ms += clock_ms() - start;
    if (status != BVHD_OK)
        return status;
    run->rays += picture.rays;
    run->seconds += picture.seconds;
    *exposure = picture.exposure;
    status = picture_write_png(&picture, path, error);
    picture_finish(&picture);
    return status;
}

/* Returns the name of a picture of a turn: "car-0003.png" for "car.png". The caller frees it with memory_free. */
static char *frame_name(const char *output, uint32_t frame, struct memory *memory)
{
    const char *slash = strrchr(output, '/'), *dot = strrchr(slash ? slash : output, '.');
    size_t stem = dot && dot > output && dot[-1] != '/' ? (size_t)(dot - output) : strlen(output);
    size_t size = strlen(output) + 16;
    char *name = memory_alloc(memory, size);
    if (name)
        snprintf(name, size, "%.*s-%04u%s", (int)stem, output, frame, output + stem);
    return name;
}

/* Renders all pictures of a turn, with the exposure of the first one. */
static enum bvhd_status render_turn(struct trace_command *run, struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    double exposure = 0;
    uint32_t count = run->options->view.turn;
    for (uint32_t i = 0; i < count && status == BVHD_OK; i++) {
        struct camera camera = camera_turn(&run->stage, &run->camera, 2 * 3.14159265358979323846 * i / count);
        char *path = frame_name(run->options->output, i, &run->local.memory);
        if (!path)
            return bvhd_error_no_memory(error, "trace", "no memory for the names of the pictures");
        status = render(run, &camera, path, &exposure, error);
        memory_free(&run->local.memory, path);
    }
    return status;
}

static enum bvhd_status render_all(struct trace_command *run, struct bvhd_error *error)
{
    double exposure = 0;
    return run->options->view.turn ? render_turn(run, error)
                                   : render(run, &run->camera, run->options->output, &exposure, error);
}

/*
 * Makes rays of the picture's camera. Those of one time follow each other, as brute force wants them, and are spread
 * over the picture. Their number is a multiple of that of the times.
 */
static void make_checked_rays(const struct trace_command *run, uint32_t count, struct ray *rays)
{
    double step = (double)CHECKED_RAYS / count;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t of_each = count / CHECKED_TIMES, moment = i / of_each;
        uint32_t cell = (uint32_t)((i % of_each * CHECKED_TIMES + moment) * step);
        struct vector direction = camera_direction(&run->camera, (cell % CHECKED_SIDE + 0.5) / CHECKED_SIDE,
                                                   (cell / CHECKED_SIDE + 0.5) / CHECKED_SIDE);
        float time = stage_time(&run->stage, moment / (CHECKED_TIMES - 1.0));
        rays[i] = stage_ray(run->camera.origin, direction, time);
    }
}

static enum bvhd_status doubt_cpu(struct trace_command *run, struct bvhd_error *error)
{
    struct memory *memory = &run->local.memory;
    double affordable = checked_pairs / (double)(run->stage.primitive_count + 1);
    uint32_t count = affordable < 16 ? 16 : affordable > CHECKED_RAYS ? CHECKED_RAYS : (uint32_t)affordable;
    count -= count % CHECKED_TIMES;
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
    return (double)run->rays / run->seconds / 1e6;
}

static void print_point(struct json *json, const char *key, struct vector point)
{
    json_array(json, key);
    json_number(json, NULL, point.x);
    json_number(json, NULL, point.y);
    json_number(json, NULL, point.z);
    json_array_end(json);
}

/* Prints the camera in the terms of the options that would give it again. */
static void print_camera(const struct trace_command *run, struct json *json)
{
    const struct camera *camera = &run->camera;
    double distance = fmax(vector_length(vector_sub(camera->pivot, camera->origin)), run->stage.size);
    json_object(json, "camera");
    print_point(json, "eye", camera->origin);
    print_point(json, "look_at", vector_mad(camera->origin, camera->forward, distance));
    json_number(json, "fov", 2 * atan(camera->half_height) * 180 / 3.14159265358979323846);
    json_text(json, "up", run->stage.up.x > 0 ? "x" : run->stage.up.y > 0 ? "y" : "z");
    json_bool(json, "inside", camera->is_inside);
    json_bool(json, "textures", run->has_appearance);
    json_object_end(json);
}

static void print_sampling(const struct trace_command *run, struct json *json)
{
    const float times[] = {run->stage.times.first, run->stage.times.last};
    json_integer(json, "samples", picture_samples(&run->stage, run->options->view.samples).all);
    json_floats(json, "times", times, 2);
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
    json_integer(&json, "pictures", run->options->view.turn ? run->options->view.turn : 1);
    print_camera(run, &json);
    print_sampling(run, &json);
    json_integer(&json, "rays", run->rays);
    json_number(&json, "mrays_s", mrays_s(run));
    json_number(&json, "wall_ms", run->wall_ms);
    json_integer(&json, "checked", run->agreement.checked);
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
    printf("%s: %u x %u of %s, %.1f million rays on %s at %.2f Mray/s; ", run->options->output, run->options->width,
           run->options->height, run->structures.name, (double)run->rays / 1e6, run->choice.tracer->device,
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

static void note_left_out(const struct import *import)
{
    if (import->looks_left_out)
        report_note(import->name, "images and attributes of vertices that are not shown: %llu; the first: %s: %s",
                    (unsigned long long)import->looks_left_out, import->look_error.where, import->look_error.text);
}

static void note_absence(const struct trace_command *run)
{
    if (run->source.is_gltf)
        report_note(run->source.file,
                    "its textures and normals are not shown, because it is neither beside the structures nor here; "
                    "bvhctl trace %s SCENE can name it",
                    run->options->operands[0]);
}

/*
 * Reads colours, textures and normals from the scene's file: the one that the user names, or else the one that is
 * found. That one may be another, or broken, and then it is not an error but a remark.
 */
static enum bvhd_status open_appearance(struct trace_command *run, struct bvhd_error *error)
{
    struct memory *memory = &run->local.memory;
    bool is_named = run->options->operand_count > 1;
    scene_source_read(&run->source, run->options->operands[0], run->structures.name, memory);
    char *found = is_named ? NULL : scene_source_find(&run->source, run->options->operands[0], memory);
    const char *path = is_named ? run->options->operands[1] : found;
    if (!path || (found && !run->source.is_gltf)) {
        note_absence(run);
        memory_free(memory, found);
        return BVHD_OK;
    }
    struct bvhd_error problem = {0};
    enum bvhd_status status =
        appearance_open(&run->appearance, &run->structures, path, &run->source.wish.wish, memory, &problem);
    run->has_appearance = status == BVHD_OK;
    if (run->has_appearance)
        note_left_out(&run->appearance.import);
    else if (is_named)
        *error = problem;
    else
        report_note(path, "its textures and normals are not shown: %s", problem.text);
    memory_free(memory, found);
    return is_named ? status : BVHD_OK;
}

/* The direction that the user names; else that of the file's format, if it has one. */
static char find_up(const struct trace_command *run)
{
    return run->options->up[0] == 'a' && is_gltf(run) ? 'y' : run->options->up[0];
}

static struct stage_times find_times(const struct trace_command *run)
{
    const struct view_options *view = &run->options->view;
    return view->has_times ? (struct stage_times){view->times[0], view->times[1]} : (struct stage_times){0, 1};
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
        status = open_appearance(run, error);
    if (status == BVHD_OK)
        status = stage_init(&run->stage, &run->structures, find_up(run), find_times(run), memory, error);
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
    uint64_t samples = (uint64_t)run->options->width * run->options->height;
    samples *= picture_samples(&run->stage, run->options->view.samples).all;
    samples *= run->options->view.turn ? run->options->view.turn : 1;
    agreement_init(&run->agreement, &run->surfaces, samples, run->local.parallel, &run->local.memory);
    progress_begin(&run->local.progress, "choosing a view of", run->structures.name);
    status = choose_camera(run, error);
    progress_end(&run->local.progress);
    if (status == BVHD_OK)
        status = render_all(run, error);
    if (status == BVHD_OK)
        status = check(run, error);
    return status;
}

static void release(struct trace_command *run)
{
    agreement_finish(&run->agreement);
    surfaces_finish(&run->surfaces);
    stage_finish(&run->stage);
    tracer_choice_finish(&run->choice);
    appearance_close(&run->appearance);
    scene_source_finish(&run->source);
    structures_close(&run->structures);
    local_close(&run->local);
}

/* EXIT_NO_DAEMON is not for this command, which uses no daemon. */
static enum exit_code fail(const struct trace_command *run, struct bvhd_error *error)
{
    memory_explain(&run->local.memory, error);
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
