/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/layout.h"

#include "proto/base/kind.h"
#include "proto/base/place.h"

static const struct layout *const layouts[] = {&layout_portable, &layout_lavapipe};

enum { LAYOUT_COUNT = sizeof layouts / sizeof layouts[0] };

const struct layout *layout_find(enum target target)
{
    for (int i = 0; i < LAYOUT_COUNT; i++)
        if (layouts[i]->target == target)
            return layouts[i];
    return NULL;
}

const struct layout *layout_find_name(const char *name)
{
    for (int i = 0; i < LAYOUT_COUNT; i++)
        if (strcmp(layouts[i]->name, name) == 0)
            return layouts[i];
    return NULL;
}

uint32_t layout_version(const struct layout *layout, const struct canonical *canonical)
{
    const uint32_t version = layout->version(canonical_kind(canonical));
    return version > 0 && canonical_has_micromaps(canonical) ? layout->micromap_version : version;
}

enum bvhd_status layout_check_kind(const struct layout *layout, const struct validate_subject *subject)
{
    const uint32_t type = subject->geometry->type;
    const bool has_micromap =
        kind_find(type)->vulkan_type == GEOMETRY_TRIANGLES && subject->geometry->triangles.micromap.is_given;
    if (layout->version(type) > 0 && has_micromap && layout->micromap_version == 0)
        return bvhd_error_set(subject->error, BVHD_UNSUPPORTED, VALIDATE_GEOMETRY_PLACE(subject, "triangles.micromap"),
                              "target %s has no opacity micromaps", layout->name);
    if (layout->version(type) > 0)
        return BVHD_OK;
    return bvhd_error_set(subject->error, BVHD_UNSUPPORTED, VALIDATE_GEOMETRY_PLACE(subject, "geometryType"),
                          "target %s has no %s", layout->name, kind_find(type)->noun);
}
