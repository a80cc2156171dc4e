/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_format.c - tests the target and the native format of a build: in options, on the wire, and with older programs
 * and daemons.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/client/client_bed.h"
#include "client/format.h"

static struct bvhd_format lavapipe(uint32_t variant)
{
    struct bvhd_format format = {.struct_size = sizeof format, .target = BVHD_TARGET_LAVAPIPE, .variant = variant};
    memset(format.driver_uuid, 0x21, sizeof format.driver_uuid);
    memset(format.compatibility_uuid, 0x43, sizeof format.compatibility_uuid);
    return format;
}

static void test_names(void **state)
{
    (void)state;
    assert_string_equal(bvhd_target_name(BVHD_TARGET_PORTABLE), "portable");
    assert_string_equal(bvhd_target_name(BVHD_TARGET_LAVAPIPE), "lavapipe");
    assert_null(bvhd_target_name((enum bvhd_target)0));
    assert_null(bvhd_target_name((enum bvhd_target)77));
}

static void test_options(void **state)
{
    (void)state;
    struct bvhd_format format = lavapipe(2);
    struct bvhd_build build = {.struct_size = sizeof build,
                               .quality = BVHD_QUALITY_HIGH,
                               .layout_flags = BVHD_PORTABLE_FAST_TRIANGLES,
                               .rays_per_primitive = 2.5f};
    static const struct device_format none;
    struct build_options options;
    assert_int_equal(format_options(&build, &options, NULL), BVHD_OK);
    assert_int_equal(options.quality, QUALITY_HIGH);
    assert_true(options.rays_per_primitive == 2.5f);
    assert_int_equal(options.layout_flags, PORTABLE_FAST_TRIANGLES);
    assert_int_equal(options.target, TARGET_PORTABLE);
    assert_memory_equal(&options.device, &none, sizeof none);
    build.format = &format;
    build.layout_flags = 0;
    for (int named = 0; named < 2; named++) {
        build.target = named ? BVHD_TARGET_LAVAPIPE : (enum bvhd_target)0;
        memset(&options, 0xee, sizeof options);
        assert_int_equal(format_options(&build, &options, NULL), BVHD_OK);
        assert_int_equal(options.target, TARGET_LAVAPIPE);
        assert_int_equal(options.device.variant, 2);
        assert_memory_equal(options.device.driver_uuid, format.driver_uuid, 16);
        assert_memory_equal(options.device.compatibility_uuid, format.compatibility_uuid, 16);
    }
    build.format = NULL;
    build.target = (enum bvhd_target)77; /* a newer daemon may know this target */
    assert_int_equal(format_options(&build, &options, NULL), BVHD_OK);
    assert_int_equal(options.target, 77);
}

static void refuse_at(const struct bvhd_build *build, const char *where, const char *text)
{
    struct build_options options, before;
    struct bvhd_error error = {0};
    memset(&options, 0xab, sizeof options);
    before = options;
    assert_int_equal(format_options(build, &options, &error), BVHD_INVALID);
    assert_string_equal(error.where, where);
    if (!strstr(error.text, text))
        fail_msg("'%s' is not in '%s'", text, error.text);
    assert_memory_equal(&options, &before, sizeof options);
    assert_int_equal(format_options(build, &options, NULL), BVHD_INVALID);
}

static void refuse(const struct bvhd_build *build, const char *text)
{
    refuse_at(build, "build.format", text);
}

static void test_wrong_formats(void **state)
{
    (void)state;
    struct bvhd_format format = lavapipe(1);
    struct bvhd_build build = {.struct_size = sizeof build, .target = BVHD_TARGET_LAVAPIPE};
    refuse(&build, "lavapipe");
    build.format = &format;
    build.target = BVHD_TARGET_PORTABLE;
    refuse(&build, "lavapipe");
    format.target = BVHD_TARGET_PORTABLE;
    build.target = BVHD_TARGET_LAVAPIPE;
    refuse(&build, "portable");
    format = lavapipe(1);
    format.struct_size = 0;
    refuse_at(&build, "build.format.struct_size", "sizeof(struct bvhd_format)");
    format.struct_size = sizeof format - 1;
    refuse_at(&build, "build.format.struct_size", "sizeof(struct bvhd_format)");
    struct { /* the struct of a newer program */
        struct bvhd_format format;
        uint64_t more;
    } newer = {lavapipe(1), 0};
    newer.format.struct_size = sizeof newer;
    build.format = &newer.format;
    assert_int_equal(format_options(&build, &(struct build_options){0}, NULL), BVHD_OK);
    newer.more = 1;
    struct bvhd_error error;
    assert_int_equal(format_options(&build, &(struct build_options){0}, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.where, "build.format.struct_size");
}

/* For programs that were compiled before there were formats, the bytes behind their struct are not read. */
static void test_older_programs(void **state)
{
    (void)state;
    struct build_options options;
    struct bvhd_build build = {.struct_size = FORMAT_BUILD_WITHOUT};
    memset(&build.format, 0xff, sizeof build.format);
    assert_int_equal(format_options(&build, &options, NULL), BVHD_OK);
    assert_int_equal(options.target, TARGET_PORTABLE);
    build.target = BVHD_TARGET_LAVAPIPE;
    refuse(&build, "lavapipe");
    build = (struct bvhd_build){.struct_size = FORMAT_BUILD_RAYLESS, .rays_per_primitive = NAN};
    assert_int_equal(format_options(&build, &options, NULL), BVHD_OK);
    assert_true(options.rays_per_primitive == 0);
    build.deadline_ms = 1;
    assert_int_equal(options.builder, BUILDER_OWN);
    build.builder = BVHD_BUILDER_EMBREE;
    assert_int_equal(format_options(&build, &options, NULL), BVHD_OK);
    assert_int_equal(format_deadline(&build), 0);
    build.struct_size = FORMAT_BUILD_BUILDERLESS;
    refuse_at(&build, "build.rays_per_primitive", "nan");
    build.rays_per_primitive = 0;
    assert_int_equal(format_options(&build, &options, NULL), BVHD_OK);
    assert_int_equal(options.builder, BUILDER_OWN);
    build.struct_size = sizeof build;
    assert_int_equal(format_deadline(&build), 1);
    assert_int_equal(format_options(&build, &options, NULL), BVHD_OK);
    assert_int_equal(options.builder, BUILDER_EMBREE);
    build.builder = (enum bvhd_builder)2;
    refuse_at(&build, "build.builder", "2 is no value of enum bvhd_builder");
    build.builder = BVHD_BUILDER_OWN;
    build.reserved = 1;
    refuse_at(&build, "build.reserved", "1 instead of 0");
    struct client_bed bed;
    struct bvhd_batch *batch;
    bed_start(&bed);
    bed_describe(bed.asked, 1, 1);
    static const size_t right[] = {FORMAT_BUILD_BUILDERLESS, FORMAT_BUILD_RAYLESS, FORMAT_BUILD_WITHOUT};
    for (size_t i = 0; i < sizeof right / sizeof right[0]; i++) {
        bed.asked->build.struct_size = right[i];
        memset((char *)&bed.asked->build + right[i], 0xff, sizeof build - right[i]);
        assert_int_equal(bvhd_batch_submit(bed.client, &bed.asked->build, &batch, NULL), BVHD_OK);
        assert_int_equal(bed_status(batch, 0), BVHD_PENDING);
        bvhd_batch_destroy(batch);
    }
    static const size_t wrong[] = {0, 8, FORMAT_BUILD_WITHOUT - 1, FORMAT_BUILD_WITHOUT + 1, sizeof build - 1};
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        struct bvhd_error error;
        bed.asked->build.struct_size = wrong[i];
        assert_int_equal(bvhd_batch_submit(bed.client, &bed.asked->build, &batch, &error), BVHD_INVALID);
        assert_string_equal(error.where, "build.struct_size");
    }
    assert_true(bed_stop(&bed));
}

static struct bvhd_batch *submit_native(struct client_bed *bed, uint32_t count)
{
    struct bvhd_batch *batch = NULL;
    struct bvhd_format format = lavapipe(2);
    bed_describe(bed->asked, count, 1);
    bed->asked->build.format = &format; /* not needed after the call */
    assert_int_equal(bvhd_batch_submit(bed->client, &bed->asked->build, &batch, NULL), BVHD_OK);
    return batch;
}

static void test_items(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    struct bvhd_format format = lavapipe(2);
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = submit_native(&bed, 3);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    struct control_build *build = fake_build(&bed.fake, &frame);
    assert_int_equal(build->item_count, 3);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(build->items[i].target, TARGET_LAVAPIPE);
        assert_int_equal(build->items[i].device.variant, 2);
        assert_memory_equal(build->items[i].device.driver_uuid, format.driver_uuid, 16);
        assert_memory_equal(build->items[i].device.compatibility_uuid, format.compatibility_uuid, 16);
    }
    fake_free(&bed.fake, build);
    struct control_result result = {.item = 1, .size = 3, .summary = {.target = TARGET_LAVAPIPE}};
    fake_send_prepared(&bed.fake, frame.header.request, 0, 3);
    fake_send_result_with(&bed.fake, frame.header.request, &result, (struct bytes){(const unsigned char *)"abc", 3},
                          -1);
    result.item = 0;
    result.summary.target = TARGET_PORTABLE;
    fake_send_result_with(&bed.fake, frame.header.request, &result, (struct bytes){(const unsigned char *)"abc", 3},
                          -1);
    fake_send_failed(&bed.fake, frame.header.request, 2, BVHD_INVALID, "infos[2].options.device");
    assert_true(bed_finish(&bed, batch));
    assert_int_equal(bvhd_batch_result(batch, 1)->target, BVHD_TARGET_LAVAPIPE);
    assert_int_equal(bvhd_batch_result(batch, 0)->target, BVHD_TARGET_PORTABLE);
    assert_string_equal(bvhd_batch_result(batch, 2)->error.where, "infos[2].options.device");
    bed_end(&bed, batch);
}

/* A daemon of the previous version cannot read the rows' device fields, and refuses the request as a whole. */
static void test_older_daemon(void **state)
{
    (void)state;
    struct client_bed bed;
    struct frame frame;
    bed_start(&bed);
    assert_true(bed_connect(&bed));
    struct bvhd_batch *batch = submit_native(&bed, 2);
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    fake_send_error(&bed.fake, frame.header.request, BVHD_UNSUPPORTED, "infos[0]", "fields of a newer version");
    assert_true(bed_finish(&bed, batch));
    for (uint32_t i = 0; i < 2; i++) {
        assert_int_equal(bed_status(batch, i), BVHD_UNSUPPORTED);
        assert_string_equal(bvhd_batch_result(batch, i)->error.text, "fields of a newer version");
    }
    bvhd_batch_destroy(batch);
    batch = bed_submit(&bed, 1, 1); /* the connection goes on with requests that this daemon understands */
    assert_true(fake_expect(&bed.fake, FRAME_BUILD, &frame));
    struct control_build *build = fake_build(&bed.fake, &frame);
    static const struct device_format none;
    assert_int_equal(build->items[0].target, TARGET_PORTABLE);
    assert_memory_equal(&build->items[0].device, &none, sizeof none);
    fake_free(&bed.fake, build);
    bed_end(&bed, batch);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_names),          cmocka_unit_test(test_options), cmocka_unit_test(test_wrong_formats),
        cmocka_unit_test(test_older_programs), cmocka_unit_test(test_items),   cmocka_unit_test(test_older_daemon),
    };
    return cmocka_run_group_tests_name("format", tests, NULL, NULL);
}
