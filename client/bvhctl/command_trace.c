/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "commands.h"
#include "local.h"
#include "picture.h"
#include "unpack.h"

/* Camera rays that are compared with brute force: at most so many, and so many pairs of ray and triangle. */
enum { CHECKED_RAYS = 1024, CHECKED_SIDE = 32 };
static const double checked_pairs = 4e8;

enum { RAYS_A_PIXEL = 20 };
static const double affordable_tests = 2e10;

/* One call of `bvhctl trace`. */
struct run {
    const struct options *options;
    struct local local;
    struct structures structures;
    struct stage stage;
    struct camera camera;
    struct picture picture;
    uint64_t checked, mismatches, uncertain;
};

/*
 * Scenes in which boxes tell nothing apart - the same triangle many times, coordinates near the smallest floats - have every ray test every triangle.
 * Better say so than draw for days.
 */
static enum bvhd_status check_cost(const struct run *run, struct bvhd_error *error)
{
    double tests = stage_cost(&run->stage) * RAYS_A_PIXEL * run->options->width * run->options->height;
    if (tests <= affordable_tests)
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_TOO_LARGE, run->structures.name,
                          "about %.0e triangle tests for this picture; a smaller --size may do", tests);
}

static enum bvhd_status render(struct run *run, struct bvhd_error *error)
{
    const struct options *options = run->options;
    struct memory *memory = &run->local.memory;
    const struct parallel *parallel = run->local.parallel;
    uint64_t rays_before = 0;
    enum bvhd_status status =
        camera_choose(&run->stage, (double)options->width / options->height, parallel, memory, &run->camera, &rays_before, error);
    if (status)
        return status;
    struct light light;
    light_init(&light, &run->stage, &run->camera);
    progress_begin(&run->local.progress, "tracing", run->structures.name);
    status = picture_render(&light, options->width, options->height, parallel, progress_update, &run->local.progress, memory,
                            &run->picture, error);
    progress_end(&run->local.progress);
    return status;
}

/* Rays of the picture's camera, spread over the picture. */
static void make_checked_rays(const struct run *run, uint32_t count, struct ray *rays)
{
    double step = (double)CHECKED_RAYS / count;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t cell = (uint32_t)(i * step);
        struct vector direction =
            camera_direction(&run->camera, (cell % CHECKED_SIDE + 0.5) / CHECKED_SIDE, (cell / CHECKED_SIDE + 0.5) / CHECKED_SIDE);
        rays[i] = stage_ray(run->camera.origin, direction);
    }
}

static void judge_rays(struct run *run, uint32_t count, const struct ray *rays, const struct oracle_answer *answers)
{
    for (uint32_t i = 0; i < count; i++) {
        struct ray_hit hit;
        bool is_hit = structures_trace(&run->structures, &rays[i], NULL, &hit);
        enum oracle_verdict verdict = oracle_judge(&answers[i], is_hit ? &hit : NULL, NULL);
        run->uncertain += verdict == ORACLE_UNDECIDED;
        run->mismatches += verdict != ORACLE_UNDECIDED && verdict != ORACLE_RIGHT;
    }
}

static enum bvhd_status check_unpacked(struct run *run, const struct unpacked *unpacked, struct ray *rays,
                                       struct oracle_answer *answers, struct bvhd_error *error)
{
    double affordable = checked_pairs / (double)(unpacked->triangle_count + 1);
    uint32_t count = affordable < 16 ? 16 : affordable > CHECKED_RAYS ? CHECKED_RAYS : (uint32_t)affordable;
    make_checked_rays(run, count, rays);
    progress_begin(&run->local.progress, "checking", run->structures.name);
    enum bvhd_status status = oracle_trace(unpacked->meshes, unpacked->mesh_count, rays, count, &run->local.memory, run->local.parallel,
                                           progress_update, &run->local.progress, answers, error);
    progress_end(&run->local.progress);
    if (status)
        return status;
    run->checked = count;
    judge_rays(run, count, rays, answers);
    oracle_finish(answers, count, &run->local.memory);
    return BVHD_OK;
}

/* What the picture shows against brute force over the triangles that are in the files. */
static enum bvhd_status check(struct run *run, struct bvhd_error *error)
{
    struct memory *memory = &run->local.memory;
    struct unpacked unpacked = {0};
    struct ray *rays = memory_array(memory, CHECKED_RAYS, sizeof *rays);
    struct oracle_answer *answers = memory_array(memory, CHECKED_RAYS, sizeof *answers);
    enum bvhd_status status = BVHD_OK;
    if (!rays || !answers)
        status = bvhd_error_set(error, BVHD_NO_MEMORY, "trace", "no memory for the rays");
    if (!status)
        status = unpack_structures(&run->structures, memory, &unpacked, error);
    if (!status)
        status = check_unpacked(run, &unpacked, rays, answers, error);
    unpack_finish(&unpacked);
    memory_free(memory, answers);
    memory_free(memory, rays);
    return status;
}

static double mrays_s(const struct run *run)
{
    return (double)run->picture.rays / run->picture.seconds / 1e6;
}

static bool print_json(struct run *run)
{
    struct json json;
    json_init(&json, &run->local.memory, false);
    json_object(&json, NULL);
    json_integer(&json, "schema", 1);
    json_text(&json, "device", "cpu");
    json_text(&json, "target", "portable");
    json_text(&json, "scene", run->structures.name);
    json_text(&json, "picture", run->options->output);
    json_integer(&json, "rays", run->picture.rays);
    json_number(&json, "mrays_s", mrays_s(run));
    json_integer(&json, "checked", run->checked);
    json_integer(&json, "mismatches", run->mismatches);
    json_integer(&json, "uncertain", run->uncertain);
    json_object_end(&json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

static bool print_text(const struct run *run)
{
    printf("%s: %u x %u of %s, %.1f million rays, %.2f Mray/s on %u threads; %llu of them checked: %llu wrong, %llu uncertain\n",
           run->options->output, run->picture.width, run->picture.height, run->structures.name, (double)run->picture.rays / 1e6,
           mrays_s(run), run->local.parallel->threads, (unsigned long long)run->checked, (unsigned long long)run->mismatches,
           (unsigned long long)run->uncertain);
    return report_flush();
}

static enum bvhd_status make_picture(struct run *run, struct bvhd_error *error)
{
    struct memory *memory = &run->local.memory;
    const struct options *options = run->options;
    enum bvhd_status status = structures_open(options->operands[0], options->scene, memory, &run->structures, error);
    if (!status)
        status = stage_init(&run->stage, &run->structures, options->up[0], memory, error);
    if (!status)
        status = check_cost(run, error);
    if (!status)
        status = render(run, error);
    if (!status)
        status = check(run, error);
    if (!status)
        status = picture_write_png(&run->picture, options->output, error);
    return status;
}

static enum exit_code finish(struct run *run)
{
    if (!(run->options->json ? print_json(run) : print_text(run)))
        return EXIT_FAILED;
    return run->mismatches ? EXIT_WRONG : EXIT_DONE;
}

enum exit_code command_trace(const struct options *options)
{
    struct run run = {.options = options};
    struct bvhd_error error;
    if (strcmp(options->device, "cpu") && strcmp(options->device, "auto")) {
        bvhd_error_set(&error, BVHD_UNSUPPORTED, options->device, "not a device of this version: cpu or auto");
        return report_failure(options->json, "trace", &error);
    }
    enum bvhd_status status = local_open(&run.local, options->threads, options->memory, &error);
    if (status)
        return report_failure(options->json, "trace", &error);
    status = make_picture(&run, &error);
    enum exit_code code = status ? report_failure(options->json, "trace", &error) : finish(&run);
    picture_finish(&run.picture);
    stage_finish(&run.stage);
    structures_close(&run.structures);
    local_close(&run.local);
    return code;
}
