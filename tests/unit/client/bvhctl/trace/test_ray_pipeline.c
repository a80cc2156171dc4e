/* SPDX-License-Identifier: Apache-2.0 */
/*
 * Support for tests that meet a driver: its own structures of a request, and rays through its ray-tracing pipeline.
 * Skipped where no device has both.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/driver/driver_structure.h"
#include "builder/input/prepare.h"
#include "tests/support/driver/ray_pipeline.h"

enum { SKIPPED = 77, INSTANCES = 3 };

static struct memory memory;
static struct gpu *gpu;

#define MUST(call) must((call), &error)

static void must(enum bvhd_status status, const struct bvhd_error *error)
{
    if (status != BVHD_OK)
        fail_msg("%s: %s", error->where, error->text);
}

/*
 * Two geometries of squares across z: at z = 0 and 1, opaque, and at z = 2, not opaque. Front faces, seen from below,
 * are clockwise in Vulkan's sense.
 */
static const float squares[][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {0, 0, 1}, {1, 0, 1},
                                   {0, 1, 1}, {1, 1, 1}, {0, 0, 2}, {1, 0, 2}, {0, 1, 2}, {1, 1, 2}};
static const uint32_t indices[] = {0, 1, 2, 1, 3, 2, 4, 5, 6, 5, 7, 6, 8, 9, 10, 9, 11, 10};
static const float boxes[2][6] = {{0, 0, 0, 1, 1, 1}, {0, 0, 3, 1, 1, 4}};

static struct geometry make_triangles(uint32_t first, uint32_t count, uint32_t flags)
{
    return (struct geometry){.type = GEOMETRY_TRIANGLES,
                             .flags = flags,
                             .triangles = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                                           .max_vertex = 11,
                                           .vertex_stride = 12,
                                           .index_type = INDEX_UINT32,
                                           .vertices = {(const unsigned char *)squares, sizeof squares},
                                           .indices = {(const unsigned char *)indices, sizeof indices}},
                             .range = {.primitive_count = count, .primitive_offset = first * 12}};
}

static void prepare_input(const struct build_input *input, struct canonical *ret_canonical)
{
    struct bvhd_error error;
    struct limits limits = limits_default();
    struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    MUST(prepare(input, 0, &limits, &context, ret_canonical, &error));
}

static void build(const struct build_input *input, const uint64_t *addresses, struct driver_structure *ret_structure)
{
    struct bvhd_error error;
    struct canonical canonical;
    prepare_input(input, &canonical);
    MUST(driver_structure_build(gpu, &canonical, addresses, &memory, ret_structure, &error));
    prepare_finish(&canonical, &memory);
}

static void build_squares(struct driver_structure *ret_structure)
{
    struct geometry geometries[2] = {make_triangles(0, 4, GEOMETRY_OPAQUE), make_triangles(4, 2, 0)};
    struct build_input input = {.type = STRUCTURE_BOTTOM,
                                .flags = BUILD_PREFER_FAST_TRACE | BUILD_ALLOW_COMPACTION,
                                .geometry_count = 2,
                                .geometries = geometries,
                                .options.target = TARGET_PORTABLE};
    build(&input, NULL, ret_structure);
}

static void build_boxes(struct driver_structure *ret_structure)
{
    struct geometry geometry = {.type = GEOMETRY_AABBS,
                                .aabbs = {24, {(const unsigned char *)boxes, sizeof boxes}},
                                .range = {.primitive_count = 2}};
    struct build_input input = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &geometry, .options.target = TARGET_PORTABLE};
    build(&input, NULL, ret_structure);
}

/* Instance i lies at x = 10 i; the last one is of the second reference, the one before the last is inactive. */
static void build_top(const uint64_t *addresses, uint32_t count, struct driver_structure *ret_structure)
{
    VkAccelerationStructureInstanceKHR records[INSTANCES] = {0};
    struct reference references[2];
    for (uint32_t i = 0; i < INSTANCES; i++)
        records[i] = (VkAccelerationStructureInstanceKHR){
            .transform = {.matrix = {{1, 0, 0, 10.0f * (float)i}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
            .instanceCustomIndex = 100 + i,
            .mask = 1u << i,
            .instanceShaderBindingTableRecordOffset = 5,
            .accelerationStructureReference = i == 1                             ? 0
                                              : i + 1 == INSTANCES && count == 2 ? 2
                                                                                 : 1};
    for (uint32_t i = 0; i < 2; i++)
        references[i] =
            (struct reference){.kind = REFERENCE_BLAS, .handle = i + 1, .bounds = {{0, 0, 0}, {1, 1, 2 + (float)i}}};
    struct geometry geometry = {.type = GEOMETRY_INSTANCES,
                                .instances = {{(const unsigned char *)records, sizeof records}},
                                .range = {.primitive_count = INSTANCES}};
    struct build_input input = {.type = STRUCTURE_TOP,
                                .geometry_count = 1,
                                .geometries = &geometry,
                                .reference_count = count,
                                .references = references,
                                .options.target = TARGET_PORTABLE};
    build(&input, addresses, ret_structure);
}

static struct ray up_at(float x, float y, float z)
{
    return (struct ray){.origin = {x, y, z}, .direction = {0, 0, 1}, .tmax = 100, .cull_mask = 0xff};
}

static struct tracer_hit trace_one(struct tracer *tracer, struct ray ray)
{
    struct bvhd_error error;
    struct tracer_hit hit;
    double seconds = -1;
    MUST(tracer->trace(tracer, &ray, 1, &hit, &seconds, &error));
    assert_true(seconds >= 0);
    return hit;
}

static void assert_hit(struct tracer_hit hit, float t, uint32_t instance, uint32_t geometry, uint32_t primitive,
                       uint32_t flags)
{
    assert_float_equal(hit.t, t, 1e-6);
    assert_int_equal(hit.instance, instance);
    assert_int_equal(hit.custom_index, 100 + instance);
    assert_int_equal(hit.geometry, geometry);
    assert_int_equal(hit.primitive, primitive);
    assert_int_equal(hit.flags, flags);
}

static void assert_miss(struct tracer_hit hit)
{
    assert_true(isinf(hit.t));
    assert_int_equal(hit.instance, RAY_NO_INSTANCE);
}

/*
 * Checks the hits of the rays of the tests below in the squares; they are the same for every builder of the structure.
 */
static void check_squares(VkAccelerationStructureKHR top)
{
    struct bvhd_error error;
    struct tracer *tracer;
    MUST(ray_pipeline_create(gpu, top, &memory, &tracer, &error));
    struct tracer_hit hit = trace_one(tracer, up_at(0.25f, 0.5f, -1));
    uint32_t facing = hit.flags;
    assert_hit(hit, 1, 0, 0, 0, facing);
    assert_float_equal(hit.u, 0.25, 1e-6);
    assert_float_equal(hit.v, 0.5, 1e-6);
    assert_hit(trace_one(tracer, up_at(0.75f, 0.75f, 0.5f)), 0.5f, 0, 0, 3, facing);
    assert_hit(trace_one(tracer, up_at(20.25f, 0.25f, 1.5f)), 0.5f, 2, 1, 0, facing);
    assert_miss(trace_one(tracer, up_at(10.25f, 0.25f, -1)));
    assert_miss(trace_one(tracer, up_at(0.25f, 0.25f, 3)));
    struct ray ray = up_at(0.25f, 0.5f, -1);
    ray.cull_mask = 4;
    assert_miss(trace_one(tracer, ray));
    ray = up_at(0.25f, 0.5f, -1);
    ray.flags = RAY_CULL_OPAQUE;
    assert_hit(trace_one(tracer, ray), 3, 0, 1, 0, facing);
    ray.flags = facing ? RAY_CULL_FRONT_FACING : RAY_CULL_BACK_FACING;
    assert_miss(trace_one(tracer, ray));
    ray.flags = 0;
    ray.direction[2] = -1;
    ray.origin[2] = 3;
    assert_hit(trace_one(tracer, ray), 1, 0, 1, 0, !facing);
    ray.direction[2] = NAN;
    assert_miss(trace_one(tracer, ray));
    tracer->destroy(tracer);
}

static void test_squares(void **state)
{
    (void)state;
    struct driver_structure bottom, top;
    build_squares(&bottom);
    build_top(&bottom.address, 1, &top);
    check_squares(top.handle);
    driver_structure_destroy(gpu, &top);
    driver_structure_destroy(gpu, &bottom);
    driver_structure_destroy(gpu, &bottom);
}

static void test_copies(void **state)
{
    (void)state;
    struct bvhd_error error;
    struct driver_structure bottom, copies[3], top;
    unsigned char *data, *again;
    uint64_t size, size_again;
    build_squares(&bottom);
    MUST(driver_structure_copy(gpu, &bottom, VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR, &copies[0], &error));
    MUST(driver_structure_copy(gpu, &bottom, VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR, &copies[1], &error));
    assert_true(copies[1].size <= bottom.size);
    MUST(driver_structure_serialize(gpu, &bottom, &memory, &data, &size, &error));
    MUST(driver_structure_load(gpu, data, size, &copies[2], &error));
    MUST(driver_structure_serialize(gpu, &copies[2], &memory, &again, &size_again, &error));
    assert_int_equal(size, size_again);
    assert_memory_equal(data, again, size);
    for (int i = 0; i < 3; i++) {
        build_top(&copies[i].address, 1, &top);
        check_squares(top.handle);
        driver_structure_destroy(gpu, &top);
        driver_structure_destroy(gpu, &copies[i]);
    }
    assert_int_not_equal(driver_structure_load(gpu, data, size - 1, &top, &error), BVHD_OK);
    memory_free(&memory, again);
    memory_free(&memory, data);
    driver_structure_destroy(gpu, &bottom);
}

static void test_top_of(void **state)
{
    (void)state;
    struct bvhd_error error;
    struct driver_structure bottom, top;
    struct tracer *tracer;
    build_squares(&bottom);
    MUST(driver_structure_top_of(gpu, bottom.address, &top, &error));
    MUST(ray_pipeline_create(gpu, top.handle, &memory, &tracer, &error));
    struct tracer_hit hit = trace_one(tracer, up_at(0.75f, 0.75f, 0.5f));
    assert_float_equal(hit.t, 0.5, 1e-6);
    assert_int_equal(hit.primitive, 3);
    assert_int_equal(hit.instance, 0);
    tracer->destroy(tracer);
    driver_structure_destroy(gpu, &top);
    driver_structure_destroy(gpu, &bottom);
}

/* Squares and boxes under one top level: boxes where the ray enters them, the nearest of both kinds wins. */
static void test_boxes(void **state)
{
    (void)state;
    struct bvhd_error error;
    struct driver_structure bottoms[2], top;
    struct tracer *tracer;
    const uint32_t first[INSTANCES * 2] = {0};
    struct scene_boxes all = {&boxes[0][0], 2, INSTANCES, 2, first};
    build_squares(&bottoms[0]);
    build_boxes(&bottoms[1]);
    build_top((uint64_t[]){bottoms[0].address, bottoms[1].address}, 2, &top);
    MUST(ray_pipeline_create(gpu, top.handle, &memory, &tracer, &error));
    MUST(ray_pipeline_set_boxes(tracer, &all, &error));
    assert_hit(trace_one(tracer, up_at(20.25f, 0.25f, -1)), 1, 2, 0, 0, 2);
    assert_hit(trace_one(tracer, up_at(20.25f, 0.25f, 0.5f)), 0, 2, 0, 0, 2);
    assert_hit(trace_one(tracer, up_at(20.25f, 0.25f, 2)), 1, 2, 0, 1, 2);
    assert_miss(trace_one(tracer, up_at(20.25f, 0.25f, 5)));
    assert_int_equal(trace_one(tracer, up_at(0.25f, 0.25f, -1)).primitive, 0);
    struct ray along = {.origin = {-5, 0.3f, 0.5f}, .direction = {1, 0, 0}, .tmax = 100, .cull_mask = 0xff};
    assert_hit(trace_one(tracer, along), 25, 2, 0, 0, 2);
    along.flags = RAY_SKIP_AABBS;
    assert_miss(trace_one(tracer, along));
    tracer->destroy(tracer);
    driver_structure_destroy(gpu, &top);
    driver_structure_destroy(gpu, &bottoms[0]);
    driver_structure_destroy(gpu, &bottoms[1]);
}

static int open_device(void)
{
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    if (gpu_open("auto", &memory, &gpu, &error) != BVHD_OK) {
        printf("skipped: %s: %s\n", error.where, error.text);
        return SKIPPED;
    }
    if (gpu->properties.has_ray_pipeline)
        return 0;
    printf("skipped: %s has no ray-tracing pipelines\n", gpu->properties.name);
    gpu_close(gpu);
    return SKIPPED;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_squares),
        cmocka_unit_test(test_copies),
        cmocka_unit_test(test_top_of),
        cmocka_unit_test(test_boxes),
    };
    if (open_device())
        return SKIPPED;
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    failed += (int)gpu_messages();
    gpu_close(gpu);
    return failed || atomic_load(&memory.live) != 0;
}
