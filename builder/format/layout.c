/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/layout.h"

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
