/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/structures.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/format/serialized.h"
#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/target_reader.h"
#include "proto/base/place.h"

static enum bvhd_status no_memory(const char *where, struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, where, "no memory to open it");
}

/* Puts the file's name before the place in it. */
static void prefix_where(struct bvhd_error *error, const char *name)
{
    char where[sizeof error->where];
    snprintf(where, sizeof where, "%s: %.55s", name, error->where);
    memcpy(error->where, where, sizeof where);
}

/* Opens a file from its bytes, which it takes over even if it fails. */
static enum bvhd_status open_file(const char *name, struct built_bytes bytes, struct memory *memory,
                                  struct structure_file *ret_file, struct bvhd_error *error)
{
    struct structure_file file = {.data = bytes.owned, .size = bytes.bytes.size};
    struct bvhd_error inner = {0};
    snprintf(file.name, sizeof file.name, "%s", name);
    enum bvhd_status status = structure_open(bytes.bytes, memory, &file.structure, &inner);
    if (status) {
        prefix_where(&inner, file.name);
        if (error)
            *error = inner;
        memory_free(memory, file.data);
        return status;
    }
    *ret_file = file;
    return BVHD_OK;
}

enum bvhd_status structures_read(const char *path, struct memory *memory, struct structure_file *ret_file,
                                 struct bvhd_error *error)
{
    static const unsigned char nothing[16] __attribute__((aligned(16)));
    struct built_bytes bytes;
    enum bvhd_status status = files_read(path, UINT64_C(1) << 40, memory, &bytes.owned, &bytes.bytes.size, error);
    if (status)
        return status;
    const char *slash = strrchr(path, '/');
    bytes.bytes.data = bytes.owned ? bytes.owned : nothing;
    return open_file(slash ? slash + 1 : path, bytes, memory, ret_file, error);
}

enum bvhd_status structures_read_built(const struct built *built, const char *name, struct memory *memory,
                                       struct structure_file *ret_file, struct bvhd_error *error)
{
    struct built_bytes bytes;
    enum bvhd_status status = built_read(built, name, &bytes, error);
    return status ? status : open_file(name, bytes, memory, ret_file, error);
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
    if (bottom >= structures->bottom_count || geometry >= structures->files[bottom].colour_count)
        return NULL;
    const float *rgb = structures->files[bottom].colours[geometry].rgb;
    return rgb[0] >= 0 ? rgb : NULL;
}

/* Moves the colours of a file from the manifest. */
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

/* The arguments of open_scene, for its helpers. */
struct scene_reader {
    struct structures *structures;
    const char *directory;
    struct manifest *manifest;
    struct bvhd_error *error;
};

static enum bvhd_status corrupt(const struct scene_reader *reading, const char *file, const char *text)
{
    return bvhd_error_set(reading->error, BVHD_CORRUPT, file, "%s", text);
}

static enum bvhd_status read_one(const struct scene_reader *reading, const char *file, bool is_top,
                                 struct structure_file *ret_file)
{
    const struct structures *structures = reading->structures;
    enum bvhd_status status =
        structures_read_built(&structures->built, file, structures->memory, ret_file, reading->error);
    if (status)
        return status;
    take_colours(reading->manifest, file, ret_file);
    const struct structure *structure = &ret_file->structure;
    if (structure->content != CONTENT_UNKNOWN && (structure->content == CONTENT_INSTANCES) != is_top)
        return corrupt(reading, file,
                       is_top ? "the manifest says that it is a top level"
                              : "the manifest says that it is a bottom level");
    if (structure->target != reading->structures->target)
        return corrupt(reading, file, "not of the target that the manifest says");
    return BVHD_OK;
}

struct named_row {
    const char *name;
    uint32_t row;
};

/* Sorts by rows, and equal rows by names. */
static int compare_rows(const void *a, const void *b)
{
    const struct named_row *x = a, *y = b;
    return x->row != y->row ? (x->row > y->row) - (x->row < y->row) : strcmp(x->name, y->name);
}

static int compare_names(const void *a, const void *b)
{
    const struct named_row *x = a, *y = b;
    int order = strcmp(x->name, y->name);
    return order ? order : (x->row > y->row) - (x->row < y->row);
}

/* Removes duplicates, so that each row is listed once. BVHD_CORRUPT when a row has two files. */
static enum bvhd_status merge_rows(const struct scene_reader *reading, const char *top, struct named_row *rows,
                                   uint32_t *count)
{
    uint32_t kept = 0;
    qsort(rows, *count, sizeof *rows, compare_rows);
    for (uint32_t i = 0; i < *count; i++) {
        if (kept == 0 || rows[i].row != rows[kept - 1].row)
            rows[kept++] = rows[i];
        else if (strcmp(rows[i].name, rows[kept - 1].name))
            return corrupt(reading, top, "the manifest has several files for one of its references");
    }
    *count = kept;
    return BVHD_OK;
}

/* Reads the files of all rows, which are sorted by name: a file that several rows name is read once. */
static enum bvhd_status read_rows(const struct scene_reader *reading, const struct named_row *rows, uint32_t count)
{
    struct structure_file *files = reading->structures->files;
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0, first = 0; i < count && !status; i++) {
        if (strcmp(rows[i].name, rows[first].name))
            first = i;
        struct structure_file *file = &files[rows[i].row];
        if (i == first) {
            status = read_one(reading, rows[i].name, false, file);
        } else {
            *file = files[rows[first].row];
            file->is_shared = true;
        }
    }
    return status;
}

/*
 * Lists the row that each handle of the top level names, with the file that the manifest has for it. The number of rows
 * is at most that of the handles.
 */
static enum bvhd_status list_rows(const struct scene_reader *reading, const struct manifest_entry *entry,
                                  const struct structure *top, struct named_row *ret_rows, uint32_t *ret_row_count)
{
    bool has_handle_per_row = target_reader_find(top->target)->has_handle_per_row;
    uint64_t highest = 0;
    for (uint32_t i = 0; i < entry->handle_count; i++) {
        uint64_t handle = bytes_get64(top->blob.data + SERIALIZED_HANDLES + UINT64_C(8) * i);
        bool is_row = handle > 0 && handle <= entry->handle_count && (!has_handle_per_row || handle == i + UINT64_C(1));
        if (!is_row)
            return corrupt(reading, entry->file, "its handles are not what a build writes");
        ret_rows[i] = (struct named_row){entry->handles[i], (uint32_t)(handle - 1)};
        highest = handle > highest ? handle : highest;
    }
    *ret_row_count = (uint32_t)highest;
    return BVHD_OK;
}

static enum bvhd_status make_files(const struct scene_reader *reading, uint32_t count)
{
    struct structures *structures = reading->structures;
    structures->files = memory_array(structures->memory, count, sizeof *structures->files);
    if (!structures->files)
        return no_memory(reading->directory, reading->error);
    memset(structures->files, 0, count * sizeof *structures->files);
    structures->file_count = count;
    return BVHD_OK;
}

static enum bvhd_status read_bottoms(const struct scene_reader *reading, const struct manifest_entry *entry,
                                     struct structure_file *top, struct named_row *rows)
{
    uint32_t row_count = 0, count = entry->handle_count;
    enum bvhd_status status = list_rows(reading, entry, &top->structure, rows, &row_count);
    if (!status)
        status = merge_rows(reading, entry->file, rows, &count);
    if (!status)
        status = make_files(reading, row_count + 1);
    if (status)
        return status;
    reading->structures->files[row_count] = *top;
    *top = (struct structure_file){0};
    qsort(rows, count, sizeof *rows, compare_names);
    return read_rows(reading, rows, count);
}

static enum bvhd_status read_below(const struct scene_reader *reading, const struct manifest_entry *entry,
                                   struct structure_file *top)
{
    struct memory *memory = reading->structures->memory;
    struct serialized_header header;
    enum bvhd_status status = serialized_read(top->structure.blob, &header, reading->error);
    if (status)
        return status;
    if (header.handle_count != entry->handle_count)
        return bvhd_error_set(reading->error, BVHD_CORRUPT, entry->file, "it has %llu handles, the manifest has %u",
                              (unsigned long long)header.handle_count, entry->handle_count);
    struct named_row *rows = memory_array(memory, header.handle_count + 1, sizeof *rows);
    status = rows ? read_bottoms(reading, entry, top, rows) : no_memory(reading->directory, reading->error);
    memory_free(memory, rows);
    return status;
}

/* Reads the top level first, so that the manifest cannot name more files than the top level has handles. */
static enum bvhd_status read_files(const struct scene_reader *reading, const struct manifest_entry *top,
                                   const struct manifest_entry *bottom)
{
    if (!top) {
        enum bvhd_status status = make_files(reading, 1);
        return status ? status : read_one(reading, bottom->file, false, &reading->structures->files[0]);
    }
    struct structure_file file = {0};
    enum bvhd_status status = read_one(reading, top->file, true, &file);
    if (!status)
        status = read_below(reading, top, &file);
    structures_close_file(&file, reading->structures->memory);
    return status;
}

const struct structure *structures_top(const struct structures *structures)
{
    return structures->has_top ? &structures->files[structures->bottom_count].structure : NULL;
}

/* Checks that the bottom levels that instances name are there. */
static enum bvhd_status check_instances(const struct structures *structures, struct bvhd_error *error)
{
    const struct structure *top = structures_top(structures);
    for (uint32_t i = 0; top && i < structure_instance_count(top); i++) {
        uint32_t bottom = structure_instance(top, i).bottom;
        if (bottom >= structures->bottom_count || !structures->files[bottom].structure.blob.data)
            return bvhd_error_set(error, BVHD_CORRUPT, place("instances[%u]", i).text, "there is no bottom level %u",
                                  bottom);
    }
    return BVHD_OK;
}

static enum bvhd_status make_scene(struct structures *structures, struct bvhd_error *error)
{
    uint32_t count = structures->file_count;
    struct bvhd_cpu_blob *blobs = memory_array(structures->memory, count, sizeof *blobs);
    if (!blobs)
        return no_memory("structures", error);
    for (uint32_t i = 0; i < count; i++)
        blobs[i] = (struct bvhd_cpu_blob){structures->blobs[i].data, structures->blobs[i].size};
    const struct bvhd_cpu_scene_options options = {.struct_size = sizeof options, .blobs = blobs, .blob_count = count};
    enum bvhd_status status = bvhd_cpu_scene_create(&options, &structures->scene, error);
    memory_free(structures->memory, blobs);
    return status;
}

enum bvhd_status structures_join(struct structures *structures, struct bvhd_error *error)
{
    uint32_t count = structures->file_count;
    struct memory *memory = structures->memory;
    structures->bottom_count = count - structures->has_top;
    structures->target = structures->files[count - 1].structure.target;
    structures->blobs = memory_array(memory, count, sizeof *structures->blobs);
    if (!structures->blobs)
        return no_memory("structures", error);
    for (uint32_t i = 0; i < count; i++)
        structures->blobs[i] = structures->files[i].structure.blob;
    enum bvhd_status status = check_instances(structures, error);
    return status == BVHD_OK ? make_scene(structures, error) : status;
}

void structures_separate(struct structures *structures)
{
    memory_free(structures->memory, structures->blobs);
    bvhd_cpu_scene_destroy(structures->scene);
    structures->blobs = NULL;
    structures->scene = NULL;
}

static enum bvhd_status open_scene(struct structures *structures, const char *directory, struct manifest *manifest,
                                   const char *name, struct bvhd_error *error)
{
    if (manifest->count == 0)
        return bvhd_error_set(error, BVHD_NOT_FOUND, directory, "its manifest names no structure");
    const struct manifest_entry *named = name ? manifest_find_top(manifest, NULL, name) : &manifest->entries[0];
    const char *scene = named ? named->scene : name;
    const struct manifest_entry *top = find_entry(manifest, scene, true), *bottom = find_entry(manifest, scene, false);
    if (!top && !bottom)
        return bvhd_error_set(error, BVHD_NOT_FOUND, directory,
                              "its manifest names no scene '%s', or one in each of several files", scene);
    structures->has_top = top != NULL;
    structures->target = top ? top->target : bottom->target;
    structures->name = files_copy_text(structures->memory, scene);
    if (!structures->name)
        return no_memory(directory, error);
    struct scene_reader reading = {structures, directory, manifest, error};
    enum bvhd_status status = read_files(&reading, top, bottom);
    return status ? status : structures_join(structures, error);
}

enum bvhd_status structures_open(const char *path, const char *name, struct memory *memory,
                                 struct structures *ret_structures, struct bvhd_error *error)
{
    struct manifest manifest;
    struct structures structures = {.memory = memory};
    enum bvhd_status status = built_open(path, memory, &structures.built, error);
    if (status)
        return status;
    status = manifest_read_built(&structures.built, memory, &manifest, error);
    if (!status) {
        status = open_scene(&structures, path, &manifest, name, error);
        manifest_finish(&manifest);
    }
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
    structures_separate(structures);
    memory_free(structures->memory, structures->name);
    built_close(&structures->built);
    *structures = (struct structures){0};
}

bool structures_trace(const struct structures *structures, const struct ray *ray, struct ray_hit *ret_hit)
{
    struct ray_hit hit;
    const struct bvhd_cpu_trace trace = {
        .struct_size = sizeof trace,
        .rays = ray,
        .ray_size = sizeof *ray,
        .hits = &hit,
        .hit_size = sizeof hit,
        .ray_count = 1,
    };
    if (bvhd_cpu_scene_trace(structures->scene, &trace, NULL) != BVHD_OK || hit.handle == RAY_NO_BOTTOM)
        return false;
    *ret_hit = hit;
    return true;
}

void structures_corners(const struct structures *structures, const struct ray_hit *hit, float time,
                        float ret_corners[3][3])
{
    const struct bvhd_cpu_hit named = {.blob = hit->handle, .record = hit->record};
    bvhd_cpu_scene_corners_at(structures->scene, &named, time, ret_corners, NULL);
}
