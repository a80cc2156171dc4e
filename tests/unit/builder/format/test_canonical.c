/* SPDX-License-Identifier: Apache-2.0 */
/* test_canonical.c - tests how instances, triangles and geometries are read from a canonical copy. */
#include "tests/support/unit.h"

#include <vulkan/vulkan_core.h>

#include "builder/format/canonical.h"
#include "tests/support/random.h"

/* Vulkan's own struct is the reference for the places of the bits. */
static void instances_are_vulkans_records(void **state)
{
    (void)state;
    assert_int_equal(sizeof(VkAccelerationStructureInstanceKHR), 64);
    VkAccelerationStructureInstanceKHR records[20];
    struct random random = {7};
    for (int i = 0; i < 20; i++) {
        for (int k = 0; k < 12; k++)
            (&records[i].transform.matrix[0][0])[k] = (float)random_between(&random, -9, 9);
        records[i].instanceCustomIndex = random_next(&random) & 0xffffff;
        records[i].mask = random_next(&random) & 0xff;
        records[i].instanceShaderBindingTableRecordOffset = random_next(&random) & 0xffffff;
        records[i].flags = random_next(&random) & 0xff;
        records[i].accelerationStructureReference = random_next(&random);
    }
    struct canonical_geometry geometry = {
        .type = GEOMETRY_INSTANCES, .primitive_count = 20, .instances = (const unsigned char *)records};
    for (uint32_t i = 0; i < 20; i++) {
        struct canonical_instance instance = canonical_instance(&geometry, i);
        assert_memory_equal(instance.transform, &records[i].transform, 48);
        assert_int_equal(instance.custom_index, records[i].instanceCustomIndex);
        assert_int_equal(instance.mask, records[i].mask);
        assert_int_equal(instance.sbt_offset, records[i].instanceShaderBindingTableRecordOffset);
        assert_int_equal(instance.flags, records[i].flags);
        assert_int_equal(instance.reference, records[i].accelerationStructureReference);
    }
}

static void each_field_reaches_its_ends(void **state)
{
    (void)state;
    unsigned char record[64];
    memset(record, 0xff, sizeof record);
    struct canonical_geometry geometry = {.type = GEOMETRY_INSTANCES, .primitive_count = 1, .instances = record};
    struct canonical_instance instance = canonical_instance(&geometry, 0);
    assert_int_equal(instance.custom_index, 0xffffff);
    assert_int_equal(instance.mask, 0xff);
    assert_int_equal(instance.sbt_offset, 0xffffff);
    assert_int_equal(instance.flags, 0xff);
    assert_true(instance.reference == UINT64_MAX);
}

static void corners_with_and_without_indices(void **state)
{
    (void)state;
    float positions[18];
    for (int i = 0; i < 18; i++)
        positions[i] = (float)i;
    static const uint32_t indices[] = {5, 0, 3, 1, 1, 4};
    struct canonical_geometry geometry = {.primitive_count = 2, .vertex_count = 6, .positions = positions};
    for (uint32_t triangle = 0; triangle < 2; triangle++)
        for (int indexed = 0; indexed < 2; indexed++) {
            float corners[3][3];
            geometry.indices = indexed ? indices : NULL;
            canonical_triangle(&geometry, triangle, corners);
            for (uint32_t k = 0; k < 3; k++) {
                uint32_t vertex = indexed ? indices[triangle * 3 + k] : triangle * 3 + k;
                for (uint32_t axis = 0; axis < 3; axis++)
                    assert_true(corners[k][axis] == (float)(vertex * 3 + axis));
            }
        }
}

/* The reference is to count through all geometries, empty ones included. */
static void check_geometry_of(const uint32_t *counts, uint32_t geometry_count)
{
    struct canonical_geometry geometries[8];
    struct canonical canonical = {.geometry_count = geometry_count, .geometries = geometries};
    for (uint32_t g = 0; g < geometry_count; g++) {
        geometries[g] =
            (struct canonical_geometry){.primitive_count = counts[g], .first_primitive = canonical.primitive_count};
        canonical.primitive_count += counts[g];
    }
    uint32_t id = 0;
    for (uint32_t g = 0; g < geometry_count; g++)
        for (uint32_t i = 0; i < counts[g]; i++)
            assert_int_equal(canonical_geometry_of(&canonical, id++), g);
}

static void ids_find_their_geometry(void **state)
{
    (void)state;
    for (uint32_t pattern = 0; pattern < 4 * 4 * 4 * 4 * 4; pattern++)
        for (uint32_t count = 1; count <= 5; count++) {
            uint32_t counts[5];
            for (uint32_t g = 0; g < 5; g++)
                counts[g] = pattern >> (2 * g) & 3;
            check_geometry_of(counts, count);
        }
}

static void ids_reach_the_largest_count(void **state)
{
    (void)state;
    struct canonical_geometry geometries[] = {
        {.primitive_count = 1},
        {.primitive_count = 0xfffffffd, .first_primitive = 1},
        {.primitive_count = 1, .first_primitive = 0xfffffffe},
    };
    struct canonical canonical = {.geometry_count = 3, .geometries = geometries, .primitive_count = 0xffffffff};
    assert_int_equal(canonical_geometry_of(&canonical, 0), 0);
    assert_int_equal(canonical_geometry_of(&canonical, 1), 1);
    assert_int_equal(canonical_geometry_of(&canonical, 0xfffffffd), 1);
    assert_int_equal(canonical_geometry_of(&canonical, 0xfffffffe), 2);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(instances_are_vulkans_records),    cmocka_unit_test(each_field_reaches_its_ends),
        cmocka_unit_test(corners_with_and_without_indices), cmocka_unit_test(ids_find_their_geometry),
        cmocka_unit_test(ids_reach_the_largest_count),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
