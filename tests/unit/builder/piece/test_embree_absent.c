/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_embree_absent.c - tests that a build of bvhd without Embree refuses that builder by name, and nothing else. The
 * program links embree_absent.c in place of embree.c.
 */
#include "tests/support/unit.h"

#include "builder/build.h"
#include "builder/content_key.h"
#include "builder/method.h"
#include "tests/support/builder/test_ir.h"

static void the_builder_is_refused_by_name(void **state)
{
    (void)state;
    const struct test_shape shape = {
        .type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 100, .size = 1, .detail = 0.1};
    struct build_options options = {.quality = QUALITY_FAST, .target = TARGET_PORTABLE, .builder = BUILDER_EMBREE};
    struct memory memory;
    struct test_model model;
    struct build_stats stats;
    struct bvhd_error error;
    struct key key;
    unsigned char *blob;
    memory_init(&memory, UINT64_MAX);
    const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    test_model_make(&shape, 1, &model);
    assert_int_equal(method_builders(), 1U << BUILDER_OWN);
    assert_int_equal(content_key(&model.canonical, &options, &context, &key, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.where, "build.builder");
    assert_non_null(strstr(error.text, "without Embree"));
    assert_int_equal(build(&model.canonical, &options, &context, &blob, &stats, &error), BVHD_UNSUPPORTED);
    assert_string_equal(error.where, "build.builder");
    options.builder = BUILDER_OWN;
    assert_int_equal(content_key(&model.canonical, &options, &context, &key, &error), BVHD_OK);
    assert_int_equal(build(&model.canonical, &options, &context, &blob, &stats, &error), BVHD_OK);
    memory_free(&memory, blob);
    test_model_finish(&model);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_builder_is_refused_by_name),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
