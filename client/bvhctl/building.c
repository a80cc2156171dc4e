/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/building.h"

#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/gpu/probe_source.h"
#include "client/bvhctl/scene/import_round.h"
#include "client/bvhctl/scene/manifest.h"
#include "client/bvhctl/scene/target_reader.h"
#include "proto/base/clock.h"

void building_init(struct building *run, const char *command, const struct options *options)
{
    *run = (struct building){.command = command, .complete = *options, .start = clock_ms()};
    run->options = &run->complete;
    memory_init(&run->memory, options->memory);
    memory_init(&run->notes, UINT64_MAX);
    json_init(&run->report, &run->notes, false);
    json_object(&run->report, NULL);
    json_integer(&run->report, "schema", 1);
}

/* Finds the format of the device that structures are built for. Targets that are not native need none. */
static enum bvhd_status find_format(struct building *run, struct bvhd_error *error)
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

static enum bvhd_status open_backend(struct building *run, struct bvhd_error *error)
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

enum bvhd_status building_open(struct building *run, struct bvhd_error *error)
{
    enum bvhd_status status = find_format(run, error);
    return status == BVHD_OK ? open_backend(run, error) : status;
}

bool building_prints_text(const struct building *run)
{
    return !run->options->json && report_volume() >= REPORT_RESULTS;
}

void building_fail(struct building *run, const char *what, const struct bvhd_error *error)
{
    progress_end(&run->progress);
    report_line(what, error);
    run->failed = true;
    if (run->failure_count == run->failure_capacity) {
        uint32_t capacity = run->failure_capacity * 2 + 8;
        struct building_failure *grown = memory_resize(&run->notes, run->failures, capacity * sizeof *grown);
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
        run->failures[run->failure_count++] = (struct building_failure){copy, *error};
}

void building_write_errors(struct building *run)
{
    struct json *json = &run->report;
    json_array(json, "errors");
    for (uint32_t i = 0; i < run->failure_count; i++) {
        json_object(json, NULL);
        json_text(json, "what", run->failures[i].what);
        report_members(json, &run->failures[i].error);
        json_object_end(json);
    }
    json_array_end(json);
}

void building_begin_manifest(struct building *run)
{
    json_finish(&run->manifest);
    json_finish(&run->manifest_scenes);
    json_init(&run->manifest, &run->notes, true);
    json_init(&run->manifest_scenes, &run->notes, true);
    run->manifest_scenes.depth = 2; /* in an array of the manifest */
    manifest_begin(&run->manifest, run->options);
}

enum bvhd_status building_end_manifest(struct building *run, struct bvhd_error *error)
{
    struct json *json = &run->manifest;
    manifest_end(json, &run->manifest_scenes);
    if (json->failed)
        return bvhd_error_no_memory(error, MANIFEST_NAME, "no memory for the manifest");
    return output_end(&run->output, (struct bytes){(const unsigned char *)json->data, json->size}, !run->failed, error);
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

/* Says why a structure was built that had a source. */
static void print_reason(const struct assembly_outcome *outcome)
{
    switch (outcome->method) {
    case ASSEMBLY_LOST:
        printf(", built: its source is not there any more");
        break;
    case ASSEMBLY_OTHER_ACTIVE:
        printf(", built: other primitives are active");
        break;
    case ASSEMBLY_DECAYED:
        printf(", built: its decay was %.2f", outcome->decay);
        break;
    default:
        break;
    }
}

/* Describes the tree: of an update by what became of that of its source, because it has no other figures. */
static void print_tree(const struct bvhd_result *item)
{
    if (item->refits)
        printf("decay %5.2f  refit %2u", item->decay, item->refits);
    else
        printf("SAH %6.2f  depth %2u", item->sah, item->depth);
}

/* What the primitives of a bottom level are called. */
static const char *unit_of(const struct import *import, uint32_t index, uint64_t count)
{
    const struct import_bottom *bottom = &import->bottoms[index];
    const struct import_shape_kind *kind = &import_shape_kinds[import->meshes[bottom->meshes[0]].shape];
    return count == 1 ? kind->one : kind->many;
}

static void print_structure(const struct assembly *assembly, uint32_t index, const char *file)
{
    const struct bvhd_result *item = &assembly->items[index];
    bool is_top = index == assembly->import->bottom_count;
    uint64_t count = is_top ? item->instances : item->primitives;
    const char *unit = is_top ? (count == 1 ? "instance" : "instances") : unit_of(assembly->import, index, count);
    printf("%-40s %9llu %-9s %8.2f MB  %5.1f B each  ", file, (unsigned long long)count, unit, (double)item->size / 1e6,
           count ? (double)item->size / (double)count : 0.0);
    print_tree(item);
    printf("  %8.1f ms  %s %s%s", item->prepare_ms + item->build_ms, manifest_quality_name(item->quality),
           item->method ? item->method : "", origin_note(item->origin));
    print_reason(&assembly->outcomes[index]);
    printf("\n");
}

/* Writes a structure, and its entries in the manifest and the report. */
static enum bvhd_status keep_structure(struct building *run, const struct assembly *assembly, uint32_t index,
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
    if (building_prints_text(run))
        print_structure(assembly, index, names->files[index]);
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

void building_keep(struct building *run, struct assembly *assembly, const struct file_names *names)
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
            building_fail(run, names->files[i], &error);
        assembly->items[i].error = error;
    }
    if (assembly->items[top].error.status == BVHD_OK)
        manifest_write_scene(&run->manifest_scenes, assembly, names);
}

void building_finish(struct building *run)
{
    for (uint32_t i = 0; i < run->failure_count; i++)
        memory_free(&run->notes, run->failures[i].what);
    memory_free(&run->notes, run->failures);
    json_finish(&run->report);
    json_finish(&run->manifest);
    json_finish(&run->manifest_scenes);
    output_close(&run->output);
    backend_local_close(&run->local);
    backend_service_close(&run->service);
}
