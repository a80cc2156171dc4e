/* SPDX-License-Identifier: Apache-2.0 */
#include "structures.h"

#include <stdio.h>
#include <string.h>

#include "files.h"

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
    status = portable_open(blob, memory, &file.view, &inner);
    if (status) {
        prefix_where(&inner, path);
        *error = inner;
        memory_free(memory, file.data);
        return status;
    }
    *ret_file = file;
    return BVHD_OK;
}

static const struct manifest_entry *find_entry(const struct manifest *manifest, const char *scene, bool is_top)
{
    for (uint32_t i = 0; i < manifest->count; i++)
        if (manifest->entries[i].is_top == is_top && !strcmp(manifest->entries[i].scene, scene))
            return &manifest->entries[i];
    return NULL;
}

const float *structures_colour(const struct structures *structures, uint32_t handle, uint32_t geometry)
{
    const struct structure_file *file = &structures->files[handle];
    bool is_there = handle < structures->scene.bottom_count && geometry < file->colour_count && file->colours[geometry].rgb[0] >= 0;
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

static enum bvhd_status read_one(struct structures *structures, const char *directory, struct manifest *manifest, const char *file,
                                 bool is_top, struct bvhd_error *error)
{
    char *path = files_join(structures->memory, directory, file);
    if (!path)
        return no_memory(file, error);
    struct structure_file *opened = &structures->files[structures->file_count];
    enum bvhd_status status = structures_read(path, structures->memory, opened, error);
    memory_free(structures->memory, path);
    if (status)
        return status;
    structures->file_count++;
    take_colours(manifest, file, opened);
    if ((opened->view.header->content == PORTABLE_INSTANCES) != is_top)
        return bvhd_error_set(error, BVHD_CORRUPT, file, "the manifest says that it is a %s level", is_top ? "top" : "bottom");
    return BVHD_OK;
}

static enum bvhd_status read_files(struct structures *structures, const char *directory, struct manifest *manifest,
                                   const struct manifest_entry *top, const struct manifest_entry *bottom, struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    uint32_t bottom_count = top ? top->handle_count : 1;
    structures->files = memory_array(structures->memory, (uint64_t)bottom_count + 1, sizeof *structures->files);
    if (!structures->files)
        return no_memory(directory, error);
    for (uint32_t i = 0; i < bottom_count && !status; i++)
        status = read_one(structures, directory, manifest, top ? top->handles[i] : bottom->file, false, error);
    if (!status && top) {
        status = read_one(structures, directory, manifest, top->file, true, error);
        uint64_t handles = status ? 0 : structures->files[bottom_count].view.handle_count;
        if (!status && handles != top->handle_count)
            status = bvhd_error_set(error, BVHD_CORRUPT, top->file, "it has %llu handles, the manifest has %u",
                                    (unsigned long long)handles, top->handle_count);
    }
    return status;
}

/* The top level first, as portable_pack wants them. */
static void list_blobs(const struct structures *structures, bool has_top, struct bytes *ret_blobs)
{
    uint32_t count = structures->file_count;
    for (uint32_t i = 0; i < count; i++) {
        const struct structure_file *file = &structures->files[i];
        ret_blobs[has_top ? (i + 1) % count : i] = (struct bytes){file->data, file->size};
    }
}

static enum bvhd_status pack_files(struct structures *structures, bool has_top, struct bvhd_error *error)
{
    struct memory *memory = structures->memory;
    uint64_t size;
    struct bytes *blobs = memory_array(memory, structures->file_count, sizeof *blobs);
    struct portable_scene *packed = memory_alloc(memory, sizeof *packed);
    enum bvhd_status status = BVHD_NO_MEMORY;
    if (blobs && packed) {
        list_blobs(structures, has_top, blobs);
        status = portable_pack(blobs, structures->file_count, memory, &structures->buffer, &size, error);
        if (!status)
            status = portable_scene_open((struct bytes){structures->buffer, size}, memory, packed, error);
    } else {
        no_memory(structures->name, error);
    }
    memory_free(memory, blobs);
    if (status) {
        memory_free(memory, packed);
        return status;
    }
    structures->packed = packed;
    structures->scene = packed->scene;
    for (uint32_t i = 0; i < structures->file_count; i++) {
        memory_free(memory, structures->files[i].data);
        structures->files[i].data = NULL;
    }
    return BVHD_OK;
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
    structures->name = files_copy_text(structures->memory, scene);
    if (!structures->name)
        return no_memory(directory, error);
    enum bvhd_status status = read_files(structures, directory, manifest, top, bottom, error);
    return status ? status : pack_files(structures, top != NULL, error);
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
    for (uint32_t i = 0; i < structures->file_count; i++) {
        memory_free(structures->memory, structures->files[i].data);
        memory_free(structures->memory, structures->files[i].colours);
    }
    memory_free(structures->memory, structures->files);
    portable_scene_finish(structures->packed);
    memory_free(structures->memory, structures->packed);
    memory_free(structures->memory, structures->buffer);
    memory_free(structures->memory, structures->name);
    *structures = (struct structures){0};
}
