/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_cpu_round.c - tests what hits of spheres and linear swept spheres say of themselves, with flags, candidates and
 * refusals, of rays whose answers are known.
 */
#include "tests/support/unit.h"

#include <math.h>

#include <bvhd/bvhd_cpu.h>

#include "tests/support/client/structure_bed.h"

enum { COPIES = 64 };

static const float ends[][4] = {{0, 0, 0, 1}, {4, 0, 0, 0.5f}};
static const uint16_t indices[] = {1, 0};

/* A scene of one bottom level, on the vertices above. */
struct bed {
    VkAccelerationStructureGeometrySpheresDataNV spheres;
    VkAccelerationStructureGeometryLinearSweptSpheresDataNV swept;
    struct structure_build build;
    struct bvhd_cpu_scene *scene;
};

static void bed_describe(struct bed *bed, VkGeometryTypeKHR type)
{
    bed->spheres = (VkAccelerationStructureGeometrySpheresDataNV){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_SPHERES_DATA_NV,
        .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
        .vertexData.hostAddress = ends,
        .vertexStride = sizeof ends[0],
        .radiusFormat = VK_FORMAT_R32_SFLOAT,
        .radiusData.hostAddress = &ends[0][3],
        .radiusStride = sizeof ends[0],
        .indexType = VK_INDEX_TYPE_UINT16,
        .indexData.hostAddress = indices,
        .indexStride = sizeof indices[0]};
    memcpy(&bed->swept, &bed->spheres, sizeof bed->spheres);
    bed->swept.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_LINEAR_SWEPT_SPHERES_DATA_NV;
    bed->swept.indexType = VK_INDEX_TYPE_NONE_KHR;
    bed->swept.indexData.hostAddress = NULL;
    const bool is_swept = type == VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV;
    bed->build.geometry =
        (VkAccelerationStructureGeometryKHR){.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
                                             .pNext = is_swept ? (const void *)&bed->swept : &bed->spheres,
                                             .geometryType = type};
    bed->build.range.primitiveCount = is_swept ? 1 : 2;
}

static void bed_start(struct bed *bed, VkGeometryTypeKHR type, VkRayTracingLssPrimitiveEndCapsModeNV caps,
                      uint32_t flags, VkGeometryFlagsKHR geometry_flags)
{
    const struct build_options options = {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE};
    *bed = (struct bed){0};
    bed_describe(bed, type);
    bed->swept.endCapsMode = caps;
    bed->build.geometry.flags = geometry_flags;
    bed->build.info = (VkAccelerationStructureBuildGeometryInfoKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
        .type = VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
        .flags = flags,
        .geometryCount = 1,
        .pGeometries = &bed->build.geometry};
    bed->build.result = structure_bed_result(&bed->build, &options);
    const struct bvhd_cpu_blob blob = {bed->build.result.data, bed->build.result.size};
    const struct bvhd_cpu_scene_options scene = {.struct_size = sizeof scene, .blobs = &blob, .blob_count = 1};
    assert_int_equal(bvhd_cpu_scene_create(&scene, &bed->scene, NULL), BVHD_OK);
}

static void bed_stop(struct bed *bed)
{
    bvhd_cpu_scene_destroy(bed->scene);
    bvhd_blob_unref(bed->build.result.blob);
    assert_int_equal(library_memory.live, 0);
}

static struct bvhd_cpu_ray ray_from(float x, float y, float z, float dx, float dy, float dz)
{
    return (struct bvhd_cpu_ray){
        .origin = {x, y, z}, .direction = {dx, dy, dz}, .tmax = INFINITY, .flags = 0, .mask = 0xff};
}

/* Traces a ray alone, and together with others, which gives the same. */
static struct bvhd_cpu_hit trace(const struct bed *bed, struct bvhd_cpu_ray ray, bvhd_cpu_candidate_function candidate,
                                 void *context)
{
    struct bvhd_cpu_ray rays[COPIES];
    struct bvhd_cpu_hit hits[COPIES], one;
    struct bvhd_cpu_trace call = {.struct_size = sizeof call,
                                  .rays = &ray,
                                  .ray_size = sizeof ray,
                                  .hits = &one,
                                  .hit_size = sizeof one,
                                  .ray_count = 1,
                                  .candidate = candidate,
                                  .context = context};
    assert_int_equal(bvhd_cpu_scene_trace(bed->scene, &call, NULL), BVHD_OK);
    if (candidate)
        return one;
    for (int i = 0; i < COPIES; i++)
        rays[i] = ray;
    call.rays = rays;
    call.hits = hits;
    call.ray_count = COPIES;
    assert_int_equal(bvhd_cpu_scene_trace(bed->scene, &call, NULL), BVHD_OK);
    for (int i = 0; i < COPIES; i++)
        assert_memory_equal(&hits[i], &one, sizeof one);
    return one;
}

static void assert_hit(const struct bed *bed, struct bvhd_cpu_ray ray, double t, double u, uint32_t primitive,
                       uint32_t kind)
{
    const struct bvhd_cpu_hit hit = trace(bed, ray, NULL, NULL);
    assert_int_equal(hit.blob, 0);
    assert_true(fabs(hit.t - t) < 1e-6 && fabs(hit.u - u) < 1e-6 && hit.v == 0);
    assert_int_equal(hit.primitive, primitive);
    assert_int_equal(hit.geometry, 0);
    assert_int_equal(hit.instance, BVHD_CPU_NO_INSTANCE);
    assert_int_equal(hit.flags, BVHD_CPU_HIT_FRONT_FACE | kind);
}

static void assert_miss(const struct bed *bed, struct bvhd_cpu_ray ray)
{
    assert_int_equal(trace(bed, ray, NULL, NULL).blob, BVHD_CPU_NO_BLOB);
}

static struct bvhd_cpu_ray with_flags(struct bvhd_cpu_ray ray, uint32_t flags)
{
    ray.flags = flags;
    return ray;
}

static void check_flags(const struct bed *bed, struct bvhd_cpu_ray ray)
{
    static const uint32_t hitting[] = {
        BVHD_CPU_RAY_CULL_BACK_FACING, BVHD_CPU_RAY_CULL_FRONT_FACING,      BVHD_CPU_RAY_SKIP_AABBS,
        BVHD_CPU_RAY_CULL_NO_OPAQUE,   BVHD_CPU_RAY_TERMINATE_ON_FIRST_HIT, BVHD_CPU_RAY_NO_OPAQUE};
    static const uint32_t missing[] = {BVHD_CPU_RAY_SKIP_TRIANGLES, BVHD_CPU_RAY_CULL_OPAQUE};
    const struct bvhd_cpu_hit hit = trace(bed, ray, NULL, NULL);
    assert_int_equal(hit.blob, 0);
    for (size_t i = 0; i < sizeof hitting / sizeof hitting[0]; i++) {
        const struct bvhd_cpu_hit same = trace(bed, with_flags(ray, hitting[i]), NULL, NULL);
        assert_memory_equal(&same, &hit, sizeof hit);
    }
    for (size_t i = 0; i < sizeof missing / sizeof missing[0]; i++)
        assert_miss(bed, with_flags(ray, missing[i]));
}

static void spheres_are_hit_from_outside(void **state)
{
    (void)state;
    struct bed bed;
    bed_start(&bed, VK_GEOMETRY_TYPE_SPHERES_NV, VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_NONE_NV, 0,
              VK_GEOMETRY_OPAQUE_BIT_KHR);
    assert_hit(&bed, ray_from(0, 0, 5, 0, 0, -2), 2, 0, 1, BVHD_CPU_HIT_SPHERE);
    assert_hit(&bed, ray_from(9, 0, 0, -1, 0, 0), 4.5, 0, 0, BVHD_CPU_HIT_SPHERE);
    assert_hit(&bed, ray_from(4, 0, 0, -1, 0, 0), 3, 0, 1, BVHD_CPU_HIT_SPHERE); /* from inside of the other */
    assert_hit(&bed, ray_from(1, 0, 5, 0, 0, -1), 5, 0, 1, BVHD_CPU_HIT_SPHERE); /* a tangent */
    assert_miss(&bed, ray_from(0, 0.5f, 0, 0, 0, 1));
    assert_miss(&bed, ray_from(2, 0, 5, 0, 0, -1));
    check_flags(&bed, ray_from(0, 0.25f, 5, 0, 0, -1));
    bed_stop(&bed);
}

/* The side is a cone whose radius decreases by 1/8 of the way along the axis. */
static void swept_spheres_tell_the_way(void **state)
{
    (void)state;
    struct bed bed;
    bed_start(&bed, VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV, VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_CHAINED_NV, 0,
              VK_GEOMETRY_OPAQUE_BIT_KHR);
    const double s = 0.125, side = (1 - 2 * s) / sqrt(1 - s * s);
    assert_hit(&bed, ray_from(2, 0, 5, 0, 0, -1), 5 - side, (2 - s) / (1 - s * s) / 4, 0, BVHD_CPU_HIT_SWEPT_SPHERE);
    assert_hit(&bed, ray_from(-5, 0, 0, 1, 0, 0), 4, 0, 0, BVHD_CPU_HIT_SWEPT_SPHERE);
    assert_hit(&bed, ray_from(9, 0, 0, -1, 0, 0), 4.5, 1, 0, BVHD_CPU_HIT_SWEPT_SPHERE);
    assert_miss(&bed, ray_from(2, 0, 0, 1, 0, 0));
    check_flags(&bed, ray_from(2, 0.25f, 5, 0, 0, -1));
    bed_stop(&bed);
    bed_start(&bed, VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV, VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_NONE_NV, 0,
              VK_GEOMETRY_OPAQUE_BIT_KHR);
    assert_hit(&bed, ray_from(2, 0, 5, 0, 0, -1), 5 - side, (2 - s) / (1 - s * s) / 4, 0, BVHD_CPU_HIT_SWEPT_SPHERE);
    assert_miss(&bed, ray_from(-5, 0, 0, 1, 0, 0));
    assert_miss(&bed, ray_from(9, 0, 0, -1, 0, 0));
    bed_stop(&bed);
}

/* What a callback was told last, and what it answers. */
struct decision {
    struct bvhd_cpu_hit told;
    uint32_t calls, answer;
};

static uint32_t decide(void *context, struct bvhd_cpu_candidate *candidate)
{
    struct decision *decision = context;
    decision->told = *candidate->hit;
    decision->calls++;
    assert_int_equal(candidate->is_opaque, 0);
    assert_true(candidate->object_origin[2] == 5 && candidate->tmax == INFINITY);
    return decision->answer;
}

/* Spheres that are not opaque are candidates, as triangles are; opaque ones are hits. */
static void candidates_are_told_about_themselves(void **state)
{
    (void)state;
    for (int i = 0; i < 4; i++) {
        struct bed bed;
        struct decision decision = {.answer = i < 2 ? BVHD_CPU_CONFIRM : BVHD_CPU_IGNORE};
        const bool is_swept = i % 2;
        bed_start(&bed, is_swept ? VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV : VK_GEOMETRY_TYPE_SPHERES_NV,
                  VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_CHAINED_NV, 0, 0);
        const struct bvhd_cpu_ray ray = ray_from(0.5f, 0, 5, 0, 0, -1);
        const struct bvhd_cpu_hit plain = trace(&bed, ray, NULL, NULL), hit = trace(&bed, ray, decide, &decision);
        assert_int_equal(decision.calls, 1);
        assert_memory_equal(&decision.told, &plain, sizeof plain);
        assert_int_equal(hit.blob, i < 2 ? 0 : BVHD_CPU_NO_BLOB);
        trace(&bed, with_flags(ray, BVHD_CPU_RAY_OPAQUE), decide, &decision);
        assert_int_equal(decision.calls, 1);
        bed_stop(&bed);
    }
}

/* The point of a hit less the centre between the ends is the normal, here of a cone with a known slope. */
static void ends_lead_to_normals(void **state)
{
    (void)state;
    struct bed bed;
    float own[2][4];
    bed_start(&bed, VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV, VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_NONE_NV, 0, 0);
    struct bvhd_cpu_hit hit = trace(&bed, ray_from(2, 0, 5, 0, 0, -1), NULL, NULL);
    assert_int_equal(bvhd_cpu_scene_ends(bed.scene, &hit, own, NULL), BVHD_OK);
    assert_memory_equal(own, ends, sizeof own);
    const double x = 2 - (own[0][0] + hit.u * (own[1][0] - own[0][0])), z = 5 - hit.t;
    assert_true(fabs(x / hypot(x, z) - 0.125) < 1e-6);
    struct bvhd_error error;
    hit.record = 1;
    assert_int_equal(bvhd_cpu_scene_ends(bed.scene, &hit, own, &error), BVHD_INVALID);
    assert_string_equal(error.where, "hit.record");
    bed_stop(&bed);
    bed_start(&bed, VK_GEOMETRY_TYPE_SPHERES_NV, VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_NONE_NV, 0, 0);
    hit = trace(&bed, ray_from(4, 0, 5, 0, 0, -1), NULL, NULL);
    assert_int_equal(bvhd_cpu_scene_ends(bed.scene, &hit, own, NULL), BVHD_OK);
    for (int end = 0; end < 2; end++)
        assert_memory_equal(own[end], ends[1], sizeof own[end]);
    bed_stop(&bed);
}

static uint32_t confirm(void *context, struct bvhd_cpu_candidate *candidate)
{
    (void)context, (void)candidate;
    return BVHD_CPU_CONFIRM;
}

/* Tests are counted as those of triangles, alone, together, and where the program decides about hits. */
static void tests_are_counted(void **state)
{
    (void)state;
    for (int kind = 0; kind < 2; kind++) {
        struct bed bed;
        bed_start(&bed, kind ? VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV : VK_GEOMETRY_TYPE_SPHERES_NV,
                  VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_CHAINED_NV, 0, 0);
        struct bvhd_cpu_ray rays[COPIES];
        struct bvhd_cpu_hit hits[COPIES];
        for (int i = 0; i < COPIES; i++)
            rays[i] = ray_from(4, 0, 5, 0, 0, -1); /* which meets one box */
        for (int way = 0; way < 3; way++) {
            struct bvhd_cpu_counters counters = {.struct_size = sizeof counters, .triangles = 1000};
            const struct bvhd_cpu_trace call = {.struct_size = sizeof call,
                                                .rays = rays,
                                                .ray_size = sizeof rays[0],
                                                .hits = hits,
                                                .hit_size = sizeof hits[0],
                                                .ray_count = way == 1 ? COPIES : 1,
                                                .candidate = way == 2 ? confirm : NULL,
                                                .counters = &counters};
            assert_int_equal(bvhd_cpu_scene_trace(bed.scene, &call, NULL), BVHD_OK);
            assert_int_equal(counters.triangles, 1000 + call.ray_count);
        }
        bed_stop(&bed);
    }
}

static void refuse(enum bvhd_status status, const struct bvhd_error *error, const char *where)
{
    assert_int_equal(status, BVHD_INVALID);
    assert_string_equal(error->where, where);
}

/* Their bounds are exact here. */
static void there_are_no_corners(void **state)
{
    (void)state;
    static const float bounds[] = {-1, -1, -1, 4.5f, 1, 1};
    for (int i = 0; i < 4; i++) {
        struct bed bed;
        struct bvhd_error error;
        float corners[3][3], own[6];
        bed_start(&bed, i % 2 ? VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV : VK_GEOMETRY_TYPE_SPHERES_NV,
                  VK_RAY_TRACING_LSS_PRIMITIVE_END_CAPS_MODE_CHAINED_NV, i < 2 ? BUILD_ALLOW_DATA_ACCESS : 0, 0);
        const struct bvhd_cpu_hit hit = trace(&bed, ray_from(0, 0, 5, 0, 0, -1), NULL, NULL);
        refuse(bvhd_cpu_scene_corners(bed.scene, &hit, corners, &error), &error, "hit.record");
        refuse(bvhd_cpu_scene_positions(bed.scene, 0, 0, 0, corners, &error), &error, i < 2 ? "geometry" : "blob");
        bvhd_cpu_scene_bounds(bed.scene, own);
        assert_memory_equal(own, bounds, sizeof own);
        bed_stop(&bed);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spheres_are_hit_from_outside),
        cmocka_unit_test(swept_spheres_tell_the_way),
        cmocka_unit_test(candidates_are_told_about_themselves),
        cmocka_unit_test(ends_lead_to_normals),
        cmocka_unit_test(tests_are_counted),
        cmocka_unit_test(there_are_no_corners),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
