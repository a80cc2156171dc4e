/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/commands.h"
#include "client/bvhctl/base/files.h"
#include "client/bvhctl/gpu/inspect_probe.h"
#include "builder/format/layout.h"
#include "builder/format/serialized.h"
#include "client/bvhctl/scene/structures.h"
#include "client/bvhctl/scene/survey.h"

enum { GEOMETRY_LINES = 16 }; /* most geometries that the text shows */

/* The state of `bvhctl inspect`. */
struct inspect_command {
    const struct options *options;
    struct memory memory;
    struct json json;
    enum exit_code code;
    struct bvhd_error first_error;
    uint32_t shown;
};

/* Adds the UUID as text if it is printable: some drivers put the name of their version there. */
static void add_letters(const uint8_t uuid[SERIALIZED_UUID_SIZE], char text[64])
{
    for (int i = 0; i < SERIALIZED_UUID_SIZE; i++)
        if (uuid[i] < ' ' || uuid[i] > '~')
            return;
    sprintf(text + strlen(text), " \"%.16s\"", (const char *)uuid);
}

static void write_counts(struct json *json, const char *key, const uint64_t *counts, unsigned first, unsigned end)
{
    json_array(json, key);
    for (unsigned i = first; i < end; i++)
        json_integer(json, NULL, counts[i]);
    json_array_end(json);
}

/* An opened structure and the facts about it. */
struct inspected {
    const char *path; /* of the file, or of the container */
    const char *file; /* the structure's name in its container; NULL: it is a file */
    const struct manifest_entry *entry; /* what the manifest says about it; NULL: there is none */
    const struct structure *structure;
    struct serialized_header serialized;
    struct survey survey;
};

static void write_serialized(struct json *json, const struct serialized_header *serialized)
{
    char uuid[INSPECT_UUID];
    inspect_uuid(serialized->driver_uuid, uuid);
    json_text(json, "driver_uuid", uuid);
    inspect_uuid(serialized->compatibility_uuid, uuid);
    json_text(json, "compatibility_uuid", uuid);
    json_integer(json, "serialized_size", serialized->serialized_size);
    json_integer(json, "deserialized_size", serialized->deserialized_size);
    json_integer(json, "handle_count", serialized->handle_count);
}

/* Nothing can be hit in an empty structure, which has no bounds. */
static void write_bounds(struct json *json, const struct inspected *inspected)
{
    float bounds[6];
    structure_bounds(inspected->structure, bounds);
    if (inspected->survey.depth)
        json_floats(json, "bounds", bounds, 6);
    else
        json_null(json, "bounds");
}

static void write_header(struct json *json, const struct inspected *inspected)
{
    const struct structure *structure = inspected->structure;
    write_serialized(json, &inspected->serialized);
    json_text(json, "target", layout_find(structure->target)->name);
    for (uint32_t i = 0; i < inspected->survey.figure_count; i++)
        json_integer(json, inspected->survey.figures[i].name, inspected->survey.figures[i].value);
    json_text(json, "content", survey_content_name(structure));
    write_bounds(json, inspected);
    json_integer(json, "levels", inspected->survey.depth);
    json_integer(json, "node_count", inspected->survey.nodes);
    json_integer(json, "records", structure->record_count);
    json_integer(json, "primitives", structure->primitive_count);
}

static void write_survey(struct json *json, const struct survey *survey)
{
    json_object(json, "sections");
    json_integer(json, "header", survey->header_bytes);
    json_integer(json, "nodes", survey->node_bytes);
    json_integer(json, "records", survey->record_bytes);
    json_integer(json, "vertices", survey->vertex_bytes);
    json_integer(json, "geometries", survey->geometry_bytes);
    json_integer(json, "padding", survey->other_bytes);
    json_object_end(json);
    json_number(json, survey->arity > 2 ? "wide_sah" : "binary_sah", survey->sah);
    json_integer(json, "unused_nodes", survey->unused_nodes);
    json_integer(json, "unreferred_records", survey->unreferred_records);
    json_integer(json, "inner_children", survey->inner_children);
    json_integer(json, "leaf_children", survey->leaf_children);
    write_counts(json, "nodes_with_children", survey->node_children, 1, survey->arity + 1);
    write_counts(json, "leaves_with_records", survey->leaf_records, 1, survey->leaf_max + 1);
    write_counts(json, "nodes_on_level", survey->level_nodes, 0, survey->depth);
}

/* Writes what the structure is called, and what its manifest says about it. */
static void write_names(struct json *json, const struct inspected *inspected)
{
    const struct manifest_entry *entry = inspected->entry;
    const char *slash = strrchr(inspected->path, '/');
    json_text(json, "file", inspected->file ? inspected->file : slash ? slash + 1 : inspected->path);
    json_text(json, "path", inspected->path);
    if (inspected->structure->content == CONTENT_UNKNOWN)
        json_null(json, "type");
    else
        json_text(json, "type", inspected->structure->content == CONTENT_INSTANCES ? "tlas" : "blas");
    if (entry) {
        json_text(json, "scene", entry->scene);
        json_text(json, "name", entry->name);
        json_text(json, "key", entry->key);
    }
    json_integer(json, "bytes", inspected->structure->blob.size);
}

/* The instances of a top level that moves, by how they move. */
struct motions {
    uint32_t counts[MOTION_TYPES]; /* by MOTION_ */
};

static bool has_motions(const struct structure *structure)
{
    return structure->moves && structure->content == CONTENT_INSTANCES;
}

static struct motions count_motions(const struct structure *structure)
{
    struct motions motions = {{0}};
    for (uint32_t row = 0; row < structure_instance_count(structure); row++)
        motions.counts[structure_instance(structure, row).motion]++;
    return motions;
}

static void write_motions(struct json *json, const struct structure *structure)
{
    if (!has_motions(structure))
        return;
    struct motions motions = count_motions(structure);
    json_object(json, "motion");
    json_integer(json, "srt_instances", motions.counts[MOTION_SRT]);
    json_integer(json, "matrix_instances", motions.counts[MOTION_MATRIX]);
    json_object_end(json);
}

static void write_file(struct json *json, const struct inspected *inspected)
{
    const struct structure *structure = inspected->structure;
    json_object(json, NULL);
    write_names(json, inspected);
    write_header(json, inspected);
    write_motions(json, structure);
    write_survey(json, &inspected->survey);
    json_array(json, "geometries");
    for (uint32_t i = 0; i < structure->geometry_count; i++) {
        const struct structure_geometry *geometry = &structure->geometries[i];
        json_object(json, NULL);
        json_integer(json, "geometry", geometry->geometry);
        json_integer(json, "flags", geometry->flags);
        json_integer(json, "first_primitive", geometry->first_primitive);
        json_integer(json, "primitives", geometry->primitive_count);
        json_object_end(json);
    }
    json_array_end(json);
    json_object_end(json);
}

static void print_section(const char *name, uint64_t bytes, uint64_t total, uint64_t count)
{
    printf("  %-11s %12llu bytes %5.1f %%", name, (unsigned long long)bytes, 100.0 * (double)bytes / (double)total);
    if (count)
        printf("  %10llu, %.1f B each", (unsigned long long)count, (double)bytes / (double)count);
    printf("\n");
}

static void print_counts(const char *title, const uint64_t *counts, unsigned first, unsigned end)
{
    printf("  %s:", title);
    for (unsigned i = first; i < end; i++)
        printf("  %u: %llu", i, (unsigned long long)counts[i]);
    printf("\n");
}

static void print_geometries(const struct structure *structure)
{
    uint32_t count = structure->geometry_count;
    for (uint32_t i = 0; i < count && i < GEOMETRY_LINES; i++) {
        const struct structure_geometry *geometry = &structure->geometries[i];
        printf("  geometry %u: %u primitives%s%s\n", geometry->geometry, geometry->primitive_count,
               geometry->flags & GEOMETRY_OPAQUE ? ", opaque" : "",
               geometry->flags & GEOMETRY_NO_DUPLICATE_ANY_HIT ? ", no duplicate any-hit" : "");
    }
    if (count > GEOMETRY_LINES)
        printf("  and %u more geometries\n", count - GEOMETRY_LINES);
}

static void print_motions(const struct structure *structure)
{
    if (!has_motions(structure))
        return;
    struct motions motions = count_motions(structure);
    printf("  motion: %u instances stand still, %u move by SRT and %u by matrices\n", motions.counts[MOTION_STATIC],
           motions.counts[MOTION_SRT], motions.counts[MOTION_MATRIX]);
}

/* For layouts with one leaf for each primitive: how many of them the tree refers to, and how often. */
static void print_leaves(const struct survey *survey, uint64_t leaf_offset)
{
    uint64_t referred = survey->records - survey->unreferred_records;
    printf("  leaves from byte %llu of the body on: %llu that no box refers to, %llu references beyond the first; room "
           "for %llu more boxes\n",
           (unsigned long long)leaf_offset, (unsigned long long)survey->unreferred_records,
           (unsigned long long)(survey->leaf_children - referred), (unsigned long long)survey->unused_nodes);
}

static void print_tree(const struct structure *structure, const struct survey *survey)
{
    uint64_t children = survey->inner_children + survey->leaf_children;
    const uint64_t *leaf_offset = survey_find_figure(survey, "leaf_offset");
    if (survey->depth == 0) {
        printf("  empty\n");
        return;
    }
    printf("  %u-wide tree: %u levels, %.2f children a node", survey->arity, survey->depth,
           (double)children / (double)survey->nodes);
    if (survey->leaf_max > 1)
        printf(", %.2f records a leaf",
               survey->leaf_children ? structure->record_count / (double)survey->leaf_children : 0.0);
    printf(", SAH %.2f\n", survey->sah);
    print_counts("nodes by children", survey->node_children, 1, survey->arity + 1);
    if (leaf_offset)
        print_leaves(survey, *leaf_offset);
    else
        print_counts("leaves by records", survey->leaf_records, 1, survey->leaf_max + 1);
    print_counts("nodes by level", survey->level_nodes, 0, survey->depth);
}

static const char *level_name(const struct structure *structure)
{
    return structure->content == CONTENT_UNKNOWN     ? "top or bottom"
           : structure->content == CONTENT_INSTANCES ? "top"
                                                     : "bottom";
}

static void print_title(const struct inspected *inspected)
{
    const struct structure *structure = inspected->structure;
    const struct serialized_header *serialized = &inspected->serialized;
    const struct survey_figure *revision = &inspected->survey.figures[0];
    const uint64_t *build_flags = survey_find_figure(&inspected->survey, "build_flags");
    char uuid[64];
    inspect_uuid(serialized->compatibility_uuid, uuid);
    add_letters(serialized->compatibility_uuid, uuid);
    printf("%s%s%s: %s level, %s %s %llu, %u %s of %u primitives, %llu bytes\n", inspected->path,
           inspected->file ? ": " : "", inspected->file ? inspected->file : "", level_name(structure),
           layout_find(structure->target)->name, revision->name, (unsigned long long)revision->value,
           structure->record_count, survey_content_name(structure), structure->primitive_count,
           (unsigned long long)structure->blob.size);
    printf("  compatibility %s, %llu bytes when created, %llu handles", uuid,
           (unsigned long long)serialized->deserialized_size, (unsigned long long)serialized->handle_count);
    if (build_flags)
        printf(", build flags 0x%llx", (unsigned long long)*build_flags);
    printf("\n");
}

static void print_sections(const struct structure *structure, const struct survey *survey)
{
    uint64_t total = structure->blob.size;
    const uint64_t *vertices = survey_find_figure(survey, "vertices");
    print_section("headers", survey->header_bytes, total, 0);
    print_section("nodes", survey->node_bytes, total, survey->nodes + survey->unused_nodes);
    print_section("records", survey->record_bytes, total, survey->records);
    if (vertices) {
        print_section("vertices", survey->vertex_bytes, total, *vertices);
        print_section("geometries", survey->geometry_bytes, total, structure->geometry_count);
    }
    print_section("padding", survey->other_bytes, total, 0);
}

static void print_file(const struct inspected *inspected)
{
    const struct structure *structure = inspected->structure;
    float bounds[6];
    structure_bounds(structure, bounds);
    print_title(inspected);
    if (inspected->survey.depth)
        printf("  bounds (%g, %g, %g) to (%g, %g, %g)\n", bounds[0], bounds[1], bounds[2], bounds[3], bounds[4],
               bounds[5]);
    print_sections(structure, &inspected->survey);
    print_tree(structure, &inspected->survey);
    print_geometries(structure);
    print_motions(structure);
}

static void fail(struct inspect_command *run, struct bvhd_error *error)
{
    memory_explain(&run->memory, error);
    if (run->code == EXIT_DONE)
        run->first_error = *error;
    report_line("inspect", error);
    enum exit_code code =
        error->status == BVHD_CORRUPT || error->status == BVHD_INCOMPATIBLE ? EXIT_WRONG : EXIT_FAILED;
    run->code = run->code == EXIT_FAILED ? EXIT_FAILED : code;
}

static enum bvhd_status take(struct inspect_command *run, struct inspected *inspected, struct bvhd_error *error)
{
    enum bvhd_status status = serialized_read(inspected->structure->blob, &inspected->serialized, error);
    return status != BVHD_OK ? status : survey_take(inspected->structure, &run->memory, &inspected->survey, error);
}

/* Prints a probe. BVHD_NOT_FOUND: the file is not a probe, and its error as a structure is the one to report. */
static enum bvhd_status inspect_probe(struct inspect_command *run, const char *path, struct bvhd_error *error)
{
    struct inspect_probe probe;
    enum bvhd_status status = inspect_probe_open(path, &run->memory, &probe, error);
    if (status != BVHD_OK)
        return status;
    if (run->options->json)
        inspect_probe_write(path, &probe, &run->json);
    else
        inspect_probe_print(path, &probe);
    inspect_probe_close(&probe, &run->memory);
    return BVHD_OK;
}

/* Inspects a file that cannot be opened as a structure: it may be a probe. */
static enum bvhd_status inspect_other(struct inspect_command *run, const char *path, enum bvhd_status status,
                                      struct bvhd_error *error)
{
    struct bvhd_error of_probe;
    if (status != BVHD_CORRUPT && status != BVHD_INCOMPATIBLE)
        return status;
    enum bvhd_status as_probe = inspect_probe(run, path, &of_probe);
    if (as_probe == BVHD_OK)
        return BVHD_OK;
    if (as_probe == BVHD_CORRUPT || as_probe == BVHD_INCOMPATIBLE || as_probe == BVHD_NO_MEMORY)
        *error = of_probe;
    return error->status;
}

/* Reports an opened structure, and closes it. */
static void show(struct inspect_command *run, struct inspected *inspected, struct structure_file *file)
{
    struct bvhd_error error;
    inspected->structure = &file->structure;
    enum bvhd_status status = take(run, inspected, &error);
    if (status == BVHD_OK && run->options->json)
        write_file(&run->json, inspected);
    else if (status == BVHD_OK)
        print_file(inspected);
    structures_close_file(file, &run->memory);
    run->shown += status == BVHD_OK;
    if (status != BVHD_OK)
        fail(run, &error);
}

static void inspect_file(struct inspect_command *run, const char *path)
{
    struct structure_file file;
    struct inspected inspected = {.path = path};
    struct bvhd_error error;
    enum bvhd_status status = structures_read(path, &run->memory, &file, &error);
    if (status == BVHD_OK) {
        show(run, &inspected, &file);
        return;
    }
    status = inspect_other(run, path, status, &error);
    run->shown += status == BVHD_OK;
    if (status != BVHD_OK)
        fail(run, &error);
}

/* Inspects what a manifest lists: a structure of a container, or a file of a directory. */
static void inspect_entry(struct inspect_command *run, const struct built *built, const struct manifest_entry *entry)
{
    struct structure_file file;
    struct bvhd_error error;
    char *path = built->is_container ? files_copy_text(&run->memory, built->path)
                                     : files_join(&run->memory, built->path, entry->file);
    struct inspected inspected = {.path = path, .entry = entry, .file = built->is_container ? entry->file : NULL};
    if (!path)
        fail(run, &(struct bvhd_error){BVHD_NO_MEMORY, BVHD_VUID_NONE, "inspect", "no memory for a path"});
    else if (structures_read_built(built, entry->file, &run->memory, &file, &error) == BVHD_OK)
        show(run, &inspected, &file);
    else
        fail(run, &error);
    memory_free(&run->memory, path);
}

static void print_container(const struct built *built)
{
    printf("%s: container version %u, %u structures, %llu bytes, of which %llu are its manifest\n", built->path,
           built->container.version, built->container.count, (unsigned long long)built->container.file.size,
           (unsigned long long)built->container.manifest.size);
}

static void write_container(struct json *json, const struct built *built)
{
    json_object(json, "container");
    json_text(json, "path", built->path);
    json_integer(json, "version", built->container.version);
    json_integer(json, "structures", built->container.count);
    json_integer(json, "bytes", built->container.file.size);
    json_integer(json, "manifest_bytes", built->container.manifest.size);
    json_object_end(json);
}

static void inspect_built(struct inspect_command *run, const struct built *built)
{
    struct manifest manifest;
    struct bvhd_error error;
    if (manifest_read_built(built, &run->memory, &manifest, &error) != BVHD_OK) {
        fail(run, &error);
        return;
    }
    if (built->is_container && !run->options->json)
        print_container(built);
    for (uint32_t i = 0; i < manifest.count; i++)
        inspect_entry(run, built, &manifest.entries[i]);
    manifest_finish(&manifest);
}

/* Inspects a directory or a container. */
static void inspect_all(struct inspect_command *run, const char *path)
{
    struct built built;
    struct bvhd_error error;
    json_array(&run->json, "files");
    if (built_open(path, &run->memory, &built, &error) != BVHD_OK) {
        fail(run, &error);
        json_array_end(&run->json);
        return;
    }
    inspect_built(run, &built);
    json_array_end(&run->json);
    if (built.is_container)
        write_container(&run->json, &built);
    built_close(&built);
}

static void inspect_one(struct inspect_command *run, const char *path)
{
    json_array(&run->json, "files");
    inspect_file(run, path);
    json_array_end(&run->json);
}

enum exit_code command_inspect(const struct options *options)
{
    struct inspect_command run = {.options = options};
    memory_init(&run.memory, options->memory);
    json_init(&run.json, &run.memory, false);
    json_object(&run.json, NULL);
    json_integer(&run.json, "schema", 1);
    if (files_is_directory(options->operands[0]) || built_is_container(options->operands[0]))
        inspect_all(&run, options->operands[0]);
    else
        inspect_one(&run, options->operands[0]);
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
