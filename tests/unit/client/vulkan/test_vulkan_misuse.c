/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_vulkan_misuse.c - a table of wrong calls of bvhd_vulkan.h and bvhd_trace.h: the status of each, the place and
 * the text of its error. No wrong call crashes or records anything. On a device in plain memory.
 */
#include "tests/support/unit.h"

#include <bvhd/bvhd_trace.h>

#include "client/library.h"
#include "tests/support/client/vulkan/fake_vulkan.h"
#include "tests/support/client/vulkan/vulkan_bed.h"

enum { RAYS = 1000 };

static const VkAllocationCallbacks callbacks; /* never called: only its address matters here */

/* The objects that the calls use: a device, and a scene of two bottom levels and a top level. */
struct world {
    struct bvhd_error error;
    struct vulkan_bed bed;
    struct bvhd_vulkan_device *device;
    struct bvhd_vulkan_queue queue;
    struct bvhd_vulkan_scene *scene;
    struct bvhd_tracer *tracer;
    struct bvhd_trace_binding *binding;
    VkBuffer rays, hits;
    VkCommandBuffer commands;
};

static struct world world;
static int rows, failures;

static void check(const char *what, enum bvhd_status got, enum bvhd_status status, const char *where, const char *text)
{
    const struct bvhd_error *error = &world.error;
    bool good = got == status && (!where || (error->status == status && strcmp(error->where, where) == 0 &&
                                             error->text[0] && strstr(error->text, text)));
    rows++;
    if (good)
        return;
    failures++;
    fprintf(stderr, "%s\n    is     %s at %s: %s\n    not    %s at %s: %s\n", what, bvhd_status_name(got), error->where,
            error->text, bvhd_status_name(status), where ? where : "", text);
}

/* A call that returns a status and fills world.error. */
#define CALL(call, status, where, text)                                                                                \
    do {                                                                                                               \
        memset(&world.error, 0, sizeof world.error);                                                                   \
        check(#call, call, status, where, text);                                                                       \
    } while (0)

/* A call that cannot tell an error, and whether it did as NULL demands. */
#define QUIET(condition) check(#condition, (condition) ? BVHD_OK : BVHD_INTERNAL, BVHD_OK, NULL, "")

static void begin(void)
{
    const struct vulkan_bed_options options = {
        .target = TARGET_PORTABLE, .bottoms = 2, .instances = 5, .triangles = 20};
    fake_vulkan_reset();
    vulkan_bed_init(&world.bed, &options);
    const struct bvhd_vulkan_device_options device = fake_vulkan_options(true, true, &callbacks);
    assert_int_equal(bvhd_vulkan_device_create(&device, &world.device, NULL), BVHD_OK);
    world.queue = fake_vulkan_queue();
    const struct bvhd_vulkan_scene_options scene = {
        .struct_size = sizeof scene, .blobs = world.bed.blobs, .blob_count = world.bed.count};
    assert_int_equal(bvhd_vulkan_scene_create(world.device, &world.queue, &scene, &world.scene, NULL), BVHD_OK);
    const struct bvhd_tracer_options tracer = {
        .struct_size = sizeof tracer, .scene = world.scene, .root = world.bed.count - 1};
    assert_int_equal(bvhd_tracer_create(world.device, &world.queue, &tracer, &world.tracer, NULL), BVHD_OK);
    world.rays = fake_vulkan_buffer(RAYS * 48, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, false, NULL);
    world.hits = fake_vulkan_buffer(RAYS * 32, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, false, NULL);
    const struct bvhd_trace_buffers buffers = {.struct_size = sizeof buffers,
                                               .rays = {world.rays, 0, RAYS * 48},
                                               .hits = {world.hits, 0, RAYS * 32},
                                               .max_rays = RAYS};
    assert_int_equal(bvhd_tracer_bind(world.tracer, &buffers, &world.binding, NULL), BVHD_OK);
    world.commands = fake_vulkan_commands();
}

static void end(void)
{
    bvhd_trace_binding_destroy(world.binding);
    bvhd_tracer_destroy(world.tracer);
    fake_vulkan_free_buffer(world.rays);
    fake_vulkan_free_buffer(world.hits);
    bvhd_vulkan_scene_destroy(world.scene);
    bvhd_vulkan_device_destroy(world.device);
    vulkan_bed_finish(&world.bed);
    assert_int_equal(fake_vulkan.live, 0);
    assert_int_equal(library_memory.live, 0);
}

static void devices(void)
{
    struct bvhd_vulkan_device *device = NULL;
    const struct bvhd_vulkan_device_options right = fake_vulkan_options(true, true, &callbacks);
    struct bvhd_vulkan_device_options wrong = right;
    void *probe = NULL;
    uint64_t size;
    CALL(bvhd_vulkan_device_create(NULL, &device, &world.error), BVHD_INVALID, "options", "options is NULL");
    CALL(bvhd_vulkan_device_create(&right, NULL, &world.error), BVHD_INVALID, "ret_device", "ret_device is NULL");
    wrong.struct_size = 4;
    CALL(bvhd_vulkan_device_create(&wrong, &device, &world.error), BVHD_INVALID, "options.struct_size",
         "sizeof(struct bvhd_vulkan_device_options)");
    wrong = right;
    wrong.get_instance_proc_addr = NULL;
    CALL(bvhd_vulkan_device_create(&wrong, &device, &world.error), BVHD_INVALID, "options.get_instance_proc_addr",
         "is NULL");
    wrong = right;
    wrong.device = VK_NULL_HANDLE;
    CALL(bvhd_vulkan_device_create(&wrong, &device, &world.error), BVHD_INVALID, "options.device", "is NULL");
    CALL(bvhd_vulkan_probe(NULL, &world.queue, &probe, &size, &world.error), BVHD_INVALID, "device", "device is NULL");
    CALL(bvhd_vulkan_probe(world.device, NULL, &probe, &size, &world.error), BVHD_INVALID, "queue", "queue is NULL");
    CALL(bvhd_vulkan_probe(world.device, &world.queue, NULL, &size, &world.error), BVHD_INVALID, "ret_probe", "NULL");
    CALL(bvhd_vulkan_probe(world.device, &world.queue, &probe, NULL, &world.error), BVHD_INVALID, "ret_size", "NULL");
    QUIET((bvhd_vulkan_device_destroy(NULL), bvhd_vulkan_free(NULL), true));
    assert_null(device);
}

static void structures(void)
{
    const struct bvhd_vulkan_bytes *blob = &world.bed.blobs[0];
    const char *bytes = blob->data;
    struct bvhd_format format = {.struct_size = 1};
    struct bvhd_vulkan_requirements needed;
    struct bvhd_reference reference = {.handle = 1};
    VkAccelerationStructureInstanceKHR instance = {.accelerationStructureReference = 9};
    uint32_t row, count;
    CALL(bvhd_vulkan_check(NULL, NULL, bytes, blob->size, &world.error), BVHD_INVALID, "device", "device is NULL");
    CALL(bvhd_vulkan_check(world.device, NULL, NULL, 9, &world.error), BVHD_INVALID, "data", "data is NULL");
    CALL(bvhd_vulkan_check(world.device, NULL, bytes + 4, 60, &world.error), BVHD_INVALID, "data", "multiple of 16");
    CALL(bvhd_vulkan_check(world.device, &format, bytes, blob->size, &world.error), BVHD_INVALID, "format.struct_size",
         "sizeof(struct bvhd_format)");
    CALL(bvhd_vulkan_check(world.device, NULL, bytes, 7, &world.error), BVHD_CORRUPT, NULL, "");
    CALL(bvhd_vulkan_requirements(NULL, bytes, blob->size, &needed, &world.error), BVHD_INVALID, "device", "NULL");
    CALL(bvhd_vulkan_requirements(world.device, NULL, 9, &needed, &world.error), BVHD_INVALID, "data", "NULL");
    CALL(bvhd_vulkan_requirements(world.device, bytes, blob->size, NULL, &world.error), BVHD_INVALID,
         "ret_requirements", "ret_requirements is NULL");
    CALL(bvhd_vulkan_rows(NULL, 1, &instance, 1, &row, &count, &world.error), BVHD_INVALID, "references", "NULL");
    CALL(bvhd_vulkan_rows(&reference, 1, NULL, 1, &row, &count, &world.error), BVHD_INVALID, "instances", "NULL");
    CALL(bvhd_vulkan_rows(&reference, 1, &instance, 1, NULL, &count, &world.error), BVHD_INVALID, "ret_rows", "NULL");
    CALL(bvhd_vulkan_rows(&reference, 1, &instance, 1, &row, NULL, &world.error), BVHD_INVALID, "ret_row_count",
         "NULL");
    CALL(bvhd_vulkan_rows(&reference, 1, &instance, 1, &row, &count, &world.error), BVHD_INVALID, "instances[0]",
         "0x9, which is not among the references");
}

static void uploads(void)
{
    struct bvhd_vulkan_upload upload = {.struct_size = sizeof upload};
    VkAccelerationStructureKHR made = VK_NULL_HANDLE;
    struct bvhd_vulkan_device *device = world.device;
    CALL(bvhd_vulkan_record_upload(NULL, world.commands, &upload, &made, &world.error), BVHD_INVALID, "device", "NULL");
    CALL(bvhd_vulkan_record_upload(device, NULL, &upload, &made, &world.error), BVHD_INVALID, "commands", "NULL");
    CALL(bvhd_vulkan_record_upload(device, world.commands, NULL, &made, &world.error), BVHD_INVALID, "upload", "NULL");
    CALL(bvhd_vulkan_record_upload(device, world.commands, &upload, NULL, &world.error), BVHD_INVALID, "ret_structure",
         "NULL");
    CALL(bvhd_vulkan_record_upload(device, world.commands, &upload, &made, &world.error), BVHD_INVALID, "upload.data",
         "upload.data is NULL");
    upload.data = world.bed.blobs[0].data;
    upload.size = world.bed.blobs[0].size;
    CALL(bvhd_vulkan_record_upload(device, world.commands, &upload, &made, &world.error), BVHD_INVALID,
         "upload.staging_mapped", "upload.staging_mapped is NULL");
    upload.staging_mapped = &upload;
    CALL(bvhd_vulkan_record_upload(device, world.commands, &upload, &made, &world.error), BVHD_INVALID,
         "upload.staging", "VK_NULL_HANDLE");
    upload.struct_size = 0;
    CALL(bvhd_vulkan_record_upload(device, world.commands, &upload, &made, &world.error), BVHD_INVALID,
         "upload.struct_size", "struct_size is 0");
    QUIET((bvhd_vulkan_record_barrier(NULL, world.commands), bvhd_vulkan_record_barrier(device, NULL), true));
    QUIET(bvhd_vulkan_address(NULL, VK_NULL_HANDLE) == 0 && bvhd_vulkan_address(device, VK_NULL_HANDLE) == 0);
}

static void scenes(void)
{
    const struct bvhd_vulkan_scene_options right = {
        .struct_size = sizeof right, .blobs = world.bed.blobs, .blob_count = world.bed.count};
    struct bvhd_vulkan_scene_options wrong = right;
    struct bvhd_vulkan_scene *scene = NULL;
    struct bvhd_vulkan_span span;
    VkDeviceSize size;
    const struct bvhd_vulkan_queue *queue = &world.queue;
    CALL(bvhd_vulkan_scene_create(NULL, queue, &right, &scene, &world.error), BVHD_INVALID, "device", "NULL");
    CALL(bvhd_vulkan_scene_create(world.device, NULL, &right, &scene, &world.error), BVHD_INVALID, "queue", "NULL");
    CALL(bvhd_vulkan_scene_create(world.device, queue, NULL, &scene, &world.error), BVHD_INVALID, "options", "NULL");
    CALL(bvhd_vulkan_scene_create(world.device, queue, &right, NULL, &world.error), BVHD_INVALID, "ret_scene", "NULL");
    wrong.blobs = NULL;
    CALL(bvhd_vulkan_scene_create(world.device, queue, &wrong, &scene, &world.error), BVHD_INVALID, "options.blobs",
         "options.blobs is NULL, but blob_count is 3");
    wrong = right;
    wrong.blob_count = 0;
    CALL(bvhd_vulkan_scene_create(world.device, queue, &wrong, &scene, &world.error), BVHD_INVALID,
         "options.blob_count", "there is no structure to load");
    wrong = right;
    wrong.flags = 8;
    CALL(bvhd_vulkan_scene_create(world.device, queue, &wrong, &scene, &world.error), BVHD_INVALID, "options.flags",
         "0x8 has bits that are no BVHD_VULKAN_SCENE_ flag");
    CALL(bvhd_vulkan_scene_storage(NULL, 0, &span, &size), BVHD_INVALID, NULL, "");
    CALL(bvhd_vulkan_scene_storage(world.scene, 0, NULL, &size), BVHD_INVALID, NULL, "");
    CALL(bvhd_vulkan_scene_storage(world.scene, 0, &span, NULL), BVHD_INVALID, NULL, "");
    CALL(bvhd_vulkan_scene_storage(world.scene, 99, &span, &size), BVHD_NOT_FOUND, NULL, "");
    QUIET(bvhd_vulkan_scene_target(NULL) == 0 && !bvhd_vulkan_scene_structure(NULL, 0));
    QUIET(bvhd_vulkan_scene_location(NULL, 0) == UINT64_MAX &&
          bvhd_vulkan_scene_location(world.scene, 9) == UINT64_MAX);
    QUIET((bvhd_vulkan_scene_destroy(NULL), true));
    assert_null(scene);
}

static void tracers(void)
{
    struct bvhd_tracer_options options = {.struct_size = sizeof options};
    struct bvhd_tracer *tracer = NULL;
    struct bvhd_trace_buffers buffers = {.struct_size = sizeof buffers};
    struct bvhd_trace_binding *binding = NULL;
    struct bvhd_trace trace = {.struct_size = sizeof trace};
    CALL(bvhd_tracer_create(NULL, NULL, &options, &tracer, &world.error), BVHD_INVALID, "device", "device is NULL");
    CALL(bvhd_tracer_create(world.device, NULL, NULL, &tracer, &world.error), BVHD_INVALID, "options", "NULL");
    CALL(bvhd_tracer_create(world.device, NULL, &options, NULL, &world.error), BVHD_INVALID, "ret_tracer", "NULL");
    CALL(bvhd_tracer_create(world.device, NULL, &options, &tracer, &world.error), BVHD_INVALID, "options",
         "neither a scene nor a buffer");
    options.scene = world.scene;
    options.root = 9;
    CALL(bvhd_tracer_create(world.device, NULL, &options, &tracer, &world.error), BVHD_NOT_FOUND, "options.root",
         "there is no structure 9");
    CALL(bvhd_tracer_bind(NULL, &buffers, &binding, &world.error), BVHD_INVALID, "tracer", "tracer is NULL");
    CALL(bvhd_tracer_bind(world.tracer, NULL, &binding, &world.error), BVHD_INVALID, "buffers", "buffers is NULL");
    CALL(bvhd_tracer_bind(world.tracer, &buffers, NULL, &world.error), BVHD_INVALID, "ret_binding", "NULL");
    CALL(bvhd_tracer_bind(world.tracer, &buffers, &binding, &world.error), BVHD_INVALID, "buffers.max_rays",
         "there are no rays");
    buffers.max_rays = 10;
    CALL(bvhd_tracer_bind(world.tracer, &buffers, &binding, &world.error), BVHD_INVALID, "buffers.rays",
         "VK_NULL_HANDLE");
    CALL(bvhd_tracer_record(NULL, world.commands, &trace, &world.error), BVHD_INVALID, "binding", "binding is NULL");
    CALL(bvhd_tracer_record(world.binding, NULL, &trace, &world.error), BVHD_INVALID, "commands", "NULL");
    CALL(bvhd_tracer_record(world.binding, world.commands, NULL, &world.error), BVHD_INVALID, "trace", "NULL");
    trace.ray_count = RAYS + 1;
    CALL(bvhd_tracer_record(world.binding, world.commands, &trace, &world.error), BVHD_INVALID, "trace.ray_count",
         "1001 rays, but the binding has 1000");
    trace.order = (enum bvhd_ray_order)7;
    CALL(bvhd_tracer_record(world.binding, world.commands, &trace, &world.error), BVHD_INVALID, "trace.order",
         "7 is no value of enum bvhd_ray_order");
    trace.flags = 0x20;
    CALL(bvhd_tracer_record(world.binding, world.commands, &trace, &world.error), BVHD_INVALID, "trace.flags",
         "0x20 has bits that are no BVHD_TRACE_ flag");
    QUIET((bvhd_trace_binding_destroy(NULL), bvhd_tracer_destroy(NULL), true));
    QUIET(bvhd_tracer_max_rays(NULL) == 0 && bvhd_tracer_scratch_size(NULL, 10) == 0);
    QUIET(bvhd_rays_order(NULL, 100, 48) == BVHD_RAYS_UNKNOWN && bvhd_rays_order(&trace, 2, 4) == BVHD_RAYS_UNKNOWN);
    assert_null(tracer);
    assert_null(binding);
}

static void test_misuses(void **state)
{
    (void)state;
    begin();
    devices();
    structures();
    uploads();
    scenes();
    tracers();
    assert_int_equal(fake_vulkan_recorded(), 0);
    fake_vulkan_submit();
    end();
    assert_int_equal(failures, 0);
    printf("%d misuses\n", rows);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_misuses)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
