/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_misuse.c - a table of wrong calls of bvhd.h, bvhd_micromap.h, bvhd_scene.h, bvhd_cpu.h and bvhd_structure.h: the
 * status of each, the place and the text of its error. No wrong call crashes, or answers OK with something that cannot
 * be used.
 */
#include "tests/support/unit.h"

#include <math.h>
#include <stdbool.h>

#include <bvhd/bvhd_cpu.h>
#include <bvhd/bvhd_micromap.h>
#include <bvhd/bvhd_scene.h>
#include <bvhd/bvhd_structure.h>

#include "client/library.h"
#include "tests/support/client/right_build.h"

enum { MISUSES_LEAST = 80 };

static int rows, failures;

/* Compares what a call has done with what the row expects. */
static void check(const char *what, enum bvhd_status got, enum bvhd_status status, const char *where, const char *text)
{
    const struct bvhd_error *error = &world.error;
    bool good =
        got == status &&
        (status == BVHD_OK || !where ||
         (error->status == status && strcmp(error->where, where) == 0 && strstr(error->text, text) && error->text[0]));
    rows++;
    if (good)
        return;
    failures++;
    fprintf(stderr, "%s\n    is     %s at %s: %s\n    not    %s at %s: %s\n", what, bvhd_status_name(got), error->where,
            error->text, bvhd_status_name(status), where ? where : "", text);
}

/* A call that returns a status and fills world.error. */
#define CALL(call, status, where, text)                                                                                \
    do {                                                                                                               \
        reset();                                                                                                       \
        check(#call, call, status, where, text);                                                                       \
    } while (0)

/* A call that returns nothing but whether it did as NULL demands. */
#define QUIET(condition)                                                                                               \
    do {                                                                                                               \
        reset();                                                                                                       \
        check(#condition, (condition) ? BVHD_OK : BVHD_INTERNAL, BVHD_OK, NULL, "");                                   \
    } while (0)

/* Submits, waits, and returns the first error of an item; nothing may be left undecided. */
static enum bvhd_status submit(uint32_t item)
{
    struct bvhd_batch *batch = NULL;
    enum bvhd_status status = bvhd_batch_submit(world.client, &world.build, &batch, &world.error);
    if (status != BVHD_OK) {
        assert_null(batch);
        return status;
    }
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    world.error = bvhd_batch_result(batch, item)->error;
    bvhd_batch_destroy(batch);
    return world.error.status;
}

/* A build that `change` breaks: the call fails, or the result of `item`. */
#define BUILD(change, item, status, where, text)                                                                       \
    do {                                                                                                               \
        reset();                                                                                                       \
        change;                                                                                                        \
        check(#change, submit(item), status, where, text);                                                             \
    } while (0)

static void test_right(void **state)
{
    (void)state;
    reset();
    for (uint32_t i = 0; i < 3; i++)
        check("the right build", submit(i), BVHD_OK, NULL, "");
    assert_int_equal(failures, 0);
}

static void clients(void)
{
    struct bvhd_client *client = NULL;
    struct bvhd_counters *counters = NULL;
    struct bvhd_connections *connections = NULL;
    struct bvhd_cache_state *cache = NULL;
    struct bvhd_client_options options = {.struct_size = sizeof options};
    char bytes[sizeof options + 16] = {0};
    CALL(bvhd_client_create(NULL, NULL, &world.error), BVHD_INVALID, "ret_client", "ret_client is NULL");
    options.struct_size = 3;
    CALL(bvhd_client_create(&options, &client, &world.error), BVHD_INVALID, "options.struct_size",
         "struct_size is 3, not sizeof(struct bvhd_client_options)");
    options.struct_size = SIZE_MAX;
    CALL(bvhd_client_create(&options, &client, &world.error), BVHD_INVALID, "options.struct_size",
         "struct_size is 1844");
    options.struct_size = sizeof bytes;
    memcpy(bytes, &options, sizeof options);
    bytes[sizeof options] = 1;
    CALL(bvhd_client_create((void *)bytes, &client, &world.error), BVHD_UNSUPPORTED, "options.struct_size",
         "which version 0.1.0 of the library does not know");
    options = (struct bvhd_client_options){.struct_size = sizeof options, .local = (enum bvhd_local)7};
    CALL(bvhd_client_create(&options, &client, &world.error), BVHD_INVALID, "options.local",
         "7 is no value of enum bvhd_local");
    CALL(bvhd_client_connect(NULL, &world.error), BVHD_INVALID, "client", "client is NULL");
    CALL(bvhd_client_ping(NULL, 1, NULL, &world.error), BVHD_INVALID, "client", "client is NULL");
    CALL(bvhd_client_counters(NULL, 1, &counters, &world.error), BVHD_INVALID, "client", "client is NULL");
    CALL(bvhd_client_counters(world.client, 1, NULL, &world.error), BVHD_INVALID, "ret_counters",
         "ret_counters is NULL");
    CALL(bvhd_client_connections(NULL, 0, 1, &connections, &world.error), BVHD_INVALID, "client", "client is NULL");
    CALL(bvhd_client_connections(world.client, 0, 1, NULL, &world.error), BVHD_INVALID, "ret_connections",
         "ret_connections is NULL");
    CALL(bvhd_client_connections(world.client, 6, 1, &connections, &world.error), BVHD_INVALID, "flags",
         "0x6 has bits that mean nothing");
    CALL(bvhd_client_cache(NULL, BVHD_CACHE_SHOW, 0, 1, &cache, &world.error), BVHD_INVALID, "client",
         "client is NULL");
    CALL(bvhd_client_cache(world.client, BVHD_CACHE_SHOW, 0, 1, NULL, &world.error), BVHD_INVALID, "ret_state",
         "ret_state is NULL");
    CALL(bvhd_client_cache(world.client, (enum bvhd_cache_action)3, 0, 1, &cache, &world.error), BVHD_INVALID, "action",
         "3 is no action");
    QUIET((bvhd_cache_state_destroy(NULL), true));
    QUIET(bvhd_client_descriptor(NULL) == -1);
    QUIET((bvhd_client_dispatch(NULL), bvhd_client_destroy(NULL), true));
    QUIET(bvhd_counters_count(NULL) == 0 && !bvhd_counters_name(NULL, 0) && bvhd_counters_value(NULL, 0) == 0);
    QUIET((bvhd_counters_destroy(NULL), true) && *bvhd_counters_version(NULL) == 0);
    QUIET(bvhd_connections_count(NULL) == 0 && !bvhd_connections_get(NULL, 0));
    QUIET(bvhd_connections_total(NULL) == 0 && bvhd_connections_hidden(NULL) == 0);
    QUIET((bvhd_connections_destroy(NULL), true));
    assert_null(client);
}

static void batches(void)
{
    struct bvhd_batch *batch = NULL;
    struct bvhd_key key = {{1}};
    CALL(bvhd_batch_submit(NULL, &world.build, &batch, &world.error), BVHD_INVALID, "client", "client is NULL");
    CALL(bvhd_batch_submit(world.client, NULL, &batch, &world.error), BVHD_INVALID, "build", "build is NULL");
    CALL(bvhd_batch_submit(world.client, &world.build, NULL, &world.error), BVHD_INVALID, "ret_batch",
         "ret_batch is NULL");
    CALL(bvhd_batch_submit(NULL, NULL, NULL, NULL), BVHD_INVALID, NULL, "");
    CALL(bvhd_batch_fetch(NULL, 1, &key, &batch, &world.error), BVHD_INVALID, "client", "client is NULL");
    CALL(bvhd_batch_fetch(world.client, 3, NULL, &batch, &world.error), BVHD_INVALID, "keys",
         "keys is NULL, but key_count is 3");
    CALL(bvhd_batch_fetch(world.client, 1, &key, NULL, &world.error), BVHD_INVALID, "ret_batch", "ret_batch is NULL");
    CALL(bvhd_batch_wait(NULL, 0), BVHD_INVALID, NULL, "");
    CALL(bvhd_batch_wait_copied(NULL, -1), BVHD_INVALID, NULL, "");
    QUIET(bvhd_batch_count(NULL) == 0 && bvhd_batch_is_done(NULL) && bvhd_batch_is_copied(NULL));
    QUIET(!bvhd_batch_result(NULL, 0) && !bvhd_batch_user(NULL));
    QUIET((bvhd_batch_cancel(NULL), bvhd_batch_cancel_item(NULL, 0), bvhd_batch_destroy(NULL), true));
    QUIET((bvhd_batch_set_callback(NULL, NULL, NULL), true));
    reset();
    assert_int_equal(bvhd_batch_fetch(world.client, 1, &key, &batch, NULL), BVHD_OK);
    QUIET(!bvhd_batch_result(batch, 1) && !bvhd_batch_result(batch, UINT32_MAX));
    QUIET(!(bvhd_batch_progress(NULL, 0) > 0) && !(bvhd_batch_progress(batch, 1) > 0));
    QUIET((bvhd_batch_cancel_item(batch, 1), bvhd_batch_cancel_item(batch, UINT32_MAX), true));
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    CALL((world.error = bvhd_batch_result(batch, 0)->error).status, BVHD_NOT_FOUND, "keys[0]", "key");
    bvhd_batch_destroy(batch);
}

static void values(void)
{
    struct bvhd_key key = {{1}};
    char text[BVHD_KEY_TEXT_SIZE] = "x", good[BVHD_KEY_TEXT_SIZE];
    struct bvhd_result result = {.error = {.status = BVHD_OK}};
    struct bvhd_reference reference;
    bvhd_key_to_text(&key, good);
    QUIET((bvhd_key_to_text(NULL, text), text[0] == '\0'));
    QUIET((bvhd_key_to_text(&key, NULL), true));
    CALL(bvhd_key_from_text(NULL, &key), BVHD_INVALID, NULL, "");
    CALL(bvhd_key_from_text(good, NULL), BVHD_INVALID, NULL, "");
    CALL(bvhd_key_from_text("", &key), BVHD_INVALID, NULL, "");
    CALL(bvhd_key_from_text(good + 1, &key), BVHD_INVALID, NULL, "");
    good[5] = 'g';
    CALL(bvhd_key_from_text(good, &key), BVHD_INVALID, NULL, "");
    QUIET(strcmp(bvhd_status_name((enum bvhd_status)99), "UNKNOWN") == 0);
    QUIET(!bvhd_target_name((enum bvhd_target)99));
    QUIET(strcmp(bvhd_vuid_string((enum bvhd_vuid)999999), "") == 0);
    QUIET(!bvhd_blob_ref(NULL) && !bvhd_blob_data(NULL) && bvhd_blob_size(NULL) == 0);
    QUIET((bvhd_blob_unref(NULL), true));
    CALL(bvhd_reference_from_result(NULL, 1, &reference), BVHD_INVALID, NULL, "");
    CALL(bvhd_reference_from_result(&result, 1, NULL), BVHD_INVALID, NULL, "");
    CALL(bvhd_reference_from_result(&result, 0, &reference), BVHD_INVALID, NULL, "");
    CALL(bvhd_reference_from_result(&result, 1, &reference), BVHD_CORRUPT, NULL, "");
    CALL(bvhd_format_from_probe(NULL, 100, &world.format, &world.error), BVHD_INVALID, "probe", "probe is NULL");
    CALL(bvhd_format_from_probe(good, 65, NULL, &world.error), BVHD_INVALID, "ret_format", "ret_format is NULL");
    CALL(bvhd_format_from_probe(good, 65, &world.format, &world.error), BVHD_CORRUPT, "probe", "");
    CALL(bvhd_format_from_probe(good, 0, &world.format, &world.error), BVHD_CORRUPT, "probe", "");
}

/* The struct bvhd_build and its references: the call itself fails. */
static void builds(void)
{
    BUILD(world.build.struct_size = 0, 0, BVHD_INVALID, "build.struct_size", "sizeof(struct bvhd_build)");
    BUILD(world.build.struct_size = sizeof world.build - 1, 0, BVHD_INVALID, "build.struct_size", "struct_size is");
    BUILD(world.build.infos = NULL, 0, BVHD_INVALID, "build.infos", "build.infos is NULL, but info_count is 3");
    assert_string_equal(bvhd_vuid_string(world.error.vuid), "VUID-vkBuildAccelerationStructuresKHR-pInfos-parameter");
    BUILD(world.build.references = NULL, 0, BVHD_INVALID, "build.references",
          "build.references is NULL, but reference_count is 3");
    BUILD(world.build.quality = (enum bvhd_quality)9, 0, BVHD_INVALID, "build.quality", "9 is no value");
    BUILD(world.build.priority = (enum bvhd_priority)5, 0, BVHD_INVALID, "build.priority", "5 is no value");
    BUILD(world.build.layout_flags = 0xf0, 0, BVHD_INVALID, "build.layout_flags", "portable has no bits 0xf0");
    BUILD(world.build.builder = 2, 0, BVHD_INVALID, "build.builder", "2 is no value of enum bvhd_builder");
    BUILD(world.build.rays_per_primitive = NAN, 0, BVHD_INVALID, "build.rays_per_primitive", "nan");
    BUILD(world.build.rays_per_primitive = -1, 0, BVHD_INVALID, "build.rays_per_primitive", "-1");
    BUILD(world.build.target = (enum bvhd_target)77, 0, BVHD_UNSUPPORTED, "infos[0].options.target",
          "target 77 is not known");
    BUILD(world.build.target = BVHD_TARGET_LAVAPIPE, 0, BVHD_INVALID, "build.format",
          "build.format is NULL, but target lavapipe needs");
    BUILD((world.build.target = BVHD_TARGET_PORTABLE, world.build.format = &world.format), 0, BVHD_INVALID,
          "build.format", "the format is of target lavapipe, the build's is portable");
    BUILD((world.build.format = &world.format, world.format.struct_size = 1), 0, BVHD_INVALID,
          "build.format.struct_size", "sizeof(struct bvhd_format)");
    BUILD((world.build.format = &world.format, world.format.variant = 9), 0, BVHD_INVALID, "build.format.variant",
          "lavapipe has no variant 9");
    BUILD((world.build.format = &world.format, world.format.target = BVHD_TARGET_PORTABLE), 0, BVHD_INVALID,
          "build.format", "target portable is that of no device");
    BUILD(world.references[1].handle = 0, 0, BVHD_INVALID, "build.references[1].handle", "the handle is 0");
    BUILD(world.references[2].handle = 21, 0, BVHD_INVALID, "build.references[2].handle",
          "0x15 is the handle of references[0], too");
    BUILD(world.references[2].handle = 12, 2, BVHD_INVALID,
          "infos[2].geometries[0].instances[1].accelerationStructureReference",
          "another entry of this call builds into this structure");
    BUILD(memset(world.references[0].bounds, 0, 24), 0, BVHD_INVALID, "build.references[0].bounds",
          "the bounds are all 0, and there is no key");
    BUILD(world.references[0].bounds[4] = INFINITY, 0, BVHD_INVALID, "build.references[0].bounds", "not finite");
    BUILD(world.references[0].slabs[4] = NAN, 0, BVHD_INVALID, "build.references[0].slabs", "not finite");
    BUILD(world.references[0].slabs[4] = 1, 0, BVHD_INVALID, "build.references[0].slabs", "over its maximum");
}

static void infos(void)
{
    static const VkBaseInStructure stray = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR};
    BUILD(world.infos[0].sType = 0, 0, BVHD_INVALID, "infos[0].sType",
          "sType is 0, not VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR");
    BUILD(world.infos[1].pNext = &stray, 1, BVHD_INVALID, "infos[1].pNext",
          "a struct whose sType is VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR does not belong here");
    BUILD(world.infos[0].type = (VkAccelerationStructureTypeKHR)7, 0, BVHD_INVALID, "infos[0].type",
          "type is 7, which is no VkAccelerationStructureTypeKHR");
    BUILD(world.infos[0].type = VK_ACCELERATION_STRUCTURE_TYPE_GENERIC_KHR, 0, BVHD_INVALID, "infos[0].type",
          "GENERIC");
    BUILD(world.infos[0].flags = 0x10000, 0, BVHD_INVALID, "infos[0].flags", "unknown bits 0x10000");
    BUILD(world.infos[0].flags = 0xc, 0, BVHD_INVALID, "infos[0].flags", "exclude each other");
    BUILD(world.infos[0].mode = (VkBuildAccelerationStructureModeKHR)5, 0, BVHD_INVALID, "infos[0].mode",
          "mode is 5, neither BUILD nor UPDATE");
    BUILD(world.infos[0].mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR, 0, BVHD_INVALID,
          "infos[0].srcAccelerationStructure", "srcAccelerationStructure is NULL, but the mode is UPDATE");
    BUILD(world.infos[0].pGeometries = NULL, 0, BVHD_INVALID, "infos[0].pGeometries",
          "pGeometries and ppGeometries are both NULL, but geometryCount is 1");
    BUILD(world.infos[0].ppGeometries = world.geometry_pointers, 0, BVHD_INVALID, "infos[0].pGeometries",
          "pGeometries and ppGeometries are both set");
    BUILD((world.infos[0].pGeometries = NULL, world.infos[0].ppGeometries = world.geometry_pointers), 0, BVHD_INVALID,
          "infos[0].ppGeometries[0]", "ppGeometries[0] is NULL");
    BUILD(world.infos[0].geometryCount = 0x7fffffff, 0, BVHD_INVALID, "infos[0].geometryCount", "at most 16777215");
    BUILD(world.build.ranges = NULL, 0, BVHD_INVALID, "ranges[0]", "ranges is NULL, but geometryCount is 1");
    BUILD(world.range_pointers[1] = NULL, 1, BVHD_INVALID, "ranges[1]", "ranges[1] is NULL, but geometryCount is 1");
    BUILD(world.infos[2].geometryCount = 0, 2, BVHD_INVALID, "infos[2].geometryCount", "a top level has one geometry");
    BUILD(world.infos[1].dstAccelerationStructure = world.infos[0].dstAccelerationStructure, 1, BVHD_INVALID,
          "infos[1].dstAccelerationStructure", "infos[0] builds into the same structure");
}

static void geometries(void)
{
    BUILD(world.geometries[0].sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR, 0,
          BVHD_INVALID, "infos[0].geometries[0].sType", "_TRIANGLES_DATA_KHR, not VK_STRUCTURE_TYPE_");
    BUILD(DATA.sType = 0, 0, BVHD_INVALID, "infos[0].geometries[0].triangles.sType", "sType is 0, not VK_STRUCTURE");
    BUILD(world.geometries[0].geometryType = (VkGeometryTypeKHR)9, 0, BVHD_INVALID,
          "infos[0].geometries[0].geometryType", "geometryType is 9, which is no VkGeometryTypeKHR");
    BUILD(world.geometries[0].geometryType = (VkGeometryTypeKHR)1000478000, 0, BVHD_UNSUPPORTED,
          "infos[0].geometries[0].geometryType", "DENSE_GEOMETRY_FORMAT_TRIANGLES_AMDX is not supported");
    BUILD(world.geometries[0].flags = 0x100, 0, BVHD_INVALID, "infos[0].geometries[0].flags", "unknown bits 0x100");
    BUILD((world.infos[1].geometryCount = 3, world.range_pointers[1] = &world.ranges[0],
           world.geometries[2] = world.geometries[0]),
          1, BVHD_INVALID, "infos[1].geometries[1].geometryType", "triangles after AABBs");
    BUILD(world.infos[1].pGeometries = &world.geometries[2], 1, BVHD_INVALID, "infos[1].geometries[0].geometryType",
          "instances in a bottom level");
    BUILD(world.infos[2].pGeometries = &world.geometries[0], 2, BVHD_INVALID, "infos[2].geometries[0].geometryType",
          "triangles in a top level, which is made of instances");
    BUILD(DATA.vertexFormat = VK_FORMAT_R32_SFLOAT, 0, BVHD_INVALID, "infos[0].geometries[0].triangles.vertexFormat",
          "vertexFormat is VK_FORMAT_R32_SFLOAT");
    BUILD(DATA.vertexStride = 7, 0, BVHD_INVALID, "infos[0].geometries[0].triangles.vertexStride",
          "7 is no multiple of 4, as R32G32B32_SFLOAT needs");
    BUILD(DATA.vertexStride = UINT64_C(1) << 33, 0, BVHD_INVALID, "infos[0].geometries[0].triangles.vertexStride",
          "over 2^32 - 1");
    BUILD(DATA.indexType = (VkIndexType)1000265000, 0, BVHD_INVALID, "infos[0].geometries[0].triangles.indexType",
          "indexType is VK_INDEX_TYPE_UINT8_KHR, none of");
    BUILD(DATA.vertexData.hostAddress = NULL, 0, BVHD_INVALID, "infos[0].geometries[0].triangles.vertexData",
          "triangles.vertexData is NULL, but primitiveCount is 2");
    BUILD(DATA.indexData.hostAddress = NULL, 0, BVHD_INVALID, "infos[0].geometries[0].triangles.indexData",
          "triangles.indexData is NULL, but primitiveCount is 2");
    BUILD(world.ranges[0].primitiveOffset = 3, 0, BVHD_INVALID, "ranges[0][0].primitiveOffset",
          "3 is no multiple of 4");
    BUILD(world.ranges[0].primitiveCount = UINT32_MAX, 0, BVHD_INVALID, "ranges[0][0].primitiveCount", "at most");
    BUILD((DATA.indexType = VK_INDEX_TYPE_NONE_KHR, world.ranges[0].primitiveCount = 5), 0, BVHD_INVALID,
          "ranges[0][0].primitiveCount", "reach past maxVertex 3");
    BUILD(DATA.maxVertex = 1, 0, BVHD_INVALID, "infos[0].geometries[0].triangles.indices[2]",
          "index 2 is over maxVertex 1");
    BUILD(BOXES.stride = 4, 1, BVHD_INVALID, "infos[1].geometries[0].aabbs.stride", "4 is no multiple of 8");
    BUILD(BOXES.data.hostAddress = NULL, 1, BVHD_INVALID, "infos[1].geometries[0].aabbs.data",
          "aabbs.data is NULL, but primitiveCount is 2");
    BUILD(world.boxes[6] = 9, 1, BVHD_INVALID, "infos[1].geometries[0].aabbs[1].minX", "9 is over the maximum, 3");
}

static void instances(void)
{
    BUILD(NAMED.data.hostAddress = NULL, 2, BVHD_INVALID, "infos[2].geometries[0].instances.data",
          "instances.data is NULL, but primitiveCount is 2");
    BUILD((NAMED.arrayOfPointers = VK_TRUE, NAMED.data.hostAddress = world.pointers, world.pointers[1] = NULL), 2,
          BVHD_INVALID, "infos[2].geometries[0].instances[1]", "the pointer to this instance is NULL");
    BUILD(world.ranges[2].primitiveOffset = 8, 2, BVHD_INVALID, "ranges[2][0].primitiveOffset",
          "8 is no multiple of 16");
    BUILD(world.instances[1].accelerationStructureReference = 99, 2, BVHD_INVALID,
          "infos[2].geometries[0].instances[1].accelerationStructureReference", "");
    BUILD(world.instances[1].accelerationStructureReference = 13, 2, BVHD_INVALID,
          "infos[2].geometries[0].instances[1].accelerationStructureReference", "");
    BUILD(world.instances[1].flags = 0xc, 2, BVHD_INVALID, "infos[2].geometries[0].instances[1].flags",
          "FORCE_OPAQUE and FORCE_NO_OPAQUE exclude each other");
    BUILD(memset(&world.instances[0].transform, 0, 48), 2, BVHD_INVALID,
          "infos[2].geometries[0].instances[0].transform", "not invertible");
    BUILD(world.infos[1].sType = 0, 2, BVHD_INVALID, "infos[2].geometries[0].instances",
          "infos[1] builds a structure that instances name, and failed: infos[1].sType: sType is 0");
    BUILD((world.references[0].has_key = 1, memset(world.references[0].bounds, 0, 24),
           world.instances[0].accelerationStructureReference = 21),
          2, BVHD_NOT_FOUND, "build.references[0].key", "infos[2] names this reference");
}

static void scenes(void)
{
    static _Alignas(64) char garbage[256];
    struct bvhd_scene *scene = NULL;
    uint64_t size = 7;
    CALL(bvhd_scene_open(NULL, 0, &scene, &world.error), BVHD_INVALID, "path", "path is NULL");
    CALL(bvhd_scene_open("/nowhere/at.all", 0, &scene, &world.error), BVHD_NOT_FOUND, NULL, "");
    CALL(bvhd_scene_open("/dev/null", 0, NULL, &world.error), BVHD_INVALID, "ret_scene", "");
    CALL(bvhd_scene_open("/dev/null", 0x80, &scene, &world.error), BVHD_INVALID, "flags", "BVHD_SCENE_");
    CALL(bvhd_scene_open_bytes(NULL, 10, 0, &scene, &world.error), BVHD_INVALID, "data", "");
    CALL(bvhd_scene_open_bytes(garbage + 1, 10, 0, &scene, &world.error), BVHD_INVALID, "data", "multiple of 64");
    CALL(bvhd_scene_open_bytes(garbage, sizeof garbage, 0, &scene, &world.error), BVHD_CORRUPT, NULL, "");
    CALL(bvhd_scene_check(NULL, 0, &world.error), BVHD_INVALID, "scene", "scene is NULL");
    QUIET((bvhd_scene_close(NULL), true));
    QUIET(bvhd_scene_structure_count(NULL) == 0 && !bvhd_scene_get_structure(NULL, 0) &&
          bvhd_scene_top_count(NULL) == 0);
    QUIET(bvhd_scene_find(NULL, "x") == UINT32_MAX && bvhd_scene_find_top(NULL, "x") == UINT32_MAX);
    QUIET(bvhd_scene_top(NULL, 0) == UINT32_MAX && !bvhd_scene_manifest(NULL, &size));
    assert_null(scene);
}

/* Calls of a scene of one triangle mesh, which is right. */
static void traced(const struct bvhd_cpu_blob *blob)
{
    struct bvhd_cpu_scene_options options = {.struct_size = sizeof options, .blobs = blob, .blob_count = 1};
    struct bvhd_cpu_scene *scene = NULL;
    struct bvhd_cpu_ray ray = {.direction = {0, 0, 1}, .tmax = 1, .mask = 255};
    struct bvhd_cpu_hit hit = {.blob = BVHD_CPU_NO_BLOB}, hits[1];
    const struct bvhd_cpu_trace right = {.struct_size = sizeof right,
                                         .rays = &ray,
                                         .ray_size = sizeof ray,
                                         .hits = hits,
                                         .hit_size = sizeof hits[0],
                                         .ray_count = 1};
    struct bvhd_cpu_trace trace;
    float numbers[12], corners[3][3];
#define TRACE(change, where, text)                                                                                     \
    do {                                                                                                               \
        reset();                                                                                                       \
        trace = right;                                                                                                 \
        change;                                                                                                        \
        check(#change, bvhd_cpu_scene_trace(scene, &trace, &world.error), BVHD_INVALID, where, text);                  \
        ray.flags = 0;                                                                                                 \
        ray.time = 0;                                                                                                  \
    } while (0)
    assert_int_equal(bvhd_cpu_scene_create(&options, &scene, NULL), BVHD_OK);
    CALL(bvhd_cpu_scene_trace(scene, &right, &world.error), BVHD_OK, NULL, "");
    CALL(bvhd_cpu_scene_trace(scene, NULL, &world.error), BVHD_INVALID, "trace", "trace is NULL");
    TRACE(trace.struct_size = 0, "trace.struct_size", "sizeof(struct bvhd_cpu_trace)");
    TRACE(trace.rays = NULL, "trace.rays", "trace.rays is NULL, but ray_count is 1");
    TRACE(trace.hits = NULL, "trace.hits", "trace.hits is NULL, but ray_count is 1");
    TRACE(trace.ray_size = 7, "trace.ray_size", "7");
    TRACE(trace.hit_size = 6, "trace.hit_size", "6");
    TRACE(trace.ray_stride = 4, "trace.ray_stride", "less than ray_size");
    TRACE(trace.flags = 0x40, "trace.flags", "0x40");
    TRACE(trace.reserved = 1, "trace.reserved", "not 0");
    TRACE(ray.flags = 0x10000, "rays[0].flags", "unknown bits");
    TRACE(ray.flags = 3, "rays[0].flags", "exclude each other");
    TRACE(ray.time = NAN, "rays[0].time", "nan");
    TRACE(ray.time = 2, "rays[0].time", "2 is not in 0 .. 1");
#undef TRACE
    CALL(bvhd_cpu_scene_corners(scene, NULL, corners, &world.error), BVHD_INVALID, "hit", "hit is NULL");
    CALL(bvhd_cpu_scene_corners(scene, &hit, NULL, &world.error), BVHD_INVALID, "ret_corners", "ret_corners is NULL");
    CALL(bvhd_cpu_scene_corners(scene, &hit, corners, &world.error), BVHD_INVALID, "hit.blob", "hit nothing");
    CALL(bvhd_cpu_scene_corners_at(scene, NULL, 0, corners, &world.error), BVHD_INVALID, "hit", "hit is NULL");
    CALL(bvhd_cpu_scene_ends(scene, &hit, NULL, &world.error), BVHD_INVALID, "ret_ends", "ret_ends is NULL");
    hit.blob = 77;
    CALL(bvhd_cpu_scene_object_to_world(scene, &hit, numbers, &world.error), BVHD_INVALID, "hit.blob",
         "77 is no bottom level");
    CALL(bvhd_cpu_scene_object_to_world(scene, &hit, NULL, &world.error), BVHD_INVALID, "ret_matrix",
         "ret_matrix is NULL");
    CALL(bvhd_cpu_scene_object_to_world_at(scene, &hit, 0, NULL, &world.error), BVHD_INVALID, "ret_matrix",
         "ret_matrix is NULL");
    hit.blob = 0;
    CALL(bvhd_cpu_scene_corners_at(scene, &hit, 2, corners, &world.error), BVHD_INVALID, "time", "2 is not in 0 .. 1");
    CALL(bvhd_cpu_scene_object_to_world_at(scene, &hit, NAN, numbers, &world.error), BVHD_INVALID, "time", "nan");
    CALL(bvhd_cpu_scene_positions(scene, 0, 0, 0, NULL, &world.error), BVHD_INVALID, "ret_positions",
         "ret_positions is NULL");
    CALL(bvhd_cpu_scene_positions(scene, 1, 0, 0, corners, &world.error), BVHD_INVALID, "blob", "1 is no bottom level");
    CALL(bvhd_cpu_scene_positions(scene, 0, 0, 0, corners, &world.error), BVHD_INVALID, "blob", "ALLOW_DATA_ACCESS");
    CALL(bvhd_cpu_scene_positions_at(scene, 0, 0, 0, 0, NULL, &world.error), BVHD_INVALID, "ret_positions",
         "ret_positions is NULL");
    CALL(bvhd_cpu_scene_positions_at(scene, 0, 0, 0, -1, corners, &world.error), BVHD_INVALID, "time",
         "-1 is not in 0 .. 1");
    QUIET((bvhd_cpu_scene_bounds(scene, NULL), bvhd_cpu_scene_bounds(NULL, numbers), true));
    bvhd_cpu_scene_destroy(scene);
}

static void traversal(void)
{
    static _Alignas(64) char garbage[256];
    struct bvhd_cpu_scene *scene = NULL;
    struct bvhd_cpu_blob blob = {garbage, sizeof garbage};
    struct bvhd_cpu_scene_options options = {.struct_size = sizeof options, .blobs = &blob, .blob_count = 1}, wrong;
    struct bvhd_cpu_trace trace = {.struct_size = sizeof trace};
    struct bvhd_cpu_hit hit = {0};
    float numbers[12], corners[3][3], ends[2][4];
    CALL(bvhd_cpu_scene_create(NULL, &scene, &world.error), BVHD_INVALID, "options", "options is NULL");
    CALL(bvhd_cpu_scene_create(&options, NULL, &world.error), BVHD_INVALID, "ret_scene", "ret_scene is NULL");
    wrong = (struct bvhd_cpu_scene_options){.struct_size = 1};
    CALL(bvhd_cpu_scene_create(&wrong, &scene, &world.error), BVHD_INVALID, "options.struct_size", "struct_size is 1");
    wrong = options;
    wrong.blobs = NULL;
    CALL(bvhd_cpu_scene_create(&wrong, &scene, &world.error), BVHD_INVALID, "options.blobs",
         "options.blobs is NULL, but blob_count is 1");
    wrong = options;
    wrong.blob_count = 0;
    CALL(bvhd_cpu_scene_create(&wrong, &scene, &world.error), BVHD_INVALID, "options.blob_count", "0");
    wrong = options;
    wrong.flags = 4;
    CALL(bvhd_cpu_scene_create(&wrong, &scene, &world.error), BVHD_INVALID, "options.flags", "0x4");
    CALL(bvhd_cpu_scene_create(&options, &scene, &world.error), BVHD_CORRUPT, "blobs[0]: header.serializedSize", "");
    CALL(bvhd_cpu_scene_trace(NULL, &trace, &world.error), BVHD_INVALID, "scene", "scene is NULL");
    CALL(bvhd_cpu_scene_ends(NULL, &hit, ends, &world.error), BVHD_INVALID, "scene", "scene is NULL");
    CALL(bvhd_cpu_scene_corners(NULL, &hit, corners, &world.error), BVHD_INVALID, "scene", "scene is NULL");
    CALL(bvhd_cpu_scene_corners_at(NULL, &hit, 0, corners, &world.error), BVHD_INVALID, "scene", "scene is NULL");
    CALL(bvhd_cpu_scene_object_to_world_at(NULL, &hit, 0, numbers, &world.error), BVHD_INVALID, "scene",
         "scene is NULL");
    CALL(bvhd_cpu_scene_positions(NULL, 0, 0, 0, corners, &world.error), BVHD_INVALID, "scene", "scene is NULL");
    CALL(bvhd_cpu_scene_positions_at(NULL, 0, 0, 0, 0, corners, &world.error), BVHD_INVALID, "scene", "scene is NULL");
    CALL(bvhd_cpu_scene_object_to_world(NULL, &hit, numbers, &world.error), BVHD_INVALID, "scene", "scene is NULL");
    QUIET((bvhd_cpu_scene_destroy(NULL), true));
    assert_null(scene);
    struct bvhd_batch *batch = NULL;
    reset();
    assert_int_equal(bvhd_batch_submit(world.client, &world.build, &batch, NULL), BVHD_OK);
    assert_int_equal(bvhd_batch_wait(batch, -1), BVHD_OK);
    blob = (struct bvhd_cpu_blob){bvhd_batch_result(batch, 0)->data, bvhd_batch_result(batch, 0)->size};
    traced(&blob);
    bvhd_batch_destroy(batch);
}

/* Other wrong calls of bvhd_structure.h break a rule of Vulkan: the tests of client/structure have those. */
static void structures(void)
{
    struct bvhd_structure *structure = NULL;
    struct bvhd_structure_state is;
    struct bvhd_structure_properties properties = {.struct_size = 1};
    float corners[3][3];
    struct bvhd_result result = {.error = {.status = BVHD_OK}};
    CALL(bvhd_structure_create(NULL, &structure, &world.error), BVHD_INVALID, "info", "info is NULL");
    CALL(bvhd_structure_sizes(NULL, NULL, &world.error), BVHD_INVALID, "query", "query is NULL");
    CALL(bvhd_structure_hold(NULL, world.infos, world.ranges, &result, &world.error), BVHD_INVALID, "structure",
         "structure is NULL");
    CALL(bvhd_structure_copy(NULL, &world.error), BVHD_INVALID, "info", "info is NULL");
    CALL(bvhd_structure_serialize(NULL, 0, &world.error), BVHD_INVALID, "info", "info is NULL");
    CALL(bvhd_structure_deserialize(NULL, 0, NULL, &world.error), BVHD_INVALID, "info", "info is NULL");
    CALL(bvhd_structure_query(NULL, &world.error), BVHD_INVALID, "properties", "properties is NULL");
    CALL(bvhd_structure_query(&properties, &world.error), BVHD_INVALID, "properties.struct_size", "struct_size is 1");
    CALL(bvhd_structure_compatibility(NULL, NULL, NULL, &world.error), BVHD_INVALID, "info", "info is NULL");
    CALL(bvhd_structure_get(NULL, &is), BVHD_INVALID, NULL, "");
    CALL(bvhd_structure_positions(NULL, 0, 0, corners, &world.error), BVHD_INVALID, "structure", "structure is NULL");
    CALL(bvhd_structure_positions_at(NULL, 0, 0, 0, corners, &world.error), BVHD_INVALID, "structure",
         "structure is NULL");
    CALL(bvhd_indirect_read(NULL, NULL, &world.error), BVHD_INVALID, "indirect", "indirect is NULL");
    QUIET((bvhd_structure_destroy(NULL), bvhd_indirect_free(NULL), bvhd_structure_handle(NULL) == VK_NULL_HANDLE));
}

/* The other wrong calls of these functions are in test_micromap_submit.c and test_micromap_read.c. */
static void micromaps(void)
{
    const struct bvhd_micromap_build build = {.struct_size = sizeof build};
    struct bvhd_micromap micromap = {.struct_size = sizeof micromap};
    _Alignas(16) static const unsigned char bytes[256];
    struct bvhd_batch *batch = NULL;
    CALL(bvhd_micromap_submit(NULL, &build, &batch, &world.error), BVHD_INVALID, "client", "client is NULL");
    CALL(bvhd_micromap_submit(world.client, NULL, &batch, &world.error), BVHD_INVALID, "build", "build is NULL");
    CALL(bvhd_micromap_submit(world.client, &build, NULL, &world.error), BVHD_INVALID, "ret_batch",
         "ret_batch is NULL");
    CALL(bvhd_micromap_read(NULL, 0, &micromap, &world.error), BVHD_INVALID, "data", "data is NULL");
    CALL(bvhd_micromap_read(bytes, sizeof bytes, NULL, &world.error), BVHD_INVALID, "ret_micromap",
         "ret_micromap is NULL");
    CALL(bvhd_micromap_read(bytes + 1, sizeof bytes - 1, &micromap, &world.error), BVHD_INVALID, "data", "16 bytes");
    CALL(bvhd_micromap_read(bytes, sizeof bytes, &micromap, NULL), BVHD_INCOMPATIBLE, NULL, "");
}

static void test_misuses(void **state)
{
    (void)state;
    uint64_t live = library_memory.live;
    const struct bvhd_client_options options = {.struct_size = sizeof options, .local = BVHD_LOCAL_ALWAYS};
    rows = failures = 0;
    assert_int_equal(bvhd_client_create(&options, &world.client, NULL), BVHD_OK);
    test_right(NULL);
    clients();
    batches();
    values();
    builds();
    infos();
    geometries();
    instances();
    scenes();
    traversal();
    structures();
    micromaps();
    bvhd_client_destroy(world.client);
    assert_int_equal(library_memory.live, live);
    assert_int_equal(failures, 0);
    assert_true(rows >= MISUSES_LEAST);
    assert_non_null(bvhd_version());
    printf("%d misuses\n", rows);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_misuses)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
