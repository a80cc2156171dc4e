/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/client/vulkan/fake_vulkan_objects.h"

#include "proto/base/bytes.h"

enum { SKEW = 64 /* largest alignment of memory addresses */ };

struct fake_vulkan fake_vulkan;
int fake_instance, fake_physical, fake_device, fake_queue, fake_command_buffer;
const VkAllocationCallbacks *fake_allocator;
static uint64_t mapped_bytes;

VkResult fake_turn(void)
{
    fake_vulkan.calls++;
    if (fake_vulkan.fail_after < 0 || fake_vulkan.fail_after-- > 0)
        return VK_SUCCESS;
    return fake_vulkan.failure;
}

struct object *fake_create(enum kind kind, const VkAllocationCallbacks *allocator)
{
    struct object *object = calloc(1, sizeof *object);
    assert_non_null(object);
    assert_ptr_equal(allocator, fake_allocator);
    object->kind = kind;
    object->allocator = allocator;
    fake_vulkan.live++;
    return object;
}

void fake_destroy(struct object *object, enum kind kind, const VkAllocationCallbacks *allocator)
{
    assert_non_null(object);
    assert_int_equal(object->kind, kind);
    assert_ptr_equal(object->allocator, allocator);
    assert_true(!fake_commands_are_recording() || (kind != BUFFER && kind != MEMORY));
    assert_false(fake_commands_are_under_way());
    fake_vulkan.live--;
    free(object->block);
    free(object);
}

/* ---- Memory and buffers ---- */

static const VkMemoryPropertyFlags memory_types[] = {
    VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT | VK_MEMORY_PROPERTY_PROTECTED_BIT,
    VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT,
    VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT,
    VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT,
};
enum { TYPES = sizeof memory_types / sizeof memory_types[0], PROTECTED_TYPE = 0, LOCAL_TYPE = 1, COHERENT_TYPE = 3 };

static VkResult VKAPI_CALL allocate_memory(VkDevice device, const VkMemoryAllocateInfo *info,
                                           const VkAllocationCallbacks *allocator, VkDeviceMemory *ret_memory)
{
    (void)device;
    RETURN_FAILURE;
    assert_true(info->memoryTypeIndex < TYPES && info->memoryTypeIndex != PROTECTED_TYPE);
    assert_true(info->allocationSize <= fake_vulkan.max_allocation + SKEW);
    if (info->memoryTypeIndex == LOCAL_TYPE && info->allocationSize > fake_vulkan.local_left)
        return VK_ERROR_OUT_OF_DEVICE_MEMORY;
    struct object *memory = fake_create(MEMORY, allocator);
    const VkMemoryAllocateFlagsInfo *flags = info->pNext;
    memory->size = info->allocationSize;
    memory->type = info->memoryTypeIndex;
    memory->has_address = flags && flags->flags == VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT;
    memory->block = aligned_alloc(256, (size_t)bytes_align(info->allocationSize + SKEW, 256));
    assert_non_null(memory->block);
    memory->bytes = memory->block + SKEW;
    memset(memory->block, 0xee, (size_t)(info->allocationSize + SKEW));
    fake_vulkan.allocations++;
    *ret_memory = (VkDeviceMemory)(void *)memory;
    return VK_SUCCESS;
}

static void VKAPI_CALL free_memory(VkDevice device, VkDeviceMemory memory, const VkAllocationCallbacks *allocator)
{
    (void)device;
    if (OBJECT(memory)->is_mapped)
        mapped_bytes -= OBJECT(memory)->size;
    fake_destroy(OBJECT(memory), MEMORY, allocator);
}

static VkResult VKAPI_CALL map_memory(VkDevice device, VkDeviceMemory handle, VkDeviceSize offset, VkDeviceSize size,
                                      VkMemoryMapFlags flags, void **ret_data)
{
    struct object *memory = OBJECT(handle);
    (void)device;
    (void)flags;
    RETURN_FAILURE;
    assert_int_equal(memory->type, COHERENT_TYPE);
    assert_int_equal(offset, 0);
    assert_true(size == VK_WHOLE_SIZE && !memory->is_mapped);
    memory->is_mapped = true;
    mapped_bytes += memory->size;
    if (mapped_bytes > fake_vulkan.host_bytes)
        fake_vulkan.host_bytes = mapped_bytes;
    *ret_data = memory->bytes;
    return VK_SUCCESS;
}

static VkResult VKAPI_CALL create_buffer(VkDevice device, const VkBufferCreateInfo *info,
                                         const VkAllocationCallbacks *allocator, VkBuffer *ret_buffer)
{
    (void)device;
    RETURN_FAILURE;
    assert_true(info->size > 0 && info->size <= fake_vulkan.max_buffer);
    struct object *buffer = fake_create(BUFFER, allocator);
    buffer->size = info->size;
    buffer->usage = info->usage;
    *ret_buffer = (VkBuffer)(void *)buffer;
    return VK_SUCCESS;
}

static void VKAPI_CALL destroy_buffer(VkDevice device, VkBuffer buffer, const VkAllocationCallbacks *allocator)
{
    (void)device;
    fake_destroy(OBJECT(buffer), BUFFER, allocator);
}

static void VKAPI_CALL buffer_requirements(VkDevice device, VkBuffer buffer, VkMemoryRequirements *ret_requirements)
{
    (void)device;
    *ret_requirements = (VkMemoryRequirements){OBJECT(buffer)->size, SKEW, (1 << TYPES) - 1};
}

static VkResult VKAPI_CALL bind_memory(VkDevice device, VkBuffer buffer, VkDeviceMemory memory, VkDeviceSize offset)
{
    (void)device;
    RETURN_FAILURE;
    assert_int_equal(offset, 0);
    assert_true(OBJECT(buffer)->size <= OBJECT(memory)->size);
    assert_true(!(OBJECT(buffer)->usage & VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT) || OBJECT(memory)->has_address);
    OBJECT(buffer)->memory = OBJECT(memory);
    return VK_SUCCESS;
}

static VkDeviceAddress VKAPI_CALL buffer_address(VkDevice device, const VkBufferDeviceAddressInfo *info)
{
    struct object *buffer = OBJECT(info->buffer);
    (void)device;
    assert_true(buffer->usage & VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT);
    return (VkDeviceAddress)(uintptr_t)buffer->memory->bytes;
}

/* ---- Structures ---- */

static VkResult VKAPI_CALL create_structure(VkDevice device, const VkAccelerationStructureCreateInfoKHR *info,
                                            const VkAllocationCallbacks *allocator,
                                            VkAccelerationStructureKHR *ret_structure)
{
    (void)device;
    RETURN_FAILURE;
    struct object *buffer = OBJECT(info->buffer);
    assert_int_equal(info->offset % 256, 0);
    assert_true(buffer->usage & VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR);
    assert_true(info->offset + info->size <= buffer->size);
    struct object *structure = fake_create(STRUCTURE, allocator);
    structure->buffer = buffer;
    structure->offset = info->offset;
    structure->size = info->size;
    structure->type = (uint32_t)info->type;
    fake_vulkan.structures++;
    *ret_structure = (VkAccelerationStructureKHR)(void *)structure;
    return VK_SUCCESS;
}

static void VKAPI_CALL destroy_structure(VkDevice device, VkAccelerationStructureKHR structure,
                                         const VkAllocationCallbacks *allocator)
{
    (void)device;
    fake_destroy(OBJECT(structure), STRUCTURE, allocator);
}

unsigned char *fake_structure_bytes(const struct object *structure)
{
    return structure->buffer->memory->bytes + structure->offset;
}

static VkDeviceAddress VKAPI_CALL structure_address(VkDevice device,
                                                    const VkAccelerationStructureDeviceAddressInfoKHR *info)
{
    (void)device;
    return (VkDeviceAddress)(uintptr_t)fake_structure_bytes(OBJECT(info->accelerationStructure));
}

static void VKAPI_CALL build_sizes(VkDevice device, VkAccelerationStructureBuildTypeKHR type,
                                   const VkAccelerationStructureBuildGeometryInfoKHR *info, const uint32_t *counts,
                                   VkAccelerationStructureBuildSizesInfoKHR *ret_sizes)
{
    (void)device;
    assert_int_equal(type, VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR);
    ret_sizes->accelerationStructureSize = 128;
    for (uint32_t i = 0; i < info->geometryCount; i++)
        ret_sizes->accelerationStructureSize += (uint64_t)64 * counts[i];
    ret_sizes->buildScratchSize = 512;
}

static void VKAPI_CALL compatibility(VkDevice device, const VkAccelerationStructureVersionInfoKHR *info,
                                     VkAccelerationStructureCompatibilityKHR *ret_answer)
{
    (void)device;
    assert_non_null(info->pVersionData);
    *ret_answer = fake_vulkan.is_updated ? VK_ACCELERATION_STRUCTURE_COMPATIBILITY_INCOMPATIBLE_KHR
                                         : VK_ACCELERATION_STRUCTURE_COMPATIBILITY_COMPATIBLE_KHR;
}

/* ---- The physical device ---- */

static void VKAPI_CALL get_properties(VkPhysicalDevice physical, VkPhysicalDeviceProperties2 *properties)
{
    assert_ptr_equal(physical, &fake_physical);
    snprintf(properties->properties.deviceName, sizeof properties->properties.deviceName, "plain memory");
    properties->properties.limits.maxStorageBufferRange = (uint32_t)fake_vulkan.max_storage_range;
    properties->properties.limits.minStorageBufferOffsetAlignment = 128;
    properties->properties.apiVersion = fake_vulkan.api_version;
    properties->properties.limits.maxComputeWorkGroupCount[0] = 65535;
    properties->properties.limits.maxComputeWorkGroupInvocations = 1024;
    properties->properties.limits.maxComputeWorkGroupSize[0] = 1024;
    for (VkBaseOutStructure *next = properties->pNext; next; next = next->pNext)
        switch (next->sType) {
        case VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES: {
            VkPhysicalDeviceSubgroupProperties *subgroup = (void *)next;
            subgroup->subgroupSize = 32;
            subgroup->supportedStages = VK_SHADER_STAGE_COMPUTE_BIT;
            subgroup->supportedOperations = fake_vulkan.subgroup_operations;
            break;
        }
        case VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES:
            ((VkPhysicalDeviceMaintenance3Properties *)(void *)next)->maxMemoryAllocationSize =
                fake_vulkan.max_allocation;
            break;
        case VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_4_PROPERTIES:
            ((VkPhysicalDeviceMaintenance4Properties *)(void *)next)->maxBufferSize = fake_vulkan.max_buffer;
            break;
        case VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_PROPERTIES_KHR: {
            VkPhysicalDeviceAccelerationStructurePropertiesKHR *limits = (void *)next;
            limits->maxPrimitiveCount = fake_vulkan.max_primitives;
            limits->maxInstanceCount = fake_vulkan.max_instances;
            limits->minAccelerationStructureScratchOffsetAlignment = 128;
            break;
        }
        default:
            fail_msg("a struct that this device does not know");
        }
}

static void VKAPI_CALL get_memory(VkPhysicalDevice physical, VkPhysicalDeviceMemoryProperties *ret_memory)
{
    (void)physical;
    memset(ret_memory, 0, sizeof *ret_memory);
    ret_memory->memoryTypeCount = TYPES;
    for (int i = 0; i < TYPES; i++)
        ret_memory->memoryTypes[i].propertyFlags = memory_types[i];
}

static VkResult VKAPI_CALL enumerate_extensions(VkPhysicalDevice physical, const char *layer, uint32_t *count,
                                                VkExtensionProperties *ret_properties)
{
    (void)physical;
    (void)layer;
    RETURN_FAILURE;
    *count = 1;
    if (ret_properties)
        snprintf(ret_properties->extensionName, sizeof ret_properties->extensionName,
                 VK_KHR_MAINTENANCE_4_EXTENSION_NAME);
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
    ROW("AllocateMemory", allocate_memory),
    ROW("BindBufferMemory", bind_memory),
    ROW("CreateAccelerationStructureKHR", create_structure),
    ROW("CreateBuffer", create_buffer),
    ROW("DestroyAccelerationStructureKHR", destroy_structure),
    ROW("DestroyBuffer", destroy_buffer),
    ROW("EnumerateDeviceExtensionProperties", enumerate_extensions),
    ROW("FreeMemory", free_memory),
    ROW("GetAccelerationStructureBuildSizesKHR", build_sizes),
    ROW("GetAccelerationStructureDeviceAddressKHR", structure_address),
    ROW("GetBufferDeviceAddress", buffer_address),
    ROW("GetBufferMemoryRequirements", buffer_requirements),
    ROW("GetDeviceAccelerationStructureCompatibilityKHR", compatibility),
    ROW("GetPhysicalDeviceMemoryProperties", get_memory),
    ROW("GetPhysicalDeviceProperties2", get_properties),
    ROW("MapMemory", map_memory),
};

static PFN_vkVoidFunction find(const char *name)
{
    for (size_t i = 0; i < sizeof functions / sizeof functions[0]; i++)
        if (strcmp(functions[i].name, name) == 0 && !(fake_vulkan.missing && strcmp(fake_vulkan.missing, name) == 0))
            return functions[i].function;
    if (fake_vulkan.missing && strcmp(fake_vulkan.missing, name) == 0)
        return NULL;
    PFN_vkVoidFunction function = fake_commands_find(name);
    return function ? function : fake_kernels_find(name);
}

static PFN_vkVoidFunction VKAPI_CALL get_device_proc_addr(VkDevice device, const char *name)
{
    assert_ptr_equal(device, &fake_device);
    return find(name);
}

static PFN_vkVoidFunction VKAPI_CALL get_instance_proc_addr(VkInstance instance, const char *name)
{
    assert_ptr_equal(instance, &fake_instance);
    bool is_missing = fake_vulkan.missing && strcmp(fake_vulkan.missing, name) == 0;
    if (strcmp(name, "vkGetDeviceProcAddr") == 0)
        return is_missing ? NULL : (PFN_vkVoidFunction)get_device_proc_addr;
    return find(name);
}

/* ---- For tests ---- */

void fake_vulkan_reset(void)
{
    fake_vulkan = (struct fake_vulkan){
        .fail_after = -1,
        .failure = VK_ERROR_OUT_OF_DEVICE_MEMORY,
        .max_storage_range = 1 << 27,
        .max_allocation = UINT64_C(1) << 30,
        .max_buffer = UINT64_C(1) << 30,
        .max_primitives = 1 << 24,
        .max_instances = 1 << 24,
        .local_left = UINT64_MAX,
        .api_version = VK_API_VERSION_1_2,
        .subgroup_operations = VK_SUBGROUP_FEATURE_BASIC_BIT | VK_SUBGROUP_FEATURE_VOTE_BIT |
                               VK_SUBGROUP_FEATURE_BALLOT_BIT | VK_SUBGROUP_FEATURE_SHUFFLE_BIT,
    };
    fake_commands_reset();
    fake_kernels_reset();
}

struct bvhd_vulkan_device_options fake_vulkan_options(bool has_structures, bool has_addresses,
                                                      const VkAllocationCallbacks *allocator)
{
    fake_allocator = allocator;
    return (struct bvhd_vulkan_device_options){
        .struct_size = sizeof(struct bvhd_vulkan_device_options),
        .get_instance_proc_addr = get_instance_proc_addr,
        .instance = (VkInstance)(void *)&fake_instance,
        .physical_device = (VkPhysicalDevice)(void *)&fake_physical,
        .device = (VkDevice)(void *)&fake_device,
        .has_acceleration_structure = has_structures,
        .has_buffer_device_address = has_addresses,
        .allocator = allocator,
    };
}

struct bvhd_vulkan_queue fake_vulkan_queue(void)
{
    return (struct bvhd_vulkan_queue){(VkQueue)(void *)&fake_queue, 0};
}

unsigned char *fake_vulkan_bytes(VkBuffer buffer)
{
    return OBJECT(buffer)->memory->bytes;
}

unsigned char *fake_vulkan_structure(VkAccelerationStructureKHR structure, uint64_t *ret_size,
                                     VkAccelerationStructureTypeKHR *ret_type)
{
    *ret_size = OBJECT(structure)->size;
    *ret_type = (VkAccelerationStructureTypeKHR)OBJECT(structure)->type;
    return fake_structure_bytes(OBJECT(structure));
}

VkBuffer fake_vulkan_buffer(uint64_t size, VkBufferUsageFlags usage, bool is_mapped, void **ret_mapped)
{
    VkBuffer buffer = VK_NULL_HANDLE;
    VkDeviceMemory memory = VK_NULL_HANDLE;
    const VkBufferCreateInfo info = {.size = size, .usage = usage};
    const VkMemoryAllocateFlagsInfo flags = {.flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT};
    const VkMemoryAllocateInfo allocation = {
        .pNext = &flags, .allocationSize = size, .memoryTypeIndex = is_mapped ? COHERENT_TYPE : LOCAL_TYPE};
    VkDevice device = (VkDevice)(void *)&fake_device;
    assert_int_equal(create_buffer(device, &info, fake_allocator, &buffer), VK_SUCCESS);
    assert_int_equal(allocate_memory(device, &allocation, fake_allocator, &memory), VK_SUCCESS);
    assert_int_equal(bind_memory(device, buffer, memory, 0), VK_SUCCESS);
    if (is_mapped)
        assert_int_equal(map_memory(device, memory, 0, VK_WHOLE_SIZE, 0, ret_mapped), VK_SUCCESS);
    return buffer;
}

void fake_vulkan_free_buffer(VkBuffer buffer)
{
    VkDevice device = (VkDevice)(void *)&fake_device;
    struct object *memory = OBJECT(buffer)->memory;
    destroy_buffer(device, buffer, fake_allocator);
    free_memory(device, (VkDeviceMemory)(void *)memory, fake_allocator);
}

void fake_vulkan_destroy_structure(VkAccelerationStructureKHR structure)
{
    destroy_structure((VkDevice)(void *)&fake_device, structure, fake_allocator);
}
