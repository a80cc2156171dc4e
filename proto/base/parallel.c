/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/parallel.h"

static void serial_for_each(const struct parallel *self, size_t count, parallel_task task, void *context)
{
    (void)self;
    for (size_t i = 0; i < count; i++)
        task(context, i);
}

const struct parallel parallel_serial = {.threads = 1, .for_each = serial_for_each};

struct wanted {
    const atomic_bool *cancel;
    parallel_task task;
    void *context;
};

static void run_if_wanted(void *context, size_t index)
{
    const struct wanted *wanted = context;
    if (!parallel_cancelled(wanted->cancel))
        wanted->task(wanted->context, index);
}

bool parallel_for_until(const struct parallel *parallel, const atomic_bool *cancel, size_t count, parallel_task task,
                        void *context)
{
    struct wanted wanted = {cancel, task, context};
    if (cancel)
        parallel_for(parallel, count, run_if_wanted, &wanted);
    else
        parallel_for(parallel, count, task, context);
    return !parallel_cancelled(cancel);
}
