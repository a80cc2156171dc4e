/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_look.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/scene/gltf_accessor.h"
#include "client/bvhctl/scene/gltf_buffer.h"
#include "client/bvhctl/scene/gltf_uri.h"
#include "client/bvhctl/scene/image.h"

enum { FEW_IMAGES = 8, LARGE_SIDE = 2048, USUAL_SIDE = 1024, MOST_IMAGES = 1 << 16, NEAREST = 9728, MOST_SETS = 15 };

static struct gltf_value find_list(const struct gltf_file *file, const char *name)
{
    struct gltf_value root = {.json = file->root, .index = -1}, list = gltf_member(&root, name);
    return cJSON_IsArray(list.json) ? list : (struct gltf_value){.index = -1};
}

static uint32_t list_size(const struct gltf_value *list)
{
    return list->json ? (uint32_t)cJSON_GetArraySize(list->json) : 0;
}

enum bvhd_status gltf_looks_init(struct gltf_looks *looks, const struct gltf_file *file, struct import *import)
{
    *looks = (struct gltf_looks){.file = *file, .import = import};
    looks->file.error = &looks->error;
    looks->textures = find_list(file, "textures");
    looks->images = find_list(file, "images");
    looks->samplers = find_list(file, "samplers");
    uint32_t count = list_size(&looks->images);
    count = count < MOST_IMAGES ? count : MOST_IMAGES;
    import->images = memory_array(import->memory, (uint64_t)count + 1, sizeof *import->images);
    looks->tried = memory_array(import->memory, (uint64_t)count + 1, sizeof *looks->tried);
    if (!import->images || !looks->tried) {
        gltf_looks_finish(looks);
        return gltf_no_memory(file);
    }
    memset(import->images, 0, count * sizeof *import->images);
    memset(looks->tried, 0, count * sizeof *looks->tried);
    import->image_count = count;
    return BVHD_OK;
}

void gltf_looks_finish(struct gltf_looks *looks)
{
    memory_free(looks->import->memory, looks->tried);
    looks->tried = NULL;
}

/* Counts something that is left out; the first error is kept for the message. */
static void leave_out(struct gltf_looks *looks)
{
    if (looks->import->looks_left_out++ == 0)
        looks->import->look_error = looks->error;
}

/* Reads a member that is the index of an element of a list. Returns an absent value if there is none. */
static struct gltf_value follow(struct gltf_looks *looks, const struct gltf_value *object, const char *name,
                                const struct gltf_value *list, uint32_t *ret_index)
{
    const struct gltf_value nothing = {.index = -1};
    struct gltf_value member = gltf_member(object, name);
    uint64_t index = 0;
    if (!member.json)
        return nothing;
    uint32_t count = list_size(list);
    if (!count || gltf_integer(&looks->file, object, name, (struct gltf_range){0, count - 1, true, 0}, &index)) {
        if (!count)
            gltf_refuse(&looks->file, BVHD_INVALID, &member, "there is no such list");
        leave_out(looks);
        return nothing;
    }
    *ret_index = (uint32_t)index;
    return gltf_element(list, cJSON_GetArrayItem(list->json, (int)index), (int64_t)index);
}

/* ---- images ---- */

/* Decodes an image from the bytes of its file. */
static enum bvhd_status decode(struct gltf_looks *looks, const struct gltf_value *place, struct bytes bytes,
                               struct import_image *ret_image)
{
    uint32_t limit = looks->import->image_count > FEW_IMAGES ? USUAL_SIDE : LARGE_SIDE;
    struct bvhd_error error = {0};
    enum bvhd_status status = image_decode(bytes, limit, looks->file.memory, ret_image, &error);
    if (status != BVHD_OK)
        gltf_refuse(&looks->file, status, place, "%s", error.text);
    return status;
}

static enum bvhd_status decode_uri(struct gltf_looks *looks, const struct gltf_value *place, const char *uri,
                                   struct import_image *ret_image)
{
    struct gltf_file *file = &looks->file;
    enum gltf_uri_kind kind = gltf_uri_kind(uri);
    if (kind == GLTF_URI_REMOTE)
        return gltf_refuse(file, BVHD_UNSUPPORTED, place, "only files and data: URIs are read, not '%.60s'", uri);
    if (kind == GLTF_URI_DATA) {
        unsigned char *data;
        uint64_t size;
        enum bvhd_status status = gltf_uri_decode(uri, file->memory, &data, &size);
        if (status != BVHD_OK)
            return gltf_refuse(file, status, place, "not a data: URI with base64");
        status = decode(looks, place, (struct bytes){data, size}, ret_image);
        memory_free(file->memory, data);
        return status;
    }
    struct bytes mapped;
    char *path = gltf_uri_path(file->path, uri, file->memory);
    enum bvhd_status status = path ? import_files_map(file->files, path, &mapped, file->error) : gltf_no_memory(file);
    memory_free(file->memory, path);
    if (status != BVHD_OK)
        return status;
    status = decode(looks, place, mapped, ret_image);
    import_files_unmap(mapped);
    return status;
}

static enum bvhd_status load_image(struct gltf_looks *looks, const struct gltf_value *image,
                                   struct import_image *ret_image)
{
    struct gltf_file *file = &looks->file;
    struct gltf_value uri = gltf_member(image, "uri");
    if (cJSON_IsString(uri.json))
        return decode_uri(looks, &uri, uri.json->valuestring, ret_image);
    uint32_t index = 0;
    bool found;
    struct gltf_view view;
    enum bvhd_status status = gltf_reference(file, image, "bufferView", GLTF_BUFFER_VIEWS, &index, &found);
    if (status == BVHD_OK && !found)
        return gltf_refuse(file, BVHD_INVALID, image, "it has neither a uri nor a bufferView");
    if (status == BVHD_OK)
        status = gltf_buffer_view(file, index, &view);
    return status == BVHD_OK ? decode(looks, image, view.bytes, ret_image) : status;
}

/* Decodes an image once. Returns whether it is there. */
static bool need_image(struct gltf_looks *looks, const struct gltf_value *image, uint32_t index)
{
    if (index >= looks->import->image_count)
        return false;
    if (!looks->tried[index] && load_image(looks, image, &looks->import->images[index]) != BVHD_OK)
        leave_out(looks);
    looks->tried[index] = true;
    return looks->import->images[index].rgba != NULL;
}

/* ---- textures ---- */

static enum import_wrap read_wrap(const struct gltf_value *sampler, const char *name)
{
    struct gltf_value wrap = gltf_member(sampler, name);
    double value = cJSON_IsNumber(wrap.json) ? wrap.json->valuedouble : IMPORT_REPEAT;
    return value == IMPORT_CLAMP ? IMPORT_CLAMP : value == IMPORT_MIRROR ? IMPORT_MIRROR : IMPORT_REPEAT;
}

static void read_sampler(struct gltf_looks *looks, const struct gltf_value *texture, struct import_look *look)
{
    uint32_t index;
    struct gltf_value sampler = follow(looks, texture, "sampler", &looks->samplers, &index);
    struct gltf_value filter = gltf_member(&sampler, "magFilter");
    look->wrap[0] = read_wrap(&sampler, "wrapS");
    look->wrap[1] = read_wrap(&sampler, "wrapT");
    look->is_pixelated = cJSON_IsNumber(filter.json) && filter.json->valuedouble == NEAREST;
}

/* How texture coordinates are changed before they are used: KHR_texture_transform. */
struct transform {
    double offset[2], rotation, scale[2];
};

static void read_transform(struct gltf_looks *looks, const struct gltf_value *extension, struct transform *transform)
{
    struct gltf_value rotation = gltf_member(extension, "rotation");
    if (gltf_numbers(&looks->file, extension, "offset", 2, transform->offset, NULL) != BVHD_OK ||
        gltf_numbers(&looks->file, extension, "scale", 2, transform->scale, NULL) != BVHD_OK)
        leave_out(looks);
    if (cJSON_IsNumber(rotation.json) && isfinite(rotation.json->valuedouble))
        transform->rotation = rotation.json->valuedouble;
}

static void apply_transform(const struct transform *transform, float *texcoords, uint32_t count)
{
    double c = cos(transform->rotation), s = sin(transform->rotation);
    for (size_t i = 0; i < count; i++) {
        double u = transform->scale[0] * (double)texcoords[2 * i],
               v = transform->scale[1] * (double)texcoords[2 * i + 1];
        texcoords[2 * i] = (float)(c * u + s * v + transform->offset[0]);
        texcoords[2 * i + 1] = (float)(-s * u + c * v + transform->offset[1]);
    }
}

/* ---- attributes of vertices ---- */

/*
 * Reads an attribute, as `components` floats for each vertex; a fourth component that is missing is 1. Returns NULL if
 * the primitive does not have it, or has it wrong, which is counted.
 */
static float *read_attribute(struct gltf_looks *looks, const struct gltf_value *primitive, const char *name,
                             uint32_t fewest, uint32_t components, const struct import_mesh *mesh)
{
    struct gltf_file *file = &looks->file;
    struct gltf_value attributes = gltf_member(primitive, "attributes");
    struct gltf_accessor accessor;
    uint32_t index;
    bool found = false;
    if (gltf_reference(file, &attributes, name, GLTF_ACCESSORS, &index, &found) != BVHD_OK) {
        leave_out(looks);
        return NULL;
    }
    if (!found)
        return NULL;
    struct gltf_value place = gltf_item(file, GLTF_ACCESSORS, index);
    enum bvhd_status status = gltf_accessor_open(file, index, &accessor);
    if (status == BVHD_OK && (accessor.components < fewest || accessor.components > components ||
                              accessor.elements.count != mesh->vertex_count))
        status = gltf_refuse(file, BVHD_INVALID, &place, "%u components of %u vertices do not fit %s of %u vertices",
                             accessor.components, accessor.elements.count, name, mesh->vertex_count);
    float *floats =
        status == BVHD_OK ? memory_array(file->memory, (uint64_t)mesh->vertex_count + 1, 4 * sizeof *floats) : NULL;
    if (status == BVHD_OK)
        status = floats ? gltf_accessor_floats(file, &accessor, floats) : gltf_no_memory(file);
    if (status != BVHD_OK) {
        memory_free(file->memory, floats);
        leave_out(looks);
        return NULL;
    }
    for (size_t i = mesh->vertex_count; accessor.components < components && i-- > 0;) {
        memmove(floats + i * components, floats + i * accessor.components, accessor.components * sizeof *floats);
        floats[i * components + components - 1] = 1;
    }
    return floats;
}

static void read_texture(struct gltf_looks *looks, const struct gltf_value *primitive, const struct gltf_value *info,
                         struct import_mesh *mesh)
{
    struct import_look *look = &mesh->look;
    struct gltf_value extensions, changed = gltf_extension(info, "KHR_texture_transform", &extensions);
    uint32_t index = 0, image_index = 0;
    uint64_t set = 0;
    const struct gltf_range sets = {0, MOST_SETS, false, 0};
    struct gltf_value texture = follow(looks, info, "index", &looks->textures, &index);
    struct gltf_value image = follow(looks, &texture, "source", &looks->images, &image_index);
    struct gltf_value other = gltf_member(&changed, "texCoord");
    if (gltf_integer(&looks->file, other.json ? &changed : info, "texCoord", sets, &set) != BVHD_OK)
        leave_out(looks);
    if (texture.json && !gltf_member(&texture, "source").json) {
        gltf_refuse(&looks->file, BVHD_UNSUPPORTED, &texture, "it has no image as PNG or JPEG");
        leave_out(looks);
    }
    if (!image.json || !need_image(looks, &image, image_index))
        return;
    char name[16];
    snprintf(name, sizeof name, "TEXCOORD_%u", (unsigned)set);
    look->texcoords = read_attribute(looks, primitive, name, 2, 2, mesh);
    if (!look->texcoords)
        return;
    struct transform transform = {.scale = {1, 1}};
    read_transform(looks, &changed, &transform);
    apply_transform(&transform, look->texcoords, mesh->vertex_count);
    read_sampler(looks, &texture, look);
    look->has_image = true;
    look->image = image_index;
}

/* ---- materials ---- */

static void read_factor(struct gltf_looks *looks, const struct gltf_value *model, const char *name,
                        struct import_look *look)
{
    double factor[4] = {1, 1, 1, 1};
    bool found = false;
    gltf_numbers(&looks->file, model, name, 4, factor, &found); /* gltf_material_read has refused wrong ones */
    for (int i = 0; i < 4; i++)
        look->factor[i] = factor[i] >= 0 && factor[i] <= 1 ? (float)factor[i] : factor[i] > 1 ? 1.0f : 0.0f;
    look->is_coloured |= found;
}

/* Blended surfaces are drawn as if they had holes where they are more transparent than opaque. */
static void read_alpha(const struct gltf_value *material, struct import_look *look)
{
    static const float half = 0.5f;
    const char *mode = gltf_text(material, "alphaMode");
    struct gltf_value cutoff = gltf_member(material, "alphaCutoff");
    if (!mode || !strcmp(mode, "OPAQUE"))
        return;
    if (!strcmp(mode, "BLEND")) {
        look->cutoff = look->has_image ? half : 0;
        look->factor[3] = 1;
        return;
    }
    double value = cJSON_IsNumber(cutoff.json) ? cutoff.json->valuedouble : (double)half;
    look->cutoff = value > 0 ? (float)fmin(value, 1) : 0;
}

static void read_material(struct gltf_looks *looks, const struct gltf_value *primitive, struct import_mesh *mesh)
{
    uint32_t index;
    bool is_there = false;
    if (gltf_reference(&looks->file, primitive, "material", GLTF_MATERIALS, &index, &is_there) != BVHD_OK || !is_there)
        return;
    struct gltf_value material = gltf_item(&looks->file, GLTF_MATERIALS, index), extensions;
    struct gltf_value glossy = gltf_extension(&material, "KHR_materials_pbrSpecularGlossiness", &extensions);
    bool is_glossy = cJSON_IsObject(glossy.json);
    struct gltf_value model = is_glossy ? glossy : gltf_member(&material, "pbrMetallicRoughness");
    struct gltf_value texture = gltf_member(&model, is_glossy ? "diffuseTexture" : "baseColorTexture");
    read_factor(looks, &model, is_glossy ? "diffuseFactor" : "baseColorFactor", &mesh->look);
    if (texture.json && mesh->shape == IMPORT_TRIANGLES)
        read_texture(looks, primitive, &texture, mesh);
    read_alpha(&material, &mesh->look);
}

/* Normals that are not unit vectors, as quantized ones are not, become so; broken ones become 0. */
static void normalize(float *normals, uint32_t count)
{
    for (size_t i = 0; i < count; i++) {
        float *n = normals + 3 * i;
        double length = sqrt((double)n[0] * (double)n[0] + (double)n[1] * (double)n[1] + (double)n[2] * (double)n[2]);
        for (int k = 0; k < 3; k++)
            n[k] = length > 0 && isfinite(length) ? (float)((double)n[k] / length) : 0;
    }
}

void gltf_look_read(struct gltf_looks *looks, const struct gltf_value *primitive, struct import_mesh *mesh)
{
    struct import_look *look = &mesh->look;
    *look = (struct import_look){
        .is_coloured = mesh->has_colour, .wrap = {IMPORT_REPEAT, IMPORT_REPEAT}, .factor = {1, 1, 1, 1}};
    if (mesh->primitive_count == 0)
        return;
    read_material(looks, primitive, mesh);
    if (mesh->shape == IMPORT_TRIANGLES)
        look->normals = read_attribute(looks, primitive, "NORMAL", 3, 3, mesh);
    look->colours = read_attribute(looks, primitive, "COLOR_0", 3, 4, mesh);
    if (look->normals)
        normalize(look->normals, mesh->vertex_count);
    look->is_coloured |= look->has_image || look->colours;
}
