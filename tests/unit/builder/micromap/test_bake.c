/* SPDX-License-Identifier: Apache-2.0 */
/* test_bake.c - tests whole micromaps: what they decide, what they share, and how baking fails. */
#include "tests/support/unit.h"

#include <math.h>
#include <time.h>

#include "builder/micromap/bake.h"
#include "builder/workers.h"
#include "tests/support/random.h"
#include "tests/support/scene/cutouts.h"

enum { SIDE = 256 };

static unsigned char leaf[SIDE * SIDE], fence[SIDE * SIDE];
static struct memory memory;
static struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
static const float card[6][2] = {{0, 0}, {1, 0}, {0, 1}, {1, 1}, {0, 1}, {1, 0}};

static struct bake_request request_of(const unsigned char *texels, const float (*coordinates)[2], uint32_t triangles)
{
    return (struct bake_request){
        .texture = {.texels = {texels, SIDE * SIDE}, .row_stride = SIDE, .width = SIDE, .height = SIDE, .cutoff = 0.5f},
        .coordinates = coordinates,
        .coordinate_count = 3 * triangles,
        .triangle_count = triangles,
        .format = MICRO_4_STATE,
        .level = 4,
    };
}

/* Random triangles, some of them twice, some of which lie in one state. */
static void make_triangles(struct random *random, float (*coordinates)[2], uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        const double size = random_between(random, 0, 0.5), s = random_between(random, 0, 1);
        const double t = random_between(random, 0, 1);
        for (uint32_t corner = 3 * i; corner < 3 * i + 3; corner++) {
            coordinates[corner][0] = (float)(s + random_between(random, -size, size));
            coordinates[corner][1] = (float)(t + random_between(random, -size, size));
        }
        if (i > 0 && random_next(random) % 4 == 0)
            memcpy(coordinates[3 * i], coordinates[3 * (i - 1)], 3 * sizeof coordinates[0]);
    }
}

/* Checks what all results have in common, and counts the shares anew. */
static void check_result(const struct bake_request *request, const struct baked *baked)
{
    uint32_t usages[MICRO_LEVEL_MAX + 1] = {0}, references[MICRO_LEVEL_MAX + 1] = {0};
    uint64_t special[MICRO_STATES] = {0}, filled = 0;
    double shares[MICRO_STATES] = {0};
    for (uint32_t i = 0; i < baked->triangle_count; i++) {
        const struct micromap_triangle *triangle = &baked->triangles[i];
        assert_true(triangle->level >= 1 && triangle->level <= MICRO_LEVEL_MAX);
        assert_int_equal(triangle->format, request->format);
        assert_int_equal(triangle->offset, filled);
        filled += micro_triangle_bytes(request->format, triangle->level);
        usages[triangle->level]++;
    }
    assert_int_equal(filled, baked->data_size);
    for (uint32_t i = 0; i < request->triangle_count; i++) {
        const uint32_t index = baked->indices[i];
        if (index >= MICROMAP_FULLY_UNKNOWN_OPAQUE) {
            special[~index]++;
            shares[~index] += 1.0 / request->triangle_count;
            continue;
        }
        assert_true(index < baked->triangle_count);
        const struct micromap_triangle *triangle = &baked->triangles[index];
        references[triangle->level]++;
        const uint32_t micros = micro_triangle_count(triangle->level);
        for (uint32_t micro = 0; micro < micros; micro++)
            shares[micro_triangle_state(baked->data + triangle->offset, request->format, micro)] +=
                1.0 / micros / request->triangle_count;
    }
    assert_memory_equal(usages, baked->usages, sizeof usages);
    assert_memory_equal(references, baked->references, sizeof references);
    assert_memory_equal(special, baked->statistics.special, sizeof special);
    for (int state = 0; state < MICRO_STATES; state++)
        assert_true(fabs(shares[state] - baked->statistics.shares[state]) < 1e-9);
}

static bool is_same(const struct baked *a, const struct baked *b, uint32_t triangles)
{
    if (a->triangle_count != b->triangle_count || a->data_size != b->data_size)
        return false;
    return (a->triangle_count == 0 ||
            memcmp(a->triangles, b->triangles, a->triangle_count * sizeof *a->triangles) == 0) &&
           (a->data_size == 0 || memcmp(a->data, b->data, a->data_size) == 0) &&
           memcmp(a->indices, b->indices, triangles * sizeof *a->indices) == 0;
}

/* What a leaf's card and a fence's quad decide at level 4. */
static void test_quality(void **state)
{
    (void)state;
    const unsigned char *const pictures[] = {leaf, fence};
    for (int i = 0; i < 2; i++) {
        const struct bake_request request = request_of(pictures[i], card, 2);
        struct baked baked;
        assert_int_equal(bake(&request, &context, &baked, NULL), BVHD_OK);
        check_result(&request, &baked);
        assert_true(baked.statistics.decided >= 0.8);
        assert_int_equal(baked.data_size, 128);
        bake_finish(&baked, &memory);
    }
}

/* The same for any number of threads, levels and formats, also where levels are chosen. */
static void test_threads(void **state)
{
    (void)state;
    enum { COUNT = 200 };
    float coordinates[3 * COUNT][2];
    struct random random = {1};
    struct workers *workers;
    make_triangles(&random, coordinates, COUNT);
    assert_int_equal(workers_create(3, &workers, NULL), BVHD_OK);
    struct build_context together = context;
    together.parallel = workers_parallel(workers);
    for (uint32_t level = 0; level <= 7; level++)
        for (int format = MICRO_2_STATE; format <= MICRO_4_STATE; format++) {
            struct bake_request request = request_of(leaf, (const float(*)[2])coordinates, COUNT);
            request.level = level == 7 ? BAKE_LEVEL_AUTO : level;
            request.format = (enum micro_format)format;
            request.worth = BAKE_WORTH;
            request.last_level = 6;
            request.budget = 4000;
            struct baked a, b;
            assert_int_equal(bake(&request, &context, &a, NULL), BVHD_OK);
            assert_int_equal(bake(&request, &together, &b, NULL), BVHD_OK);
            check_result(&request, &a);
            assert_true(is_same(&a, &b, COUNT));
            if (level == 0)
                assert_int_equal(a.triangle_count, 0);
            if (level == 7)
                assert_true(a.data_size <= 4000 && a.triangle_count > 0);
            bake_finish(&a, &memory);
            bake_finish(&b, &memory);
        }
    workers_destroy(workers);
    assert_int_equal(memory.live, 0);
}

/* Triangles of one state have special indices, equal ones share, and indices are as good as copies. */
static void test_sharing(void **state)
{
    (void)state;
    float coordinates[15][2];
    memcpy(coordinates, card, sizeof card);
    for (int i = 0; i < 3; i++) {
        coordinates[6 + i][0] = card[i][0] + 5; /* the first one, five repeats away */
        coordinates[6 + i][1] = card[i][1] - 3;
        coordinates[9 + i][0] = 0.5f + 0.05f * card[i][0]; /* within the leaf */
        coordinates[9 + i][1] = 0.5f + 0.05f * card[i][1];
        coordinates[12 + i][0] = 0.05f * card[i][0]; /* beside it */
        coordinates[12 + i][1] = 0.05f * card[i][1];
    }
    struct bake_request request = request_of(leaf, (const float(*)[2])coordinates, 5);
    struct baked a, b;
    assert_int_equal(bake(&request, &context, &a, NULL), BVHD_OK);
    check_result(&request, &a);
    assert_int_equal(a.triangle_count, 2);
    assert_int_equal(a.indices[0], a.indices[2]);
    assert_true(a.indices[3] == MICROMAP_FULLY_OPAQUE && a.indices[4] == MICROMAP_FULLY_TRANSPARENT);
    uint32_t indices[15];
    for (uint32_t i = 0; i < 15; i++)
        indices[i] = i;
    request.indices = indices;
    assert_int_equal(bake(&request, &context, &b, NULL), BVHD_OK);
    assert_true(is_same(&a, &b, 5));
    bake_finish(&a, &memory);
    bake_finish(&b, &memory);
}

/* A texture of one value; one with values that blend. */
static void test_uniform(void **state)
{
    (void)state;
    static unsigned char texels[SIDE * SIDE];
    const float hostile[9][2] = {{NAN, 0}, {1, 0}, {0, 1}, {3e38f, -3e38f}, {0, 0}, {1, 1}, {0, 0}, {0, 0}, {0, 0}};
    const uint32_t expected[] = {MICROMAP_FULLY_TRANSPARENT, MICROMAP_FULLY_UNKNOWN_TRANSPARENT,
                                 MICROMAP_FULLY_UNKNOWN_OPAQUE, MICROMAP_FULLY_OPAQUE};
    const int values[] = {0, 1, 254, 255};
    for (int i = 0; i < 4; i++) {
        memset(texels, values[i], sizeof texels);
        struct bake_request request = request_of(texels, hostile, 3);
        request.texture.mode = BAKE_BLEND;
        struct baked baked;
        assert_int_equal(bake(&request, &context, &baked, NULL), BVHD_OK);
        assert_int_equal(baked.indices[2], expected[i]);
        if (i % 3 == 0)
            assert_true(baked.indices[0] == expected[i] && baked.indices[1] == expected[i]);
        else /* no place, so no state but the cautious one */
            assert_true(baked.indices[0] == MICROMAP_FULLY_UNKNOWN_OPAQUE && baked.indices[1] == baked.indices[0]);
        assert_int_equal(baked.data_size, 0);
        bake_finish(&baked, &memory);
    }
    const struct bake_request none = request_of(leaf, card, 0);
    struct baked baked;
    assert_int_equal(bake(&none, &context, &baked, NULL), BVHD_OK);
    assert_int_equal(baked.triangle_count, 0);
    bake_finish(&baked, &memory);
    assert_int_equal(memory.live, 0);
}

/* A further level decides more, and a smaller worth gives more bytes that decide more. */
static void test_worth(void **state)
{
    (void)state;
    uint64_t bytes = 0;
    double decided = 0;
    for (double worth = 1e-1; worth > 1e-7; worth /= 10) {
        struct bake_request request = request_of(leaf, card, 2);
        request.level = BAKE_LEVEL_AUTO;
        request.last_level = 9;
        request.worth = worth;
        request.budget = UINT64_MAX;
        struct baked baked;
        assert_int_equal(bake(&request, &context, &baked, NULL), BVHD_OK);
        check_result(&request, &baked);
        assert_true(baked.data_size >= bytes && baked.statistics.decided >= decided);
        bytes = baked.data_size;
        decided = baked.statistics.decided;
        bake_finish(&baked, &memory);
    }
    assert_true(bytes > 10000 && decided > 0.97);
}

/* Triangles over thousands of repeats of a large texture end soon, also where no look ends early. */
static void test_time(void **state)
{
    (void)state;
    enum { LARGE = 4096 };
    unsigned char *texels = malloc((size_t)LARGE * LARGE);
    assert_non_null(texels);
    memset(texels, 255, (size_t)LARGE * LARGE);
    for (int x = 0; x < LARGE; x += 128) /* so that all large blocks are mixed */
        texels[x] = 0;
    const float coordinates[12][2] = {{0, 0},         {1, 30000},     {0.001f, 30000}, {0, 0},
                                      {1, 29000},     {0.01f, 29000}, {0.5f, 0.5f},    {30000, 0.7f},
                                      {-30000, 0.3f}, {-30000, 0},    {30000, 30000},  {0, -30000}};
    struct bake_request request = request_of(texels, coordinates, 4);
    request.texture.texels.size = (uint64_t)LARGE * LARGE;
    request.texture.row_stride = request.texture.width = request.texture.height = LARGE;
    request.level = 8;
    struct baked baked;
    const clock_t start = clock();
    assert_int_equal(bake(&request, &context, &baked, NULL), BVHD_OK);
    check_result(&request, &baked);
    assert_true((double)(clock() - start) / CLOCKS_PER_SEC < 5); /* 0.2 s in release builds, and long without care */
    bake_finish(&baked, &memory);
    free(texels);
}

static void test_refusals(void **state)
{
    (void)state;
    const struct bake_request good = request_of(leaf, card, 2);
    struct bake_request bad[9];
    struct baked baked;
    struct bvhd_error error;
    for (int i = 0; i < 9; i++)
        bad[i] = good;
    bad[0].format = (enum micro_format)3;
    bad[1].level = MICRO_LEVEL_MAX + 1;
    bad[2].level = BAKE_LEVEL_AUTO;
    bad[2].last_level = MICRO_LEVEL_MAX + 1;
    bad[3].level = BAKE_LEVEL_AUTO;
    bad[3].worth = NAN;
    bad[4].extra[1] = -1;
    bad[5].extra[0] = NAN;
    bad[6].coordinates = NULL;
    bad[7].coordinate_count = 5;
    bad[8].texture.width = 0;
    for (int i = 0; i < 9; i++)
        assert_int_equal(bake(&bad[i], &context, &baked, &error), BVHD_INVALID);
    bad[0] = good;
    bad[0].triangle_count = UINT32_MAX;
    assert_int_equal(bake(&bad[0], &context, &baked, &error), BVHD_TOO_LARGE);
    assert_int_equal(memory.live, 0);
}

/* Each allocation fails once, and cancellation ends a bake that would take long. */
static void test_failures(void **state)
{
    (void)state;
    for (int is_auto = 0; is_auto < 2; is_auto++) {
        struct bake_request request = request_of(leaf, card, 2);
        request.level = is_auto ? BAKE_LEVEL_AUTO : 4;
        request.last_level = 4;
        request.budget = UINT64_MAX;
        struct baked baked;
        struct bvhd_error error;
        enum bvhd_status status = BVHD_NO_MEMORY;
        int failures = 0;
        for (; status == BVHD_NO_MEMORY; failures++) {
            memory.fail_after = failures;
            status = bake(&request, &context, &baked, &error);
            assert_true(status == BVHD_OK || memory.live == 0);
        }
        memory.fail_after = -1;
        assert_int_equal(status, BVHD_OK);
        assert_true(failures > 6);
        bake_finish(&baked, &memory);
        atomic_bool cancel = true;
        struct build_context cancelled = context;
        cancelled.cancel = &cancel;
        assert_int_equal(bake(&request, &cancelled, &baked, &error), BVHD_CANCELLED);
        assert_int_equal(memory.live, 0);
    }
}

int main(void)
{
    memory_init(&memory, UINT64_MAX);
    cutout_draw(CUTOUT_LEAF, SIDE, leaf);
    cutout_draw(CUTOUT_FENCE, SIDE, fence);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_quality),  cmocka_unit_test(test_threads),  cmocka_unit_test(test_sharing),
        cmocka_unit_test(test_uniform),  cmocka_unit_test(test_worth),    cmocka_unit_test(test_time),
        cmocka_unit_test(test_refusals), cmocka_unit_test(test_failures),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
