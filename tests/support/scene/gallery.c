/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/gallery.h"

#include <string.h>

const struct gallery_scene *gallery_scenes(uint32_t *ret_count)
{
    static struct gallery_scene all[GALLERY_BODIES + GALLERY_BUILDINGS + GALLERY_NATURE];
    memcpy(all, gallery_bodies, sizeof gallery_bodies);
    memcpy(all + GALLERY_BODIES, gallery_buildings, sizeof gallery_buildings);
    memcpy(all + GALLERY_BODIES + GALLERY_BUILDINGS, gallery_nature, sizeof gallery_nature);
    *ret_count = sizeof all / sizeof *all;
    return all;
}

const struct gallery_scene *gallery_find(const char *name)
{
    uint32_t count;
    const struct gallery_scene *scenes = gallery_scenes(&count);
    for (uint32_t i = 0; i < count; i++)
        if (!strcmp(scenes[i].name, name))
            return &scenes[i];
    return NULL;
}
