/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import_look.h"

void import_look_finish(struct import_look *look, struct memory *memory)
{
    memory_free(memory, look->normals);
    memory_free(memory, look->texcoords);
    memory_free(memory, look->colours);
    *look = (struct import_look){0};
}
