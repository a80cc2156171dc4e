/* SPDX-License-Identifier: Apache-2.0 */
/*
 * trace_motion.c - builds a wing that flaps, which is a triangle of two times, and lets it fly by and turn, which is an
 * instance of two times. It traces rays of many times through it on the CPU, and prints their average as a picture of
 * characters, as a camera with an open shutter takes it. It works with a daemon and without one, and needs no device.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <bvhd/bvhd.h>
#include <bvhd/bvhd_cpu.h>

enum { WIDTH = 64, HEIGHT = 24, PIXELS = WIDTH * HEIGHT, TIMES = 16, WING = 1 };

/* The wing at the time 0, and at the time 1, when its tip is elsewhere. */
static const float corners[3][3] = {{-0.6f, -0.2f, 0}, {0.6f, -0.2f, 0}, {0, 1, 0}},
                   later_corners[3][3] = {{-0.6f, -0.2f, 0}, {0.6f, -0.2f, 0}, {0.8f, 0.7f, 0}};

static const VkAccelerationStructureGeometryMotionTrianglesDataNV later = {
    .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_MOTION_TRIANGLES_DATA_NV,
    .vertexData.hostAddress = later_corners};

/* Instances that move have 152 bytes, and Vulkan reads one every 160. */
static struct {
    VkAccelerationStructureMotionInstanceNV instance;
    uint64_t padding;
} flight;

static const VkAccelerationStructureGeometryKHR
    wing = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
            .geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR,
            .geometry.triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                                   .pNext = &later,
                                   .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                                   .vertexData.hostAddress = corners,
                                   .vertexStride = sizeof corners[0],
                                   .maxVertex = 2,
                                   .indexType = VK_INDEX_TYPE_NONE_KHR},
            .flags = VK_GEOMETRY_OPAQUE_BIT_KHR},
    flights = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
               .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
               .geometry.instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                                      .data.hostAddress = &flight}};

/* Both levels move, and have the flag. The instance names the bottom level by the handle of its destination. */
static const VkAccelerationStructureBuildGeometryInfoKHR infos[2] = {
    {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
     .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
     .flags = VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV,
     .dstAccelerationStructure = (VkAccelerationStructureKHR)WING,
     .geometryCount = 1,
     .pGeometries = &wing},
    {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
     .type = VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
     .flags = VK_BUILD_ACCELERATION_STRUCTURE_MOTION_BIT_NV,
     .geometryCount = 1,
     .pGeometries = &flights}};

static const VkAccelerationStructureBuildRangeInfoKHR one = {.primitiveCount = 1}, *const ranges[2] = {&one, &one};

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "%s: %s: %s\n", bvhd_status_name(status), error->where, error->text);
    exit(1);
}

/* From the left to the right, while it turns by a quarter about z and shrinks. */
static void make_flight(void)
{
    const VkSRTDataNV start = {.sx = 1, .sy = 1, .sz = 1, .qw = 1, .tx = -0.7f, .ty = -0.3f},
                      end = {.sx = 0.8f, .sy = 0.8f, .sz = 1, .qz = -0.70710678f, .qw = 0.70710678f, .tx = 0.7f};
    VkAccelerationStructureSRTMotionInstanceNV *srt = &flight.instance.data.srtMotionInstance;
    flight.instance.type = VK_ACCELERATION_STRUCTURE_MOTION_INSTANCE_TYPE_SRT_MOTION_NV;
    srt->transformT0 = start;
    srt->transformT1 = end;
    srt->mask = 0xff;
    srt->accelerationStructureReference = WING;
}

/* Traces parallel rays towards -z, at each time one for each pixel. Returns how many hit something. */
static int count_hits(struct bvhd_cpu_scene *scene, float time, int counts[PIXELS])
{
    static struct bvhd_cpu_ray rays[PIXELS];
    static struct bvhd_cpu_hit hits[PIXELS];
    const struct bvhd_cpu_trace trace = {.struct_size = sizeof trace,
                                         .rays = rays,
                                         .ray_size = sizeof rays[0],
                                         .hits = hits,
                                         .hit_size = sizeof hits[0],
                                         .ray_count = PIXELS};
    struct bvhd_error error;
    int sum = 0;
    for (int i = 0; i < PIXELS; i++) {
        const float x = ((float)(i % WIDTH) + 0.5f) / WIDTH, y = ((float)(i / WIDTH) + 0.5f) / HEIGHT;
        rays[i] = (struct bvhd_cpu_ray){.origin = {4.4f * x - 2.2f, 1.3f - 3 * y, 2},
                                        .direction = {0, 0, -1},
                                        .tmax = 4,
                                        .mask = 0xff,
                                        .time = time};
    }
    must(bvhd_cpu_scene_trace(scene, &trace, &error), &error);
    for (int i = 0; i < PIXELS; i++) {
        const int is_hit = hits[i].blob != BVHD_CPU_NO_BLOB;
        counts[i] += is_hit;
        sum += is_hit;
    }
    return sum;
}

/* Prints which part of the time something is seen in each pixel. */
static void print_picture(const struct bvhd_cpu_blob blobs[2])
{
    static int counts[PIXELS];
    const struct bvhd_cpu_scene_options options = {.struct_size = sizeof options, .blobs = blobs, .blob_count = 2};
    struct bvhd_cpu_scene *scene;
    struct bvhd_error error;
    int sum = 0;
    must(bvhd_cpu_scene_create(&options, &scene, &error), &error);
    for (int i = 0; i < TIMES; i++)
        sum += count_hits(scene, (float)i / (TIMES - 1), counts);
    for (int i = 0; i < PIXELS; i++)
        printf("%c%s", " .:-=+*#@"[(counts[i] * 8 + TIMES - 1) / TIMES], i % WIDTH == WIDTH - 1 ? "\n" : "");
    printf("%d of %d rays hit the wing\n", sum, TIMES * PIXELS);
    bvhd_cpu_scene_destroy(scene);
}

int main(void)
{
    const struct bvhd_build build = {.struct_size = sizeof build, .info_count = 2, .infos = infos, .ranges = ranges};
    struct bvhd_cpu_blob blobs[2];
    struct bvhd_client *client;
    struct bvhd_batch *batch;
    struct bvhd_error error;
    make_flight();
    must(bvhd_client_create(NULL, &client, &error), &error);
    must(bvhd_batch_submit(client, &build, &batch, &error), &error);
    bvhd_batch_wait(batch, -1);
    for (uint32_t i = 0; i < 2; i++) {
        const struct bvhd_result *result = bvhd_batch_result(batch, i);
        must(result->error.status, &result->error);
        blobs[i] = (struct bvhd_cpu_blob){result->data, result->size};
    }
    print_picture(blobs);
    bvhd_batch_destroy(batch);
    bvhd_client_destroy(client);
    return 0;
}
