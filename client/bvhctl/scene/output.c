/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/output.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "builder/format/serialized.h"

bool output_is_container(const char *path)
{
    static const char ending[] = ".bvhd";
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    size_t length = strlen(name);
    return length >= sizeof ending && strcmp(name + length - (sizeof ending - 1), ending) == 0;
}

static bool sink(void *context, struct bytes data)
{
    return files_stream_put(context, data);
}

static enum bvhd_status open_container(struct output *output, struct bvhd_error *error)
{
    static const unsigned char room[CONTAINER_HEADER];
    enum bvhd_status status = files_stream_begin(&output->stream, output->path, output->memory, error);
    if (status != BVHD_OK)
        return status;
    files_stream_put(&output->stream, (struct bytes){room, sizeof room});
    container_writer_init(&output->writer, output->memory, sink, &output->stream);
    return BVHD_OK;
}

/* A manifest that is not there, or that cannot be read, lists nothing that could be removed. */
static enum bvhd_status open_directory(struct output *output, struct bvhd_error *error)
{
    enum bvhd_status status = files_make_directory(output->path, error);
    if (status == BVHD_OK && manifest_read(output->path, output->memory, &output->before, NULL) != BVHD_OK)
        output->before = (struct manifest){0};
    return status;
}

enum bvhd_status output_open(struct output *output, const char *path, struct memory *memory, struct bvhd_error *error)
{
    *output = (struct output){.path = path, .is_container = output_is_container(path), .memory = memory};
    enum bvhd_status status = output->is_container ? open_container(output, error) : open_directory(output, error);
    if (status != BVHD_OK)
        output_close(output);
    return status;
}

static enum bvhd_status no_memory(const char *file, struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, file, "no memory to write it");
}

/* ---- A directory ---- */

static bool note_written(struct output *output, const char *file, const char *scene)
{
    if (output->written_count == output->written_capacity) {
        uint64_t capacity = output->written_capacity * 2 + 64;
        struct output_name *grown = memory_resize(output->memory, output->written, capacity * sizeof *grown);
        if (!grown)
            return false;
        output->written = grown;
        output->written_capacity = capacity;
    }
    struct output_name name = {files_copy_text(output->memory, file), files_copy_text(output->memory, scene)};
    output->written[output->written_count++] = name;
    return name.file && name.scene;
}

static enum bvhd_status write_file(struct output *output, const char *file, struct bytes content,
                                   struct bvhd_error *error)
{
    bool changed = false;
    char *path = files_join(output->memory, output->path, file);
    if (!path)
        return no_memory(file, error);
    enum bvhd_status status = files_write(path, content, output->memory, &changed, error);
    memory_free(output->memory, path);
    output->changed += changed;
    return status;
}

static int compare_written(const void *a, const void *b)
{
    const struct output_name *x = a, *y = b;
    return strcmp(x->file, y->file);
}

static bool is_written(const struct output *output, const char *file)
{
    struct output_name wanted = {(char *)(uintptr_t)file, NULL};
    return bsearch(&wanted, output->written, output->written_count, sizeof wanted, compare_written) != NULL;
}

/* Returns whether this build has written structures of the scene. Its files are sorted, those of a scene together. */
static bool has_scene(const struct output *output, const char *scene)
{
    for (uint64_t i = 0; i < output->written_count; i++)
        if ((i == 0 || strcmp(output->written[i].scene, output->written[i - 1].scene) != 0) &&
            strcmp(output->written[i].scene, scene) == 0)
            return true;
    return false;
}

/* Returns whether the name is one that a build gives to a structure of the scene. */
static bool has_our_name(const struct output *output, const struct manifest_entry *entry)
{
    char *scene = file_names_safe(entry->scene, output->memory);
    size_t length = scene ? strlen(scene) : 0, size = strlen(entry->file);
    bool is_ours = scene && size > length + 4 && strncmp(entry->file, scene, length) == 0 &&
                   entry->file[length] == '.' && strcmp(entry->file + size - 3, ".as") == 0;
    memory_free(output->memory, scene);
    return is_ours;
}

/* Returns whether the file is the structure that the manifest describes: by its size, and by the size that it says. */
static bool is_our_file(const char *path, const struct manifest_entry *entry)
{
    struct stat about;
    unsigned char header[SERIALIZED_HANDLES];
    if (lstat(path, &about) != 0 || !S_ISREG(about.st_mode) || (uint64_t)about.st_size != entry->bytes)
        return false;
    FILE *file = fopen(path, "rb");
    bool is_ours =
        file && fread(header, 1, sizeof header, file) == sizeof header && bytes_get64(header + 32) == entry->bytes;
    if (file)
        fclose(file);
    return is_ours;
}

static enum bvhd_status remove_stale(struct output *output, const struct manifest_entry *entry,
                                     struct bvhd_error *error)
{
    if (!(output->replaces_all || has_scene(output, entry->scene)) || is_written(output, entry->file) ||
        !has_our_name(output, entry))
        return BVHD_OK;
    char *path = files_join(output->memory, output->path, entry->file);
    if (!path)
        return no_memory(entry->file, error);
    enum bvhd_status status = BVHD_OK;
    if (is_our_file(path, entry)) {
        if (unlink(path) == 0)
            output->removed++;
        else
            status = bvhd_error_set(error, BVHD_IO, path, "it is stale and cannot be removed: %s", strerror(errno));
    }
    memory_free(output->memory, path);
    return status;
}

static enum bvhd_status end_directory(struct output *output, struct bytes manifest, bool is_complete,
                                      struct bvhd_error *error)
{
    uint32_t changed = output->changed;
    enum bvhd_status status = write_file(output, MANIFEST_NAME, manifest, error);
    output->changed = changed; /* structures are counted */
    if (status != BVHD_OK || !is_complete)
        return status;
    qsort(output->written, output->written_count, sizeof *output->written, compare_written);
    for (uint32_t i = 0; i < output->before.count && status == BVHD_OK; i++)
        status = remove_stale(output, &output->before.entries[i], error);
    return status;
}

/* ---- A container ---- */

static bool make_rows(struct output *output, uint64_t count)
{
    if (output->row_capacity >= count)
        return true;
    uint32_t *rows = memory_resize(output->memory, output->rows, count * sizeof *rows);
    if (!rows)
        return false;
    output->rows = rows;
    output->row_capacity = count;
    return true;
}

/* Makes the references of the top level: rows of the container instead of numbers of bottom levels. */
static uint32_t *make_references(const struct output *output, const struct assembly *assembly,
                                 const struct file_names *names)
{
    uint32_t *references = memory_array(output->memory, (uint64_t)assembly->row_count + 1, sizeof *references);
    for (uint32_t i = 0; i < assembly->row_count && references; i++)
        references[i] = output->rows[names->first[assembly->rows[i]]];
    return references;
}

/* Adds a row with these texts and references, which are copied. */
static enum bvhd_status add_row(struct output *output, const struct assembly *assembly, uint32_t index,
                                const struct container_structure *source, struct bvhd_error *error)
{
    const struct bvhd_result *item = &assembly->items[index];
    struct container_structure structure = *source;
    structure.blob = (struct bytes){item->data, item->size};
    structure.type = index == assembly->import->bottom_count ? STRUCTURE_TOP : STRUCTURE_BOTTOM;
    structure.target = (enum target)item->target;
    memcpy(&structure.key, &item->key, sizeof structure.key);
    memcpy(structure.bounds, item->bounds, sizeof structure.bounds);
    memcpy(structure.slabs, item->slabs, sizeof structure.slabs);
    output->rows[index] = output->writer.count;
    enum bvhd_status status = container_writer_add(&output->writer, &structure, error);
    if (output->stream.failure)
        bvhd_error_set(error, status, output->path, "%s", strerror(output->stream.failure));
    return status;
}

static enum bvhd_status put_row(struct output *output, const struct assembly *assembly, uint32_t index,
                                const struct file_names *names, struct bvhd_error *error)
{
    bool is_top = index == assembly->import->bottom_count;
    char *name = json_clean_text(output->memory, manifest_structure_name(assembly->import, index));
    char *scene = json_clean_text(output->memory, assembly->import->name);
    uint32_t *references = is_top ? make_references(output, assembly, names) : NULL;
    enum bvhd_status status;
    if (!make_rows(output, names->count) || !name || !scene || (is_top && !references))
        status = no_memory(names->files[index], error);
    else
        status = add_row(output, assembly, index,
                         &(struct container_structure){.file = names->files[index],
                                                       .name = name,
                                                       .scene = scene,
                                                       .references = references,
                                                       .reference_count = is_top ? assembly->row_count : 0},
                         error);
    memory_free(output->memory, references);
    memory_free(output->memory, name);
    memory_free(output->memory, scene);
    return status;
}

static enum bvhd_status end_container(struct output *output, struct bytes manifest, bool is_complete,
                                      struct bvhd_error *error)
{
    unsigned char header[CONTAINER_HEADER];
    bool changed = false;
    if (!is_complete)
        return BVHD_OK;
    enum bvhd_status status = container_writer_end(&output->writer, manifest, header, error);
    if (status == BVHD_OK || output->stream.failure)
        status = files_stream_end(&output->stream, (struct bytes){header, sizeof header}, &changed, error);
    output->changed += changed;
    return status;
}

/* ---- Both ---- */

enum bvhd_status output_put(struct output *output, const struct assembly *assembly, uint32_t index,
                            const struct file_names *names, struct bvhd_error *error)
{
    const struct bvhd_result *item = &assembly->items[index];
    if (output->is_container)
        return put_row(output, assembly, index, names, error);
    enum bvhd_status status = write_file(output, names->files[index], (struct bytes){item->data, item->size}, error);
    if (status == BVHD_OK && !note_written(output, names->files[index], assembly->import->name))
        return no_memory(names->files[index], error);
    return status;
}

enum bvhd_status output_end(struct output *output, struct bytes manifest, bool is_complete, struct bvhd_error *error)
{
    return output->is_container ? end_container(output, manifest, is_complete, error)
                                : end_directory(output, manifest, is_complete, error);
}

void output_close(struct output *output)
{
    if (!output || !output->memory)
        return;
    for (uint64_t i = 0; i < output->written_count; i++) {
        memory_free(output->memory, output->written[i].file);
        memory_free(output->memory, output->written[i].scene);
    }
    memory_free(output->memory, output->written);
    memory_free(output->memory, output->rows);
    manifest_finish(&output->before);
    container_writer_finish(&output->writer);
    files_stream_abandon(&output->stream);
    *output = (struct output){0};
}
