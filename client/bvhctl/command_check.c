/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/commands.h"
#include "client/bvhctl/scene/import_compare.h"
#include "client/bvhctl/service/local.h"
#include "client/bvhctl/oracle/oracle_timed.h"
#include "client/bvhctl/oracle/rays.h"
#include "client/bvhctl/scene/structures.h"

enum { DEFAULT_RAYS = 4000, DEFAULT_SECONDS = 60 };

/* The state of `bvhctl check`. */
struct check_command {
    const struct options *options;
    struct local local;
    struct import import;
    struct import_comparison readers;
    struct structures structures;
    struct oracle_mesh *meshes;
    uint32_t mesh_count;
    struct ray *rays;
    struct oracle_answer *answers;
    uint32_t ray_count;
    uint32_t judged; /* rays from the first on that brute force has answered: the time allowed no more */
    bool answered;
    bool is_damaged; /* the structures cannot be opened, which is a result of the check */
};

struct tally {
    uint64_t hits, uncertain, wrong_miss, wrong_hit, wrong_primitive;
    double t_rel_err_max;
};

/* The scene of a directory and the scene of a file that are compared. */
struct choice {
    char *file; /* the name of the file without its ending */
    char *name; /* the scene's name in the manifest; NULL: what --scene says, which the manifest may not have */
    struct manifest_wish source; /* what of the file was built */
};

/*
 * Finds what of the file the structures were built from, in the manifest. A manifest that cannot be read is
 * reported when it is opened.
 */
static void find_source(struct check_command *run, struct choice *choice)
{
    struct manifest manifest;
    struct bvhd_error ignored;
    const char *wanted = run->options->scene ? run->options->scene : choice->file;
    if (manifest_read(run->options->operands[0], &run->local.memory, &manifest, &ignored))
        return;
    const struct manifest_entry *top = manifest_find_top(&manifest, choice->file, wanted);
    if (top)
        choice->name = files_copy_text(&run->local.memory, top->scene);
    if (top)
        manifest_wish_init(&choice->source, top);
    manifest_finish(&manifest);
}

static enum bvhd_status open_choice(struct check_command *run, const struct choice *choice, struct bvhd_error *error)
{
    struct memory *memory = &run->local.memory;
    const struct options *options = run->options;
    const char *name = choice->name ? choice->name : options->scene ? options->scene : choice->file;
    enum bvhd_status status = import_scene_as(options->operands[1], &choice->source.wish, memory, &run->import, error);
    bool is_imported = !status;
    if (!status)
        status = structures_open(options->operands[0], name, memory, &run->structures, error);
    run->is_damaged = is_imported && (status == BVHD_CORRUPT || status == BVHD_INCOMPATIBLE);
    if (!status)
        status = import_oracle_meshes(&run->import, run->structures.has_top, &run->meshes, &run->mesh_count, error);
    return status;
}

static enum bvhd_status open_both(struct check_command *run, struct bvhd_error *error)
{
    struct memory *memory = &run->local.memory;
    struct choice choice = {.file = import_name(run->options->operands[1], memory)};
    if (!choice.file)
        return bvhd_error_no_memory(error, run->options->operands[1], "no memory for its name");
    find_source(run, &choice);
    enum bvhd_status status = open_choice(run, &choice, error);
    memory_free(memory, choice.name);
    memory_free(memory, choice.file);
    return status;
}

/* Says what brute force will cost, before it starts. */
static void announce(const struct check_command *run, const struct oracle_work *work, double limit)
{
    double seconds = oracle_work_seconds(work, run->ray_count);
    char bound[64] = "";
    if (!isinf(limit))
        snprintf(bound, sizeof bound, ", for at most %.0f s (--time)", ceil(limit));
    report_note(run->import.name, "%u rays need %.1e tests of a ray and a primitive: about %.0f s%s", run->ray_count,
                (double)oracle_work_tests(work, run->ray_count), ceil(seconds), bound);
}

static enum bvhd_status ask_oracle(struct check_command *run, struct bvhd_error *error)
{
    struct memory *memory = &run->local.memory;
    const struct options *options = run->options;
    struct oracle_work work = {run->meshes,         run->mesh_count, memory,
                               run->local.parallel, progress_update, &run->local.progress};
    double limit = options->seconds > 0 ? options->seconds : options->rays > 0 ? INFINITY : DEFAULT_SECONDS;
    run->ray_count = options->rays > 0 ? (uint32_t)options->rays : DEFAULT_RAYS;
    run->rays = memory_array(memory, run->ray_count, sizeof *run->rays);
    run->answers = memory_array(memory, run->ray_count, sizeof *run->answers);
    if (!run->rays || !run->answers)
        return bvhd_error_no_memory(error, "check", "no memory for the rays");
    rays_make(run->meshes, run->mesh_count, options->seed, run->ray_count, run->rays);
    announce(run, &work, limit);
    progress_begin(&run->local.progress, "brute force over", run->import.name);
    enum bvhd_status status =
        oracle_trace_timed(&work, run->rays, run->ray_count, limit, run->answers, &run->judged, error);
    progress_end(&run->local.progress);
    run->answered = status == BVHD_OK;
    return status;
}

static void count_verdict(struct tally *tally, enum oracle_verdict verdict, double t_rel_err)
{
    tally->uncertain += verdict == ORACLE_UNDECIDED;
    tally->wrong_miss += verdict == ORACLE_WRONG_MISS;
    tally->wrong_hit += verdict == ORACLE_WRONG_HIT;
    tally->wrong_primitive += verdict == ORACLE_WRONG_PRIMITIVE;
    if (t_rel_err > tally->t_rel_err_max)
        tally->t_rel_err_max = t_rel_err;
}

static bool trace_one(const struct check_command *run, const struct ray *ray, struct ray_hit *ret_hit)
{
    const struct bvhd_cpu_trace trace = {
        .struct_size = sizeof trace,
        .rays = ray,
        .ray_size = sizeof *ray,
        .hits = ret_hit,
        .hit_size = sizeof *ret_hit,
        .ray_count = 1,
        .flags = run->options->flip_order ? BVHD_CPU_TRACE_FLIP_ORDER : 0,
    };
    return bvhd_cpu_scene_trace(run->structures.scene, &trace, NULL) == BVHD_OK && ret_hit->handle != RAY_NO_BOTTOM;
}

static struct tally judge_all(const struct check_command *run)
{
    struct tally tally = {0};
    for (uint32_t i = 0; i < run->judged; i++) {
        struct ray_hit hit;
        double t_rel_err;
        bool is_hit = trace_one(run, &run->rays[i], &hit);
        tally.hits += is_hit;
        enum oracle_verdict verdict = oracle_judge(&run->answers[i], is_hit ? &hit : NULL, &t_rel_err);
        count_verdict(&tally, verdict, t_rel_err);
    }
    return tally;
}

static void write_readers(const struct import_comparison *readers, struct json *json)
{
    static const char *const names[] = {
        [IMPORT_AGREES] = "agrees", [IMPORT_DIFFERS] = "differs", [IMPORT_REFUSED] = "refused"};
    if (readers->agreement == IMPORT_NOT_COMPARED)
        return;
    json_object(json, "second_reader");
    json_text(json, "name", "assimp");
    json_text(json, "result", names[readers->agreement]);
    if (readers->agreement != IMPORT_REFUSED) {
        json_integer(json, "triangles", readers->first.triangles);
        json_integer(json, "triangles_second", readers->second.triangles);
    }
    json_object_end(json);
}

/* Says what a second reader of the file made of it. A difference is no error of the structures. */
static void note_readers(const struct check_command *run)
{
    const struct import_comparison *readers = &run->readers;
    unsigned long long first = readers->first.triangles, second = readers->second.triangles;
    if (readers->agreement == IMPORT_AGREES && !run->options->json)
        report_note(run->import.name, "assimp, a second reader, finds the same %llu triangles in the same bounds",
                    first);
    if (readers->agreement == IMPORT_REFUSED)
        report_note(run->import.name, "assimp, a second reader, refuses the file: %s", readers->text);
    if (readers->agreement == IMPORT_DIFFERS && first != second)
        report_note(run->import.name, "warning: %llu triangles, but assimp, a second reader, finds %llu", first,
                    second);
    else if (readers->agreement == IMPORT_DIFFERS)
        report_note(run->import.name, "warning: assimp, a second reader, finds other bounds");
}

static void write_tally(const struct check_command *run, const struct tally *tally, struct json *json)
{
    json_object(json, NULL);
    json_integer(json, "schema", 1);
    json_text(json, "scene", run->import.name);
    json_integer(json, "rays", run->ray_count);
    json_integer(json, "judged", run->judged);
    json_integer(json, "unjudged", run->ray_count - run->judged);
    json_integer(json, "hits", tally->hits);
    json_integer(json, "uncertain", tally->uncertain);
    json_integer(json, "wrong_miss", tally->wrong_miss);
    json_integer(json, "wrong_hit", tally->wrong_hit);
    json_integer(json, "wrong_primitive", tally->wrong_primitive);
    json_number(json, "t_rel_err_max", tally->t_rel_err_max);
    json_integer(json, "seed", run->options->seed);
    json_bool(json, "flip_order", run->options->flip_order);
    write_readers(&run->readers, json);
    json_object_end(json);
}

static bool print_tally(struct check_command *run, const struct tally *tally)
{
    uint64_t wrong = tally->wrong_miss + tally->wrong_hit + tally->wrong_primitive;
    if (!run->options->json && report_volume() == REPORT_ERRORS)
        return true;
    if (!run->options->json) {
        printf("%s: %u rays, %llu hits, %llu uncertain, %llu wrong (%llu missed, %llu hit nothing there, %llu another "
               "primitive), t within %.2g",
               run->import.name, run->judged, (unsigned long long)tally->hits, (unsigned long long)tally->uncertain,
               (unsigned long long)wrong, (unsigned long long)tally->wrong_miss, (unsigned long long)tally->wrong_hit,
               (unsigned long long)tally->wrong_primitive, tally->t_rel_err_max);
        if (run->judged < run->ray_count)
            printf("; %u rays not judged", run->ray_count - run->judged);
        printf("\n");
        return report_flush();
    }
    struct json json;
    json_init(&json, &run->local.memory, false);
    write_tally(run, tally, &json);
    bool ok = report_print(&json);
    json_finish(&json);
    return ok;
}

static enum exit_code judge(struct check_command *run)
{
    struct tally tally = judge_all(run);
    uint64_t wrong = tally.wrong_miss + tally.wrong_hit + tally.wrong_primitive;
    if (!print_tally(run, &tally))
        return EXIT_FAILED;
    if (run->judged < run->ray_count)
        report_note(run->import.name, "warning: brute force had time for %u of %u rays: %u were not judged",
                    run->judged, run->ray_count, run->ray_count - run->judged);
    if (tally.hits == 0)
        report_note(run->import.name, "warning: no ray hit anything, so that only misses were checked");
    if (wrong)
        report_finding(run->import.name, "%llu of %u rays have a wrong answer", (unsigned long long)wrong, run->judged);
    return wrong ? EXIT_WRONG : EXIT_DONE;
}

static void release(struct check_command *run)
{
    struct memory *memory = &run->local.memory;
    if (run->answered)
        oracle_finish(run->answers, run->ray_count, memory);
    memory_free(memory, run->answers);
    memory_free(memory, run->rays);
    memory_free(memory, run->meshes);
    structures_close(&run->structures);
    import_finish(&run->import);
    local_close(&run->local);
}

enum exit_code command_check(const struct options *options)
{
    struct check_command run = {.options = options};
    struct bvhd_error error;
    enum bvhd_status status = local_open(&run.local, options->threads, options->memory, &error);
    if (status)
        return report_failure(options->json, "check", &error);
    progress_begin(&run.local.progress, "importing", options->operands[1]);
    status = open_both(&run, &error);
    progress_end(&run.local.progress);
    if (!status) {
        progress_begin(&run.local.progress, "importing again, by a second reader,", options->operands[1]);
        run.readers = import_compare(options->operands[1], &run.import, &run.local.memory);
        progress_end(&run.local.progress);
        note_readers(&run);
        status = ask_oracle(&run, &error);
    }
    if (status)
        memory_explain(&run.local.memory, &error);
    enum exit_code code = status ? report_failure(options->json, "check", &error) : judge(&run);
    release(&run);
    return run.is_damaged ? EXIT_WRONG : code;
}
