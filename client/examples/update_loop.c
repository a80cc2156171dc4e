/* SPDX-License-Identifier: Apache-2.0 */
/*
 * update_loop.c - keeps the structure of a mesh that moves: each frame updates the structure of the frame before, or
 * builds it where an update does not pay or is not possible. It works with a daemon and without one.
 *
 * A frame's line says how often the structure was updated since it was built, its decay (the expected cost of a ray,
 * over that after the build), and its size. The last line counts updates and builds.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include <bvhd/bvhd.h>

enum { FRAMES = 24, SIDE = 64, TRIANGLES = 2 * (SIDE - 1) * (SIDE - 1) };

/* This suits a balanced build and about one ray for each primitive and frame; with more rays a smaller number pays. */
static const double most_decay = 1.7;

static float vertices[SIDE * SIDE * 3];
static uint32_t indices[TRIANGLES * 3];

static const VkAccelerationStructureGeometryKHR geometry = {
    .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
    .geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR,
    .geometry.triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                           .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                           .vertexData.hostAddress = vertices,
                           .vertexStride = 12,
                           .maxVertex = SIDE * SIDE - 1,
                           .indexType = VK_INDEX_TYPE_UINT32,
                           .indexData.hostAddress = indices},
    .flags = VK_GEOMETRY_OPAQUE_BIT_KHR};

static const VkAccelerationStructureBuildGeometryInfoKHR sheet = {
    .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
    .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
    .flags = VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR,
    .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
    .geometryCount = 1,
    .pGeometries = &geometry};

static const VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = TRIANGLES}, *const ranges = &range;

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "%s: %s: %s\n", bvhd_status_name(status), error->where, error->text);
    exit(1);
}

static void make_triangles(void)
{
    uint32_t *index = indices;
    for (uint32_t i = 0; i < TRIANGLES / 2; i++) {
        const uint32_t a = i / (SIDE - 1) * SIDE + i % (SIDE - 1), b = a + 1, c = a + SIDE, d = c + 1;
        *index++ = a, *index++ = b, *index++ = c;
        *index++ = b, *index++ = d, *index++ = c;
    }
}

/* Twists a sheet by a quarter turn every four frames. */
static void move_vertices(int frame)
{
    for (int i = 0; i < SIDE * SIDE; i++) {
        const float x = (float)(i % SIDE) / (float)SIDE - 0.5f, y = (float)i / (float)(SIDE * SIDE),
                    turn = 0.4f * (float)frame * y;
        vertices[3 * i] = x * cosf(turn);
        vertices[3 * i + 1] = 2 * y;
        vertices[3 * i + 2] = x * sinf(turn);
    }
}

/* Makes the structure of the vertices: by an update of the last batch's one, or by a build without a last batch. */
static struct bvhd_batch *make(struct bvhd_client *client, struct bvhd_batch *last)
{
    VkAccelerationStructureBuildGeometryInfoKHR info = sheet;
    struct bvhd_build build = {.struct_size = sizeof build, .info_count = 1, .infos = &info, .ranges = &ranges};
    struct bvhd_reference source = {.handle = 1, .has_key = 1};
    struct bvhd_batch *batch;
    struct bvhd_error error;
    if (last) {
        source.key = bvhd_batch_result(last, 0)->key;
        build.references = &source;
        build.reference_count = 1;
        info.mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
        /* in place */
        info.srcAccelerationStructure = info.dstAccelerationStructure = (VkAccelerationStructureKHR)1;
    }
    must(bvhd_batch_submit(client, &build, &batch, &error), &error);
    bvhd_batch_wait(batch, -1);
    return batch;
}

static struct bvhd_batch *make_frame(struct bvhd_client *client, struct bvhd_batch *last)
{
    struct bvhd_batch *batch = make(client, last);
    const struct bvhd_result *result = bvhd_batch_result(batch, 0);
    if (result->error.status == BVHD_SOURCE_LOST || result->decay > most_decay) {
        bvhd_batch_destroy(batch);
        batch = make(client, NULL);
        result = bvhd_batch_result(batch, 0);
    }
    must(result->error.status, &result->error);
    bvhd_batch_destroy(last); /* not earlier: the update starts from its result */
    return batch;
}

int main(void)
{
    struct bvhd_client *client;
    struct bvhd_batch *batch = NULL;
    struct bvhd_error error;
    int updates = 0;
    must(bvhd_client_create(NULL, &client, &error), &error);
    make_triangles();
    for (int frame = 0; frame < FRAMES; frame++) {
        move_vertices(frame);
        batch = make_frame(client, batch);
        const struct bvhd_result *result = bvhd_batch_result(batch, 0); /* data and size: what to upload, or to trace */
        updates += result->refits > 0;
        printf("frame %d: refits %u, decay %.2f, %lu bytes\n", frame, result->refits,
               result->refits ? result->decay : 1, (unsigned long)result->size);
    }
    bvhd_batch_destroy(batch);
    bvhd_client_destroy(client);
    printf("%d frames: %d updates, %d builds\n", FRAMES, updates, FRAMES - updates);
    return 0;
}
