/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_extensions.h"

#include <string.h>

#include "client/bvhctl/scene/gltf_accessor.h"

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

/* Finds the accessor that a member names. Returns false if there is none. */
static bool find_accessor(const struct gltf_file *file, const struct gltf_value *object, const char *name,
                          struct gltf_value *ret_accessor)
{
    struct gltf_value value = gltf_member(object, name);
    double index = cJSON_IsNumber(value.json) ? value.json->valuedouble : -1;
    if (!(index >= 0 && index < file->lists[GLTF_ACCESSORS].count))
        return false;
    *ret_accessor = gltf_item(file, GLTF_ACCESSORS, (uint32_t)index);
    return true;
}

/* Returns whether a primitive is compressed, and its accessors have no bytes of their own. */
static bool is_only_draco(const struct gltf_file *file, const struct gltf_value *primitive)
{
    struct gltf_value extensions, accessor, attributes = gltf_member(primitive, "attributes");
    if (!gltf_extension(primitive, draco, &extensions).json || !find_accessor(file, &attributes, "POSITION", &accessor))
        return false;
    return !gltf_member(&accessor, "bufferView").json && !gltf_member(&accessor, "sparse").json;
}

/* Returns the largest number that a member of an accessor may be, or 0 for no integer. */
static uint64_t number_of(const struct gltf_value *accessor, const char *name)
{
    struct gltf_value value = gltf_member(accessor, name);
    double number = cJSON_IsNumber(value.json) ? value.json->valuedouble : 0;
    return number >= 0 && number <= UINT32_MAX ? (uint64_t)number : 0;
}

/*
 * Refuses compressed primitives that assimp reads wrong: without an accessor of indices it takes the vertices in their
 * order, and indices that are too large for their type are cut.
 */
static enum bvhd_status check_primitive(const struct gltf_file *file, const struct gltf_value *primitive,
                                        enum gltf_draco *draco_kind)
{
    struct gltf_value attributes = gltf_member(primitive, "attributes"), place = gltf_member(primitive, "indices");
    struct gltf_value positions = {0}, indices;
    find_accessor(file, &attributes, "POSITION", &positions);
    if (!find_accessor(file, primitive, "indices", &indices))
        return gltf_refuse(file, BVHD_INVALID, &place, "missing: %s needs an accessor", draco);
    uint64_t type = number_of(&indices, "componentType"), vertices = number_of(&positions, "count");
    uint64_t most = type == GLTF_UINT8 ? 256 : type == GLTF_UINT16 ? 65536 : UINT32_MAX;
    place = gltf_member(&indices, "componentType");
    if (vertices > most)
        return gltf_refuse(file, BVHD_INVALID, &place, "%u is too small for %llu vertices", (unsigned)type,
                           (unsigned long long)vertices);
    *draco_kind = type == GLTF_UINT32 || *draco_kind == GLTF_DRACO_WIDE ? GLTF_DRACO_WIDE : GLTF_DRACO;
    return BVHD_OK;
}

enum bvhd_status gltf_extensions_find_draco(const struct gltf_file *file, enum gltf_draco *ret_draco)
{
    enum bvhd_status status = BVHD_OK;
    *ret_draco = GLTF_NO_DRACO;
    for (uint32_t i = 0; i < file->lists[GLTF_MESHES].count && !status; i++) {
        struct gltf_value mesh = gltf_item(file, GLTF_MESHES, i), list = gltf_member(&mesh, "primitives");
        int64_t number = 0;
        for (const cJSON *item = cJSON_IsArray(list.json) ? list.json->child : NULL; item && !status;
             item = item->next) {
            struct gltf_value primitive = gltf_element(&list, item, number++);
            if (is_only_draco(file, &primitive))
                status = check_primitive(file, &primitive, ret_draco);
        }
    }
    return status;
}

static bool goes_with_draco(const char *name)
{
    return !is_geometric(name);
}

enum bvhd_status gltf_extensions_check_draco(const struct gltf_file *file)
{
    return check_names(file, goes_with_draco, "%.80s together with KHR_draco_mesh_compression is not supported");
}
