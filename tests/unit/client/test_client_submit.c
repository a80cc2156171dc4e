/* SPDX-License-Identifier: Apache-2.0 */
/* test_client_submit.c - tests the rules between the infos of a call: each by a wrong call, and its right neighbour. */
#include "tests/support/unit.h"

#include <string.h>

#include <bvhd/bvhd.h>

#include "client/library.h"

/* The infos of each call: two bottom levels, an updated one, and two top levels. */
enum { FIRST, SECOND, UPDATED, TOP, OTHER_TOP, INFOS };

/* Handles that build.references has, and of destinations. */
enum { SOURCE = 50, GIVEN = 51, BUILT = 10 };

#define CALL "VUID-vkBuildAccelerationStructuresKHR-"

static struct world {
    struct bvhd_client *client;
    float vertices[9];
    VkAccelerationStructureInstanceKHR instances[2]; /* of each top level */
    VkAccelerationStructureGeometryKHR triangles, named[2];
    VkAccelerationStructureBuildRangeInfoKHR range;
    const VkAccelerationStructureBuildRangeInfoKHR *ranges[INFOS];
    VkAccelerationStructureBuildGeometryInfoKHR infos[INFOS];
    struct bvhd_reference references[2];
    struct bvhd_key source; /* of a structure that may be updated */
    struct bvhd_build build;
} world;

static VkAccelerationStructureKHR handle(uint64_t number)
{
    return (VkAccelerationStructureKHR)(uintptr_t)number;
}

static void describe_geometries(void)
{
    static const float vertices[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    memcpy(world.vertices, vertices, sizeof vertices);
    world.triangles = (VkAccelerationStructureGeometryKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR,
        .geometry.triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                               .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                               .vertexData.hostAddress = world.vertices,
                               .vertexStride = 12,
                               .maxVertex = 2,
                               .indexType = VK_INDEX_TYPE_NONE_KHR}};
    for (int i = 0; i < 2; i++) {
        world.named[i] = (VkAccelerationStructureGeometryKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
            .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
            .geometry.instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                                   .data.hostAddress = &world.instances[i]}};
        world.instances[i] =
            (VkAccelerationStructureInstanceKHR){.transform = {{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
                                                 .mask = 255,
                                                 .accelerationStructureReference = GIVEN};
    }
}

/* Makes the call right: info i builds into the handle BUILT + i. */
static void reset(void)
{
    describe_geometries();
    world.range = (VkAccelerationStructureBuildRangeInfoKHR){.primitiveCount = 1};
    for (uint32_t i = 0; i < INFOS; i++) {
        world.ranges[i] = &world.range;
        world.infos[i] = (VkAccelerationStructureBuildGeometryInfoKHR){
            .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
            .type = i < TOP ? VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR
                            : VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR,
            .flags = VK_BUILD_ACCELERATION_STRUCTURE_ALLOW_UPDATE_BIT_KHR,
            .dstAccelerationStructure = handle(BUILT + i),
            .geometryCount = 1,
            .pGeometries = i < TOP ? &world.triangles : &world.named[i - TOP]};
    }
    world.infos[UPDATED].mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
    world.infos[UPDATED].srcAccelerationStructure = handle(SOURCE);
    world.references[0] = (struct bvhd_reference){.handle = SOURCE, .has_key = 1, .key = world.source};
    world.references[1] = (struct bvhd_reference){.handle = GIVEN, .bounds = {0, 0, 0, 1, 1, 1}};
    world.build = (struct bvhd_build){.struct_size = sizeof world.build,
                                      .info_count = INFOS,
                                      .infos = world.infos,
                                      .ranges = world.ranges,
                                      .references = world.references,
                                      .reference_count = 2,
                                      .quality = BVHD_QUALITY_FAST};
}

static struct bvhd_batch *submit(void)
{
    struct bvhd_batch *batch = NULL;
    struct bvhd_error error;
    if (bvhd_batch_submit(world.client, &world.build, &batch, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    return batch;
}

/* Submits, and checks that the infos whose bits are set in `broken` get this rule, at `where`, and no other fails. */
static void check(const char *what, uint32_t broken, const char *rule, const char *where)
{
    struct bvhd_batch *batch = submit();
    for (uint32_t i = 0; i < INFOS; i++) {
        const struct bvhd_error *error = &bvhd_batch_result(batch, i)->error;
        const bool is_broken = broken >> i & 1;
        char place[BVHD_WHERE_SIZE];
        snprintf(place, sizeof place, "infos[%u].%s", i, where);
        if (error->status != (is_broken ? BVHD_INVALID : BVHD_OK) ||
            (is_broken && (strcmp(bvhd_vuid_string(error->vuid), rule) != 0 || strcmp(error->where, place) != 0)))
            fail_msg("%s: infos[%u]: %s %s at %s: %s", what, i, bvhd_status_name(error->status),
                     bvhd_vuid_string(error->vuid), error->where, error->text);
    }
    bvhd_batch_destroy(batch);
}

#define RULE(change, broken, rule, where)                                                                              \
    do {                                                                                                               \
        reset();                                                                                                       \
        change;                                                                                                        \
        check(#change, broken, CALL rule, where);                                                                      \
    } while (0)

#define RIGHT(change)                                                                                                  \
    do {                                                                                                               \
        reset();                                                                                                       \
        change;                                                                                                        \
        check(#change, 0, "", "");                                                                                     \
    } while (0)

#define INTO(info) world.infos[info].dstAccelerationStructure
#define OF(info) world.infos[info].srcAccelerationStructure
#define NAMES(top) world.instances[(top)-TOP].accelerationStructureReference

static void destinations_differ(void **state)
{
    (void)state;
    RIGHT((void)0);
    RULE(INTO(SECOND) = INTO(FIRST), 1 << FIRST | 1 << SECOND, "dstAccelerationStructure-03698",
         "dstAccelerationStructure");
    RULE(INTO(OTHER_TOP) = INTO(FIRST), 1 << FIRST | 1 << OTHER_TOP, "dstAccelerationStructure-03698",
         "dstAccelerationStructure");
    RIGHT(INTO(FIRST) = INTO(SECOND) = VK_NULL_HANDLE); /* handles that nobody needs */
}

/* A source may be updated in place and to several structures, but not while another info builds into it. */
static void sources_are_not_built(void **state)
{
    (void)state;
    RULE(INTO(FIRST) = handle(SOURCE), 1 << UPDATED, "pInfos-03403", "srcAccelerationStructure");
    RULE(INTO(OTHER_TOP) = handle(SOURCE), 1 << UPDATED, "pInfos-03403", "srcAccelerationStructure");
    RULE(world.infos[FIRST].mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
         OF(FIRST) = INTO(FIRST) = handle(SOURCE), 1 << UPDATED, "pInfos-03403", "srcAccelerationStructure");
    RIGHT(INTO(UPDATED) = handle(SOURCE));
    RIGHT(world.infos[FIRST].mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR; OF(FIRST) = handle(SOURCE));
    RIGHT(OF(FIRST) = INTO(SECOND)); /* a build has no source */
}

static void sources_are_known(void **state)
{
    (void)state;
    RULE(OF(UPDATED) = handle(77), 1 << UPDATED, "srcAccelerationStructure-04629", "srcAccelerationStructure");
    RULE(OF(UPDATED) = handle(GIVEN), 1 << UPDATED, "srcAccelerationStructure-04629", "srcAccelerationStructure");
    RULE(OF(UPDATED) = VK_NULL_HANDLE, 1 << UPDATED, "pInfos-04630", "srcAccelerationStructure");
}

/*
 * A structure that instances name must not be built by another info of the call. The exception are bottom levels that
 * only this call knows: the top level waits for their results.
 */
static void named_structures_are_not_built(void **state)
{
    (void)state;
    static const char where[] = "geometries[0].instances[0].accelerationStructureReference";
    RULE(INTO(FIRST) = handle(GIVEN), 1 << TOP | 1 << OTHER_TOP, "None-03407", where);
    RULE(INTO(FIRST) = handle(GIVEN); NAMES(TOP) = BUILT + SECOND, 1 << OTHER_TOP, "None-03407", where);
    RULE(NAMES(TOP) = BUILT + OTHER_TOP, 1 << TOP, "None-03407", where);
    RULE(INTO(OTHER_TOP) = handle(GIVEN); NAMES(OTHER_TOP) = BUILT + FIRST, 1 << TOP, "None-03407", where);
    RIGHT(NAMES(TOP) = BUILT + FIRST);
    RIGHT(NAMES(TOP) = NAMES(OTHER_TOP) = BUILT + UPDATED);
    RIGHT(INTO(UPDATED) = handle(SOURCE); NAMES(TOP) = SOURCE);
    RIGHT(INTO(FIRST) = handle(GIVEN); NAMES(TOP) = NAMES(OTHER_TOP) = 0); /* inactive instances */
    RIGHT(INTO(FIRST) = handle(GIVEN); NAMES(TOP) = NAMES(OTHER_TOP) = BUILT + SECOND);
}

static int start(void **state)
{
    (void)state;
    const struct bvhd_client_options options = {.struct_size = sizeof options, .local = BVHD_LOCAL_ALWAYS};
    if (bvhd_client_create(&options, &world.client, NULL) != BVHD_OK)
        return 1;
    reset();
    world.build.info_count = 1;
    struct bvhd_batch *kept = submit();
    world.source = bvhd_batch_result(kept, 0)->key;
    *state = kept; /* where this process builds, sources are results that it holds */
    return 0;
}

static int stop(void **state)
{
    bvhd_batch_destroy(*state);
    bvhd_client_destroy(world.client);
    return library_memory.live != 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(destinations_differ),
        cmocka_unit_test(sources_are_not_built),
        cmocka_unit_test(sources_are_known),
        cmocka_unit_test(named_structures_are_not_built),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
