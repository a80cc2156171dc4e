/* SPDX-License-Identifier: Apache-2.0 */
/* test_validate.c - tests each rule on the fields of an entry by a wrong request, its VUID and its place. */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/builder/inputs.h"
#include "builder/format/lavapipe.h"
#include "builder/input/validate.h"

typedef void (*change)(struct test_input *test);

struct wrong {
    const char *name;
    change base, change;
    enum bvhd_status status;
    const char *vuid, *where;
};

static void accept(const struct test_input *test, const char *name)
{
    struct limits limits = limits_default();
    struct bvhd_error error = {0};
    if (validate_input(&test->input, 0, &limits, &error) != BVHD_OK)
        fail_msg("%s: %s at %s: %s", name, bvhd_vuid_string(error.vuid), error.where, error.text);
}

/* Checks that the request is refused as expected; it is entry number 3 of its batch. */
static void refuse(const struct wrong *wrong, const struct limits *limits)
{
    struct test_input test;
    struct bvhd_error error = {0};
    wrong->base(&test);
    accept(&test, wrong->name);
    wrong->change(&test);
    enum bvhd_status status = validate_input(&test.input, 3, limits, &error);
    if (status != wrong->status || error.status != status || strcmp(bvhd_vuid_string(error.vuid), wrong->vuid) != 0 ||
        strcmp(error.where, wrong->where) != 0 || error.text[0] == 0)
        fail_msg("%s: %s %s at %s: %s", wrong->name, bvhd_status_name(status), bvhd_vuid_string(error.vuid),
                 error.where, error.text);
    assert_int_equal(validate_input(&test.input, 3, limits, NULL), status);
}

#define CHANGE(name, statement)                                                                                        \
    static void name(struct test_input *test)                                                                          \
    {                                                                                                                  \
        statement;                                                                                                     \
    }
#define TRIANGLES(index) test->geometries[index].triangles
#define SPHERES(index) test->geometries[index].spheres
#define SWEPT(index) test->geometries[index].swept_spheres
#define RANGE(index) test->geometries[index].range

static void make_native(struct test_input *test, uint32_t variant)
{
    test->input.options.target = TARGET_LAVAPIPE;
    test->input.options.device.variant = variant;
}

CHANGE(generic, test->input.type = STRUCTURE_GENERIC)
CHANGE(generic_motion, test->input.type = STRUCTURE_GENERIC; test->input.flags = 0x20)
CHANGE(unknown_type, test->input.type = 3)
CHANGE(micromap_type, test->input.type = 1000623000)
CHANGE(unknown_flags, test->input.flags = 0x2000)
CHANGE(high_flags, test->input.flags = 0x80000000)
CHANGE(both_preferences, test->input.flags = BUILD_PREFER_FAST_TRACE | BUILD_PREFER_FAST_BUILD)
CHANGE(motion_flag, test->input.flags = BUILD_MOTION | BUILD_ALLOW_UPDATE)
CHANGE(motion_triangles_without_flag, test->geometries[1].type = GEOMETRY_MOVING_TRIANGLES)
CHANGE(motion_instances_without_flag, test->geometries[0].type = GEOMETRY_MOVING_INSTANCES)
CHANGE(boxes_after_motion_triangles, test->input.flags = BUILD_MOTION;
       test->geometries[0].type = GEOMETRY_MOVING_TRIANGLES; test->geometries[1].type = GEOMETRY_AABBS)
CHANGE(lossy_flag, test->input.flags = 0x400)
CHANGE(cluster_flag, test->input.flags = 0x1000)
CHANGE(unknown_mode, test->input.mode = 2)
CHANGE(update_without_source, test->input.mode = MODE_UPDATE)
CHANGE(update, test->input.mode = MODE_UPDATE; test->input.source = 5)
CHANGE(unknown_quality, test->input.options.quality = (enum build_quality)5)
CHANGE(negative_rays, test->input.options.rays_per_primitive = -1)
CHANGE(infinite_rays, test->input.options.quality = QUALITY_AUTO; test->input.options.rays_per_primitive = INFINITY)
CHANGE(nan_rays, test->input.options.quality = QUALITY_AUTO; test->input.options.rays_per_primitive = NAN)
CHANGE(unknown_target, test->input.options.target = (enum target)77)
CHANGE(unknown_layout_flag, test->input.options.layout_flags = 2)
CHANGE(foreign_layout_flag, make_native(test, 1); test->input.options.layout_flags = PORTABLE_FAST_TRIANGLES)
CHANGE(portable_driver, test->input.options.device.driver_uuid[15] = 1)
CHANGE(portable_compatibility, test->input.options.device.compatibility_uuid[0] = 1)
CHANGE(portable_variant, test->input.options.device.variant = 1)
CHANGE(native_without_device, make_native(test, 0))
CHANGE(native_without_variant, make_native(test, 0); test->input.options.device.driver_uuid[0] = 1)
CHANGE(unknown_variant, make_native(test, LAVAPIPE_VARIANTS + 1))
CHANGE(far_variant, make_native(test, UINT32_MAX))
CHANGE(two_in_top, test->input.geometry_count = 2)
CHANGE(none_in_top, test->input.geometry_count = 0)
CHANGE(no_geometries, test->input.geometries = NULL)
CHANGE(unknown_geometry, test->geometries[1].type = 3)
CHANGE(dense_triangles, test->geometries[1].type = 1000478000)
CHANGE(triangles_in_top, test->input.type = STRUCTURE_TOP; test->input.geometry_count = 1)
CHANGE(instances_in_bottom, test->input.type = STRUCTURE_BOTTOM)
CHANGE(instances_second, test->geometries[1].type = GEOMETRY_INSTANCES)
CHANGE(mixed_with_spheres, test->geometries[1].type = GEOMETRY_SPHERES)
CHANGE(spheres_in_top, test->geometries[0].type = GEOMETRY_SPHERES)
CHANGE(mixed, test->geometries[1].type = GEOMETRY_AABBS)
CHANGE(unknown_geometry_flags, test->geometries[1].flags = 4)

CHANGE(unknown_format, TRIANGLES(1).vertex_format = 107)
CHANGE(undefined_format, TRIANGLES(0).vertex_format = 0)
CHANGE(no_format, TRIANGLES(1).vertex_format = 185)
CHANGE(no_format_below_extensions, TRIANGLES(0).vertex_format = 999999999)
CHANGE(last_of_core, TRIANGLES(0).vertex_format = 184)
CHANGE(extension_format, TRIANGLES(1).vertex_format = 1000000000)
CHANGE(stride_alignment, TRIANGLES(0).vertex_stride = 18)
CHANGE(packed_stride, TRIANGLES(1).vertex_format = 64; TRIANGLES(1).vertex_stride = 22)
CHANGE(large_stride, TRIANGLES(0).vertex_stride = UINT64_C(1) << 32)
CHANGE(uint8_indices, TRIANGLES(0).index_type = 1000265000)
CHANGE(unknown_indices, TRIANGLES(1).index_type = 2)
CHANGE(odd_index_offset, RANGE(0).primitive_offset = 3)
CHANGE(index_offset_32, TRIANGLES(0).index_type = INDEX_UINT32; RANGE(0).primitive_offset = 6)
CHANGE(vertex_offset, RANGE(1).primitive_offset = 2)
CHANGE(packed_offset, TRIANGLES(1).vertex_format = 64; RANGE(1).primitive_offset = 2)
CHANGE(transform_offset, RANGE(0).transform_offset = 8)
CHANGE(past_max_vertex, TRIANGLES(1).max_vertex = 7)
CHANGE(first_vertex_past, RANGE(1).first_vertex = 1)
CHANGE(far_past_max_vertex, RANGE(1).first_vertex = UINT32_MAX; TRIANGLES(1).max_vertex = UINT32_MAX)

CHANGE(null_vertices, TRIANGLES(0).vertices.data = NULL)
CHANGE(short_vertices, TRIANGLES(1).vertices.size = 8 * 20 + 11)
CHANGE(offset_vertices, RANGE(1).primitive_offset = 12)
CHANGE(null_indices, TRIANGLES(0).indices.data = NULL)
CHANGE(short_indices, TRIANGLES(0).indices.size = 15)
CHANGE(short_indices_32, TRIANGLES(0).index_type = INDEX_UINT32)
CHANGE(short_transform, TRIANGLES(0).transform.size = 63)
CHANGE(far_transform, RANGE(0).transform_offset = UINT32_MAX - 15)

CHANGE(box_stride, test->geometries[0].aabbs.stride = 28)
CHANGE(large_box_stride, test->geometries[0].aabbs.stride = UINT64_C(8) << 32)
CHANGE(box_offset, RANGE(0).primitive_offset = 4)
CHANGE(null_boxes, test->geometries[0].aabbs.boxes.data = NULL)
CHANGE(short_boxes, test->geometries[0].aabbs.boxes.size--)

CHANGE(record_offset, RANGE(0).primitive_offset = 8)
CHANGE(null_records, test->geometries[0].instances.records.data = NULL)
CHANGE(short_records, test->geometries[0].instances.records.size--)

CHANGE(null_centres, SPHERES(0).vertices.data = NULL)
CHANGE(short_centres, SPHERES(1).vertices.size = 2 * 20 + 11)
CHANGE(offset_centres, RANGE(1).primitive_offset = 8 * 20 - 12)
CHANGE(null_radii, SPHERES(0).radii.data = NULL)
CHANGE(short_radii, SPHERES(1).radii.size = 2 * 20 + 3)
CHANGE(far_radii, SPHERES(1).radius_stride = UINT32_MAX)
CHANGE(null_sphere_indices, SPHERES(0).indices.data = NULL)
CHANGE(short_sphere_indices, SPHERES(0).indices.size = 15)
CHANGE(far_sphere_indices, SPHERES(0).index_stride = UINT64_MAX)
CHANGE(given_sphere_indices, SPHERES(1).indices = SPHERES(0).indices)

CHANGE(null_ends, SWEPT(0).ends.vertices.data = NULL)
CHANGE(short_ends, SWEPT(1).ends.vertices.size = 5 * 20 + 11)
CHANGE(null_end_radii, SWEPT(0).ends.radii.data = NULL)
CHANGE(short_end_radii, SWEPT(1).ends.radii.size = 5 * 20 + 3)
CHANGE(null_end_indices, SWEPT(0).indexing_mode = SWEPT_LIST; SWEPT(0).ends.indices.data = NULL)
CHANGE(short_end_indices, SWEPT(0).ends.indices.size = 15)
CHANGE(indices_for_a_list, SWEPT(0).indexing_mode = SWEPT_LIST)
CHANGE(successive_without_indices, SWEPT(0).ends.indices.data = NULL)
CHANGE(given_end_indices, SWEPT(1).ends.indices = SWEPT(0).ends.indices)

CHANGE(many_triangles, RANGE(0).primitive_count = (1u << 29) - 3)
CHANGE(many_boxes, RANGE(0).primitive_count = 1u << 29)
CHANGE(many_spheres, RANGE(1).primitive_count = (1u << 29) - 6)
CHANGE(many_instances, RANGE(0).primitive_count = 1u << 24)
CHANGE(many_geometries, test->input.geometry_count = 1u << 24)

#define BUILD "VUID-VkAccelerationStructureBuildGeometryInfoKHR-"
#define RANGE_INFO "VUID-VkAccelerationStructureBuildRangeInfoKHR-"
#define GEOMETRY "VUID-VkAccelerationStructureGeometryKHR-"
#define TRIANGLES_DATA "VUID-VkAccelerationStructureGeometryTrianglesDataKHR-"
#define AABBS_DATA "VUID-VkAccelerationStructureGeometryAabbsDataKHR-"
#define LSS_DATA "VUID-VkAccelerationStructureGeometryLinearSweptSpheresDataNV-"
#define CALL "VUID-vkBuildAccelerationStructuresKHR-"
#define WRONG(base, change, vuid, where)                                                                               \
    {                                                                                                                  \
#change, inputs_##base, change, BVHD_INVALID, vuid, where                                                      \
    }
#define FOREIGN(base, change, where)                                                                                   \
    {                                                                                                                  \
#change, inputs_##base, change, BVHD_UNSUPPORTED, "", where                                                    \
    }
#define LARGE(base, change, where)                                                                                     \
    {                                                                                                                  \
#change, inputs_##base, change, BVHD_TOO_LARGE, "", where                                                      \
    }

static const struct wrong entries[] = {
    WRONG(triangles, generic, BUILD "type-03654", "infos[3].type"),
    WRONG(triangles, generic_motion, BUILD "flags-04929", "infos[3].flags"),
    WRONG(triangles, unknown_type, BUILD "type-parameter", "infos[3].type"),
    FOREIGN(triangles, micromap_type, "infos[3].type"),
    WRONG(triangles, unknown_flags, BUILD "flags-parameter", "infos[3].flags"),
    WRONG(triangles, high_flags, BUILD "flags-parameter", "infos[3].flags"),
    WRONG(aabbs, both_preferences, BUILD "flags-03796", "infos[3].flags"),
    WRONG(instances, motion_flag, "", "infos[3].flags"),
    WRONG(instances, motion_instances_without_flag, "", "infos[3].flags"),
    WRONG(triangles, motion_triangles_without_flag, "VUID-VkAccelerationStructureCreateInfoKHR-flags-04955",
          "infos[3].flags"),
    WRONG(triangles, boxes_after_motion_triangles, BUILD "type-03792", "infos[3].geometries[1].geometryType"),
    FOREIGN(triangles, lossy_flag, "infos[3].flags"),
    FOREIGN(triangles, cluster_flag, "infos[3].flags"),
    WRONG(triangles, unknown_mode, CALL "mode-04628", "infos[3].mode"),
    WRONG(triangles, update_without_source, CALL "pInfos-04630", "infos[3].srcAccelerationStructure"),
    WRONG(triangles, update, CALL "srcAccelerationStructure-04629", "infos[3].srcAccelerationStructure"),
    WRONG(triangles, unknown_quality, "", "infos[3].options.quality"),
    WRONG(triangles, negative_rays, "", "infos[3].options.raysPerPrimitive"),
    WRONG(instances, infinite_rays, "", "infos[3].options.raysPerPrimitive"),
    WRONG(aabbs, nan_rays, "", "infos[3].options.raysPerPrimitive"),
    FOREIGN(triangles, unknown_target, "infos[3].options.target"),
    WRONG(triangles, unknown_layout_flag, "", "infos[3].options.layoutFlags"),
    WRONG(triangles, foreign_layout_flag, "", "infos[3].options.layoutFlags"),
    WRONG(aabbs, portable_driver, "", "infos[3].options.device"),
    WRONG(triangles, portable_compatibility, "", "infos[3].options.device"),
    WRONG(instances, portable_variant, "", "infos[3].options.device"),
    WRONG(triangles, native_without_device, "", "infos[3].options.device"),
    WRONG(triangles, native_without_variant, "", "infos[3].options.device"),
    WRONG(aabbs, unknown_variant, "", "infos[3].options.device"),
    WRONG(instances, far_variant, "", "infos[3].options.device"),
    WRONG(instances, two_in_top, BUILD "type-03790", "infos[3].geometryCount"),
    WRONG(instances, none_in_top, BUILD "type-03790", "infos[3].geometryCount"),
    WRONG(triangles, no_geometries, BUILD "pGeometries-parameter", "infos[3].pGeometries"),
    WRONG(triangles, unknown_geometry, GEOMETRY "geometryType-parameter", "infos[3].geometries[1].geometryType"),
    FOREIGN(triangles, dense_triangles, "infos[3].geometries[1].geometryType"),
    WRONG(triangles, triangles_in_top, BUILD "type-03789", "infos[3].geometries[0].geometryType"),
    WRONG(instances, instances_in_bottom, BUILD "type-03791", "infos[3].geometries[0].geometryType"),
    WRONG(triangles, instances_second, BUILD "type-03791", "infos[3].geometries[1].geometryType"),
    WRONG(triangles, mixed, BUILD "type-03792", "infos[3].geometries[1].geometryType"),
    WRONG(triangles, mixed_with_spheres, BUILD "type-03792", "infos[3].geometries[1].geometryType"),
    WRONG(instances, spheres_in_top, BUILD "type-03789", "infos[3].geometries[0].geometryType"),
    WRONG(triangles, unknown_geometry_flags, GEOMETRY "flags-parameter", "infos[3].geometries[1].flags"),

    WRONG(triangles, unknown_format, TRIANGLES_DATA "vertexFormat-03797",
          "infos[3].geometries[1].triangles.vertexFormat"),
    WRONG(triangles, undefined_format, TRIANGLES_DATA "vertexFormat-03797",
          "infos[3].geometries[0].triangles.vertexFormat"),
    WRONG(triangles, last_of_core, TRIANGLES_DATA "vertexFormat-03797",
          "infos[3].geometries[0].triangles.vertexFormat"),
    WRONG(triangles, extension_format, TRIANGLES_DATA "vertexFormat-03797",
          "infos[3].geometries[1].triangles.vertexFormat"),
    WRONG(triangles, no_format, TRIANGLES_DATA "vertexFormat-parameter",
          "infos[3].geometries[1].triangles.vertexFormat"),
    WRONG(triangles, no_format_below_extensions, TRIANGLES_DATA "vertexFormat-parameter",
          "infos[3].geometries[0].triangles.vertexFormat"),
    WRONG(triangles, stride_alignment, TRIANGLES_DATA "vertexStride-03735",
          "infos[3].geometries[0].triangles.vertexStride"),
    WRONG(triangles, packed_stride, TRIANGLES_DATA "vertexStride-03735",
          "infos[3].geometries[1].triangles.vertexStride"),
    WRONG(triangles, large_stride, TRIANGLES_DATA "vertexStride-03819",
          "infos[3].geometries[0].triangles.vertexStride"),
    WRONG(triangles, uint8_indices, TRIANGLES_DATA "indexType-03798", "infos[3].geometries[0].triangles.indexType"),
    WRONG(triangles, unknown_indices, TRIANGLES_DATA "indexType-parameter",
          "infos[3].geometries[1].triangles.indexType"),
    WRONG(triangles, odd_index_offset, RANGE_INFO "primitiveOffset-03656", "ranges[3][0].primitiveOffset"),
    WRONG(triangles, index_offset_32, RANGE_INFO "primitiveOffset-03656", "ranges[3][0].primitiveOffset"),
    WRONG(triangles, vertex_offset, RANGE_INFO "primitiveOffset-03657", "ranges[3][1].primitiveOffset"),
    WRONG(triangles, packed_offset, RANGE_INFO "primitiveOffset-03657", "ranges[3][1].primitiveOffset"),
    WRONG(triangles, transform_offset, RANGE_INFO "transformOffset-03658", "ranges[3][0].transformOffset"),
    WRONG(triangles, past_max_vertex, RANGE_INFO "None-10775", "ranges[3][1].primitiveCount"),
    WRONG(triangles, first_vertex_past, RANGE_INFO "None-10775", "ranges[3][1].primitiveCount"),
    WRONG(triangles, far_past_max_vertex, RANGE_INFO "None-10775", "ranges[3][1].primitiveCount"),

    WRONG(triangles, null_vertices, CALL "pInfos-03771", "infos[3].geometries[0].triangles.vertexData"),
    WRONG(triangles, short_vertices, CALL "pInfos-03771", "infos[3].geometries[1].triangles.vertexData"),
    WRONG(triangles, offset_vertices, CALL "pInfos-03771", "infos[3].geometries[1].triangles.vertexData"),
    WRONG(triangles, null_indices, CALL "pInfos-03772", "infos[3].geometries[0].triangles.indexData"),
    WRONG(triangles, short_indices, CALL "pInfos-03772", "infos[3].geometries[0].triangles.indexData"),
    WRONG(triangles, short_indices_32, CALL "pInfos-03772", "infos[3].geometries[0].triangles.indexData"),
    WRONG(triangles, short_transform, CALL "pInfos-03773", "infos[3].geometries[0].triangles.transformData"),
    WRONG(triangles, far_transform, CALL "pInfos-03773", "infos[3].geometries[0].triangles.transformData"),

    WRONG(aabbs, box_stride, AABBS_DATA "stride-03545", "infos[3].geometries[0].aabbs.stride"),
    WRONG(aabbs, large_box_stride, AABBS_DATA "stride-03820", "infos[3].geometries[0].aabbs.stride"),
    WRONG(aabbs, box_offset, RANGE_INFO "primitiveOffset-03659", "ranges[3][0].primitiveOffset"),
    WRONG(aabbs, null_boxes, CALL "pInfos-03774", "infos[3].geometries[0].aabbs.data"),
    WRONG(aabbs, short_boxes, CALL "pInfos-03774", "infos[3].geometries[0].aabbs.data"),

    WRONG(instances, record_offset, RANGE_INFO "primitiveOffset-03660", "ranges[3][0].primitiveOffset"),
    WRONG(instances, null_records, CALL "pInfos-03778", "infos[3].geometries[0].instances.data"),
    WRONG(instances, short_records, CALL "pInfos-03778", "infos[3].geometries[0].instances.data"),

#define SPHERES_PLACE(index, field) "infos[3].geometries[" #index "].spheres." field
    WRONG(spheres, null_centres, CALL "pInfos-11824", SPHERES_PLACE(0, "vertexData")),
    WRONG(spheres, short_centres, CALL "pInfos-11824", SPHERES_PLACE(1, "vertexData")),
    WRONG(spheres, offset_centres, CALL "pInfos-11824", SPHERES_PLACE(1, "vertexData")),
    WRONG(spheres, null_radii, CALL "pInfos-11825", SPHERES_PLACE(0, "radiusData")),
    WRONG(spheres, short_radii, CALL "pInfos-11825", SPHERES_PLACE(1, "radiusData")),
    WRONG(spheres, far_radii, CALL "pInfos-11825", SPHERES_PLACE(1, "radiusData")),
    WRONG(spheres, null_sphere_indices, CALL "pInfos-11823", SPHERES_PLACE(0, "indexData")),
    WRONG(spheres, short_sphere_indices, CALL "pInfos-11823", SPHERES_PLACE(0, "indexData")),
    WRONG(spheres, far_sphere_indices, CALL "pInfos-11823", SPHERES_PLACE(0, "indexData")),
    WRONG(spheres, given_sphere_indices, CALL "pInfos-11822", SPHERES_PLACE(1, "indexData")),

#define SWEPT_PLACE(index, field) "infos[3].geometries[" #index "].linearSweptSpheres." field
    WRONG(swept_spheres, null_ends, CALL "pInfos-11828", SWEPT_PLACE(0, "vertexData")),
    WRONG(swept_spheres, short_ends, CALL "pInfos-11828", SWEPT_PLACE(1, "vertexData")),
    WRONG(swept_spheres, null_end_radii, CALL "pInfos-11829", SWEPT_PLACE(0, "radiusData")),
    WRONG(swept_spheres, short_end_radii, CALL "pInfos-11829", SWEPT_PLACE(1, "radiusData")),
    WRONG(swept_spheres, null_end_indices, CALL "pInfos-11827", SWEPT_PLACE(0, "indexData")),
    WRONG(swept_spheres, short_end_indices, CALL "pInfos-11827", SWEPT_PLACE(0, "indexData")),
    WRONG(swept_spheres, indices_for_a_list, CALL "pInfos-11827", SWEPT_PLACE(0, "indexData")),
    WRONG(swept_spheres, successive_without_indices, LSS_DATA "indexingMode-10427", SWEPT_PLACE(0, "indexData")),
    WRONG(swept_spheres, given_end_indices, CALL "pInfos-11826", SWEPT_PLACE(1, "indexData")),

    LARGE(spheres, many_spheres, "ranges[3][1].primitiveCount"),
    LARGE(swept_spheres, many_spheres, "ranges[3][1].primitiveCount"),
    WRONG(triangles, many_triangles, BUILD "type-03795", "ranges[3][1].primitiveCount"),
    WRONG(aabbs, many_boxes, BUILD "type-03794", "ranges[3][0].primitiveCount"),
    WRONG(instances, many_instances, CALL "pInfos-03801", "ranges[3][0].primitiveCount"),
    WRONG(triangles, many_geometries, BUILD "type-03793", "infos[3].geometryCount"),
};

static void every_rule_is_named(void **state)
{
    (void)state;
    struct limits limits = limits_default(), larger = {UINT64_MAX, UINT64_MAX, UINT64_MAX, UINT64_MAX};
    for (size_t i = 0; i < sizeof entries / sizeof entries[0]; i++) {
        refuse(&entries[i], &limits);
        refuse(&entries[i], &larger);
    }
}

/* Announced limits below the format's own limits are kept. */
static void limits_are_kept(void **state)
{
    (void)state;
    struct test_input test;
    struct bvhd_error error;
    struct limits limits = {2, 4, 5, UINT64_MAX};
    inputs_triangles(&test);
    assert_int_equal(validate_input(&test.input, 0, &limits, &error), BVHD_OK);
    limits.max_primitives = 4;
    assert_int_equal(validate_input(&test.input, 0, &limits, &error), BVHD_INVALID);
    assert_int_equal(error.vuid, BVHD_VUID_03795);
    assert_string_equal(error.where, "ranges[0][1].primitiveCount");
    limits.max_geometries = 1;
    assert_int_equal(validate_input(&test.input, 0, &limits, &error), BVHD_INVALID);
    assert_int_equal(error.vuid, BVHD_VUID_03793);

    inputs_instances(&test);
    assert_int_equal(validate_input(&test.input, 0, &limits, &error), BVHD_OK);
    limits.max_instances = 3;
    assert_int_equal(validate_input(&test.input, 0, &limits, &error), BVHD_INVALID);
    assert_int_equal(error.vuid, BVHD_VUID_03801);

    limits.max_primitives = 2;
    inputs_aabbs(&test);
    assert_int_equal(validate_input(&test.input, 0, &limits, &error), BVHD_INVALID);
    assert_int_equal(error.vuid, BVHD_VUID_03794);
}

static void nothing_needs_no_memory(void **state)
{
    (void)state;
    struct test_input test;
    inputs_triangles(&test);
    test.geometries[0].range.primitive_count = test.geometries[1].range.primitive_count = 0;
    test.geometries[0].triangles.vertices = test.geometries[1].triangles.vertices = (struct bytes){NULL, 0};
    test.geometries[0].triangles.indices = test.geometries[0].triangles.transform = (struct bytes){NULL, 0};
    accept(&test, "no triangles");
    inputs_aabbs(&test);
    test.geometries[0].range.primitive_count = 0;
    test.geometries[0].aabbs.boxes = (struct bytes){NULL, 0};
    accept(&test, "no boxes");
    inputs_instances(&test);
    test.geometries[0].range.primitive_count = 0;
    test.geometries[0].instances.records = (struct bytes){NULL, 0};
    accept(&test, "no instances");
    inputs_triangles(&test);
    test.input.geometry_count = 0;
    test.input.geometries = NULL;
    accept(&test, "no geometries");
}

/* Requests at the edges of the rules are legal. */
static void edges_are_legal(void **state)
{
    (void)state;
    static const uint64_t strides[] = {0, 4, 12, UINT32_MAX - 3};
    struct test_input test;
    for (size_t i = 0; i < sizeof strides / sizeof strides[0]; i++) {
        inputs_triangles(&test);
        test.geometries[0].triangles.vertex_stride = strides[i];
        accept(&test, "vertex stride");
    }
    inputs_aabbs(&test);
    for (test.geometries[0].aabbs.stride = 0; test.geometries[0].aabbs.stride <= 24;
         test.geometries[0].aabbs.stride += 8)
        accept(&test, "box stride");
    inputs_triangles(&test);
    test.geometries[0].range.first_vertex = UINT32_MAX; /* checked later, with the indices */
    test.geometries[0].triangles.transform.data = NULL;
    test.geometries[0].range.transform_offset = 7; /* no transform is given */
    test.geometries[1].triangles.vertices.size = 8 * 20 + 12;
    test.input.flags = BUILD_ALLOW_UPDATE | BUILD_ALLOW_COMPACTION | BUILD_PREFER_FAST_TRACE | BUILD_LOW_MEMORY |
                       BUILD_ALLOW_DATA_ACCESS;
    test.input.source = 7; /* a build ignores it */
    accept(&test, "triangles");
    inputs_mixed_triangles(&test);
    accept(&test, "motion triangles beside others");
    inputs_triangles(&test);
    test.input.flags = BUILD_MOTION;
    accept(&test, "the flag MOTION for triangles that stand still");
    inputs_motion_instances(&test);
    accept(&test, "motion instances");
}

/* The UUIDs of a native target may have any value, because the device's driver chooses them. */
static void native_targets_are_legal(void **state)
{
    (void)state;
    struct test_input test;
    for (uint32_t variant = 1; variant <= LAVAPIPE_VARIANTS; variant++) {
        inputs_triangles(&test);
        make_native(&test, variant);
        accept(&test, "without UUIDs");
        memset(&test.input.options.device.driver_uuid, 0xff, 32);
        accept(&test, "with UUIDs");
        inputs_instances(&test);
        make_native(&test, variant);
        accept(&test, "instances");
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_rule_is_named),      cmocka_unit_test(limits_are_kept),
        cmocka_unit_test(nothing_needs_no_memory),  cmocka_unit_test(edges_are_legal),
        cmocka_unit_test(native_targets_are_legal),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
