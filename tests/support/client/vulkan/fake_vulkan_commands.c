/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/client/vulkan/fake_vulkan_objects.h"

#include "proto/base/bytes.h"
#include "builder/format/lavapipe.h"
#include "builder/format/serialized.h"

enum { MAX_COMMANDS = 4096 };

struct command {
    enum { COPY, FILL, DESERIALIZE, SERIALIZE, BUILD, QUERY } kind;
    struct object *source, *dest;
    unsigned char *from, *to;
    VkBufferCopy region;
    uint32_t row;
};

static struct command commands[MAX_COMMANDS];
static uint32_t command_count;
static bool is_recording, has_fill;
static bool is_under_way; /* no wait for the last submission has succeeded yet */

/* ---- Commands ---- */

static VkResult VKAPI_CALL create_pool(VkDevice device, const VkCommandPoolCreateInfo *info,
                                       const VkAllocationCallbacks *allocator, VkCommandPool *ret_pool)
{
    (void)device;
    (void)info;
    RETURN_FAILURE;
    *ret_pool = (VkCommandPool)(void *)fake_create(POOL, allocator);
    return VK_SUCCESS;
}

static void VKAPI_CALL destroy_pool(VkDevice device, VkCommandPool pool, const VkAllocationCallbacks *allocator)
{
    (void)device;
    is_recording = false;
    command_count = 0;
    fake_destroy(OBJECT(pool), POOL, allocator);
}

static VkResult VKAPI_CALL allocate_commands(VkDevice device, const VkCommandBufferAllocateInfo *info,
                                             VkCommandBuffer *ret_commands)
{
    (void)device;
    RETURN_FAILURE;
    assert_int_equal(info->commandBufferCount, 1);
    *ret_commands = (VkCommandBuffer)(void *)&fake_command_buffer;
    return VK_SUCCESS;
}

static VkResult VKAPI_CALL reset_pool(VkDevice device, VkCommandPool pool, VkCommandPoolResetFlags flags)
{
    (void)device;
    (void)pool;
    (void)flags;
    RETURN_FAILURE;
    assert_false(is_recording);
    command_count = 0;
    return VK_SUCCESS;
}

static VkResult VKAPI_CALL begin_commands(VkCommandBuffer buffer, const VkCommandBufferBeginInfo *info)
{
    (void)info;
    RETURN_FAILURE;
    assert_ptr_equal(buffer, &fake_command_buffer);
    assert_false(is_recording);
    assert_int_equal(command_count, 0);
    is_recording = true;
    return VK_SUCCESS;
}

static VkResult VKAPI_CALL end_commands(VkCommandBuffer buffer)
{
    (void)buffer;
    assert_true(is_recording);
    is_recording = false;
    return fake_turn();
}

static void record(struct command command)
{
    assert_true(is_recording && command_count < MAX_COMMANDS);
    commands[command_count++] = command;
}

static void VKAPI_CALL copy_buffer(VkCommandBuffer buffer, VkBuffer source, VkBuffer dest, uint32_t count,
                                   const VkBufferCopy *regions)
{
    (void)buffer;
    assert_true(OBJECT(source)->usage & VK_BUFFER_USAGE_TRANSFER_SRC_BIT &&
                OBJECT(dest)->usage & VK_BUFFER_USAGE_TRANSFER_DST_BIT);
    for (uint32_t i = 0; i < count; i++) {
        assert_true(regions[i].size > 0 && regions[i].srcOffset + regions[i].size <= OBJECT(source)->size);
        assert_true(regions[i].dstOffset + regions[i].size <= OBJECT(dest)->size);
        record((struct command){.kind = COPY, .source = OBJECT(source), .dest = OBJECT(dest), .region = regions[i]});
    }
}

static void VKAPI_CALL fill_buffer(VkCommandBuffer buffer, VkBuffer dest, VkDeviceSize offset, VkDeviceSize size,
                                   uint32_t value)
{
    (void)buffer;
    if (size == VK_WHOLE_SIZE)
        size = OBJECT(dest)->size - offset;
    assert_true(OBJECT(dest)->usage & VK_BUFFER_USAGE_TRANSFER_DST_BIT);
    assert_true(offset % 4 == 0 && offset + size <= OBJECT(dest)->size && value == 0);
    record((struct command){.kind = FILL, .dest = OBJECT(dest), .region = {.dstOffset = offset, .size = size}});
}

static void VKAPI_CALL barrier(VkCommandBuffer buffer, VkPipelineStageFlags source, VkPipelineStageFlags dest,
                               VkDependencyFlags flags, uint32_t count, const VkMemoryBarrier *barriers,
                               uint32_t buffer_count, const VkBufferMemoryBarrier *buffer_barriers,
                               uint32_t image_count, const VkImageMemoryBarrier *image_barriers)
{
    (void)buffer;
    (void)flags;
    (void)buffer_barriers;
    (void)image_barriers;
    assert_true(source && dest && count == 1 && barriers && buffer_count == 0 && image_count == 0);
    fake_vulkan.barrier_stages = source;
    fake_vulkan.barrier_writes = barriers->srcAccessMask;
}

static void VKAPI_CALL deserialize(VkCommandBuffer buffer, const VkCopyMemoryToAccelerationStructureInfoKHR *info)
{
    (void)buffer;
    assert_int_equal(info->src.deviceAddress % 256, 0);
    assert_int_equal(info->mode, VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR);
    record((struct command){
        .kind = DESERIALIZE, .from = (unsigned char *)(uintptr_t)info->src.deviceAddress, .dest = OBJECT(info->dst)});
}

static void VKAPI_CALL serialize(VkCommandBuffer buffer, const VkCopyAccelerationStructureToMemoryInfoKHR *info)
{
    (void)buffer;
    assert_int_equal(info->dst.deviceAddress % 256, 0);
    record((struct command){
        .kind = SERIALIZE, .source = OBJECT(info->src), .to = (unsigned char *)(uintptr_t)info->dst.deviceAddress});
}

static void VKAPI_CALL build_structures(VkCommandBuffer buffer, uint32_t count,
                                        const VkAccelerationStructureBuildGeometryInfoKHR *infos,
                                        const VkAccelerationStructureBuildRangeInfoKHR *const *ranges)
{
    (void)buffer;
    assert_true(count == 1 && infos->scratchData.deviceAddress % 128 == 0 && ranges[0]);
    bool is_top = infos->type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
    record((struct command){
        .kind = BUILD,
        .dest = OBJECT(infos->dstAccelerationStructure),
        .from = is_top ? (unsigned char *)(uintptr_t)infos->pGeometries->geometry.instances.data.deviceAddress : NULL,
        .row = ranges[0]->primitiveCount});
}

static void VKAPI_CALL write_properties(VkCommandBuffer buffer, uint32_t count,
                                        const VkAccelerationStructureKHR *structures, VkQueryType type,
                                        VkQueryPool pool, uint32_t first)
{
    (void)buffer;
    assert_int_equal(type, VK_QUERY_TYPE_ACCELERATION_STRUCTURE_SERIALIZATION_SIZE_KHR);
    for (uint32_t i = 0; i < count; i++)
        record(
            (struct command){.kind = QUERY, .source = OBJECT(structures[i]), .dest = OBJECT(pool), .row = first + i});
}

static void VKAPI_CALL reset_queries(VkCommandBuffer buffer, VkQueryPool pool, uint32_t first, uint32_t count)
{
    (void)buffer;
    (void)pool;
    (void)first;
    (void)count;
}

/* ---- Running commands ---- */

static void run_deserialize(const struct command *command)
{
    struct serialized_header header;
    uint64_t size = bytes_get64(command->from + 32);
    assert_int_equal(serialized_read((struct bytes){command->from, size}, &header, NULL), BVHD_OK);
    assert_int_equal(command->dest->size, header.deserialized_size);
    const unsigned char *body = command->from + SERIALIZED_HANDLES + 8 * header.handle_count;
    unsigned char *to = fake_structure_bytes(command->dest);
    memcpy(to, body, header.deserialized_size);
    uint32_t leaves = bytes_get32(body + 32);
    for (uint64_t i = 0; i < header.handle_count; i++)
        memcpy(to + leaves + i * sizeof(struct lavapipe_instance), command->from + SERIALIZED_HANDLES + 8 * i, 8);
}

static void run(const struct command *command)
{
    switch (command->kind) {
    case COPY:
        memcpy(command->dest->memory->bytes + command->region.dstOffset,
               command->source->memory->bytes + command->region.srcOffset, command->region.size);
        break;
    case FILL:
        memset(command->dest->memory->bytes + command->region.dstOffset, 0, command->region.size);
        has_fill = true;
        break;
    case DESERIALIZE:
        run_deserialize(command);
        break;
    case SERIALIZE:
        memset(command->to, 0, SERIALIZED_HANDLES);
        memcpy(command->to + SERIALIZED_HANDLES, fake_structure_bytes(command->source), command->source->size);
        break;
    case BUILD:
        memset(fake_structure_bytes(command->dest), (int)command->dest->size, 64);
        /* Writes the addresses that instances name, at odd offsets. */
        for (uint32_t i = 0; command->from && i < command->row; i++)
            memcpy(fake_structure_bytes(command->dest) + 64 + 9 * i, command->from + 64 * i + 56, 8);
        break;
    case QUERY:
        command->dest->results[command->row] = SERIALIZED_HANDLES + command->source->size;
        break;
    }
}

static void run_all(void)
{
    for (uint32_t i = 0; i < command_count; i++)
        run(&commands[i]);
    command_count = 0;
}

static VkResult VKAPI_CALL submit(VkQueue queue, uint32_t count, const VkSubmitInfo *submits, VkFence fence)
{
    RETURN_FAILURE;
    assert_ptr_equal(queue, &fake_queue);
    assert_true(count == 1 && submits->commandBufferCount == 1 && !is_recording && !OBJECT(fence)->is_signalled);
    run_all();
    OBJECT(fence)->is_signalled = true;
    is_under_way = true;
    fake_vulkan.submissions++;
    return VK_SUCCESS;
}

static VkResult VKAPI_CALL create_fence(VkDevice device, const VkFenceCreateInfo *info,
                                        const VkAllocationCallbacks *allocator, VkFence *ret_fence)
{
    (void)device;
    (void)info;
    RETURN_FAILURE;
    *ret_fence = (VkFence)(void *)fake_create(FENCE, allocator);
    return VK_SUCCESS;
}

static void VKAPI_CALL destroy_fence(VkDevice device, VkFence fence, const VkAllocationCallbacks *allocator)
{
    (void)device;
    fake_destroy(OBJECT(fence), FENCE, allocator);
}

static VkResult VKAPI_CALL wait_for_fences(VkDevice device, uint32_t count, const VkFence *fences, VkBool32 all,
                                           uint64_t timeout)
{
    (void)device;
    (void)all;
    RETURN_FAILURE;
    assert_true(count == 1 && OBJECT(*fences)->is_signalled && timeout == UINT64_MAX);
    is_under_way = false;
    return VK_SUCCESS;
}

static VkResult VKAPI_CALL wait_for_queue(VkQueue queue)
{
    RETURN_FAILURE;
    assert_ptr_equal(queue, &fake_queue);
    is_under_way = false;
    return VK_SUCCESS;
}

static VkResult VKAPI_CALL reset_fences(VkDevice device, uint32_t count, const VkFence *fences)
{
    (void)device;
    RETURN_FAILURE;
    assert_int_equal(count, 1);
    OBJECT(*fences)->is_signalled = false;
    return VK_SUCCESS;
}

static VkResult VKAPI_CALL create_queries(VkDevice device, const VkQueryPoolCreateInfo *info,
                                          const VkAllocationCallbacks *allocator, VkQueryPool *ret_pool)
{
    (void)device;
    RETURN_FAILURE;
    assert_true(info->queryCount <= 8);
    *ret_pool = (VkQueryPool)(void *)fake_create(QUERIES, allocator);
    return VK_SUCCESS;
}

static void VKAPI_CALL destroy_queries(VkDevice device, VkQueryPool pool, const VkAllocationCallbacks *allocator)
{
    (void)device;
    fake_destroy(OBJECT(pool), QUERIES, allocator);
}

static VkResult VKAPI_CALL query_results(VkDevice device, VkQueryPool pool, uint32_t first, uint32_t count, size_t size,
                                         void *data, VkDeviceSize stride, VkQueryResultFlags flags)
{
    (void)device;
    (void)first;
    RETURN_FAILURE;
    assert_true(stride == 8 && size == (size_t)8 * count && flags & VK_QUERY_RESULT_64_BIT && has_fill);
    memcpy(data, OBJECT(pool)->results, size);
    return VK_SUCCESS;
}

/* ---- Looking up functions ---- */

#define ROW(name, function)                                                                                            \
    {                                                                                                                  \
        "vk" name, (PFN_vkVoidFunction)(function)                                                                      \
    }
static const struct {
    const char *name;
    PFN_vkVoidFunction function;
} functions[] = {
    ROW("AllocateCommandBuffers", allocate_commands),
    ROW("BeginCommandBuffer", begin_commands),
    ROW("CmdBuildAccelerationStructuresKHR", build_structures),
    ROW("CmdCopyAccelerationStructureToMemoryKHR", serialize),
    ROW("CmdCopyBuffer", copy_buffer),
    ROW("CmdCopyMemoryToAccelerationStructureKHR", deserialize),
    ROW("CmdFillBuffer", fill_buffer),
    ROW("CmdPipelineBarrier", barrier),
    ROW("CmdResetQueryPool", reset_queries),
    ROW("CmdWriteAccelerationStructuresPropertiesKHR", write_properties),
    ROW("CreateCommandPool", create_pool),
    ROW("CreateFence", create_fence),
    ROW("CreateQueryPool", create_queries),
    ROW("DestroyCommandPool", destroy_pool),
    ROW("DestroyFence", destroy_fence),
    ROW("DestroyQueryPool", destroy_queries),
    ROW("EndCommandBuffer", end_commands),
    ROW("GetQueryPoolResults", query_results),
    ROW("QueueSubmit", submit),
    ROW("QueueWaitIdle", wait_for_queue),
    ROW("ResetCommandPool", reset_pool),
    ROW("ResetFences", reset_fences),
    ROW("WaitForFences", wait_for_fences),
};

PFN_vkVoidFunction fake_commands_find(const char *name)
{
    for (size_t i = 0; i < sizeof functions / sizeof functions[0]; i++)
        if (strcmp(functions[i].name, name) == 0)
            return functions[i].function;
    return NULL;
}

void fake_commands_reset(void)
{
    command_count = 0;
    is_recording = has_fill = is_under_way = false;
}

bool fake_commands_are_under_way(void)
{
    return is_under_way;
}

bool fake_commands_are_recording(void)
{
    return is_recording;
}

void fake_commands_run(void)
{
    is_recording = false;
    run_all();
}

VkCommandBuffer fake_vulkan_commands(void)
{
    is_recording = true;
    return (VkCommandBuffer)(void *)&fake_command_buffer;
}

uint32_t fake_vulkan_recorded(void)
{
    return command_count;
}

void fake_vulkan_submit(void)
{
    fake_commands_run();
}
