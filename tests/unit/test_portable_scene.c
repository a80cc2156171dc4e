/* SPDX-License-Identifier: Apache-2.0 */
#include "unit.h"

#include <float.h>

#include "portable_scene.h"
#include "random.h"
#include "serialized.h"
#include "test_scene.h"

enum { HANDLES = 2, TRIANGLES = 60, RAYS = 500 };

/* Two bottom levels of random triangles under a top level of three instances, and their blobs, the top level first. */
struct fixture {
    struct test_scene built;
    float corners[2][TRIANGLES][3][3];
    struct test_instance instances[3];
    struct bytes blobs[1 + HANDLES];
};

static uint32_t add_soup(struct fixture *fixture, int which)
{
    struct random random = {(uint64_t)which + 1};
    for (int i = 0; i < TRIANGLES * 9; i++)
        (&fixture->corners[which][0][0][0])[i] = (float)random_between(&random, -1, 1);
    struct geometry geometry = {
        .type = GEOMETRY_TRIANGLES,
        .triangles = {.vertex_format = 106,
                      .vertex_stride = 12,
                      .max_vertex = 3 * TRIANGLES - 1,
                      .index_type = INDEX_NONE,
                      .vertices = {(const unsigned char *)fixture->corners[which], sizeof fixture->corners[which]}},
        .range = {.primitive_count = TRIANGLES},
    };
    return test_scene_add(&fixture->built, &geometry, 1, 0);
}

static int set_up(void **state)
{
    struct fixture *fixture = calloc(1, sizeof *fixture);
    assert_non_null(fixture);
    test_scene_init(&fixture->built);
    for (int i = 0; i < HANDLES; i++)
        assert_int_equal(add_soup(fixture, i), i);
    for (uint32_t i = 0; i < 3; i++)
        fixture->instances[i] = (struct test_instance){
            .transform = {1, 0, 0, 3.0f * (float)i, 0, 1, 0, 0, 0, 0, 1, 0}, .mask = 0xff, .bottom = i % HANDLES};
    test_scene_add_top(&fixture->built, fixture->instances, 3);
    const struct batch_item *items = fixture->built.items;
    fixture->blobs[0] = (struct bytes){items[TEST_SCENE_BOTTOMS].blob, items[TEST_SCENE_BOTTOMS].size};
    for (int i = 0; i < HANDLES; i++)
        fixture->blobs[1 + i] = (struct bytes){items[i].blob, items[i].size};
    *state = fixture;
    return 0;
}

static int tear_down(void **state)
{
    struct fixture *fixture = *state;
    test_scene_finish(&fixture->built);
    free(fixture);
    return 0;
}

static struct bytes pack(struct fixture *fixture, const struct bytes *blobs, uint32_t count)
{
    unsigned char *buffer;
    uint64_t size;
    struct bvhd_error error;
    assert_int_equal(portable_pack(blobs, count, &fixture->built.memory, &buffer, &size, &error), BVHD_OK);
    return (struct bytes){buffer, size};
}

static void free_pack(struct fixture *fixture, struct bytes buffer)
{
    memory_free(&fixture->built.memory, (unsigned char *)(uintptr_t)buffer.data);
}

static struct ray make_ray(struct random *random)
{
    struct ray ray = {.tmax = FLT_MAX, .cull_mask = 0xff};
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)random_between(random, -2, axis == 0 ? 8 : 2);
        ray.direction[axis] = (float)random_between(random, -1, 1);
    }
    return ray;
}

static void assert_same_answers(const struct scene *a, const struct scene *b)
{
    struct random random = {7};
    unsigned hits = 0;
    for (int i = 0; i < RAYS; i++) {
        struct ray ray = make_ray(&random);
        struct ray_hit x, y;
        bool is_hit = traverse(a, &ray, NULL, &x, NULL);
        assert_int_equal(traverse(b, &ray, NULL, &y, NULL), is_hit);
        if (!is_hit)
            continue;
        hits++;
        assert_true(x.t == y.t && x.instance == y.instance && x.primitive == y.primitive && x.handle == y.handle);
    }
    assert_true(hits > RAYS / 10);
}

static void packed_scene_answers_like_one_kept_apart(void **state)
{
    struct fixture *fixture = *state;
    struct bytes buffer = pack(fixture, fixture->blobs, 1 + HANDLES);
    struct portable_scene scene;
    struct bvhd_error error;
    assert_int_equal(portable_scene_open(buffer, &fixture->built.memory, &scene, &error), BVHD_OK);
    assert_int_equal(scene.scene.bottom_count, HANDLES);
    assert_same_answers(&fixture->built.scene, &scene.scene);
    for (int i = 0; i < HANDLES; i++) {
        uint64_t offset = bytes_get64(buffer.data + SERIALIZED_HANDLES + 8 * i);
        assert_int_equal(offset % 64, 0);
        assert_memory_equal(buffer.data + offset, fixture->blobs[1 + i].data, fixture->blobs[1 + i].size);
    }
    portable_scene_finish(&scene);
    portable_scene_finish(&scene);
    free_pack(fixture, buffer);
}

static void bottom_level_alone(void **state)
{
    struct fixture *fixture = *state;
    struct bytes buffer = pack(fixture, fixture->blobs + 1, 1);
    struct scene apart = {NULL, fixture->built.bottoms, 1};
    struct portable_scene scene;
    struct bvhd_error error;
    assert_int_equal(portable_scene_open(buffer, &fixture->built.memory, &scene, &error), BVHD_OK);
    struct random random = {9};
    for (int i = 0; i < RAYS; i++) {
        struct ray ray = make_ray(&random);
        struct ray_hit x, y;
        bool is_hit = traverse(&apart, &ray, NULL, &x, NULL);
        assert_int_equal(traverse(&scene.scene, &ray, NULL, &y, NULL), is_hit);
        assert_true(!is_hit || (x.t == y.t && x.primitive == y.primitive));
    }
    portable_scene_finish(&scene);
    free_pack(fixture, buffer);
}

static void equal_blobs_are_stored_once(void **state)
{
    struct fixture *fixture = *state;
    struct bytes blobs[3] = {fixture->blobs[0], fixture->blobs[1], fixture->blobs[1]};
    struct bytes twice = pack(fixture, blobs, 3), once = pack(fixture, blobs + 1, 1);
    assert_true(twice.size < bytes_align(blobs[0].size, 64) + 2 * once.size);
    assert_int_equal(bytes_get64(twice.data + SERIALIZED_HANDLES), bytes_get64(twice.data + SERIALIZED_HANDLES + 8));
    struct portable_scene scene;
    struct bvhd_error error;
    assert_int_equal(portable_scene_open(twice, &fixture->built.memory, &scene, &error), BVHD_OK);
    assert_ptr_equal(scene.bottoms[0], scene.bottoms[1]);
    portable_scene_finish(&scene);
    free_pack(fixture, twice);
    free_pack(fixture, once);
}

static void counts_that_do_not_fit_are_refused(void **state)
{
    struct fixture *fixture = *state;
    unsigned char *buffer = NULL;
    uint64_t size;
    struct bvhd_error error;
    assert_int_equal(portable_pack(fixture->blobs, 2, &fixture->built.memory, &buffer, &size, &error), BVHD_INVALID);
    assert_string_equal(error.where, "header.handleCount");
    assert_int_equal(portable_pack(fixture->blobs, 0, &fixture->built.memory, &buffer, &size, &error), BVHD_INVALID);
    struct bytes cut[3] = {fixture->blobs[0], fixture->blobs[1], {fixture->blobs[2].data, 40}};
    assert_int_equal(portable_pack(cut, 3, &fixture->built.memory, &buffer, &size, &error), BVHD_CORRUPT);
    assert_memory_equal(error.where, "handles[1]", 10);
    assert_null(buffer);
}

static void bad_handles_are_named(void **state)
{
    struct fixture *fixture = *state;
    struct bytes buffer = pack(fixture, fixture->blobs, 1 + HANDLES);
    unsigned char *handle = (unsigned char *)(uintptr_t)buffer.data + SERIALIZED_HANDLES + 8;
    uint64_t good = bytes_get64(handle);
    const uint64_t bad[] = {0, 1, 8, good + 1, good + 64, good - 64, buffer.size, buffer.size - 64, UINT64_MAX, UINT64_MAX - 63};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        struct portable_scene scene;
        struct bvhd_error error;
        bytes_put64(handle, bad[i]);
        assert_int_equal(portable_scene_open(buffer, &fixture->built.memory, &scene, &error), BVHD_CORRUPT);
        assert_memory_equal(error.where, "handles[1]", 10);
    }
    free_pack(fixture, buffer);
}

/* A structure inside another would be checked again for each handle. */
static void structures_may_not_overlap(void **state)
{
    struct fixture *fixture = *state;
    struct bytes blobs[3] = {fixture->blobs[0], fixture->blobs[1], fixture->blobs[2]};
    struct bytes buffer = pack(fixture, blobs, 3);
    unsigned char *bytes = (unsigned char *)(uintptr_t)buffer.data;
    uint64_t first = bytes_get64(bytes + SERIALIZED_HANDLES), second = bytes_get64(bytes + SERIALIZED_HANDLES + 8);
    assert_true(first < second);
    /* The second is moved into the first, whose own sections then lie elsewhere: that it overlaps is found before it is read. */
    bytes_put64(bytes + SERIALIZED_HANDLES + 8, first + 64);
    struct portable_scene scene;
    struct bvhd_error error;
    assert_int_equal(portable_scene_open(buffer, &fixture->built.memory, &scene, &error), BVHD_CORRUPT);
    assert_string_equal(error.where, "handles[1]: offset");
    free_pack(fixture, buffer);
}

/* Whatever stands in a buffer, opening it ends with a status, and what it opens can be traversed. */
static void hostile_buffers_end_with_a_status(void **state)
{
    struct fixture *fixture = *state;
    struct bytes buffer = pack(fixture, fixture->blobs, 1 + HANDLES);
    struct random random = {11};
    unsigned opened = 0, refused = 0;
    for (unsigned i = 0; i < 4000; i++) {
        uint64_t size = i < 2000 ? buffer.size : random_next(&random) % buffer.size;
        unsigned char *copy = aligned_alloc(64, bytes_align(size + 1, 64));
        assert_non_null(copy);
        memcpy(copy, buffer.data, size);
        if (i < 2000)
            copy[random_next(&random) % (i % 2 ? 200 : size)] ^= (unsigned char)(1u << random_next(&random) % 8);
        struct portable_scene scene;
        struct bvhd_error error;
        if (portable_scene_open((struct bytes){copy, size}, &fixture->built.memory, &scene, &error) == BVHD_OK) {
            struct ray ray = make_ray(&random);
            struct ray_hit hit;
            traverse(&scene.scene, &ray, NULL, &hit, NULL);
            portable_scene_finish(&scene);
            opened++;
        } else {
            assert_true(error.text[0]);
            refused++;
        }
        free(copy);
    }
    assert_true(opened > 100 && refused > 2000);
    free_pack(fixture, buffer);
}

static void every_allocation_may_fail(void **state)
{
    struct fixture *fixture = *state;
    struct memory memory;
    struct bvhd_error error;
    unsigned char *buffer = NULL;
    uint64_t size = 0;
    unsigned failures = 0;
    enum bvhd_status status = BVHD_NO_MEMORY;
    memory_init(&memory, UINT64_MAX);
    while (status != BVHD_OK) {
        atomic_store(&memory.fail_after, (int64_t)failures++);
        status = portable_pack(fixture->blobs, 1 + HANDLES, &memory, &buffer, &size, &error);
        assert_true(status == BVHD_OK || (status == BVHD_NO_MEMORY && memory.live == 0));
    }
    assert_true(failures > 2);
    uint64_t packed = memory.live;
    status = BVHD_NO_MEMORY;
    for (failures = 0; status != BVHD_OK;) {
        struct portable_scene scene;
        atomic_store(&memory.fail_after, (int64_t)failures++);
        status = portable_scene_open((struct bytes){buffer, size}, &memory, &scene, &error);
        if (status == BVHD_OK)
            portable_scene_finish(&scene);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        assert_int_equal(memory.live, packed);
    }
    assert_true(failures > 4);
    memory_free(&memory, buffer);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(packed_scene_answers_like_one_kept_apart),
        cmocka_unit_test(bottom_level_alone),
        cmocka_unit_test(equal_blobs_are_stored_once),
        cmocka_unit_test(counts_that_do_not_fit_are_refused),
        cmocka_unit_test(bad_handles_are_named),
        cmocka_unit_test(structures_may_not_overlap),
        cmocka_unit_test(hostile_buffers_end_with_a_status),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
