/* SPDX-License-Identifier: Apache-2.0 */
/*
 * trace_hair.c - builds three hairs of linear swept spheres, traces rays through them on the CPU, and prints a picture
 * of characters: each hair is darker towards its tip. It works with a daemon and without one, and needs no device.
 */
#include <stdio.h>
#include <stdlib.h>

#include <bvhd/bvhd.h>
#include <bvhd/bvhd_cpu.h>
#include <bvhd/vulkan_nv.h>

enum { HAIRS = 3, POINTS = 9, PARTS = POINTS - 1, WIDTH = 64, HEIGHT = 24, RAYS = WIDTH * HEIGHT };

static float points[HAIRS * POINTS][4]; /* x, y, z, radius */
static uint32_t firsts[HAIRS * PARTS]; /* of each part its first point; its second one is the next */

/* A part that begins where the one before it ends has no cap there: each hair is closed at its two ends alone. */
static const VkAccelerationStructureGeometryLinearSweptSpheresDataNV hairs = {
    .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_LINEAR_SWEPT_SPHERES_DATA_NV,
    .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
    .vertexData.hostAddress = points,
    .vertexStride = sizeof points[0],
    .radiusFormat = VK_FORMAT_R32_SFLOAT,
    .radiusData.hostAddress = &points[0][3],
    .radiusStride = sizeof points[0],
    .indexType = VK_INDEX_TYPE_UINT32,
    .indexData.hostAddress = firsts,
    .indexStride = sizeof firsts[0],
    .indexingMode = VK_RAY_TRACING_LSS_INDEXING_MODE_SUCCESSIVE_NV,
    .endCapsMode = VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_CHAINED_NV};

static const VkAccelerationStructureGeometryKHR geometry = {.sType =
                                                                VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                                                            .pNext = &hairs,
                                                            .geometryType = VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV,
                                                            .flags = VK_GEOMETRY_OPAQUE_BIT_KHR};

static const VkAccelerationStructureBuildGeometryInfoKHR info = {
    .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
    .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
    .geometryCount = 1,
    .pGeometries = &geometry};

static const VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = HAIRS * PARTS}, *const ranges = &range;

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "%s: %s: %s\n", bvhd_status_name(status), error->where, error->text);
    exit(1);
}

/* Lets each hair hang down, bend to one side, and taper. */
static void make_hairs(void)
{
    for (uint32_t hair = 0; hair < HAIRS; hair++)
        for (uint32_t i = 0; i < POINTS; i++) {
            const float way = (float)i / PARTS;
            float *point = points[hair * POINTS + i];
            point[0] = (float)hair - 1 + way * way * (1 - 0.5f * (float)hair);
            point[1] = -2 * way;
            point[3] = 0.25f * (1 - way) + 0.03f;
            if (i < PARTS)
                firsts[hair * PARTS + i] = hair * POINTS + i;
        }
}

/* Traces parallel rays towards -z. */
static void print_picture(const struct bvhd_cpu_blob *blob)
{
    static struct bvhd_cpu_ray rays[RAYS];
    static struct bvhd_cpu_hit hits[RAYS];
    const struct bvhd_cpu_scene_options options = {.struct_size = sizeof options, .blobs = blob, .blob_count = 1};
    const struct bvhd_cpu_trace trace = {.struct_size = sizeof trace,
                                         .rays = rays,
                                         .ray_size = sizeof rays[0],
                                         .hits = hits,
                                         .hit_size = sizeof hits[0],
                                         .ray_count = RAYS};
    struct bvhd_cpu_scene *scene;
    struct bvhd_error error;
    int hit_count = 0;
    for (int i = 0; i < RAYS; i++) {
        const float x = ((float)(i % WIDTH) + 0.5f) / WIDTH, y = ((float)(i / WIDTH) + 0.5f) / HEIGHT;
        rays[i] = (struct bvhd_cpu_ray){
            .origin = {4 * x - 2, 0.5f - 3 * y, 2}, .direction = {0, 0, -1}, .tmax = 4, .mask = 0xff};
    }
    must(bvhd_cpu_scene_create(&options, &scene, &error), &error);
    must(bvhd_cpu_scene_trace(scene, &trace, &error), &error);
    for (int i = 0; i < RAYS; i++) {
        const int is_hit = hits[i].blob != BVHD_CPU_NO_BLOB;
        /* u is the place between the two ends of the part. */
        const float way = is_hit ? ((float)(hits[i].primitive % PARTS) + hits[i].u) / PARTS : 0;
        hit_count += is_hit;
        printf("%c%s", is_hit ? "#*+:-"[(int)(way * 4.99f)] : ' ', i % WIDTH == WIDTH - 1 ? "\n" : "");
    }
    printf("%d of %d rays hit a hair\n", hit_count, RAYS);
    bvhd_cpu_scene_destroy(scene);
}

int main(void)
{
    const struct bvhd_build build = {.struct_size = sizeof build, .info_count = 1, .infos = &info, .ranges = &ranges};
    struct bvhd_client *client;
    struct bvhd_batch *batch;
    struct bvhd_error error;
    make_hairs();
    must(bvhd_client_create(NULL, &client, &error), &error);
    must(bvhd_batch_submit(client, &build, &batch, &error), &error);
    bvhd_batch_wait(batch, -1);
    const struct bvhd_result *result = bvhd_batch_result(batch, 0);
    must(result->error.status, &result->error);
    const struct bvhd_cpu_blob blob = {result->data, result->size};
    print_picture(&blob);
    bvhd_batch_destroy(batch);
    bvhd_client_destroy(client);
    return 0;
}
