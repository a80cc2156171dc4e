/* SPDX-License-Identifier: Apache-2.0 */
#include "local.h"

enum bvhd_status local_open(struct local *local, uint32_t threads, uint64_t memory_limit, bool builds, const atomic_bool *cancel,
                            struct bvhd_error *error)
{
    *local = (struct local){0};
    memory_init(&local->memory, memory_limit);
    enum bvhd_status status = workers_create(threads, &local->workers, error);
    if (!status && builds)
        status = embree_create(&local->embree, error);
    if (status) {
        workers_destroy(local->workers);
        local->workers = NULL;
        return status;
    }
    local->build = (struct build_context){.embree = local->embree,
                                          .memory = &local->memory,
                                          .parallel = workers_parallel(local->workers),
                                          .cancel = cancel,
                                          .progress = progress_update,
                                          .progress_context = &local->progress};
    return BVHD_OK;
}

void local_close(struct local *local)
{
    embree_destroy(local->embree);
    workers_destroy(local->workers);
    local->embree = NULL;
    local->workers = NULL;
}
