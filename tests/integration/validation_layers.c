/* SPDX-License-Identifier: Apache-2.0 */
/*
 * validation_layers.c - tests that the validation layers report mistakes, since all tests of the suite "vulkan" rely on
 * their silence. Mistakes made on purpose are counted. Skipped (77), with a message, unless $BVHD_VALIDATE is 1.
 */
#include "tests/support/unit.h"

#include "tests/support/driver/gpu_bed.h"

static struct memory memory;
static struct gpu *gpu;

static int set_up(void **state)
{
    (void)state;
    memory_init(&memory, UINT64_MAX);
    return gpu_open("auto", &memory, &gpu, NULL) != BVHD_OK ? -1 : 0;
}

static int tear_down(void **state)
{
    (void)state;
    gpu_close(gpu);
    return memory.live ? -1 : 0;
}

static void what_is_right_passes_in_silence(void **state)
{
    (void)state;
    struct gpu_buffer buffer;
    VkCommandBuffer commands;
    assert_int_equal(gpu_buffer_create(gpu, 256, VK_BUFFER_USAGE_TRANSFER_DST_BIT, GPU_DEVICE, &buffer, NULL), BVHD_OK);
    assert_int_equal(gpu_begin(gpu, &commands, NULL), BVHD_OK);
    gpu->vk.CmdFillBuffer(commands, buffer.buffer, 0, 256, 1);
    assert_int_equal(gpu_submit(gpu, commands, NULL), BVHD_OK);
    gpu_buffer_destroy(gpu, &buffer);
    assert_int_equal(gpu_messages(), 0);
}

static void wrong_arguments_are_noticed(void **state)
{
    (void)state;
    unsigned before = gpu_messages();
    VkBuffer buffer = VK_NULL_HANDLE;
    const VkBufferCreateInfo without_usage = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO, .size = 256};
    if (gpu->vk.CreateBuffer(gpu->device, &without_usage, NULL, &buffer) == VK_SUCCESS)
        gpu->vk.DestroyBuffer(gpu->device, buffer, NULL);
    assert_true(gpu_messages() > before);
}

/* Two writes to the same place without a barrier between them. */
static void missing_barriers_are_noticed(void **state)
{
    (void)state;
    unsigned before = gpu_messages();
    struct gpu_buffer buffer;
    VkCommandBuffer commands;
    assert_int_equal(gpu_buffer_create(gpu, 256, VK_BUFFER_USAGE_TRANSFER_DST_BIT, GPU_DEVICE, &buffer, NULL), BVHD_OK);
    assert_int_equal(gpu_begin(gpu, &commands, NULL), BVHD_OK);
    gpu->vk.CmdFillBuffer(commands, buffer.buffer, 0, 256, 1);
    gpu->vk.CmdFillBuffer(commands, buffer.buffer, 0, 256, 2);
    assert_int_equal(gpu_submit(gpu, commands, NULL), BVHD_OK);
    gpu_buffer_destroy(gpu, &buffer);
    assert_true(gpu_messages() > before);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_right_passes_in_silence),
        cmocka_unit_test(wrong_arguments_are_noticed),
        cmocka_unit_test(missing_barriers_are_noticed),
    };
    const char *asked = getenv("BVHD_VALIDATE");
    if (!asked || strcmp(asked, "1") != 0) {
        printf("skipped: $BVHD_VALIDATE is not 1, so no validation layer checks the tests of Vulkan devices\n");
        return GPU_BED_SKIPPED;
    }
    return gpu_bed_is_missing(false) ? GPU_BED_SKIPPED : cmocka_run_group_tests(tests, set_up, tear_down);
}
