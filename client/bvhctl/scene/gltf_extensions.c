/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_extensions.h"

#include <string.h>

static const char draco[] = "KHR_draco_mesh_compression";

/* Extensions that change geometry. */
static const char *const geometric[] = {"KHR_mesh_quantization", "EXT_meshopt_compression", "KHR_meshopt_compression",
                                        "EXT_mesh_gpu_instancing"};

/* Extensions that have no effect on geometry. */
static const char *const harmless[] = {"KHR_animation_pointer",
                                       "KHR_lights_punctual",
                                       "KHR_techniques_webgl",
                                       "KHR_texture_basisu",
                                       "KHR_texture_transform",
                                       "KHR_xmp",
                                       "KHR_xmp_json_ld",
                                       "EXT_lights_ies",
                                       "EXT_lights_image_based",
                                       "EXT_texture_avif",
                                       "EXT_texture_webp",
                                       "EXT_texture_astc",
                                       "EXT_texture_procedurals",
                                       "MSFT_texture_dds",
                                       "MSFT_packing_normalRoughnessMetallic",
                                       "KHR_audio",
                                       "KHR_audio_emitter",
                                       "MSFT_packing_occlusionRoughnessMetallic",
                                       "VRM",
                                       "VRMC_vrm",
                                       "VRMC_materials_mtoon",
                                       "FB_geometry_metadata",
                                       "CESIUM_primitive_outline"};
static const char materials[] = "KHR_materials_";

static bool is_in(const char *name, const char *const *names, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!strcmp(name, names[i]))
            return true;
    return false;
}

static bool is_geometric(const char *name)
{
    return is_in(name, geometric, sizeof geometric / sizeof *geometric);
}

static bool is_known(const char *name)
{
    return is_geometric(name) || !strcmp(name, draco) || !strncmp(name, materials, sizeof materials - 1) ||
           is_in(name, harmless, sizeof harmless / sizeof *harmless);
}

/* Calls `allows` for each name in an array of the file, and refuses the first that it does not allow. */
static enum bvhd_status check_names(const struct gltf_file *file, bool (*allows)(const char *), const char *text)
{
    struct gltf_value root = {.json = file->root, .index = -1}, list;
    enum bvhd_status status = gltf_array(file, &root, "extensionsRequired", &list);
    int64_t number = 0;
    for (const cJSON *item = list.json && !status ? list.json->child : NULL; item; item = item->next) {
        struct gltf_value place = gltf_element(&list, item, number++);
        if (!cJSON_IsString(item))
            return gltf_refuse(file, BVHD_INVALID, &place, "not a text");
        if (!allows(item->valuestring))
            return gltf_refuse(file, BVHD_UNSUPPORTED, &place, text, item->valuestring);
    }
    return status;
}

enum bvhd_status gltf_extensions_check(const struct gltf_file *file)
{
    struct gltf_value root = {.json = file->root, .index = -1}, used;
    enum bvhd_status status = check_names(file, is_known, "the file requires %.80s, which is not supported");
    if (!status)
        status = gltf_array(file, &root, "extensionsUsed", &used);
    for (const cJSON *item = used.json && !status ? used.json->child : NULL; item; item = item->next)
        file->counts->extensions += cJSON_IsString(item) && !is_known(item->valuestring);
    return status;
}

/* Returns whether a primitive is compressed, and its accessors have no bytes of their own. */
static bool is_only_draco(const struct gltf_file *file, const struct gltf_value *primitive)
{
    struct gltf_value extensions, attributes = gltf_member(primitive, "attributes");
    struct gltf_value position = gltf_member(&attributes, "POSITION");
    if (!gltf_extension(primitive, draco, &extensions).json || !cJSON_IsNumber(position.json))
        return false;
    double index = position.json->valuedouble;
    if (!(index >= 0 && index < file->lists[GLTF_ACCESSORS].count))
        return false;
    struct gltf_value accessor = gltf_item(file, GLTF_ACCESSORS, (uint32_t)index);
    return !gltf_member(&accessor, "bufferView").json && !gltf_member(&accessor, "sparse").json;
}

bool gltf_extensions_need_draco(const struct gltf_file *file)
{
    for (uint32_t i = 0; i < file->lists[GLTF_MESHES].count; i++) {
        struct gltf_value mesh = gltf_item(file, GLTF_MESHES, i), list = gltf_member(&mesh, "primitives");
        for (const cJSON *item = cJSON_IsArray(list.json) ? list.json->child : NULL; item; item = item->next) {
            struct gltf_value primitive = gltf_element(&list, item, 0);
            if (is_only_draco(file, &primitive))
                return true;
        }
    }
    return false;
}

static bool goes_with_draco(const char *name)
{
    return !is_geometric(name);
}

enum bvhd_status gltf_extensions_check_draco(const struct gltf_file *file)
{
    return check_names(file, goes_with_draco, "%.80s together with KHR_draco_mesh_compression is not supported");
}
