/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/service/local.h"

#include "builder/workers.h"

enum bvhd_status local_open(struct local *local, uint32_t threads, uint64_t memory_limit, struct bvhd_error *error)
{
    *local = (struct local){0};
    memory_keep();
    memory_init(&local->memory, memory_limit);
    enum bvhd_status status = workers_create(threads, &local->workers, error);
    if (status == BVHD_OK)
        local->parallel = workers_parallel(local->workers);
    return status;
}

void local_close(struct local *local)
{
    workers_destroy(local->workers);
    local->workers = NULL;
}
