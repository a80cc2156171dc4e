/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/depfile.h"
#include "client/bvhctl/base/files.h"
#include "client/bvhctl/building.h"
#include "client/bvhctl/commands.h"
#include "client/bvhctl/scene/manifest.h"
#include "client/bvhctl/scene/notes.h"
#include "proto/base/clock.h"

/* The state of `bvhctl build`. */
struct build_command {
    struct building run;
    struct json scenes; /* the array "scenes" of the report */
    struct depfile depfile;
};

static void write_scene(struct build_command *command, const struct import *import, const char *path)
{
    struct json *json = &command->scenes;
    json_object(json, NULL);
    json_text(json, "scene", import->name);
    json_text(json, "source", path);
    json_integer(json, "meshes", import->mesh_count);
    json_integer(json, "triangles", import->triangle_count);
    manifest_write_round_counts(json, import);
    json_integer(json, "instances", import->instance_count);
    json_integer(json, "skipped_instances", import->skipped_instances);
    manifest_write_left_out(json, &import->counts);
    manifest_write_left_out_options(json, &import->counts);
    json_object_end(json);
}

static enum bvhd_status build_imported(struct building *run, const struct import *import, struct bvhd_error *error)
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
        building_keep(run, &assembly, &names);
        notes_activity(&assembly);
        assembly_finish(&assembly);
    }
    file_names_finish(&names);
    return status;
}

static void build_scene(struct build_command *command, const char *path)
{
    struct building *run = &command->run;
    struct import import;
    struct bvhd_error error = {0};
    progress_begin(&run->progress, "importing", path);
    const struct options *options = run->options;
    const struct import_moment moment = {.time = options->has_shutter ? options->shutter[0] : options->moment,
                                         .animation = options->animation,
                                         .is_shutter = options->has_shutter,
                                         .end = options->shutter[1],
                                         .is_for_updates = options->build_flags & BUILD_ALLOW_UPDATE};
    const struct import_wish wish = {.scene = options->scene,
                                     .moment = options->has_moment || options->has_shutter ? &moment : NULL,
                                     .point_radius = options->point_radius,
                                     .line_radius = options->line_radius};
    enum bvhd_status status = import_scene_as(path, &wish, &run->memory, &import, &error);
    progress_end(&run->progress);
    memory_explain(&run->memory, &error);
    if (status) {
        building_fail(run, "build", &error);
        return;
    }
    report_detail(import.name, "%u meshes, %llu triangles, %llu points, %llu lines, %u instances in %u bottom levels",
                  import.mesh_count, (unsigned long long)import.triangle_count, (unsigned long long)import.point_count,
                  (unsigned long long)import.line_count, import.instance_count, import.bottom_count);
    notes_left_out(&import);
    notes_motion(&import);
    write_scene(command, &import, path);
    for (uint32_t i = 0; i < import.file_count; i++)
        depfile_add(&command->depfile, import.files[i]);
    status = build_imported(run, &import, &error);
    memory_explain(&run->memory, &error);
    if (status == BVHD_UNAVAILABLE)
        run->loss = error;
    else if (status)
        building_fail(run, "build", &error);
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

static void begin_output(struct build_command *command)
{
    struct building *run = &command->run;
    const char *output = run->options->output;
    char *target = run->output.is_container ? files_copy_text(&run->notes, output)
                                            : files_join(&run->notes, output, MANIFEST_NAME);
    depfile_init(&command->depfile, &run->notes, target ? target : "");
    if (run->options->probe)
        depfile_add(&command->depfile, run->options->probe);
    command->depfile.failed |= !target;
    memory_free(&run->notes, target);
    json_init(&command->scenes, &run->notes, false);
    json_array(&run->report, "structures");
    building_begin_manifest(run);
}

static void print_report(struct build_command *command)
{
    struct building *run = &command->run;
    struct json *json = &run->report;
    json_array_end(json);
    json_array(json, "scenes");
    json_append(json, &command->scenes);
    json_array_end(json);
    building_write_errors(run);
    json_text(json, "output", run->options->output);
    json_integer(json, "changed", run->output.changed);
    json_integer(json, "removed", run->output.removed);
    json_number(json, "wall_ms", clock_ms() - run->start);
    json_object_end(json);
}

static void print_summary(const struct building *run)
{
    uint32_t changed = run->output.changed, removed = run->output.removed;
    printf("%llu structure%s, %.2f MB, %u file%s changed, ", (unsigned long long)run->structure_count,
           run->structure_count == 1 ? "" : "s", (double)run->byte_count / 1e6, changed, changed == 1 ? "" : "s");
    if (removed)
        printf("%u stale file%s removed, ", removed, removed == 1 ? "" : "s");
    printf("%.0f ms\n", clock_ms() - run->start);
}

/* Says that a container was not written, because it holds all structures or none. */
static void note_no_container(struct building *run)
{
    struct bvhd_error error;
    if (!run->output.is_container || !run->failed)
        return;
    bvhd_error_set(&error, run->failures ? run->failures[0].error.status : BVHD_NO_MEMORY, run->options->output,
                   "it was not written, because not all of its structures were built");
    building_fail(run, "build", &error);
}

static void write_lists(struct build_command *command)
{
    struct building *run = &command->run;
    struct bvhd_error error;
    if (run->failed && run->structure_count == 0)
        return; /* there is nothing to list, and an earlier manifest may still be right */
    note_no_container(run);
    if (building_end_manifest(run, &error))
        building_fail(run, "build", &error);
    else if (run->options->depfile && !run->failed && depfile_write(&command->depfile, run->options->depfile, &error))
        building_fail(run, "build", &error);
}

static enum exit_code finish_output(struct build_command *command)
{
    struct building *run = &command->run;
    if (run->loss.status)
        return report_failure(run->options->json, "build", &run->loss);
    write_lists(command);
    bool ok = true;
    if (building_prints_text(run)) {
        if (run->structure_count)
            print_summary(run);
        ok = report_flush();
    } else if (!run->options->json) {
        return run->failed ? EXIT_FAILED : EXIT_DONE;
    } else if (run->structure_count == 0 && run->failure_count) {
        report_failure_json(&run->failures[0].error);
    } else {
        print_report(command);
        ok = report_print(&run->report);
    }
    return ok && !run->failed ? EXIT_DONE : EXIT_FAILED;
}

static enum exit_code build_scenes(struct build_command *command)
{
    begin_output(command);
    for (int i = 0; i < command->run.options->operand_count && !command->run.loss.status; i++)
        build_scene(command, command->run.options->operands[i]);
    return finish_output(command);
}

enum exit_code command_build(const struct options *options)
{
    struct bvhd_error error;
    struct build_command command = {0};
    struct building *run = &command.run;
    enum exit_code code;
    building_init(run, "build", options);
    if (check_names(options, &run->notes, &error)) {
        report_failure(options->json, "build", &error);
        code = error.status == BVHD_INVALID ? EXIT_USAGE : EXIT_FAILED;
    } else if (building_open(run, &error) || output_open(&run->output, options->output, &run->notes, &error)) {
        memory_explain(&run->memory, &error);
        code = report_failure(options->json, "build", &error);
    } else {
        code = build_scenes(&command);
    }
    json_finish(&command.scenes);
    depfile_finish(&command.depfile);
    building_finish(run);
    return code;
}
