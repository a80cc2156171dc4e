/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/service/backend_service.h"

#include <string.h>

enum { POLL_MS = 50 }; /* between reports of progress */

static void release(struct backend *backend, void *hold)
{
    (void)backend;
    bvhd_batch_destroy(hold);
}

static uint64_t count_primitives(const struct bvhd_build *build, uint32_t info)
{
    uint64_t count = 1;
    for (uint32_t i = 0; i < build->infos[info].geometryCount; i++)
        count += build->ranges[info][i].primitiveCount;
    return count;
}

/* Structures count by their primitives, because their sizes differ too much, and those under way by their progress. */
static void show_progress(const struct backend_service *service, struct bvhd_batch *batch,
                          const struct bvhd_build *build)
{
    double done = 0;
    uint64_t total = 0;
    if (!service->progress->shown)
        return;
    for (uint32_t i = 0; i < build->info_count; i++) {
        uint64_t count = count_primitives(build, i);
        total += count;
        done += (double)bvhd_batch_progress(batch, i) * (double)count;
    }
    progress_update(service->progress, (uint64_t)done, total);
}

static void wait_until_done(const struct backend_service *service, struct bvhd_batch *batch,
                            const struct bvhd_build *build)
{
    while (bvhd_batch_wait(batch, POLL_MS) == BVHD_PENDING)
        show_progress(service, batch, build);
}

/* When the connection is lost, its items have no results, and the batch as a whole has failed. */
static enum bvhd_status take_results(struct bvhd_batch *batch, const char *path, struct bvhd_result *ret_results,
                                     struct bvhd_error *error)
{
    uint32_t count = bvhd_batch_count(batch);
    for (uint32_t i = 0; i < count; i++) {
        const struct bvhd_result *result = bvhd_batch_result(batch, i);
        if (result->error.status == BVHD_UNAVAILABLE)
            return bvhd_error_set(error, BVHD_UNAVAILABLE, path, "%s", result->error.text);
    }
    for (uint32_t i = 0; i < count; i++)
        ret_results[i] = *bvhd_batch_result(batch, i);
    return BVHD_OK;
}

static enum bvhd_status build_there(struct backend *backend, const struct bvhd_build *build,
                                    struct bvhd_result *ret_results, void **ret_hold, struct bvhd_error *error)
{
    const struct backend_service *service = (const struct backend_service *)backend;
    struct bvhd_batch *batch;
    enum bvhd_status status = bvhd_batch_submit(service->connect.client, build, &batch, error);
    if (status != BVHD_OK)
        return status;
    wait_until_done(service, batch, build);
    bvhd_batch_wait_copied(batch, -1);
    status = take_results(batch, service->connect.path, ret_results, error);
    if (status != BVHD_OK)
        bvhd_batch_destroy(batch);
    else
        *ret_hold = batch;
    return status;
}

enum bvhd_status backend_service_open(struct backend_service *service, const struct options *options,
                                      struct memory *memory, struct progress *progress, struct bvhd_error *error)
{
    *service = (struct backend_service){.backend = {build_there, release}, .progress = progress};
    return connect_open(options, memory, &service->connect, error);
}

void backend_service_close(struct backend_service *service)
{
    connect_close(&service->connect);
}
