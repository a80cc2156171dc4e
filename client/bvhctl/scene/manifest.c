/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/manifest_internal.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/scene/activity.h"
#include "client/bvhctl/scene/import_round.h"

static void write_colour(struct json *json, const float colour[3])
{
    json_array(json, "color");
    for (int i = 0; i < 3; i++)
        json_number(json, NULL, round((double)colour[i] * 1e4) / 1e4);
    json_array_end(json);
}

void manifest_write_left_out_options(struct json *json, const struct import_counts *counts)
{
    bool any = false;
    for (int i = 0; i < IMPORT_COUNT_KINDS; i++) {
        if (!import_count_kinds[i].option || !import_counts_get(counts, i))
            continue;
        if (!any)
            json_array(json, "left_out_options");
        any = true;
        json_text(json, NULL, import_count_kinds[i].option);
    }
    if (any)
        json_array_end(json);
}

void manifest_write_left_out(struct json *json, const struct import_counts *counts)
{
    if (!import_counts_any(counts))
        return;
    json_object(json, "left_out");
    for (int i = 0; i < IMPORT_COUNT_KINDS; i++)
        if (import_counts_get(counts, i))
            json_integer(json, import_count_kinds[i].name, import_counts_get(counts, i));
    json_object_end(json);
}

/* Writes what of a mesh cannot be hit, and what of it was left out: the kinds of which there is some. */
static void write_losses(struct json *json, const struct import_mesh *mesh, bool is_active)
{
    struct activity activity = is_active ? (struct activity){0} : activity_of(mesh);
    if (activity.inactive)
        json_integer(json, "inactive", activity.inactive);
    if (activity.degenerate)
        json_integer(json, "degenerate", activity.degenerate);
    if (activity.infinite)
        json_integer(json, "infinite", activity.infinite);
    manifest_write_left_out(json, &mesh->counts);
}

static void write_geometries(struct json *json, const struct import *import, uint32_t index,
                             const struct bvhd_result *item)
{
    bool is_active = !(item->inactive || item->degenerate || item->skipped);
    json_array(json, "geometries");
    const struct import_bottom *bottom = index < import->bottom_count ? &import->bottoms[index] : NULL;
    for (uint32_t i = 0; bottom && i < bottom->mesh_count; i++) {
        const struct import_mesh *mesh = &import->meshes[bottom->meshes[i]];
        json_object(json, NULL);
        json_text(json, "name", mesh->name);
        json_text(json, "material", mesh->material);
        json_integer(json, "primitives", mesh->primitive_count);
        if (mesh->shape != IMPORT_TRIANGLES)
            json_text(json, "shape", import_shape_kinds[mesh->shape].name);
        if (mesh->end_positions)
            json_bool(json, "moves", true);
        if (mesh->has_colour)
            write_colour(json, mesh->colour);
        write_losses(json, mesh, is_active);
        json_object_end(json);
    }
    json_array_end(json);
}

static void write_handles(struct json *json, const struct assembly *assembly, const struct file_names *names)
{
    json_array(json, "handles");
    for (uint32_t i = 0; i < assembly->handle_count; i++)
        json_text(json, NULL, names->files[names->first[assembly->handles[i]]]);
    json_array_end(json);
}

/* Returns for each mesh whether it is a geometry of a bottom level. NULL: there is no memory. */
static bool *find_geometries(const struct import *import)
{
    bool *is_geometry = memory_array(import->memory, import->mesh_count, sizeof *is_geometry);
    if (is_geometry)
        memset(is_geometry, 0, import->mesh_count * sizeof *is_geometry);
    for (uint32_t i = 0; i < import->bottom_count && is_geometry; i++)
        for (uint32_t k = 0; k < import->bottoms[i].mesh_count; k++)
            is_geometry[import->bottoms[i].meshes[k]] = true;
    return is_geometry;
}

/* Writes the meshes that are no geometries, because no node with triangles has them, if something is left out. */
static void write_meshes_left_out(struct json *json, const struct import *import)
{
    bool any = false, *is_geometry = find_geometries(import);
    json->failed |= !is_geometry;
    for (uint32_t i = 0; is_geometry && i < import->mesh_count; i++) {
        const struct import_mesh *mesh = &import->meshes[i];
        if (is_geometry[i] || !import_counts_any(&mesh->counts))
            continue;
        if (!any)
            json_array(json, "meshes_left_out");
        any = true;
        json_object(json, NULL);
        json_text(json, "name", mesh->name);
        manifest_write_left_out(json, &mesh->counts);
        json_object_end(json);
    }
    if (any)
        json_array_end(json);
    memory_free(import->memory, is_geometry);
}

/* Writes at which moment of which animation the file was read. */
static void write_moment(struct json *json, const struct import *import)
{
    json_object(json, "source_moment");
    json_number(json, "time", import->time);
    if (import->is_shutter)
        json_number(json, "end", import->end_time);
    if (import->has_animation)
        json_integer(json, "animation", import->animation);
    else
        json_null(json, "animation");
    json_object_end(json);
}

static void write_deviation(struct json *json, const char *key, const struct import_deviation *deviation,
                            const char *subject, const char *name)
{
    json_object(json, key);
    json_number(json, "distance", deviation->distance);
    if (deviation->distance > 0) {
        json_number(json, "time", deviation->time);
        json_text(json, subject, name);
    }
    json_object_end(json);
}

/* Writes what moves in a shutter interval, and how far it is from the animation. */
static void write_motion(struct json *json, const struct import *import)
{
    const struct import_deviation *of_instances = &import->instance_deviation, *of_vertices = &import->vertex_deviation;
    uint32_t turning = import_turning_count(import);
    json_object(json, "motion");
    json_integer(json, "srt_instances", turning);
    json_integer(json, "matrix_instances", import->motion_count - turning);
    json_integer(json, "meshes", import->moving_meshes);
    write_deviation(json, "instance_deviation", of_instances, "node",
                    of_instances->distance > 0 ? import_names_get(&import->node_names, of_instances->which) : "");
    write_deviation(json, "vertex_deviation", of_vertices, "mesh",
                    of_vertices->distance > 0 ? import->meshes[of_vertices->which].name : "");
    json_object_end(json);
}

/* Writes the radii with which points and lines were read. */
static void write_radii(struct json *json, const struct import *import)
{
    json_object(json, "source_radii");
    if (import->point_radius > 0)
        json_float(json, "points", import->point_radius);
    if (import->line_radius > 0)
        json_float(json, "lines", import->line_radius);
    json_object_end(json);
}

/* Writes which scene of the file was chosen, and numbers of what is left out, as far as there is anything to say. */
static void write_source(struct json *json, const struct import *import)
{
    if (import->has_source) {
        json_object(json, "source_scene");
        json_integer(json, "number", import->source_number);
        json_text(json, "name", import->source_name);
        json_object_end(json);
    }
    if (import->has_moment)
        write_moment(json, import);
    if (import->is_shutter)
        write_motion(json, import);
    if (import->point_radius > 0 || import->line_radius > 0)
        write_radii(json, import);
    manifest_write_left_out(json, &import->counts);
    manifest_write_left_out_options(json, &import->counts);
    write_meshes_left_out(json, import);
}

const char *manifest_method_name(enum assembly_method method)
{
    static const char *const names[] = {[ASSEMBLY_BUILT] = "built",
                                        [ASSEMBLY_UPDATED] = "updated",
                                        [ASSEMBLY_LOST] = "lost",
                                        [ASSEMBLY_OTHER_ACTIVE] = "other_active",
                                        [ASSEMBLY_DECAYED] = "decayed"};
    return names[method];
}

/* Writes what a reader has to know about an update: how much the tree has decayed, and after how many of them. */
static void write_decay(struct json *json, const struct bvhd_result *item)
{
    json_number(json, "decay", item->decay);
    json_integer(json, "refits", item->refits);
}

static void write_outcome(struct json *json, const struct assembly_outcome *outcome)
{
    json_text(json, "update", manifest_method_name(outcome->method));
    if (outcome->method == ASSEMBLY_DECAYED)
        json_number(json, "refused_decay", outcome->decay);
}

static void write_times(struct json *json, const struct bvhd_result *item)
{
    json_bool(json, "cached", item->origin == BVHD_ORIGIN_MEMORY || item->origin == BVHD_ORIGIN_DISK);
    json_bool(json, "coalesced", item->origin == BVHD_ORIGIN_COALESCED);
    json_number(json, "prepare_ms", item->prepare_ms);
    json_number(json, "build_ms", item->build_ms);
    json_integer(json, "peak_bytes", item->peak_bytes);
}

const char *manifest_structure_name(const struct import *import, uint32_t index)
{
    bool named = index < import->bottom_count && *import->bottoms[index].name;
    return named ? import->bottoms[index].name : import->name;
}

static const char *target_name(const struct bvhd_result *item)
{
    const char *name = bvhd_target_name(item->target);
    return name ? name : "";
}

const char *manifest_quality_name(enum bvhd_quality quality)
{
    static const char *const names[] = {
        [BVHD_QUALITY_FAST] = "fast", [BVHD_QUALITY_BALANCED] = "balanced", [BVHD_QUALITY_HIGH] = "high"};
    const char *name = (size_t)quality < sizeof names / sizeof names[0] ? names[quality] : NULL;
    return name ? name : "";
}

void manifest_write_structure(struct json *json, const struct assembly *assembly, uint32_t index,
                              const struct file_names *names, bool times)
{
    const struct import *import = assembly->import;
    const struct bvhd_result *item = &assembly->items[index];
    struct key key;
    char key_text[KEY_TEXT_SIZE];
    memcpy(&key, &item->key, sizeof key);
    key_to_text(&key, key_text);
    bool is_top = index == import->bottom_count;
    json_object(json, NULL);
    json_text(json, "file", names->files[index]);
    json_text(json, "type", is_top ? "tlas" : "blas");
    json_text(json, "scene", import->name);
    json_text(json, "name", manifest_structure_name(import, index));
    write_geometries(json, import, index, item);
    json_integer(json, "primitives", item->primitives);
    json_integer(json, "triangles", item->triangles);
    json_integer(json, "instances", item->instances);
    json_integer(json, "inactive", item->inactive);
    json_integer(json, "degenerate", item->degenerate);
    json_integer(json, "skipped", item->skipped);
    json_integer(json, "bytes", item->size);
    json_text(json, "key", key_text);
    manifest_write_bounds(json, item->bounds);
    if (item->refits)
        write_decay(json, item);
    if (times && assembly->is_update)
        write_outcome(json, &assembly->outcomes[index]);
    if (times)
        write_times(json, item);
    json_integer(json, "depth", item->depth);
    json_number(json, "sah", item->sah);
    json_integer(json, "refs", item->refs);
    json_text(json, "method", item->method ? item->method : "");
    json_text(json, "quality", manifest_quality_name(item->quality));
    json_text(json, "target", target_name(item));
    if (is_top) {
        write_source(json, import);
        write_handles(json, assembly, names);
        if (!times)
            manifest_write_nodes(json, import, names);
    }
    json_object_end(json);
}
