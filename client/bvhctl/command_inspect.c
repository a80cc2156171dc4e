/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "commands.h"
#include "files.h"
#include "serialized.h"
#include "structures.h"
#include "survey.h"

enum { GEOMETRY_LINES = 16 }; /* most geometries that the text shows */

/* One call of `bvhctl inspect`. */
struct run {
    const struct options *options;
    struct memory memory;
    struct json json;
    enum exit_code code;
    struct bvhd_error first_error;
    uint32_t shown;
};

static void uuid_text(const uint8_t uuid[SERIALIZED_UUID_SIZE], char ret_text[40])
{
    char *out = ret_text;
    for (int i = 0; i < SERIALIZED_UUID_SIZE; i++)
        out += sprintf(out, "%s%02x", i == 4 || i == 6 || i == 8 || i == 10 ? "-" : "", uuid[i]);
}

static void write_counts(struct json *json, const char *key, const uint64_t *counts, unsigned first, unsigned end)
{
    json_array(json, key);
    for (unsigned i = first; i < end; i++)
        json_integer(json, NULL, counts[i]);
    json_array_end(json);
}

static void write_header(struct json *json, const struct serialized_header *serialized, const struct portable_header *header)
{
    char uuid[40];
    uuid_text(serialized->driver_uuid, uuid);
    json_text(json, "driver_uuid", uuid);
    uuid_text(serialized->compatibility_uuid, uuid);
    json_text(json, "compatibility_uuid", uuid);
    json_integer(json, "serialized_size", serialized->serialized_size);
    json_integer(json, "deserialized_size", serialized->deserialized_size);
    json_integer(json, "handles", serialized->handle_count);
    json_text(json, "target", "portable");
    json_integer(json, "version", header->version);
    json_text(json, "content", survey_content_name(header->content));
    json_integer(json, "build_flags", header->build_flags);
    json_array(json, "bounds");
    for (int i = 0; i < 6; i++)
        json_number(json, NULL, header->bounds[i]);
    json_array_end(json);
    json_integer(json, "depth", header->depth);
    json_integer(json, "nodes", header->node_count);
    json_integer(json, "records", header->record_count);
    json_integer(json, "vertices", header->vertex_count);
    json_integer(json, "primitives", header->primitive_count);
}

static void write_survey(struct json *json, const struct survey *survey, uint32_t depth)
{
    json_object(json, "bytes");
    json_integer(json, "header", survey->header_bytes);
    json_integer(json, "nodes", survey->node_bytes);
    json_integer(json, "records", survey->record_bytes);
    json_integer(json, "vertices", survey->vertex_bytes);
    json_integer(json, "geometries", survey->geometry_bytes);
    json_integer(json, "padding", survey->other_bytes);
    json_object_end(json);
    json_number(json, "wide_sah", survey->sah);
    json_integer(json, "inner_children", survey->inner_children);
    json_integer(json, "leaf_children", survey->leaf_children);
    write_counts(json, "nodes_with_children", survey->node_children, 1, 9);
    write_counts(json, "leaves_with_records", survey->leaf_records, 1, PORTABLE_LEAF_MAX + 1);
    write_counts(json, "nodes_on_level", survey->level_nodes, 0, depth);
}

static void write_file(struct json *json, const char *path, const struct serialized_header *serialized,
                       const struct structure_file *file, const struct survey *survey)
{
    json_object(json, NULL);
    json_text(json, "file", path);
    write_header(json, serialized, file->structure.view.portable.header);
    write_survey(json, survey, file->structure.view.portable.header->depth);
    json_array(json, "geometries");
    for (uint32_t i = 0; i < file->structure.view.portable.header->geometry_count; i++) {
        const struct portable_geometry *geometry = &file->structure.view.portable.geometries[i];
        json_object(json, NULL);
        json_integer(json, "flags", geometry->flags);
        json_integer(json, "first_primitive", geometry->first_primitive);
        json_integer(json, "primitives", geometry->primitive_count);
        json_object_end(json);
    }
    json_array_end(json);
    json_object_end(json);
}

static void print_section(const char *name, uint64_t bytes, uint64_t total, uint32_t count)
{
    printf("  %-11s %12llu bytes %5.1f %%", name, (unsigned long long)bytes, 100.0 * (double)bytes / (double)total);
    if (count)
        printf("  %10u, %.1f B each", count, (double)bytes / count);
    printf("\n");
}

static void print_counts(const char *title, const uint64_t *counts, unsigned first, unsigned end)
{
    printf("  %s:", title);
    for (unsigned i = first; i < end; i++)
        printf("  %u: %llu", i, (unsigned long long)counts[i]);
    printf("\n");
}

static void print_geometries(const struct portable_view *view)
{
    uint32_t count = view->header->geometry_count;
    for (uint32_t i = 0; i < count && i < GEOMETRY_LINES; i++)
        printf("  geometry %u: %u primitives%s%s\n", i, view->geometries[i].primitive_count,
               view->geometries[i].flags & GEOMETRY_OPAQUE ? ", opaque" : "",
               view->geometries[i].flags & GEOMETRY_NO_DUPLICATE_ANY_HIT ? ", no duplicate any-hit" : "");
    if (count > GEOMETRY_LINES)
        printf("  and %u geometries more\n", count - GEOMETRY_LINES);
}

static void print_tree(const struct portable_header *header, const struct survey *survey)
{
    uint64_t children = survey->inner_children + survey->leaf_children;
    if (header->node_count == 0) {
        printf("  empty\n");
        return;
    }
    printf("  8-wide tree: %u levels, %.2f children a node, %.2f records a leaf, SAH %.2f\n", header->depth,
           (double)children / header->node_count, survey->leaf_children ? header->record_count / (double)survey->leaf_children : 0.0,
           survey->sah);
    print_counts("nodes by children", survey->node_children, 1, 9);
    print_counts("leaves by records", survey->leaf_records, 1, PORTABLE_LEAF_MAX + 1);
    print_counts("nodes by level", survey->level_nodes, 0, header->depth);
}

static void print_file(const char *path, const struct serialized_header *serialized, const struct structure_file *file,
                       const struct survey *survey)
{
    const struct portable_header *header = file->structure.view.portable.header;
    const float *bounds = header->bounds;
    char uuid[40];
    uuid_text(serialized->compatibility_uuid, uuid);
    printf("%s: %s level, portable version %u, %u %s of %u primitives, %llu bytes\n", path,
           header->content == PORTABLE_INSTANCES ? "top" : "bottom", header->version, header->record_count,
           survey_content_name(header->content), header->primitive_count, (unsigned long long)file->size);
    printf("  compatibility %s, %llu bytes when created, %llu handles, build flags 0x%x\n", uuid,
           (unsigned long long)serialized->deserialized_size, (unsigned long long)serialized->handle_count, header->build_flags);
    if (header->node_count)
        printf("  bounds (%g, %g, %g) to (%g, %g, %g)\n", bounds[0], bounds[1], bounds[2], bounds[3], bounds[4], bounds[5]);
    print_section("headers", survey->header_bytes, file->size, 0);
    print_section("nodes", survey->node_bytes, file->size, header->node_count);
    print_section("records", survey->record_bytes, file->size, header->record_count);
    print_section("vertices", survey->vertex_bytes, file->size, header->vertex_count);
    print_section("geometries", survey->geometry_bytes, file->size, header->geometry_count);
    print_section("padding", survey->other_bytes, file->size, 0);
    print_tree(header, survey);
    print_geometries(&file->structure.view.portable);
}

static void fail(struct run *run, const struct bvhd_error *error)
{
    if (run->code == EXIT_DONE)
        run->first_error = *error;
    report_line("inspect", error);
    enum exit_code code = error->status == BVHD_CORRUPT || error->status == BVHD_INCOMPATIBLE ? EXIT_WRONG : EXIT_FAILED;
    run->code = run->code == EXIT_FAILED ? EXIT_FAILED : code;
}

static void inspect_file(struct run *run, const char *path)
{
    struct structure_file file;
    struct serialized_header serialized;
    struct survey survey;
    struct bvhd_error error;
    enum bvhd_status status = structures_read(path, &run->memory, &file, &error);
    if (!status) {
        status = serialized_read((struct bytes){file.data, file.size}, &serialized, &error);
        if (!status)
            status = survey_take(&file.structure.view.portable, file.size, &run->memory, &survey, &error);
        if (!status && run->options->json)
            write_file(&run->json, path, &serialized, &file, &survey);
        else if (!status)
            print_file(path, &serialized, &file, &survey);
        structures_close_file(&file, &run->memory);
    }
    run->shown += !status;
    if (status)
        fail(run, &error);
}

static void inspect_directory(struct run *run, const char *directory)
{
    struct manifest manifest;
    struct bvhd_error error;
    if (manifest_read(directory, &run->memory, &manifest, &error)) {
        fail(run, &error);
        return;
    }
    for (uint32_t i = 0; i < manifest.count; i++) {
        char *path = files_join(&run->memory, directory, manifest.entries[i].file);
        if (path)
            inspect_file(run, path);
        else
            fail(run, &(struct bvhd_error){BVHD_NO_MEMORY, BVHD_VUID_NONE, "inspect", "no memory for a path"});
        memory_free(&run->memory, path);
    }
    manifest_finish(&manifest);
}

enum exit_code command_inspect(const struct options *options)
{
    struct run run = {.options = options};
    memory_init(&run.memory, options->memory);
    json_init(&run.json, &run.memory, false);
    json_object(&run.json, NULL);
    json_integer(&run.json, "schema", 1);
    json_array(&run.json, "files");
    if (files_is_directory(options->operands[0]))
        inspect_directory(&run, options->operands[0]);
    else
        inspect_file(&run, options->operands[0]);
    json_array_end(&run.json);
    json_object_end(&run.json);
    bool ok = true;
    if (!options->json)
        ok = report_flush();
    else if (run.code != EXIT_DONE && run.shown == 0)
        report_failure_json(&run.first_error);
    else
        ok = report_print(&run.json);
    json_finish(&run.json);
    return ok ? run.code : EXIT_FAILED;
}
