/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_kind.h"

const struct random_kind *const random_kinds[RANDOM_KINDS] = {&random_triangles, &random_boxes, &random_instances};

const struct random_kind *random_kind_find(uint32_t type)
{
    for (int i = 0; i < RANDOM_KINDS; i++)
        if (random_kinds[i]->type == type)
            return random_kinds[i];
    return NULL;
}
