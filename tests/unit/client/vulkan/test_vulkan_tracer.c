/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_vulkan_tracer.c - tests that tracers are created, bound and recorded as bvhd_trace.h says, and that nothing is
 * left when a call of Vulkan's fails: on a device in plain memory.
 */
#include "tests/support/unit.h"

#include "client/library.h"
#include "client/vulkan/vulkan_tracer.h"
#include "tests/support/client/vulkan/fake_vulkan.h"
#include "tests/support/client/vulkan/vulkan_bed.h"

enum { RAYS = 100000, FALLBACK_GROUPS = 256 };

static const VkAllocationCallbacks callbacks; /* never called: only its address matters here */

struct world {
    struct vulkan_bed bed;
    struct bvhd_vulkan_device *device;
    struct bvhd_vulkan_queue queue;
    struct bvhd_vulkan_scene *scene;
    VkBuffer rays, hits, scratch;
};

static struct world world;

static void begin_with(bool has_addresses, uint32_t instances, bool has_spheres)
{
    const struct vulkan_bed_options options = {
        .target = TARGET_PORTABLE, .bottoms = 2, .instances = instances, .triangles = 20, .has_spheres = has_spheres};
    struct bvhd_error error = {0};
    vulkan_bed_init(&world.bed, &options);
    const struct bvhd_vulkan_device_options device = fake_vulkan_options(false, has_addresses, &callbacks);
    assert_int_equal(bvhd_vulkan_device_create(&device, &world.device, NULL), BVHD_OK);
    world.queue = fake_vulkan_queue();
    const struct bvhd_vulkan_scene_options scene = {.struct_size = sizeof scene,
                                                    .blobs = world.bed.blobs,
                                                    .blob_count = world.bed.count,
                                                    .flags = has_addresses ? BVHD_VULKAN_SCENE_ADDRESSES : 0};
    if (bvhd_vulkan_scene_create(world.device, &world.queue, &scene, &world.scene, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    world.rays = fake_vulkan_buffer(RAYS * 48 + 128, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, false, NULL);
    world.hits = fake_vulkan_buffer(RAYS * 32, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, false, NULL);
    world.scratch = fake_vulkan_buffer(
        RAYS * 28 + 16 + 128, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT, false, NULL);
}

static void begin(bool has_addresses, uint32_t instances)
{
    begin_with(has_addresses, instances, false);
}

static void end(void)
{
    fake_vulkan_free_buffer(world.rays);
    fake_vulkan_free_buffer(world.hits);
    fake_vulkan_free_buffer(world.scratch);
    bvhd_vulkan_scene_destroy(world.scene);
    bvhd_vulkan_device_destroy(world.device);
    vulkan_bed_finish(&world.bed);
    assert_int_equal(fake_vulkan.live, 0);
    assert_int_equal(library_memory.live, 0);
}

static struct bvhd_tracer_options tracer_options(void)
{
    return (struct bvhd_tracer_options){
        .struct_size = sizeof(struct bvhd_tracer_options), .scene = world.scene, .root = world.bed.count - 1};
}

static struct bvhd_tracer *create(const struct bvhd_tracer_options *options)
{
    struct bvhd_tracer *tracer = NULL;
    struct bvhd_error error = {0};
    if (bvhd_tracer_create(world.device, &world.queue, options, &tracer, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return tracer;
}

static struct bvhd_trace_buffers trace_buffers(void)
{
    return (struct bvhd_trace_buffers){.struct_size = sizeof(struct bvhd_trace_buffers),
                                       .rays = {world.rays, 128, RAYS * 48},
                                       .hits = {world.hits, 0, RAYS * 32},
                                       .max_rays = RAYS};
}

static struct bvhd_trace trace_of(uint32_t count, uint32_t flags, enum bvhd_ray_order order)
{
    return (struct bvhd_trace){
        .struct_size = sizeof(struct bvhd_trace), .ray_count = count, .flags = flags, .order = order};
}

/* ---- records ---- */

static uint32_t record(const struct bvhd_trace_binding *binding, struct bvhd_trace trace)
{
    VkCommandBuffer commands = fake_vulkan_commands();
    fake_vulkan.dispatch_count = 0;
    assert_int_equal(bvhd_tracer_record(binding, commands, &trace, NULL), BVHD_OK);
    fake_vulkan_submit();
    return fake_vulkan.dispatch_count;
}

/* A pass, the resolve kernel, the fallback; the query alone where rays have flags. */
static void records_are_a_few_dispatches(void **state)
{
    (void)state;
    for (int has_addresses = 0; has_addresses < 2; has_addresses++) {
        struct bvhd_trace_binding *binding = NULL;
        fake_vulkan_reset();
        begin(has_addresses, 3);
        const struct bvhd_tracer_options options = tracer_options();
        struct bvhd_tracer *tracer = create(&options);
        const struct bvhd_trace_buffers buffers = trace_buffers();
        assert_int_equal(bvhd_tracer_bind(tracer, &buffers, &binding, NULL), BVHD_OK);

        assert_int_equal(record(binding, trace_of(RAYS, 0, BVHD_RAYS_COHERENT)), 3);
        assert_true(fake_vulkan.dispatches[0].pipeline == tracer->coherent.pipeline);
        assert_int_equal(fake_vulkan.dispatches[0].groups, (RAYS + 63) / 64);
        assert_int_equal(fake_vulkan.dispatches[0].group_size, 64);
        assert_true(fake_vulkan.dispatches[1].pipeline == tracer->resolve);
        assert_int_equal(fake_vulkan.dispatches[1].groups, FALLBACK_GROUPS);
        assert_true(fake_vulkan.dispatches[2].pipeline == tracer->fallback);
        assert_int_equal(fake_vulkan.dispatches[2].groups, FALLBACK_GROUPS);
        for (int order = 0; order < 2; order++) {
            assert_int_equal(record(binding, trace_of(100, 0, order ? BVHD_RAYS_INCOHERENT : BVHD_RAYS_UNKNOWN)), 3);
            assert_true(fake_vulkan.dispatches[0].pipeline == tracer->incoherent.pipeline);
            assert_int_equal(fake_vulkan.dispatches[0].group_size, 32);
        }
        assert_int_equal(record(binding, trace_of(100, BVHD_TRACE_RAY_FLAGS, BVHD_RAYS_COHERENT)), 1);
        assert_true(fake_vulkan.dispatches[0].pipeline == tracer->query);
        assert_int_equal(record(binding, trace_of(0, 0, BVHD_RAYS_COHERENT)), 0);
        bvhd_trace_binding_destroy(binding);
        bvhd_tracer_destroy(tracer);
        end();
    }
}

/* All rays are traced by the query alone. */
static void expect_query_only(void)
{
    struct bvhd_trace_binding *binding = NULL;
    const struct bvhd_tracer_options options = tracer_options();
    struct bvhd_tracer *tracer = create(&options);
    assert_int_equal(bvhd_tracer_scratch_size(tracer, RAYS), 0);
    const struct bvhd_trace_buffers buffers = trace_buffers();
    assert_int_equal(bvhd_tracer_bind(tracer, &buffers, &binding, NULL), BVHD_OK);
    for (int order = 0; order < 2; order++) {
        const struct bvhd_trace trace =
            trace_of(RAYS, BVHD_TRACE_ANY_HIT, order ? BVHD_RAYS_INCOHERENT : BVHD_RAYS_COHERENT);
        assert_int_equal(record(binding, trace), 1);
        assert_true(fake_vulkan.dispatches[0].pipeline == tracer->query);
    }
    bvhd_trace_binding_destroy(binding);
    bvhd_tracer_destroy(tracer);
}

static void without_ballots_there_is_the_query(void **state)
{
    (void)state;
    fake_vulkan_reset();
    fake_vulkan.subgroup_operations = VK_SUBGROUP_FEATURE_BASIC_BIT;
    begin(true, 0);
    expect_query_only();
    end();
}

/* One structure of spheres is enough, whatever the others hold. */
static void spheres_are_traced_by_the_query(void **state)
{
    (void)state;
    for (int has_addresses = 0; has_addresses < 2; has_addresses++)
        for (uint32_t instances = 0; instances <= 3; instances += 3) {
            fake_vulkan_reset();
            begin_with(has_addresses, instances, true);
            expect_query_only();
            end();
        }
}

/* Only the counters of the caller's scratch memory are cleared, at its offset. */
static void scratch_may_be_the_callers(void **state)
{
    (void)state;
    struct bvhd_trace_binding *binding = NULL;
    fake_vulkan_reset();
    begin(false, 3);
    const struct bvhd_tracer_options options = tracer_options();
    struct bvhd_tracer *tracer = create(&options);
    struct bvhd_trace_buffers buffers = trace_buffers();
    const uint64_t size = bvhd_tracer_scratch_size(tracer, RAYS);
    assert_int_equal(size, RAYS * 28 + 16);
    buffers.scratch = (struct bvhd_vulkan_span){world.scratch, 128, size};
    const uint64_t allocations = fake_vulkan.allocations;
    assert_int_equal(bvhd_tracer_bind(tracer, &buffers, &binding, NULL), BVHD_OK);
    assert_int_equal(fake_vulkan.allocations, allocations);
    memset(fake_vulkan_bytes(world.scratch), 0x55, RAYS);
    record(binding, trace_of(RAYS, 0, BVHD_RAYS_COHERENT));
    const unsigned char *bytes = fake_vulkan_bytes(world.scratch);
    for (int i = 0; i < 200; i++)
        assert_int_equal(bytes[i], i >= 128 && i < 128 + VULKAN_TRACE_HEAD ? 0 : 0x55);
    bvhd_trace_binding_destroy(binding);
    bvhd_tracer_destroy(tracer);
    end();
}

/* ---- what is refused ---- */

static void refuse_tracer(const struct bvhd_tracer_options *options, enum bvhd_status wanted, const char *where)
{
    struct bvhd_tracer *tracer = NULL;
    struct bvhd_error error = {0};
    assert_int_equal(bvhd_tracer_create(world.device, &world.queue, options, &tracer, &error), wanted);
    assert_int_equal(error.status, wanted);
    assert_string_equal(error.where, where);
    assert_null(tracer);
}

static void bad_options_are_refused(void **state)
{
    (void)state;
    fake_vulkan_reset();
    begin(false, 3);
    const struct bvhd_tracer_options good = tracer_options();
    struct bvhd_tracer_options bad = good;
    bad.struct_size = 8;
    refuse_tracer(&bad, BVHD_INVALID, "options.struct_size");
    bad = good;
    bad.root = world.bed.count;
    refuse_tracer(&bad, BVHD_NOT_FOUND, "options.root");
    bad = good;
    bad.scene = NULL;
    refuse_tracer(&bad, BVHD_INVALID, "options");
    bad.buffer = world.rays;
    bad.buffer_size = 1000;
    bad.blobs = world.bed.blobs;
    bad.blob_count = world.bed.count;
    bad.root_location = 1000;
    refuse_tracer(&bad, BVHD_INVALID, "options.root_location");
    bad.root_location = 0;
    bad.root = world.bed.count;
    refuse_tracer(&bad, BVHD_NOT_FOUND, "options.root");
    bad.root = 0;
    bad.buffer_size = UINT64_C(1) << 28;
    refuse_tracer(&bad, BVHD_TOO_LARGE, "options.buffer_size");
    bad.buffer_address = bad.root_location = 4096;
    refuse_tracer(&bad, BVHD_UNSUPPORTED, "options.buffer_address");
    end();
}

static void old_devices_are_refused(void **state)
{
    (void)state;
    fake_vulkan_reset();
    fake_vulkan.api_version = VK_API_VERSION_1_0;
    begin(false, 3);
    const struct bvhd_tracer_options options = tracer_options();
    refuse_tracer(&options, BVHD_UNSUPPORTED, "device");
    end();
}

static void refuse_buffers(const struct bvhd_tracer *tracer, const struct bvhd_trace_buffers *buffers,
                           enum bvhd_status wanted, const char *where)
{
    struct bvhd_trace_binding *binding = NULL;
    struct bvhd_error error = {0};
    assert_int_equal(bvhd_tracer_bind(tracer, buffers, &binding, &error), wanted);
    assert_string_equal(error.where, where);
    assert_null(binding);
}

static void bad_buffers_are_refused(void **state)
{
    (void)state;
    fake_vulkan_reset();
    begin(false, 3);
    const struct bvhd_tracer_options options = tracer_options();
    struct bvhd_tracer *tracer = create(&options);
    const struct bvhd_trace_buffers good = trace_buffers();
    struct bvhd_trace_buffers bad = good;
    bad.struct_size = 8;
    refuse_buffers(tracer, &bad, BVHD_INVALID, "buffers.struct_size");
    bad = good;
    bad.max_rays = 0;
    refuse_buffers(tracer, &bad, BVHD_INVALID, "buffers.max_rays");
    bad.max_rays = bvhd_tracer_max_rays(tracer) + 1;
    assert_true(bad.max_rays > 2000000);
    refuse_buffers(tracer, &bad, BVHD_TOO_LARGE, "buffers.max_rays");
    bad = good;
    bad.rays.buffer = VK_NULL_HANDLE;
    refuse_buffers(tracer, &bad, BVHD_INVALID, "buffers.rays");
    bad = good;
    bad.rays.offset = 64;
    refuse_buffers(tracer, &bad, BVHD_INVALID, "buffers.rays");
    bad = good;
    bad.hits.size = RAYS * 32 - 1;
    refuse_buffers(tracer, &bad, BVHD_INVALID, "buffers.hits");
    bad = good;
    bad.scratch = (struct bvhd_vulkan_span){world.scratch, 0, RAYS * 28};
    refuse_buffers(tracer, &bad, BVHD_INVALID, "buffers.scratch");
    bvhd_tracer_destroy(tracer);
    end();
}

static void bad_records_are_refused(void **state)
{
    (void)state;
    struct bvhd_trace_binding *binding = NULL;
    fake_vulkan_reset();
    begin(false, 3);
    const struct bvhd_tracer_options options = tracer_options();
    struct bvhd_tracer *tracer = create(&options);
    const struct bvhd_trace_buffers buffers = trace_buffers();
    assert_int_equal(bvhd_tracer_bind(tracer, &buffers, &binding, NULL), BVHD_OK);
    const struct {
        struct bvhd_trace trace;
        const char *where;
    } rows[] = {{{.struct_size = 8}, "trace.struct_size"},
                {trace_of(RAYS + 1, 0, BVHD_RAYS_COHERENT), "trace.ray_count"},
                {trace_of(1, 0x80, BVHD_RAYS_COHERENT), "trace.flags"},
                {trace_of(1, 0, (enum bvhd_ray_order)7), "trace.order"}};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct bvhd_error error = {0};
        VkCommandBuffer commands = fake_vulkan_commands();
        assert_int_equal(bvhd_tracer_record(binding, commands, &rows[i].trace, &error), BVHD_INVALID);
        assert_string_equal(error.where, rows[i].where);
        assert_int_equal(fake_vulkan_recorded(), 0);
        fake_vulkan_submit();
    }
    bvhd_trace_binding_destroy(binding);
    bvhd_trace_binding_destroy(NULL);
    bvhd_tracer_destroy(tracer);
    bvhd_tracer_destroy(NULL);
    end();
}

/* ---- failures ---- */

/* Each call, and each allocation, fails once; those of the test for halves only make it say no. */
static void every_failure_leaves_nothing(void **state)
{
    (void)state;
    for (int is_memory = 0; is_memory < 2; is_memory++)
        for (int64_t n = 0;; n++) {
            struct bvhd_tracer *tracer = NULL;
            struct bvhd_trace_binding *binding = NULL;
            fake_vulkan_reset();
            begin(true, 3);
            const uint64_t objects = fake_vulkan.live, live = library_memory.live;
            const struct bvhd_tracer_options options = tracer_options();
            const struct bvhd_trace_buffers buffers = trace_buffers();
            if (is_memory)
                library_memory.fail_after = n;
            else
                fake_vulkan.fail_after = n;
            enum bvhd_status status = bvhd_tracer_create(world.device, &world.queue, &options, &tracer, NULL);
            assert_int_equal(status == BVHD_OK, tracer != NULL);
            if (status == BVHD_OK)
                status = bvhd_tracer_bind(tracer, &buffers, &binding, NULL);
            const bool has_failed = (is_memory ? library_memory.fail_after : fake_vulkan.fail_after) < 0;
            library_memory.fail_after = fake_vulkan.fail_after = -1;
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
            bvhd_trace_binding_destroy(binding);
            bvhd_tracer_destroy(tracer);
            assert_int_equal(fake_vulkan.live, objects);
            assert_int_equal(library_memory.live, live);
            end();
            if (!has_failed) {
                assert_int_equal(status, BVHD_OK);
                assert_true(n >= (is_memory ? 2 : 20));
                break;
            }
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_are_a_few_dispatches), cmocka_unit_test(without_ballots_there_is_the_query),
        cmocka_unit_test(scratch_may_be_the_callers),   cmocka_unit_test(bad_options_are_refused),
        cmocka_unit_test(old_devices_are_refused),      cmocka_unit_test(bad_buffers_are_refused),
        cmocka_unit_test(bad_records_are_refused),      cmocka_unit_test(spheres_are_traced_by_the_query),
        cmocka_unit_test(every_failure_leaves_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
