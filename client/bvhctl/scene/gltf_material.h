/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_material.h - the names and base colours of glTF materials. */
#ifndef BVHCTL_GLTF_MATERIAL_H
#define BVHCTL_GLTF_MATERIAL_H

#include "client/bvhctl/scene/gltf_json.h"

/*
 * Sets the name and the colour of a mesh by the material of its primitive. The colour is that of the metallic-roughness
 * model, which KHR_materials_unlit also has, or the diffuse colour of KHR_materials_pbrSpecularGlossiness. A material
 * with neither a name nor a colour gives none, because nobody chose it.
 */
enum bvhd_status gltf_material_read(const struct gltf_file *file, const struct gltf_value *primitive,
                                    struct import_mesh *mesh);

#endif
