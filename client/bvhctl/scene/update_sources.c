/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/update_sources.h"

#include <string.h>

void update_sources_init(struct update_sources *sources, struct memory *memory)
{
    *sources = (struct update_sources){.memory = memory};
}

void update_sources_finish(struct update_sources *sources)
{
    if (!sources->memory)
        return;
    memory_free(sources->memory, sources->items);
    memory_free(sources->memory, sources->aligned);
    *sources = (struct update_sources){0};
}

/* An entry without a key is no source, and its structure is built. */
static struct assembly_source source_of(const struct manifest_entry *entry)
{
    struct assembly_source source = {0};
    source.has_key = bvhd_key_from_text(entry->key, &source.key) == BVHD_OK;
    return source;
}

static bool is_bottom_of(const struct manifest_entry *entry, const struct manifest_entry *top)
{
    return !entry->is_top && strcmp(entry->scene, top->scene) == 0;
}

static uint32_t count_bottoms(const struct manifest *manifest, const struct manifest_entry *top)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < manifest->count; i++)
        count += is_bottom_of(&manifest->entries[i], top);
    return count;
}

static void find_by_order(struct update_sources *sources, const struct manifest *manifest,
                          const struct manifest_entry *top)
{
    uint32_t found = 0;
    for (uint32_t i = 0; i < manifest->count; i++)
        if (is_bottom_of(&manifest->entries[i], top))
            sources->items[found++] = source_of(&manifest->entries[i]);
}

static struct assembly_source find_file(const struct manifest *manifest, const char *file)
{
    for (uint32_t i = 0; i < manifest->count; i++)
        if (!manifest->entries[i].is_top && strcmp(manifest->entries[i].file, file) == 0)
            return source_of(&manifest->entries[i]);
    return (struct assembly_source){0};
}

static enum bvhd_status other_scene(const char *path, uint32_t built, const struct import *import,
                                    struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_INVALID, path,
                          "it was built from another scene: it has %u bottom levels, and %.60s has %u in %u instances",
                          built, import->name, import->bottom_count, import->instance_count);
}

/* Several nodes may have one file, and so may several bottom levels. */
static enum bvhd_status find_by_nodes(struct update_sources *sources, const struct manifest *manifest,
                                      const struct manifest_entry *top, const char *path, const struct import *import,
                                      struct bvhd_error *error)
{
    struct manifest_nodes nodes;
    enum bvhd_status status = manifest_read_nodes(path, top->file, sources->memory, &nodes, error);
    if (status != BVHD_OK)
        return status;
    if (nodes.count != import->instance_count)
        status = other_scene(path, count_bottoms(manifest, top), import, error);
    for (uint32_t i = 0; i < import->instance_count && status == BVHD_OK; i++) {
        struct assembly_source *source = &sources->items[import->instances[i].bottom];
        if (!source->has_key)
            *source = find_file(manifest, nodes.files[i]);
    }
    manifest_nodes_finish(&nodes);
    return status;
}

enum bvhd_status update_sources_find(struct update_sources *sources, const struct manifest *manifest, const char *path,
                                     const struct import *import, struct bvhd_error *error)
{
    const struct manifest_entry *top = NULL;
    uint64_t room = (uint64_t)import->bottom_count + 1;
    for (uint32_t i = 0; i < manifest->count; i++)
        top = manifest->entries[i].is_top ? &manifest->entries[i] : top;
    sources->items = memory_array(sources->memory, room, sizeof *sources->items);
    sources->aligned = memory_array(sources->memory, room, sizeof *sources->aligned);
    if (!top || !sources->items || !sources->aligned)
        return bvhd_error_no_memory(error, path, "no memory for the keys of its structures");
    memset(sources->items, 0, room * sizeof *sources->items);
    sources->bottom_count = import->bottom_count;
    sources->items[import->bottom_count] = source_of(top);
    uint32_t built = count_bottoms(manifest, top);
    if (built > import->bottom_count)
        return other_scene(path, built, import, error);
    if (built < import->bottom_count)
        return find_by_nodes(sources, manifest, top, path, import, error);
    find_by_order(sources, manifest, top);
    return BVHD_OK;
}

enum bvhd_status update_sources_align(struct update_sources *sources, const struct import *import,
                                      const struct file_names *names, struct bvhd_error *error)
{
    if (import->bottom_count != sources->bottom_count)
        return other_scene(import->name, sources->bottom_count, import, error);
    for (uint32_t i = 0; i <= sources->bottom_count; i++)
        sources->aligned[i] = sources->items[names->first[i]];
    return BVHD_OK;
}

void update_sources_take(struct update_sources *sources, const struct assembly *assembly)
{
    for (uint32_t i = 0; i <= sources->bottom_count; i++)
        if (assembly->items[i].error.status == BVHD_OK)
            sources->items[i] = (struct assembly_source){true, assembly->items[i].key};
}
