/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/gltf_deform.h"
#include "client/bvhctl/scene/gltf_extensions.h"
#include "client/bvhctl/scene/gltf_json.h"
#include "client/bvhctl/scene/gltf_look.h"
#include "client/bvhctl/scene/gltf_mesh.h"
#include "client/bvhctl/scene/gltf_nodes.h"
#include "client/bvhctl/scene/gltf_pose.h"
#include "client/bvhctl/scene/gltf_scenes.h"
#include "client/bvhctl/scene/gltf_shutter.h"
#include "client/bvhctl/scene/import_round.h"

/* The state of the reader. */
struct reader {
    struct gltf_file file;
    struct import *import;
    const struct import_wish *wish;
    struct gltf_pose pose; /* only of a wish with a moment */
    struct gltf_forms forms;
    struct gltf_spot *spots; /* one for each instance of the walk, only of a shutter interval */
    struct form_use {
        bool has[IMPORT_SHAPES]; /* a primitive of the shape */
        uint32_t bottoms[IMPORT_SHAPES]; /* its bottom level of each shape + 1; 0: none yet */
    } * uses; /* one for each form */
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

/* Numbers the import meshes: those of the forms of each mesh, in the order of the file. */
static enum bvhd_status number_meshes(struct reader *reader)
{
    uint64_t total = 0;
    for (uint32_t i = 0; i < mesh_count(reader); i++) {
        uint32_t form = reader->forms.lists[i].first, primitives = 0;
        reader->file.counts->meshes += !form;
        enum bvhd_status status = form ? gltf_mesh_primitives(&reader->file, i, &primitives) : BVHD_OK;
        if (status)
            return status;
        for (; form; form = reader->forms.items[form - 1].next) {
            reader->forms.items[form - 1].first_mesh = (uint32_t)total;
            reader->forms.items[form - 1].mesh_count = primitives;
            total += primitives;
        }
    }
    struct import *import = reader->import;
    import->meshes = total < UINT32_MAX ? memory_array(import->memory, total + 1, sizeof *import->meshes) : NULL;
    if (!import->meshes)
        return gltf_no_memory(&reader->file);
    memset(import->meshes, 0, total * sizeof *import->meshes);
    import->mesh_count = (uint32_t)total;
    return BVHD_OK;
}

/* Reads the meshes of a form, as they are at rest. What a pose does with them is not left out. */
static enum bvhd_status read_form(struct reader *reader, uint32_t form)
{
    const struct gltf_form *from = &reader->forms.items[form];
    struct import_mesh *meshes = reader->import->meshes + from->first_mesh;
    enum bvhd_status status = gltf_mesh_read(&reader->file, from->mesh, reader->wish, meshes);
    for (uint32_t i = 0; i < from->mesh_count; i++) {
        meshes[i].counts.skins = from->is_skinned && !reader->wish->moment;
        if (reader->wish->moment)
            meshes[i].counts.morphs = 0;
    }
    return status;
}

static enum bvhd_status read_meshes(struct reader *reader)
{
    enum bvhd_status status = number_meshes(reader);
    struct import *import = reader->import;
    for (uint32_t i = 0; i < mesh_count(reader) && !status; i++)
        for (uint32_t form = reader->forms.lists[i].first; form && !status; form = reader->forms.items[form - 1].next)
            status = read_form(reader, form - 1);
    for (uint32_t i = 0; i < import->mesh_count; i++)
        import_counts_add_mesh(&import->counts, &import->meshes[i].counts);
    import_round_count(import);
    return status;
}

static void read_form_look(const struct reader *reader, struct gltf_looks *looks, uint32_t form)
{
    const struct gltf_form *from = &reader->forms.items[form];
    struct gltf_value mesh = gltf_item(&reader->file, GLTF_MESHES, from->mesh);
    struct gltf_value list = gltf_member(&mesh, "primitives");
    const cJSON *item = from->mesh_count ? list.json->child : NULL;
    for (uint32_t k = 0; k < from->mesh_count; k++, item = item->next) {
        struct gltf_value primitive = gltf_element(&list, item, k);
        gltf_look_read(looks, &primitive, reader->import->meshes + from->first_mesh + k);
    }
}

/* Reads what the meshes look like. */
static enum bvhd_status read_looks(struct reader *reader)
{
    struct gltf_looks looks;
    enum bvhd_status status = gltf_looks_init(&looks, &reader->file, reader->import);
    if (status)
        return status;
    for (uint32_t i = 0; i < mesh_count(reader); i++)
        for (uint32_t form = reader->forms.lists[i].first; form; form = reader->forms.items[form - 1].next)
            read_form_look(reader, &looks, form - 1);
    gltf_looks_finish(&looks);
    return BVHD_OK;
}

/* Moves everything as the pose says, over the shutter interval if there is one, and records the moment. */
static enum bvhd_status apply_pose(struct reader *reader)
{
    struct import *import = reader->import;
    const struct import_moment *moment = reader->wish->moment;
    enum bvhd_status status = BVHD_OK;
    import->has_moment = true;
    import->time = moment->time;
    import->has_animation = reader->pose.has_animation;
    import->animation = reader->pose.index;
    if (moment->is_shutter)
        return gltf_shutter_apply(&reader->file, &reader->pose, moment, &reader->forms, reader->spots, import);
    for (uint32_t i = 0; i < reader->forms.count && !status; i++) {
        const struct gltf_form *form = &reader->forms.items[i];
        status = gltf_deform(&reader->file, &reader->pose, form, import->meshes + form->first_mesh);
    }
    return status;
}

/* Finds which shapes the forms have. Returns how many instances there are, with one for each shape. */
static uint64_t find_shapes(struct reader *reader)
{
    const struct import *import = reader->import;
    uint64_t count = 0;
    for (uint32_t form = 0; form < reader->forms.count; form++) {
        const struct gltf_form *from = &reader->forms.items[form];
        const struct import_mesh *meshes = import->meshes + from->first_mesh;
        for (uint32_t i = 0; i < from->mesh_count; i++)
            reader->uses[form].has[meshes[i].shape] |= meshes[i].primitive_count > 0;
    }
    for (uint32_t i = 0; i < import->instance_count; i++)
        for (int shape = 0; shape < IMPORT_SHAPES; shape++)
            count += reader->uses[import->instances[i].bottom].has[shape];
    return count;
}

/*
 * A bottom level has the name of its mesh if that has one primitive, else that of the first node that has it, with an
 * ending for points and for lines.
 */
static char *name_bottom(const struct reader *reader, uint32_t form, enum import_shape shape)
{
    const struct gltf_form *from = &reader->forms.items[form];
    uint32_t node_index = from->first_node;
    struct gltf_value node = gltf_item(&reader->file, GLTF_NODES, node_index);
    const char *name = gltf_text(&node, "name"), *ending = import_shape_kinds[shape].ending;
    char unnamed[32];
    snprintf(unnamed, sizeof unnamed, "nodes[%u]", node_index);
    if (from->mesh_count == 1)
        return files_copy_text(reader->file.memory, reader->import->meshes[from->first_mesh].name);
    name = name && *name ? name : unnamed;
    uint64_t size = strlen(name) + strlen(ending) + 1;
    char *text = memory_alloc(reader->file.memory, size);
    if (text)
        snprintf(text, size, "%s%s", name, ending);
    return text;
}

static bool add_bottom(struct reader *reader, uint32_t form, enum import_shape shape)
{
    const struct gltf_form *from = &reader->forms.items[form];
    struct import *import = reader->import;
    struct import_bottom *bottom = &import->bottoms[import->bottom_count++];
    *bottom = (struct import_bottom){.name = name_bottom(reader, form, shape)};
    bottom->meshes = memory_array(import->memory, from->mesh_count, sizeof *bottom->meshes);
    for (uint32_t i = 0; i < from->mesh_count && bottom->meshes; i++)
        if (import->meshes[from->first_mesh + i].shape == shape)
            bottom->meshes[bottom->mesh_count++] = from->first_mesh + i;
    reader->uses[form].bottoms[shape] = import->bottom_count;
    return bottom->name && bottom->meshes;
}

/* Adds an instance for each shape of which its form has a primitive. */
static enum bvhd_status add_instances(struct reader *reader, struct import_instance instance,
                                      struct import_instance *instances, uint32_t *count)
{
    uint32_t form = instance.bottom;
    struct form_use *use = &reader->uses[form];
    for (int shape = 0; shape < IMPORT_SHAPES; shape++) {
        if (!use->has[shape])
            continue;
        if (!use->bottoms[shape] && !add_bottom(reader, form, (enum import_shape)shape))
            return gltf_no_memory(&reader->file);
        instance.bottom = use->bottoms[shape] - 1;
        reader->import->skipped_instances += instance.skipped;
        instances[(*count)++] = instance;
    }
    return BVHD_OK;
}

/* Replaces forms by bottom levels in the instances, and drops instances of meshes without a primitive. */
static enum bvhd_status make_bottoms(struct reader *reader)
{
    struct import *import = reader->import;
    uint64_t forms = (uint64_t)reader->forms.count * IMPORT_SHAPES, wanted = find_shapes(reader);
    struct import_instance *instances = memory_array(import->memory, wanted + 1, sizeof *instances);
    uint32_t count = 0;
    import->skipped_instances = 0;
    import->bottoms = memory_array(import->memory, forms + 1, sizeof *import->bottoms);
    enum bvhd_status status =
        import->bottoms && instances && wanted < UINT32_MAX ? BVHD_OK : gltf_no_memory(&reader->file);
    for (uint32_t i = 0; i < import->instance_count && !status; i++)
        status = add_instances(reader, import->instances[i], instances, &count);
    if (status) {
        memory_free(import->memory, instances);
        return status;
    }
    memory_free(import->memory, import->instances);
    import->instances = instances;
    import->instance_count = count;
    return BVHD_OK;
}

/* Brings the vertices of points and lines into their final order, after the pose. */
static enum bvhd_status order_round(struct reader *reader)
{
    for (uint32_t i = 0; i < reader->import->mesh_count; i++)
        if (!import_round_order(&reader->import->meshes[i], reader->file.memory))
            return gltf_no_memory(&reader->file);
    return BVHD_OK;
}

/* Makes the list of the forms of each mesh. */
static enum bvhd_status make_lists(struct reader *reader)
{
    uint64_t count = (uint64_t)mesh_count(reader) + 1;
    reader->forms.lists = memory_array(reader->file.memory, count, sizeof *reader->forms.lists);
    if (!reader->forms.lists)
        return gltf_no_memory(&reader->file);
    memset(reader->forms.lists, 0, count * sizeof *reader->forms.lists);
    return BVHD_OK;
}

/* Makes the uses of the forms, after the walk. */
static enum bvhd_status make_uses(struct reader *reader)
{
    uint64_t count = (uint64_t)reader->forms.count + 1;
    reader->uses = memory_array(reader->file.memory, count, sizeof *reader->uses);
    if (!reader->uses)
        return gltf_no_memory(&reader->file);
    memset(reader->uses, 0, count * sizeof *reader->uses);
    return BVHD_OK;
}

static void free_tables(struct reader *reader)
{
    gltf_pose_finish(&reader->file, &reader->pose);
    memory_free(reader->file.memory, reader->forms.items);
    memory_free(reader->file.memory, reader->forms.lists);
    memory_free(reader->file.memory, reader->spots);
    memory_free(reader->file.memory, reader->uses);
}

/* Counts the animations but the one that the pose is of. */
static void count_animations(const struct reader *reader)
{
    reader->file.counts->animations += reader->file.lists[GLTF_ANIMATIONS].count - reader->pose.has_animation;
}

static enum bvhd_status no_triangles(const struct reader *reader)
{
    const struct import_counts *counts = &reader->import->counts;
    if (!counts->points && !counts->lines && !counts->positionless)
        return gltf_refuse(&reader->file, BVHD_INVALID, NULL, "no triangles in it");
    return gltf_refuse(&reader->file, BVHD_INVALID, NULL,
                       "no triangles in it, only %llu points, %llu lines and %llu primitives without positions%s",
                       (unsigned long long)counts->points, (unsigned long long)counts->lines,
                       (unsigned long long)counts->positionless, import_round_hint(counts));
}

/* Reads the nodes of the chosen scenes, in the pose of the moment if there is one. */
static enum bvhd_status read_nodes(struct reader *reader)
{
    const struct import_moment *moment = reader->wish->moment;
    uint32_t chosen = 0;
    enum bvhd_status status = make_lists(reader);
    if (!status)
        status = gltf_scenes_choose(&reader->file, reader->wish->scene, reader->import, &chosen);
    if (!status && moment)
        status = gltf_pose_read(&reader->file, moment, &reader->pose);
    if (!status)
        status = gltf_nodes_walk(&reader->file, chosen, moment ? &reader->pose : NULL, reader->import, &reader->forms,
                                 moment && moment->is_shutter ? &reader->spots : NULL);
    return status ? status : make_uses(reader);
}

static enum bvhd_status read_scene(struct reader *reader)
{
    enum bvhd_status status = read_nodes(reader);
    if (!status)
        status = read_meshes(reader);
    if (!status && reader->import->wants_looks)
        status = read_looks(reader);
    if (!status && reader->wish->moment)
        status = apply_pose(reader);
    if (!status)
        status = order_round(reader);
    if (!status)
        status = make_bottoms(reader);
    if (!status && !import_round_any(reader->import))
        return no_triangles(reader);
    if (!status)
        count_animations(reader);
    reader->import->has_second_reader = !reader->wish->scene && !reader->wish->moment &&
                                        reader->file.lists[GLTF_SCENES].count == 1 &&
                                        reader->import->triangle_count > 0;
    return status;
}

/* Reads an opened file, or finds the reason to leave it to assimp. */
static enum bvhd_status read_opened(struct reader *reader, const char **ret_foreign)
{
    enum gltf_draco draco = GLTF_NO_DRACO;
    enum bvhd_status status = gltf_extensions_check(&reader->file);
    if (!status)
        status = gltf_extensions_find_draco(&reader->file, &draco);
    if (status)
        return status;
    if (draco == GLTF_NO_DRACO)
        return read_scene(reader);
    *ret_foreign = draco == GLTF_DRACO_WIDE
                       ? "KHR_draco_mesh_compression with indices of 32 bits, which assimp does not decode up to 5.4"
                       : "KHR_draco_mesh_compression, which assimp reads";
    status = gltf_extensions_check_draco(&reader->file);
    return status ? status : gltf_scenes_check_foreign(&reader->file, reader->wish->scene);
}

enum bvhd_status gltf_read(const char *path, const struct import_wish *wish, struct import_files *files,
                           struct import *import, const char **ret_foreign, struct bvhd_error *error)
{
    struct reader reader = {.import = import, .wish = wish};
    reader.file = (struct gltf_file){
        .path = path, .memory = import->memory, .files = files, .counts = &import->counts, .error = error};
    *ret_foreign = NULL;
    enum bvhd_status status = gltf_file_open(&reader.file);
    if (!status && reader.file.is_old)
        *ret_foreign = "glTF 1.0, which assimp reads";
    else if (!status)
        status = read_opened(&reader, ret_foreign);
    free_tables(&reader);
    gltf_file_close(&reader.file);
    return status;
}
