/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_vulkan_upload.c - tests that uploads record the right copies and barriers, and that wrong ones record nothing.
 */
#include "tests/support/unit.h"

#include "tests/support/client/vulkan/fake_vulkan.h"
#include "builder/format/lavapipe.h"
#include "client/library.h"
#include "tests/support/client/vulkan/vulkan_bed.h"

enum { SPARE = 512 }; /* bytes in a buffer behind those that are needed */

static const struct device_format driver = {"driver uuid 1234", "driver uuid 1234", LAVAPIPE_PLAIN};

/* The top level of a scene, with buffers of exactly the right size for it. */
struct world {
    struct vulkan_bed bed;
    struct bvhd_vulkan_device *device;
    struct bvhd_vulkan_requirements needed;
    VkBuffer staging, storage;
    uint64_t references[3];
    struct bvhd_vulkan_upload upload;
};

static void init(struct world *world, enum target target)
{
    struct vulkan_bed_options options = {.target = target, .bottoms = 3, .instances = 7, .triangles = 9};
    void *mapped = NULL;
    if (target == TARGET_LAVAPIPE)
        options.device = driver;
    *world = (struct world){.references = {256, 512, 1024}};
    fake_vulkan_reset();
    vulkan_bed_init(&world->bed, &options);
    const struct bvhd_vulkan_device_options device = fake_vulkan_options(true, true, NULL);
    assert_int_equal(bvhd_vulkan_device_create(&device, &world->device, NULL), BVHD_OK);
    const struct bvhd_vulkan_bytes *top = &world->bed.blobs[3];
    assert_int_equal(bvhd_vulkan_requirements(world->device, top->data, top->size, &world->needed, NULL), BVHD_OK);
    uint64_t skew = 192; /* to a multiple of 256, in device addresses */
    world->staging =
        fake_vulkan_buffer(skew + world->needed.staging_size + SPARE,
                           world->needed.staging_usage | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT, true, &mapped);
    world->storage =
        fake_vulkan_buffer(256 + world->needed.storage_size + SPARE, world->needed.storage_usage, false, NULL);
    world->upload = (struct bvhd_vulkan_upload){
        .struct_size = sizeof world->upload,
        .data = top->data,
        .size = top->size,
        .staging = {world->staging, skew, world->needed.staging_size},
        .staging_mapped = (unsigned char *)mapped + skew,
        .storage = {world->storage, 256, world->needed.storage_size},
        .references = world->references,
        .reference_count = 3,
    };
}

static void finish(struct world *world)
{
    fake_vulkan_submit();
    fake_vulkan_free_buffer(world->staging);
    fake_vulkan_free_buffer(world->storage);
    bvhd_vulkan_device_destroy(world->device);
    vulkan_bed_finish(&world->bed);
    assert_int_equal(fake_vulkan.live, 0);
    assert_int_equal(library_memory.live, 0);
}

static void structures_arrive_where_they_should(void **state)
{
    (void)state;
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++) {
        struct world world;
        struct bvhd_error error = {0};
        VkAccelerationStructureKHR structure = VK_NULL_HANDLE;
        init(&world, (enum target)target);
        VkCommandBuffer commands = fake_vulkan_commands();
        assert_int_equal(bvhd_vulkan_record_upload(world.device, commands, &world.upload, &structure, &error), BVHD_OK);
        bvhd_vulkan_record_barrier(world.device, commands);
        assert_int_equal(fake_vulkan_recorded(), 1);
        fake_vulkan_submit();
        const unsigned char *stored = fake_vulkan_bytes(world.storage) + 256;
        if (target == TARGET_PORTABLE) {
            assert_true(structure == VK_NULL_HANDLE);
            assert_int_equal(bytes_get32(stored), 0x42485642);
        } else {
            VkAccelerationStructureTypeKHR type;
            uint64_t size;
            assert_ptr_equal(fake_vulkan_structure(structure, &size, &type), stored);
            assert_int_equal(size, world.needed.storage_size);
            assert_int_equal(type, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR);
            assert_int_equal(bvhd_vulkan_address(world.device, structure), (uint64_t)(uintptr_t)stored);
            assert_int_equal(bvhd_vulkan_address(world.device, VK_NULL_HANDLE), 0);
            fake_vulkan_destroy_structure(structure);
        }
        finish(&world);
    }
}

/* Some drivers serialize a structure with as many bytes as it was created with. */
static void spans_may_be_larger_than_structures(void **state)
{
    (void)state;
    struct world world;
    VkAccelerationStructureKHR structure = VK_NULL_HANDLE;
    VkAccelerationStructureTypeKHR type;
    uint64_t size;
    init(&world, TARGET_LAVAPIPE);
    world.upload.staging.size += SPARE;
    world.upload.storage.size += SPARE;
    VkCommandBuffer commands = fake_vulkan_commands();
    assert_int_equal(bvhd_vulkan_record_upload(world.device, commands, &world.upload, &structure, NULL), BVHD_OK);
    fake_vulkan_submit();
    fake_vulkan_structure(structure, &size, &type);
    assert_int_equal(size, world.needed.storage_size);
    fake_vulkan_destroy_structure(structure);
    finish(&world);
}

static void barriers_wait_for_both_ways_of_uploading(void **state)
{
    (void)state;
    struct world world;
    init(&world, TARGET_PORTABLE);
    bvhd_vulkan_record_barrier(world.device, fake_vulkan_commands());
    assert_int_equal(fake_vulkan.barrier_stages,
                     VK_PIPELINE_STAGE_TRANSFER_BIT | VK_PIPELINE_STAGE_ACCELERATION_STRUCTURE_BUILD_BIT_KHR);
    assert_int_equal(fake_vulkan.barrier_writes,
                     VK_ACCESS_TRANSFER_WRITE_BIT | VK_ACCESS_ACCELERATION_STRUCTURE_WRITE_BIT_KHR);
    const struct bvhd_vulkan_device_options plain = fake_vulkan_options(false, false, NULL);
    struct bvhd_vulkan_device *device;
    assert_int_equal(bvhd_vulkan_device_create(&plain, &device, NULL), BVHD_OK);
    bvhd_vulkan_record_barrier(device, fake_vulkan_commands());
    assert_int_equal(fake_vulkan.barrier_stages, VK_PIPELINE_STAGE_TRANSFER_BIT);
    assert_int_equal(fake_vulkan.barrier_writes, VK_ACCESS_TRANSFER_WRITE_BIT);
    bvhd_vulkan_device_destroy(device);
    finish(&world);
}

static void refuse(struct world *world, enum bvhd_status wanted, const char *where)
{
    struct bvhd_error error = {0};
    VkAccelerationStructureKHR structure = VK_NULL_HANDLE;
    uint64_t live = fake_vulkan.live;
    VkCommandBuffer commands = fake_vulkan_commands();
    assert_int_equal(bvhd_vulkan_record_upload(world->device, commands, &world->upload, &structure, &error), wanted);
    assert_string_equal(error.where, where);
    assert_int_equal(fake_vulkan_recorded(), 0);
    assert_int_equal(fake_vulkan.live, live);
    assert_true(structure == VK_NULL_HANDLE);
}

static void wrong_uploads_record_nothing(void **state)
{
    (void)state;
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++) {
        struct world world;
        init(&world, (enum target)target);
        const struct bvhd_vulkan_upload good = world.upload;
        world.upload.struct_size--;
        refuse(&world, BVHD_INVALID, "upload.struct_size");
        world.upload = good;
        world.upload.data = NULL;
        refuse(&world, BVHD_INVALID, "upload.data");
        world.upload = good;
        world.upload.size--;
        refuse(&world, BVHD_CORRUPT, "header.serializedSize");
        world.upload = good;
        world.upload.staging_mapped = NULL;
        refuse(&world, BVHD_INVALID, "upload.staging_mapped");
        world.upload = good;
        world.upload.staging.buffer = VK_NULL_HANDLE;
        refuse(&world, BVHD_INVALID, "upload.staging");
        world.upload = good;
        world.upload.staging.size--;
        refuse(&world, BVHD_INVALID, "upload.staging");
        world.upload = good;
        world.upload.staging.offset += 8;
        refuse(&world, BVHD_INVALID, "upload.staging");
        world.upload = good;
        world.upload.storage.size--;
        refuse(&world, BVHD_INVALID, "upload.storage");
        world.upload = good;
        world.upload.storage.offset -= 64;
        refuse(&world, BVHD_INVALID, "upload.storage");
        world.upload = good;
        world.upload.reference_count = 2;
        refuse(&world, BVHD_INVALID, "references[2]");
        world.upload = good;
        world.references[1] = target == TARGET_PORTABLE ? UINT64_MAX : 0;
        refuse(&world, BVHD_INVALID, "references[1]");
        world.references[1] = 512;
        finish(&world);
    }
}

/* Offset 0 is a valid location in a scene's buffer, address 0 is not. */
static void a_portable_scene_may_begin_at_zero(void **state)
{
    (void)state;
    struct world world;
    VkAccelerationStructureKHR structure;
    init(&world, TARGET_PORTABLE);
    world.references[0] = 0;
    assert_int_equal(bvhd_vulkan_record_upload(world.device, fake_vulkan_commands(), &world.upload, &structure, NULL),
                     BVHD_OK);
    finish(&world);
}

static void failing_structures_record_nothing(void **state)
{
    (void)state;
    struct world world;
    init(&world, TARGET_LAVAPIPE);
    fake_vulkan.fail_after = 0;
    fake_vulkan.failure = VK_ERROR_OUT_OF_HOST_MEMORY;
    refuse(&world, BVHD_NO_MEMORY, "vkCreateAccelerationStructureKHR");
    finish(&world);
}

static void native_ones_need_a_device_with_structures(void **state)
{
    (void)state;
    struct world world;
    init(&world, TARGET_LAVAPIPE);
    bvhd_vulkan_device_destroy(world.device);
    const struct bvhd_vulkan_device_options device = fake_vulkan_options(false, true, NULL);
    assert_int_equal(bvhd_vulkan_device_create(&device, &world.device, NULL), BVHD_OK);
    refuse(&world, BVHD_UNSUPPORTED, "upload.data");
    assert_int_equal(bvhd_vulkan_address(world.device, VK_NULL_HANDLE), 0);
    finish(&world);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(structures_arrive_where_they_should),
        cmocka_unit_test(wrong_uploads_record_nothing),
        cmocka_unit_test(a_portable_scene_may_begin_at_zero),
        cmocka_unit_test(failing_structures_record_nothing),
        cmocka_unit_test(native_ones_need_a_device_with_structures),
        cmocka_unit_test(spans_may_be_larger_than_structures),
        cmocka_unit_test(barriers_wait_for_both_ways_of_uploading),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
