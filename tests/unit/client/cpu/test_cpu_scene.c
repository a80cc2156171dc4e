/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_cpu_scene.c - tests that sets of blobs become scenes: by order and by handles, whole and damaged ones, and that
 * sets which do not belong together are refused by name.
 */
#include "tests/support/client/cpu/cpu_bed.h"

enum { RAYS = 400 };

static struct cpu_bed beds[2]; /* portable, native */

static int open_beds(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++)
        cpu_bed_init(&beds[i], i);
    return 0;
}

static int close_beds(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++)
        cpu_bed_finish(&beds[i]);
    return 0;
}

static void shoot(const struct bvhd_cpu_scene *scene, uint32_t count, struct bvhd_cpu_hit *ret_hits)
{
    struct random random = {8};
    struct bvhd_cpu_ray rays[RAYS];
    for (uint32_t i = 0; i < count; i++)
        rays[i] = cpu_bed_ray(&random, i);
    const struct bvhd_cpu_trace trace = cpu_bed_trace(rays, ret_hits, count);
    assert_int_equal(bvhd_cpu_scene_trace(scene, &trace, NULL), BVHD_OK);
}

/* `where` is the beginning of the place. */
static void refuse_with(const struct bvhd_cpu_blob *blobs, uint32_t count, const uint64_t *handles,
                        enum bvhd_status expected, const char *where)
{
    struct bvhd_cpu_scene *scene = NULL;
    struct bvhd_error error = {0};
    enum bvhd_status status = cpu_bed_try(blobs, count, handles, &scene, &error);
    if (status != expected || strncmp(error.where, where, strlen(where)) != 0)
        fail_msg("expected %s: %s, not %s: %s: %s", bvhd_status_name(expected), where, bvhd_status_name(status),
                 error.where, error.text);
    assert_true(error.status == expected && error.text[0]);
    assert_null(scene);
    assert_int_equal(library_memory.live, 0);
}

static void options_are_checked(void **state)
{
    struct bvhd_cpu_scene *scene = NULL;
    struct bvhd_error error = {0};
    (void)state;
    const struct bvhd_cpu_scene_options right = {.struct_size = sizeof right, .blobs = beds[0].blobs, .blob_count = 3};
    struct bvhd_cpu_scene_options wrong;
#define REFUSE(member, value, place)                                                                                   \
    do {                                                                                                               \
        wrong = right;                                                                                                 \
        wrong.member = value;                                                                                          \
        assert_int_equal(bvhd_cpu_scene_create(&wrong, &scene, &error), BVHD_INVALID);                                 \
        assert_string_equal(error.where, place);                                                                       \
        assert_int_equal(bvhd_cpu_scene_create(&wrong, &scene, NULL), BVHD_INVALID);                                   \
    } while (0)
    REFUSE(struct_size, sizeof right - 1, "options.struct_size");
    REFUSE(blobs, NULL, "options.blobs");
    REFUSE(blob_count, 0, "options.blob_count");
    REFUSE(flags, 1, "options.flags");
    assert_int_equal(bvhd_cpu_scene_create(NULL, &scene, &error), BVHD_INVALID);
    assert_string_equal(error.where, "options");
    assert_null(scene);
    bvhd_cpu_scene_destroy(NULL);
}

static void sets_belong_together(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        const struct bvhd_cpu_blob *own = beds[i].blobs, *others = beds[!i].blobs, none = {NULL, 0};
        const struct bvhd_cpu_blob alone[] = {own[2]};
        refuse_with(alone, 1, NULL, BVHD_INVALID, "instances[");
        const struct bvhd_cpu_blob one_less[] = {own[0], own[2]};
        refuse_with(one_less, 2, NULL, BVHD_INVALID, "instances[");
        const struct bvhd_cpu_blob hole[] = {none, own[1], own[2]};
        refuse_with(hole, 3, NULL, BVHD_INVALID, "instances[");
        const struct bvhd_cpu_blob no_last[] = {own[0], own[1], none};
        refuse_with(no_last, 3, NULL, BVHD_INVALID, "blobs[2]: data");
        const struct bvhd_cpu_blob bottom_last[] = {own[0], own[1]};
        refuse_with(bottom_last, 2, NULL, BVHD_INVALID, "blobs[1]: data");
        const struct bvhd_cpu_blob top_first[] = {own[2], own[1], own[2]};
        refuse_with(top_first, 3, NULL, BVHD_INVALID, "blobs[0]: data");
        const struct bvhd_cpu_blob mixed[] = {own[0], others[1], own[2]};
        refuse_with(mixed, 3, NULL, BVHD_INVALID, "blobs[1]: data");
        const struct bvhd_cpu_blob sized[] = {own[0], {NULL, 5}, own[2]};
        refuse_with(sized, 3, NULL, BVHD_INVALID, "blobs[1]: data");
        const struct bvhd_cpu_blob twice[] = {own[0], {own[0].data, own[0].size - 1}, own[2]};
        refuse_with(twice, 3, NULL, BVHD_INVALID, "blobs[1]: size");
        const struct bvhd_cpu_blob empty[] = {{own[0].data, 0}};
        refuse_with(empty, 1, NULL, BVHD_CORRUPT, "blobs[0]: header");
    }
}

/* Blobs that no instance names may be missing, and one blob may be several bottom levels. */
static void rows_may_be_shared_or_missing(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        const struct bvhd_cpu_blob *own = beds[i].blobs;
        const struct bvhd_cpu_blob shared[] = {own[0], own[0], {NULL, 0}, {NULL, 0}, own[2]};
        struct bvhd_cpu_scene *scene = cpu_bed_open(shared, 5);
        struct bvhd_cpu_hit hits[RAYS];
        int found[2] = {0, 0};
        shoot(scene, RAYS, hits);
        for (int k = 0; k < RAYS; k++)
            if (hits[k].blob != BVHD_CPU_NO_BLOB) {
                assert_in_range(hits[k].blob, 0, 1);
                assert_int_equal(hits[k].flags & BVHD_CPU_HIT_AABB, 0);
                found[hits[k].blob]++;
            }
        assert_true(found[0] > 10 && found[1] > 10);
        bvhd_cpu_scene_destroy(scene);
    }
}

static unsigned char *copy_of(struct bvhd_cpu_blob blob)
{
    void *block = NULL;
    assert_int_equal(posix_memalign(&block, 64, blob.size ? blob.size : 1), 0);
    memcpy(block, blob.data, blob.size);
    return block;
}

/* A loader has replaced the handles: the blobs are found by their numbers, in whatever order they come. */
static void bottoms_are_found_by_handles(void **state)
{
    static const uint64_t numbers[2] = {0xfedcba9876543210, 0x10};
    (void)state;
    for (int i = 0; i < 2; i++) {
        const struct bvhd_cpu_blob *own = beds[i].blobs;
        unsigned char *top = copy_of(own[2]);
        for (uint64_t k = 0; k < bytes_get64(top + 48); k++)
            bytes_put64(top + 56 + 8 * k, numbers[bytes_get64(top + 56 + 8 * k) - 1]);
        const struct bvhd_cpu_blob swapped[] = {{NULL, 0}, own[1], own[0], {top, own[2].size}};
        const uint64_t handles[] = {0, numbers[1], numbers[0]}, wrong[] = {0, numbers[1], 5},
                       same[] = {0, numbers[1], numbers[1]}, zero[] = {9, 0, numbers[0]};
        struct bvhd_cpu_scene *by_order = cpu_bed_open(own, CPU_BED_BLOBS), *by_handle = NULL;
        struct bvhd_cpu_hit hits[2][RAYS];
        assert_int_equal(cpu_bed_try(swapped, 4, handles, &by_handle, NULL), BVHD_OK);
        shoot(by_order, RAYS, hits[0]);
        shoot(by_handle, RAYS, hits[1]);
        for (int k = 0; k < RAYS; k++) {
            if (hits[0][k].blob != BVHD_CPU_NO_BLOB)
                hits[0][k].blob = 2 - hits[0][k].blob;
            assert_memory_equal(&hits[0][k], &hits[1][k], sizeof hits[0][k]);
        }
        bvhd_cpu_scene_destroy(by_order);
        bvhd_cpu_scene_destroy(by_handle);
        refuse_with(swapped, 4, wrong, BVHD_INVALID, "instances[");
        refuse_with(swapped, 4, same, BVHD_INVALID, "options.handles[2]");
        refuse_with(swapped, 4, zero, BVHD_INVALID, "options.handles[1]");
        free(top);
    }
}

static void bounds_cover_everything(void **state)
{
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct bvhd_cpu_scene *bottom = cpu_bed_open(beds[i].blobs, 1), *top = cpu_bed_open(beds[i].blobs, 3);
        float bounds[6], exact[6] = {1, 1, 1, -1, -1, -1};
        for (int k = 0; k < CPU_BED_TRIANGLES * 3; k++)
            for (int axis = 0; axis < 3; axis++) {
                float at = beds[i].corners[k / 3][k % 3][axis];
                exact[axis] = fminf(exact[axis], at);
                exact[3 + axis] = fmaxf(exact[3 + axis], at);
            }
        bvhd_cpu_scene_bounds(bottom, bounds);
        for (int k = 0; k < 6; k++)
            assert_true(fabsf(bounds[k] - exact[k]) <= (i ? 1e-6f : 0));
        bvhd_cpu_scene_bounds(top, bounds);
        for (int axis = 0; axis < 3; axis++)
            assert_true(bounds[axis] < -0.5f && bounds[3 + axis] > 0.5f && bounds[3 + axis] < 10);
        bvhd_cpu_scene_destroy(bottom);
        bvhd_cpu_scene_destroy(top);
    }
}

static void scenes_of_nothing_have_no_bounds(void **state)
{
    static const float zeros[6];
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct test_scene empty;
        const struct geometry nothing = test_scene_triangles((const float(*)[3][3])beds[0].corners, 0, 0);
        test_scene_init_native(&empty, LAVAPIPE_PLAIN);
        test_scene_add(&empty, &nothing, 1, 0);
        const struct batch_item *item = i ? &empty.native_items[0] : &empty.items[0];
        const struct bvhd_cpu_blob blob = {item->blob, item->size};
        struct bvhd_cpu_scene *scene = cpu_bed_open(&blob, 1);
        struct bvhd_cpu_hit hits[8];
        float bounds[6] = {1};
        bvhd_cpu_scene_bounds(scene, bounds);
        assert_memory_equal(bounds, zeros, sizeof zeros);
        shoot(scene, 8, hits);
        for (int k = 0; k < 8; k++)
            assert_int_equal(hits[k].blob, BVHD_CPU_NO_BLOB);
        bvhd_cpu_scene_destroy(scene);
        test_scene_finish(&empty);
    }
}

static void portable_blobs_are_aligned(void **state)
{
    (void)state;
    const struct bvhd_cpu_blob whole = beds[0].blobs[0];
    unsigned char *shifted = malloc(whole.size + 128);
    assert_non_null(shifted);
    unsigned char *at = shifted + (64 - (uintptr_t)shifted % 64) + 8;
    memcpy(at, whole.data, whole.size);
    const struct bvhd_cpu_blob blob = {at, whole.size};
    refuse_with(&blob, 1, NULL, BVHD_INVALID, "blobs[0]: data");
    free(shifted);
}

/* ---- damaged blobs ---- */

static uint64_t opened, refused;

/* Opens a set with one blob in an exact block. It is a scene through which rays end, or a refusal with its reason. */
static void try_set(const struct cpu_bed *bed, uint32_t index, struct bvhd_cpu_blob blob)
{
    struct bvhd_cpu_blob blobs[CPU_BED_BLOBS];
    struct bvhd_cpu_scene *scene = NULL;
    struct bvhd_error error = {0};
    struct bvhd_cpu_hit hits[8];
    memcpy(blobs, bed->blobs, sizeof blobs);
    blobs[index] = blob;
    if (cpu_bed_try(blobs, CPU_BED_BLOBS, NULL, &scene, &error) == BVHD_OK) {
        float corners[3][3], matrix[12];
        shoot(scene, 8, hits);
        for (int i = 0; i < 8; i++) {
            bvhd_cpu_scene_corners(scene, &hits[i], corners, NULL);
            bvhd_cpu_scene_object_to_world(scene, &hits[i], matrix, NULL);
        }
        opened++;
    } else {
        assert_true(error.status == BVHD_CORRUPT || error.status == BVHD_INCOMPATIBLE || error.status == BVHD_INVALID);
        assert_true(error.where[0] && error.text[0]);
        refused++;
    }
    bvhd_cpu_scene_destroy(scene);
    assert_int_equal(library_memory.live, 0);
}

static void truncate_blob(const struct cpu_bed *bed, uint32_t index)
{
    const struct bvhd_cpu_blob whole = bed->blobs[index];
    for (uint64_t size = 0; size < whole.size; size += size < 200 ? 1 : 37)
        for (int adapted = 0; adapted < 2; adapted++) {
            unsigned char *block = copy_of((struct bvhd_cpu_blob){whole.data, size});
            if (adapted && size >= 40)
                bytes_put64(block + 32, size);
            try_set(bed, index, (struct bvhd_cpu_blob){block, size});
            free(block);
        }
}

static void damage_blob(const struct cpu_bed *bed, uint32_t index, struct random *random)
{
    enum { TRIES = 1500 };
    const struct bvhd_cpu_blob whole = bed->blobs[index];
    unsigned char *block = copy_of(whole);
    for (int i = 0; i < TRIES; i++) {
        uint64_t at = random_next(random) % (i % 2 ? whole.size : 256);
        unsigned char old = block[at];
        block[at] = i % 3 ? (unsigned char)(old ^ 1u << random_next(random) % 8) : (unsigned char)random_next(random);
        try_set(bed, index, (struct bvhd_cpu_blob){block, whole.size});
        block[at] = old;
    }
    free(block);
}

static void damaged_sets_do_no_harm(void **state)
{
    struct random random = {21};
    (void)state;
    for (int i = 0; i < 2; i++)
        for (uint32_t index = 0; index < CPU_BED_BLOBS; index++) {
            opened = 0;
            truncate_blob(&beds[i], index);
            assert_int_equal(opened, 0);
            refused = 0;
            damage_blob(&beds[i], index, &random);
            assert_true(opened > 100 && refused > 100);
        }
}

static void every_allocation_may_fail(void **state)
{
    static const uint64_t handles[] = {1, 2};
    (void)state;
    for (int i = 0; i < 2; i++) {
        struct bvhd_cpu_scene *scene = NULL;
        enum bvhd_status status = BVHD_NO_MEMORY;
        int tries = 0;
        for (; status != BVHD_OK && tries < 50; tries++) {
            struct bvhd_error error = {0};
            library_memory.fail_after = tries;
            status = cpu_bed_try(beds[i].blobs, CPU_BED_BLOBS, handles, &scene, &error);
            library_memory.fail_after = -1;
            if (status != BVHD_OK) {
                assert_int_equal(error.status, BVHD_NO_MEMORY);
                assert_int_equal(library_memory.live, 0);
            }
        }
        assert_in_range(tries, 6, 49);
        bvhd_cpu_scene_destroy(scene);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(options_are_checked),           cmocka_unit_test(sets_belong_together),
        cmocka_unit_test(rows_may_be_shared_or_missing), cmocka_unit_test(bottoms_are_found_by_handles),
        cmocka_unit_test(bounds_cover_everything),       cmocka_unit_test(scenes_of_nothing_have_no_bounds),
        cmocka_unit_test(portable_blobs_are_aligned),    cmocka_unit_test(damaged_sets_do_no_harm),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, open_beds, close_beds);
}
