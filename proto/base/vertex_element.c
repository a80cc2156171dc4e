/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/vertex_element.h"

#include <stddef.h>

static const struct vertex_element elements[] = {
#define VERTEX_FORMAT(name, value, size, alignment) {value, #name, size, alignment},
#include "proto/base/vertex_formats.def"
#undef VERTEX_FORMAT
};

const struct vertex_element *vertex_element_find(uint32_t format)
{
    for (size_t i = 0; i < sizeof elements / sizeof elements[0]; i++)
        if (elements[i].format == format)
            return &elements[i];
    return NULL;
}
