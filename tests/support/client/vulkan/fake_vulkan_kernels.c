/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/client/vulkan/fake_vulkan_objects.h"

static struct object *bound_pipeline, *bound_set;

/* ---- objects ---- */

static VkResult VKAPI_CALL create_set_layout(VkDevice device, const VkDescriptorSetLayoutCreateInfo *info,
                                             const VkAllocationCallbacks *allocator, VkDescriptorSetLayout *ret_layout)
{
    (void)device;
    RETURN_FAILURE;
    assert_true(info->bindingCount > 0);
    struct object *layout = fake_create(SET_LAYOUT, allocator);
    layout->size = info->bindingCount;
    *ret_layout = (VkDescriptorSetLayout)(void *)layout;
    return VK_SUCCESS;
}

static void VKAPI_CALL destroy_set_layout(VkDevice device, VkDescriptorSetLayout layout,
                                          const VkAllocationCallbacks *allocator)
{
    (void)device;
    fake_destroy(OBJECT(layout), SET_LAYOUT, allocator);
}

static VkResult VKAPI_CALL create_pipeline_layout(VkDevice device, const VkPipelineLayoutCreateInfo *info,
                                                  const VkAllocationCallbacks *allocator, VkPipelineLayout *ret_layout)
{
    (void)device;
    RETURN_FAILURE;
    assert_true(info->setLayoutCount == 1 && OBJECT(*info->pSetLayouts)->kind == SET_LAYOUT);
    struct object *layout = fake_create(PIPELINE_LAYOUT, allocator);
    layout->size = info->pushConstantRangeCount ? info->pPushConstantRanges->size : 0;
    *ret_layout = (VkPipelineLayout)(void *)layout;
    return VK_SUCCESS;
}

static void VKAPI_CALL destroy_pipeline_layout(VkDevice device, VkPipelineLayout layout,
                                               const VkAllocationCallbacks *allocator)
{
    (void)device;
    fake_destroy(OBJECT(layout), PIPELINE_LAYOUT, allocator);
}

static VkResult VKAPI_CALL create_module(VkDevice device, const VkShaderModuleCreateInfo *info,
                                         const VkAllocationCallbacks *allocator, VkShaderModule *ret_module)
{
    (void)device;
    RETURN_FAILURE;
    assert_true(info->codeSize > 20 && info->codeSize % 4 == 0 && info->pCode[0] == 0x07230203);
    *ret_module = (VkShaderModule)(void *)fake_create(MODULE, allocator);
    return VK_SUCCESS;
}

static void VKAPI_CALL destroy_module(VkDevice device, VkShaderModule module, const VkAllocationCallbacks *allocator)
{
    (void)device;
    fake_destroy(OBJECT(module), MODULE, allocator);
}

static VkResult VKAPI_CALL create_pipelines(VkDevice device, VkPipelineCache cache, uint32_t count,
                                            const VkComputePipelineCreateInfo *infos,
                                            const VkAllocationCallbacks *allocator, VkPipeline *ret_pipelines)
{
    (void)device;
    (void)cache;
    RETURN_FAILURE;
    assert_int_equal(count, 1);
    assert_int_equal(OBJECT(infos->stage.module)->kind, MODULE);
    assert_int_equal(OBJECT(infos->layout)->kind, PIPELINE_LAYOUT);
    struct object *pipeline = fake_create(PIPELINE, allocator);
    if (infos->stage.pSpecializationInfo)
        memcpy(&pipeline->size, infos->stage.pSpecializationInfo->pData, sizeof(uint32_t));
    *ret_pipelines = (VkPipeline)(void *)pipeline;
    return VK_SUCCESS;
}

static void VKAPI_CALL destroy_pipeline(VkDevice device, VkPipeline pipeline, const VkAllocationCallbacks *allocator)
{
    (void)device;
    fake_destroy(OBJECT(pipeline), PIPELINE, allocator);
}

static VkResult VKAPI_CALL create_sets(VkDevice device, const VkDescriptorPoolCreateInfo *info,
                                       const VkAllocationCallbacks *allocator, VkDescriptorPool *ret_pool)
{
    (void)device;
    RETURN_FAILURE;
    assert_int_equal(info->maxSets, 1);
    *ret_pool = (VkDescriptorPool)(void *)fake_create(SETS, allocator);
    return VK_SUCCESS;
}

static void VKAPI_CALL destroy_sets(VkDevice device, VkDescriptorPool pool, const VkAllocationCallbacks *allocator)
{
    (void)device;
    fake_destroy(OBJECT(pool), SETS, allocator);
}

/* The one set of a pool is the pool. */
static VkResult VKAPI_CALL allocate_sets(VkDevice device, const VkDescriptorSetAllocateInfo *info,
                                         VkDescriptorSet *ret_sets)
{
    (void)device;
    RETURN_FAILURE;
    assert_int_equal(info->descriptorSetCount, 1);
    assert_int_equal(OBJECT(info->descriptorPool)->kind, SETS);
    *ret_sets = (VkDescriptorSet)(void *)OBJECT(info->descriptorPool);
    return VK_SUCCESS;
}

static void VKAPI_CALL update_sets(VkDevice device, uint32_t count, const VkWriteDescriptorSet *writes,
                                   uint32_t copy_count, const VkCopyDescriptorSet *copies)
{
    (void)device;
    (void)copies;
    assert_int_equal(copy_count, 0);
    for (uint32_t i = 0; i < count; i++) {
        const VkDescriptorBufferInfo *range = writes[i].pBufferInfo;
        assert_int_equal(OBJECT(writes[i].dstSet)->kind, SETS);
        assert_true(OBJECT(range->buffer)->usage & VK_BUFFER_USAGE_STORAGE_BUFFER_BIT);
        assert_true(range->offset % 128 == 0 && range->range > 0 && range->range <= fake_vulkan.max_storage_range);
        assert_true(range->offset + range->range <= OBJECT(range->buffer)->size);
        OBJECT(writes[i].dstSet)->results[writes[i].dstBinding] = range->range;
    }
}

/* ---- commands ---- */

static void VKAPI_CALL bind_pipeline(VkCommandBuffer buffer, VkPipelineBindPoint point, VkPipeline pipeline)
{
    (void)buffer;
    assert_int_equal(point, VK_PIPELINE_BIND_POINT_COMPUTE);
    bound_pipeline = OBJECT(pipeline);
}

static void VKAPI_CALL bind_sets(VkCommandBuffer buffer, VkPipelineBindPoint point, VkPipelineLayout layout,
                                 uint32_t first, uint32_t count, const VkDescriptorSet *sets, uint32_t offset_count,
                                 const uint32_t *offsets)
{
    (void)buffer;
    (void)offsets;
    assert_int_equal(point, VK_PIPELINE_BIND_POINT_COMPUTE);
    assert_int_equal(OBJECT(layout)->kind, PIPELINE_LAYOUT);
    assert_true(first == 0 && count == 1 && offset_count == 0);
    bound_set = OBJECT(*sets);
}

static void VKAPI_CALL push_constants(VkCommandBuffer buffer, VkPipelineLayout layout, VkShaderStageFlags stages,
                                      uint32_t offset, uint32_t size, const void *values)
{
    (void)buffer;
    assert_true(stages == VK_SHADER_STAGE_COMPUTE_BIT && offset == 0 && size == OBJECT(layout)->size && values);
}

static void VKAPI_CALL dispatch(VkCommandBuffer buffer, uint32_t x, uint32_t y, uint32_t z)
{
    (void)buffer;
    assert_true(fake_commands_are_recording() && x > 0 && x <= 65535 && y == 1 && z == 1);
    assert_true(bound_pipeline && bound_pipeline->kind == PIPELINE && bound_set && bound_set->kind == SETS);
    uint32_t index = fake_vulkan.dispatch_count++;
    if (index >= sizeof fake_vulkan.dispatches / sizeof fake_vulkan.dispatches[0])
        return;
    fake_vulkan.dispatches[index].pipeline = (VkPipeline)(void *)bound_pipeline;
    fake_vulkan.dispatches[index].groups = x;
    fake_vulkan.dispatches[index].group_size = (uint32_t)bound_pipeline->size;
}

/* ---- looking functions up ---- */

#define ROW(name, function)                                                                                            \
    {                                                                                                                  \
        "vk" name, (PFN_vkVoidFunction)(function)                                                                      \
    }
static const struct {
    const char *name;
    PFN_vkVoidFunction function;
} functions[] = {
    ROW("AllocateDescriptorSets", allocate_sets),
    ROW("CmdBindDescriptorSets", bind_sets),
    ROW("CmdBindPipeline", bind_pipeline),
    ROW("CmdDispatch", dispatch),
    ROW("CmdPushConstants", push_constants),
    ROW("CreateComputePipelines", create_pipelines),
    ROW("CreateDescriptorPool", create_sets),
    ROW("CreateDescriptorSetLayout", create_set_layout),
    ROW("CreatePipelineLayout", create_pipeline_layout),
    ROW("CreateShaderModule", create_module),
    ROW("DestroyDescriptorPool", destroy_sets),
    ROW("DestroyDescriptorSetLayout", destroy_set_layout),
    ROW("DestroyPipeline", destroy_pipeline),
    ROW("DestroyPipelineLayout", destroy_pipeline_layout),
    ROW("DestroyShaderModule", destroy_module),
    ROW("UpdateDescriptorSets", update_sets),
};

PFN_vkVoidFunction fake_kernels_find(const char *name)
{
    for (size_t i = 0; i < sizeof functions / sizeof functions[0]; i++)
        if (strcmp(functions[i].name, name) == 0)
            return functions[i].function;
    return NULL;
}

void fake_kernels_reset(void)
{
    bound_pipeline = bound_set = NULL;
}
