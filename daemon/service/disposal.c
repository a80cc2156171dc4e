/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/disposal.h"

struct disposal {
    struct pool_job job;
    struct disposals *disposals;
    struct preparation *preparation;
    uint64_t promised, promised_build;
    enum admission_class class;
};

/* Copies of up to this many bytes are freed on the loop. */
enum { FREED_AT_ONCE = 1024 * 1024 };

static void free_copy(struct pool_job *job, const struct parallel *parallel)
{
    struct disposal *disposal = (void *)job;
    (void)parallel;
    preparation_destroy(disposal->preparation);
}

static void copy_is_freed(struct pool_job *job)
{
    struct disposal *disposal = (void *)job;
    struct disposals *disposals = disposal->disposals;
    disposals->running--;
    admission_end(&disposals->admission->prepares[disposal->class], disposal->promised);
    admission_expect_end(disposals->admission, disposal->class, disposal->promised_build);
    memory_free(disposals->memory, disposal);
}

void disposals_add(struct disposals *disposals, struct preparation *preparation)
{
    struct disposal *disposal = NULL;
    if (!preparation)
        return;
    if (preparation->entry.canonical.size > FREED_AT_ONCE)
        disposal = memory_alloc(disposals->memory, sizeof *disposal);
    if (!disposal) {
        admission_end(&disposals->admission->prepares[preparation->class], preparation->promised);
        admission_expect_end(disposals->admission, preparation->class, preparation->promised_build);
        preparation_destroy(preparation);
        return;
    }
    *disposal = (struct disposal){.job = {.run = free_copy, .done = copy_is_freed, .flow = disposals->flow, .size = 1},
                                  .disposals = disposals,
                                  .preparation = preparation,
                                  .promised = preparation->promised,
                                  .promised_build = preparation->promised_build,
                                  .class = preparation->class};
    disposals->running++;
    pool_submit(disposals->pool, &disposal->job);
}
