/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_scenes.h"

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/gltf_named.h"
#include "client/bvhctl/scene/gltf_nodes.h"

enum bvhd_status gltf_scenes_choose(const struct gltf_file *file, const char *scene, struct import *import,
                                    uint32_t *ret_scene)
{
    struct gltf_value root = {.json = file->root, .index = -1};
    uint32_t ignored = 0;
    bool found;
    enum bvhd_status status = gltf_reference(file, &root, "scene", GLTF_SCENES, &ignored, &found);
    *ret_scene = (uint32_t)GLTF_ALL_SCENES;
    if (status || !scene)
        return status;
    status = gltf_named_find(file, GLTF_SCENES, scene, ret_scene);
    if (status)
        return status;
    import->has_source = true;
    import->source_number = *ret_scene;
    import->source_name = files_copy_text(import->memory, gltf_named_text(file, GLTF_SCENES, *ret_scene));
    return import->source_name ? BVHD_OK : gltf_no_memory(file);
}

enum bvhd_status gltf_scenes_check_foreign(const struct gltf_file *file, const char *scene)
{
    if (scene)
        return gltf_refuse(file, BVHD_UNSUPPORTED, NULL, "scenes cannot be chosen in files with Draco compression");
    uint32_t count = file->lists[GLTF_SCENES].count;
    file->counts->scenes += count > 1 ? count - 1 : 0;
    return BVHD_OK;
}
