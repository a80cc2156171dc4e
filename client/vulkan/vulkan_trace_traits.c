/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan/vulkan_tracer.h"
#include "client/vulkan/vulkan_work.h"

#include "client/shaders/probe_halves.h"

/* ---- denormal halves ---- */

enum { BYTES = 256, PROBE_GROUP = 64 };

struct trait_probe {
    const struct bvhd_vulkan_device *device;
    struct vulkan_layout layout;
    VkPipeline pipeline;
    struct vulkan_set set;
    struct vulkan_buffer floats;
    struct vulkan_work work;
};

static enum bvhd_status create_probe(struct trait_probe *probe, struct bvhd_error *error)
{
    const struct vulkan_code code = {.words = probe_halves_code, .size = sizeof probe_halves_code};
    enum bvhd_status status = vulkan_layout_create(probe->device, 1, 0, 0, &probe->layout, error);
    if (status == BVHD_OK)
        status = vulkan_pipeline_create(probe->device, &probe->layout, VK_NULL_HANDLE, &code, &probe->pipeline, error);
    if (status == BVHD_OK)
        status = vulkan_set_create(probe->device, &probe->layout, &probe->set, error);
    if (status == BVHD_OK)
        status = vulkan_buffer_create(probe->device, BYTES * 2 * sizeof(float), VK_BUFFER_USAGE_STORAGE_BUFFER_BIT,
                                      VULKAN_READBACK, &probe->floats, error);
    return status;
}

static enum bvhd_status run_probe(struct trait_probe *probe, const struct bvhd_vulkan_queue *queue,
                                  struct bvhd_error *error)
{
    const VkDescriptorBufferInfo range = {probe->floats.buffer, 0, probe->floats.size};
    const VkMemoryBarrier written = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                     .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT,
                                     .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    vulkan_set_write(probe->device, &probe->layout, &probe->set, &range, NULL);
    enum bvhd_status status = vulkan_work_init(&probe->work, probe->device, queue, error);
    if (status == BVHD_OK)
        status = vulkan_work_begin(&probe->work, error);
    if (status != BVHD_OK)
        return status;
    vulkan_record_dispatch(probe->device, probe->work.commands, &probe->layout, probe->pipeline, &probe->set, NULL,
                           BYTES / PROBE_GROUP);
    probe->device->vk.CmdPipelineBarrier(probe->work.commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT,
                                         VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &written, 0, NULL, 0, NULL);
    return vulkan_work_run(&probe->work, error);
}

static bool are_kept(const float *pairs)
{
    for (int byte = 0; byte < BYTES; byte++)
        if (pairs[2 * byte] != (float)byte * 0x1p-24f || pairs[2 * byte + 1] != pairs[2 * byte])
            return false;
    return true;
}

bool vulkan_keeps_small_halves(const struct bvhd_vulkan_device *device, const struct bvhd_vulkan_queue *queue)
{
    struct trait_probe probe = {.device = device};
    struct bvhd_error unused;
    enum bvhd_status status = create_probe(&probe, &unused);
    if (status == BVHD_OK)
        status = run_probe(&probe, queue, &unused);
    bool keeps = status == BVHD_OK && are_kept((const float *)(const void *)probe.floats.mapped);
    vulkan_work_finish(&probe.work);
    vulkan_buffer_destroy(device, &probe.floats);
    vulkan_set_destroy(device, &probe.set);
    vulkan_pipeline_destroy(device, probe.pipeline);
    vulkan_layout_destroy(device, &probe.layout);
    return keeps;
}

/* ---- the rest ---- */

/* Vulkan lets fma() round twice. The hardware of these vendors has one that rounds once. */
static bool has_fused_fma(const struct vulkan_compute *compute)
{
    enum { AMD = 0x1002, NVIDIA = 0x10de, INTEL = 0x8086 };
    return compute->vendor == AMD || compute->vendor == NVIDIA || compute->vendor == INTEL;
}

/*
 * Vulkan tells whether there are doubles, not how quick they are. NVIDIA's multiprocessors that hold 64 warps are those
 * of its larger chips, with a double for every two floats; others have one for 32 or 64. A CPU takes twice the time.
 */
static bool has_quick_doubles(const struct vulkan_compute *compute)
{
    enum { WARPS = 64 };
    return compute->multiprocessors ? compute->warps >= WARPS : compute->type == VK_PHYSICAL_DEVICE_TYPE_CPU;
}

struct vulkan_trace_traits vulkan_trace_traits_of(struct bvhd_vulkan_device *device,
                                                  const struct bvhd_vulkan_queue *queue, bool has_float64)
{
    const VkSubgroupFeatureFlags ballots = VK_SUBGROUP_FEATURE_BASIC_BIT | VK_SUBGROUP_FEATURE_BALLOT_BIT,
                                 shuffles = ballots | VK_SUBGROUP_FEATURE_SHUFFLE_BIT | VK_SUBGROUP_FEATURE_VOTE_BIT;
    const struct vulkan_compute *compute = &device->compute;
    VkSubgroupFeatureFlags operations = compute->subgroup_operations;
    bool is_cpu = compute->type == VK_PHYSICAL_DEVICE_TYPE_CPU;
    return (struct vulkan_trace_traits){
        .has_quick_doubles = has_float64 && has_quick_doubles(compute),
        .has_small_halves = queue && !is_cpu && vulkan_keeps_small_halves(device, queue),
        .has_fused_fma = has_fused_fma(compute),
        .has_ballots = (operations & ballots) == ballots,
        .has_shuffles = (operations & shuffles) == shuffles && compute->subgroup_size <= 32 &&
                        VULKAN_TRACE_GROUP % compute->subgroup_size == 0,
        .is_cpu = is_cpu,
        .lanes = compute->subgroup_size,
        .multiprocessors = compute->multiprocessors,
    };
}
