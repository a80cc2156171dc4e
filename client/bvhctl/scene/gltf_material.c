/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_material.h"

#include "client/bvhctl/base/files.h"

static enum bvhd_status read_colour(const struct gltf_file *file, const struct gltf_value *material, double colour[4],
                                    bool *ret_found)
{
    struct gltf_value extensions;
    struct gltf_value model = gltf_extension(material, "KHR_materials_pbrSpecularGlossiness", &extensions);
    if (cJSON_IsObject(model.json))
        return gltf_numbers(file, &model, "diffuseFactor", 4, colour, ret_found);
    model = gltf_member(material, "pbrMetallicRoughness");
    return gltf_numbers(file, &model, "baseColorFactor", 4, colour, ret_found);
}

enum bvhd_status gltf_material_read(const struct gltf_file *file, const struct gltf_value *primitive,
                                    struct import_mesh *mesh)
{
    uint32_t index = 0;
    bool is_there, is_coloured;
    double colour[4] = {1, 1, 1, 1};
    enum bvhd_status status = gltf_reference(file, primitive, "material", GLTF_MATERIALS, &index, &is_there);
    if (status)
        return status;
    struct gltf_value material = {.index = -1};
    if (is_there)
        material = gltf_item(file, GLTF_MATERIALS, index);
    const char *name = gltf_text(&material, "name");
    mesh->material = files_copy_text(file->memory, name ? name : "");
    if (!mesh->material)
        return gltf_no_memory(file);
    status = read_colour(file, &material, colour, &is_coloured);
    mesh->has_colour = is_coloured || *mesh->material;
    for (int i = 0; i < 3 && mesh->has_colour; i++)
        mesh->colour[i] = colour[i] >= 0 && colour[i] <= 1 ? (float)colour[i] : colour[i] > 1 ? 1.0f : 0.0f;
    return status;
}
