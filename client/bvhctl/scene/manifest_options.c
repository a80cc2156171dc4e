/* SPDX-License-Identifier: Apache-2.0 */
/* manifest_options.c - reads what updates need of a manifest: the options of the build, and the nodes. */
#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/base/options_table.h"
#include "client/bvhctl/scene/manifest_internal.h"

/* ---- options ---- */

/* Finds the value of a name. *ret_known becomes false if there is no such name. */
static uint32_t find_value(const struct name_value *names, const cJSON *name, bool *ret_known)
{
    for (; cJSON_IsString(name) && names->name; names++)
        if (!strcmp(names->name, name->valuestring))
            return names->value;
    *ret_known = false;
    return 0;
}

/* A member that is missing or null has the value `fallback`. */
static uint32_t read_name(const cJSON *options, const char *member, const struct name_value *names, uint32_t fallback,
                          bool *ret_known)
{
    const cJSON *name = cJSON_GetObjectItemCaseSensitive(options, member);
    return !name || cJSON_IsNull(name) ? fallback : find_value(names, name, ret_known);
}

static uint32_t read_names(const cJSON *options, const char *member, const struct name_value *names, bool *ret_known)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(options, member), *name;
    uint32_t value = 0;
    *ret_known &= cJSON_IsArray(list) != 0;
    cJSON_ArrayForEach(name, list) value |= find_value(names, name, ret_known);
    return value;
}

struct manifest_options manifest_read_options(const struct cJSON *root)
{
    const cJSON *options = cJSON_GetObjectItemCaseSensitive(root, "options");
    const cJSON *rays = cJSON_GetObjectItemCaseSensitive(options, "rays_per_primitive");
    struct manifest_options found = {.are_known = cJSON_IsObject(options) != 0};
    bool *known = &found.are_known;
    found.build.target = (enum target)read_name(options, "target", target_names, 0, known);
    found.build.quality = (enum build_quality)read_name(options, "quality", quality_names, QUALITY_UNSPECIFIED, known);
    found.build.builder = (enum build_builder)read_name(options, "builder", builder_names, BUILDER_OWN, known);
    found.build.layout_flags = read_names(options, "layout", layout_flag_names, known);
    found.build_flags = read_names(options, "flags", build_flag_names, known);
    found.geometry_flags = read_names(options, "geometry_flags", geometry_flag_names, known);
    found.rays = cJSON_IsNumber(rays) && rays->valuedouble > 0 && isfinite(rays->valuedouble) ? rays->valuedouble : 0;
    found.are_known &= found.build.target != 0;
    return found;
}

/* ---- nodes ---- */

static enum bvhd_status no_nodes(const char *path, const char *top, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CORRUPT, path, "the manifest does not say which files the nodes of %.60s have",
                          top);
}

static const cJSON *find_top(const cJSON *root, const char *top)
{
    const cJSON *object, *list = cJSON_GetObjectItemCaseSensitive(root, "structures");
    cJSON_ArrayForEach(object, list)
    {
        const cJSON *file = cJSON_GetObjectItemCaseSensitive(object, "file");
        if (cJSON_IsString(file) && !strcmp(file->valuestring, top))
            return object;
    }
    return NULL;
}

static enum bvhd_status take_nodes(const cJSON *root, const char *path, const char *top, struct manifest_nodes *nodes,
                                   struct bvhd_error *error)
{
    const cJSON *list = cJSON_GetObjectItemCaseSensitive(find_top(root, top), "nodes"), *node;
    if (!cJSON_IsArray(list))
        return no_nodes(path, top, error);
    nodes->files = memory_array(nodes->memory, (uint64_t)cJSON_GetArraySize(list) + 1, sizeof *nodes->files);
    if (!nodes->files)
        return bvhd_error_no_memory(error, path, "no memory for the nodes of the manifest");
    cJSON_ArrayForEach(node, list)
    {
        const cJSON *file = cJSON_GetObjectItemCaseSensitive(node, "file");
        if (!cJSON_IsString(file))
            return no_nodes(path, top, error);
        nodes->files[nodes->count] = files_copy_text(nodes->memory, file->valuestring);
        if (!nodes->files[nodes->count++])
            return bvhd_error_no_memory(error, path, "no memory for the nodes of the manifest");
    }
    return BVHD_OK;
}

enum bvhd_status manifest_read_nodes(const char *path, const char *top, struct memory *memory,
                                     struct manifest_nodes *ret_nodes, struct bvhd_error *error)
{
    struct built built;
    struct built_bytes text;
    char where[BVHD_WHERE_SIZE];
    struct manifest_nodes nodes = {.memory = memory};
    enum bvhd_status status = built_open(path, memory, &built, error);
    if (status != BVHD_OK)
        return status;
    status = built_manifest(&built, &text, where, error);
    if (status == BVHD_OK) {
        cJSON *root = cJSON_ParseWithLength((const char *)text.bytes.data, text.bytes.size);
        status = root ? take_nodes(root, path, top, &nodes, error) : no_nodes(path, top, error);
        cJSON_Delete(root);
        memory_free(memory, text.owned);
    }
    built_close(&built);
    if (status != BVHD_OK)
        manifest_nodes_finish(&nodes);
    else
        *ret_nodes = nodes;
    return status;
}

void manifest_nodes_finish(struct manifest_nodes *nodes)
{
    if (!nodes || !nodes->memory)
        return;
    for (uint32_t i = 0; i < nodes->count; i++)
        memory_free(nodes->memory, nodes->files[i]);
    memory_free(nodes->memory, nodes->files);
    *nodes = (struct manifest_nodes){0};
}
