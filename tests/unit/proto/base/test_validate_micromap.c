/* SPDX-License-Identifier: Apache-2.0 */
/* test_validate_micromap.c - tests the rules about types, flags and numbers of opacity micromaps. */
#include "tests/support/unit.h"

#include "proto/base/validate_shape.h"

static int open_door(void **state)
{
    (void)state;
    validate_micromaps = true;
    return 0;
}

static void expect_flags(uint32_t type, uint32_t flags, enum bvhd_vuid vuid)
{
    struct bvhd_error error = {.status = BVHD_OK};
    enum bvhd_status want = vuid == BVHD_VUID_NONE ? BVHD_OK : BVHD_INVALID;
    assert_int_equal(validate_type(type, flags, 3, &error), want);
    assert_int_equal(error.vuid, vuid);
    if (want != BVHD_OK)
        assert_string_equal(error.where, "infos[3].flags");
}

static void flags_are_checked(void **state)
{
    (void)state;
    expect_flags(STRUCTURE_MICROMAP, 0, BVHD_VUID_NONE);
    expect_flags(STRUCTURE_MICROMAP, BUILD_ALLOW_COMPACTION | BUILD_PREFER_FAST_TRACE | BUILD_MICROMAP_LOSSY,
                 BVHD_VUID_NONE);
    expect_flags(STRUCTURE_MICROMAP, BUILD_PREFER_FAST_BUILD, BVHD_VUID_NONE);
    static const uint32_t not_of_micromaps[] = {0x1, 0x10, 0x20, 0x40, 0x80, 0x100, 0x800};
    for (size_t i = 0; i < sizeof not_of_micromaps / sizeof *not_of_micromaps; i++)
        expect_flags(STRUCTURE_MICROMAP, not_of_micromaps[i], BVHD_VUID_11562);
    expect_flags(STRUCTURE_BOTTOM, BUILD_MICROMAP_LOSSY, BVHD_VUID_11563);
    expect_flags(STRUCTURE_TOP, BUILD_MICROMAP_LOSSY, BVHD_VUID_11563);
    expect_flags(STRUCTURE_BOTTOM, 0x1c0, BVHD_VUID_11558);
    expect_flags(STRUCTURE_BOTTOM, 0x0c0, BVHD_VUID_NONE);
    expect_flags(STRUCTURE_BOTTOM, 0x180, BVHD_VUID_NONE);
    expect_flags(STRUCTURE_MICROMAP, BUILD_PREFER_FAST_TRACE | BUILD_PREFER_FAST_BUILD, BVHD_VUID_03796);
}

static void expect_geometry(uint32_t type, const struct geometry *geometry, enum bvhd_status want, enum bvhd_vuid vuid,
                            const char *where)
{
    const struct limits limits = limits_default();
    const struct build_input input = {.type = type, .geometry_count = 1, .geometries = geometry};
    struct bvhd_error error = {.status = BVHD_OK};
    const struct validate_subject subject = {geometry, 3, 0, &error, false};
    uint64_t total = 0;
    assert_int_equal(validate_geometry(&subject, &input, &limits, &total), want);
    assert_int_equal(error.vuid, vuid);
    if (want != BVHD_OK)
        assert_string_equal(error.where, where);
}

static void a_micromap_has_one_geometry(void **state)
{
    (void)state;
    const struct limits limits = limits_default();
    static const char type_place[] = "infos[3].geometries[0].geometryType";
    for (uint32_t count = 0; count < 4; count++) {
        struct bvhd_error error = {.status = BVHD_OK};
        assert_int_equal(validate_geometry_count(STRUCTURE_MICROMAP, count, 3, &limits, &error),
                         count == 1 ? BVHD_OK : BVHD_INVALID);
        assert_int_equal(error.vuid, count == 1 ? BVHD_VUID_NONE : BVHD_VUID_11560);
    }
    struct geometry geometry = {.type = GEOMETRY_MICROMAP};
    for (int i = 0; i < 2; i++) {
        expect_geometry(STRUCTURE_MICROMAP, &geometry, BVHD_OK, BVHD_VUID_NONE, "");
        expect_geometry(STRUCTURE_BOTTOM, &geometry, BVHD_INVALID, BVHD_VUID_11707, type_place);
        expect_geometry(STRUCTURE_TOP, &geometry, BVHD_INVALID, BVHD_VUID_11707, type_place);
        geometry.flags = GEOMETRY_OPAQUE;
        expect_geometry(STRUCTURE_MICROMAP, &geometry, BVHD_INVALID, BVHD_VUID_NONE, "infos[3].geometries[0].flags");
        geometry = (struct geometry){.type = GEOMETRY_BAKED_MICROMAP};
    }
    geometry.type = GEOMETRY_TRIANGLES;
    expect_geometry(STRUCTURE_MICROMAP, &geometry, BVHD_INVALID, BVHD_VUID_11561, type_place);
    geometry.type = GEOMETRY_INSTANCES;
    expect_geometry(STRUCTURE_MICROMAP, &geometry, BVHD_INVALID, BVHD_VUID_11561, type_place);
}

static void many_triangles_are_too_many(void **state)
{
    (void)state;
    struct geometry geometry = {.type = GEOMETRY_MICROMAP, .range = {.primitive_count = LIMIT_MAX_PRIMITIVES}};
    expect_geometry(STRUCTURE_MICROMAP, &geometry, BVHD_OK, BVHD_VUID_NONE, "");
    geometry.range.primitive_count++;
    expect_geometry(STRUCTURE_MICROMAP, &geometry, BVHD_INVALID, BVHD_VUID_11643, "ranges[3][0].primitiveCount");
}

/* The program refuses all of this until it has the rest of micromaps. */
static void a_closed_door_refuses(void **state)
{
    (void)state;
    struct bvhd_error error = {.status = BVHD_OK};
    const struct geometry geometry = {.type = GEOMETRY_MICROMAP}, bake = {.type = GEOMETRY_BAKED_MICROMAP};
    validate_micromaps = false;
    assert_int_equal(validate_type(STRUCTURE_MICROMAP, 0, 0, &error), BVHD_UNSUPPORTED);
    assert_int_equal(validate_type(STRUCTURE_BOTTOM, BUILD_MICROMAP_LOSSY, 0, &error), BVHD_UNSUPPORTED);
    assert_int_equal(validate_type(STRUCTURE_BOTTOM, BUILD_ALLOW_MICROMAP_UPDATE, 0, &error), BVHD_UNSUPPORTED);
    expect_geometry(STRUCTURE_BOTTOM, &geometry, BVHD_UNSUPPORTED, BVHD_VUID_NONE,
                    "infos[3].geometries[0].geometryType");
    expect_geometry(STRUCTURE_BOTTOM, &bake, BVHD_UNSUPPORTED, BVHD_VUID_NONE, "infos[3].geometries[0].geometryType");
    validate_micromaps = true;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(flags_are_checked),
        cmocka_unit_test(a_micromap_has_one_geometry),
        cmocka_unit_test(many_triangles_are_too_many),
        cmocka_unit_test(a_closed_door_refuses),
    };
    return cmocka_run_group_tests(tests, open_door, NULL);
}
