/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_copies.c - tests our structures after a driver has copied them: cloned, compacted, and serialized and loaded
 * again, one after the other in several orders; bottom levels, top levels, and both. Every copy traces the same as the
 * scene that it comes from, and serializing it gives the bytes that we wrote, apart from addresses. Skipped (77) where
 * no device loads our structures.
 */
#include "tests/support/unit.h"

#include "tests/support/driver/driver_judge.h"
#include "tests/support/driver/driver_world.h"
#include "tests/support/driver/gpu_bed.h"
#include "builder/format/lavapipe.h"
#include "builder/format/serialized.h"

#define MUST(call) driver_scene_must((call), &error)

enum { RAYS = 200, MOST_ROWS = DRIVER_WORLD_BOTTOMS };

/* The ways to copy, and sequences of them. */
enum way { CLONE, COMPACT, RELOAD, WAYS };

static const enum way sequences[][WAYS] = {
    {CLONE, COMPACT, RELOAD}, {RELOAD, COMPACT, CLONE}, {RELOAD, RELOAD, RELOAD}};
enum { SEQUENCES = sizeof sequences / sizeof *sequences };

static struct memory memory;
static struct gpu *gpu;
static struct bvhd_format format;
static struct driver_world world;
static struct driver_scene scene;

static int set_up(void **state)
{
    (void)state;
    driver_world_init(&world, 3);
    const struct driver_scene_options options = {.gpu = gpu,
                                                 .format = &format,
                                                 .bottoms = world.bottoms,
                                                 .bottom_count = world.bottom_count,
                                                 .driver_bottoms = world.driver_bottoms,
                                                 .top = &world.top,
                                                 .quality = QUALITY_BALANCED,
                                                 .parallel = &parallel_serial};
    driver_scene_init(&scene, &options);
    assert_true(scene.row_count > 3 && scene.row_count <= MOST_ROWS);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    driver_scene_finish(&scene);
    driver_world_finish(&world);
    return 0;
}

/* ---- Copies ---- */

static struct driver_structure copy(const struct driver_structure *from, enum way way)
{
    struct bvhd_error error;
    struct driver_structure to;
    unsigned char *data;
    uint64_t size;
    if (way != RELOAD) {
        MUST(driver_structure_copy(gpu, from,
                                   way == CLONE ? VK_COPY_ACCELERATION_STRUCTURE_MODE_CLONE_KHR
                                                : VK_COPY_ACCELERATION_STRUCTURE_MODE_COMPACT_KHR,
                                   &to, &error));
        return to;
    }
    MUST(driver_structure_serialize(gpu, from, &memory, &data, &size, &error));
    MUST(driver_structure_load(gpu, data, size, &to, &error));
    memory_free(&memory, data);
    return to;
}

/* Copies, then copies the copy, and so on. Returns the last one; the others are destroyed by then. */
static struct driver_structure copy_in_turn(const struct driver_structure *from, const enum way ways[WAYS])
{
    struct driver_structure to = copy(from, ways[0]);
    for (int i = 1; i < WAYS; i++) {
        struct driver_structure next = copy(&to, ways[i]);
        driver_structure_destroy(gpu, &to);
        to = next;
    }
    return to;
}

/* The bytes that we wrote, with addresses in place of handles; `addresses` is indexed by row. */
static unsigned char *written_with(uint32_t row, const uint64_t *addresses)
{
    struct bvhd_error error;
    struct lavapipe_view view;
    const struct bvhd_vulkan_bytes *blob = &scene.blobs[row];
    unsigned char *bytes = memory_alloc(&memory, blob->size);
    assert_non_null(bytes);
    memcpy(bytes, blob->data, blob->size);
    MUST(lavapipe_open_any((struct bytes){bytes, blob->size}, &memory, &view, &error));
    for (uint64_t i = 0; i < view.handle_count; i++) {
        unsigned char *handle = bytes + SERIALIZED_HANDLES + 8 * i;
        uint64_t address = addresses[bytes_get64(handle) - 1];
        bytes_put64(handle, address);
        bytes_put64(bytes + (view.body - bytes) + view.leaf_offset + i * sizeof(struct lavapipe_instance), address);
    }
    return bytes;
}

static void assert_bytes_again(const struct driver_structure *structure, uint32_t row, const uint64_t *addresses)
{
    struct bvhd_error error;
    unsigned char *data, *written = written_with(row, addresses);
    uint64_t size;
    MUST(driver_structure_serialize(gpu, structure, &memory, &data, &size, &error));
    assert_int_equal(size, scene.blobs[row].size);
    assert_memory_equal(data, written, size);
    memory_free(&memory, data);
    memory_free(&memory, written);
}

static void our_addresses(uint64_t addresses[MOST_ROWS])
{
    for (uint32_t row = 0; row < scene.row_count; row++)
        addresses[row] = driver_scene_ours(&scene, row).address;
}

/* ---- Tracing them ---- */

/* Traces and compares with the driver's own structure of the same scene, which driver_query compares with ours. */
static void assert_traced_the_same(VkAccelerationStructureKHR top)
{
    struct driver_judge judge;
    struct ray *rays = calloc(RAYS, sizeof *rays);
    driver_judge_init(&judge, &scene, top);
    for (int kind = 0; kind < DRIVER_RAYS; kind++) {
        driver_world_rays(&world, (enum driver_rays)kind, 5 + (uint64_t)kind, RAYS, rays);
        for (uint32_t i = 0; i < driver_case_count; i += 4)
            driver_judge_queries(&judge, "copies", &driver_cases[i], rays, RAYS);
        driver_judge_pipelines(&judge, "copies", &driver_cases[0], rays, RAYS);
    }
    assert_int_equal(judge.tally.other, 0);
    assert_true(judge.tally.hits * 5 > judge.tally.rays);
    driver_judge_finish(&judge);
    free(rays);
}

static void what_was_loaded_gives_its_bytes(void **state)
{
    (void)state;
    uint64_t addresses[MOST_ROWS];
    our_addresses(addresses);
    for (uint32_t row = 0; row <= scene.row_count; row++) {
        struct driver_structure ours = driver_scene_ours(&scene, row);
        assert_bytes_again(&ours, row, addresses);
    }
    assert_traced_the_same(VK_NULL_HANDLE);
}

/* The copied top level refers to the bottom levels that were loaded. */
static void top_levels_are_copied(void **state)
{
    (void)state;
    uint64_t addresses[MOST_ROWS];
    struct driver_structure ours = driver_scene_ours(&scene, scene.row_count);
    our_addresses(addresses);
    for (int s = 0; s < SEQUENCES; s++) {
        struct driver_structure top = copy_in_turn(&ours, sequences[s]);
        assert_bytes_again(&top, scene.row_count, addresses);
        assert_traced_the_same(top.handle);
        driver_structure_destroy(gpu, &top);
    }
}

/* A top level is loaded over copied bottom levels, and then copied itself. */
static void bottom_levels_are_copied(void **state)
{
    (void)state;
    for (int s = 0; s < SEQUENCES; s++) {
        struct driver_structure bottoms[MOST_ROWS];
        uint64_t addresses[MOST_ROWS];
        for (uint32_t row = 0; row < scene.row_count; row++) {
            struct driver_structure ours = driver_scene_ours(&scene, row);
            bottoms[row] = copy_in_turn(&ours, sequences[s]);
            addresses[row] = bottoms[row].address;
            assert_bytes_again(&bottoms[row], row, NULL);
        }
        struct driver_structure top = driver_scene_top_over(&scene, addresses),
                                copied = copy_in_turn(&top, sequences[s]);
        assert_bytes_again(&copied, scene.row_count, addresses);
        driver_structure_destroy(gpu, &top);
        assert_traced_the_same(copied.handle);
        driver_structure_destroy(gpu, &copied);
        for (uint32_t row = 0; row < scene.row_count; row++)
            driver_structure_destroy(gpu, &bottoms[row]);
    }
}

/* The driver's own top level over our bottom levels, and ours over the driver's: both trace the same. */
static void levels_are_mixed(void **state)
{
    (void)state;
    struct bvhd_error error;
    struct driver_structure theirs;
    uint64_t addresses[MOST_ROWS];
    our_addresses(addresses);
    MUST(driver_structure_build(gpu, &world.top, addresses, &memory, &theirs, &error));
    assert_traced_the_same(theirs.handle);
    driver_structure_destroy(gpu, &theirs);
    for (uint32_t row = 0; row < scene.row_count; row++)
        addresses[row] = scene.bottoms[row].address;
    struct driver_structure ours = driver_scene_top_over(&scene, addresses);
    assert_traced_the_same(ours.handle);
    driver_structure_destroy(gpu, &ours);
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_was_loaded_gives_its_bytes),
        cmocka_unit_test(top_levels_are_copied),
        cmocka_unit_test(bottom_levels_are_copied),
        cmocka_unit_test(levels_are_mixed),
    };
    memory_init(&memory, UINT64_MAX);
    if (!driver_scene_device(&memory, &gpu, &format))
        return GPU_BED_SKIPPED;
    int failed = cmocka_run_group_tests(tests, set_up, tear_down);
    gpu_close(gpu);
    return failed || memory.live || gpu_messages();
}
