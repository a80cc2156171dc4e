/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>

#include "tests/bench/bench_vulkan_kernel.h"

enum { MAX_STATISTICS = 64, MAX_EXECUTABLES = 4 };

static void print_statistic(const VkPipelineExecutableStatisticKHR *statistic)
{
    if (statistic->format == VK_PIPELINE_EXECUTABLE_STATISTIC_FORMAT_FLOAT64_KHR)
        printf("; %s %g", statistic->name, statistic->value.f64);
    else if (statistic->format == VK_PIPELINE_EXECUTABLE_STATISTIC_FORMAT_INT64_KHR)
        printf("; %s %" PRId64, statistic->name, statistic->value.i64);
    else if (statistic->format == VK_PIPELINE_EXECUTABLE_STATISTIC_FORMAT_UINT64_KHR)
        printf("; %s %" PRIu64, statistic->name, statistic->value.u64);
    else
        printf("; %s %s", statistic->name, statistic->value.b32 ? "yes" : "no");
}

static void print_executable(struct gpu *gpu, VkPipeline pipeline, uint32_t index)
{
    VkPipelineExecutableStatisticKHR statistics[MAX_STATISTICS];
    uint32_t count = MAX_STATISTICS;
    for (uint32_t i = 0; i < MAX_STATISTICS; i++)
        statistics[i] =
            (VkPipelineExecutableStatisticKHR){.sType = VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_STATISTIC_KHR};
    VkPipelineExecutableInfoKHR info = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_INFO_KHR, .pipeline = pipeline, .executableIndex = index};
    if (gpu->vk.GetPipelineExecutableStatisticsKHR(gpu->device, &info, &count, statistics) < 0)
        return;
    for (uint32_t i = 0; i < count; i++)
        print_statistic(&statistics[i]);
}

void bench_statistics_print(struct gpu *gpu, const char *name, VkPipeline pipeline)
{
    VkPipelineExecutablePropertiesKHR executables[MAX_EXECUTABLES];
    uint32_t count = MAX_EXECUTABLES;
    VkPipelineInfoKHR info = {.sType = VK_STRUCTURE_TYPE_PIPELINE_INFO_KHR, .pipeline = pipeline};
    for (uint32_t i = 0; i < MAX_EXECUTABLES; i++)
        executables[i] =
            (VkPipelineExecutablePropertiesKHR){.sType = VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_PROPERTIES_KHR};
    if (gpu->vk.GetPipelineExecutablePropertiesKHR(gpu->device, &info, &count, executables) < 0)
        return;
    for (uint32_t i = 0; i < count; i++) {
        printf("  %s: %s, subgroups of %u", name, executables[i].name, executables[i].subgroupSize);
        print_executable(gpu, pipeline, i);
        printf("\n");
    }
}

void bench_statistics_of(struct gpu *gpu, const char *name, const struct gpu_kernel_options *options,
                         VkPipelineLayout layout)
{
    VkSpecializationMapEntry entries[32];
    for (uint32_t i = 0; i < options->constant_count; i++)
        entries[i] = (VkSpecializationMapEntry){i, (uint32_t)(i * sizeof(uint32_t)), sizeof(uint32_t)};
    VkSpecializationInfo constants = {options->constant_count, entries, options->constant_count * sizeof(uint32_t),
                                      options->constants};
    VkShaderModuleCreateInfo module_info = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = options->size, .pCode = options->code};
    VkShaderModule module;
    VkPipeline pipeline;
    if (!gpu->vk.GetPipelineExecutablePropertiesKHR ||
        gpu->vk.CreateShaderModule(gpu->device, &module_info, NULL, &module))
        return;
    VkComputePipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                        .flags = VK_PIPELINE_CREATE_CAPTURE_STATISTICS_BIT_KHR,
                                        .stage = {.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                                  .stage = VK_SHADER_STAGE_COMPUTE_BIT,
                                                  .module = module,
                                                  .pName = "main",
                                                  .pSpecializationInfo = &constants},
                                        .layout = layout};
    if (!gpu->vk.CreateComputePipelines(gpu->device, VK_NULL_HANDLE, 1, &info, NULL, &pipeline)) {
        bench_statistics_print(gpu, name, pipeline);
        gpu->vk.DestroyPipeline(gpu->device, pipeline, NULL);
    }
    gpu->vk.DestroyShaderModule(gpu->device, module, NULL);
}
