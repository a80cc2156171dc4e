/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_scenes.h"

#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/gltf_nodes.h"

static const char *scene_name(const struct gltf_file *file, uint32_t index)
{
    struct gltf_value scene = gltf_item(file, GLTF_SCENES, index);
    const char *name = gltf_text(&scene, "name");
    return name ? name : "";
}

static enum bvhd_status find(const struct gltf_file *file, const char *wanted, uint32_t *ret_scene)
{
    uint32_t count = file->lists[GLTF_SCENES].count, matches = 0, first = 0;
    for (uint32_t i = 0; i < count; i++)
        if (!strcmp(scene_name(file, i), wanted)) {
            first = matches++ ? first : i;
            *ret_scene = i;
        }
    if (matches > 1)
        return gltf_refuse(file, BVHD_INVALID, NULL,
                           "%u of its scenes have the name '%.60s', from number %u to %u: choose one by its number",
                           matches, wanted, first, *ret_scene);
    if (matches)
        return BVHD_OK;
    char *end;
    unsigned long number = strtoul(wanted, &end, 10);
    if (wanted[0] < '0' || wanted[0] > '9' || *end || number >= count)
        return gltf_refuse(file, BVHD_NOT_FOUND, NULL, "it has no scene '%.60s'; it has %u, counted from 0", wanted,
                           count);
    *ret_scene = (uint32_t)number;
    return BVHD_OK;
}

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
    status = find(file, scene, ret_scene);
    if (status)
        return status;
    import->has_source = true;
    import->source_number = *ret_scene;
    import->source_name = files_copy_text(import->memory, scene_name(file, *ret_scene));
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
