/* SPDX-License-Identifier: Apache-2.0 */
/* test_structure_positions.c - tests positions by primitive: their bits, their place after transforms, each refusal. */
#include "tests/support/unit.h"

#include "tests/support/client/structure_bed.h"

static struct structure_bed bed;

static const enum target targets[] = {TARGET_PORTABLE, TARGET_LAVAPIPE};

static enum bvhd_status copy(VkCopyAccelerationStructureModeKHR mode)
{
    const VkCopyAccelerationStructureInfoKHR info = {.sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_INFO_KHR,
                                                     .src = bvhd_structure_handle(bed.holds_bottom),
                                                     .dst = bvhd_structure_handle(bed.spare),
                                                     .mode = mode};
    return bvhd_structure_copy(&info, &bed.error);
}

/* Serializes the bottom level and makes `spare` hold the bytes. */
static void travel(const struct bvhd_format *format)
{
    const VkCopyAccelerationStructureToMemoryInfoKHR to = {
        .sType = VK_STRUCTURE_TYPE_COPY_ACCELERATION_STRUCTURE_TO_MEMORY_INFO_KHR,
        .src = bvhd_structure_handle(bed.holds_bottom),
        .dst.hostAddress = bed.room,
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_SERIALIZE_KHR};
    const VkCopyMemoryToAccelerationStructureInfoKHR from = {
        .sType = VK_STRUCTURE_TYPE_COPY_MEMORY_TO_ACCELERATION_STRUCTURE_INFO_KHR,
        .src.hostAddress = bed.room,
        .dst = bvhd_structure_handle(bed.spare),
        .mode = VK_COPY_ACCELERATION_STRUCTURE_MODE_DESERIALIZE_KHR};
    assert_int_equal(bvhd_structure_serialize(&to, STRUCTURE_ROOM, &bed.error), BVHD_OK);
    assert_int_equal(bvhd_structure_deserialize(&from, STRUCTURE_ROOM, format, &bed.error), BVHD_OK);
}

static void assert_positions(const struct bvhd_structure *structure)
{
    float positions[3][3];
    for (uint32_t i = 0; i < STRUCTURE_TRIANGLES; i++) {
        assert_int_equal(bvhd_structure_positions(structure, 0, i, positions, &bed.error), BVHD_OK);
        assert_memory_equal(positions, bed.vertices[i], sizeof positions);
    }
}

/* Also of copies, which outlive their source. */
static void structures_give_their_positions(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        structure_bed_start(&bed, BUILD_ALLOW_DATA_ACCESS | BUILD_ALLOW_COMPACTION, targets[i]);
        assert_positions(bed.holds_bottom);
        assert_int_equal(copy(VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR), BVHD_OK);
        assert_positions(bed.spare);
        assert_int_equal(copy(VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR), BVHD_OK);
        bvhd_structure_destroy(bed.holds_bottom);
        bed.holds_bottom = NULL;
        assert_positions(bed.spare);
        structure_bed_stop(&bed);
    }
}

/* The bytes of a portable structure tell the flag, those of a native one do not. */
static void flags_travel_with_portable_structures(void **state)
{
    (void)state;
    static const struct bvhd_format format = {
        .struct_size = sizeof format, .target = BVHD_TARGET_LAVAPIPE, .variant = 1};
    float positions[3][3];
    for (int i = 0; i < 2; i++) {
        structure_bed_start(&bed, BUILD_ALLOW_DATA_ACCESS, targets[i]);
        travel(&format);
        if (targets[i] == TARGET_PORTABLE)
            assert_positions(bed.spare);
        else
            structure_bed_refused(&bed, "native", bvhd_structure_positions(bed.spare, 0, 0, positions, &bed.error), "",
                                  "structure");
        structure_bed_stop(&bed);
    }
}

/* Each allocation fails once; then the object holds what it held before. */
static void a_failure_changes_nothing(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        structure_bed_start(&bed, BUILD_ALLOW_DATA_ACCESS, targets[i]);
        const uint64_t live = library_memory.live;
        enum bvhd_status status = BVHD_NO_MEMORY;
        int failures = 0;
        for (; status == BVHD_NO_MEMORY; failures++) {
            assert_int_equal(library_memory.live, live);
            atomic_store(&library_memory.fail_after, failures);
            status = bvhd_structure_hold(bed.holds_bottom, &bed.bottom.info, &bed.bottom.range, &bed.bottom.result,
                                         &bed.error);
            atomic_store(&library_memory.fail_after, -1);
            assert_positions(bed.holds_bottom);
        }
        assert_int_equal(status, BVHD_OK);
        assert_int_equal(library_memory.live, live);
        assert_true(failures > 3);
        structure_bed_stop(&bed);
    }
}

/* Spheres have no corners. */
static void other_kinds_have_none(void **state)
{
    (void)state;
    static const VkGeometryTypeKHR types[] = {VK_GEOMETRY_TYPE_SPHERES_NV, VK_GEOMETRY_TYPE_LINEAR_SWEPT_SPHERES_NV};
    float positions[3][3];
    for (int i = 0; i < 2; i++) {
        structure_bed_start_with(&bed, types[i], BUILD_ALLOW_DATA_ACCESS, TARGET_PORTABLE);
        travel(NULL);
        for (int k = 0; k < 2; k++)
            structure_bed_refused(
                &bed, "no triangles",
                bvhd_structure_positions(k ? bed.spare : bed.holds_bottom, 0, 0, positions, &bed.error), "",
                "geometry");
        structure_bed_refused(&bed, "no triangles",
                              bvhd_structure_positions(bed.holds_top, 0, 0, positions, &bed.error), "", "geometry");
        structure_bed_stop(&bed);
    }
}

/* Positions are those after the geometry's transform; these numbers are exact. */
static void positions_are_transformed(void **state)
{
    (void)state;
    static const VkTransformMatrixKHR matrix = {{{2, 0, 0, 1}, {0, 0, -1, 3}, {1, 4, 0, -5}}};
    for (int i = 0; i < 2; i++) {
        structure_bed_start(&bed, BUILD_ALLOW_DATA_ACCESS, targets[i]);
        const struct build_options options = {
            .quality = QUALITY_BALANCED, .target = targets[i], .device.variant = targets[i] == TARGET_LAVAPIPE};
        struct structure_build moved = bed.bottom;
        float positions[3][3];
        for (int k = 0; k < 9 * STRUCTURE_TRIANGLES; k++)
            bed.vertices[k / 9][k / 3 % 3][k % 3] = (float)(1 + k * k % 23);
        moved.info.pGeometries = &moved.geometry;
        moved.geometry.geometry.triangles.transformData.hostAddress = &matrix;
        moved.result = structure_bed_result(&moved, &options);
        assert_int_equal(bvhd_structure_hold(bed.spare, &moved.info, &moved.range, &moved.result, &bed.error), BVHD_OK);
        for (uint32_t t = 0; t < STRUCTURE_TRIANGLES; t++) {
            assert_int_equal(bvhd_structure_positions(bed.spare, 0, t, positions, &bed.error), BVHD_OK);
            for (int k = 0; k < 3; k++) {
                const float *v = bed.vertices[t][k];
                const float wanted[3] = {2 * v[0] + 1, 3 - v[2], v[0] + 4 * v[1] - 5};
                assert_memory_equal(positions[k], wanted, sizeof wanted);
            }
        }
        bvhd_blob_unref(moved.result.blob);
        structure_bed_stop(&bed);
    }
}

static void refused(const struct bvhd_structure *structure, uint32_t geometry, uint32_t primitive, const char *where)
{
    float positions[3][3];
    structure_bed_refused(&bed, where, bvhd_structure_positions(structure, geometry, primitive, positions, &bed.error),
                          "", where);
}

static void what_is_not_there_is_refused(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        float positions[3][3];
        structure_bed_start(&bed, BUILD_ALLOW_DATA_ACCESS, targets[i]);
        refused(NULL, 0, 0, "structure");
        refused(bed.spare, 0, 0, "structure");
        refused(bed.holds_top, 0, 0, "geometry");
        refused(bed.holds_bottom, 0, STRUCTURE_TRIANGLES, "primitive");
        refused(bed.holds_bottom, 1, 0, targets[i] == TARGET_PORTABLE ? "geometry" : "primitive");
        structure_bed_refused(&bed, "NULL", bvhd_structure_positions(bed.holds_bottom, 0, 0, NULL, &bed.error), "",
                              "ret_positions");
        structure_bed_stop(&bed);
        structure_bed_start(&bed, BUILD_ALLOW_UPDATE, targets[i]);
        refused(bed.holds_bottom, 0, 0, "structure"); /* without the flag */
        assert_int_equal(bvhd_structure_positions(bed.holds_bottom, 0, 0, positions, NULL), BVHD_INVALID);
        structure_bed_stop(&bed);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(structures_give_their_positions), cmocka_unit_test(flags_travel_with_portable_structures),
        cmocka_unit_test(a_failure_changes_nothing),       cmocka_unit_test(positions_are_transformed),
        cmocka_unit_test(what_is_not_there_is_refused),    cmocka_unit_test(other_kinds_have_none),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
