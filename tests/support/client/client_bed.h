/* SPDX-License-Identifier: Apache-2.0 */
/* client_bed.h - a client of a fake daemon, and builds for it to request. For tests of the client library. */
#ifndef BVHD_CLIENT_BED_H
#define BVHD_CLIENT_BED_H

#include <time.h>

#include <bvhd/bvhd.h>

#include "tests/support/client/fake_daemon.h"
#include "client/library.h"
#include "tests/support/open_descriptors.h"

enum { BED_MAX_INFOS = 1000, BED_CONNECT_MS = 400, BED_LOST_MS = 400, BED_LATE_MS = 3000 };

/* A build of `count` infos, each with its own mesh of triangles. */
struct bed_build {
    struct bvhd_build build;
    VkAccelerationStructureGeometryKHR geometries[BED_MAX_INFOS];
    VkAccelerationStructureBuildRangeInfoKHR ranges[BED_MAX_INFOS];
    const VkAccelerationStructureBuildRangeInfoKHR *range_pointers[BED_MAX_INFOS];
    VkAccelerationStructureBuildGeometryInfoKHR infos[BED_MAX_INFOS];
    float *vertices;
};

struct client_bed {
    struct fake_daemon fake;
    struct bvhd_client *client;
    struct bed_build *asked; /* the build that was submitted last; owned */
    int descriptors; /* number that were open before */
    uint64_t live; /* bytes of library_memory that were live before */
};

static inline double bed_now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec * 1e3 + (double)time.tv_nsec * 1e-6;
}

/*
 * Describes infos of `triangles` triangles each. Info i has the destination i + 1, which the serving fake daemon takes
 * as the result's size.
 */
static inline void bed_describe(struct bed_build *asked, uint32_t count, uint32_t triangles)
{
    free(asked->vertices);
    memset(asked, 0, sizeof *asked);
    asked->vertices = malloc((size_t)count * triangles * 36 + 1);
    for (uint64_t i = 0; i < (uint64_t)count * triangles * 9; i++)
        asked->vertices[i] = (float)i;
    for (uint32_t i = 0; i < count; i++) {
        asked->geometries[i] = (VkAccelerationStructureGeometryKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
            .geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR,
            .geometry.triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                                   .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                                   .vertexData.hostAddress = asked->vertices + (size_t)i * triangles * 9,
                                   .vertexStride = 12,
                                   .maxVertex = 3 * triangles - 1,
                                   .indexType = VK_INDEX_TYPE_NONE_KHR},
        };
        asked->ranges[i].primitiveCount = triangles;
        asked->range_pointers[i] = &asked->ranges[i];
        asked->infos[i] = (VkAccelerationStructureBuildGeometryInfoKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
            .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
            .dstAccelerationStructure = (VkAccelerationStructureKHR)(uintptr_t)(i + 1),
            .geometryCount = 1,
            .pGeometries = &asked->geometries[i],
        };
    }
    asked->build = (struct bvhd_build){.struct_size = sizeof asked->build,
                                       .info_count = count,
                                       .infos = asked->infos,
                                       .ranges = asked->range_pointers};
}

static inline struct bvhd_batch *bed_submit(struct client_bed *bed, uint32_t count, uint32_t triangles)
{
    struct bvhd_batch *batch = NULL;
    struct bvhd_error error;
    bed_describe(bed->asked, count, triangles);
    if (bvhd_batch_submit(bed->client, &bed->asked->build, &batch, &error) != BVHD_OK)
        fprintf(stderr, "submit: %s: %s\n", error.where, error.text);
    return batch;
}

static inline void bed_options(struct client_bed *bed, struct bvhd_client_options *options)
{
    bed->descriptors = open_descriptors();
    bed->live = library_memory.live;
    fake_start(&bed->fake);
    bed->asked = calloc(1, sizeof *bed->asked);
    if (!options->socket_path)
        options->socket_path = bed->fake.path;
    options->struct_size = sizeof *options;
    bvhd_client_create(options, &bed->client, NULL);
}

/* Starts a client with the default timeouts, which needs the daemon. */
static inline void bed_start(struct client_bed *bed)
{
    struct bvhd_client_options options = {.local = BVHD_LOCAL_NEVER};
    bed_options(bed, &options);
}

/*
 * Starts a client that searches for a daemon for BED_CONNECT_MS, and gives up one that is silent for BED_LOST_MS. On a
 * busy machine that takes up to BED_LATE_MS longer.
 */
static inline void bed_start_impatient(struct client_bed *bed)
{
    struct bvhd_client_options options = {
        .connect_timeout_ms = BED_CONNECT_MS, .lost_after_ms = BED_LOST_MS, .local = BVHD_LOCAL_NEVER};
    bed_options(bed, &options);
}

/* Ends the client and the daemon. Returns true if nothing is left over. */
static inline bool bed_stop(struct client_bed *bed)
{
    bvhd_client_destroy(bed->client);
    fake_stop(&bed->fake);
    free(bed->asked->vertices);
    free(bed->asked);
    int descriptors = open_descriptors();
    if (descriptors != bed->descriptors || library_memory.live != bed->live)
        fprintf(stderr, "left over: %d descriptors, %llu bytes\n", descriptors - bed->descriptors,
                (unsigned long long)(library_memory.live - bed->live));
    return descriptors == bed->descriptors && library_memory.live == bed->live;
}

/* Ends a bed with its last batch, and checks that nothing is left over. */
static inline void bed_end(struct client_bed *bed, struct bvhd_batch *batch)
{
    bvhd_batch_destroy(batch);
    assert_true(bed_stop(bed));
}

static inline enum bvhd_status bed_status(struct bvhd_batch *batch, uint32_t item)
{
    return bvhd_batch_result(batch, item)->error.status;
}

/* Waits for the batch, and returns its first item's status. */
static inline enum bvhd_status bed_outcome(struct bvhd_batch *batch)
{
    assert_int_equal(bvhd_batch_wait(batch, 5000), BVHD_OK);
    return bed_status(batch, 0);
}

/* Returns the text of the first item's error. */
static inline const char *bed_text(struct bvhd_batch *batch)
{
    return bvhd_batch_result(batch, 0)->error.text;
}

/* Submits one item on a connection that has been greeted, and receives the request. */
static inline struct bvhd_batch *bed_ask(struct client_bed *bed, uint64_t *ret_request)
{
    struct frame frame;
    struct bvhd_batch *batch = bed_submit(bed, 1, 1);
    assert_true(fake_expect(&bed->fake, FRAME_BUILD, &frame));
    *ret_request = frame.header.request;
    return batch;
}

/* Dispatches until the batch is done or 10 s have passed. */
static inline bool bed_finish(struct client_bed *bed, struct bvhd_batch *batch)
{
    double end = bed_now() + 10000;
    do
        bvhd_client_dispatch(bed->client);
    while (!bvhd_batch_is_done(batch) && bed_now() < end);
    return bvhd_batch_is_done(batch);
}

/* Has the client connect, and answers its HELLO and a first build. Returns whether all of that worked. */
static inline bool bed_connect(struct client_bed *bed)
{
    struct bvhd_batch *batch = bed_submit(bed, 1, 1);
    struct frame frame;
    if (!batch || !fake_greet(&bed->fake))
        return false;
    bvhd_client_dispatch(bed->client);
    bool asked = fake_expect(&bed->fake, FRAME_BUILD, &frame);
    if (asked) {
        fake_send_prepared(&bed->fake, frame.header.request, 0, 1);
        fake_send_result(&bed->fake, frame.header.request, 0, 10);
        asked = bed_finish(bed, batch) && bed_status(batch, 0) == BVHD_OK;
    }
    bvhd_batch_destroy(batch);
    return asked;
}

/* Starts a client that asks for one item on a connection that has been greeted. */
static inline struct bvhd_batch *bed_start_asked(struct client_bed *bed, uint64_t *ret_request)
{
    bed_start(bed);
    assert_true(bed_connect(bed));
    return bed_ask(bed, ret_request);
}

#endif
