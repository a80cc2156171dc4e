/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_cpu.c - fuzzes the opening of sets of structures for the CPU: a set is refused with its reason, or rays through
 * it end, and what belongs to their hits is found.
 *
 * The input is a byte of flags (bit 0: blobs have the handles 1, 2, 3, ...), the number of blobs, and of each its size
 * in two bytes, followed by their bytes.
 */
#include "tests/fuzz/fuzz.h"

#include <math.h>
#include <string.h>

#include <bvhd/bvhd_cpu.h>

#include "client/library.h"
#include "tests/fuzz/sample_scene.h"

enum { MOST = 4, RAYS = 4 };

static uint32_t decide(void *context, struct bvhd_cpu_candidate *candidate)
{
    uint32_t *count = context;
    FUZZ_CHECK(candidate->ray_index < RAYS && candidate->hit->blob < MOST);
    return (*count)++ % 4;
}

static void shoot(const struct bvhd_cpu_scene *scene)
{
    static const float directions[RAYS][3] = {{1, 0.25f, -0.5f}, {-1, 0, 0}, {0, -0.0f, 1}, {0.3f, -1, 1e-30f}};
    static const float times[RAYS] = {0, 1, 0.5f, 0.3f};
    struct bvhd_cpu_ray rays[RAYS];
    struct bvhd_cpu_hit hits[RAYS];
    uint32_t count = 0;
    float corners[3][3], matrix[12];
    for (int i = 0; i < RAYS; i++) {
        rays[i] = (struct bvhd_cpu_ray){.tmax = INFINITY, .mask = 0xff, .flags = i == 1 ? BVHD_CPU_RAY_NO_OPAQUE : 0};
        rays[i].time = times[i];
        for (int axis = 0; axis < 3; axis++) {
            rays[i].direction[axis] = directions[i][axis];
            rays[i].origin[axis] = 0.1f - 2 * directions[i][axis];
        }
    }
    const struct bvhd_cpu_trace trace = {.struct_size = sizeof trace,
                                         .rays = rays,
                                         .ray_size = sizeof *rays,
                                         .hits = hits,
                                         .hit_size = sizeof *hits,
                                         .ray_count = RAYS,
                                         .candidate = decide,
                                         .context = &count};
    FUZZ_CHECK(bvhd_cpu_scene_trace(scene, &trace, NULL) == BVHD_OK);
    for (int i = 0; i < RAYS; i++) {
        bool is_hit = hits[i].blob != BVHD_CPU_NO_BLOB, is_box = hits[i].flags & BVHD_CPU_HIT_AABB;
        FUZZ_CHECK((bvhd_cpu_scene_object_to_world_at(scene, &hits[i], times[i], matrix, NULL) == BVHD_OK) == is_hit);
        FUZZ_CHECK(bvhd_cpu_scene_object_to_world(scene, &hits[i], matrix, NULL) != BVHD_OK || is_hit);
        const bool has_corners = bvhd_cpu_scene_corners_at(scene, &hits[i], times[i], corners, NULL) == BVHD_OK;
        FUZZ_CHECK(has_corners == (is_hit && !is_box));
        FUZZ_CHECK(bvhd_cpu_scene_corners(scene, &hits[i], corners, NULL) != BVHD_OK || has_corners);
        bvhd_cpu_scene_positions(scene, hits[i].blob, hits[i].geometry, hits[i].primitive, corners, NULL);
    }
    for (uint32_t i = 0; i < RAYS; i++) {
        bvhd_cpu_scene_positions(scene, i % MOST, i / 2, i, corners, NULL);
        bvhd_cpu_scene_positions_at(scene, i % MOST, i / 2, i, 0.5f, corners, NULL);
    }
}

static void open_set(const struct bvhd_cpu_blob *blobs, uint32_t count, bool has_handles)
{
    static const uint64_t handles[MOST] = {1, 2, 3, 4};
    struct bvhd_cpu_scene *scene = NULL;
    struct bvhd_error error = {0};
    const struct bvhd_cpu_scene_options options = {
        .struct_size = sizeof options, .blobs = blobs, .blob_count = count, .handles = has_handles ? handles : NULL};
    enum bvhd_status status = bvhd_cpu_scene_create(&options, &scene, &error);
    if (status == BVHD_OK)
        shoot(scene);
    else
        FUZZ_CHECK(!scene && error.status == status && error.where[0] && error.text[0]);
    bvhd_cpu_scene_destroy(scene);
    FUZZ_CHECK(library_memory.live == 0);
}

/* Each blob is in a block of exactly its size. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct bvhd_cpu_blob blobs[MOST];
    void *blocks[MOST];
    if (size < 2)
        return 0;
    uint32_t count = data[1] % (MOST + 1);
    size_t at = 2 + 2 * (size_t)count;
    for (uint32_t i = 0; i < count; i++) {
        size_t rest = size > at ? size - at : 0, wanted = at <= size ? data[2 + 2 * i] | data[3 + 2 * i] << 8 : 0;
        size_t length = wanted < rest ? wanted : rest;
        FUZZ_CHECK(posix_memalign(&blocks[i], 16, length ? length : 1) == 0);
        if (length > 0)
            memcpy(blocks[i], data + at, length);
        blobs[i] = (struct bvhd_cpu_blob){blocks[i], length};
        at += length;
    }
    open_set(blobs, count, data[0] & 1);
    for (uint32_t i = 0; i < count; i++)
        free(blocks[i]);
    return 0;
}

static size_t put(const struct batch_item *const *items, uint32_t count, uint8_t flags, uint8_t *ret_bytes)
{
    size_t at = 2 + 2 * (size_t)count;
    ret_bytes[0] = flags;
    ret_bytes[1] = (uint8_t)count;
    for (uint32_t i = 0; i < count; i++) {
        FUZZ_CHECK(at + items[i]->size <= FUZZ_ROOM);
        ret_bytes[2 + 2 * i] = (uint8_t)items[i]->size;
        ret_bytes[3 + 2 * i] = (uint8_t)(items[i]->size >> 8);
        memcpy(ret_bytes + at, items[i]->blob, items[i]->size);
        at += items[i]->size;
    }
    return at;
}

/*
 * Samples are each bottom level alone and both under the top level, portable and native, and what moves, portable; by
 * order and by handles.
 */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    enum { SETS = 3, MOTION = 4 * SETS, SAMPLES = MOTION + 4 };
    struct test_scene scene;
    if (index >= SAMPLES)
        return 0;
    if (index >= MOTION) {
        sample_scene_init_motion(&scene);
        const struct batch_item *items[2] = {&scene.items[0], &scene.items[TEST_SCENE_BOTTOMS]};
        const size_t motion_size = put(items, 1 + (index & 1), index >> 1 & 1, ret_bytes);
        test_scene_finish(&scene);
        return motion_size;
    }
    sample_scene_init(&scene);
    const struct sample_structures structures = sample_scene_structures(&scene, index & 1);
    uint32_t set = index / 4;
    size_t size = put(set < 2 ? &structures.items[set] : structures.items, set < 2 ? 1 : 3, index >> 1 & 1, ret_bytes);
    test_scene_finish(&scene);
    return size;
}
