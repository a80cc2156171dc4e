/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_motion_rules.c - tests Vulkan's rules about what moves, each by a request that breaks it and is right without
 * that: about the flag, about the vertices at t = 1, and about each field of the three types of motion instances.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/builder/prepare_bed.h"

#define CALL "VUID-vkBuildAccelerationStructuresKHR-"
#define RECORD(name) "VUID-VkAccelerationStructure" #name "InstanceNV-"
#define END_DATA "infos[2].geometries[0].triangles.motion.vertexData"

static void accept(struct test_input *test)
{
    struct canonical canonical = bed_make(test);
    bed_finish(&canonical);
}

/* The second array of vertices reaches as far as the first. */
static void vertices_of_both_times_are_there(void **state)
{
    (void)state;
    struct test_input test;
    inputs_motion_triangles(&test);
    accept(&test);
    test.geometries[0].triangles.end_vertices = (struct bytes){NULL, 0};
    bed_refuse(&test, BVHD_INVALID, CALL "pInfos-11820", END_DATA);
    inputs_motion_triangles(&test);
    test.geometries[1].triangles.end_vertices.size = 8 * 20 + 12;
    accept(&test);
    test.geometries[1].triangles.end_vertices.size--; /* nine vertices without indices */
    bed_refuse(&test, BVHD_INVALID, CALL "pInfos-11820", "infos[2].geometries[1].triangles.motion.vertexData");
    inputs_motion_triangles(&test);
    test.geometries[0].triangles.end_vertices.size = 4 * 20 + 12;
    accept(&test);
    test.geometries[0].triangles.end_vertices.size--; /* the greatest index is 3, from vertex 1 on */
    bed_refuse(&test, BVHD_INVALID, CALL "pInfos-11820", END_DATA);
    inputs_motion_triangles(&test);
    test.geometries[0].triangles.vertices.size = 4 * 20 + 11;
    bed_refuse(&test, BVHD_INVALID, CALL "pInfos-03771", "infos[2].geometries[0].triangles.vertexData");
    inputs_mixed_triangles(&test); /* of which the second one needs no such array */
    accept(&test);
}

static void the_flag_goes_with_the_kinds(void **state)
{
    (void)state;
    struct test_input test;
    inputs_motion_triangles(&test);
    test.input.flags = 0;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureCreateInfoKHR-flags-04955", "infos[2].flags");
    inputs_mixed_triangles(&test);
    test.input.flags = BUILD_ALLOW_UPDATE;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureCreateInfoKHR-flags-04955", "infos[2].flags");
    inputs_motion_instances(&test);
    test.input.flags = 0;
    bed_refuse(&test, BVHD_INVALID, "", "infos[2].flags");
    inputs_instances(&test);
    test.input.flags = BUILD_MOTION;
    bed_refuse(&test, BVHD_INVALID, "", "infos[2].flags");
    static void (*const still[])(struct test_input *) = {inputs_triangles, inputs_aabbs, inputs_spheres,
                                                         inputs_swept_spheres};
    for (int i = 0; i < 4; i++) { /* what stands still may be in a bottom level with the flag */
        still[i](&test);
        test.input.flags = BUILD_MOTION;
        accept(&test);
    }
    inputs_motion_triangles(&test);
    test.geometries[1].type = GEOMETRY_AABBS;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureBuildGeometryInfoKHR-type-03792",
               "infos[2].geometries[1].geometryType");
    inputs_motion_triangles(&test);
    test.input.type = STRUCTURE_GENERIC;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureBuildGeometryInfoKHR-flags-04929", "infos[2].flags");
}

/* The last record ends before its stride does. */
static void all_records_are_there(void **state)
{
    (void)state;
    struct test_input test;
    const uint64_t needed = (INPUTS_MOTION_RECORDS - 1) * MOTION_RECORD_STRIDE + MOTION_RECORD_SIZE;
    inputs_motion_instances(&test);
    unsigned char *exact = malloc(needed); /* whose end a sanitizer knows */
    memcpy(exact, test.motion_records, needed);
    test.geometries[0].instances.records = (struct bytes){exact, needed};
    accept(&test);
    test.geometries[0].instances.records.size--;
    bed_refuse(&test, BVHD_INVALID, CALL "pInfos-03778", "infos[2].geometries[0].instances.data");
    free(exact);
    inputs_motion_instances(&test);
    test.geometries[0].instances.records.data = NULL;
    bed_refuse(&test, BVHD_INVALID, CALL "pInfos-03778", "infos[2].geometries[0].instances.data");
    inputs_motion_instances(&test);
    test.geometries[0].range.primitive_offset = 8;
    bed_refuse(&test, BVHD_INVALID, "VUID-VkAccelerationStructureBuildRangeInfoKHR-primitiveOffset-03660",
               "ranges[2][0].primitiveOffset");
}

/* Records 0, 2 and 3 of the request are a static, a matrix and a SRT instance. */
static const struct {
    int record, fields; /* the word that has custom index and mask */
    const char *member, *flags;
} types[] = {
    {0, 14, "staticInstance", "VUID-VkAccelerationStructureInstanceKHR-flags-parameter"},
    {2, 26, "matrixMotionInstance", RECORD(MatrixMotion) "flags-parameter"},
    {3, 34, "srtMotionInstance", RECORD(SRTMotion) "flags-parameter"},
};

static void types_and_references_are_checked(void **state)
{
    (void)state;
    struct test_input test;
    char where[96];
    for (int i = 0; i < 3; i++) {
        const int record = types[i].record;
        inputs_motion_instances(&test);
        test.motion_records[record][1] = 1u << (10 * i);
        snprintf(where, sizeof where, "infos[2].geometries[0].instances[%d].flags", record);
        bed_refuse(&test, BVHD_INVALID, RECORD(Motion) "flags-zerobitmask", where);
        inputs_motion_instances(&test);
        test.motion_records[record][types[i].fields + 2] = 56;
        snprintf(where, sizeof where, "infos[2].geometries[0].instances[%d].accelerationStructureReference", record);
        bed_refuse(&test, BVHD_INVALID, CALL "pInfos-04930", where);
        for (uint32_t type = MOTION_TYPES; type != 0; type <<= 1) {
            inputs_motion_instances(&test);
            test.motion_records[record][0] = type;
            snprintf(where, sizeof where, "infos[2].geometries[0].instances[%d].type", record);
            bed_refuse(&test, BVHD_INVALID, RECORD(Motion) "type-parameter", where);
        }
    }
}

static void flags_of_instances_are_checked(void **state)
{
    (void)state;
    struct test_input test;
    char where[96];
    for (int i = 0; i < 3; i++)
        for (uint32_t flags = 0; flags < 256; flags++) {
            inputs_motion_instances(&test);
            test.motion_records[types[i].record][types[i].fields + 1] = flags << 24 | 5;
            if (flags < 16 && (flags & 12) != 12) {
                accept(&test);
                continue;
            }
            const bool is_foreign = flags < 64 && flags & 0x30;
            snprintf(where, sizeof where, "infos[2].geometries[0].instances[%d].data.%s.flags", types[i].record,
                     types[i].member);
            bed_refuse(&test, is_foreign ? BVHD_UNSUPPORTED : BVHD_INVALID, is_foreign ? "" : types[i].flags, where);
        }
}

/* Matrices are invertible at both ends; between them, and in a SRT, they need not be. */
static void matrices_are_invertible(void **state)
{
    (void)state;
    static const struct {
        int record, word;
        const char *member;
    } matrices[] = {{0, 2, "staticInstance.transform"},
                    {2, 2, "matrixMotionInstance.transformT0"},
                    {2, 14, "matrixMotionInstance.transformT1"}};
    struct test_input test;
    char where[96];
    for (int i = 0; i < 3; i++) {
        uint32_t *row = &test.motion_records[matrices[i].record][matrices[i].word + 8]; /* the third row */
        snprintf(where, sizeof where, "infos[2].geometries[0].instances[%d].data.%s", matrices[i].record,
                 matrices[i].member);
        inputs_motion_instances(&test);
        memset(row, 0, 12);
        bed_refuse(&test, BVHD_INVALID, "VUID-VkTransformMatrixKHR-matrix-03799", where);
        inputs_motion_instances(&test);
        row[1] = 0x7fc00000;
        bed_refuse(&test, BVHD_INVALID, "VUID-VkTransformMatrixKHR-matrix-03799", where);
    }
    inputs_motion_instances(&test);
    const float mirrored[12] = {-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0},
                plain[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    memcpy(test.motion_records[2] + 2, plain, sizeof plain);
    memcpy(test.motion_records[2] + 14, mirrored, sizeof mirrored); /* 0 at half the time */
    memset(test.motion_records[3] + 2, 0, 32 * sizeof(float));
    accept(&test);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_flag_goes_with_the_kinds),   cmocka_unit_test(vertices_of_both_times_are_there),
        cmocka_unit_test(all_records_are_there),          cmocka_unit_test(types_and_references_are_checked),
        cmocka_unit_test(flags_of_instances_are_checked), cmocka_unit_test(matrices_are_invertible),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
