/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_mesh.h"

#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/gltf_accessor.h"
#include "client/bvhctl/scene/gltf_material.h"
#include "client/bvhctl/scene/gltf_round.h"
#include "client/bvhctl/scene/import_round.h"

enum bvhd_status gltf_mesh_primitives(const struct gltf_file *file, uint32_t index, uint32_t *ret_count)
{
    struct gltf_value mesh = gltf_item(file, GLTF_MESHES, index), primitives;
    enum bvhd_status status = gltf_array(file, &mesh, "primitives", &primitives);
    *ret_count = status || !primitives.json ? 0 : (uint32_t)cJSON_GetArraySize(primitives.json);
    return status;
}

/* Returns how many triangles there are, and counts corners that are left over. */
static uint32_t count_triangles(struct import_counts *counts, enum gltf_mode mode, uint32_t corners)
{
    if (mode == GLTF_TRIANGLE_LIST) {
        counts->incomplete += corners % 3 != 0;
        return corners / 3;
    }
    counts->incomplete += corners == 1 || corners == 2;
    return corners < 3 ? 0 : corners - 2;
}

/*
 * Writes the corners of triangle `i` of a strip or fan. The first corner is not always the one that the specification
 * names, but the order around the triangle is; bvhctl has always numbered them so, and keys depend on it.
 */
static void place_corners(enum gltf_mode mode, const uint32_t *corners, uint32_t i, uint32_t *ret_triangle)
{
    uint32_t first = mode == GLTF_TRIANGLE_FAN ? 0 : i % 2 ? i + 1 : i;
    uint32_t second = mode == GLTF_TRIANGLE_FAN ? i + 1 : i % 2 ? i : i + 1;
    ret_triangle[0] = corners ? corners[first] : first;
    ret_triangle[1] = corners ? corners[second] : second;
    ret_triangle[2] = corners ? corners[i + 2] : i + 2;
}

/* The state of the decoding of one primitive. */
struct primitive {
    struct gltf_file *file;
    struct gltf_value value;
    enum gltf_mode mode;
    bool is_indexed;
    struct gltf_accessor positions, indices;
    uint32_t corners;
    const struct import_wish *wish;
    struct import_mesh *mesh;
};

static enum bvhd_status check_indices(const struct primitive *primitive, const uint32_t *indices, uint32_t count)
{
    uint32_t vertices = primitive->mesh->vertex_count, highest = 0;
    for (uint32_t i = 0; i < count; i++)
        highest = indices[i] > highest ? indices[i] : highest;
    for (uint32_t i = 0; count && highest >= vertices && i < count; i++)
        if (indices[i] >= vertices) {
            struct gltf_value place = gltf_item(primitive->file, GLTF_ACCESSORS, primitive->indices.index);
            return gltf_refuse(primitive->file, BVHD_INVALID, &place,
                               "index %u at %u is beyond the %u vertices of accessors[%u]", indices[i], i, vertices,
                               primitive->positions.index);
        }
    return BVHD_OK;
}

/* Decodes the indices to `ret_corners`, which has room for them, and checks them. */
static enum bvhd_status read_corners(const struct primitive *primitive, uint32_t *ret_corners)
{
    enum bvhd_status status = gltf_accessor_indices(primitive->file, &primitive->indices, ret_corners);
    return status ? status : check_indices(primitive, ret_corners, primitive->corners);
}

static enum bvhd_status read_list(const struct primitive *primitive)
{
    uint32_t *indices = primitive->mesh->indices;
    if (primitive->is_indexed)
        return read_corners(primitive, indices);
    for (uint32_t i = 0; i < 3 * primitive->mesh->primitive_count; i++)
        indices[i] = i;
    return BVHD_OK;
}

/* Decodes the indices to an array of their own; *ret_corners stays NULL if there are none. */
static enum bvhd_status read_own_corners(const struct primitive *primitive, uint32_t **ret_corners)
{
    struct memory *memory = primitive->file->memory;
    if (!primitive->is_indexed)
        return BVHD_OK;
    uint32_t *corners = memory_array(memory, (uint64_t)primitive->corners + 1, sizeof *corners);
    enum bvhd_status status = corners ? read_corners(primitive, corners) : gltf_no_memory(primitive->file);
    if (status)
        memory_free(memory, corners);
    else
        *ret_corners = corners;
    return status;
}

static enum bvhd_status read_strip(const struct primitive *primitive)
{
    uint32_t *corners = NULL;
    enum bvhd_status status = read_own_corners(primitive, &corners);
    if (status)
        return status;
    for (uint32_t i = 0; i < primitive->mesh->primitive_count; i++)
        place_corners(primitive->mode, corners, i, primitive->mesh->indices + 3 * (size_t)i);
    memory_free(primitive->file->memory, corners);
    return BVHD_OK;
}

static enum bvhd_status read_triangles(const struct primitive *primitive)
{
    struct import_mesh *mesh = primitive->mesh;
    struct gltf_file *file = primitive->file;
    mesh->primitive_count = count_triangles(&mesh->counts, primitive->mode, primitive->corners);
    /* There is room for the corners that are left over, because indices are decoded before they are dropped. */
    mesh->indices = memory_array(file->memory, (uint64_t)mesh->primitive_count + 1, 3 * sizeof *mesh->indices);
    if (!mesh->indices)
        return gltf_no_memory(file);
    return primitive->mode == GLTF_TRIANGLE_LIST ? read_list(primitive) : read_strip(primitive);
}

static enum bvhd_status read_positions(const struct primitive *primitive)
{
    struct gltf_file *file = primitive->file;
    struct import_mesh *mesh = primitive->mesh;
    const struct gltf_accessor *accessor = &primitive->positions;
    struct gltf_value place = gltf_item(file, GLTF_ACCESSORS, accessor->index);
    if (accessor->components != 3 || accessor->component == GLTF_UINT32)
        return gltf_refuse(file, BVHD_INVALID, &place, "positions are VEC3 of floats, or of 8 or 16 bit integers");
    mesh->vertex_count = accessor->elements.count;
    mesh->positions = memory_array(file->memory, (uint64_t)mesh->vertex_count + 1, 3 * sizeof *mesh->positions);
    if (!mesh->positions)
        return gltf_no_memory(file);
    enum bvhd_status status = gltf_accessor_floats(file, accessor, mesh->positions);
    if (!status)
        mesh->counts.bounds += !gltf_accessor_bounds_agree(file, accessor, mesh->positions);
    return status;
}

/* Reads points or lines, after the positions. */
static enum bvhd_status read_round(const struct primitive *primitive, enum import_shape shape)
{
    struct gltf_file *file = primitive->file;
    struct import_mesh *mesh = primitive->mesh;
    uint32_t *corners = NULL, count = gltf_round_count(primitive->mode, primitive->corners);
    mesh->shape = shape;
    mesh->counts.incomplete += shape == IMPORT_LINES &&
                               (primitive->mode == GLTF_LINES ? primitive->corners % 2 != 0 : primitive->corners == 1);
    mesh->indices = memory_array(file->memory, (uint64_t)count + 1, 2 * sizeof *mesh->indices);
    if (!mesh->indices)
        return gltf_no_memory(file);
    enum bvhd_status status = read_own_corners(primitive, &corners);
    if (!status) {
        gltf_round_place(primitive->mode, corners, primitive->corners, mesh->indices);
        mesh->primitive_count = count;
        status = gltf_round_read_radii(file, &primitive->value, import_round_radius(primitive->wish, shape), mesh);
    }
    memory_free(file->memory, corners);
    return status;
}

/* Counts the points or lines of a primitive that is left out. */
static void count_round(const struct primitive *primitive, enum import_shape shape)
{
    struct import_counts *counts = &primitive->mesh->counts;
    *(shape == IMPORT_POINTS ? &counts->points : &counts->lines) +=
        gltf_round_count(primitive->mode, primitive->corners);
}

/* Makes the arrays of a mesh without triangles, which are not NULL. */
static enum bvhd_status leave_out(const struct primitive *primitive)
{
    struct import_mesh *mesh = primitive->mesh;
    if (!mesh->positions)
        mesh->positions = memory_array(primitive->file->memory, 1, 3 * sizeof *mesh->positions);
    mesh->indices = memory_array(primitive->file->memory, 1, 3 * sizeof *mesh->indices);
    return mesh->positions && mesh->indices ? BVHD_OK : gltf_no_memory(primitive->file);
}

/* Opens the accessors of a primitive. *ret_has_positions is false if it has no positions. */
static enum bvhd_status open_accessors(struct primitive *primitive, bool *ret_has_positions)
{
    struct gltf_file *file = primitive->file;
    struct gltf_value attributes = gltf_member(&primitive->value, "attributes");
    uint32_t index = 0;
    enum bvhd_status status = gltf_reference(file, &attributes, "POSITION", GLTF_ACCESSORS, &index, ret_has_positions);
    if (!status && *ret_has_positions)
        status = gltf_accessor_open(file, index, &primitive->positions);
    if (!status)
        status = gltf_reference(file, &primitive->value, "indices", GLTF_ACCESSORS, &index, &primitive->is_indexed);
    if (!status && primitive->is_indexed)
        status = gltf_accessor_open(file, index, &primitive->indices);
    primitive->corners =
        primitive->is_indexed ? primitive->indices.elements.count : primitive->positions.elements.count;
    return status;
}

static enum bvhd_status read_geometry(struct primitive *primitive)
{
    struct gltf_file *file = primitive->file;
    uint64_t mode = 0;
    bool has_positions = false;
    enum bvhd_status status =
        gltf_integer(file, &primitive->value, "mode",
                     (struct gltf_range){GLTF_POINTS, GLTF_TRIANGLE_FAN, false, GLTF_TRIANGLE_LIST}, &mode);
    primitive->mode = (enum gltf_mode)mode;
    if (!status)
        status = open_accessors(primitive, &has_positions);
    if (status)
        return status;
    if (!has_positions) {
        primitive->mesh->counts.positionless++;
        return leave_out(primitive);
    }
    enum import_shape shape = primitive->mode == GLTF_POINTS         ? IMPORT_POINTS
                              : primitive->mode < GLTF_TRIANGLE_LIST ? IMPORT_LINES
                                                                     : IMPORT_TRIANGLES;
    if (shape != IMPORT_TRIANGLES && !(import_round_radius(primitive->wish, shape) > 0)) {
        count_round(primitive, shape);
        return leave_out(primitive);
    }
    status = read_positions(primitive);
    if (status)
        return status;
    return shape == IMPORT_TRIANGLES ? read_triangles(primitive) : read_round(primitive, shape);
}

/* Names the meshes of one with several primitives "NAME-0" and so on, and those of one without a name "meshes[3]". */
static char *make_name(const struct gltf_file *file, const struct gltf_value *mesh, uint32_t index, uint32_t primitive,
                       uint32_t count)
{
    const char *name = gltf_text(mesh, "name");
    char number[32] = "", unnamed[32];
    snprintf(unnamed, sizeof unnamed, "meshes[%u]", index);
    name = name && *name ? name : unnamed;
    if (count > 1)
        snprintf(number, sizeof number, "-%u", primitive);
    uint64_t size = strlen(name) + strlen(number) + 1;
    char *text = memory_alloc(file->memory, size);
    if (text)
        snprintf(text, size, "%s%s", name, number);
    return text;
}

static enum bvhd_status read_primitive(struct gltf_file *file, const struct gltf_value *value,
                                       const struct import_wish *wish, struct import_mesh *mesh)
{
    struct primitive primitive = {.file = file, .value = *value, .wish = wish, .mesh = mesh};
    struct gltf_value targets;
    if (!cJSON_IsObject(value->json))
        return gltf_refuse(file, BVHD_INVALID, value, "not an object");
    enum bvhd_status status = gltf_material_read(file, value, mesh);
    if (!status)
        status = gltf_array(file, value, "targets", &targets);
    if (!status)
        mesh->counts.morphs += (uint64_t)cJSON_GetArraySize(targets.json);
    return status ? status : read_geometry(&primitive);
}

enum bvhd_status gltf_mesh_read(struct gltf_file *file, uint32_t index, const struct import_wish *wish,
                                struct import_mesh *ret_meshes)
{
    struct gltf_value mesh = gltf_item(file, GLTF_MESHES, index), primitives;
    uint32_t count, i = 0;
    enum bvhd_status status = gltf_mesh_primitives(file, index, &count);
    if (!status)
        status = gltf_array(file, &mesh, "primitives", &primitives);
    if (status || !count)
        return status;
    for (const cJSON *item = primitives.json->child; item && !status; item = item->next, i++) {
        struct gltf_value value = gltf_element(&primitives, item, i);
        ret_meshes[i].name = make_name(file, &mesh, index, i, count);
        status = ret_meshes[i].name ? read_primitive(file, &value, wish, &ret_meshes[i]) : gltf_no_memory(file);
    }
    return status;
}
