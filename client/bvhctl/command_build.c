/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/scene/assemble.h"
#include "client/bvhctl/service/backend_local.h"
#include "client/bvhctl/service/backend_service.h"
#include "proto/base/clock.h"
#include "client/bvhctl/commands.h"
#include "client/bvhctl/base/depfile.h"
#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/manifest.h"
#include "client/bvhctl/scene/notes.h"
#include "client/bvhctl/scene/output.h"
#include "client/bvhctl/scene/target_reader.h"
#include "client/bvhctl/gpu/probe_source.h"

struct failure {
    char *what;
    struct bvhd_error error;
};

/* The state of `bvhctl build`. */
struct build_command {
    const struct options *options; /* points to `complete` */
    struct options complete; /* the options, with the format that they mean */
    struct bvhd_format format;
    struct memory memory; /* the budget: for scenes, and for builds in this process */
    struct memory notes; /* for messages and lists: outside the budget, so that its exhaustion can be reported */
    struct progress progress;
    struct backend *backend; /* that of `local` or of `service` */
    struct backend_local local;
    struct backend_service service;
    struct json report; /* what --json prints */
    struct output output;
    struct json manifest, manifest_scenes;
    struct json scenes; /* the array "scenes" of the report */
    struct depfile depfile;
    struct failure *failures;
    uint32_t failure_count, failure_capacity;
    bool failed;
    struct bvhd_error loss; /* its status is not BVHD_OK if the connection to the service was lost */
    uint64_t structure_count, byte_count;
    double start;
};

static bool prints_text(const struct options *options)
{
    return !options->json && report_volume() >= REPORT_RESULTS;
}

/* Prints an error at once, and keeps it for the JSON object. */
static void fail(struct build_command *run, const char *what, const struct bvhd_error *error)
{
    progress_end(&run->progress);
    report_line(what, error);
    run->failed = true;
    if (run->failure_count == run->failure_capacity) {
        uint32_t capacity = run->failure_capacity * 2 + 8;
        struct failure *grown = memory_resize(&run->notes, run->failures, capacity * sizeof *grown);
        if (!grown) {
            run->report.failed = true;
            return;
        }
        run->failures = grown;
        run->failure_capacity = capacity;
    }
    char *copy = files_copy_text(&run->notes, what);
    run->report.failed |= !copy;
    if (copy)
        run->failures[run->failure_count++] = (struct failure){copy, *error};
}

static void write_scene(struct build_command *run, const struct import *import, const char *path)
{
    struct json *json = &run->scenes;
    json_object(json, NULL);
    json_text(json, "scene", import->name);
    json_text(json, "source", path);
    json_integer(json, "meshes", import->mesh_count);
    json_integer(json, "triangles", import->triangle_count);
    json_integer(json, "instances", import->instance_count);
    json_integer(json, "skipped_instances", import->skipped_instances);
    manifest_write_left_out(json, &import->counts);
    json_object_end(json);
}

static const char *origin_note(enum bvhd_origin origin)
{
    switch (origin) {
    case BVHD_ORIGIN_MEMORY:
    case BVHD_ORIGIN_DISK:
        return ", cached";
    case BVHD_ORIGIN_COALESCED:
        return ", shared";
    default:
        return "";
    }
}

static void print_structure(const struct bvhd_result *item, const char *file, bool is_top)
{
    uint64_t count = is_top ? item->instances : item->primitives;
    const char *unit = is_top ? (count == 1 ? "instance" : "instances") : count == 1 ? "triangle" : "triangles";
    printf("%-40s %9llu %-9s %8.2f MB  %5.1f B each  SAH %6.2f  depth %2u  %8.1f ms  %s %s%s\n", file,
           (unsigned long long)count, unit, (double)item->size / 1e6, count ? (double)item->size / (double)count : 0.0,
           item->sah, item->depth, item->prepare_ms + item->build_ms, manifest_quality_name(item->quality),
           item->method ? item->method : "", origin_note(item->origin));
}

/* Writes a structure, and its entries in the manifest and the report. */
static enum bvhd_status keep_structure(struct build_command *run, const struct assembly *assembly, uint32_t index,
                                       const struct file_names *names, struct bvhd_error *error)
{
    const struct bvhd_result *item = &assembly->items[index];
    enum bvhd_status status = output_put(&run->output, assembly, index, names, error);
    if (status)
        return status;
    manifest_write_structure(&run->report, assembly, index, names, true);
    manifest_write_structure(&run->manifest, assembly, index, names, false);
    run->structure_count++;
    run->byte_count += item->size;
    if (prints_text(run->options))
        print_structure(item, names->files[index], index == assembly->import->bottom_count);
    return BVHD_OK;
}

/* A top level is not written if a file that it names has failed. */
static enum bvhd_status check_handles(const struct assembly *assembly, const struct file_names *names,
                                      struct bvhd_error *error)
{
    for (uint32_t i = 0; i < assembly->handle_count; i++) {
        enum bvhd_status status = assembly->items[assembly->handles[i]].error.status;
        if (status)
            return bvhd_error_set(error, status, assembly->import->name, "%s, which it needs, was not written",
                                  names->files[assembly->handles[i]]);
    }
    return BVHD_OK;
}

/* Bottom levels with equal names have equal geometry, so that one file serves them all. */
static enum bvhd_status check_shared(const struct assembly *assembly, uint32_t index, const struct file_names *names,
                                     struct bvhd_error *error)
{
    const struct bvhd_result *item = &assembly->items[index], *first = &assembly->items[names->first[index]];
    if (first->error.status || !memcmp(&item->key, &first->key, sizeof item->key))
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_INVALID, assembly->import->name,
                          "two different meshes have the same name and the same checksum");
}

/* Writes all structures of a scene. One that cannot be written has failed, like one that cannot be built. */
static void keep_structures(struct build_command *run, const struct assembly *assembly, const struct file_names *names)
{
    uint32_t top = assembly->import->bottom_count;
    for (uint32_t i = 0; i <= top; i++) {
        struct bvhd_error error = assembly->items[i].error;
        if (!error.status && i == top)
            check_handles(assembly, names, &error);
        if (!error.status && names->first[i] != i)
            check_shared(assembly, i, names, &error);
        else if (!error.status)
            keep_structure(run, assembly, i, names, &error);
        if (error.status)
            fail(run, names->files[i], &error);
        assembly->items[i].error = error;
    }
}

static enum bvhd_status build_imported(struct build_command *run, const struct import *import, struct bvhd_error *error)
{
    struct assembly assembly;
    struct file_names names;
    enum bvhd_status status = file_names_make(import, &names, error);
    if (status)
        return status;
    progress_begin(&run->progress, "building", import->name);
    status = assemble(import, run->options, run->backend, &assembly, error);
    progress_end(&run->progress);
    if (!status) {
        keep_structures(run, &assembly, &names);
        if (assembly.items[import->bottom_count].error.status == BVHD_OK)
            manifest_write_scene(&run->manifest_scenes, &assembly, &names);
        notes_activity(&assembly);
        assembly_finish(&assembly);
    }
    file_names_finish(&names);
    return status;
}

static void build_scene(struct build_command *run, const char *path)
{
    struct import import;
    struct bvhd_error error = {0};
    progress_begin(&run->progress, "importing", path);
    const struct import_moment moment = {run->options->moment, run->options->animation};
    const struct import_wish wish = {run->options->scene, run->options->has_moment ? &moment : NULL, false};
    enum bvhd_status status = import_scene_as(path, &wish, &run->memory, &import, &error);
    progress_end(&run->progress);
    memory_explain(&run->memory, &error);
    if (status) {
        fail(run, "build", &error);
        return;
    }
    report_detail(import.name, "%u meshes, %llu triangles, %u instances in %u bottom levels", import.mesh_count,
                  (unsigned long long)import.triangle_count, import.instance_count, import.bottom_count);
    notes_left_out(&import);
    write_scene(run, &import, path);
    for (uint32_t i = 0; i < import.file_count; i++)
        depfile_add(&run->depfile, import.files[i]);
    status = build_imported(run, &import, &error);
    memory_explain(&run->memory, &error);
    if (status == BVHD_UNAVAILABLE)
        run->loss = error;
    else if (status)
        fail(run, "build", &error);
    import_finish(&import);
}

/* Refuses two scenes with the same name, because they would write the same files. */
static enum bvhd_status check_names(const struct options *options, struct memory *memory, struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    char **names = memory_array(memory, (uint64_t)options->operand_count, sizeof *names);
    int count = 0;
    for (; names && count < options->operand_count && !status; count++) {
        char *raw = import_name(options->operands[count], memory);
        names[count] = raw ? file_names_safe(raw, memory) : NULL;
        memory_free(memory, raw);
        if (!names[count])
            status = bvhd_error_no_memory(error, options->operands[count], "no memory for its name");
        for (int i = 0; i < count && !status; i++)
            if (!strcmp(names[i], names[count]))
                status = bvhd_error_set(
                    error, BVHD_INVALID, options->operands[count],
                    "its files would have the same names as those of %s ('%s...'): rename one of the two, or "
                    "build them by two commands with different directories (-o)",
                    options->operands[i], names[i]);
    }
    for (int i = 0; i < count; i++)
        memory_free(memory, names[i]);
    memory_free(memory, names);
    return names ? status : bvhd_error_no_memory(error, "build", "no memory for the scenes' names");
}

static enum bvhd_status write_manifest(struct build_command *run, struct bvhd_error *error)
{
    struct json *json = &run->manifest;
    manifest_end(json, &run->manifest_scenes);
    if (json->failed)
        return bvhd_error_no_memory(error, MANIFEST_NAME, "no memory for the manifest");
    return output_end(&run->output, (struct bytes){(const unsigned char *)json->data, json->size}, !run->failed, error);
}

static void begin_output(struct build_command *run)
{
    const char *output = run->options->output;
    char *target = run->output.is_container ? files_copy_text(&run->notes, output)
                                            : files_join(&run->notes, output, MANIFEST_NAME);
    depfile_init(&run->depfile, &run->notes, target ? target : "");
    if (run->options->probe)
        depfile_add(&run->depfile, run->options->probe);
    run->depfile.failed |= !target;
    memory_free(&run->notes, target);
    json_init(&run->report, &run->notes, false);
    json_init(&run->manifest, &run->notes, true);
    json_init(&run->scenes, &run->notes, false);
    json_init(&run->manifest_scenes, &run->notes, true);
    run->manifest_scenes.depth = 2; /* in an array of the manifest */
    json_object(&run->report, NULL);
    json_integer(&run->report, "schema", 1);
    json_array(&run->report, "structures");
    manifest_begin(&run->manifest, run->options);
}

static void print_report(struct build_command *run)
{
    struct json *json = &run->report;
    json_array_end(json);
    json_array(json, "scenes");
    json_append(json, &run->scenes);
    json_array_end(json);
    json_array(json, "errors");
    for (uint32_t i = 0; i < run->failure_count; i++) {
        json_object(json, NULL);
        json_text(json, "what", run->failures[i].what);
        report_members(json, &run->failures[i].error);
        json_object_end(json);
    }
    json_array_end(json);
    json_text(json, "output", run->options->output);
    json_integer(json, "changed", run->output.changed);
    json_integer(json, "removed", run->output.removed);
    json_number(json, "wall_ms", clock_ms() - run->start);
    json_object_end(json);
}

static void print_summary(const struct build_command *run)
{
    uint32_t changed = run->output.changed, removed = run->output.removed;
    printf("%llu structure%s, %.2f MB, %u file%s changed, ", (unsigned long long)run->structure_count,
           run->structure_count == 1 ? "" : "s", (double)run->byte_count / 1e6, changed, changed == 1 ? "" : "s");
    if (removed)
        printf("%u stale file%s removed, ", removed, removed == 1 ? "" : "s");
    printf("%.0f ms\n", clock_ms() - run->start);
}

/* Says that a container was not written, because it holds all structures or none. */
static void note_no_container(struct build_command *run)
{
    struct bvhd_error error;
    if (!run->output.is_container || !run->failed)
        return;
    bvhd_error_set(&error, run->failures ? run->failures[0].error.status : BVHD_NO_MEMORY, run->options->output,
                   "it was not written, because not all of its structures were built");
    fail(run, "build", &error);
}

static void write_lists(struct build_command *run)
{
    struct bvhd_error error;
    if (run->failed && run->structure_count == 0)
        return; /* there is nothing to list, and an earlier manifest may still be right */
    note_no_container(run);
    if (write_manifest(run, &error))
        fail(run, "build", &error);
    else if (run->options->depfile && !run->failed && depfile_write(&run->depfile, run->options->depfile, &error))
        fail(run, "build", &error);
}

static enum exit_code finish_output(struct build_command *run)
{
    if (run->loss.status)
        return report_failure(run->options->json, "build", &run->loss);
    write_lists(run);
    bool ok = true;
    if (prints_text(run->options)) {
        if (run->structure_count)
            print_summary(run);
        ok = report_flush();
    } else if (!run->options->json) {
        return run->failed ? EXIT_FAILED : EXIT_DONE;
    } else if (run->structure_count == 0 && run->failure_count) {
        report_failure_json(&run->failures[0].error);
    } else {
        print_report(run);
        ok = report_print(&run->report);
    }
    return ok && !run->failed ? EXIT_DONE : EXIT_FAILED;
}

static void release(struct build_command *run)
{
    for (uint32_t i = 0; i < run->failure_count; i++)
        memory_free(&run->notes, run->failures[i].what);
    memory_free(&run->notes, run->failures);
    json_finish(&run->report);
    json_finish(&run->manifest);
    json_finish(&run->scenes);
    json_finish(&run->manifest_scenes);
    output_close(&run->output);
    depfile_finish(&run->depfile);
    backend_local_close(&run->local);
    backend_service_close(&run->service);
}

/* Finds the format of the device that structures are built for. Targets that are not native need none. */
static enum bvhd_status find_format(struct build_command *run, struct bvhd_error *error)
{
    struct options *options = &run->complete;
    const struct target_reader *reader = target_reader_find(options->build.target);
    if (reader && !reader->is_native)
        return BVHD_OK;
    struct probe_source source = {options->probe, options->build.target};
    enum bvhd_status status = probe_source_read(&source, &run->notes, &run->format, error);
    if (!status) {
        options->build.target = (enum target)run->format.target;
        options->format = &run->format;
    }
    return status;
}

static enum bvhd_status open_backend(struct build_command *run, struct bvhd_error *error)
{
    const struct options *options = run->options;
    if (options->local) {
        run->backend = &run->local.backend;
        enum bvhd_status status =
            backend_local_open(&run->local, options->threads, &run->memory, &run->progress, error);
        return status == BVHD_OK ? backend_local_use_cache(&run->local, options, error) : status;
    }
    run->backend = &run->service.backend;
    return backend_service_open(&run->service, options, &run->memory, &run->progress, error);
}

static enum exit_code build_scenes(struct build_command *run)
{
    begin_output(run);
    for (int i = 0; i < run->options->operand_count && !run->loss.status; i++)
        build_scene(run, run->options->operands[i]);
    return finish_output(run);
}

enum exit_code command_build(const struct options *options)
{
    struct bvhd_error error;
    struct build_command run = {.complete = *options, .start = clock_ms()};
    run.options = &run.complete;
    memory_init(&run.memory, options->memory);
    memory_init(&run.notes, UINT64_MAX);
    enum exit_code code;
    if (check_names(options, &run.notes, &error)) {
        report_failure(options->json, "build", &error);
        code = error.status == BVHD_INVALID ? EXIT_USAGE : EXIT_FAILED;
    } else if (find_format(&run, &error) || open_backend(&run, &error) ||
               output_open(&run.output, options->output, &run.notes, &error)) {
        memory_explain(&run.memory, &error);
        code = report_failure(options->json, "build", &error);
    } else {
        code = build_scenes(&run);
    }
    release(&run);
    return code;
}
