/* SPDX-License-Identifier: Apache-2.0 */
/* test_assemble.c - tests that an imported scene is built into the right structures, whatever its backend answers. */
#include "tests/support/unit.h"

#include "proto/base/bytes.h"
#include "tests/support/client/bvhctl/test_world.h"
#include "client/bvhctl/scene/assemble_internal.h"
#include "client/bvhctl/scene/unpack.h"

static void test_structures(void **state)
{
    (void)state;
    struct test_world world;
    test_world_init(&world, 1);
    const struct bvhd_result *items = world.assembly.items;
    assert_int_equal(items[0].triangles, 2);
    assert_int_equal(items[1].triangles, 12);
    assert_int_equal(items[2].instances, TEST_WORLD_INSTANCES);
    assert_int_equal(items[2].inactive, 1);
    assert_int_equal(world.assembly.handle_count, 2);
    assert_int_equal(world.assembly.handles[0], 0);
    assert_int_equal(world.assembly.handles[1], 1);
    assert_int_equal(world.structures.bottom_count, 2);
    test_world_finish(&world);
}

static bool shoot_down(const struct test_world *world, float x, float z, struct ray_hit *ret_hit)
{
    struct ray ray = {.origin = {x, 10, z}, .direction = {0, -1, 0}, .tmax = 100, .cull_mask = 0xff};
    return structures_trace(&world->structures, &ray, ret_hit);
}

/* Rays from above hit what is known to be there. */
static void test_answers(void **state)
{
    (void)state;
    struct test_world world;
    struct ray_hit hit;
    test_world_init(&world, 2);
    assert_true(shoot_down(&world, 0.25f, 0.5f, &hit));
    assert_int_equal(hit.instance, 1);
    assert_int_equal(hit.custom_index, 1);
    assert_true(hit.t == 8);
    assert_true(shoot_down(&world, 3.25f, 0.125f, &hit));
    assert_int_equal(hit.instance, 3);
    assert_true(hit.t == 9);
    assert_true(shoot_down(&world, -5, 2, &hit));
    assert_int_equal(hit.instance, 0);
    assert_true(hit.t == 10);
    assert_false(shoot_down(&world, 9, 0, &hit));
    test_world_finish(&world);
}

/* The triangles that are unpacked from the files are the imported ones, bit by bit and with the same numbers. */
static void test_unpack(void **state)
{
    (void)state;
    struct test_world world;
    struct unpacked unpacked;
    test_world_init(&world, 1);
    assert_int_equal(unpack_structures(&world.structures, &world.local.memory, &unpacked, NULL), BVHD_OK);
    assert_int_equal(unpacked.mesh_count, 3);
    assert_int_equal(unpacked.primitive_count, 2 + 12 + 12);
    for (uint32_t m = 0; m < unpacked.mesh_count; m++) {
        const struct oracle_mesh *mesh = &unpacked.meshes[m];
        const struct import_instance *instance = &world.import.instances[mesh->instance];
        const struct import_mesh *source =
            &world.import.meshes[world.import.bottoms[instance->bottom].meshes[mesh->geometry]];
        assert_int_equal(mesh->primitive_count, source->primitive_count);
        assert_memory_equal(mesh->transform, instance->transform, sizeof instance->transform);
        for (uint32_t i = 0; i < 3 * mesh->primitive_count; i++)
            assert_memory_equal(mesh->positions + 3 * i, source->positions + 3 * source->indices[i], 3 * sizeof(float));
    }
    unpack_finish(&unpacked);
    unpack_finish(&unpacked);
    test_world_finish(&world);
    assert_int_equal(world.local.memory.live, 0);
}

/* Motion instances have the type of their motion, and its numbers; inactive ones name nothing, whatever they have. */
static void test_motion_records(void **state)
{
    (void)state;
    struct import_motion motions[2] = {{.kind = ORACLE_MATRIX}, {.kind = ORACLE_SRT}};
    struct import_instance instances[4] = {{.motion = 0, .transform = {1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 1, 7}},
                                           {.motion = 1},
                                           {.motion = 2},
                                           {.motion = 2, .skipped = true}};
    const struct import import = {.instances = instances, .instance_count = 4, .motions = motions, .motion_count = 2};
    for (int i = 0; i < 16; i++)
        for (int k = 0; k < 2; k++) {
            motions[k].start[i] = (float)(100 * k + i);
            motions[k].end[i] = (float)(1000 + 100 * k + i);
        }
    _Static_assert(sizeof(struct assemble_motion_record) == 160, "as far apart as Vulkan reads them");
    VkAccelerationStructureMotionInstanceNV record = assemble_describe_motion(&import, 0, 9).instance;
    assert_int_equal(record.type, VK_ACCELERATION_STRUCTURE_MOTION_INSTANCE_TYPE_STATIC_NV);
    assert_true(record.data.staticInstance.transform.matrix[2][3] == 7 && record.flags == 0);
    assert_int_equal(record.data.staticInstance.accelerationStructureReference, 9);
    record = assemble_describe_motion(&import, 1, 9).instance;
    assert_int_equal(record.type, VK_ACCELERATION_STRUCTURE_MOTION_INSTANCE_TYPE_MATRIX_MOTION_NV);
    const VkAccelerationStructureMatrixMotionInstanceNV *matrices = &record.data.matrixMotionInstance;
    assert_true(matrices->transformT0.matrix[2][3] == 11 && matrices->transformT1.matrix[0][1] == 1001);
    assert_true(matrices->mask == 0xff && matrices->instanceCustomIndex == 1);
    assert_int_equal(matrices->accelerationStructureReference, 9);
    record = assemble_describe_motion(&import, 2, 9).instance;
    assert_int_equal(record.type, VK_ACCELERATION_STRUCTURE_MOTION_INSTANCE_TYPE_SRT_MOTION_NV);
    const VkAccelerationStructureSRTMotionInstanceNV *srt = &record.data.srtMotionInstance;
    assert_true(srt->transformT0.sx == 100 && srt->transformT0.pvx == 103 && srt->transformT0.pvz == 108);
    assert_true(srt->transformT1.qx == 1109 && srt->transformT1.qw == 1112 && srt->transformT1.tz == 1115);
    assert_true(srt->mask == 0xff && srt->instanceCustomIndex == 2);
    assert_int_equal(srt->accelerationStructureReference, 9);
    record = assemble_describe_motion(&import, 3, 9).instance;
    assert_int_equal(record.type, VK_ACCELERATION_STRUCTURE_MOTION_INSTANCE_TYPE_STATIC_NV);
    assert_int_equal(record.data.staticInstance.accelerationStructureReference, 0);
    assert_true(record.data.staticInstance.transform.matrix[1][1] == 1);
}

/*
 * Both preferences together break a rule (VUID-VkAccelerationStructureBuildGeometryInfoKHR-flags-03796): every bottom
 * level reports it, and the top level reports that a bottom level is missing.
 */
static void test_rules_are_reported(void **state)
{
    (void)state;
    struct test_world world;
    struct assembly assembly;
    test_world_init(&world, 1);
    world.options.build_flags = BUILD_PREFER_FAST_BUILD | BUILD_PREFER_FAST_TRACE;
    assert_int_equal(assemble(&world.import, &world.options, &world.backend.backend, &assembly, NULL), BVHD_OK);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(assembly.items[i].error.status, BVHD_INVALID);
        assert_int_equal(assembly.items[i].error.vuid, BVHD_VUID_03796);
    }
    assert_int_equal(assembly.items[2].error.status, BVHD_INVALID);
    assert_non_null(strstr(assembly.items[2].error.text, "bottom level 0"));
    assembly_finish(&assembly);
    assembly_finish(&assembly);
    test_world_finish(&world);
}

static void test_cancelled(void **state)
{
    (void)state;
    struct test_world world;
    struct assembly assembly;
    atomic_bool cancel = true;
    test_world_init(&world, 1);
    world.backend.context.cancel = &cancel;
    assert_int_equal(assemble(&world.import, &world.options, &world.backend.backend, &assembly, NULL), BVHD_OK);
    for (int i = 0; i < 3; i++)
        assert_int_equal(assembly.items[i].error.status, BVHD_CANCELLED);
    assembly_finish(&assembly);
    test_world_finish(&world);
}

static bool all_built(const struct assembly *assembly)
{
    bool all = true;
    for (int i = 0; i < 3; i++) {
        enum bvhd_status status = assembly->items[i].error.status;
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        all &= status == BVHD_OK;
    }
    return all;
}

static void test_no_memory(void **state)
{
    (void)state;
    struct test_world world;
    test_world_init(&world, 1);
    uint64_t live = world.local.memory.live;
    bool done = false;
    for (int64_t after = 0; !done; after++) {
        struct assembly assembly;
        atomic_store(&world.local.memory.fail_after, after);
        enum bvhd_status status =
            assemble(&world.import, &world.options, &world.backend.backend, &assembly, &(struct bvhd_error){0});
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        if (status == BVHD_OK) {
            done = all_built(&assembly);
            assembly_finish(&assembly);
        }
        assert_int_equal(world.local.memory.live, live);
        assert_true(after < 2000);
    }
    test_world_finish(&world);
}

/*
 * A backend that gives two different bottom levels and then loses its connection. It records the requests.
 */
struct vanishing {
    struct backend backend;
    struct backend *real;
    uint32_t asked, held;
};

static enum bvhd_status build_once(struct backend *backend, const struct bvhd_build *build,
                                   struct bvhd_result *ret_results, void **ret_hold, struct bvhd_error *error)
{
    struct vanishing *vanishing = (struct vanishing *)backend;
    assert_int_equal(build->struct_size, sizeof *build);
    if (vanishing->asked++ == 1) {
        assert_int_equal(build->info_count, 1);
        assert_int_equal(build->infos[0].type, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR);
        assert_int_equal(build->reference_count, 2);
        for (int i = 0; i < 2; i++)
            assert_true(build->references[i].has_key && build->references[i].handle);
        assert_memory_not_equal(&build->references[0].key, &build->references[1].key, sizeof(struct bvhd_key));
        assert_true(build->references[1].bounds[0] == -1 && build->references[1].bounds[5] == 1);
        return bvhd_error_set(error, BVHD_UNAVAILABLE, "socket", "gone");
    }
    assert_int_equal(build->info_count, 2);
    vanishing->held++;
    return vanishing->real->build(vanishing->real, build, ret_results, ret_hold, error);
}

static void release_once(struct backend *backend, void *hold)
{
    struct vanishing *vanishing = (struct vanishing *)backend;
    vanishing->held -= hold != NULL;
    vanishing->real->release(vanishing->real, hold);
}

static void test_lost_backend(void **state)
{
    (void)state;
    struct test_world world;
    struct assembly assembly;
    struct bvhd_error error;
    test_world_init(&world, 1);
    uint64_t live = world.local.memory.live;
    struct vanishing vanishing = {.backend = {build_once, release_once}, .real = &world.backend.backend};
    assert_int_equal(assemble(&world.import, &world.options, &vanishing.backend, &assembly, &error), BVHD_UNAVAILABLE);
    assert_int_equal(error.status, BVHD_UNAVAILABLE);
    assert_string_equal(error.text, "gone");
    assert_int_equal(vanishing.asked, 2);
    assert_int_equal(vanishing.held, 0);
    assert_int_equal(world.local.memory.live, live);
    test_world_finish(&world);
}

/* A backend that builds what is to be updated, and answers as planned about it. */
struct refitting {
    struct backend backend;
    struct backend *real;
    struct bvhd_error errors[2]; /* of the updates of the bottom levels; BVHD_OK: it has the decay */
    double decays[2];
    struct bvhd_key expected[3]; /* of the sources: of the bottom levels, then of the top level */
    uint32_t update_count, build_count; /* infos that were asked for */
};

static void check_source(const struct refitting *refitting, const struct bvhd_build *build, uint32_t info)
{
    bool is_top = build->infos[info].type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, found = false;
    uint64_t source;
    memcpy(&source, &build->infos[info].srcAccelerationStructure, sizeof source);
    for (uint32_t i = 0; i < build->reference_count; i++) {
        const struct bvhd_reference *reference = &build->references[i];
        if (reference->handle != source)
            continue;
        assert_false(found);
        found = true;
        assert_true(reference->has_key);
        assert_memory_equal(&reference->key, &refitting->expected[is_top ? 2 : info], sizeof reference->key);
    }
    assert_true(found);
}

static enum bvhd_status refit_or_build(struct backend *backend, const struct bvhd_build *build,
                                       struct bvhd_result *ret_results, void **ret_hold, struct bvhd_error *error)
{
    struct refitting *refitting = (struct refitting *)backend;
    VkAccelerationStructureBuildGeometryInfoKHR infos[2];
    struct bvhd_build plain = *build;
    assert_true(build->info_count <= 2);
    for (uint32_t i = 0; i < build->info_count; i++) {
        bool is_update = build->infos[i].mode == VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR;
        infos[i] = build->infos[i];
        infos[i].mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR;
        infos[i].srcAccelerationStructure = VK_NULL_HANDLE;
        refitting->update_count += is_update;
        refitting->build_count += !is_update;
        plain.reference_count -= is_update;
        if (is_update)
            check_source(refitting, build, i);
    }
    plain.infos = infos;
    enum bvhd_status status = refitting->real->build(refitting->real, &plain, ret_results, ret_hold, error);
    for (uint32_t i = 0; i < build->info_count && status == BVHD_OK; i++)
        if (build->infos[i].mode == VK_BUILD_ACCELERATION_STRUCTURE_MODE_UPDATE_KHR) {
            bool is_top = build->infos[i].type == VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR;
            ret_results[i].decay = is_top ? 1 : refitting->decays[i];
            ret_results[i].refits = 1;
            if (!is_top)
                ret_results[i].error = refitting->errors[i];
        }
    return status;
}

static void release_refit(struct backend *backend, void *hold)
{
    struct refitting *refitting = (struct refitting *)backend;
    refitting->real->release(refitting->real, hold);
}

/*
 * An update is kept, unless its source is lost, other primitives are active, or the tree has decayed: then the
 * structure is built.
 */
static void test_updates(void **state)
{
    (void)state;
    static const struct plan {
        struct bvhd_error error;
        double decay;
        enum assembly_method method;
        enum bvhd_status status; /* in the end */
        double most_decay, rays;
    } plans[] = {
        {{.status = BVHD_OK}, 1.4, ASSEMBLY_UPDATED, BVHD_OK, 1.5, 0},
        {{.status = BVHD_OK}, 1.6, ASSEMBLY_DECAYED, BVHD_OK, 1.5, 0},
        {{.status = BVHD_OK}, 1.4, ASSEMBLY_UPDATED, BVHD_OK, 0, 0},
        {{.status = BVHD_OK}, 9, ASSEMBLY_DECAYED, BVHD_OK, 0, 0},
        {{.status = BVHD_OK}, 9, ASSEMBLY_UPDATED, BVHD_OK, 0, 0.01},
        {{.status = BVHD_OK}, 1.4, ASSEMBLY_DECAYED, BVHD_OK, 0, 100},
        {{.status = BVHD_OK}, 1.4, ASSEMBLY_UPDATED, BVHD_OK, 1.5, 100},
        {{.status = BVHD_SOURCE_LOST}, 0, ASSEMBLY_LOST, BVHD_OK, 1.5, 0},
        {{.status = BVHD_INVALID, .vuid = BVHD_VUID_03663}, 0, ASSEMBLY_OTHER_ACTIVE, BVHD_OK, 1.5, 0},
        {{.status = BVHD_INVALID, .vuid = BVHD_VUID_03664}, 0, ASSEMBLY_OTHER_ACTIVE, BVHD_OK, 1.5, 0},
        {{.status = BVHD_INVALID, .vuid = BVHD_VUID_03758}, 0, ASSEMBLY_UPDATED, BVHD_INVALID, 1.5, 0},
    };
    struct test_world world;
    test_world_init(&world, 1);
    for (size_t i = 0; i < sizeof plans / sizeof *plans; i++) {
        struct refitting refitting = {.backend = {refit_or_build, release_refit}, .real = &world.backend.backend};
        struct assembly_source items[3] = {{true, {{1}}}, {true, {{2}}}, {true, {{3}}}};
        const struct assembly_sources sources = {items, plans[i].most_decay, plans[i].rays};
        struct assembly assembly;
        bool is_rebuilt = plans[i].method != ASSEMBLY_UPDATED;
        for (int k = 0; k < 3; k++)
            refitting.expected[k] = items[k].key;
        refitting.errors[1] = plans[i].error;
        refitting.decays[0] = 1;
        refitting.decays[1] = plans[i].decay;
        assert_int_equal(assemble_update(&world.import, &world.options, &sources, &refitting.backend, &assembly, NULL),
                         BVHD_OK);
        assert_int_equal(assembly.outcomes[0].method, ASSEMBLY_UPDATED);
        assert_int_equal(assembly.outcomes[1].method, plans[i].method);
        assert_true(assembly.outcomes[1].decay == plans[i].decay);
        assert_int_equal(assembly.items[1].error.status, plans[i].status);
        assert_int_equal(assembly.items[1].refits, is_rebuilt ? 0 : 1);
        assert_int_equal(refitting.build_count, is_rebuilt);
        assert_int_equal(refitting.update_count, plans[i].status == BVHD_OK ? 3 : 2);
        assembly_finish(&assembly);
    }
    test_world_finish(&world);
    assert_int_equal(world.local.memory.live, 0);
}

/* Structures without a source are built in the same request. */
static void test_update_of_some(void **state)
{
    (void)state;
    struct test_world world;
    struct assembly assembly;
    test_world_init(&world, 1);
    struct refitting refitting = {
        .backend = {refit_or_build, release_refit}, .real = &world.backend.backend, .decays = {1, 1}};
    const struct assembly_source items[3] = {{true, {{1}}}, {0}, {0}};
    const struct assembly_sources sources = {items, 1.5, 0};
    refitting.expected[0] = items[0].key;
    assert_int_equal(assemble_update(&world.import, &world.options, &sources, &refitting.backend, &assembly, NULL),
                     BVHD_OK);
    assert_int_equal(refitting.update_count, 1);
    assert_int_equal(refitting.build_count, 2);
    assert_int_equal(assembly.outcomes[0].method, ASSEMBLY_UPDATED);
    assert_int_equal(assembly.outcomes[1].method, ASSEMBLY_BUILT);
    assert_true(all_built(&assembly));
    assembly_finish(&assembly);
    test_world_finish(&world);
}

/*
 * A native top level has one handle for each instance that is not skipped, in the order of its leaves; a portable one
 * has one for each bottom level.
 */
static void test_native_handles(void **state)
{
    (void)state;
    struct test_world world;
    struct assembly assembly;
    const struct bvhd_format format = {
        .struct_size = sizeof format, .target = BVHD_TARGET_LAVAPIPE, .variant = 2, .driver_uuid = {7}};
    test_world_init(&world, 1);
    world.options.build.target = TARGET_LAVAPIPE;
    world.options.format = &format;
    assert_int_equal(assemble(&world.import, &world.options, &world.backend.backend, &assembly, NULL), BVHD_OK);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(assembly.items[i].error.status, BVHD_OK);
        assert_int_equal(assembly.items[i].target, BVHD_TARGET_LAVAPIPE);
        assert_memory_equal(assembly.items[i].data, format.driver_uuid, 16);
        assert_memory_not_equal(&assembly.items[i].key, &world.assembly.items[i].key, sizeof(struct bvhd_key));
    }
    assert_int_equal(assembly.handle_count, TEST_WORLD_INSTANCES - 1);
    for (uint32_t i = 0; i < assembly.handle_count; i++)
        assert_int_equal(assembly.handles[i], i == 0 ? 0 : 1);
    assembly_finish(&assembly);
    world.options.format = NULL;
    struct bvhd_error error;
    assert_int_equal(assemble(&world.import, &world.options, &world.backend.backend, &assembly, &error), BVHD_INVALID);
    assert_string_equal(error.where, "build.format");
    test_world_finish(&world);
}

/* A backend whose top levels have another handle, or another size. */
struct lying {
    struct backend backend;
    struct backend *real;
    unsigned char top[4096];
    uint64_t handle, size;
};

static enum bvhd_status build_lies(struct backend *backend, const struct bvhd_build *build,
                                   struct bvhd_result *ret_results, void **ret_hold, struct bvhd_error *error)
{
    struct lying *lying = (struct lying *)backend;
    enum bvhd_status status = lying->real->build(lying->real, build, ret_results, ret_hold, error);
    if (build->info_count == 1) {
        assert_true(ret_results[0].size <= sizeof lying->top);
        memcpy(lying->top, ret_results[0].data, ret_results[0].size);
        bytes_put64(lying->top + 64, lying->handle);
        ret_results[0].data = lying->top;
        ret_results[0].size -= lying->size;
    }
    return status;
}

static void release_lies(struct backend *backend, void *hold)
{
    struct lying *lying = (struct lying *)backend;
    lying->real->release(lying->real, hold);
}

static void test_wrong_handles(void **state)
{
    (void)state;
    static const struct {
        uint64_t handle, size;
        enum bvhd_status status;
    } lies[] = {{2, 0, BVHD_OK},
                {0, 0, BVHD_CORRUPT},
                {3, 0, BVHD_CORRUPT},
                {UINT64_MAX, 0, BVHD_CORRUPT},
                {2, 1, BVHD_CORRUPT}};
    struct test_world world;
    test_world_init(&world, 1);
    uint64_t live = world.local.memory.live;
    for (size_t i = 0; i < sizeof lies / sizeof lies[0]; i++) {
        struct lying lying = {.backend = {build_lies, release_lies}, .real = &world.backend.backend};
        struct assembly assembly;
        lying.handle = lies[i].handle;
        lying.size = lies[i].size;
        assert_int_equal(assemble(&world.import, &world.options, &lying.backend, &assembly, NULL), BVHD_OK);
        assert_int_equal(assembly.items[0].error.status, BVHD_OK);
        assert_int_equal(assembly.items[2].error.status, lies[i].status);
        assembly_finish(&assembly);
        assert_int_equal(world.local.memory.live, live);
    }
    test_world_finish(&world);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_structures),
        cmocka_unit_test(test_answers),
        cmocka_unit_test(test_motion_records),
        cmocka_unit_test(test_unpack),
        cmocka_unit_test(test_rules_are_reported),
        cmocka_unit_test(test_cancelled),
        cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_lost_backend),
        cmocka_unit_test(test_updates),
        cmocka_unit_test(test_update_of_some),
        cmocka_unit_test(test_native_handles),
        cmocka_unit_test(test_wrong_handles),
    };
    return cmocka_run_group_tests_name("assemble", tests, NULL, NULL);
}
