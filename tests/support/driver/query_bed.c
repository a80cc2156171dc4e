/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/driver/query_bed.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/trace/device_ray.h"
#include "tests/support/driver/driver_scene.h"
#include "tests/support/query_bed_code.h"

enum { PORTION = 8192, GROUP = 64 };
enum { RAYS, ANSWERS, TARGETS, CANDIDATES, BOXES, FIRST, BUFFERS };

struct push {
    uint32_t count, policy, listed, geometry_stride;
};

struct query_bed {
    struct gpu *gpu;
    struct gpu_kernel kernel;
    struct gpu_buffer buffers[BUFFERS];
    uint32_t geometry_stride;
};

#define MUST(call) driver_scene_must((call), &error)

bool query_answer_equal(const struct query_answer *a, const struct query_answer *b)
{
    return memcmp(a, b, offsetof(struct query_answer, candidates)) == 0;
}

static void put(struct query_bed *bed, int which, uint64_t size, enum gpu_place place)
{
    struct bvhd_error error;
    gpu_buffer_destroy(bed->gpu, &bed->buffers[which]);
    MUST(gpu_buffer_create(bed->gpu, size, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, place, &bed->buffers[which], &error));
}

struct query_bed *query_bed_create(struct gpu *gpu)
{
    struct bvhd_error error;
    const struct gpu_kernel_options kernel = {.code = query_bed_code,
                                              .size = sizeof query_bed_code,
                                              .bindings = BUFFERS,
                                              .structures = 1,
                                              .push_size = sizeof(struct push)};
    static const float no_box[6];
    static const uint32_t no_first;
    const struct scene_boxes none = {
        .boxes = no_box, .box_count = 1, .instance_count = 1, .geometry_stride = 1, .first = &no_first};
    struct query_bed *bed = calloc(1, sizeof *bed);
    if (!bed)
        exit(1);
    bed->gpu = gpu;
    MUST(gpu_kernel_create(gpu, &kernel, &bed->kernel, &error));
    put(bed, RAYS, PORTION * sizeof(struct bvhd_ray), GPU_UPLOAD);
    put(bed, ANSWERS, PORTION * sizeof(struct query_answer), GPU_READBACK);
    put(bed, TARGETS, PORTION * sizeof(struct query_id), GPU_UPLOAD);
    put(bed, CANDIDATES, sizeof(struct query_id), GPU_READBACK);
    query_bed_set_boxes(bed, &none);
    return bed;
}

void query_bed_destroy(struct query_bed *bed)
{
    for (int i = 0; i < BUFFERS; i++)
        gpu_buffer_destroy(bed->gpu, &bed->buffers[i]);
    gpu_kernel_destroy(bed->gpu, &bed->kernel);
    free(bed);
}

void query_bed_set_boxes(struct query_bed *bed, const struct scene_boxes *boxes)
{
    size_t size = (size_t)boxes->box_count * 6 * sizeof(float);
    size_t first_size = (size_t)boxes->instance_count * boxes->geometry_stride * sizeof(uint32_t);
    put(bed, BOXES, size, GPU_UPLOAD);
    put(bed, FIRST, first_size, GPU_UPLOAD);
    memcpy(bed->buffers[BOXES].mapped, boxes->boxes, size);
    memcpy(bed->buffers[FIRST].mapped, boxes->first, first_size);
    bed->geometry_stride = boxes->geometry_stride;
}

static void put_rays(struct query_bed *bed, const struct query_work *work, uint32_t from, uint32_t count)
{
    device_rays_put(work->rays + from, count, bed->buffers[RAYS].mapped);
    if (work->targets)
        memcpy(bed->buffers[TARGETS].mapped, work->targets + from, count * sizeof *work->targets);
}

static void trace_portion(struct query_bed *bed, const struct query_work *work, uint32_t count)
{
    struct bvhd_error error;
    struct gpu *gpu = bed->gpu;
    VkCommandBuffer commands;
    const struct push push = {count, (uint32_t)work->policy, work->listed, bed->geometry_stride};
    const VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                     .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT,
                                     .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    MUST(gpu_begin(gpu, &commands, &error));
    gpu_kernel_record(gpu, &bed->kernel, commands, &push, (count + GROUP - 1) / GROUP);
    gpu->vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1,
                               &barrier, 0, NULL, 0, NULL);
    MUST(gpu_submit(gpu, commands, &error));
}

void query_bed_trace(struct query_bed *bed, const struct query_work *work, struct query_answer *ret_answers,
                     struct query_id *ret_candidates)
{
    const struct gpu_buffer *bound[BUFFERS];
    uint64_t list_size = (uint64_t)PORTION * work->listed * sizeof *ret_candidates;
    if (work->listed && bed->buffers[CANDIDATES].size < list_size)
        put(bed, CANDIDATES, list_size, GPU_READBACK);
    for (int i = 0; i < BUFFERS; i++)
        bound[i] = &bed->buffers[i];
    gpu_kernel_bind(bed->gpu, &bed->kernel, bound, &work->top);
    for (uint32_t done = 0; done < work->count; done += PORTION) {
        uint32_t some = work->count - done < PORTION ? work->count - done : PORTION;
        put_rays(bed, work, done, some);
        trace_portion(bed, work, some);
        memcpy(ret_answers + done, bed->buffers[ANSWERS].mapped, some * sizeof *ret_answers);
        if (work->listed)
            memcpy(ret_candidates + (size_t)done * work->listed, bed->buffers[CANDIDATES].mapped,
                   (size_t)some * work->listed * sizeof *ret_candidates);
    }
}
