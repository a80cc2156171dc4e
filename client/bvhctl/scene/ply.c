/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/ply.h"

#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/ply_faces.h"

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
    int coordinates[3]; /* which properties of the vertices they are */
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

/* Finds which property is which coordinate. */
static enum bvhd_status find_coordinates(struct ply_file *file)
{
    static const char *const names[3] = {"x", "y", "z"};
    for (int i = 0; i < 3; i++) {
        file->coordinates[i] = file->vertex ? ply_element_find(file->vertex, names[i]) : -1;
        if (file->coordinates[i] < 0 || file->vertex->properties[file->coordinates[i]].is_list)
            return bvhd_error_set(file->error, BVHD_INVALID, file->path, "its vertices have no '%s'", names[i]);
    }
    return BVHD_OK;
}

/* Reads vertices that all have the same size in the file. */
static enum bvhd_status read_fixed_vertices(struct ply_file *file, const int coordinates[3])
{
    const struct ply_element *element = file->vertex;
    size_t offsets[3] = {0}, size = 0;
    for (uint32_t i = 0; i < element->property_count; i++) {
        for (int k = 0; k < 3; k++)
            if (coordinates[k] == (int)i)
                offsets[k] = size;
        size += ply_type_size(element->properties[i].type);
    }
    float *out = file->mesh->positions;
    for (uint64_t row = 0; row < element->count; row++) {
        const unsigned char *bytes = ply_source_take(&file->source, size);
        if (!bytes)
            return ply_row_failure(&file->source, element, row, file->path, file->error);
        for (int k = 0; k < 3; k++) {
            enum ply_type type = element->properties[coordinates[k]].type;
            *out++ = ply_value_of(bytes + offsets[k], type, file->source.format).single;
        }
    }
    return BVHD_OK;
}

/* Reads a row of any element. Unless `coordinates` is NULL, the values of these three properties go to ret_position. */
static enum bvhd_status read_row(struct ply_file *file, const struct ply_element *element, uint64_t row,
                                 const int coordinates[3], float ret_position[3])
{
    for (uint32_t i = 0; i < element->property_count; i++) {
        const struct ply_property *property = &element->properties[i];
        uint64_t length = 1;
        int axis = 0;
        while (coordinates && axis < 3 && coordinates[axis] != (int)i)
            axis++;
        enum bvhd_status status = BVHD_OK;
        if (property->is_list)
            status = ply_list_length(&file->source, element, property, row, file->path, &length, file->error);
        if (status)
            return status;
        struct ply_value value;
        bool is_coordinate = coordinates && axis < 3;
        bool ok = is_coordinate ? ply_source_value(&file->source, property->type, &value)
                                : ply_source_skip_values(&file->source, property->type, length);
        if (!ok)
            return ply_row_failure(&file->source, element, row, file->path, file->error);
        if (is_coordinate)
            ret_position[axis] = value.single;
    }
    return ply_source_end_row(&file->source) ? BVHD_OK : too_many_values(file, element, row);
}

static enum bvhd_status read_vertices(struct ply_file *file)
{
    const struct ply_element *element = file->vertex;
    enum bvhd_status status = BVHD_OK;
    if (element->count >= UINT32_MAX)
        return bvhd_error_set(file->error, BVHD_UNSUPPORTED, file->path, "it has more than %u vertices",
                              UINT32_MAX - 1);
    file->mesh->positions = memory_array(file->memory, element->count + 1, 3 * sizeof *file->mesh->positions);
    if (!file->mesh->positions)
        return no_memory(file);
    file->mesh->vertex_count = (uint32_t)element->count;
    if (ply_element_is_fixed(element, file->source.format))
        return read_fixed_vertices(file, file->coordinates);
    for (uint64_t row = 0; row < element->count && !status; row++)
        status = read_row(file, element, row, file->coordinates, file->mesh->positions + 3 * row);
    return status;
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
        status = read_row(file, element, row, NULL, NULL);
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

/* Refuses what cannot have triangles, and what lacks a list, before anything is read. */
static enum bvhd_status check_elements(struct ply_file *file)
{
    uint64_t rows = 0;
    enum bvhd_status status = find_coordinates(file);
    for (uint32_t i = 0; i < file->header.element_count && !status; i++) {
        const struct ply_element *element = &file->header.elements[i];
        if (is_faces(element) && !ply_faces_list(element, file->path, file->error))
            return BVHD_UNSUPPORTED;
        rows += is_faces(element) ? element->count : 0;
        if (element != file->vertex && !is_faces(element))
            file->import->counts.unknown_rows += element->count;
    }
    if (!status && rows == 0)
        status = bvhd_error_set(file->error, BVHD_INVALID, file->path,
                                "no triangles in it: it is a point cloud of %llu vertices, without faces",
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
    status = read_body(file, &faces);
    ply_faces_finish(&faces);
    file->import->counts.extra_bytes = ply_source_left(&file->source);
    if (!status && ferror(file->source.file))
        status = bvhd_error_set(file->error, BVHD_IO, file->path, "it cannot be read");
    if (!status && file->mesh->triangle_count == 0)
        status = no_triangles(file);
    return status;
}

/* Makes the parts of an import that are the same for all files: one mesh, one bottom level, one instance. */
static bool prepare_import(const char *path, struct import *import)
{
    struct memory *memory = import->memory;
    import->name = import_name(path, memory);
    import->meshes = memory_alloc(memory, sizeof *import->meshes);
    import->bottoms = memory_alloc(memory, sizeof *import->bottoms);
    import->instances = memory_alloc(memory, sizeof *import->instances);
    import->files = memory_alloc(memory, sizeof *import->files);
    if (!import->name || !import->meshes || !import->bottoms || !import->instances || !import->files)
        return false;
    import->mesh_count = import->bottom_count = import->instance_count = import->file_count = 1;
    import->meshes[0] =
        (struct import_mesh){.name = files_copy_text(memory, ""), .material = files_copy_text(memory, "")};
    import->bottoms[0] = (struct import_bottom){.name = files_copy_text(memory, ""), .mesh_count = 1};
    import->bottoms[0].meshes = memory_alloc(memory, sizeof *import->bottoms[0].meshes);
    import->instances[0] = (struct import_instance){.transform = { 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0 }};
    import->files[0] = files_copy_text(memory, path);
    if (!import->meshes[0].name || !import->meshes[0].material || !import->bottoms[0].name ||
        !import->bottoms[0].meshes || !import->files[0])
        return false;
    import->bottoms[0].meshes[0] = 0;
    return true;
}

enum bvhd_status ply_import_stream(FILE *stream, uint64_t size, const char *path, struct memory *memory,
                                   struct import *ret_import, struct bvhd_error *error)
{
    struct import import = {.memory = memory};
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
        ply_source_init(&file->source, stream, size);
        status = read_file(file);
    }
    memory_free(memory, file);
    if (status) {
        import_finish(&import);
        return status;
    }
    import.reader = IMPORT_BY_PLY;
    import.has_second_reader = true;
    import.triangle_count = import.meshes[0].triangle_count;
    import_counts_add_mesh(&import.counts, &import.meshes[0].counts);
    *ret_import = import;
    return BVHD_OK;
}

enum bvhd_status ply_import(const char *path, struct memory *memory, struct import *ret_import,
                            struct bvhd_error *error)
{
    uint64_t size = 0;
    FILE *file = open_regular(path, &size);
    if (!file)
        return bvhd_error_set(error, BVHD_IO, path, "it cannot be opened");
    enum bvhd_status status = ply_import_stream(file, size, path, memory, ret_import, error);
    fclose(file);
    return status;
}
