/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/ply_faces.h"

#include <assert.h>
#include <string.h>

static const uint32_t restart = UINT32_MAX; /* -1 in a strip */

void ply_faces_init(struct ply_faces *faces, struct ply_source *source, const char *path, struct memory *memory,
                    struct import_mesh *mesh, struct bvhd_error *error)
{
    *faces = (struct ply_faces){.source = source, .path = path, .mesh = mesh, .memory = memory, .error = error};
    polygon_cutter_init(&faces->cutter, memory);
}

void ply_faces_finish(struct ply_faces *faces)
{
    memory_free(faces->memory, faces->corners);
    faces->corners = NULL;
    for (int shape = 0; shape < IMPORT_SHAPES; shape++) {
        memory_free(faces->memory, faces->rounds[shape].indices);
        faces->rounds[shape] = (struct ply_round){0};
    }
    polygon_cutter_finish(&faces->cutter);
}

const struct ply_property *ply_faces_list(const struct ply_element *element, const char *path, struct bvhd_error *error)
{
    int found = ply_element_find(element, "vertex_indices");
    if (found < 0)
        found = ply_element_find(element, "vertex_index");
    if (found >= 0 && element->properties[found].is_list)
        return &element->properties[found];
    bvhd_error_set(error, BVHD_UNSUPPORTED, path, "element '%s' has no list 'vertex_indices' or 'vertex_index'",
                   element->name);
    return NULL;
}

enum bvhd_status ply_row_failure(const struct ply_source *source, const struct ply_element *element, uint64_t row,
                                 const char *path, struct bvhd_error *error)
{
    unsigned long long number = (unsigned long long)row, line = (unsigned long long)source->line;
    if (source->is_bad_value)
        return bvhd_error_set(error, BVHD_INVALID, path, "%s %llu, in line %llu, has a value that is not a number",
                              element->name, number, line);
    return bvhd_error_set(error, BVHD_INVALID, path, "the file is cut off in %s %llu of %llu", element->name, number,
                          (unsigned long long)element->count);
}

enum bvhd_status ply_list_length(struct ply_source *source, const struct ply_element *element,
                                 const struct ply_property *property, uint64_t row, const char *path,
                                 uint64_t *ret_length, struct bvhd_error *error)
{
    struct ply_value value;
    if (!ply_source_value(source, property->count_type, &value))
        return ply_row_failure(source, element, row, path, error);
    uint64_t left = ply_source_left(source);
    uint64_t most = source->format == PLY_ASCII ? left / 2 + 1 : left / ply_type_size(property->type);
    if (!(value.number >= 0 && value.number <= (double)most))
        return bvhd_error_set(error, BVHD_INVALID, path,
                              "%s %llu has a list '%s' of %.0f values, but the file has at most %llu", element->name,
                              (unsigned long long)row, property->name, value.number, (unsigned long long)most);
    *ret_length = (uint64_t)value.number;
    return BVHD_OK;
}

static enum bvhd_status no_memory(const struct ply_faces *faces)
{
    return bvhd_error_no_memory(faces->error, faces->path, "no memory for the scene, or more than --memory allows");
}

/* Makes room for `count` more triangles. */
static enum bvhd_status reserve_triangles(struct ply_faces *faces, uint64_t count)
{
    uint64_t wanted = faces->mesh->primitive_count + count;
    if (wanted > UINT32_MAX / 3)
        return bvhd_error_set(faces->error, BVHD_UNSUPPORTED, faces->path, "it has more than %u triangles",
                              UINT32_MAX / 3);
    if (wanted <= faces->capacity)
        return BVHD_OK;
    if (wanted < faces->capacity + faces->capacity / 2)
        wanted = faces->capacity + faces->capacity / 2;
    uint32_t *indices = memory_resize(faces->memory, faces->mesh->indices, wanted * 3 * sizeof *indices);
    if (!indices)
        return no_memory(faces);
    faces->mesh->indices = indices;
    faces->capacity = wanted;
    return BVHD_OK;
}

static bool reserve_corners(struct ply_faces *faces, uint64_t count)
{
    if (count <= faces->corner_capacity)
        return true;
    uint64_t capacity = count + count / 2 + 16;
    memory_free(faces->memory, faces->corners);
    faces->corners = memory_array(faces->memory, capacity, sizeof *faces->corners);
    faces->corner_capacity = faces->corners ? capacity : 0;
    return faces->corners != NULL;
}

/* Reads the vertices of a row into faces->corners. */
static enum bvhd_status read_corners(struct ply_faces *faces, const struct ply_element *element,
                                     const struct ply_property *list, uint64_t row, bool is_strip, uint64_t *ret_count)
{
    enum bvhd_status status = ply_list_length(faces->source, element, list, row, faces->path, ret_count, faces->error);
    if (status)
        return status;
    if (!reserve_corners(faces, *ret_count))
        return no_memory(faces);
    for (uint64_t i = 0; i < *ret_count; i++) {
        struct ply_value value;
        if (!ply_source_value(faces->source, list->type, &value))
            return ply_row_failure(faces->source, element, row, faces->path, faces->error);
        bool is_restart = is_strip && (value.number == -1 || value.number == (double)UINT32_MAX);
        bool is_vertex = value.number >= 0 && value.number < (double)faces->mesh->vertex_count &&
                         value.number == (double)(uint32_t)value.number;
        if (!is_restart && !is_vertex)
            return bvhd_error_set(faces->error, BVHD_INVALID, faces->path,
                                  "corner %llu of %s %llu is vertex %.15g, but there are only %u",
                                  (unsigned long long)i, element->name, (unsigned long long)row, value.number,
                                  faces->mesh->vertex_count);
        faces->corners[i] = is_restart ? restart : (uint32_t)value.number;
    }
    return BVHD_OK;
}

/* Turns (a, b, c) into (c, a, b). */
static void rotate(uint32_t triangle[3])
{
    uint32_t last = triangle[2];
    triangle[2] = triangle[1];
    triangle[1] = triangle[0];
    triangle[0] = last;
}

/*
 * Rotates triangles as assimp 5.2 does in meshes with polygons, so that the keys of such files stay the same: triangles
 * that follow each other begin with the same corner only if they are halves of one quad. The other half of a quad is
 * rotated backward, because both begin with the corner across then.
 */
static void rotate_triangles(struct ply_faces *faces, uint32_t first, bool is_quad)
{
    for (uint32_t i = first; i < faces->mesh->primitive_count; i += 1 + is_quad) {
        uint32_t *triangle = faces->mesh->indices + 3 * (size_t)i;
        if (triangle[0] == faces->last_corner) {
            rotate(triangle);
            for (int turns = 0; is_quad && turns < 2; turns++)
                rotate(triangle + 3);
        }
        faces->last_corner = triangle[0];
    }
}

/* Rotates the triangles of a face of `count` corners, and those before it if it is the first that is no triangle. */
static void rotate_face(struct ply_faces *faces, uint32_t first, uint64_t count)
{
    if (!faces->has_polygons && (count == 0 || count > 3)) { /* to assimp a face without corners is a polygon, too */
        uint32_t triangle_count = faces->mesh->primitive_count;
        faces->has_polygons = true;
        faces->last_corner = UINT32_MAX;
        faces->mesh->primitive_count = first;
        rotate_triangles(faces, faces->first_face, false);
        faces->mesh->primitive_count = triangle_count;
    }
    if (faces->has_polygons)
        rotate_triangles(faces, first, count == 4);
}

/* Adds a face of one or two corners to the points or lines, or counts it. One without corners is ignored. */
static enum bvhd_status add_round(struct ply_faces *faces, const uint32_t *corners, uint64_t count)
{
    struct ply_round *round = &faces->rounds[count == 1 ? IMPORT_POINTS : IMPORT_LINES];
    if (count == 0 || !round->is_wanted) {
        faces->mesh->counts.points += count == 1;
        faces->mesh->counts.lines += count == 2;
        return BVHD_OK;
    }
    if (round->count + count > round->capacity) {
        uint64_t capacity = 2 * round->capacity + 64;
        uint32_t *grown = capacity / 2 < UINT32_MAX ? memory_resize(faces->memory, round->indices, capacity * 4) : NULL;
        if (!grown)
            return no_memory(faces);
        round->indices = grown;
        round->capacity = capacity;
    }
    for (uint64_t i = 0; i < count; i++)
        round->indices[round->count++] = corners[i];
    return BVHD_OK;
}

/* Makes triangles of the polygon in faces->corners. */
static enum bvhd_status add_polygon(struct ply_faces *faces, uint64_t count)
{
    struct import_mesh *mesh = faces->mesh;
    mesh->counts.empty_faces += count == 0;
    if (count < 3) {
        rotate_face(faces, mesh->primitive_count, count);
        return add_round(faces, faces->corners, count);
    }
    enum bvhd_status status = reserve_triangles(faces, count - 2);
    if (status)
        return status;
    bool is_fanned;
    if (!polygon_cut(&faces->cutter, mesh->positions, faces->corners, (uint32_t)count,
                     mesh->indices + 3 * (size_t)mesh->primitive_count, &is_fanned))
        return no_memory(faces);
    mesh->primitive_count += (uint32_t)count - 2;
    mesh->counts.fanned += is_fanned;
    rotate_face(faces, mesh->primitive_count - (uint32_t)(count - 2), count);
    return BVHD_OK;
}

/*
 * Makes triangles of `count` vertices of a strip. Every second one has its first two corners swapped, to face as the
 * others.
 */
static enum bvhd_status add_strip(struct ply_faces *faces, const uint32_t *corners, uint64_t count)
{
    struct import_mesh *mesh = faces->mesh;
    if (count < 3)
        return add_round(faces, corners, count);
    for (uint64_t i = 2; i < count; i++) {
        uint32_t *out = mesh->indices + 3 * (size_t)mesh->primitive_count++;
        out[0] = corners[i % 2 ? i - 1 : i - 2];
        out[1] = corners[i % 2 ? i - 2 : i - 1];
        out[2] = corners[i];
    }
    return BVHD_OK;
}

static enum bvhd_status add_strips(struct ply_faces *faces, uint64_t count)
{
    enum bvhd_status status = reserve_triangles(faces, count);
    uint64_t first = 0;
    faces->mesh->counts.empty_faces += count == 0;
    for (uint64_t i = 0; i <= count && !status; i++)
        if (i == count || faces->corners[i] == restart) {
            if (i > first)
                status = add_strip(faces, faces->corners + first, i - first);
            first = i + 1;
        }
    return status;
}

static enum bvhd_status read_row(struct ply_faces *faces, const struct ply_element *element,
                                 const struct ply_property *list, uint64_t row, bool is_strip)
{
    uint64_t count = 0, length = 1;
    for (uint32_t i = 0; i < element->property_count; i++) {
        const struct ply_property *property = &element->properties[i];
        enum bvhd_status status = BVHD_OK;
        if (property == list)
            status = read_corners(faces, element, list, row, is_strip, &count);
        else if (property->is_list)
            status = ply_list_length(faces->source, element, property, row, faces->path, &length, faces->error);
        if (status)
            return status;
        if (property != list && !ply_source_skip_values(faces->source, property->type, property->is_list ? length : 1))
            return ply_row_failure(faces->source, element, row, faces->path, faces->error);
    }
    return is_strip ? add_strips(faces, count) : add_polygon(faces, count);
}

enum bvhd_status ply_faces_read(struct ply_faces *faces, const struct ply_element *element)
{
    bool is_strip = !strcmp(element->name, "tristrips");
    const struct ply_property *list = ply_faces_list(element, faces->path, faces->error);
    assert(list); /* elements without one were refused before anything was read */
    faces->first_face = faces->mesh->primitive_count;
    enum bvhd_status status = reserve_triangles(faces, is_strip ? 0 : element->count);
    for (uint64_t row = 0; row < element->count && !status; row++) {
        status = read_row(faces, element, list, row, is_strip);
        if (!status && !ply_source_end_row(faces->source))
            status = bvhd_error_set(faces->error, BVHD_INVALID, faces->path,
                                    "%s %llu, in line %llu, has more values than the header says", element->name,
                                    (unsigned long long)row, (unsigned long long)faces->source->line);
    }
    return status;
}
