/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/building.h"
#include "client/bvhctl/commands.h"
#include "client/bvhctl/scene/manifest.h"
#include "client/bvhctl/scene/notes.h"
#include "client/bvhctl/scene/update_sources.h"
#include "proto/base/clock.h"

/* The state of `bvhctl update`. */
struct update_command {
    struct building run;
    struct manifest manifest; /* of the directory that is updated */
    const struct manifest_entry *top;
    struct manifest_wish wish; /* what of the scene's file was built */
    struct update_sources sources; /* of the next frame */
    struct assembly_holds held; /* with --local: the results of the last frame, which are those sources */
    uint32_t frame_count;
    uint64_t method_counts[ASSEMBLY_METHODS];
    uint32_t changed, removed; /* files, over all frames */
};

/* One moment, or the scene as a whole. */
struct frame {
    uint32_t number;
    struct import_wish wish;
    struct import_moment moment;
    char *output;
};

/* ---- what is updated ---- */

static const struct manifest_entry *find_only_top(const struct manifest *manifest, uint32_t *ret_count)
{
    const struct manifest_entry *top = NULL;
    *ret_count = 0;
    for (uint32_t i = 0; i < manifest->count; i++)
        if (manifest->entries[i].is_top) {
            top = &manifest->entries[i];
            (*ret_count)++;
        }
    return top;
}

/* Reads the manifest, whose options are those of the updates. */
static enum bvhd_status read_directory(struct update_command *command, struct bvhd_error *error)
{
    struct building *run = &command->run;
    const char *path = run->options->operands[0];
    const struct manifest_options *built = &command->manifest.options;
    uint32_t tops;
    enum bvhd_status status = manifest_read(path, &run->notes, &command->manifest, error);
    if (status != BVHD_OK)
        return status;
    command->top = find_only_top(&command->manifest, &tops);
    if (tops != 1)
        return bvhd_error_set(error, BVHD_INVALID, path, "it has %u top levels; one with its bottom levels is updated",
                              tops);
    if (!built->are_known)
        return bvhd_error_set(error, BVHD_INCOMPATIBLE, path,
                              "its manifest does not say by which options it was built, or this version does not know "
                              "them: build it again");
    if (!(built->build_flags & BUILD_ALLOW_UPDATE))
        return bvhd_error_set(error, BVHD_INVALID, path, "it was built without --flags allow-update");
    if (run->options->has_shutter && !command->top->is_shutter)
        return bvhd_error_set(error, BVHD_INVALID, path, "it was built without --shutter, so that nothing of it moves");
    manifest_wish_init(&command->wish, command->top);
    run->complete.build = built->build;
    run->complete.build_flags = built->build_flags;
    run->complete.geometry_flags = built->geometry_flags;
    run->complete.rays = built->rays;
    run->complete.scene = command->top->source_name ? command->top->source_name : command->wish.wish.scene;
    run->complete.output = run->options->output ? run->options->output : path;
    return BVHD_OK;
}

/* ---- a frame ---- */

static enum bvhd_status keep_frame(struct update_command *command, struct frame *frame, struct assembly *assembly,
                                   const struct file_names *names, struct bvhd_error *error)
{
    struct building *run = &command->run;
    enum bvhd_status status = output_open(&run->output, frame->output, &run->notes, error);
    if (status != BVHD_OK)
        return status;
    run->output.replaces_all = true;
    building_begin_manifest(run);
    building_keep(run, assembly, names);
    notes_activity(assembly);
    if (!run->failed)
        status = building_end_manifest(run, error);
    command->changed += run->output.changed;
    command->removed += run->output.removed;
    output_close(&run->output);
    return status;
}

static void count_methods(struct update_command *command, const struct assembly *assembly)
{
    for (uint32_t i = 0; i <= assembly->import->bottom_count; i++)
        if (assembly->items[i].error.status == BVHD_OK)
            command->method_counts[assembly->outcomes[i].method]++;
}

static enum bvhd_status update_imported(struct update_command *command, struct frame *frame,
                                        const struct import *import, const struct file_names *names,
                                        struct bvhd_error *error)
{
    struct building *run = &command->run;
    struct assembly assembly;
    enum bvhd_status status = BVHD_OK;
    if (frame->number == 0)
        status = update_sources_find(&command->sources, &command->manifest, run->options->operands[0], import, error);
    if (status == BVHD_OK)
        status = update_sources_align(&command->sources, import, names, error);
    if (status != BVHD_OK)
        return status;
    const struct assembly_sources sources = {command->sources.aligned, run->options->most_decay, run->complete.rays};
    progress_begin(&run->progress, "updating", import->name);
    status = assemble_update(import, run->options, &sources, run->backend, &assembly, error);
    progress_end(&run->progress);
    if (status != BVHD_OK)
        return status;
    status = keep_frame(command, frame, &assembly, names, error);
    count_methods(command, &assembly);
    update_sources_take(&command->sources, &assembly);
    assembly_release(&command->held);
    if (run->options->local)
        command->held = assembly_take(&assembly);
    assembly_finish(&assembly);
    return status;
}

static void print_frame(const struct update_command *command, const struct frame *frame)
{
    if (!building_prints_text(&command->run) || !frame->wish.moment)
        return;
    printf("%s: %g s", frame->output, frame->moment.time);
    if (frame->moment.is_shutter)
        printf(" to %g s", frame->moment.end);
    printf("\n");
}

static void begin_frame(struct update_command *command, const struct frame *frame)
{
    struct json *json = &command->run.report;
    print_frame(command, frame);
    json_object(json, NULL);
    if (frame->wish.moment)
        json_number(json, "time", frame->moment.time);
    else
        json_null(json, "time");
    if (frame->wish.moment && frame->moment.is_shutter)
        json_number(json, "end", frame->moment.end);
    json_text(json, "output", frame->output);
    json_array(json, "structures");
}

static void end_frame(struct update_command *command)
{
    json_array_end(&command->run.report);
    json_object_end(&command->run.report);
    command->frame_count++;
}

static enum bvhd_status update_scene(struct update_command *command, struct frame *frame, struct bvhd_error *error)
{
    struct building *run = &command->run;
    const char *path = run->options->operands[1];
    struct import import;
    struct file_names names;
    progress_begin(&run->progress, "importing", path);
    enum bvhd_status status = import_scene_as(path, &frame->wish, &run->memory, &import, error);
    progress_end(&run->progress);
    if (status != BVHD_OK)
        return status;
    if (frame->number == 0)
        notes_left_out(&import);
    notes_motion(&import);
    status = file_names_make(&import, &names, error);
    if (status == BVHD_OK) {
        begin_frame(command, frame);
        status = update_imported(command, frame, &import, &names, error);
        end_frame(command);
        file_names_finish(&names);
    }
    import_finish(&import);
    return status;
}

/* ---- all frames ---- */

/* Returns the path that a frame is written to, or NULL when there is no memory. */
static char *frame_output(const struct update_command *command, uint32_t number)
{
    const struct options *options = command->run.options;
    struct memory *memory = (struct memory *)(uintptr_t)&command->run.notes;
    char name[16];
    snprintf(name, sizeof name, "%04u", number);
    bool has_own = options->has_frames && strcmp(options->output, options->operands[0]) != 0;
    return has_own ? files_join(memory, options->output, name) : files_copy_text(memory, options->output);
}

static void update_frame(struct update_command *command, uint32_t number)
{
    struct building *run = &command->run;
    const struct options *options = run->options;
    struct bvhd_error error = {0};
    struct frame frame = {.number = number, .wish = command->wish.wish, .moment = command->wish.moment};
    if (options->has_moment || options->has_frames) {
        double length = frame.moment.end - frame.moment.time; /* of a shutter interval, which begins at each moment */
        frame.moment.time = options->has_frames ? options->frames[0] + number * options->frames[2] : options->moment;
        frame.moment.end = frame.moment.time + length;
        frame.wish.moment = &frame.moment;
    }
    if (options->has_shutter) {
        frame.moment.time = options->shutter[0];
        frame.moment.end = options->shutter[1];
        frame.moment.is_shutter = true;
        frame.wish.moment = &frame.moment;
    }
    if (options->animation)
        frame.moment.animation = options->animation;
    frame.output = frame_output(command, number);
    enum bvhd_status status = frame.output ? update_scene(command, &frame, &error)
                                           : bvhd_error_no_memory(&error, options->output, "no memory for a name");
    memory_explain(&run->memory, &error);
    if (status == BVHD_UNAVAILABLE)
        run->loss = error;
    else if (status != BVHD_OK)
        building_fail(run, "update", &error);
    memory_free(&run->notes, frame.output);
}

/* The last moment may be missed by what rounding adds up to. */
static uint32_t count_frames(const struct options *options)
{
    const double *frames = options->frames;
    return options->has_frames ? (uint32_t)((frames[1] - frames[0]) / frames[2] + 1e-6) + 1 : 1;
}

static void write_summary(struct update_command *command)
{
    struct building *run = &command->run;
    struct json *json = &run->report;
    json_array_end(json);
    for (int i = 0; i < ASSEMBLY_METHODS; i++)
        json_integer(json, manifest_method_name((enum assembly_method)i), command->method_counts[i]);
    building_write_errors(run);
    json_integer(json, "changed", command->changed);
    json_integer(json, "removed", command->removed);
    json_number(json, "wall_ms", clock_ms() - run->start);
    json_object_end(json);
}

static void print_summary(const struct update_command *command)
{
    const uint64_t *counts = command->method_counts;
    uint64_t built = 0;
    for (int i = 0; i < ASSEMBLY_METHODS; i++)
        built += i == ASSEMBLY_UPDATED ? 0 : counts[i];
    printf("%u frame%s: %llu updated, %llu built", command->frame_count, command->frame_count == 1 ? "" : "s",
           (unsigned long long)counts[ASSEMBLY_UPDATED], (unsigned long long)built);
    if (built)
        printf(" (%llu had decayed, %llu were lost, %llu have other active primitives)",
               (unsigned long long)counts[ASSEMBLY_DECAYED], (unsigned long long)counts[ASSEMBLY_LOST],
               (unsigned long long)counts[ASSEMBLY_OTHER_ACTIVE]);
    printf(", %u files changed, %.0f ms\n", command->changed, clock_ms() - command->run.start);
}

static enum exit_code finish(struct update_command *command)
{
    struct building *run = &command->run;
    bool ok = true;
    write_summary(command);
    if (run->loss.status != BVHD_OK)
        return report_failure(run->options->json, "update", &run->loss);
    if (building_prints_text(run)) {
        if (run->structure_count)
            print_summary(command);
        ok = report_flush();
    } else if (run->options->json && run->structure_count == 0 && run->failure_count) {
        report_failure_json(&run->failures[0].error);
    } else if (run->options->json) {
        ok = report_print(&run->report);
    }
    return ok && !run->failed ? EXIT_DONE : EXIT_FAILED;
}

/* Updates frame after frame, until one fails: the next ones would have no source. */
static enum exit_code update_all(struct update_command *command)
{
    struct building *run = &command->run;
    uint32_t count = count_frames(run->options);
    json_array(&run->report, "frames");
    for (uint32_t i = 0; i < count && !run->failed && run->loss.status == BVHD_OK; i++)
        update_frame(command, i);
    return finish(command);
}

enum exit_code command_update(const struct options *options)
{
    struct bvhd_error error = {0};
    struct update_command command = {0};
    enum exit_code code;
    building_init(&command.run, "update", options);
    update_sources_init(&command.sources, &command.run.notes);
    if (read_directory(&command, &error) != BVHD_OK || building_open(&command.run, &error) != BVHD_OK) {
        memory_explain(&command.run.memory, &error);
        code = report_failure(options->json, "update", &error);
    } else {
        code = update_all(&command);
    }
    assembly_release(&command.held);
    update_sources_finish(&command.sources);
    manifest_finish(&command.manifest);
    building_finish(&command.run);
    return code;
}
