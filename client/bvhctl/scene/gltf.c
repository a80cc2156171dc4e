/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/gltf_extensions.h"
#include "client/bvhctl/scene/gltf_json.h"
#include "client/bvhctl/scene/gltf_look.h"
#include "client/bvhctl/scene/gltf_mesh.h"
#include "client/bvhctl/scene/gltf_nodes.h"
#include "client/bvhctl/scene/gltf_scenes.h"

/* The state of the reader. Arrays have an entry for each mesh of the file. */
struct reader {
    struct gltf_file file;
    struct import *import;
    struct gltf_use *uses;
    uint32_t *first; /* the first import mesh of a mesh that is used */
    uint32_t *counts; /* and how many there are */
    uint32_t *bottoms; /* its bottom level + 1; 0: none yet */
};

bool gltf_is_file(const char *path)
{
    char magic[4] = "";
    const char *dot = strrchr(path, '.');
    if (dot && (!strcasecmp(dot, ".gltf") || !strcasecmp(dot, ".glb")))
        return true;
    FILE *file = files_is_directory(path) ? NULL : fopen(path, "rbe");
    bool has_magic = file && fread(magic, 1, sizeof magic, file) == sizeof magic && !memcmp(magic, "glTF", 4);
    if (file)
        fclose(file);
    return has_magic;
}

static uint32_t mesh_count(const struct reader *reader)
{
    return reader->file.lists[GLTF_MESHES].count;
}

/* Numbers the import meshes: those of meshes that are used, in the order of the file. */
static enum bvhd_status number_meshes(struct reader *reader)
{
    uint64_t total = 0;
    for (uint32_t i = 0; i < mesh_count(reader); i++) {
        reader->file.counts->meshes += !reader->uses[i].is_used;
        if (!reader->uses[i].is_used)
            continue;
        enum bvhd_status status = gltf_mesh_primitives(&reader->file, i, &reader->counts[i]);
        if (status)
            return status;
        reader->first[i] = (uint32_t)total;
        total += reader->counts[i];
    }
    struct import *import = reader->import;
    import->meshes = total < UINT32_MAX ? memory_array(import->memory, total + 1, sizeof *import->meshes) : NULL;
    if (!import->meshes)
        return gltf_no_memory(&reader->file);
    memset(import->meshes, 0, total * sizeof *import->meshes);
    import->mesh_count = (uint32_t)total;
    return BVHD_OK;
}

static enum bvhd_status read_meshes(struct reader *reader)
{
    enum bvhd_status status = number_meshes(reader);
    struct import *import = reader->import;
    for (uint32_t i = 0; i < mesh_count(reader) && !status; i++) {
        if (reader->uses[i].is_used)
            status = gltf_mesh_read(&reader->file, i, import->meshes + reader->first[i]);
        for (uint32_t k = 0; k < reader->counts[i]; k++)
            import->meshes[reader->first[i] + k].counts.skins = reader->uses[i].is_skinned;
    }
    for (uint32_t i = 0; i < import->mesh_count; i++) {
        import->triangle_count += import->meshes[i].triangle_count;
        import_counts_add_mesh(&import->counts, &import->meshes[i].counts);
    }
    return status;
}

/* Reads what the meshes look like. */
static enum bvhd_status read_looks(struct reader *reader)
{
    struct gltf_looks looks;
    enum bvhd_status status = gltf_looks_init(&looks, &reader->file, reader->import);
    if (status)
        return status;
    for (uint32_t i = 0; i < mesh_count(reader); i++) {
        struct gltf_value mesh = gltf_item(&reader->file, GLTF_MESHES, i), list = gltf_member(&mesh, "primitives");
        const cJSON *item = reader->counts[i] ? list.json->child : NULL;
        for (uint32_t k = 0; k < reader->counts[i]; k++, item = item->next) {
            struct gltf_value primitive = gltf_element(&list, item, k);
            gltf_look_read(&looks, &primitive, reader->import->meshes + reader->first[i] + k);
        }
    }
    gltf_looks_finish(&looks);
    return BVHD_OK;
}

static bool has_triangles(const struct reader *reader, uint32_t mesh)
{
    for (uint32_t i = 0; i < reader->counts[mesh]; i++)
        if (reader->import->meshes[reader->first[mesh] + i].triangle_count)
            return true;
    return false;
}

/* A bottom level has the name of its mesh if that has one primitive, else that of the first node that has it. */
static char *name_bottom(const struct reader *reader, uint32_t mesh)
{
    uint32_t node_index = reader->uses[mesh].first_node;
    struct gltf_value node = gltf_item(&reader->file, GLTF_NODES, node_index);
    const char *name = gltf_text(&node, "name");
    char unnamed[32];
    snprintf(unnamed, sizeof unnamed, "nodes[%u]", node_index);
    if (reader->counts[mesh] == 1)
        name = reader->import->meshes[reader->first[mesh]].name;
    return files_copy_text(reader->file.memory, name && *name ? name : unnamed);
}

static bool add_bottom(struct reader *reader, uint32_t mesh)
{
    struct import *import = reader->import;
    struct import_bottom *bottom = &import->bottoms[import->bottom_count++];
    *bottom = (struct import_bottom){.mesh_count = reader->counts[mesh], .name = name_bottom(reader, mesh)};
    bottom->meshes = memory_array(import->memory, bottom->mesh_count, sizeof *bottom->meshes);
    for (uint32_t i = 0; i < bottom->mesh_count && bottom->meshes; i++)
        bottom->meshes[i] = reader->first[mesh] + i;
    reader->bottoms[mesh] = import->bottom_count;
    return bottom->name && bottom->meshes;
}

/* Replaces meshes by bottom levels in the instances, and drops instances of meshes without a triangle. */
static enum bvhd_status make_bottoms(struct reader *reader)
{
    struct import *import = reader->import;
    uint32_t kept = 0;
    uint64_t skipped = 0;
    import->bottoms = memory_array(import->memory, (uint64_t)mesh_count(reader) + 1, sizeof *import->bottoms);
    if (!import->bottoms)
        return gltf_no_memory(&reader->file);
    for (uint32_t i = 0; i < import->instance_count; i++) {
        struct import_instance instance = import->instances[i];
        uint32_t mesh = instance.bottom;
        if (!has_triangles(reader, mesh))
            continue;
        if (!reader->bottoms[mesh] && !add_bottom(reader, mesh))
            return gltf_no_memory(&reader->file);
        instance.bottom = reader->bottoms[mesh] - 1;
        skipped += instance.skipped;
        import->instances[kept++] = instance;
    }
    import->instance_count = kept;
    import->skipped_instances = skipped;
    return BVHD_OK;
}

static bool make_tables(struct reader *reader)
{
    uint64_t count = (uint64_t)mesh_count(reader) + 1;
    struct memory *memory = reader->file.memory;
    reader->uses = memory_array(memory, count, sizeof *reader->uses);
    reader->first = memory_array(memory, count, sizeof *reader->first);
    reader->counts = memory_array(memory, count, sizeof *reader->counts);
    reader->bottoms = memory_array(memory, count, sizeof *reader->bottoms);
    if (!reader->uses || !reader->first || !reader->counts || !reader->bottoms)
        return false;
    memset(reader->uses, 0, count * sizeof *reader->uses);
    memset(reader->first, 0, count * sizeof *reader->first);
    memset(reader->counts, 0, count * sizeof *reader->counts);
    memset(reader->bottoms, 0, count * sizeof *reader->bottoms);
    return true;
}

static void free_tables(struct reader *reader)
{
    memory_free(reader->file.memory, reader->uses);
    memory_free(reader->file.memory, reader->first);
    memory_free(reader->file.memory, reader->counts);
    memory_free(reader->file.memory, reader->bottoms);
}

static void count_animations(const struct gltf_file *file)
{
    struct gltf_value root = {.json = file->root, .index = -1}, animations = gltf_member(&root, "animations");
    file->counts->animations += cJSON_IsArray(animations.json) ? (uint64_t)cJSON_GetArraySize(animations.json) : 0;
}

static enum bvhd_status no_triangles(const struct reader *reader)
{
    const struct import_counts *counts = &reader->import->counts;
    if (!counts->points && !counts->lines && !counts->positionless)
        return gltf_refuse(&reader->file, BVHD_INVALID, NULL, "no triangles in it");
    return gltf_refuse(&reader->file, BVHD_INVALID, NULL,
                       "no triangles in it, only %llu points, %llu lines and %llu primitives without positions",
                       (unsigned long long)counts->points, (unsigned long long)counts->lines,
                       (unsigned long long)counts->positionless);
}

static enum bvhd_status read_scene(struct reader *reader, const char *scene)
{
    uint32_t chosen = 0;
    enum bvhd_status status = make_tables(reader) ? BVHD_OK : gltf_no_memory(&reader->file);
    if (!status)
        status = gltf_scenes_choose(&reader->file, scene, reader->import, &chosen);
    if (!status)
        status = gltf_nodes_walk(&reader->file, chosen, reader->import, reader->uses);
    if (!status)
        status = read_meshes(reader);
    if (!status && reader->import->wants_looks)
        status = read_looks(reader);
    if (!status)
        status = make_bottoms(reader);
    if (!status && reader->import->triangle_count == 0)
        return no_triangles(reader);
    count_animations(&reader->file);
    reader->import->has_second_reader = !scene && reader->file.lists[GLTF_SCENES].count == 1;
    return status;
}

/* Reads an opened file, or finds the reason to leave it to assimp. */
static enum bvhd_status read_opened(struct reader *reader, const char *scene, const char **ret_foreign)
{
    enum gltf_draco draco = GLTF_NO_DRACO;
    enum bvhd_status status = gltf_extensions_check(&reader->file);
    if (!status)
        status = gltf_extensions_find_draco(&reader->file, &draco);
    if (status)
        return status;
    if (draco == GLTF_NO_DRACO)
        return read_scene(reader, scene);
    *ret_foreign = draco == GLTF_DRACO_WIDE
                       ? "KHR_draco_mesh_compression with indices of 32 bits, which assimp does not decode up to 5.4"
                       : "KHR_draco_mesh_compression, which assimp reads";
    status = gltf_extensions_check_draco(&reader->file);
    return status ? status : gltf_scenes_check_foreign(&reader->file, scene);
}

enum bvhd_status gltf_read(const char *path, const char *scene, struct import_files *files, struct import *import,
                           const char **ret_foreign, struct bvhd_error *error)
{
    struct reader reader = {.import = import};
    reader.file = (struct gltf_file){
        .path = path, .memory = import->memory, .files = files, .counts = &import->counts, .error = error};
    *ret_foreign = NULL;
    enum bvhd_status status = gltf_file_open(&reader.file);
    if (!status && reader.file.is_old)
        *ret_foreign = "glTF 1.0, which assimp reads";
    else if (!status)
        status = read_opened(&reader, scene, ret_foreign);
    free_tables(&reader);
    gltf_file_close(&reader.file);
    return status;
}
