/* SPDX-License-Identifier: Apache-2.0 */
/* test_micromap.c - tests the copies of opacity micromaps: what they hold, and the rules about what is in memory. */
#include "tests/support/unit.h"

#include "builder/build.h"
#include "builder/format/portable_micromap.h"
#include "builder/format/size_bound.h"
#include "tests/support/builder/prepare_bed.h"
#include "tests/support/builder/random_micromap.h"

enum { COUNT = 5 };

static int open_door(void **state)
{
    (void)state;
    validate_micromaps = true;
    return 0;
}

/* A micromap that tests change. */
struct subject {
    struct test_input test;
    struct micromap_triangle triangles[COUNT];
    unsigned char states[24];
    struct micromap_usage usages[4];
};

/* Two triangles of the same states, one of others, one of the same bytes in the other format, and one of level 0. */
static void start(struct subject *s)
{
    static const struct micromap_triangle triangles[COUNT] = {
        {10, 2, MICRO_4_STATE}, {2, 2, MICRO_4_STATE}, {10, 1, MICRO_2_STATE}, {14, 2, MICRO_4_STATE}, {0, 0, 1}};
    static const struct micromap_usage usages[4] = {{2, 2, 2}, {1, 1, 1}, {1, 0, 1}, {1, 2, 2}};
    inputs_start(&s->test, STRUCTURE_MICROMAP, 1);
    memcpy(s->triangles, triangles, sizeof triangles);
    memcpy(s->usages, usages, sizeof usages);
    for (uint32_t i = 0; i < sizeof s->states; i++)
        s->states[i] = (unsigned char)(i % 4 + 0xc0 * (i < 4));
    s->states[0] = 0xff;
    s->test.geometries[0] =
        (struct geometry){.type = GEOMETRY_MICROMAP,
                          .micromap = {.usages = {(const unsigned char *)s->usages, sizeof s->usages},
                                       .states = {s->states, sizeof s->states},
                                       .triangles = {(const unsigned char *)s->triangles, sizeof s->triangles},
                                       .stride = 8},
                          .range.primitive_count = COUNT};
}

static void equal_states_are_shared(void **state)
{
    (void)state;
    struct subject s;
    start(&s);
    struct canonical canonical = bed_make(&s.test);
    const struct canonical_geometry *geometry = &canonical.geometries[0];
    static const uint32_t offsets[COUNT] = {0, 4, 8, 0, 9};
    assert_int_equal(canonical.type, STRUCTURE_MICROMAP);
    assert_int_equal(canonical.primitive_count, COUNT);
    assert_int_equal(geometry->vertex_count, 10);
    for (uint32_t i = 0; i < COUNT; i++)
        assert_int_equal(geometry->micro_triangles[i].offset, offsets[i]);
    assert_memory_equal(geometry->states, s.states + 10, 4);
    assert_memory_equal(geometry->states + 4, s.states + 2, 4);
    assert_int_equal(geometry->states[8], s.states[10] & 15); /* four micro-triangles of one bit */
    assert_int_equal(geometry->states[9], 1);
    bed_finish(&canonical);
}

static void what_decides_nothing_is_not_copied(void **state)
{
    (void)state;
    struct subject a, b;
    start(&a);
    start(&b);
    b.states[9] ^= 0x55; /* no triangle has it */
    b.states[0] = 1; /* bits beyond the state */
    b.triangles[3].offset = 10;
    b.usages[0].count = 1;
    b.usages[3].count = 2;
    bed_compare(&a.test, &b.test, true);
    b.states[11] ^= 1;
    bed_compare(&a.test, &b.test, false);
    start(&b);
    b.test.input.flags = BUILD_ALLOW_COMPACTION;
    bed_compare(&a.test, &b.test, false);
}

#define EXT "VUID-Vk"
#define BUILD "VUID-VkAccelerationStructureBuildGeometryInfoKHR-"
#define DATA "VUID-VkAccelerationStructureGeometryMicromapDataKHR-"
#define PLACE "infos[2].geometries[0].micromap."

/* Changes the micromap, expects an error, and makes it again. */
#define REFUSE(change, vuid, where)                                                                                    \
    do {                                                                                                               \
        start(&s);                                                                                                     \
        change;                                                                                                        \
        bed_refuse(&s.test, BVHD_INVALID, vuid, where);                                                                \
    } while (0)

static void wrong_usages_are_refused(void **state)
{
    (void)state;
    struct subject s;
    struct geometry_micromap *micromap = &s.test.geometries[0].micromap;
    REFUSE(s.usages[1].format = 0, EXT "MicromapUsageEXT-format-07519", PLACE "usageCounts[1]");
    REFUSE(s.usages[1].format = 3, EXT "MicromapUsageEXT-format-07519", PLACE "usageCounts[1]");
    REFUSE(s.usages[1].level = 13, DATA "subdivisionLevel-11645", PLACE "usageCounts[1]");
    REFUSE(s.usages[0].level = 13, BUILD "subdivisionLevel-11564", PLACE "usageCounts[0]");
    REFUSE(s.usages[0].level = 13;
           s.test.input.flags = BUILD_MICROMAP_LOSSY, BUILD "subdivisionLevel-11565", PLACE "usageCounts[0]");
    REFUSE(s.test.input.flags = BUILD_MICROMAP_LOSSY, BUILD "format-11712", PLACE "usageCounts[1]");
    REFUSE(s.usages[2].count = 2, "", PLACE "usageCounts"); /* more than there are */
    REFUSE(s.usages[2].level = 1, "", PLACE "usageCounts"); /* others than there are */
    REFUSE(s.test.geometries[0].range.primitive_count = 4, "", PLACE "usageCounts");
    REFUSE(micromap->usages.size--, "", PLACE "usageCounts");
    start(&s);
    s.usages[0] = (struct micromap_usage){3, 2, 2};
    micromap->usages.size -= 12;
    struct canonical canonical = bed_make(&s.test);
    bed_finish(&canonical);
}

static void wrong_triangles_are_refused(void **state)
{
    (void)state;
    struct subject s;
    REFUSE(s.triangles[4].format = 0, EXT "MicromapTriangleEXT-format-07522", PLACE "triangleArray[4]");
    REFUSE(s.triangles[4].format = 3, EXT "MicromapTriangleEXT-format-07522", PLACE "triangleArray[4]");
    REFUSE(s.triangles[4].level = 13, EXT "MicromapTriangleEXT-format-07523", PLACE "triangleArray[4]");
    REFUSE(s.triangles[0].level = 13, BUILD "subdivisionLevel-11566", PLACE "triangleArray[0]");
    REFUSE(s.triangles[0].offset = 21, "VUID-vkBuildMicromapsEXT-pInfos-07553", PLACE "triangleArray[0]");
    REFUSE(s.triangles[0].offset = UINT32_MAX, "VUID-vkBuildMicromapsEXT-pInfos-07553", PLACE "triangleArray[0]");
    start(&s);
    s.triangles[0].offset = 20;
    struct canonical canonical = bed_make(&s.test);
    bed_finish(&canonical);
}

/* Makes all triangles 4-state, with so many usages. */
static void make_lossy(struct subject *s)
{
    start(s);
    s->test.input.flags = BUILD_MICROMAP_LOSSY;
    s->triangles[2] = s->triangles[4] = s->triangles[0];
    s->usages[0].count = COUNT;
    s->test.geometries[0].micromap.usages.size = 12;
}

static void lossy_micromaps_have_four_states(void **state)
{
    (void)state;
    struct subject s;
    make_lossy(&s);
    struct canonical canonical = bed_make(&s.test);
    bed_finish(&canonical);
    s.triangles[2].format = MICRO_2_STATE;
    bed_refuse(&s.test, BVHD_INVALID, BUILD "format-11713", PLACE "triangleArray[2]");
    make_lossy(&s);
    s.triangles[2].level = 13;
    bed_refuse(&s.test, BVHD_INVALID, BUILD "subdivisionLevel-11567", PLACE "triangleArray[2]");
}

static void memory_has_to_be_there(void **state)
{
    (void)state;
    struct subject s;
    struct geometry_micromap *micromap = &s.test.geometries[0].micromap;
    REFUSE(micromap->states.data = NULL, "VUID-vkBuildMicromapsEXT-pInfos-07553", PLACE "data");
    REFUSE(micromap->triangles.data = NULL, "VUID-vkBuildMicromapsEXT-pInfos-07554", PLACE "triangleArray");
    REFUSE(micromap->triangles.size--, "VUID-vkBuildMicromapsEXT-pInfos-07554", PLACE "triangleArray");
    REFUSE(micromap->stride = UINT64_MAX - 7, "VUID-vkBuildMicromapsEXT-pInfos-07554", PLACE "triangleArray");
    start(&s);
    s.test.geometries[0].range.primitive_count = 0; /* then no memory is needed */
    *micromap = (struct geometry_micromap){.stride = 8};
    struct canonical canonical = bed_make(&s.test);
    assert_int_equal(canonical.primitive_count, 0);
    bed_finish(&canonical);
}

static void failures_hold_nothing(void **state)
{
    (void)state;
    struct subject s;
    struct canonical canonical;
    struct bvhd_error error;
    struct limits limits = limits_default();
    atomic_bool cancel = true;
    struct build_context context = bed_context;
    start(&s);
    for (int64_t fail = 0; fail < 5; fail++) {
        bed_memory.fail_after = fail;
        assert_int_equal(bed_try(&s.test, &canonical, &error), BVHD_NO_MEMORY);
        assert_int_equal(bed_memory.live, 0);
    }
    bed_memory.fail_after = -1;
    context.cancel = &cancel;
    assert_int_equal(prepare(&s.test.input, 2, &limits, &context, &canonical, &error), BVHD_CANCELLED);
    limits.max_canonical_bytes = 9;
    assert_int_equal(prepare(&s.test.input, 2, &limits, &bed_context, &canonical, &error), BVHD_TOO_LARGE);
    limits.max_canonical_bytes = 128 + 48 + 15;
    assert_int_equal(prepare(&s.test.input, 2, &limits, &bed_context, &canonical, &error), BVHD_TOO_LARGE);
    limits.max_canonical_bytes = 128 + 48 + 16;
    assert_int_equal(prepare(&s.test.input, 2, &limits, &bed_context, &canonical, &error), BVHD_OK);
    bed_finish(&canonical);
}

/* Every triangle of a built micromap has the states that the request says. */
static void random_micromaps_are_built(void **state)
{
    (void)state;
    struct random random = {1};
    for (uint32_t round = 0; round < 300; round++) {
        struct random_micromap micromap;
        struct portable_micromap_view view;
        struct bvhd_error error;
        random_micromap_make(&random, round % 40, round % 7, 0, &micromap);
        assert_int_equal(portable_micromap_open(micromap.blob, &view, &error), BVHD_OK);
        assert_int_equal(view.header->triangle_count, micromap.count);
        assert_true(view.header->states_size <= micromap.states_size * 16 + 16);
        for (uint32_t t = 0; t < micromap.count; t++) {
            const struct micromap_triangle asked = random_micromap_triangle(&micromap, t);
            assert_int_equal(view.triangles[t].level, asked.level);
            assert_int_equal(view.triangles[t].format, asked.format);
            for (uint32_t i = 0; i < micro_triangle_count(asked.level); i++)
                assert_int_equal(
                    micro_triangle_state(view.states + view.triangles[t].offset, (enum micro_format)asked.format, i),
                    micro_triangle_state(micromap.states + asked.offset, (enum micro_format)asked.format, i));
        }
        const struct build_input input = {.type = STRUCTURE_MICROMAP,
                                          .geometry_count = 1,
                                          .geometries = &micromap.geometry,
                                          .options.target = TARGET_PORTABLE};
        assert_true(size_bound(&input) >= view.header->body_size);
        random_micromap_finish(&micromap);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equal_states_are_shared),
        cmocka_unit_test(what_decides_nothing_is_not_copied),
        cmocka_unit_test(wrong_usages_are_refused),
        cmocka_unit_test(wrong_triangles_are_refused),
        cmocka_unit_test(lossy_micromaps_have_four_states),
        cmocka_unit_test(memory_has_to_be_there),
        cmocka_unit_test(failures_hold_nothing),
        cmocka_unit_test(random_micromaps_are_built),
    };
    return cmocka_run_group_tests(tests, open_door, NULL);
}
