/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_micromap_submit.c - tests the requests of bvhd_micromap.h: the rules that only VkMicromapBuildInfoEXT shows, one
 * wrong info among right ones, and structs of the request that are wrong. What states and textures become is tested by
 * test_vulkan_input_micromap.c.
 */
#include "tests/support/unit.h"

#include <string.h>

#include <bvhd/bvhd_micromap.h>

enum { INFOS = 2 };

#define BUILD "VUID-VkMicromapBuildInfoEXT-"

static struct world {
    struct bvhd_client *client;
    VkMicromapUsageEXT usage;
    const VkMicromapUsageEXT *usage_pointer;
    VkMicromapTriangleEXT triangle;
    unsigned char states[16];
    float coordinates[3][2];
    VkMicromapBuildInfoEXT infos[INFOS];
    struct bvhd_micromap_bake bakes[INFOS];
    struct bvhd_micromap_build build;
    struct bvhd_error error;
} world;

/* Makes a right call with two equal micromaps. */
static void reset(void)
{
    world.usage = (VkMicromapUsageEXT){1, 0, VK_OPACITY_MICROMAP_FORMAT_2_STATE_EXT};
    world.usage_pointer = &world.usage;
    world.triangle = (VkMicromapTriangleEXT){0, 0, VK_OPACITY_MICROMAP_FORMAT_2_STATE_EXT};
    for (int i = 0; i < INFOS; i++) {
        world.infos[i] = (VkMicromapBuildInfoEXT){
            .sType = VK_STRUCTURE_TYPE_MICROMAP_BUILD_INFO_EXT,
            .type = VK_MICROMAP_TYPE_OPACITY_MICROMAP_EXT,
            .flags = VK_BUILD_MICROMAP_PREFER_FAST_TRACE_BIT_EXT | VK_BUILD_MICROMAP_ALLOW_COMPACTION_BIT_EXT,
            .usageCountsCount = 1,
            .pUsageCounts = &world.usage,
            .data.hostAddress = world.states,
            .triangleArray.hostAddress = &world.triangle,
            .triangleArrayStride = sizeof world.triangle,
        };
        world.bakes[i] = (struct bvhd_micromap_bake){
            .sType = BVHD_STRUCTURE_TYPE_MICROMAP_BAKE,
            .alpha = world.states,
            .width = 4,
            .height = 4,
            .row_stride = 4,
            .mode = BVHD_BAKE_BLEND,
            .format = VK_OPACITY_MICROMAP_FORMAT_4_STATE_KHR,
            .coordinates = world.coordinates,
            .coordinate_stride = 8,
            .vertex_count = 3,
            .triangle_count = 1,
            .index_type = VK_INDEX_TYPE_NONE_KHR,
        };
    }
    world.build =
        (struct bvhd_micromap_build){.struct_size = sizeof world.build, .info_count = INFOS, .infos = world.infos};
}

/* Submits and waits; the caller destroys the batch. */
static struct bvhd_batch *submit(void)
{
    struct bvhd_batch *batch = NULL;
    if (bvhd_micromap_submit(world.client, &world.build, &batch, &world.error) != BVHD_OK)
        fail_msg("%s: %s", world.error.where, world.error.text);
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    assert_int_equal(bvhd_batch_count(batch), world.build.info_count);
    return batch;
}

/* Checks that the second info breaks this rule, and that nothing is wrong with the first. */
static void refuse(const char *rule, const char *where)
{
    struct bvhd_batch *batch = submit();
    const struct bvhd_error *error = &bvhd_batch_result(batch, 1)->error;
    if (error->status != BVHD_INVALID || strcmp(bvhd_vuid_string(error->vuid), rule) != 0 ||
        strcmp(error->where, where) != 0)
        fail_msg("%s instead of %s at %s: %s", bvhd_vuid_string(error->vuid), rule, error->where, error->text);
    assert_int_not_equal(bvhd_batch_result(batch, 0)->error.status, BVHD_INVALID);
    bvhd_batch_destroy(batch);
    reset();
}

static void rules_are_checked(void **state)
{
    (void)state;
    const VkBaseInStructure stray = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO};
    reset();
    world.infos[1].sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
    refuse(BUILD "sType-sType", "infos[1].sType");
    world.infos[1].pNext = &stray;
    refuse(BUILD "pNext-pNext", "infos[1].pNext");
    world.infos[1].type = (VkMicromapTypeEXT)7;
    refuse(BUILD "type-parameter", "infos[1].type");
    world.infos[1].flags = 8;
    refuse(BUILD "flags-parameter", "infos[1].flags");
    world.infos[1].mode = (VkBuildMicromapModeEXT)1;
    refuse("VUID-vkBuildMicromapsEXT-mode-07462", "infos[1].mode");
    world.infos[1].ppUsageCounts = &world.usage_pointer;
    refuse(BUILD "pUsageCounts-07516", "infos[1].pUsageCounts");
    world.infos[1].pUsageCounts = NULL; /* the other form is right */
    world.infos[1].ppUsageCounts = &world.usage_pointer;
    struct bvhd_batch *batch = submit();
    assert_int_not_equal(bvhd_batch_result(batch, 1)->error.status, BVHD_INVALID);
    bvhd_batch_destroy(batch);
}

static void bakes_are_requested(void **state)
{
    (void)state;
    reset();
    world.build.infos = NULL;
    world.build.bakes = world.bakes;
    struct bvhd_batch *batch = submit();
    for (uint32_t i = 0; i < INFOS; i++)
        assert_int_not_equal(bvhd_batch_result(batch, i)->error.status, BVHD_INVALID);
    bvhd_batch_destroy(batch);
}

static void no_infos_are_done(void **state)
{
    (void)state;
    reset();
    world.build.infos = NULL;
    world.build.info_count = 0;
    bvhd_batch_destroy(submit());
}

static void fails(enum bvhd_status status, const char *where)
{
    struct bvhd_batch *batch = NULL;
    assert_int_equal(bvhd_micromap_submit(world.client, &world.build, &batch, &world.error), status);
    assert_string_equal(world.error.where, where);
    assert_null(batch);
    reset();
}

static void wrong_calls_fail(void **state)
{
    (void)state;
    struct bvhd_batch *batch = NULL;
    reset();
    assert_int_equal(bvhd_micromap_submit(NULL, &world.build, &batch, &world.error), BVHD_INVALID);
    assert_string_equal(world.error.where, "client");
    assert_int_equal(bvhd_micromap_submit(world.client, NULL, &batch, &world.error), BVHD_INVALID);
    assert_string_equal(world.error.where, "build");
    assert_int_equal(bvhd_micromap_submit(world.client, &world.build, NULL, NULL), BVHD_INVALID);
    world.build.struct_size--;
    fails(BVHD_INVALID, "build.struct_size");
    world.build.infos = NULL;
    fails(BVHD_INVALID, "build.infos");
    world.build.bakes = world.bakes;
    fails(BVHD_INVALID, "build.infos");
    world.build.reserved = 1;
    fails(BVHD_UNSUPPORTED, "build.reserved");
    world.build.infos = NULL;
    world.build.bakes = world.bakes;
    world.bakes[1].sType = VK_STRUCTURE_TYPE_APPLICATION_INFO;
    fails(BVHD_INVALID, "build.bakes[1].sType");
    world.build.infos = NULL;
    world.build.bakes = world.bakes;
    world.bakes[1].pNext = &world.usage;
    fails(BVHD_INVALID, "build.bakes[1].sType");
}

static int set_up(void **state)
{
    (void)state;
    const struct bvhd_client_options options = {.struct_size = sizeof options, .local = BVHD_LOCAL_ALWAYS};
    return bvhd_client_create(&options, &world.client, NULL) != BVHD_OK;
}

static int tear_down(void **state)
{
    (void)state;
    bvhd_client_destroy(world.client);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rules_are_checked),
        cmocka_unit_test(bakes_are_requested),
        cmocka_unit_test(no_infos_are_done),
        cmocka_unit_test(wrong_calls_fail),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
