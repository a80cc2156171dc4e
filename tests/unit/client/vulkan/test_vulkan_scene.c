/* SPDX-License-Identifier: Apache-2.0 */
/* test_vulkan_scene.c - tests how whole scenes are placed and loaded, and that every failure leaves nothing behind. */
#include "tests/support/unit.h"

#include "tests/support/client/vulkan/fake_vulkan.h"
#include "builder/format/lavapipe.h"
#include "client/library.h"
#include "builder/format/portable.h"
#include "tests/support/client/vulkan/vulkan_bed.h"

static const struct device_format driver = {"driver uuid 1234", "driver uuid 1234", LAVAPIPE_PLAIN};
static const VkAllocationCallbacks callbacks; /* never called: only its address matters here */

struct world {
    struct vulkan_bed bed;
    struct bvhd_vulkan_device *device;
    struct bvhd_format format;
    struct bvhd_vulkan_queue queue;
};

static struct world world;

static struct vulkan_bed_options shape(enum target target, uint32_t bottoms, uint32_t instances, uint32_t triangles,
                                       uint32_t named)
{
    struct vulkan_bed_options options = {
        .target = target, .bottoms = bottoms, .instances = instances, .triangles = triangles, .named = named};
    if (target == TARGET_LAVAPIPE)
        options.device = driver;
    return options;
}

static void begin(const struct vulkan_bed_options *options, bool has_structures, bool has_addresses)
{
    fake_vulkan_reset();
    vulkan_bed_init(&world.bed, options);
    const struct bvhd_vulkan_device_options device = fake_vulkan_options(has_structures, has_addresses, &callbacks);
    assert_int_equal(bvhd_vulkan_device_create(&device, &world.device, NULL), BVHD_OK);
    world.format = vulkan_bed_format(&driver);
    world.queue = fake_vulkan_queue();
}

static void end(void)
{
    bvhd_vulkan_device_destroy(world.device);
    vulkan_bed_finish(&world.bed);
    assert_int_equal(fake_vulkan.live, 0);
    assert_int_equal(library_memory.live, 0);
}

static struct bvhd_vulkan_scene_options scene_options(uint32_t flags)
{
    return (struct bvhd_vulkan_scene_options){.struct_size = sizeof(struct bvhd_vulkan_scene_options),
                                              .blobs = world.bed.blobs,
                                              .blob_count = world.bed.count,
                                              .flags = flags,
                                              .format = &world.format};
}

static struct bvhd_vulkan_scene *load(uint32_t flags)
{
    struct bvhd_vulkan_scene *scene = NULL;
    struct bvhd_error error = {0};
    const struct bvhd_vulkan_scene_options options = scene_options(flags);
    if (bvhd_vulkan_scene_create(world.device, &world.queue, &options, &scene, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return scene;
}

/* Expects a failure that leaves nothing behind, and the result unchanged. */
static void refuse(const struct bvhd_vulkan_scene_options *options, enum bvhd_status wanted, const char *where)
{
    struct bvhd_vulkan_scene *scene = NULL;
    struct bvhd_error error = {0};
    uint64_t live = library_memory.live;
    assert_int_equal(bvhd_vulkan_scene_create(world.device, &world.queue, options, &scene, &error), wanted);
    assert_int_equal(error.status, wanted);
    if (where)
        assert_string_equal(error.where, where);
    assert_null(scene);
    assert_int_equal(fake_vulkan.live, 0);
    assert_int_equal(library_memory.live, live);
}

/* ---- Portable scenes ---- */

static void check_body(const struct bvhd_vulkan_scene *scene, uint32_t row, uint64_t base)
{
    struct bvhd_vulkan_span span;
    VkDeviceSize whole;
    struct portable_view view;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(bvhd_vulkan_scene_storage(scene, row, &span, &whole), BVHD_OK);
    assert_int_equal(
        portable_open((struct bytes){world.bed.blobs[row].data, world.bed.blobs[row].size}, &memory, &view, NULL),
        BVHD_OK);
    assert_int_equal(span.size, view.header->body_size);
    assert_int_equal(span.offset % 128, 0);
    assert_true(span.offset + span.size <= whole);
    assert_int_equal(bvhd_vulkan_scene_location(scene, row), base + span.offset);
    unsigned char *expected = malloc(span.size);
    memcpy(expected, view.header, span.size);
    for (uint32_t i = 0; view.header->content == PORTABLE_INSTANCES && i < view.header->record_count; i++) {
        const struct portable_instance *record = (const struct portable_instance *)view.records + i;
        uint64_t location = bvhd_vulkan_scene_location(scene, vulkan_bed_bottom(&world.bed, record->instance));
        bytes_put64(expected + view.header->record_offset + 128 * (uint64_t)i + 112, location);
    }
    assert_memory_equal(fake_vulkan_bytes(span.buffer) + span.offset, expected, span.size);
    free(expected);
}

static void portable_structures_share_one_buffer(void **state)
{
    (void)state;
    for (uint32_t addresses = 0; addresses < 2; addresses++)
        for (uint32_t flags = 0; flags <= addresses; flags++) {
            const struct vulkan_bed_options options = shape(TARGET_PORTABLE, 6, 30, 40, 0);
            begin(&options, false, addresses);
            struct bvhd_vulkan_scene *scene = load(flags);
            struct bvhd_vulkan_span span;
            VkDeviceSize whole;
            assert_int_equal(bvhd_vulkan_scene_target(scene), BVHD_TARGET_PORTABLE);
            assert_int_equal(bvhd_vulkan_scene_storage(scene, 0, &span, &whole), BVHD_OK);
            uint64_t base = flags ? (uint64_t)(uintptr_t)fake_vulkan_bytes(span.buffer) : 0;
            for (uint32_t i = 0; i < world.bed.count; i++)
                check_body(scene, i, base);
            assert_true(bvhd_vulkan_scene_structure(scene, 0) == VK_NULL_HANDLE);
            assert_int_equal(bvhd_vulkan_scene_storage(scene, world.bed.count, &span, &whole), BVHD_NOT_FOUND);
            assert_true(bvhd_vulkan_scene_location(scene, world.bed.count) == UINT64_MAX);
            bvhd_vulkan_scene_destroy(scene);
            end();
        }
}

static void one_bottom_level_is_a_scene(void **state)
{
    (void)state;
    const struct vulkan_bed_options options = shape(TARGET_PORTABLE, 1, 0, 40, 0);
    begin(&options, false, false);
    struct bvhd_vulkan_scene *scene = load(0);
    check_body(scene, 0, 0);
    assert_int_equal(bvhd_vulkan_scene_location(scene, 0), 0);
    bvhd_vulkan_scene_destroy(scene);
    end();
}

/* A structure that is larger than a step is loaded in several steps. */
static void large_structures_come_in_steps(void **state)
{
    (void)state;
    const struct vulkan_bed_options options = shape(TARGET_PORTABLE, 1, 3, 1000, 0);
    begin(&options, false, false);
    enum { STEP = 32 << 20 };
    uint64_t size = world.bed.blobs[0].size + (UINT64_C(80) << 20), body = size - 64;
    unsigned char *padded = aligned_alloc(64, bytes_align(size, 64));
    assert_non_null(padded);
    memcpy(padded, world.bed.blobs[0].data, world.bed.blobs[0].size);
    for (uint64_t i = world.bed.blobs[0].size; i < size; i++)
        padded[i] = (unsigned char)(i * 7919 >> 5);
    bytes_put64(padded + 32, size); /* a body may be longer than its sections */
    bytes_put64(padded + 40, body);
    bytes_put64(padded + 64 + 96, body);
    const struct bvhd_vulkan_bytes original = world.bed.blobs[0];
    world.bed.blobs[0] = (struct bvhd_vulkan_bytes){padded, size};
    struct bvhd_vulkan_scene *scene = load(0);
    struct bvhd_vulkan_span span;
    VkDeviceSize whole;
    assert_int_equal(bvhd_vulkan_scene_storage(scene, 0, &span, &whole), BVHD_OK);
    assert_int_equal(span.size, body);
    assert_memory_equal(fake_vulkan_bytes(span.buffer) + span.offset, padded + 64, body);
    check_body(scene, 1, 0);
    assert_int_equal(fake_vulkan.submissions, 3);
    assert_true(fake_vulkan.host_bytes <= STEP + 4096);
    bvhd_vulkan_scene_destroy(scene);
    world.bed.blobs[0] = original;
    free(padded);
    end();
}

static void a_buffer_that_no_shader_sees_wants_addresses(void **state)
{
    (void)state;
    const struct vulkan_bed_options options = shape(TARGET_PORTABLE, 4, 30, 40, 0);
    begin(&options, false, true);
    bvhd_vulkan_device_destroy(world.device);
    fake_vulkan.max_storage_range = 4096;
    const struct bvhd_vulkan_device_options device = fake_vulkan_options(false, true, &callbacks);
    assert_int_equal(bvhd_vulkan_device_create(&device, &world.device, NULL), BVHD_OK);
    const struct bvhd_vulkan_scene_options bound = scene_options(0);
    refuse(&bound, BVHD_TOO_LARGE, "scene");
    bvhd_vulkan_scene_destroy(load(BVHD_VULKAN_SCENE_ADDRESSES));
    end();
}

/* ---- Native scenes ---- */

static void check_native(const struct bvhd_vulkan_scene *scene)
{
    for (uint32_t row = 0; row < world.bed.count; row++) {
        uint64_t size;
        VkAccelerationStructureTypeKHR type;
        struct lavapipe_view view;
        struct memory memory;
        const struct bytes blob = {world.bed.blobs[row].data, world.bed.blobs[row].size};
        if (!blob.data)
            continue;
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(lavapipe_open(blob, LAVAPIPE_PLAIN, &memory, &view, NULL), BVHD_OK);
        unsigned char *bytes = fake_vulkan_structure(bvhd_vulkan_scene_structure(scene, row), &size, &type);
        assert_int_equal(size, view.body_size);
        assert_int_equal(type, row + 1 == world.bed.count && world.bed.options.instances
                                   ? VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR
                                   : VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR);
        assert_int_equal(bvhd_vulkan_scene_location(scene, row), (uint64_t)(uintptr_t)bytes);
        unsigned char *expected = malloc(size);
        memcpy(expected, view.body, size);
        for (uint32_t i = 0; i < view.handle_count; i++) {
            uint32_t bottom = vulkan_bed_bottom(&world.bed, lavapipe_instance_at(&view, i).instance);
            bytes_put64(expected + view.leaf_offset + i * sizeof(struct lavapipe_instance),
                        bvhd_vulkan_scene_location(scene, bottom));
        }
        assert_memory_equal(bytes, expected, size);
        free(expected);
    }
}

static void native_structures_become_what_they_say(void **state)
{
    (void)state;
    static const uint32_t shapes[][4] = {{1, 0, 5, 0}, {1, 1, 2, 0}, {9, 100, 30, 0}, {9, 100, 30, 4}};
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0]; i++) {
        const struct vulkan_bed_options options =
            shape(TARGET_LAVAPIPE, shapes[i][0], shapes[i][1], shapes[i][2], shapes[i][3]);
        begin(&options, true, true);
        struct bvhd_vulkan_scene *scene = load(0);
        struct bvhd_vulkan_span span;
        VkDeviceSize whole;
        assert_int_equal(bvhd_vulkan_scene_target(scene), BVHD_TARGET_LAVAPIPE);
        check_native(scene);
        if (options.named) {
            assert_true(bvhd_vulkan_scene_structure(scene, options.named) == VK_NULL_HANDLE);
            assert_true(bvhd_vulkan_scene_location(scene, options.named) == UINT64_MAX);
        }
        assert_int_equal(bvhd_vulkan_scene_storage(scene, 0, &span, &whole), BVHD_NOT_FOUND);
        bvhd_vulkan_scene_destroy(scene);
        end();
    }
}

/* Devices allow only 4,096 allocations in total. */
static void many_structures_take_few_allocations(void **state)
{
    (void)state;
    const struct vulkan_bed_options options = shape(TARGET_LAVAPIPE, 3000, 3000, 2, 0);
    begin(&options, true, true);
    struct bvhd_vulkan_scene *scene = load(0);
    assert_int_equal(fake_vulkan.structures, 3001);
    assert_true(fake_vulkan.allocations <= 3);
    check_native(scene);
    bvhd_vulkan_scene_destroy(scene);
    end();
}

static void equal_data_is_loaded_once(void **state)
{
    (void)state;
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++) {
        const struct vulkan_bed_options options = shape((enum target)target, 5, 12, 30, 0);
        begin(&options, true, true);
        world.bed.blobs[2] = world.bed.blobs[4] = world.bed.blobs[1];
        struct bvhd_vulkan_scene *scene = load(0);
        assert_true(bvhd_vulkan_scene_location(scene, 1) == bvhd_vulkan_scene_location(scene, 4));
        assert_true(bvhd_vulkan_scene_location(scene, 1) == bvhd_vulkan_scene_location(scene, 2));
        assert_true(bvhd_vulkan_scene_location(scene, 1) != bvhd_vulkan_scene_location(scene, 3));
        if (target == TARGET_LAVAPIPE) {
            assert_int_equal(fake_vulkan.structures, 4);
            assert_true(bvhd_vulkan_scene_structure(scene, 4) == bvhd_vulkan_scene_structure(scene, 1));
        }
        bvhd_vulkan_scene_destroy(scene);
        end();
    }
}

static void memory_that_is_short_on_the_device_is_taken_elsewhere(void **state)
{
    (void)state;
    const struct vulkan_bed_options options = shape(TARGET_LAVAPIPE, 5, 12, 30, 0);
    begin(&options, true, true);
    fake_vulkan.local_left = 100;
    struct bvhd_vulkan_scene *scene = load(0);
    check_native(scene);
    bvhd_vulkan_scene_destroy(scene);
    end();
}

/* ---- Refusals ---- */

static void wrong_arguments_are_refused(void **state)
{
    (void)state;
    const struct vulkan_bed_options options = shape(TARGET_LAVAPIPE, 3, 12, 30, 0);
    begin(&options, true, true);
    struct bvhd_vulkan_scene_options wrong = scene_options(0);
    wrong.struct_size--;
    refuse(&wrong, BVHD_INVALID, "options.struct_size");
    wrong = scene_options(2);
    refuse(&wrong, BVHD_INVALID, "options.flags");
    wrong = scene_options(0);
    wrong.blob_count = 0;
    refuse(&wrong, BVHD_INVALID, "options.blob_count");
    wrong.blob_count = 4;
    wrong.blobs = NULL;
    refuse(&wrong, BVHD_INVALID, "options.blobs");
    wrong = scene_options(0);
    wrong.blobs = world.bed.blobs + 1; /* row 2 is the top level itself */
    wrong.blob_count = 3;
    refuse(&wrong, BVHD_INVALID, NULL);
    end();
    begin(&options, false, false);
    wrong = scene_options(BVHD_VULKAN_SCENE_ADDRESSES);
    refuse(&wrong, BVHD_UNSUPPORTED, "options.flags");
    end();
}

/* A structure of each target passes the check, but they cannot form a scene together. */
static void targets_are_not_mixed(void **state)
{
    (void)state;
    struct vulkan_bed other;
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++) {
        const struct vulkan_bed_options options = shape((enum target)target, 3, 12, 30, 0);
        const struct vulkan_bed_options others =
            shape(target == TARGET_PORTABLE ? TARGET_LAVAPIPE : TARGET_PORTABLE, 3, 12, 30, 0);
        begin(&options, true, true);
        vulkan_bed_init(&other, &others);
        struct bvhd_vulkan_bytes kept = world.bed.blobs[1];
        const struct bvhd_vulkan_scene_options wrong = scene_options(0);
        world.bed.blobs[1] = other.blobs[1];
        refuse(&wrong, BVHD_INVALID, "blobs[1]: data");
        world.bed.blobs[1] = kept;
        kept = world.bed.blobs[3];
        world.bed.blobs[3] = other.blobs[3];
        refuse(&wrong, BVHD_INVALID, "blobs[3]: data");
        world.bed.blobs[3] = kept;
        vulkan_bed_finish(&other);
        end();
    }
}

static void scenes_that_do_not_fit_together_are_refused(void **state)
{
    (void)state;
    const struct vulkan_bed_options portable = shape(TARGET_PORTABLE, 1, 2, 3, 0);
    struct vulkan_bed other;
    vulkan_bed_init(&other, &portable);
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++) {
        const struct vulkan_bed_options options = shape((enum target)target, 3, 12, 30, 0);
        begin(&options, true, true);
        const struct bvhd_vulkan_scene_options all = scene_options(0);
        const struct bvhd_vulkan_bytes one = world.bed.blobs[1];
        world.bed.blobs[1] = (struct bvhd_vulkan_bytes){NULL, 0};
        refuse(&all, BVHD_INVALID, "blobs[3]: references[1]");
        world.bed.blobs[1] = other.blobs[1];
        refuse(&all, BVHD_INVALID, "blobs[1]: data");
        world.bed.blobs[1] = one;
        world.bed.blobs[1].size--;
        refuse(&all, BVHD_CORRUPT, "blobs[1]: header.serializedSize");
        world.bed.blobs[1] = one;
        world.bed.blobs[0] = (struct bvhd_vulkan_bytes){one.data, one.size - 1};
        refuse(&all, BVHD_INVALID, "blobs[1]");
        world.bed.blobs[0] = one;
        world.bed.blobs[3] = (struct bvhd_vulkan_bytes){NULL, 0};
        refuse(&all, BVHD_INVALID, "blobs");
        end();
    }
    vulkan_bed_finish(&other);
}

static void other_drivers_structures_are_refused(void **state)
{
    (void)state;
    const struct vulkan_bed_options options = shape(TARGET_LAVAPIPE, 3, 12, 30, 0);
    begin(&options, true, true);
    const struct bvhd_vulkan_scene_options all = scene_options(0);
    world.format.compatibility_uuid[15] ^= 1;
    refuse(&all, BVHD_INCOMPATIBLE, "blobs[0]: header.compatibilityUUID");
    end();
    begin(&options, false, true);
    const struct bvhd_vulkan_scene_options again = scene_options(0);
    refuse(&again, BVHD_UNSUPPORTED, "blobs[0]: header.driverUUID");
    end();
}

/* Without a format the device is probed; this device serializes an unknown format. */
static void an_unknown_device_says_so(void **state)
{
    (void)state;
    const struct vulkan_bed_options options = shape(TARGET_LAVAPIPE, 3, 12, 30, 0);
    begin(&options, true, true);
    struct bvhd_vulkan_scene_options all = scene_options(0);
    all.format = NULL;
    struct bvhd_vulkan_scene *scene = NULL;
    struct bvhd_error error = {0};
    enum bvhd_status status = bvhd_vulkan_scene_create(world.device, &world.queue, &all, &scene, &error);
    assert_true(status == BVHD_UNSUPPORTED || status == BVHD_CORRUPT);
    assert_true(fake_vulkan.submissions == 2);
    assert_int_equal(fake_vulkan.live, 0);
    end();
}

/* ---- Failures ---- */

/* Every Vulkan call that can fail fails once in each way, and so does every allocation of the library. */
static void whatever_fails_nothing_is_left(void **state)
{
    (void)state;
    static const struct {
        VkResult result;
        enum bvhd_status status;
    } ways[] = {
        {VK_ERROR_OUT_OF_DEVICE_MEMORY, BVHD_NO_MEMORY},
        {VK_ERROR_OUT_OF_HOST_MEMORY, BVHD_NO_MEMORY},
        {VK_ERROR_DEVICE_LOST, BVHD_UNAVAILABLE},
        {VK_ERROR_UNKNOWN, BVHD_INTERNAL},
    };
    for (int target = TARGET_PORTABLE; target <= TARGET_LAVAPIPE; target++) {
        const struct vulkan_bed_options options = shape((enum target)target, 3, 12, 30, 0);
        begin(&options, true, true);
        const struct bvhd_vulkan_scene_options all = scene_options(0);
        for (size_t way = 0; way < sizeof ways / sizeof ways[0]; way++) {
            struct bvhd_vulkan_scene *scene = NULL;
            int64_t n = 0;
            fake_vulkan.failure = ways[way].result;
            for (;; n++) {
                struct bvhd_error error = {0};
                uint64_t live = library_memory.live;
                fake_vulkan.fail_after = n;
                enum bvhd_status status = bvhd_vulkan_scene_create(world.device, &world.queue, &all, &scene, &error);
                fake_vulkan.fail_after = -1;
                /* One memory type is used up, so another one is taken. */
                if (status == BVHD_OK && ways[way].result == VK_ERROR_OUT_OF_DEVICE_MEMORY && n < 4) {
                    bvhd_vulkan_scene_destroy(scene);
                    scene = NULL;
                    continue;
                }
                if (status == BVHD_OK)
                    break;
                assert_int_equal(status, ways[way].status);
                assert_non_null(strstr(error.where, "vk"));
                assert_null(scene);
                assert_int_equal(fake_vulkan.live, 0);
                assert_int_equal(library_memory.live, live);
            }
            assert_true(n > 12);
            bvhd_vulkan_scene_destroy(scene);
        }
        for (int64_t n = 0;; n++) {
            struct bvhd_vulkan_scene *scene = NULL;
            uint64_t live = library_memory.live;
            library_memory.fail_after = n;
            enum bvhd_status status = bvhd_vulkan_scene_create(world.device, &world.queue, &all, &scene, NULL);
            library_memory.fail_after = -1;
            bvhd_vulkan_scene_destroy(scene);
            assert_int_equal(library_memory.live, live);
            assert_int_equal(fake_vulkan.live, 0);
            if (status == BVHD_OK)
                break;
            assert_int_equal(status, BVHD_NO_MEMORY);
        }
        end();
    }
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(portable_structures_share_one_buffer),
        cmocka_unit_test(one_bottom_level_is_a_scene),
        cmocka_unit_test(large_structures_come_in_steps),
        cmocka_unit_test(a_buffer_that_no_shader_sees_wants_addresses),
        cmocka_unit_test(native_structures_become_what_they_say),
        cmocka_unit_test(many_structures_take_few_allocations),
        cmocka_unit_test(equal_data_is_loaded_once),
        cmocka_unit_test(memory_that_is_short_on_the_device_is_taken_elsewhere),
        cmocka_unit_test(wrong_arguments_are_refused),
        cmocka_unit_test(targets_are_not_mixed),
        cmocka_unit_test(scenes_that_do_not_fit_together_are_refused),
        cmocka_unit_test(other_drivers_structures_are_refused),
        cmocka_unit_test(an_unknown_device_says_so),
        cmocka_unit_test(whatever_fails_nothing_is_left),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
