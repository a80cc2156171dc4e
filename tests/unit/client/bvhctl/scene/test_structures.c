/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_structures.c - tests that built files are opened and traced alike for every target, and that bad files are
 * refused.
 */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>
#include <unistd.h>

#include "client/bvhctl/base/files.h"
#include "tests/support/random.h"
#include "builder/format/serialized.h"
#include "tests/support/client/bvhctl/test_world.h"
#include "client/bvhctl/scene/unpack.h"
#include "tests/support/scratch.h"

/* Variant 0 is the portable target. */
static void open_world(struct test_world *world, uint32_t variant, struct bvhd_format *format)
{
    *format = (struct bvhd_format){.struct_size = sizeof *format, .target = BVHD_TARGET_LAVAPIPE, .variant = variant};
    test_world_init_for(world, 1, variant ? format : NULL);
}

static void put_file(const char *name, const void *data, uint64_t size)
{
    char path[128];
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    snprintf(path, sizeof path, "%s/%s", scratch_folder, name);
    assert_int_equal(files_write(path, (struct bytes){data, size}, &memory, NULL, NULL), BVHD_OK);
}

#define BOTTOM(file)                                                                                                   \
    "{\"file\":\"" file "\",\"type\":\"blas\",\"scene\":\"world\",\"name\":\"\",\"target\":\"%s\",\"geometries\":[{"   \
    "\"color\":[0.5,0.25,1]}]}"

static void put_manifest(const char *target, const char *top, const char *handles)
{
    char text[2048];
    snprintf(
        text, sizeof text,
        "{\"schema\":1,\"structures\":[" BOTTOM("ground.as") "," BOTTOM(
            "cube.as") ",{\"file\":\"%s\",\"type\":\"tlas\",\"scene\":\"world\",\"name\":\"\",\"target\":\"%s\","
                       "\"geometries\":["
                       "],\"handles\":[%s]},{\"file\":\"cube.as\",\"type\":\"blas\",\"scene\":\"alone\",\"name\":\"\","
                       "\"target\":\"%s\",\"geometries\":[]}]}",
        target, target, top, target, handles, target);
    put_file(MANIFEST_NAME, text, strlen(text));
}

static const char *const portable_handles = "\"ground.as\",\"cube.as\"", *const native_handles =
                                                                             "\"ground.as\",\"cube.as\",\"cube.as\"";

/* Writes the files and the manifest that a build would write. */
static void put_world(const struct test_world *world, uint32_t variant)
{
    static const char *const names[] = {"ground.as", "cube.as", "top.as"};
    for (int i = 0; i < TEST_WORLD_FILES; i++)
        put_file(names[i], world->assembly.items[i].data, world->assembly.items[i].size);
    put_manifest(variant ? "lavapipe" : "portable", "top.as", variant ? native_handles : portable_handles);
}

static struct ray make_ray(struct random *random)
{
    struct ray ray = {.tmax = INFINITY, .cull_mask = 0xff};
    double from[3], to[3];
    random_point(random, from);
    random_point(random, to);
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)(from[axis] * 6 + (axis == 1 ? 4 : 0));
        ray.direction[axis] = (float)(to[axis] * 4 - ray.origin[axis]);
    }
    return ray;
}

static void assert_same_answers(const struct structures *a, const struct structures *b)
{
    struct random random = {5};
    int hits = 0;
    for (int i = 0; i < 2000; i++) {
        struct ray ray = make_ray(&random);
        struct ray_hit x, y;
        bool is_hit = structures_trace(a, &ray, &x);
        assert_int_equal(structures_trace(b, &ray, &y), is_hit);
        if (!is_hit)
            continue;
        float corners[2][3][3];
        structures_corners(a, &x, 0, corners[0]);
        structures_corners(b, &y, 0, corners[1]);
        assert_true(x.t == y.t && x.instance == y.instance && x.geometry == y.geometry && x.primitive == y.primitive);
        assert_int_equal(x.handle, y.handle);
        assert_memory_equal(corners[0], corners[1], sizeof corners[0]);
        hits++;
    }
    assert_true(hits > 500);
}

/* Structures of every target can be read again, and give the same answers. */
static void test_both_targets(void **state)
{
    (void)state;
    struct bvhd_format format;
    struct test_world reference;
    open_world(&reference, 0, &format);
    for (uint32_t variant = 0; variant <= LAVAPIPE_VARIANTS; variant++) {
        struct test_world world;
        struct structures structures, alone;
        struct memory memory;
        open_world(&world, variant, &format);
        put_world(&world, variant);
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(structures_open(scratch_folder, "world", &memory, &structures, NULL), BVHD_OK);
        assert_int_equal(structures.target, variant ? TARGET_LAVAPIPE : TARGET_PORTABLE);
        assert_true(structures.has_top && structures.bottom_count == 2 && structures.file_count == 3);
        for (int i = 0; i < TEST_WORLD_FILES; i++) {
            assert_int_equal(structures.blobs[i].size, world.assembly.items[i].size);
            assert_memory_equal(structures.blobs[i].data, world.assembly.items[i].data, structures.blobs[i].size);
        }
        assert_same_answers(&reference.structures, &structures);
        assert_true(structures_colour(&structures, 1, 0)[0] == 0.5f && !structures_colour(&structures, 1, 1) &&
                    !structures_colour(&structures, 2, 0));

        assert_int_equal(structures_open(scratch_folder, "alone", &memory, &alone, NULL), BVHD_OK);
        assert_true(!alone.has_top && alone.file_count == 1 && !structures_top(&alone));
        struct ray ray = {.origin = {0.25f, 9, 0.5f}, .direction = {0, -1, 0}, .tmax = INFINITY, .cull_mask = 1};
        struct ray_hit hit;
        assert_true(structures_trace(&alone, &ray, &hit) && hit.t == 8);
        structures_close(&alone);
        structures_close(&structures);
        structures_close(&structures);
        assert_int_equal(memory.live, 0);
        test_world_finish(&world);
    }
    test_world_finish(&reference);
}

/* The triangles and instances that are unpacked are those of the import. */
static void test_unpacked(void **state)
{
    (void)state;
    for (uint32_t variant = 0; variant <= LAVAPIPE_VARIANTS; variant++) {
        struct bvhd_format format;
        struct test_world world;
        struct unpacked unpacked;
        float bounds[6];
        open_world(&world, variant, &format);
        structure_bounds(structures_top(&world.structures), bounds);
        assert_true(bounds[0] <= -8 && bounds[0] > -8.001f && bounds[4] >= 2 && bounds[4] < 2.001f);
        assert_int_equal(structure_instance_count(structures_top(&world.structures)), 3);
        assert_int_equal(unpack_structures(&world.structures, &world.local.memory, &unpacked, NULL), BVHD_OK);
        assert_int_equal(unpacked.mesh_count, 3);
        for (uint32_t m = 0; m < unpacked.mesh_count; m++) {
            const struct oracle_mesh *mesh = &unpacked.meshes[m];
            const struct import_instance *instance = &world.import.instances[mesh->instance];
            const struct import_mesh *source =
                &world.import.meshes[world.import.bottoms[instance->bottom].meshes[mesh->geometry]];
            assert_int_equal(mesh->primitive_count, source->primitive_count);
            assert_memory_equal(mesh->transform, instance->transform, sizeof instance->transform);
            for (uint32_t i = 0; i < 3 * mesh->primitive_count; i++)
                assert_memory_equal(mesh->positions + 3 * i, source->positions + 3 * source->indices[i],
                                    3 * sizeof(float));
        }
        unpack_finish(&unpacked);
        test_world_finish(&world);
    }
}

static void expect(enum bvhd_status expected, const char *place)
{
    struct memory memory;
    struct structures structures;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = structures_open(scratch_folder, "world", &memory, &structures, &error);
    if (status != expected || !strstr(error.where, place))
        fail_msg("%s: %s: %s", bvhd_status_name(status), error.where, error.text);
    assert_int_equal(memory.live, 0);
}

/* Manifests that contradict their files are refused. */
static void test_wrong_manifests(void **state)
{
    (void)state;
    struct bvhd_format format;
    struct test_world worlds[2];
    for (uint32_t variant = 0; variant < 2; variant++) {
        const char *target = variant ? "lavapipe" : "portable", *other = variant ? "portable" : "lavapipe";
        const char *handles = variant ? native_handles : portable_handles;
        open_world(&worlds[variant], variant, &format);
        put_world(&worlds[variant], variant);
        put_manifest(other, "top.as", handles);
        expect(BVHD_CORRUPT, "top.as");
        put_manifest(target, "cube.as", handles);
        expect(BVHD_CORRUPT, "cube.as");
        put_manifest(target, "top.as", "\"ground.as\"");
        expect(BVHD_CORRUPT, "top.as");
        put_manifest(target, "top.as", variant ? "\"ground.as\",\"cube.as\",\"top.as\"" : "\"ground.as\",\"top.as\"");
        expect(BVHD_CORRUPT, "top.as");
        put_manifest(target, "top.as", variant ? "\"none.as\",\"cube.as\",\"cube.as\"" : "\"none.as\",\"cube.as\"");
        expect(BVHD_NOT_FOUND, "none.as");
        put_manifest(target, "top.as", handles);
        put_file("cube.as", worlds[variant].assembly.items[1].data, worlds[variant].assembly.items[1].size - 1);
        expect(BVHD_CORRUPT, "cube.as");
        put_file("cube.as", "", 0);
        expect(BVHD_CORRUPT, "cube.as");
    }
    /* A bottom level of the other target is refused under a good top level. */
    put_world(&worlds[1], 1);
    put_file("cube.as", worlds[0].assembly.items[1].data, worlds[0].assembly.items[1].size);
    expect(BVHD_CORRUPT, "cube.as");
    test_world_finish(&worlds[0]);
    test_world_finish(&worlds[1]);
}

/* Handles that no build writes are refused. */
static void test_wrong_handles(void **state)
{
    (void)state;
    static const uint64_t wrong[] = {0, 4, UINT32_MAX, UINT64_MAX, UINT64_C(1) << 32};
    for (uint32_t variant = 0; variant < 2; variant++) {
        struct bvhd_format format;
        struct test_world world;
        open_world(&world, variant, &format);
        put_world(&world, variant);
        const struct bvhd_result *item = &world.assembly.items[2];
        unsigned char *top = malloc(item->size);
        assert_non_null(top);
        memcpy(top, item->data, item->size);
        for (unsigned i = 0; i < sizeof wrong / sizeof *wrong; i++) {
            bytes_put64(top + SERIALIZED_HANDLES + 8, wrong[i]);
            put_file("top.as", top, item->size);
            expect(BVHD_CORRUPT, "top.as");
        }
        /* Two handles for row 0, for which the manifest has two files; in a portable structure handles are distinct. */
        bytes_put64(top + SERIALIZED_HANDLES + 8, 1);
        put_file("top.as", top, item->size);
        expect(BVHD_CORRUPT, "top.as");
        free(top);
        test_world_finish(&world);
    }
}

/* A native top level may leave rows out, and several of its rows may be one file. */
static void test_rows(void **state)
{
    (void)state;
    struct bvhd_format format;
    struct test_world world;
    struct structures structures;
    struct memory memory;
    open_world(&world, 1, &format);
    put_world(&world, 1);
    const struct bvhd_result *item = &world.assembly.items[2];
    unsigned char *top = malloc(item->size);
    assert_non_null(top);
    memcpy(top, item->data, item->size);
    bytes_put64(top + SERIALIZED_HANDLES, 3);
    bytes_put64(top + SERIALIZED_HANDLES + 8, 1);
    bytes_put64(top + SERIALIZED_HANDLES + 16, 3);
    put_file("top.as", top, item->size);
    put_manifest("lavapipe", "top.as", "\"cube.as\",\"cube.as\",\"cube.as\"");
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(structures_open(scratch_folder, NULL, &memory, &structures, NULL), BVHD_OK);
    assert_true(structures.bottom_count == 3 && structures.file_count == 4);
    assert_ptr_equal(structures.blobs[0].data, structures.blobs[2].data);
    assert_null(structures.blobs[1].data);
    assert_non_null(structures_colour(&structures, 2, 0));
    structures_close(&structures);
    assert_int_equal(memory.live, 0);
    free(top);
    test_world_finish(&world);
}

/* Leaves that are not in the order of primitives are refused; only structure_open checks that. */
static void test_wrong_leaves(void **state)
{
    (void)state;
    struct bvhd_format format;
    struct test_world world;
    open_world(&world, 1, &format);
    const struct bvhd_result *item = &world.assembly.items[1];
    const struct lavapipe_view *view = &world.structures.files[1].structure.view.lavapipe;
    unsigned char *blob = aligned_alloc(16, (item->size + 15) / 16 * 16);
    assert_non_null(blob);
    size_t leaves = (size_t)(view->body - (const unsigned char *)item->data) + view->leaf_offset;
    static const struct {
        uint32_t leaf, field, value;
    } changes[] = {{0, 40, 1}, {3, 40, 4},   {3, 44, 0},
                   {5, 44, 1}, {11, 40, 10}, {11, 44, LAVAPIPE_GEOMETRY_OPAQUE + 0xffffff}};
    for (unsigned i = 0; i < sizeof changes / sizeof *changes; i++) {
        struct structure structure;
        struct bvhd_error error = {0};
        memcpy(blob, item->data, item->size);
        bytes_put32(blob + leaves + (size_t)48 * changes[i].leaf + changes[i].field, changes[i].value);
        uint64_t live = world.local.memory.live;
        assert_int_equal(structure_open((struct bytes){blob, item->size}, &world.local.memory, &structure, &error),
                         BVHD_CORRUPT);
        assert_true(!strncmp(error.where, "leaf[", 5));
        assert_int_equal(world.local.memory.live, live);
    }
    free(blob);
    test_world_finish(&world);
}

/* Numbers of instances that no request can have are refused, because tables of that size would be allocated. */
static void test_wrong_instances(void **state)
{
    (void)state;
    static const uint32_t wrong[] = {UINT32_MAX, UINT32_MAX - 1, LAVAPIPE_MAX_PRIMITIVES};
    struct bvhd_format format;
    struct test_world world;
    open_world(&world, 1, &format);
    put_world(&world, 1);
    const struct bvhd_result *item = &world.assembly.items[2];
    const struct lavapipe_view *view = &structures_top(&world.structures)->view.lavapipe;
    size_t last = (size_t)(view->body - structures_top(&world.structures)->blob.data) + view->leaf_offset +
                  sizeof(struct lavapipe_instance) * (view->leaf_count - 1);
    unsigned char *top = malloc(item->size);
    assert_non_null(top);
    memcpy(top, item->data, item->size);
    for (unsigned i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        bytes_put32(top + last + offsetof(struct lavapipe_instance, instance), wrong[i]);
        put_file("top.as", top, item->size);
        expect(BVHD_CORRUPT, "top.as");
    }
    free(top);
    test_world_finish(&world);
}

/* Structures that move may be empty, too. */
static void test_moving(void **state)
{
    (void)state;
    static const uint32_t moving[] = {PORTABLE_MOVING_TRIANGLES, PORTABLE_MOVING_INSTANCES};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (unsigned i = 0; i < sizeof moving / sizeof *moving; i++) {
        enum { BODY = 64, BYTES = BODY + sizeof(struct portable_header) };
        _Alignas(16) unsigned char blob[BYTES] = {0};
        struct serialized_header serialized = {.serialized_size = BYTES, .deserialized_size = BYTES - BODY};
        const struct portable_header header = {.magic = PORTABLE_MAGIC,
                                               .version = 2,
                                               .content = moving[i],
                                               .bounds = {FLT_MAX, FLT_MAX, FLT_MAX, -FLT_MAX, -FLT_MAX, -FLT_MAX},
                                               .node_offset = sizeof header,
                                               .record_offset = sizeof header,
                                               .vertex_offset = sizeof header,
                                               .geometry_offset = sizeof header,
                                               .body_size = sizeof header};
        memcpy(serialized.driver_uuid, portable_driver_uuid, sizeof serialized.driver_uuid);
        portable_compatibility_uuid(header.version, serialized.compatibility_uuid);
        serialized_write(blob, &serialized);
        memcpy(blob + BODY, &header, sizeof header);
        struct structure structure;
        assert_int_equal(structure_open((struct bytes){blob, BYTES}, &memory, &structure, NULL), BVHD_OK);
        assert_true(structure.moves);
        assert_int_equal(structure_triangle_count(&structure) + structure_instance_count(&structure), 0);
        structure_close(&structure);
        assert_int_equal(memory.live, 0);
    }
}

/* Every file is refused when it is truncated anywhere, or has a byte too many. */
static void test_cut(void **state)
{
    (void)state;
    for (uint32_t variant = 0; variant <= LAVAPIPE_VARIANTS; variant++) {
        struct bvhd_format format;
        struct test_world world;
        open_world(&world, variant, &format);
        for (int i = 0; i < TEST_WORLD_FILES; i++) {
            const struct bvhd_result *item = &world.assembly.items[i];
            uint64_t live = world.local.memory.live;
            for (uint64_t size = 0; size <= item->size + 1; size++) {
                struct structure structure;
                unsigned char *blob = aligned_alloc(16, (size + 16) / 16 * 16);
                assert_non_null(blob);
                memset(blob, 0, size);
                memcpy(blob, item->data, size < item->size ? size : item->size);
                enum bvhd_status status =
                    structure_open((struct bytes){blob, size}, &world.local.memory, &structure, NULL);
                assert_int_equal(status, size == item->size ? BVHD_OK : BVHD_CORRUPT);
                if (status == BVHD_OK)
                    structure_close(&structure);
                assert_int_equal(world.local.memory.live, live);
                free(blob);
            }
        }
        test_world_finish(&world);
    }
}

static void test_no_memory(void **state)
{
    (void)state;
    for (uint32_t variant = 0; variant <= 1; variant++) {
        struct bvhd_format format;
        struct test_world world;
        struct memory memory;
        open_world(&world, variant, &format);
        put_world(&world, variant);
        memory_init(&memory, UINT64_MAX);
        enum bvhd_status status = BVHD_NO_MEMORY;
        int64_t after = 0;
        for (; status != BVHD_OK; after++) {
            struct structures structures;
            struct unpacked unpacked;
            atomic_store(&memory.fail_after, after);
            status = structures_open(scratch_folder, NULL, &memory, &structures, NULL);
            if (status == BVHD_OK) {
                status = unpack_structures(&structures, &memory, &unpacked, NULL);
                if (status == BVHD_OK)
                    unpack_finish(&unpacked);
                structures_close(&structures);
            }
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
            assert_int_equal(memory.live, 0);
            assert_true(after < 200);
        }
        assert_true(after > 30);
        test_world_finish(&world);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_both_targets),    cmocka_unit_test(test_unpacked), cmocka_unit_test(test_wrong_manifests),
        cmocka_unit_test(test_wrong_handles),   cmocka_unit_test(test_rows),     cmocka_unit_test(test_wrong_leaves),
        cmocka_unit_test(test_wrong_instances), cmocka_unit_test(test_cut),      cmocka_unit_test(test_no_memory),
        cmocka_unit_test(test_moving),
    };
    return cmocka_run_group_tests_name("structures", tests, scratch_make, scratch_remove);
}
