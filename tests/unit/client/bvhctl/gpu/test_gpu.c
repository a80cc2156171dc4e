/* SPDX-License-Identifier: Apache-2.0 */
/* test_gpu.c - tests devices, buffers and kernels on a real Vulkan device, and the errors without one. */
#include "tests/support/unit.h"

#include "tests/support/gpu_add.h"
#include "tests/support/driver/gpu_bed.h"

enum { COUNT = 10000, CONSTANT = 1000, ADDEND = 7 };

static struct memory memory;
static struct gpu *gpu;

static int open_any(void **state)
{
    (void)state;
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    if (gpu_open("auto", &memory, &gpu, &error) == BVHD_OK)
        return 0;
    fprintf(stderr, "%s: %s\n", error.where, error.text);
    return -1;
}

static int close_it(void **state)
{
    (void)state;
    gpu_close(gpu);
    return memory.live ? -1 : 0;
}

static void lists_devices_best_first(void **state)
{
    (void)state;
    struct gpu_properties *list;
    uint32_t count;
    uint64_t before = memory.live;
    assert_int_equal(gpu_list(&memory, &list, &count, NULL), BVHD_OK);
    assert_true(count >= 1);
    for (uint32_t i = 0; i < count; i++) {
        assert_true(*list[i].name && *list[i].driver);
        assert_true(list[i].memory > 0);
        assert_int_equal(atoi(list[i].number), i);
        assert_true(list[i].max_groups >= 65535 && list[i].max_storage_range >= 1 << 27);
        assert_true(list[i].has_acceleration_structure || !list[i].has_ray_query);
        if (i && list[i].type == VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU)
            assert_int_equal(list[i - 1].type, VK_PHYSICAL_DEVICE_TYPE_DISCRETE_GPU);
    }
    assert_string_equal(list[0].name, gpu->properties.name);
    memory_free(&memory, list);
    assert_int_equal(memory.live, before);
}

static void opens_by_a_part_of_the_name(void **state)
{
    (void)state;
    struct gpu *other = NULL;
    struct bvhd_error error;
    char part[8];
    snprintf(part, sizeof part, "%.5s", gpu->properties.name);
    for (char *at = part; *at; at++)
        *at = (char)(*at >= 'a' && *at <= 'z' ? *at - 32 : *at);
    assert_int_equal(gpu_open(part, &memory, &other, &error), BVHD_OK);
    gpu_close(other);
    assert_int_equal(gpu_open(gpu->properties.name, &memory, &other, &error), BVHD_OK);
    assert_string_equal(other->properties.name, gpu->properties.name);
    gpu_close(other);
    assert_int_equal(gpu_open("0", &memory, &other, &error), BVHD_OK);
    assert_string_equal(other->properties.name, gpu->properties.name);
    gpu_close(other);
    other = NULL;
    assert_int_equal(gpu_open("4294967295", &memory, &other, &error), BVHD_NOT_FOUND);
    assert_int_equal(gpu_open("a device that nobody makes", &memory, &other, &error), BVHD_NOT_FOUND);
    assert_null(other);
    assert_non_null(strstr(error.text, gpu->properties.name));
    assert_string_equal(error.where, "a device that nobody makes");
}

static void results_have_a_status(void **state)
{
    (void)state;
    struct bvhd_error error;
    assert_int_equal(gpu_result("vkX", VK_SUCCESS, &error), BVHD_OK);
    assert_int_equal(gpu_result("vkX", VK_ERROR_OUT_OF_DEVICE_MEMORY, &error), BVHD_NO_MEMORY);
    assert_string_equal(error.where, "vkX");
    assert_int_equal(gpu_result("vkX", VK_ERROR_DEVICE_LOST, &error), BVHD_UNAVAILABLE);
    assert_int_equal(gpu_result("vkX", VK_ERROR_FRAGMENTED_POOL, &error), BVHD_INTERNAL);
}

static void buffers_are_where_they_should_be(void **state)
{
    (void)state;
    for (int place = GPU_DEVICE; place <= GPU_READBACK; place++) {
        struct gpu_buffer buffer;
        assert_int_equal(
            gpu_buffer_create(gpu, 0, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, (enum gpu_place)place, &buffer, NULL),
            BVHD_OK);
        assert_int_equal(buffer.size, 1);
        assert_int_equal(buffer.mapped != NULL, place != GPU_DEVICE);
        assert_int_equal(buffer.address != 0, gpu->properties.has_buffer_address);
        gpu_buffer_destroy(gpu, &buffer);
        gpu_buffer_destroy(gpu, &buffer);
        assert_null(buffer.buffer);
    }
    gpu_buffer_destroy(gpu, NULL);
}

static void too_large_a_buffer_is_refused(void **state)
{
    (void)state;
    struct gpu_buffer buffer = {.size = 5};
    if (getenv("BVHD_VALIDATE"))
        skip(); /* the validation layer rightly reports such sizes */
    assert_int_not_equal(
        gpu_buffer_create(gpu, UINT64_C(1) << 60, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, GPU_DEVICE, &buffer, NULL),
        BVHD_OK);
    assert_int_equal(buffer.size, 5);
}

struct sum {
    struct gpu_kernel kernel;
    struct gpu_timer timer;
    struct gpu_buffer from, to;
};

static void sum_open(struct sum *sum)
{
    static const uint32_t constants[] = {CONSTANT};
    const struct gpu_kernel_options options = {.code = gpu_add_code,
                                               .size = sizeof gpu_add_code,
                                               .bindings = 2,
                                               .push_size = 8,
                                               .constants = constants,
                                               .constant_count = 1};
    const VkBufferUsageFlags usage = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT;
    assert_int_equal(gpu_kernel_create(gpu, &options, &sum->kernel, NULL), BVHD_OK);
    assert_int_equal(gpu_timer_create(gpu, &sum->timer, NULL), BVHD_OK);
    assert_int_equal(gpu_buffer_create(gpu, COUNT * 4, usage, GPU_UPLOAD, &sum->from, NULL), BVHD_OK);
    assert_int_equal(gpu_buffer_create(gpu, COUNT * 4, usage, GPU_READBACK, &sum->to, NULL), BVHD_OK);
    const struct gpu_buffer *buffers[] = {&sum->from, &sum->to};
    gpu_kernel_bind(gpu, &sum->kernel, buffers, NULL);
}

static void sum_close(struct sum *sum)
{
    gpu_buffer_destroy(gpu, &sum->from);
    gpu_buffer_destroy(gpu, &sum->to);
    gpu_timer_destroy(gpu, &sum->timer);
    gpu_timer_destroy(gpu, &sum->timer);
    gpu_kernel_destroy(gpu, &sum->kernel);
    gpu_kernel_destroy(gpu, &sum->kernel);
}

static void sum_run(struct sum *sum)
{
    const uint32_t push[] = {COUNT - 1, ADDEND};
    const VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                     .srcAccessMask = VK_ACCESS_SHADER_WRITE_BIT,
                                     .dstAccessMask = VK_ACCESS_HOST_READ_BIT};
    VkCommandBuffer commands;
    assert_int_equal(gpu_begin(gpu, &commands, NULL), BVHD_OK);
    gpu_timer_start(gpu, &sum->timer, commands);
    gpu_kernel_record(gpu, &sum->kernel, commands, push, (COUNT + 63) / 64);
    gpu_timer_stop(gpu, &sum->timer, commands);
    gpu->vk.CmdPipelineBarrier(commands, VK_PIPELINE_STAGE_COMPUTE_SHADER_BIT, VK_PIPELINE_STAGE_HOST_BIT, 0, 1,
                               &barrier, 0, NULL, 0, NULL);
    assert_int_equal(gpu_submit(gpu, commands, NULL), BVHD_OK);
}

static void kernels_run(void **state)
{
    (void)state;
    struct sum sum;
    sum_open(&sum);
    uint32_t *from = sum.from.mapped, *to = sum.to.mapped;
    for (uint32_t i = 0; i < COUNT; i++) {
        from[i] = i * i;
        to[i] = 99;
    }
    sum_run(&sum);
    for (uint32_t i = 0; i < COUNT - 1; i++)
        assert_int_equal(to[i], i * i + CONSTANT + ADDEND);
    assert_int_equal(to[COUNT - 1], 99);
    double seconds = gpu_timer_seconds(gpu, &sum.timer);
    assert_true(gpu->timestamp_ms > 0 ? seconds >= 0 && seconds < 10 : seconds < 0);
    sum_close(&sum);
}

static void impossible_kernels_are_refused(void **state)
{
    (void)state;
    struct gpu_kernel kernel = {.layout.push_size = 3};
    const struct gpu_kernel_options none = {.code = gpu_add_code, .size = sizeof gpu_add_code};
    const struct gpu_kernel_options many = {.code = gpu_add_code, .size = sizeof gpu_add_code, .bindings = 1000};
    assert_int_equal(gpu_kernel_create(gpu, &none, &kernel, NULL), BVHD_INTERNAL);
    assert_int_equal(gpu_kernel_create(gpu, &many, &kernel, NULL), BVHD_INTERNAL);
    assert_int_equal(kernel.layout.push_size, 3);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    struct memory small;
    memory_init(&small, UINT64_MAX);
    enum bvhd_status status = BVHD_NO_MEMORY;
    int64_t tries = 0;
    for (; status != BVHD_OK && tries < 100; tries++) {
        struct gpu *other = NULL;
        small.fail_after = tries;
        status = gpu_open("auto", &small, &other, NULL);
        bool has_failed = small.fail_after < 0;
        small.fail_after = -1;
        assert_int_equal(status == BVHD_OK, other != NULL);
        gpu_close(other);
        assert_int_equal(small.live, 0);
        if (status == BVHD_OK && has_failed)
            status = BVHD_NO_MEMORY; /* this allocation is not needed, or its lack looks like a smaller device */
    }
    assert_true(tries > 3 && tries < 100);
}

static void nothing_to_close_is_closed(void **state)
{
    (void)state;
    gpu_close(NULL);
}

static void validation_layers_are_silent(void **state)
{
    (void)state;
    assert_int_equal(gpu_messages(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_devices_best_first),       cmocka_unit_test(opens_by_a_part_of_the_name),
        cmocka_unit_test(results_have_a_status),          cmocka_unit_test(buffers_are_where_they_should_be),
        cmocka_unit_test(too_large_a_buffer_is_refused),  cmocka_unit_test(kernels_run),
        cmocka_unit_test(impossible_kernels_are_refused), cmocka_unit_test(every_allocation_may_fail),
        cmocka_unit_test(nothing_to_close_is_closed),     cmocka_unit_test(validation_layers_are_silent),
    };
    if (gpu_bed_is_missing(false))
        return GPU_BED_SKIPPED;
    return cmocka_run_group_tests(tests, open_any, close_it);
}
