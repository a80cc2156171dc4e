/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/shader/shader_bed.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/shader_agreement.h"
#include "tests/support/shader_agreement_address.h"
#include "tests/support/shader_agreement_all.h"
#include "tests/support/shader_agreement_all_address.h"
#include "tests/support/shader_agreement_motion.h"
#include "tests/support/shader_agreement_motion_address.h"
#include "tests/support/shader_agreement_round.h"
#include "tests/support/shader_agreement_round_address.h"

_Static_assert(sizeof(struct shader_answer) == 48 &&
                   sizeof(struct shader_full_answer) == 204 + 40 * SHADER_BED_CANDIDATES,
               "The layouts are those of the kernel.");

enum { HIT_PORTION = 1 << 18, BINDINGS = 3 };

struct kernel_ray {
    float origin[3], tmin, direction[3], tmax;
    uint32_t flags, cull_mask;
    float time;
    uint32_t padding;
};

struct kernel_push {
    uint32_t count, policy;
    uint64_t root;
    uint32_t candidates, padding;
};

struct shader_bed {
    struct memory *memory;
    struct gpu *gpu;
    struct gpu_kernel kernel;
    struct gpu_buffer scene, rays, answers;
    uint64_t root;
    bool by_address;
};

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status == BVHD_OK)
        return;
    fprintf(stderr, "shader bed: %s: %s\n", error->where, error->text);
    exit(1);
}

bool shader_policy_accepts(uint32_t instance, uint32_t geometry, uint32_t primitive)
{
    return (instance * 73856093u ^ geometry * 19349663u ^ primitive * 83492791u) >> 7 & 1;
}

/* ---- the device ---- */

#define CODE(name) name##_code, sizeof name##_code

/*
 * The kernels by whether they know spheres and linear swept spheres, whether they know motion, and whether they find
 * the scene by its address.
 */
static const struct {
    const uint32_t *words;
    size_t size;
} codes[2][2][2] = {
    {{{CODE(shader_agreement)}, {CODE(shader_agreement_address)}},
     {{CODE(shader_agreement_motion)}, {CODE(shader_agreement_motion_address)}}},
    {{{CODE(shader_agreement_round)}, {CODE(shader_agreement_round_address)}},
     {{CODE(shader_agreement_all)}, {CODE(shader_agreement_all_address)}}},
};

static void create_kernel(struct shader_bed *bed, const struct shader_bed_options *options)
{
    struct bvhd_error error;
    const uint32_t constants[] = {options->plain_bytes, options->fused_fma};
    struct gpu_kernel_options kernel = {
        .code = codes[options->is_round][options->moves][options->by_address].words,
        .size = codes[options->is_round][options->moves][options->by_address].size,
        .bindings = BINDINGS,
        .push_size = sizeof(struct kernel_push),
        .constants = constants,
        .constant_count = 2,
    };
    must(gpu_kernel_create(bed->gpu, &kernel, &bed->kernel, &error), &error);
}

static void create_buffer(struct shader_bed *bed, uint64_t size, enum gpu_place place, struct gpu_buffer *ret_buffer)
{
    struct bvhd_error error;
    must(gpu_buffer_create(bed->gpu, size, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, place, ret_buffer, &error), &error);
}

enum bvhd_status shader_bed_create(const struct shader_bed_options *options, struct memory *memory,
                                   struct shader_bed **ret_bed, struct bvhd_error *error)
{
    struct shader_bed *bed = calloc(1, sizeof *bed);
    enum bvhd_status status = bed ? gpu_open(options->device, memory, &bed->gpu, error) : BVHD_NO_MEMORY;
    if (status == BVHD_OK && options->by_address && !bed->gpu->properties.has_buffer_address) {
        status =
            bvhd_error_set(error, BVHD_UNAVAILABLE, "device", "%s has no buffer addresses", bed->gpu->properties.name);
        gpu_close(bed->gpu);
    }
    if (status != BVHD_OK) {
        free(bed);
        return status;
    }
    bed->memory = memory;
    bed->by_address = options->by_address;
    create_kernel(bed, options);
    create_buffer(bed, (uint64_t)HIT_PORTION * sizeof(struct kernel_ray), GPU_UPLOAD, &bed->rays);
    uint64_t brief = (uint64_t)HIT_PORTION * sizeof(struct shader_answer),
             full = (uint64_t)SHADER_BED_PORTION * sizeof(struct shader_full_answer);
    create_buffer(bed, brief > full ? brief : full, GPU_READBACK, &bed->answers);
    *ret_bed = bed;
    return BVHD_OK;
}

void shader_bed_destroy(struct shader_bed *bed)
{
    if (!bed)
        return;
    gpu_buffer_destroy(bed->gpu, &bed->scene);
    gpu_buffer_destroy(bed->gpu, &bed->rays);
    gpu_buffer_destroy(bed->gpu, &bed->answers);
    gpu_kernel_destroy(bed->gpu, &bed->kernel);
    gpu_close(bed->gpu);
    free(bed);
}

const char *shader_bed_device(const struct shader_bed *bed)
{
    return bed->gpu->properties.name;
}

/* ---- the scene ---- */

/* Reserves space for the body of `view` after `*used` bytes and returns its location. Location 0 is valid. */
static uint64_t place(uint64_t *used, const struct portable_view *view)
{
    uint64_t at = *used;
    *used += (view->header->body_size + 63) / 64 * 64;
    return at;
}

static void copy_body(unsigned char *dest, const struct portable_view *view)
{
    memcpy(dest, view->header, (size_t)view->header->body_size);
}

static void patch_instances(unsigned char *body, const struct portable_view *top, const uint64_t *locations,
                            uint64_t base)
{
    unsigned char *records = body + top->header->record_offset;
    for (uint32_t i = 0; i < top->header->record_count; i++) {
        struct portable_instance *record = (struct portable_instance *)(void *)records + i;
        struct portable_moving_instance *moving = (struct portable_moving_instance *)(void *)records + i;
        bool moves = top->header->content == PORTABLE_MOVING_INSTANCES;
        uint64_t location = locations[moves ? moving->handle : record->handle];
        bytes_put64((unsigned char *)(moves ? &moving->reserved[1] : &record->reserved[0]),
                    location == UINT64_MAX ? location : base + location);
    }
}

void shader_bed_load(struct shader_bed *bed, const struct scene *scene)
{
    uint64_t used = 0, *locations = calloc((size_t)scene->bottom_count + 1, sizeof *locations);
    for (uint32_t i = 0; i < scene->bottom_count; i++)
        locations[i] = scene->bottoms[i] ? place(&used, scene->bottoms[i]) : UINT64_MAX;
    uint64_t top = scene->top ? place(&used, scene->top) : locations[0];
    gpu_buffer_destroy(bed->gpu, &bed->scene);
    create_buffer(bed, used, GPU_UPLOAD, &bed->scene);
    unsigned char *bytes = bed->scene.mapped;
    uint64_t base = bed->by_address ? bed->scene.address : 0;
    for (uint32_t i = 0; i < scene->bottom_count; i++)
        if (scene->bottoms[i])
            copy_body(bytes + locations[i], scene->bottoms[i]);
    if (scene->top) {
        copy_body(bytes + top, scene->top);
        patch_instances(bytes + top, scene->top, locations, base);
    }
    bed->root = base + top;
    free(locations);
    const struct gpu_buffer *const buffers[BINDINGS] = {&bed->scene, &bed->rays, &bed->answers};
    gpu_kernel_bind(bed->gpu, &bed->kernel, buffers, NULL);
}

/* ---- rays ---- */

static void write_rays(struct shader_bed *bed, const struct ray *rays, uint32_t count)
{
    struct kernel_ray *row = bed->rays.mapped;
    for (uint32_t i = 0; i < count; i++) {
        row[i] = (struct kernel_ray){.tmin = rays[i].tmin,
                                     .tmax = rays[i].tmax,
                                     .flags = rays[i].flags,
                                     .cull_mask = rays[i].cull_mask,
                                     .time = rays[i].time};
        memcpy(row[i].origin, rays[i].origin, sizeof row[i].origin);
        memcpy(row[i].direction, rays[i].direction, sizeof row[i].direction);
    }
}

static void run(struct shader_bed *bed, const struct ray *rays, uint32_t count, enum shader_policy policy,
                uint32_t candidates)
{
    struct bvhd_error error;
    VkCommandBuffer commands;
    struct kernel_push push = {count, policy, bed->root, candidates, 0};
    write_rays(bed, rays, count);
    must(gpu_begin(bed->gpu, &commands, &error), &error);
    gpu_kernel_record(bed->gpu, &bed->kernel, commands, &push, (count + 63) / 64);
    VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                               .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT,
                               .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    bed->gpu->vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1,
                                    &barrier, 0, NULL, 0, NULL);
    must(gpu_submit(bed->gpu, commands, &error), &error);
}

void shader_bed_trace(struct shader_bed *bed, const struct ray *rays, uint32_t count, enum shader_policy policy,
                      struct shader_answer *ret_answers)
{
    for (uint32_t done = 0, portion; done < count; done += portion) {
        portion = count - done < HIT_PORTION ? count - done : HIT_PORTION;
        run(bed, rays + done, portion, policy, 0);
        memcpy(ret_answers + done, bed->answers.mapped, (size_t)portion * sizeof *ret_answers);
    }
}

void shader_bed_trace_fully(struct shader_bed *bed, const struct ray *rays, uint32_t count, enum shader_policy policy,
                            struct shader_full_answer *ret_answers)
{
    run(bed, rays, count, policy, SHADER_BED_CANDIDATES);
    memcpy(ret_answers, bed->answers.mapped, (size_t)count * sizeof *ret_answers);
}
