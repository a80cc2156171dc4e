/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/vertex_element.h"

#include <stddef.h>

static const struct vertex_element elements[] = {
#define VERTEX_FORMAT(name, value, size, alignment) {value, #name, size, alignment},
#include "proto/base/vertex_formats.def"
#undef VERTEX_FORMAT
};

static const struct vertex_element radii[] = {
    {RADIUS_FLOAT16, "R16_SFLOAT", 2, 2},
    {RADIUS_FLOAT32, "R32_SFLOAT", 4, 4},
};

static const struct vertex_element *find(const struct vertex_element *among, size_t count, uint32_t format)
{
    for (size_t i = 0; i < count; i++)
        if (among[i].format == format)
            return &among[i];
    return NULL;
}

const struct vertex_element *vertex_element_find(uint32_t format)
{
    return find(elements, sizeof elements / sizeof elements[0], format);
}

const struct vertex_element *radius_element_find(uint32_t format)
{
    return find(radii, sizeof radii / sizeof radii[0], format);
}
