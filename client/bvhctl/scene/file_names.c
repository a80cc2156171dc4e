/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/file_names.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/scene/import_round.h"
#include "proto/base/checksum.h"

enum { NAME_MAX_LENGTH = 48, DIGEST_LENGTH = 16 }; /* NAME_MAX_LENGTH: of the name of a mesh, as far as it is used */

static bool is_safe(unsigned char character)
{
    return (character >= 'a' && character <= 'z') || (character >= 'A' && character <= 'Z') ||
           (character >= '0' && character <= '9') || character == '.' || character == '-' || character == '_';
}

/*
 * Makes a name that is safe in file names: runs of other characters become one '_', dots are kept only with `dots`, and
 * the first character is neither a dot, which would hide the file, nor a hyphen.
 */
static size_t make_safe(const char *name, size_t limit, bool dots, char *ret_safe)
{
    size_t size = 0;
    for (const unsigned char *at = (const unsigned char *)name; *at && size < limit; at++) {
        bool ok = is_safe(*at) && (dots || *at != '.') && !(size == 0 && (*at == '.' || *at == '-'));
        if (ok)
            ret_safe[size++] = (char)*at;
        else if (size == 0 || ret_safe[size - 1] != '_')
            ret_safe[size++] = '_';
    }
    ret_safe[size] = '\0';
    return size;
}

char *file_names_safe(const char *name, struct memory *memory)
{
    size_t length = strlen(name);
    char *safe = memory_alloc(memory, length + 2);
    if (safe && make_safe(name, length, true, safe) == 0)
        memcpy(safe, "_", 2);
    return safe;
}

/* Returns whether a reader made the name of the position in the file, as in "meshes[3]": neighbours change that. */
static bool is_numbered(const char *name)
{
    int end = 0;
    sscanf(name, "meshes[%*u]%n", &end);
    return end > 0 && (name[end] == '\0' || name[end] == '-');
}

static const char *own_name(const struct import_mesh *mesh)
{
    return is_numbered(mesh->name) ? "" : mesh->name;
}

static void add_bytes(struct checksum *sum, const void *data, uint64_t size)
{
    checksum_add(sum, (struct bytes){data, size});
}

static void add_text(struct checksum *sum, const char *text)
{
    add_bytes(sum, text, strlen(text) + 1);
}

static void add_mesh(struct checksum *sum, const struct import_mesh *mesh)
{
    uint32_t counts[] = {mesh->vertex_count, mesh->primitive_count, mesh->has_colour};
    add_text(sum, own_name(mesh));
    add_text(sum, mesh->material);
    add_bytes(sum, counts, sizeof counts);
    add_bytes(sum, mesh->colour, mesh->has_colour ? sizeof mesh->colour : 0);
    add_bytes(sum, mesh->positions, mesh->vertex_count * UINT64_C(12));
    if (mesh->end_positions)
        add_bytes(sum, mesh->end_positions, mesh->vertex_count * UINT64_C(12));
    add_bytes(sum, mesh->indices, import_corner_count(mesh) * 4);
    if (mesh->radii)
        add_bytes(sum, mesh->radii, mesh->vertex_count * UINT64_C(4));
}

/* The name of several meshes that were primitives of one mesh, "NAME-0" and so on, is NAME. */
static void make_level_name(const struct import *import, const struct import_bottom *bottom,
                            char ret_name[NAME_MAX_LENGTH + 1])
{
    const char *name = bottom->mesh_count ? own_name(&import->meshes[bottom->meshes[0]]) : "";
    size_t length = strlen(name);
    bool is_first = bottom->mesh_count > 1 && length > 2 && strcmp(name + length - 2, "-0") == 0;
    size_t used = make_safe(name, NAME_MAX_LENGTH, false, ret_name);
    if (is_first && used >= 2 && strcmp(ret_name + used - 2, "-0") == 0)
        ret_name[used - 2] = '\0';
}

static char *make_bottom(const struct import *import, const char *scene, uint32_t index)
{
    const struct import_bottom *bottom = &import->bottoms[index];
    struct checksum sum;
    char name[NAME_MAX_LENGTH + 1];
    checksum_init(&sum, bottom->mesh_count);
    for (uint32_t i = 0; i < bottom->mesh_count; i++)
        add_mesh(&sum, &import->meshes[bottom->meshes[i]]);
    make_level_name(import, bottom, name);
    uint64_t size = strlen(scene) + strlen(name) + DIGEST_LENGTH + sizeof ".blas--.as";
    char *file = memory_alloc(import->memory, size);
    if (file)
        snprintf(file, size, "%s.blas-%s%s%016llx.as", scene, name, *name ? "-" : "",
                 (unsigned long long)checksum_get(&sum));
    return file;
}

static char *make_top(const struct import *import, const char *scene)
{
    uint64_t size = strlen(scene) + sizeof ".tlas.as";
    char *file = memory_alloc(import->memory, size);
    if (file)
        snprintf(file, size, "%s.tlas.as", scene);
    return file;
}

struct numbered_file {
    const char *file;
    uint32_t number;
};

static int compare(const void *a, const void *b)
{
    const struct numbered_file *x = a, *y = b;
    int order = strcmp(x->file, y->file);
    return order ? order : (x->number > y->number) - (x->number < y->number);
}

/* Finds equal names. Returns false when there is no memory. */
static bool find_first(struct file_names *names)
{
    struct numbered_file *sorted = memory_array(names->memory, names->count, sizeof *sorted);
    if (!sorted)
        return false;
    for (uint32_t i = 0; i < names->count; i++)
        sorted[i] = (struct numbered_file){names->files[i], i};
    qsort(sorted, names->count, sizeof *sorted, compare);
    for (uint32_t i = 0; i < names->count; i++) {
        bool is_same = i > 0 && strcmp(sorted[i].file, sorted[i - 1].file) == 0;
        names->first[sorted[i].number] = is_same ? names->first[sorted[i - 1].number] : sorted[i].number;
    }
    memory_free(names->memory, sorted);
    return true;
}

static bool fill(struct file_names *names, const struct import *import, const char *scene)
{
    uint64_t count = (uint64_t)import->bottom_count + 1;
    names->files = memory_array(names->memory, count, sizeof *names->files);
    names->first = memory_array(names->memory, count, sizeof *names->first);
    if (!names->files || !names->first)
        return false;
    for (uint32_t i = 0; i < count; i++) {
        char *file = i < import->bottom_count ? make_bottom(import, scene, i) : make_top(import, scene);
        if (!file)
            return false;
        names->files[names->count++] = file;
    }
    return find_first(names);
}

enum bvhd_status file_names_make(const struct import *import, struct file_names *ret_names, struct bvhd_error *error)
{
    struct file_names names = {.memory = import->memory};
    char *scene = file_names_safe(import->name, import->memory);
    bool ok = scene && fill(&names, import, scene);
    memory_free(import->memory, scene);
    if (!ok) {
        file_names_finish(&names);
        return bvhd_error_no_memory(error, import->name, "no memory for its files' names");
    }
    *ret_names = names;
    return BVHD_OK;
}

void file_names_finish(struct file_names *names)
{
    if (!names || !names->memory)
        return;
    for (uint32_t i = 0; i < names->count; i++)
        memory_free(names->memory, names->files[i]);
    memory_free(names->memory, names->files);
    memory_free(names->memory, names->first);
    *names = (struct file_names){0};
}
