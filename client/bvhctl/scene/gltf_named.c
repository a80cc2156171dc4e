/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_named.h"

#include <stdlib.h>
#include <string.h>

const char *gltf_named_text(const struct gltf_file *file, enum gltf_list_name list, uint32_t index)
{
    struct gltf_value item = gltf_item(file, list, index);
    const char *name = gltf_text(&item, "name");
    return name ? name : "";
}

enum bvhd_status gltf_named_find(const struct gltf_file *file, enum gltf_list_name list, const char *wanted,
                                 uint32_t *ret_index)
{
    const char *items = gltf_list_text(list);
    int singular = (int)strlen(items) - 1; /* without the "s" */
    uint32_t count = file->lists[list].count, matches = 0, first = 0;
    for (uint32_t i = 0; i < count; i++)
        if (!strcmp(gltf_named_text(file, list, i), wanted)) {
            first = matches++ ? first : i;
            *ret_index = i;
        }
    if (matches > 1)
        return gltf_refuse(file, BVHD_INVALID, NULL,
                           "%u of its %s have the name '%.60s', from number %u to %u: choose one by its number",
                           matches, items, wanted, first, *ret_index);
    if (matches)
        return BVHD_OK;
    char *end;
    unsigned long number = strtoul(wanted, &end, 10);
    if (wanted[0] < '0' || wanted[0] > '9' || *end || number >= count)
        return gltf_refuse(file, BVHD_NOT_FOUND, NULL, "it has no %.*s '%.60s'; it has %u, counted from 0", singular,
                           items, wanted, count);
    *ret_index = (uint32_t)number;
    return BVHD_OK;
}
