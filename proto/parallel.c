/* SPDX-License-Identifier: Apache-2.0 */
#include "parallel.h"

static void serial_for_each(const struct parallel *self, size_t count, parallel_task task, void *context)
{
    (void)self;
    for (size_t i = 0; i < count; i++)
        task(context, i);
}

const struct parallel parallel_serial = {.threads = 1, .for_each = serial_for_each};
