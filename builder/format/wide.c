/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/wide.h"

#include <stddef.h>

void wide_finish(struct wide *wide)
{
    if (!wide)
        return;
    memory_free(wide->memory, wide->nodes);
    wide->nodes = NULL;
    wide->node_count = wide->leaf_refs = wide->depth = 0;
}
