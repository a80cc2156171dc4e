/* SPDX-License-Identifier: Apache-2.0 */
/*
 * hostile_blobs.c - tests that portable structures which were truncated, overwritten or had bits flipped do no harm:
 * opening one gives a status, and where it opens, rays through it terminate.
 *
 *     hostile_blobs [FLIPS [SEED]]
 *
 * The address sanitizer finds reads outside of a blob, because every blob is in a block of exactly its size.
 */
#include <float.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/format/portable.h"
#include "tests/support/builder/test_blob.h"
#include "builder/traverse/traverse.h"

enum { RAYS = 3, SUBJECTS = 7, WAYS = 4 };

static const struct {
    struct test_shape shape;
    uint32_t layout_flags;
} subjects[SUBJECTS] = {
    {{.type = GEOMETRY_TRIANGLES, .geometries = 2, .primitives = 40, .size = 10, .detail = 0.1, .inactive = 6}, 0},
    {{.type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 60, .size = 1e-30, .detail = 0.1}, 0},
    {{.type = GEOMETRY_TRIANGLES, .geometries = 3, .primitives = 20, .size = 10, .detail = 0.1},
     PORTABLE_FAST_TRIANGLES},
    {{.type = GEOMETRY_AABBS, .geometries = 2, .primitives = 30, .size = 10, .detail = 0.1}, 0},
    {{.type = GEOMETRY_INSTANCES, .geometries = 1, .primitives = 40, .size = 10, .detail = 0.1}, 0},
    {{.type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 1, .size = 1, .detail = 1}, 0},
    {{.type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 0, .size = 1, .detail = 1}, 0},
};

struct tally {
    uint64_t refused, opened, hits;
};

static struct memory memory;
static struct portable_view bottom; /* the bottom level of all instances */

static void fail(const char *what, const struct bvhd_error *error)
{
    fprintf(stderr, "hostile_blobs: %s: %s: %s\n", what, error->where, error->text);
    exit(1);
}

static struct ray random_ray(struct random *random, double size)
{
    double origin[3], target[3];
    struct ray ray = {.tmin = 0, .tmax = FLT_MAX, .cull_mask = 0xff};
    random_point(random, origin);
    random_point(random, target);
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)(origin[axis] * size);
        ray.direction[axis] = (float)((target[axis] * 0.5 - origin[axis]) * size);
    }
    if (random_next(random) % 3 == 0)
        ray.flags = RAY_TERMINATE_ON_FIRST_HIT;
    return ray;
}

static void trace(const struct portable_view *view, struct random *random, double size, struct tally *tally)
{
    const struct portable_view *bottoms[8];
    bool top = view->header->content == PORTABLE_INSTANCES;
    struct scene scene = {.bottoms = bottoms, .bottom_count = 1};
    bottoms[0] = view;
    if (top) {
        if (view->handle_count > 8)
            return;
        for (uint64_t i = 0; i < view->handle_count; i++)
            bottoms[i] = i == 1 ? NULL : &bottom;
        scene = (struct scene){.top = view, .bottoms = bottoms, .bottom_count = (uint32_t)view->handle_count};
    }
    for (int i = 0; i < RAYS; i++) {
        struct ray ray = random_ray(random, size);
        for (int way = 0; way < WAYS; way++) {
            const struct traverse_options options = {
                .baseline_only = way == 1, .exact_only = way == 2, .flip_order = way == 3};
            struct ray_hit hit;
            float corners[3][3];
            if (!traverse(&scene, &ray, &options, &hit, NULL))
                continue;
            tally->hits++;
            if (!hit.is_aabb && !hit.is_sphere && !hit.is_swept_sphere)
                traverse_positions(&scene, &hit, corners);
        }
    }
}

static void try_open(const unsigned char *data, uint64_t size, struct random *random, double extent,
                     struct tally *tally)
{
    struct bytes bytes = {data, size};
    struct portable_view view;
    struct bvhd_error error = {.status = BVHD_OK};
    if (portable_open(bytes, &memory, &view, &error) == BVHD_OK) {
        tally->opened++;
        trace(&view, random, extent, tally);
        return;
    }
    tally->refused++;
    if ((error.status != BVHD_CORRUPT && error.status != BVHD_INCOMPATIBLE) || !error.where[0] || !error.text[0])
        fail("a refusal without its reason", &error);
}

static void *exact_block(uint64_t size)
{
    void *block = NULL;
    if (posix_memalign(&block, 64, size ? size : 1) != 0)
        abort();
    return block;
}

/* Tries every truncation, with the original size in the header and with an adapted one. */
static void truncate_blob(struct bytes blob, struct random *random, double extent, struct tally *tally)
{
    for (uint64_t size = 0; size < blob.size; size++)
        for (int adapted = 0; adapted < 2; adapted++) {
            unsigned char *copy = exact_block(size);
            memcpy(copy, blob.data, size);
            if (adapted && size >= 40)
                bytes_put64(copy + 32, size);
            try_open(copy, size, random, extent, tally);
            free(copy);
        }
    if (tally->opened)
        fail("a truncated blob opened", &(struct bvhd_error){.where = ""});
}

/* Tries each bit flipped and some values, for every byte of both headers and of what is between them. */
static void spoil_headers(unsigned char *blob, uint64_t size, struct random *random, double extent, struct tally *tally)
{
    static const unsigned char values[] = {0, 1, 0x7f, 0x80, 0xfe, 0xff};
    uint64_t end = bytes_align(56 + 8 * bytes_get64(blob + 48), 64) + sizeof(struct portable_header);
    for (uint64_t at = 0; at < end; at++) {
        unsigned char old = blob[at];
        for (int k = 0; k < 14; k++) {
            blob[at] = k < 8 ? (unsigned char)(old ^ 1 << k) : values[k - 8];
            try_open(blob, size, random, extent, tally);
        }
        blob[at] = old;
    }
}

/* Changes a bit, a byte, or a whole aligned word to a value that is likely to matter. */
static void damage(unsigned char *blob, uint64_t size, struct random *random)
{
    static const uint32_t words[] = {0,          1,          2,          0x7fffffff, 0x80000000, 0xffffffff,
                                     0x7f800000, 0xff800000, 0x7fc00000, 0x7f7fffff, 0x00000001};
    uint64_t at = random_next(random) % size;
    switch (random_next(random) % 4) {
    case 0:
        blob[at] = (unsigned char)random_next(random);
        break;
    case 1:
        at = random_next(random) % (size / 4) * 4;
        bytes_put32(blob + at, words[random_next(random) % (sizeof words / sizeof words[0])]);
        break;
    case 2:
        at = random_next(random) % (size / 4) * 4;
        bytes_put32(blob + at, bytes_get32(blob + at) + (random_next(random) % 2 ? 1 : UINT32_MAX));
        break;
    default:
        blob[at] ^= (unsigned char)(1 << random_next(random) % 8);
    }
}

static void flip(unsigned char *blob, const unsigned char *original, uint64_t size, uint64_t flips,
                 struct random *random, double extent, struct tally *tally)
{
    for (uint64_t i = 0; i < flips; i++) {
        memcpy(blob, original, size);
        for (uint64_t k = random_next(random) % 4 ? 1 : 1 + random_next(random) % 8; k > 0; k--)
            damage(blob, size, random);
        try_open(blob, size, random, extent, tally);
    }
}

static void report(const char *what, const struct tally *tally)
{
    printf("%-12s %9" PRIu64 " refused %9" PRIu64 " opened %9" PRIu64 " hits\n", what, tally->refused, tally->opened,
           tally->hits);
}

static void run(uint64_t flips, uint64_t seed)
{
    struct random random = {seed};
    struct tally cut = {0}, headers = {0}, flipped = {0};
    for (int i = 0; i < SUBJECTS; i++) {
        const struct test_shape *shape = &subjects[i].shape;
        struct bytes blob = test_blob_make(shape, seed + (uint64_t)i, subjects[i].layout_flags);
        unsigned char *copy = exact_block(blob.size);
        memcpy(copy, blob.data, blob.size);
        truncate_blob(blob, &random, shape->size, &cut);
        spoil_headers(copy, blob.size, &random, shape->size, &headers);
        flip(copy, blob.data, blob.size, flips / SUBJECTS + 1, &random, shape->size, &flipped);
        free(copy);
        test_blob_free(blob);
    }
    report("truncations", &cut);
    report("headers", &headers);
    report("flips", &flipped);
    if (flipped.opened == 0 || flipped.hits == 0 || flipped.refused == 0)
        fail("the flips tested nothing", &(struct bvhd_error){.where = ""});
}

int main(int argc, char **argv)
{
    uint64_t flips = argc > 1 ? strtoull(argv[1], NULL, 10) : 100000, seed = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
    static const struct test_shape shape = {
        .type = GEOMETRY_TRIANGLES, .geometries = 1, .primitives = 20, .size = 1, .detail = 0.5};
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    struct bytes blob = test_blob_make(&shape, seed, 0);
    if (portable_open(blob, &memory, &bottom, &error) != BVHD_OK)
        fail("an untouched blob", &error);
    run(flips, seed);
    test_blob_free(blob);
    return memory.live == 0 ? 0 : 1;
}
