/* SPDX-License-Identifier: Apache-2.0 */
#include "structures.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "files.h"
#include "portable_scene.h"

static enum bvhd_status no_memory(const char *where, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_NO_MEMORY, where, "no memory to open it");
}

/* Puts the file's name before the place inside it. */
static void prefix_where(struct bvhd_error *error, const char *path)
{
    char where[sizeof error->where];
    const char *slash = strrchr(path, '/');
    snprintf(where, sizeof where, "%.60s: %.55s", slash ? slash + 1 : path, error->where);
    memcpy(error->where, where, sizeof where);
}

enum bvhd_status structures_read(const char *path, struct memory *memory, struct structure_file *ret_file, struct bvhd_error *error)
{
    struct structure_file file = {0};
    enum bvhd_status status = files_read(path, UINT64_C(1) << 40, memory, &file.data, &file.size, error);
    if (status)
        return status;
    static const unsigned char nothing[16] __attribute__((aligned(16)));
    struct bytes blob = {file.data ? file.data : nothing, file.size};
    struct bvhd_error inner = {0};
    status = structure_open(blob, memory, &file.structure, &inner);
    if (status) {
        prefix_where(&inner, path);
        *error = inner;
        memory_free(memory, file.data);
        return status;
    }
    *ret_file = file;
    return BVHD_OK;
}

void structures_close_file(struct structure_file *file, struct memory *memory)
{
    if (!file->is_shared) {
        structure_close(&file->structure);
        memory_free(memory, file->data);
        memory_free(memory, file->colours);
    }
    *file = (struct structure_file){0};
}

static const struct manifest_entry *find_entry(const struct manifest *manifest, const char *scene, bool is_top)
{
    for (uint32_t i = 0; i < manifest->count; i++)
        if (manifest->entries[i].is_top == is_top && !strcmp(manifest->entries[i].scene, scene))
            return &manifest->entries[i];
    return NULL;
}

const float *structures_colour(const struct structures *structures, uint32_t bottom, uint32_t geometry)
{
    const struct structure_file *file = &structures->files[bottom];
    bool is_there = bottom < structures->bottom_count && geometry < file->colour_count && file->colours[geometry].rgb[0] >= 0;
    return is_there ? file->colours[geometry].rgb : NULL;
}

/* Takes them over from the manifest. */
static void take_colours(struct manifest *manifest, const char *file, struct structure_file *opened)
{
    for (uint32_t i = 0; i < manifest->count; i++) {
        struct manifest_entry *entry = &manifest->entries[i];
        if (!entry->colours || strcmp(entry->file, file))
            continue;
        opened->colours = entry->colours;
        opened->colour_count = entry->colour_count;
        entry->colours = NULL;
        entry->colour_count = 0;
        return;
    }
}

/* What open_scene reads, and from where. */
struct reading {
    struct structures *structures;
    const char *directory;
    struct manifest *manifest;
    struct bvhd_error *error;
};

static enum bvhd_status read_one(const struct reading *reading, const char *file, bool is_top, struct structure_file *ret_file)
{
    struct memory *memory = reading->structures->memory;
    char *path = files_join(memory, reading->directory, file);
    if (!path)
        return no_memory(file, reading->error);
    enum bvhd_status status = structures_read(path, memory, ret_file, reading->error);
    memory_free(memory, path);
    if (status)
        return status;
    take_colours(reading->manifest, file, ret_file);
    enum structure_content content = ret_file->structure.content;
    if (content != CONTENT_UNKNOWN && (content == CONTENT_INSTANCES) != is_top)
        return bvhd_error_set(reading->error, BVHD_CORRUPT, file, "the manifest says that it is a %s level", is_top ? "top" : "bottom");
    return BVHD_OK;
}

/* A portable top level has one handle for each structure that it names. */
static enum bvhd_status check_handles(const struct structure_file *file, const struct manifest_entry *top, struct bvhd_error *error)
{
    uint64_t count = file->structure.view.portable.handle_count;
    if (count == top->handle_count)
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_CORRUPT, top->file, "it has %llu handles, the manifest has %u", (unsigned long long)count,
                          top->handle_count);
}

/* Before any bottom level, so that a manifest cannot have files read that the top level does not name. */
static enum bvhd_status read_top(const struct reading *reading, const struct manifest_entry *top)
{
    struct structure_file *file = &reading->structures->files[top->handle_count];
    enum bvhd_status status = read_one(reading, top->file, true, file);
    return status ? status : check_handles(file, top, reading->error);
}

struct named_place {
    const char *name;
    uint32_t place;
};

static int compare_places(const void *a, const void *b)
{
    const struct named_place *x = a, *y = b;
    int order = strcmp(x->name, y->name);
    return order ? order : (x->place > y->place) - (x->place < y->place);
}

/* A file that several handles name is read once. */
static enum bvhd_status read_places(const struct reading *reading, const struct named_place *places, uint32_t count)
{
    struct structure_file *files = reading->structures->files;
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0, first = 0; i < count && !status; i++) {
        if (strcmp(places[i].name, places[first].name))
            first = i;
        struct structure_file *file = &files[places[i].place];
        if (i == first) {
            status = read_one(reading, places[i].name, false, file);
        } else {
            *file = files[places[first].place];
            file->is_shared = true;
        }
    }
    return status;
}

static enum bvhd_status read_bottoms(const struct reading *reading, const struct manifest_entry *top)
{
    struct memory *memory = reading->structures->memory;
    struct named_place *places = memory_array(memory, (uint64_t)top->handle_count + 1, sizeof *places);
    if (!places)
        return no_memory(reading->directory, reading->error);
    for (uint32_t i = 0; i < top->handle_count; i++)
        places[i] = (struct named_place){top->handles[i], i};
    qsort(places, top->handle_count, sizeof *places, compare_places);
    enum bvhd_status status = read_places(reading, places, top->handle_count);
    memory_free(memory, places);
    return status;
}

static enum bvhd_status read_files(const struct reading *reading, const struct manifest_entry *top, const struct manifest_entry *bottom)
{
    struct structures *structures = reading->structures;
    uint64_t count = top ? (uint64_t)top->handle_count + 1 : 1;
    structures->files = memory_array(structures->memory, count, sizeof *structures->files);
    if (!structures->files)
        return no_memory(reading->directory, reading->error);
    memset(structures->files, 0, count * sizeof *structures->files);
    structures->file_count = (uint32_t)count;
    if (!top)
        return read_one(reading, bottom->file, false, &structures->files[0]);
    enum bvhd_status status = read_top(reading, top);
    return status ? status : read_bottoms(reading, top);
}

const struct structure *structures_top(const struct structures *structures)
{
    return structures->has_top ? &structures->files[structures->bottom_count].structure : NULL;
}

enum bvhd_status structures_join(struct structures *structures, struct bvhd_error *error)
{
    uint32_t count = structures->file_count;
    struct memory *memory = structures->memory;
    structures->bottom_count = count - structures->has_top;
    structures->target = structures->files[0].structure.target;
    structures->blobs = memory_array(memory, count, sizeof *structures->blobs);
    structures->portable_bottoms = memory_array(memory, count, sizeof *structures->portable_bottoms);
    if (!structures->blobs || !structures->portable_bottoms)
        return no_memory(structures->name, error);
    for (uint32_t i = 0; i < count; i++) {
        structures->blobs[i] = structures->files[i].structure.blob;
        structures->portable_bottoms[i] = &structures->files[i].structure.view.portable;
    }
    const struct structure *top = structures_top(structures);
    structures->scene = (struct scene){top ? &top->view.portable : NULL, structures->portable_bottoms, structures->bottom_count};
    return BVHD_OK;
}

enum bvhd_status structures_pack(const struct structures *structures, struct memory *memory, unsigned char **ret_buffer,
                                 uint64_t *ret_size, struct bvhd_error *error)
{
    uint32_t count = structures->file_count;
    struct bytes *blobs = memory_array(memory, count, sizeof *blobs);
    if (!blobs)
        return no_memory(structures->name, error);
    for (uint32_t i = 0; i < count; i++)
        blobs[structures->has_top ? (i + 1) % count : i] = structures->blobs[i];
    enum bvhd_status status = portable_pack(blobs, count, memory, ret_buffer, ret_size, error);
    memory_free(memory, blobs);
    return status;
}

static enum bvhd_status open_scene(struct structures *structures, const char *directory, struct manifest *manifest, const char *name,
                                   struct bvhd_error *error)
{
    if (manifest->count == 0)
        return bvhd_error_set(error, BVHD_NOT_FOUND, directory, "its manifest names no structure");
    const char *scene = name ? name : manifest->entries[0].scene;
    const struct manifest_entry *top = find_entry(manifest, scene, true), *bottom = find_entry(manifest, scene, false);
    if (!top && !bottom)
        return bvhd_error_set(error, BVHD_NOT_FOUND, directory, "its manifest names no scene '%s'", scene);
    structures->has_top = top != NULL;
    structures->name = files_copy_text(structures->memory, scene);
    if (!structures->name)
        return no_memory(directory, error);
    struct reading reading = {structures, directory, manifest, error};
    enum bvhd_status status = read_files(&reading, top, bottom);
    return status ? status : structures_join(structures, error);
}

enum bvhd_status structures_open(const char *directory, const char *name, struct memory *memory, struct structures *ret_structures,
                                 struct bvhd_error *error)
{
    struct manifest manifest;
    enum bvhd_status status = manifest_read(directory, memory, &manifest, error);
    if (status)
        return status;
    struct structures structures = {.memory = memory};
    status = open_scene(&structures, directory, &manifest, name, error);
    manifest_finish(&manifest);
    if (status)
        structures_close(&structures);
    else
        *ret_structures = structures;
    return status;
}

void structures_close(struct structures *structures)
{
    if (!structures || !structures->memory)
        return;
    for (uint32_t i = 0; structures->files && i < structures->file_count; i++)
        structures_close_file(&structures->files[i], structures->memory);
    memory_free(structures->memory, structures->files);
    memory_free(structures->memory, structures->blobs);
    memory_free(structures->memory, structures->portable_bottoms);
    memory_free(structures->memory, structures->name);
    *structures = (struct structures){0};
}

bool structures_trace_counted(const struct structures *structures, const struct ray *ray, const struct traverse_options *options,
                              struct ray_hit *ret_hit, struct traverse_counters *counters)
{
    return traverse(&structures->scene, ray, options, ret_hit, counters);
}

bool structures_trace(const struct structures *structures, const struct ray *ray, const struct traverse_options *options,
                      struct ray_hit *ret_hit)
{
    return structures_trace_counted(structures, ray, options, ret_hit, NULL);
}

void structures_corners(const struct structures *structures, const struct ray_hit *hit, float ret_corners[3][3])
{
    traverse_positions(&structures->scene, hit, ret_corners);
}
