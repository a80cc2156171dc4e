/* SPDX-License-Identifier: Apache-2.0 */
/* manifest_scene.c - writes what a manifest says about a scene as a whole: its files, its bounds, its nodes. */
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/manifest_internal.h"
#include "proto/base/checksum.h"

void manifest_write_bounds(struct json *json, const float bounds[6])
{
    if (bounds[0] <= bounds[3])
        json_floats(json, "bounds", bounds, 6);
    else
        json_null(json, "bounds"); /* nothing can be hit */
}

/* Reads a file for its size and its checksum. Returns false if it cannot be read any more. */
static bool sum_file(const char *path, uint64_t *ret_size, uint64_t *ret_sum)
{
    unsigned char chunk[1 << 16];
    struct checksum sum;
    size_t got;
    FILE *file = fopen(path, "rb");
    if (!file)
        return false;
    setvbuf(file, NULL, _IONBF, 0);
    checksum_init(&sum, 0);
    while ((got = fread(chunk, 1, sizeof chunk, file)) > 0)
        checksum_add(&sum, (struct bytes){chunk, got});
    bool ok = !ferror(file);
    fclose(file);
    *ret_size = sum.size;
    *ret_sum = checksum_get(&sum);
    return ok;
}

/* Returns the path from the folder of the scene's file, as far as it is below it: manifests do not depend on where. */
static const char *relative_path(const char *path, const char *scene_file)
{
    const char *slash = strrchr(scene_file, '/');
    size_t length = slash ? (size_t)(slash - scene_file) + 1 : 0;
    const char *rest = strncmp(path, scene_file, length) == 0 ? path + length : path;
    while (length > 0 && *rest == '/')
        rest++;
    return *rest ? rest : path;
}

static void write_files(struct json *json, const struct import *import)
{
    json_array(json, "files");
    for (uint32_t i = 0; i < import->file_count; i++) {
        uint64_t size, sum;
        char text[17];
        json_object(json, NULL);
        json_text(json, "path", relative_path(import->files[i], import->files[0]));
        if (sum_file(import->files[i], &size, &sum)) {
            snprintf(text, sizeof text, "%016llx", (unsigned long long)sum);
            json_integer(json, "bytes", size);
            json_text(json, "xxh64", text);
        }
        json_object_end(json);
    }
    json_array_end(json);
}

void manifest_write_round_counts(struct json *json, const struct import *import)
{
    if (import->point_count)
        json_integer(json, "points", import->point_count);
    if (import->line_count)
        json_integer(json, "lines", import->line_count);
}

void manifest_write_scene(struct json *json, const struct assembly *assembly, const struct file_names *names)
{
    const struct import *import = assembly->import;
    const struct bvhd_result *top = &assembly->items[import->bottom_count];
    json_object(json, NULL);
    json_text(json, "scene", import->name);
    json_text(json, "file", names->files[import->bottom_count]);
    json_integer(json, "meshes", import->mesh_count);
    json_integer(json, "triangles", import->triangle_count);
    manifest_write_round_counts(json, import);
    json_integer(json, "instances", import->instance_count);
    json_integer(json, "skipped_instances", import->skipped_instances);
    manifest_write_bounds(json, top->bounds);
    write_files(json, import);
    json_object_end(json);
}

static void write_node(struct json *json, const struct import *import, uint32_t index, const char *file)
{
    const struct import_instance *instance = &import->instances[index];
    json_object(json, NULL);
    json->lines = false; /* one line for each node */
    json_text(json, "name", import_names_get(&import->node_names, instance->name));
    json_integer(json, "custom_index", index & 0xffffff);
    json_text(json, "file", file);
    json_floats(json, "transform", instance->transform, 12);
    if (instance->motion)
        json_text(json, "motion", import->motions[instance->motion - 1].kind == ORACLE_SRT ? "srt" : "matrix");
    if (instance->skipped)
        json_bool(json, "skipped", true);
    json_object_end(json);
    json->lines = true;
}

void manifest_write_nodes(struct json *json, const struct import *import, const struct file_names *names)
{
    json_array(json, "nodes");
    for (uint32_t i = 0; i < import->instance_count; i++)
        write_node(json, import, i, names->files[import->instances[i].bottom]);
    json_array_end(json);
}
