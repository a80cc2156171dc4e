/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/target_reader.h"

const struct target_reader *const target_readers[TARGET_READER_COUNT] = {&target_reader_portable,
                                                                         &target_reader_lavapipe};

const struct target_reader *target_reader_find(enum target target)
{
    for (int i = 0; i < TARGET_READER_COUNT; i++)
        if (target_readers[i]->target == target)
            return target_readers[i];
    return NULL;
}
