/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/ply.h"

#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/import_round.h"
#include "client/bvhctl/scene/ply_faces.h"

enum { RADIUS = 3, VALUES };

/* A file while it is read. It is too large for the stack of a thread. */
struct ply_file {
    const char *path;
    struct bvhd_error *error;
    struct memory *memory;
    struct import *import;
    struct import_mesh *mesh; /* the only one */
    const struct ply_element *vertex; /* NULL: there is none */
    struct ply_source source;
    struct ply_header header;
    const struct import_wish *wish;
    int wanted[VALUES]; /* which properties of the vertices are x, y, z and the radius; -1: the file has none */
};

static FILE *open_regular(const char *path, uint64_t *ret_size)
{
    struct stat status;
    if (stat(path, &status) < 0 || !S_ISREG(status.st_mode))
        return NULL;
    *ret_size = (uint64_t)status.st_size;
    return fopen(path, "rbe");
}

bool ply_is_file(const char *path)
{
    char magic[4] = "";
    uint64_t size;
    FILE *file = open_regular(path, &size);
    if (!file)
        return false;
    size_t length = fread(magic, 1, sizeof magic, file), name = strlen(path);
    fclose(file);
    bool has_magic = length == sizeof magic && !memcmp(magic, "ply", 3) && (magic[3] == '\n' || magic[3] == '\r');
    return has_magic || (name > 4 && !strcasecmp(path + name - 4, ".ply"));
}

static enum bvhd_status no_memory(const struct ply_file *file)
{
    return bvhd_error_no_memory(file->error, file->path, "no memory for the scene, or more than --memory allows");
}

static bool is_faces(const struct ply_element *element)
{
    return !strcmp(element->name, "face") || !strcmp(element->name, "tristrips");
}

/* Compares the number of rows with what is left of the file, before memory is allocated for them. */
static enum bvhd_status check_count(const struct ply_file *file, const struct ply_element *element)
{
    uint64_t row = ply_element_row_size(element, file->source.format), left = ply_source_left(&file->source);
    uint64_t most = row ? (left + (file->source.format == PLY_ASCII)) / row : UINT64_MAX;
    if (element->count <= most)
        return BVHD_OK;
    return bvhd_error_set(file->error, BVHD_INVALID, file->path,
                          "the header says %llu rows of '%s', but the file has room for %llu at most",
                          (unsigned long long)element->count, element->name, (unsigned long long)most);
}

static enum bvhd_status too_many_values(const struct ply_file *file, const struct ply_element *element, uint64_t row)
{
    return bvhd_error_set(file->error, BVHD_INVALID, file->path,
                          "%s %llu, in line %llu, has more values than the header says", element->name,
                          (unsigned long long)row, (unsigned long long)file->source.line);
}

static bool wants_round(const struct ply_file *file)
{
    return file->wish->point_radius > 0 || file->wish->line_radius > 0;
}

/* Finds which property is which coordinate, and the radius if there may be points or lines. */
static enum bvhd_status find_values(struct ply_file *file)
{
    static const char *const names[VALUES] = {"x", "y", "z", "radius"};
    for (int i = 0; i < VALUES; i++) {
        int found = file->vertex ? ply_element_find(file->vertex, names[i]) : -1;
        bool is_value = found >= 0 && !file->vertex->properties[found].is_list;
        if (i != RADIUS && !is_value)
            return bvhd_error_set(file->error, BVHD_INVALID, file->path, "its vertices have no '%s'", names[i]);
        file->wanted[i] = is_value && (i != RADIUS || wants_round(file)) ? found : -1;
    }
    return BVHD_OK;
}

/* Stores the value of vertex `row` that has number `which` among those that are wanted. */
static void store(struct ply_file *file, uint64_t row, int which, float value)
{
    if (which == RADIUS)
        file->mesh->radii[row] = value;
    else
        file->mesh->positions[3 * row + (uint64_t)which] = value;
}

/* Reads vertices that all have the same size in the file. */
static enum bvhd_status read_fixed_vertices(struct ply_file *file)
{
    const struct ply_element *element = file->vertex;
    size_t offsets[VALUES] = {0}, size = 0;
    for (uint32_t i = 0; i < element->property_count; i++) {
        for (int k = 0; k < VALUES; k++)
            if (file->wanted[k] == (int)i)
                offsets[k] = size;
        size += ply_type_size(element->properties[i].type);
    }
    for (uint64_t row = 0; row < element->count; row++) {
        const unsigned char *bytes = ply_source_take(&file->source, size);
        if (!bytes)
            return ply_row_failure(&file->source, element, row, file->path, file->error);
        for (int k = 0; k < VALUES && file->wanted[k] >= 0; k++) {
            enum ply_type type = element->properties[file->wanted[k]].type;
            store(file, row, k, ply_value_of(bytes + offsets[k], type, file->source.format).single);
        }
    }
    return BVHD_OK;
}

/* Reads a row of any element. If they are vertices whose values are wanted, these are stored. */
static enum bvhd_status read_row(struct ply_file *file, const struct ply_element *element, uint64_t row, bool is_wanted)
{
    for (uint32_t i = 0; i < element->property_count; i++) {
        const struct ply_property *property = &element->properties[i];
        uint64_t length = 1;
        int which = 0;
        while (is_wanted && which < VALUES && file->wanted[which] != (int)i)
            which++;
        enum bvhd_status status = BVHD_OK;
        if (property->is_list)
            status = ply_list_length(&file->source, element, property, row, file->path, &length, file->error);
        if (status)
            return status;
        struct ply_value value;
        bool is_value = is_wanted && which < VALUES;
        bool ok = is_value ? ply_source_value(&file->source, property->type, &value)
                           : ply_source_skip_values(&file->source, property->type, length);
        if (!ok)
            return ply_row_failure(&file->source, element, row, file->path, file->error);
        if (is_value)
            store(file, row, which, value.single);
    }
    return ply_source_end_row(&file->source) ? BVHD_OK : too_many_values(file, element, row);
}

static void fill(float *radii, uint32_t count, float radius)
{
    for (uint32_t i = 0; i < count; i++)
        radii[i] = radius;
}

/* Makes the arrays of the vertices, and if they are points, the points. */
static bool make_arrays(struct ply_file *file)
{
    struct import_mesh *mesh = file->mesh;
    uint64_t room = file->vertex->count + 1;
    mesh->vertex_count = (uint32_t)file->vertex->count;
    mesh->positions = memory_array(file->memory, room, 3 * sizeof *mesh->positions);
    bool is_cloud = mesh->shape == IMPORT_POINTS, has_radii = is_cloud || file->wanted[RADIUS] >= 0;
    mesh->radii = has_radii ? memory_array(file->memory, room, sizeof *mesh->radii) : NULL;
    mesh->indices = is_cloud ? memory_array(file->memory, room, sizeof *mesh->indices) : NULL;
    if (!mesh->positions || (has_radii && !mesh->radii) || (is_cloud && !mesh->indices))
        return false;
    if (is_cloud && file->wanted[RADIUS] < 0)
        fill(mesh->radii, mesh->vertex_count, file->wish->point_radius);
    mesh->primitive_count = is_cloud ? mesh->vertex_count : 0;
    for (uint32_t i = 0; i < mesh->primitive_count; i++)
        mesh->indices[i] = i;
    return true;
}

static enum bvhd_status check_radii(const struct ply_file *file)
{
    uint32_t wrong = 0;
    if (!file->mesh->radii || !import_round_find_wrong(file->mesh->radii, file->mesh->vertex_count, &wrong))
        return BVHD_OK;
    return bvhd_error_set(file->error, BVHD_INVALID, file->path,
                          "the radius of vertex %u is %g: it has to be finite and not negative", wrong,
                          (double)file->mesh->radii[wrong]);
}

static enum bvhd_status read_vertices(struct ply_file *file)
{
    const struct ply_element *element = file->vertex;
    enum bvhd_status status = BVHD_OK;
    if (element->count >= UINT32_MAX)
        return bvhd_error_set(file->error, BVHD_UNSUPPORTED, file->path, "it has more than %u vertices",
                              UINT32_MAX - 1);
    if (!make_arrays(file))
        return no_memory(file);
    if (ply_element_is_fixed(element, file->source.format))
        status = read_fixed_vertices(file);
    else
        for (uint64_t row = 0; row < element->count && !status; row++)
            status = read_row(file, element, row, true);
    return status ? status : check_radii(file);
}

static enum bvhd_status skip_element(struct ply_file *file, const struct ply_element *element)
{
    enum bvhd_status status = BVHD_OK;
    if (element->property_count == 0)
        return BVHD_OK;
    if (ply_element_is_fixed(element, file->source.format)) {
        bool ok = ply_source_skip(&file->source, element->count * ply_element_row_size(element, file->source.format));
        return ok ? BVHD_OK : ply_row_failure(&file->source, element, 0, file->path, file->error);
    }
    for (uint64_t row = 0; row < element->count && !status; row++)
        status = read_row(file, element, row, false);
    return status;
}

/* Reads all elements, or skips the faces, or all but the faces. */
static enum bvhd_status read_elements(struct ply_file *file, bool with_vertices, struct ply_faces *faces)
{
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; i < file->header.element_count && !status; i++) {
        const struct ply_element *element = &file->header.elements[i];
        status = check_count(file, element);
        if (status)
            break;
        if (element == file->vertex && with_vertices)
            status = read_vertices(file);
        else if (is_faces(element) && faces)
            status = ply_faces_read(faces, element);
        else
            status = skip_element(file, element);
    }
    return status;
}

/*
 * Reads the body. The triangles of polygons depend on positions, so that a file with faces before its vertices is read
 * twice: for the vertices and then for the faces.
 */
static enum bvhd_status read_body(struct ply_file *file, struct ply_faces *faces)
{
    bool is_seen = false, is_late = false;
    for (uint32_t i = 0; i < file->header.element_count; i++) {
        is_late |= is_faces(&file->header.elements[i]) && !is_seen;
        is_seen |= &file->header.elements[i] == file->vertex;
    }
    if (!is_late)
        return read_elements(file, true, faces);
    uint64_t body = ply_source_tell(&file->source), line = file->source.line;
    enum bvhd_status status = read_elements(file, true, NULL);
    if (!status && !ply_source_seek(&file->source, body, line))
        status = bvhd_error_set(file->error, BVHD_IO, file->path, "it cannot be read twice");
    return status ? status : read_elements(file, false, faces);
}

/* Refuses what cannot have triangles or points, and what lacks a list, before anything is read. */
static enum bvhd_status check_elements(struct ply_file *file)
{
    uint64_t rows = 0;
    for (uint32_t i = 0; i < file->header.element_count; i++)
        rows += is_faces(&file->header.elements[i]) ? file->header.elements[i].count : 0;
    file->mesh->shape = rows == 0 && file->wish->point_radius > 0 ? IMPORT_POINTS : IMPORT_TRIANGLES;
    enum bvhd_status status = find_values(file);
    for (uint32_t i = 0; i < file->header.element_count && !status; i++) {
        const struct ply_element *element = &file->header.elements[i];
        if (is_faces(element) && !ply_faces_list(element, file->path, file->error))
            return BVHD_UNSUPPORTED;
        if (element != file->vertex && !is_faces(element))
            file->import->counts.unknown_rows += element->count;
    }
    if (!status && rows == 0 && file->mesh->shape == IMPORT_TRIANGLES)
        status = bvhd_error_set(file->error, BVHD_INVALID, file->path,
                                "no triangles in it: it is a point cloud of %llu vertices, without faces; --points "
                                "RADIUS reads them as spheres",
                                (unsigned long long)file->vertex->count);
    return status;
}

static enum bvhd_status no_triangles(const struct ply_file *file)
{
    const struct import_counts *counts = &file->mesh->counts;
    return bvhd_error_set(
        file->error, BVHD_INVALID, file->path, "no triangles in it, only %llu points, %llu lines and %llu empty faces",
        (unsigned long long)counts->points, (unsigned long long)counts->lines, (unsigned long long)counts->empty_faces);
}

/* Makes a mesh of points or lines among the faces, whose indices it takes. Its radii are those of the file, if any. */
static bool add_round(struct ply_file *file, enum import_shape shape, struct ply_round *round)
{
    const struct import_mesh *from = file->mesh;
    struct import_mesh *mesh = &file->import->meshes[file->import->mesh_count++];
    uint64_t room = (uint64_t)from->vertex_count + 1;
    *mesh = (struct import_mesh){.name = files_copy_text(file->memory, ""),
                                 .material = files_copy_text(file->memory, ""),
                                 .shape = shape,
                                 .positions = memory_array(file->memory, room, 3 * sizeof *mesh->positions),
                                 .radii = memory_array(file->memory, room, sizeof *mesh->radii),
                                 .indices = round->indices,
                                 .vertex_count = from->vertex_count,
                                 .primitive_count = (uint32_t)(round->count / import_shape_kinds[shape].corners)};
    *round = (struct ply_round){0};
    if (!mesh->name || !mesh->material || !mesh->positions || !mesh->radii)
        return false;
    memcpy(mesh->positions, from->positions, from->vertex_count * 3 * sizeof *mesh->positions);
    if (from->radii)
        memcpy(mesh->radii, from->radii, from->vertex_count * sizeof *mesh->radii);
    else
        fill(mesh->radii, mesh->vertex_count, import_round_radius(file->wish, shape));
    return true;
}

/* Adds a bottom level and an instance of a mesh. */
static bool add_bottom(struct import *import, uint32_t mesh)
{
    struct import_bottom *bottom = &import->bottoms[import->bottom_count++];
    *bottom = (struct import_bottom){.name = files_copy_text(import->memory, ""), .mesh_count = 1};
    bottom->meshes = memory_alloc(import->memory, sizeof *bottom->meshes);
    if (!bottom->name || !bottom->meshes)
        return false;
    bottom->meshes[0] = mesh;
    import->instances[import->instance_count] =
        (struct import_instance){.bottom = import->instance_count, .transform = {
                                     1,
                                     0,
                                     0,
                                     0,
                                     0,
                                     1,
                                     0,
                                     0,
                                     0,
                                     0,
                                     1,
                                     0
                                 }};
    import->instance_count++;
    return true;
}

/* Completes what was read: triangles have no radii, and each mesh that is not empty gets a bottom level. */
static bool finish_meshes(struct ply_file *file)
{
    struct import *import = file->import;
    if (file->mesh->shape == IMPORT_TRIANGLES) {
        memory_free(file->memory, file->mesh->radii);
        file->mesh->radii = NULL;
    }
    for (uint32_t i = 0; i < import->mesh_count; i++)
        if (import->meshes[i].primitive_count &&
            (!import_round_order(&import->meshes[i], file->memory) || !add_bottom(import, i)))
            return false;
    return true;
}

static enum bvhd_status read_file(struct ply_file *file)
{
    enum bvhd_status status = ply_header_read(&file->source, file->path, &file->header, file->error);
    if (status)
        return status;
    file->import->counts.unknown_lines = file->header.unknown_lines;
    file->vertex = ply_header_find(&file->header, "vertex");
    status = check_elements(file);
    if (status)
        return status;
    struct ply_faces faces;
    ply_source_end_row(&file->source); /* empty lines and comments before the first row */
    ply_faces_init(&faces, &file->source, file->path, file->memory, file->mesh, file->error);
    faces.rounds[IMPORT_POINTS].is_wanted = file->wish->point_radius > 0;
    faces.rounds[IMPORT_LINES].is_wanted = file->wish->line_radius > 0;
    status = read_body(file, &faces);
    for (enum import_shape shape = IMPORT_POINTS; shape < IMPORT_SHAPES && !status; shape++)
        if (faces.rounds[shape].count && !add_round(file, shape, &faces.rounds[shape]))
            status = no_memory(file);
    ply_faces_finish(&faces);
    file->import->counts.extra_bytes = ply_source_left(&file->source);
    if (!status && ferror(file->source.file))
        status = bvhd_error_set(file->error, BVHD_IO, file->path, "it cannot be read");
    import_round_count(file->import);
    if (!status && !import_round_any(file->import))
        status = no_triangles(file);
    if (!status && !finish_meshes(file))
        status = no_memory(file);
    return status;
}

/* Makes the parts of an import that are the same for all files, with room for a mesh of each shape. */
static bool prepare_import(const char *path, struct import *import)
{
    struct memory *memory = import->memory;
    import->name = import_name(path, memory);
    import->meshes = memory_array(memory, IMPORT_SHAPES, sizeof *import->meshes);
    import->bottoms = memory_array(memory, IMPORT_SHAPES, sizeof *import->bottoms);
    import->instances = memory_array(memory, IMPORT_SHAPES, sizeof *import->instances);
    import->files = memory_alloc(memory, sizeof *import->files);
    if (!import->name || !import->meshes || !import->bottoms || !import->instances || !import->files)
        return false;
    import->mesh_count = import->file_count = 1;
    import->meshes[0] =
        (struct import_mesh){.name = files_copy_text(memory, ""), .material = files_copy_text(memory, "")};
    import->files[0] = files_copy_text(memory, path);
    return import->meshes[0].name && import->meshes[0].material && import->files[0];
}

enum bvhd_status ply_import_stream(FILE *stream, uint64_t size, const char *path, const struct import_wish *wish,
                                   struct memory *memory, struct import *ret_import, struct bvhd_error *error)
{
    struct import import = {.memory = memory, .point_radius = wish->point_radius, .line_radius = wish->line_radius};
    struct ply_file *file = memory_alloc(memory, sizeof *file);
    bool ok = prepare_import(path, &import) && file;
    enum bvhd_status status = BVHD_OK;
    if (!ok)
        status = bvhd_error_no_memory(error, path, "no memory for the scene, or more than --memory allows");
    if (!status) {
        file->path = path;
        file->error = error;
        file->memory = memory;
        file->import = &import;
        file->mesh = &import.meshes[0];
        file->wish = wish;
        ply_source_init(&file->source, stream, size);
        status = read_file(file);
    }
    memory_free(memory, file);
    if (status) {
        import_finish(&import);
        return status;
    }
    import.reader = IMPORT_BY_PLY;
    import.has_second_reader = import.triangle_count > 0;
    import_counts_add_mesh(&import.counts, &import.meshes[0].counts);
    *ret_import = import;
    return BVHD_OK;
}

enum bvhd_status ply_import(const char *path, const struct import_wish *wish, struct memory *memory,
                            struct import *ret_import, struct bvhd_error *error)
{
    uint64_t size = 0;
    FILE *file = open_regular(path, &size);
    if (!file)
        return bvhd_error_set(error, BVHD_IO, path, "it cannot be opened");
    enum bvhd_status status = ply_import_stream(file, size, path, wish, memory, ret_import, error);
    fclose(file);
    return status;
}
