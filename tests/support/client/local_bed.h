/* SPDX-License-Identifier: Apache-2.0 */
/*
 * local_bed.h - a client that builds in the test's own process, and meshes for it. For tests of the client library.
 * The program needs libbvhd_build, which it finds by the path that the dependency local_build gives it.
 */
#ifndef BVHD_LOCAL_BED_H
#define BVHD_LOCAL_BED_H

#include <pthread.h>

#include <bvhd/bvhd.h>

#include "client/library.h"
#include "tests/support/open_descriptors.h"
#include "tests/support/scene/terrain.h"

enum { LOCAL_BED_MESHES = 8 };

struct local_bed {
    struct bvhd_client *client;
    struct terrain meshes[LOCAL_BED_MESHES]; /* of 2,000 triangles, each different */
    int descriptors; /* number that were open before */
    uint64_t live; /* bytes of library_memory that were live before */
};

/* Starts a client with these options, whose struct_size is set here. */
static inline void local_bed_start_with(struct local_bed *bed, struct bvhd_client_options options)
{
    struct bvhd_error error;
    bed->descriptors = open_descriptors();
    bed->live = library_memory.live;
    options.struct_size = sizeof options;
    if (bvhd_client_create(&options, &bed->client, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    for (uint32_t i = 0; i < LOCAL_BED_MESHES; i++)
        terrain_init(&bed->meshes[i], 2000, i + 1);
}

/* Starts a client that always builds here, on `threads` threads of its own. */
static inline void local_bed_start(struct local_bed *bed, uint32_t threads)
{
    local_bed_start_with(bed, (struct bvhd_client_options){.local = BVHD_LOCAL_ALWAYS, .local_threads = threads});
}

/* Ends the client, and checks that nothing is left over. */
static inline void local_bed_stop(struct local_bed *bed)
{
    bvhd_client_destroy(bed->client);
    for (uint32_t i = 0; i < LOCAL_BED_MESHES; i++)
        terrain_finish(&bed->meshes[i]);
    assert_int_equal(open_descriptors(), bed->descriptors);
    assert_int_equal(library_memory.live, bed->live);
}

/* A request for `count` meshes, from the first one. */
struct local_bed_build {
    struct bvhd_build build;
    VkAccelerationStructureBuildGeometryInfoKHR infos[LOCAL_BED_MESHES];
    const VkAccelerationStructureBuildRangeInfoKHR *ranges[LOCAL_BED_MESHES];
};

static inline void local_bed_describe(struct terrain *meshes, uint32_t count, struct local_bed_build *ret_build)
{
    for (uint32_t i = 0; i < count; i++) {
        ret_build->infos[i] = meshes[i].info;
        ret_build->ranges[i] = meshes[i].ranges;
    }
    ret_build->build = (struct bvhd_build){.struct_size = sizeof ret_build->build,
                                           .info_count = count,
                                           .infos = ret_build->infos,
                                           .ranges = ret_build->ranges,
                                           .quality = BVHD_QUALITY_FAST};
}

/* Submits `count` meshes. */
static inline struct bvhd_batch *local_bed_submit(struct bvhd_client *client, struct terrain *meshes, uint32_t count,
                                                  enum bvhd_priority priority)
{
    struct local_bed_build request;
    struct bvhd_batch *batch = NULL;
    struct bvhd_error error;
    local_bed_describe(meshes, count, &request);
    request.build.priority = priority;
    if (bvhd_batch_submit(client, &request.build, &batch, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return batch;
}

/* Submits one mesh with the quality that takes the longest. `deadline_ms`: 0 for none. */
static inline struct bvhd_batch *local_bed_submit_long(struct bvhd_client *client, struct terrain *mesh,
                                                       enum bvhd_priority priority, uint32_t deadline_ms)
{
    struct local_bed_build request;
    struct bvhd_batch *batch = NULL;
    local_bed_describe(mesh, 1, &request);
    request.build.quality = BVHD_QUALITY_HIGH;
    request.build.priority = priority;
    request.build.deadline_ms = deadline_ms;
    assert_int_equal(bvhd_batch_submit(client, &request.build, &batch, NULL), BVHD_OK);
    return batch;
}

/* A thread that waits for a batch; joined by the test. */
struct local_bed_waiting {
    pthread_t thread;
    struct bvhd_batch *batch;
};

static inline void *local_bed_wait(void *argument)
{
    bvhd_batch_wait(((struct local_bed_waiting *)argument)->batch, -1);
    return NULL;
}

static inline void local_bed_start_waiting(struct local_bed_waiting *waiting, struct bvhd_batch *batch)
{
    waiting->batch = batch;
    assert_int_equal(pthread_create(&waiting->thread, NULL, local_bed_wait, waiting), 0);
}

static inline enum bvhd_status local_bed_status(struct bvhd_batch *batch, uint32_t item)
{
    return bvhd_batch_result(batch, item)->error.status;
}

/* Checks that all items have succeeded. */
static inline void local_bed_expect_ok(struct bvhd_batch *batch)
{
    for (uint32_t i = 0; i < bvhd_batch_count(batch); i++) {
        const struct bvhd_error *error = &bvhd_batch_result(batch, i)->error;
        if (error->status != BVHD_OK)
            fail_msg("item %u: %s: %s: %s", i, bvhd_status_name(error->status), error->where, error->text);
    }
}

#endif
