/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/scene_source.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "client/bvhctl/base/files.h"

static bool ends_with(const char *name, const char *ending)
{
    size_t length = strlen(name), size = strlen(ending);
    return length > size && !strcasecmp(name + length - size, ending);
}

void scene_source_read(struct scene_source *source, const char *built, const char *scene, struct memory *memory)
{
    struct manifest manifest;
    struct bvhd_error ignored;
    *source = (struct scene_source){.memory = memory};
    if (manifest_read(built, memory, &manifest, &ignored) != BVHD_OK)
        return;
    for (uint32_t i = 0; i < manifest.count; i++) {
        const struct manifest_entry *entry = &manifest.entries[i];
        if (!entry->is_top || strcmp(entry->scene, scene) || source->file)
            continue;
        source->file = entry->source_file ? files_copy_text(memory, entry->source_file) : NULL;
        manifest_wish_init(&source->wish, entry);
    }
    source->is_gltf = source->file && (ends_with(source->file, ".gltf") || ends_with(source->file, ".glb"));
    manifest_finish(&manifest);
}

void scene_source_finish(struct scene_source *source)
{
    if (!source || !source->memory)
        return;
    memory_free(source->memory, source->file);
    *source = (struct scene_source){0};
}

static bool is_file(const char *path)
{
    struct stat file;
    return stat(path, &file) == 0 && S_ISREG(file.st_mode);
}

char *scene_source_find(const struct scene_source *source, const char *built, struct memory *memory)
{
    enum { INSIDE, BESIDE, HERE, PLACES };
    if (!source->file)
        return NULL;
    size_t length = strlen(built), size = length + strlen(source->file) + sizeof "/../";
    while (length > 1 && built[length - 1] == '/')
        length--;
    size_t folder = length;
    while (folder > 0 && built[folder - 1] != '/')
        folder--;
    char *path = memory_alloc(memory, size);
    for (int place = INSIDE; place < PLACES && path; place++) {
        int kept = place == INSIDE ? (int)length : place == BESIDE ? (int)folder : 0;
        snprintf(path, size, "%.*s%s%s", kept, built, place == INSIDE ? "/" : "", source->file);
        if (is_file(path))
            return path;
    }
    memory_free(memory, path);
    return NULL;
}
