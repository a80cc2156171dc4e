/* SPDX-License-Identifier: Apache-2.0 */
/*
 * vulkan_driver.c - tests bvhd_vulkan.h on the Vulkan device of this machine: what the probe says; structures of the
 * device's native target, loaded in both ways and traced by the driver's own ray queries; portable structures, read
 * back; and that nothing leaks. Skipped where there is no such device.
 */
#include "tests/support/unit.h"

#include <malloc.h>
#include <math.h>

#include "tests/support/driver/driver_structure.h"
#include "tests/support/driver/gpu_bed.h"
#include "tests/support/random.h"
#include "client/bvhctl/trace/tracer.h"
#include "tests/support/client/vulkan/vulkan_bed.h"

static struct memory memory;
static struct gpu *gpu;
static struct bvhd_vulkan_device *device;
static struct bvhd_format format;
static bool is_native;

/* ---- the program's allocator: it counts everything, and its n-th allocation can fail ---- */

static int64_t live_blocks, fail_after = -1;

static void *VKAPI_CALL allocate(void *user, size_t size, size_t alignment, VkSystemAllocationScope scope)
{
    (void)user;
    (void)scope;
    if (fail_after == 0)
        return NULL;
    if (fail_after > 0)
        fail_after--;
    void *block = memalign(alignment < 16 ? 16 : alignment, size);
    live_blocks += block != NULL;
    return block;
}

static void VKAPI_CALL release(void *user, void *block)
{
    (void)user;
    live_blocks -= block != NULL;
    free(block);
}

static void *VKAPI_CALL reallocate(void *user, void *block, size_t size, size_t alignment,
                                   VkSystemAllocationScope scope)
{
    if (size == 0) {
        release(user, block);
        return NULL;
    }
    void *moved = allocate(user, size, alignment, scope);
    if (moved && block) {
        size_t old = malloc_usable_size(block);
        memcpy(moved, block, old < size ? old : size);
        release(user, block);
    }
    return moved;
}

static const VkAllocationCallbacks callbacks = {
    .pfnAllocation = allocate, .pfnReallocation = reallocate, .pfnFree = release};

/* lavapipe ends the process when an allocation fails while commands are recorded, so none fails then. */
static PFN_vkGetDeviceProcAddr get_device_proc_addr;
static PFN_vkBeginCommandBuffer begin_commands;
static PFN_vkEndCommandBuffer end_commands;
static int64_t fail_after_recording;

static VkResult VKAPI_CALL begin_without_failures(VkCommandBuffer commands, const VkCommandBufferBeginInfo *info)
{
    VkResult result = begin_commands(commands, info);
    fail_after_recording = fail_after;
    fail_after = -1;
    return result;
}

static VkResult VKAPI_CALL end_with_failures(VkCommandBuffer commands)
{
    fail_after = fail_after_recording;
    return end_commands(commands);
}

static PFN_vkVoidFunction VKAPI_CALL find_device_function(VkDevice handle, const char *name)
{
    PFN_vkVoidFunction found = get_device_proc_addr(handle, name);
    if (strcmp(name, "vkBeginCommandBuffer") == 0) {
        begin_commands = (PFN_vkBeginCommandBuffer)found;
        return (PFN_vkVoidFunction)begin_without_failures;
    }
    if (strcmp(name, "vkEndCommandBuffer") == 0) {
        end_commands = (PFN_vkEndCommandBuffer)found;
        return (PFN_vkVoidFunction)end_with_failures;
    }
    return found;
}

static PFN_vkVoidFunction VKAPI_CALL find_function(VkInstance instance, const char *name)
{
    PFN_vkVoidFunction found = gpu->get_instance_proc_addr(instance, name);
    if (strcmp(name, "vkGetDeviceProcAddr") != 0)
        return found;
    get_device_proc_addr = (PFN_vkGetDeviceProcAddr)found;
    return (PFN_vkVoidFunction)find_device_function;
}

/* ---- the device ---- */

static int open_device(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    if (gpu_open("auto", &memory, &gpu, &error) != BVHD_OK)
        return -1;
    const struct bvhd_vulkan_device_options options = {
        .struct_size = sizeof options,
        .get_instance_proc_addr = find_function,
        .instance = gpu->instance,
        .physical_device = gpu->physical,
        .device = gpu->device,
        .has_acceleration_structure = gpu->properties.has_acceleration_structure,
        .has_buffer_device_address = gpu->properties.has_buffer_address,
        .allocator = &callbacks,
    };
    return bvhd_vulkan_device_create(&options, &device, &error) != BVHD_OK ? -1 : 0;
}

static int close_device(void **state)
{
    (void)state;
    bvhd_vulkan_device_destroy(device);
    gpu_close(gpu);
    return memory.live || live_blocks || gpu_messages() ? -1 : 0;
}

static void the_probe_tells_what_the_device_loads(void **state)
{
    (void)state;
    struct bvhd_error error = {0};
    void *probe = NULL, *again = NULL;
    uint64_t size = 0, size_again = 0;
    assert_int_equal(bvhd_vulkan_probe(device, &gpu->queue, &probe, &size, &error), BVHD_OK);
    enum bvhd_status status = bvhd_format_from_probe(probe, size, &format, &error);
    is_native = status == BVHD_OK;
    printf("%s: %s\n", gpu->properties.name, is_native ? bvhd_target_name(format.target) : error.text);
    assert_true(is_native || status == BVHD_UNSUPPORTED);
    if (strstr(gpu->properties.name, "llvmpipe"))
        assert_int_equal(format.target, BVHD_TARGET_LAVAPIPE);
    assert_int_equal(bvhd_vulkan_probe(device, &gpu->queue, &again, &size_again, &error), BVHD_OK);
    assert_int_equal(size_again, size);
    bvhd_vulkan_free(probe);
    bvhd_vulkan_free(again);
}

static void skip_unless_native(void)
{
    if (!is_native)
        skip();
}

static struct device_format device_format(void)
{
    struct device_format copy = {.variant = format.variant};
    memcpy(copy.driver_uuid, format.driver_uuid, sizeof copy.driver_uuid);
    memcpy(copy.compatibility_uuid, format.compatibility_uuid, sizeof copy.compatibility_uuid);
    return copy;
}

static struct vulkan_bed_options native(uint32_t bottoms, uint32_t instances, uint32_t triangles, uint32_t named)
{
    return (struct vulkan_bed_options){TARGET_LAVAPIPE, device_format(), bottoms, instances, triangles, named, false};
}

/* Checks that a ray towards each instance hits it at the expected distance. */
static void trace(const struct vulkan_bed *bed, VkAccelerationStructureKHR top)
{
    struct bvhd_error error = {0};
    struct tracer *tracer = NULL;
    uint32_t count = bed->options.instances;
    struct ray *rays = calloc(count, sizeof *rays);
    struct tracer_hit *hits = calloc(count, sizeof *hits);
    float *expected = calloc(count, sizeof *expected);
    for (uint32_t i = 0; i < count; i++)
        rays[i] = vulkan_bed_ray(bed, i, &expected[i]);
    assert_int_equal(tracer_query_create(gpu, top, &memory, &tracer, &error), BVHD_OK);
    assert_int_equal(tracer->trace(tracer, rays, count, hits, NULL, &error), BVHD_OK);
    for (uint32_t i = 0; i < count; i++) {
        assert_true(hits[i].t == expected[i]);
        assert_int_equal(hits[i].instance, i);
        assert_int_equal(hits[i].custom_index, i);
        assert_int_equal(hits[i].primitive, 0);
    }
    tracer_destroy(tracer);
    free(rays);
    free(hits);
    free(expected);
}

static struct bvhd_vulkan_scene_options scene_options(const struct vulkan_bed *bed, uint32_t flags)
{
    return (struct bvhd_vulkan_scene_options){.struct_size = sizeof(struct bvhd_vulkan_scene_options),
                                              .blobs = bed->blobs,
                                              .blob_count = bed->count,
                                              .flags = flags,
                                              .format = is_native ? &format : NULL};
}

static void native_scenes_are_traced(void **state)
{
    (void)state;
    static const uint32_t shapes[][4] = {{1, 1, 2, 0}, {8, 40, 100, 5}, {3, 200, 20000, 0}, {2000, 3000, 2, 0}};
    skip_unless_native();
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0]; i++) {
        struct vulkan_bed bed;
        struct bvhd_error error = {0};
        struct bvhd_vulkan_scene *scene = NULL;
        const struct vulkan_bed_options shape = native(shapes[i][0], shapes[i][1], shapes[i][2], shapes[i][3]);
        vulkan_bed_init(&bed, &shape);
        struct bvhd_vulkan_scene_options options = scene_options(&bed, 0);
        options.format = i == 0 ? NULL : &format; /* the scene probes the format itself */
        assert_int_equal(bvhd_vulkan_scene_create(device, &gpu->queue, &options, &scene, &error), BVHD_OK);
        assert_int_equal(bvhd_vulkan_scene_target(scene), BVHD_TARGET_LAVAPIPE);
        trace(&bed, bvhd_vulkan_scene_structure(scene, bed.count - 1));
        bvhd_vulkan_scene_destroy(scene);
        vulkan_bed_finish(&bed);
    }
}

/* Makes buffers as a program with its own allocator does. */
static struct gpu_buffer make_buffer(uint64_t size, uint64_t alignment, VkBufferUsageFlags usage, enum gpu_place place)
{
    struct gpu_buffer buffer;
    assert_int_equal(gpu_buffer_create(gpu, size + alignment, usage, place, &buffer, NULL), BVHD_OK);
    return buffer;
}

static void own_buffers_are_filled(void **state)
{
    (void)state;
    enum { BOTTOMS = 3 };
    struct vulkan_bed bed;
    struct gpu_buffer staging[BOTTOMS + 1], storage[BOTTOMS + 1];
    VkAccelerationStructureKHR structures[BOTTOMS + 1];
    uint64_t addresses[BOTTOMS];
    VkCommandBuffer commands;
    skip_unless_native();
    const struct vulkan_bed_options shape = native(BOTTOMS, 12, 50, 0);
    vulkan_bed_init(&bed, &shape);
    assert_int_equal(gpu_begin(gpu, &commands, NULL), BVHD_OK);
    for (uint32_t i = 0; i <= BOTTOMS; i++) {
        struct bvhd_error error = {0};
        struct bvhd_vulkan_requirements needed;
        const struct bvhd_vulkan_bytes *blob = &bed.blobs[i];
        assert_int_equal(bvhd_vulkan_check(device, &format, blob->data, blob->size, &error), BVHD_OK);
        assert_int_equal(bvhd_vulkan_requirements(device, blob->data, blob->size, &needed, &error), BVHD_OK);
        staging[i] = make_buffer(needed.staging_size, needed.staging_alignment, needed.staging_usage, GPU_UPLOAD);
        storage[i] = make_buffer(needed.storage_size, needed.storage_alignment, needed.storage_usage, GPU_DEVICE);
        uint64_t offset = bytes_align(staging[i].address, needed.staging_alignment) - staging[i].address;
        const struct bvhd_vulkan_upload upload = {
            .struct_size = sizeof upload,
            .data = blob->data,
            .size = blob->size,
            .staging = {staging[i].buffer, offset, needed.staging_size},
            .staging_mapped = (unsigned char *)staging[i].mapped + offset,
            .storage = {storage[i].buffer, needed.storage_alignment, needed.storage_size},
            .references = addresses,
            .reference_count = i == BOTTOMS ? BOTTOMS : 0,
        };
        assert_int_equal(bvhd_vulkan_record_upload(device, commands, &upload, &structures[i], &error), BVHD_OK);
        if (i < BOTTOMS)
            addresses[i] = bvhd_vulkan_address(device, structures[i]);
    }
    bvhd_vulkan_record_barrier(device, commands);
    assert_int_equal(gpu_submit(gpu, commands, NULL), BVHD_OK);
    trace(&bed, structures[BOTTOMS]);
    for (uint32_t i = 0; i <= BOTTOMS; i++) {
        gpu->vk.DestroyAccelerationStructureKHR(gpu->device, structures[i], &callbacks);
        gpu_buffer_destroy(gpu, &staging[i]);
        gpu_buffer_destroy(gpu, &storage[i]);
    }
    vulkan_bed_finish(&bed);
}

/* Checks the contents of the scene's buffer: the bodies, with locations in the instances. */
static void check_portable(const struct vulkan_bed *bed, const struct bvhd_vulkan_scene *scene,
                           const unsigned char *bytes)
{
    for (uint32_t i = 0; i < bed->count; i++) {
        struct bvhd_vulkan_span span;
        VkDeviceSize whole;
        struct portable_view view;
        const struct bytes blob = {bed->blobs[i].data, bed->blobs[i].size};
        if (!blob.data)
            continue;
        assert_int_equal(bvhd_vulkan_scene_storage(scene, i, &span, &whole), BVHD_OK);
        assert_int_equal(portable_open(blob, &memory, &view, NULL), BVHD_OK);
        assert_true(span.offset % 64 == 0 && span.offset + span.size <= whole && span.size == view.header->body_size);
        unsigned char *body = malloc(span.size);
        memcpy(body, view.header, span.size);
        for (uint32_t r = 0; view.header->content == PORTABLE_INSTANCES && r < view.header->record_count; r++) {
            struct portable_instance record;
            unsigned char *at = body + view.header->record_offset + r * sizeof record;
            memcpy(&record, at, sizeof record);
            bytes_put64(at + 112, bvhd_vulkan_scene_location(scene, vulkan_bed_bottom(bed, record.instance)));
        }
        assert_memory_equal(bytes + span.offset, body, span.size);
        free(body);
    }
}

static void portable_scenes_arrive(void **state)
{
    (void)state;
    for (uint32_t flags = 0; flags <= (gpu->properties.has_buffer_address ? BVHD_VULKAN_SCENE_ADDRESSES : 0); flags++) {
        struct vulkan_bed bed;
        struct bvhd_error error = {0};
        struct bvhd_vulkan_scene *scene = NULL;
        struct bvhd_vulkan_span span;
        struct gpu_buffer copy;
        VkDeviceSize whole;
        VkCommandBuffer commands;
        const struct vulkan_bed_options shape = {
            .target = TARGET_PORTABLE, .bottoms = 9, .instances = 70, .triangles = 500, .named = 7};
        vulkan_bed_init(&bed, &shape);
        const struct bvhd_vulkan_scene_options options = scene_options(&bed, flags);
        assert_int_equal(bvhd_vulkan_scene_create(device, &gpu->queue, &options, &scene, &error), BVHD_OK);
        assert_int_equal(bvhd_vulkan_scene_storage(scene, bed.count - 1, &span, &whole), BVHD_OK);
        assert_int_equal(gpu_buffer_create(gpu, whole, VK_BUFFER_USAGE_TRANSFER_DST_BIT, GPU_READBACK, &copy, NULL),
                         BVHD_OK);
        assert_int_equal(gpu_begin(gpu, &commands, NULL), BVHD_OK);
        const VkBufferCopy region = {0, 0, whole};
        gpu->vk.CmdCopyBuffer(commands, span.buffer, copy.buffer, 1, &region);
        assert_int_equal(gpu_submit(gpu, commands, NULL), BVHD_OK);
        check_portable(&bed, scene, copy.mapped);
        gpu_buffer_destroy(gpu, &copy);
        bvhd_vulkan_scene_destroy(scene);
        vulkan_bed_finish(&bed);
    }
}

/* Every allocation fails once: the status is NO_MEMORY, and nothing is left of the other objects. */
static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    for (int target = TARGET_PORTABLE; target <= (is_native ? TARGET_LAVAPIPE : TARGET_PORTABLE); target++) {
        struct vulkan_bed bed;
        struct bvhd_vulkan_scene *scene = NULL;
        struct vulkan_bed_options shape = native(4, 12, 20, 0);
        shape.target = (enum target)target;
        if (target == TARGET_PORTABLE)
            shape.device = (struct device_format){.variant = 0};
        vulkan_bed_init(&bed, &shape);
        const struct bvhd_vulkan_scene_options options = scene_options(&bed, 0);
        int64_t before = live_blocks, n = 0;
        for (;; n++) {
            struct bvhd_error error = {0};
            fail_after = n;
            enum bvhd_status status = bvhd_vulkan_scene_create(device, &gpu->queue, &options, &scene, &error);
            fail_after = -1;
            if (status == BVHD_OK)
                break;
            assert_int_equal(status, BVHD_NO_MEMORY);
            assert_int_equal(live_blocks, before);
        }
        assert_true(n > 3);
        bvhd_vulkan_scene_destroy(scene);
        assert_int_equal(live_blocks, before);
        vulkan_bed_finish(&bed);
    }
}

/* ---- driver functions on structures that the driver has not built ---- */

/* Borrows a structure of a scene for functions that copy. The result must not be destroyed. */
static struct driver_structure borrow(const struct vulkan_bed *bed, const struct bvhd_vulkan_scene *scene, uint32_t row)
{
    struct bvhd_vulkan_requirements needed;
    assert_int_equal(bvhd_vulkan_requirements(device, bed->blobs[row].data, bed->blobs[row].size, &needed, NULL),
                     BVHD_OK);
    return (struct driver_structure){.handle = bvhd_vulkan_scene_structure(scene, row),
                                     .type = needed.type,
                                     .address = bvhd_vulkan_scene_location(scene, row),
                                     .size = needed.storage_size};
}

/*
 * Serializing the structure must give the bytes that it came from, with addresses for handles. A top level that is
 * loaded from these bytes must trace the same.
 */
static void serialize_again(const struct vulkan_bed *bed, const struct driver_structure *structure, uint32_t row,
                            const uint64_t *addresses)
{
    unsigned char *data = NULL;
    uint64_t size = 0;
    struct driver_structure loaded;
    const unsigned char *written = bed->blobs[row].data;
    assert_int_equal(driver_structure_serialize(gpu, structure, &memory, &data, &size, NULL), BVHD_OK);
    assert_int_equal(size, bed->blobs[row].size);
    uint64_t handles = bytes_get64(written + 48), body = 56 + 8 * handles;
    assert_memory_equal(data, written, 56);
    for (uint64_t i = 0; i < handles; i++)
        assert_int_equal(bytes_get64(data + 56 + 8 * i), addresses[bytes_get64(written + 56 + 8 * i) - 1]);
    if (handles == 0) /* the instances of a top level hold the addresses, too */
        assert_memory_equal(data + body, written + body, size - body);
    else {
        assert_int_equal(driver_structure_load(gpu, data, size, &loaded, NULL), BVHD_OK);
        trace(bed, loaded.handle);
        driver_structure_destroy(gpu, &loaded);
    }
    memory_free(&memory, data);
}

static void copies_on_the_device_trace_the_same(void **state)
{
    (void)state;
    enum { BOTTOMS = 4 };
    static const VkCopyAccelerationStructureModeKHR modes[] = {VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR,
                                                               VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR};
    struct vulkan_bed bed;
    struct bvhd_vulkan_scene *scene = NULL;
    uint64_t addresses[BOTTOMS];
    skip_unless_native();
    const struct vulkan_bed_options shape = native(BOTTOMS, 40, 300, 0);
    vulkan_bed_init(&bed, &shape);
    const struct bvhd_vulkan_scene_options options = scene_options(&bed, 0);
    assert_int_equal(bvhd_vulkan_scene_create(device, &gpu->queue, &options, &scene, NULL), BVHD_OK);
    for (uint32_t row = 0; row < BOTTOMS; row++)
        addresses[row] = bvhd_vulkan_scene_location(scene, row);
    for (size_t m = 0; m < 2; m++) {
        struct driver_structure copies[BOTTOMS + 1], from;
        for (uint32_t row = 0; row <= BOTTOMS; row++) {
            from = borrow(&bed, scene, row);
            assert_int_equal(driver_structure_copy(gpu, &from, modes[m], &copies[row], NULL), BVHD_OK);
            serialize_again(&bed, &from, row, addresses);
            serialize_again(&bed, &copies[row], row, addresses);
        }
        trace(&bed, copies[BOTTOMS].handle);
        for (uint32_t row = 0; row <= BOTTOMS; row++)
            driver_structure_destroy(gpu, &copies[row]);
    }
    bvhd_vulkan_scene_destroy(scene);
    vulkan_bed_finish(&bed);
}

/* ---- structures that were tampered with ---- */

static void tamper(struct random *random, unsigned char *data, uint64_t size)
{
    uint64_t at = random_next(random) % size, aligned = at & ~UINT64_C(3);
    switch (random_next(random) % 4) {
    case 0:
        data[at] = (unsigned char)random_next(random);
        break;
    case 1:
        data[at] = (unsigned char)(data[at] ^ 1 << random_next(random) % 8);
        break;
    case 2: /* a value like an offset or a count */
        bytes_put32(data + aligned, (uint32_t)(random_next(random) % 700));
        break;
    default:
        bytes_put32(data + aligned, bytes_get32(data + (random_next(random) % size & ~UINT64_C(3))));
    }
}

/*
 * Loads a scene if the checks pass, and traces rays through it. The answers do not matter, but the driver must survive.
 * Returns false when the scene was refused.
 */
static bool load_and_trace(const struct vulkan_bed *bed)
{
    struct bvhd_vulkan_scene *scene = NULL;
    struct bvhd_error error = {0};
    struct tracer *tracer = NULL;
    const struct bvhd_vulkan_scene_options options = scene_options(bed, 0);
    if (bvhd_vulkan_scene_create(device, &gpu->queue, &options, &scene, &error) != BVHD_OK)
        return false;
    enum { COUNT = 256 };
    struct ray rays[COUNT];
    struct tracer_hit hits[COUNT];
    struct random random = {5};
    for (int i = 0; i < COUNT; i++) {
        rays[i] = (struct ray){.tmax = INFINITY, .cull_mask = 0xff};
        for (int axis = 0; axis < 3; axis++) {
            rays[i].origin[axis] = (float)random_between(&random, -2, 14);
            rays[i].direction[axis] = (float)random_between(&random, -1, 1);
        }
    }
    assert_int_equal(
        tracer_query_create(gpu, bvhd_vulkan_scene_structure(scene, bed->count - 1), &memory, &tracer, &error),
        BVHD_OK);
    assert_int_equal(tracer->trace(tracer, rays, COUNT, hits, NULL, &error), BVHD_OK);
    tracer_destroy(tracer);
    bvhd_vulkan_scene_destroy(scene);
    return true;
}

/* The command line can ask for more: vulkan_driver TRIES. */
static uint64_t tries = 150;

static void what_passes_the_check_does_no_harm(void **state)
{
    (void)state;
    struct vulkan_bed bed;
    struct random random = {tries};
    uint64_t passed = 0;
    skip_unless_native();
    const struct vulkan_bed_options shape = native(3, 6, 6, 0);
    vulkan_bed_init(&bed, &shape);
    for (uint64_t i = 0; i < tries; i++) {
        struct bvhd_vulkan_bytes *blob = &bed.blobs[random_next(&random) % bed.count];
        const struct bvhd_vulkan_bytes whole = *blob;
        unsigned char *data = aligned_alloc(64, bytes_align(whole.size, 64));
        memcpy(data, whole.data, whole.size);
        blob->data = data;
        for (uint64_t n = 1 + random_next(&random) % 4; n > 0; n--)
            tamper(&random, data, whole.size);
        passed += load_and_trace(&bed);
        *blob = whole;
        free(data);
    }
    printf("%d of %d were loaded\n", (int)passed, (int)tries);
    assert_true(passed > tries / 8 && passed < tries);
    vulkan_bed_finish(&bed);
}

int main(int argc, char **argv)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_probe_tells_what_the_device_loads),
        cmocka_unit_test(native_scenes_are_traced),
        cmocka_unit_test(own_buffers_are_filled),
        cmocka_unit_test(portable_scenes_arrive),
        cmocka_unit_test(failing_allocations_leave_nothing),
        cmocka_unit_test(copies_on_the_device_trace_the_same),
        cmocka_unit_test(what_passes_the_check_does_no_harm),
    };
    tries = argc > 1 ? strtoull(argv[1], NULL, 10) : tries;
    return gpu_bed_is_missing(true) ? GPU_BED_SKIPPED : cmocka_run_group_tests(tests, open_device, close_device);
}
