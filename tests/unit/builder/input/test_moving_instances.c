/* SPDX-License-Identifier: Apache-2.0 */
/* test_moving_instances.c - tests the canonical form of motion instances, their rules, and their boxes. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/input/canonical_form.h"
#include "builder/input/primitive.h"
#include "builder/traverse/motion.h"
#include "tests/support/builder/prepare_bed.h"
#include "tests/support/random.h"

/* Records keep their types and numbers; references become rows in the order of first use. */
static void records_are_copied(void **state)
{
    (void)state;
    static const uint64_t rows[INPUTS_MOTION_RECORDS] = {1, 0, 2, 1, 0};
    static const int numbers[MOTION_TYPES] = {12, 12, 16};
    struct test_input test;
    inputs_motion_instances(&test);
    struct canonical canonical = bed_make(&test);
    const struct canonical_geometry *geometry = canonical.geometries;
    assert_int_equal(bytes_get32(canonical.bytes + 4), CANONICAL_VERSION_ROUND);
    assert_int_equal(canonical.reference_count, 2);
    assert_true(canonical_moves(&canonical));
    for (uint32_t i = 0; i < INPUTS_MOTION_RECORDS; i++) {
        const uint32_t *record = test.motion_records[i];
        const struct canonical_motion motion = canonical_motion(geometry, i);
        const struct canonical_instance instance = canonical_instance(geometry, i);
        const int count = numbers[record[0]];
        assert_int_equal(motion.type, record[0]);
        assert_memory_equal(motion.start, record + 2, 4 * count);
        assert_memory_equal(motion.end, record + 2 + (record[0] == MOTION_STATIC ? 0 : count), 4 * count);
        for (int k = count; k < 16; k++)
            assert_true(motion.start[k] == 0 && motion.end[k] == 0);
        assert_int_equal(instance.reference, rows[i]);
        assert_int_equal(instance.custom_index, 0x123450 + i);
        assert_int_equal(instance.mask, 0xff);
        assert_int_equal(instance.sbt_offset, 0x54321 + i);
        if (record[0] != MOTION_SRT)
            assert_memory_equal(instance.transform, record + 2, sizeof instance.transform);
    }
    bed_finish(&canonical);
}

/* Bytes that the type of a record does not use are no part of the copy. */
static void unused_bytes_do_not_count(void **state)
{
    (void)state;
    static const uint32_t used[INPUTS_MOTION_RECORDS] = {18, 18, 30, 38, 38};
    struct test_input test, other;
    inputs_motion_instances(&test);
    inputs_motion_instances(&other);
    for (int i = 0; i < INPUTS_MOTION_RECORDS; i++)
        for (uint32_t word = used[i]; word < 40; word++)
            other.motion_records[i][word] = 0xfeedbeef;
    bed_compare(&test, &other, true);
    for (int i = 0; i < INPUTS_MOTION_RECORDS; i++) {
        inputs_motion_instances(&other);
        other.motion_records[i][used[i] - 4] ^= 1;
        bed_compare(&test, &other, false);
    }
}

static void refuse(const struct test_input *test, const char *rule, const char *field)
{
    char where[200];
    snprintf(where, sizeof where, "infos[2].geometries[0].instances%s", field);
    bed_refuse(test, BVHD_INVALID, rule, where);
}

static void set_reference(struct test_input *test, int index, int word, uint64_t reference)
{
    memcpy(test->motion_records[index] + word, &reference, sizeof reference);
}

static void contents_are_checked(void **state)
{
    (void)state;
    static const struct {
        int record, fields;
        const char *place, *rule;
    } flags[] = {
        {0, 14, "[0].data.staticInstance.flags", "VUID-VkAccelerationStructureInstanceKHR-flags-parameter"},
        {2, 26, "[2].data.matrixMotionInstance.flags",
         "VUID-VkAccelerationStructureMatrixMotionInstanceNV-flags-parameter"},
        {3, 34, "[3].data.srtMotionInstance.flags", "VUID-VkAccelerationStructureSRTMotionInstanceNV-flags-parameter"},
    };
    static const char *const singular = "VUID-VkTransformMatrixKHR-matrix-03799";
    struct test_input test;
    for (size_t i = 0; i < sizeof flags / sizeof *flags; i++) {
        inputs_motion_instances(&test);
        test.motion_records[flags[i].record][flags[i].fields + 1] |= 0x80000000;
        refuse(&test, flags[i].rule, flags[i].place);
        inputs_motion_instances(&test);
        test.motion_records[flags[i].record][flags[i].fields + 1] |= 0x0c000000;
        refuse(&test, flags[i].rule, flags[i].place);
    }
    for (uint32_t type = MOTION_TYPES; type > 0 && type < UINT32_MAX / 3; type *= 3) {
        inputs_motion_instances(&test);
        test.motion_records[4][0] = type;
        refuse(&test, "VUID-VkAccelerationStructureMotionInstanceNV-type-parameter", "[4].type");
    }
    inputs_motion_instances(&test);
    test.motion_records[1][1] = 1;
    refuse(&test, "VUID-VkAccelerationStructureMotionInstanceNV-flags-zerobitmask", "[1].flags");
    inputs_motion_instances(&test);
    set_reference(&test, 3, 36, 78);
    refuse(&test, "VUID-vkBuildAccelerationStructuresKHR-pInfos-04930", "[3].accelerationStructureReference");
    inputs_motion_instances(&test);
    memset(test.motion_records[0] + 2, 0, 48);
    refuse(&test, singular, "[0].data.staticInstance.transform");
    for (int key = 0; key < 2; key++) {
        inputs_motion_instances(&test);
        memset(test.motion_records[2] + 2 + 12 * (ptrdiff_t)key, 0, 48);
        refuse(&test, singular,
               key ? "[2].data.matrixMotionInstance.transformT1" : "[2].data.matrixMotionInstance.transformT0");
    }
    inputs_motion_instances(&test); /* scales of an SRT may be 0, and inactive instances have any matrix */
    memset(test.motion_records[3] + 2, 0, 128);
    memset(test.motion_records[1] + 2, 0, 48);
    struct canonical canonical = bed_make(&test);
    bed_finish(&canonical);
}

/* A block from elsewhere is opened as it was made, and refused where nobody would have made it. */
static void blocks_are_opened(void **state)
{
    (void)state;
    struct test_input test;
    struct canonical view;
    struct bvhd_error error;
    inputs_motion_instances(&test);
    struct canonical canonical = bed_make(&test);
    unsigned char *bytes = malloc(canonical.size);
    assert_non_null(bytes);
    const struct bytes block = {bytes, canonical.size};
    unsigned char *records = bytes + (canonical.geometries[0].instances - canonical.bytes);
    memcpy(bytes, canonical.bytes, canonical.size);
    assert_int_equal(prepare_open(block, &bed_memory, &view, NULL), BVHD_OK);
    assert_memory_equal(view.geometries[0].instances, canonical.geometries[0].instances,
                        MOTION_RECORD_STRIDE * INPUTS_MOTION_RECORDS);
    prepare_finish(&view, &bed_memory);
    records[0] = MOTION_TYPES;
    assert_int_equal(prepare_open(block, &bed_memory, &view, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "geometries[0].instances");
    memcpy(bytes, canonical.bytes, canonical.size);
    records[MOTION_RECORD_STRIDE - 1] = 1;
    assert_int_equal(prepare_open(block, &bed_memory, &view, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "geometries[0].instances");
    memcpy(bytes, canonical.bytes, canonical.size);
    records[4] = 1;
    assert_int_equal(prepare_open(block, &bed_memory, &view, &error), BVHD_INVALID);
    memcpy(bytes, canonical.bytes, canonical.size);
    bytes_put64(records + 64, 2);
    assert_int_equal(prepare_open(block, &bed_memory, &view, &error), BVHD_CORRUPT);
    memcpy(bytes, canonical.bytes, canonical.size);
    ((struct form_header *)(void *)bytes)->flags = 0;
    assert_int_equal(prepare_open(block, &bed_memory, &view, &error), BVHD_CORRUPT);
    free(bytes);
    bed_finish(&canonical);
}

/* One motion instance of a structure with these bounds. */
struct moving {
    uint32_t record[40];
    struct canonical_geometry geometry;
    struct canonical_reference reference;
    struct canonical canonical;
};

static struct canonical *set(struct moving *moving, uint32_t type, const float *start, const float *end, uint32_t flags)
{
    const size_t size = type == MOTION_SRT ? 64 : 48;
    unsigned char *at = (unsigned char *)(moving->record + 2);
    memset(moving->record, 0, sizeof moving->record);
    moving->record[0] = type;
    memcpy(at, start, size);
    at += size;
    if (type != MOTION_STATIC) {
        memcpy(at, end, size);
        at += size;
    }
    bytes_put64(at + 8, 1);
    moving->geometry = (struct canonical_geometry){
        .type = GEOMETRY_MOVING_INSTANCES, .primitive_count = 1, .instances = (const unsigned char *)moving->record};
    moving->canonical = (struct canonical){.type = STRUCTURE_TOP,
                                           .flags = BUILD_MOTION | flags,
                                           .geometry_count = 1,
                                           .reference_count = 1,
                                           .primitive_count = 1,
                                           .geometries = &moving->geometry,
                                           .references = &moving->reference};
    return &moving->canonical;
}

/* Counts the corners that are outside of the interpolated box at a time. */
static uint32_t outside(const struct portable_moving_instance *instance, const struct box *box,
                        const struct box keys[2], float time)
{
    float m[12];
    uint32_t count = 0;
    if (!motion_matrix(instance, time, m))
        return 0;
    for (int corner = 0; corner < 8; corner++)
        for (int row = 0; row < 3; row++) {
            double x = m[4 * row + 3];
            for (int axis = 0; axis < 3; axis++)
                x += (double)m[4 * row + axis] * (corner >> axis & 1 ? box->max[axis] : box->min[axis]);
            count += !(x >= keys[0].min[row] * (1 - (double)time) + keys[1].min[row] * (double)time &&
                       x <= keys[0].max[row] * (1 - (double)time) + keys[1].max[row] * (double)time);
        }
    return count;
}

/*
 * Instances of all types hold their structure at all times; those of matrices are hardly larger than it at both ends.
 */
static void boxes_hold_the_structure(void **state)
{
    (void)state;
    struct random random = {9};
    uint32_t beyond = 0;
    for (int i = 0; i < 3000; i++) {
        const uint32_t type = (uint32_t)i % MOTION_TYPES;
        const double scale = exp2(random_between(&random, -10, 10)), place = exp2(random_between(&random, -10, 20));
        struct portable_moving_instance instance = {.motion = type};
        struct moving moving;
        struct box keys[2], both, *bounds = &moving.reference.bounds;
        memset(&moving, 0, sizeof moving);
        for (int axis = 0; axis < 3; axis++) {
            bounds->min[axis] = (float)(place * random_between(&random, -1, 1));
            bounds->max[axis] = bounds->min[axis] + (float)random_between(&random, 0, 2);
        }
        for (int k = 0; k < (type == MOTION_SRT ? 16 : 12); k++) {
            instance.start[k] = (float)(scale * random_between(&random, -1, 1));
            instance.end[k] =
                type == MOTION_STATIC ? instance.start[k] : (float)(scale * random_between(&random, -1, 1));
        }
        const struct canonical *canonical = set(&moving, type, instance.start, instance.end, 0);
        primitive_key_boxes(canonical, canonical->geometries, 0, keys);
        both = primitive_box(canonical, canonical->geometries, 0);
        assert_true(box_contains(&both, &keys[0]) && box_contains(&both, &keys[1]));
        for (int t = 0; t <= 64; t++)
            beyond += outside(&instance, bounds, keys, (float)t / 64);
    }
    assert_int_equal(beyond, 0);
}

/* Checks how an instance is counted, without and with ALLOW_UPDATE, which keeps all that are active. */
static void check(struct moving *moving, uint32_t type, const float *start, const float *end, bool active,
                  bool degenerate, bool kept)
{
    for (uint32_t flags = 0; flags < 2; flags++) {
        const struct canonical *canonical = set(moving, type, start, end, flags ? BUILD_ALLOW_UPDATE : 0);
        const bool has_ref = flags ? active : kept;
        struct primitive_refs refs;
        struct box boxes[2];
        assert_int_equal(primitive_collect_blocks(canonical, NULL, &bed_context, &refs, NULL), BVHD_OK);
        assert_int_equal(refs.count, has_ref);
        assert_int_equal(refs.inactive, !active);
        assert_int_equal(refs.degenerate, degenerate);
        assert_int_equal(refs.skipped, active && !has_ref);
        primitive_key_boxes(canonical, canonical->geometries, 0, boxes);
        for (int key = 0; key < 2; key++) {
            assert_int_equal(box_is_empty(&boxes[key]), !has_ref);
            for (int axis = 0; axis < 3; axis++)
                assert_true(isfinite(boxes[key].min[axis]) && isfinite(boxes[key].max[axis]));
        }
        memory_free(&bed_memory, refs.refs);
        memory_free(&bed_memory, refs.blocks);
        assert_int_equal(bed_memory.live, 0);
    }
}

static void instances_are_classified(void **state)
{
    (void)state;
    static const float identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    static const float srt[16] = {1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0};
    for (uint32_t type = 0; type < MOTION_TYPES; type++) {
        const int count = type == MOTION_SRT ? 16 : 12;
        struct moving moving = {.reference = {.bounds = {{0, 0, 0}, {1, 1, 1}}}};
        float keys[2][16];
        for (int number = -1; number < (type == MOTION_STATIC ? 1 : 2) * count; number++)
            for (int bad = 0; bad < 2; bad++) {
                for (int key = 0; key < 2; key++)
                    memcpy(keys[key], type == MOTION_SRT ? srt : identity, (size_t)count * 4);
                if (number >= 0)
                    keys[number / count][number % count] = bad ? INFINITY : NAN;
                check(&moving, type, keys[0], keys[1], number < 0 || bad, false, number < 0);
            }
        moving.reference.bounds = box_empty();
        for (int key = 0; key < 2; key++)
            memcpy(keys[key], type == MOTION_SRT ? srt : identity, (size_t)count * 4);
        check(&moving, type, keys[0], keys[1], true, true, false);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(records_are_copied),       cmocka_unit_test(unused_bytes_do_not_count),
        cmocka_unit_test(contents_are_checked),     cmocka_unit_test(blocks_are_opened),
        cmocka_unit_test(boxes_hold_the_structure), cmocka_unit_test(instances_are_classified),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
