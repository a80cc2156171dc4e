/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_round.c - tests spheres and linear swept spheres of many chunks: on several threads, and with a caller that
 * writes to its indices meanwhile.
 */
#include "tests/support/unit.h"

#include <pthread.h>
#include <stdatomic.h>

#include "builder/input/prepare.h"
#include "builder/workers.h"
#include "tests/support/random.h"

enum { COUNT = 100001, FORMS = 6 };

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static const struct build_context serial = {.memory = &memory, .parallel = &parallel_serial};

struct large {
    struct build_input input;
    struct geometry geometries[FORMS];
    float (*vertices)[4];
    uint32_t *chain, *pairs;
};

/* Makes a chain of that many links, a list of the same pairs, one of others, one without indices, and spheres. */
static void large_make(struct large *large, bool spheres)
{
    struct random random = {3};
    *large = (struct large){.vertices = calloc(2 * COUNT, sizeof *large->vertices),
                            .chain = calloc(COUNT, sizeof *large->chain),
                            .pairs = calloc(4 * COUNT, sizeof *large->pairs)};
    assert_true(large->vertices && large->chain && large->pairs);
    for (int i = 0; i < 2 * COUNT; i++)
        for (int k = 0; k < 4; k++)
            large->vertices[i][k] = (float)random_between(&random, 0, 1);
    for (uint32_t i = 0; i < COUNT; i++) {
        large->chain[i] = i + i / 20000; /* some chains */
        large->pairs[2 * i] = i;
        large->pairs[2 * i + 1] = i + 1;
        large->pairs[2 * COUNT + 2 * i] = (uint32_t)(random_next(&random) % COUNT);
        large->pairs[2 * COUNT + 2 * i + 1] = (uint32_t)(random_next(&random) % COUNT);
    }
    for (int form = 0; form < FORMS; form++) {
        const uint32_t *indices = form < 2 ? large->chain : form == 2 ? large->pairs : large->pairs + 2 * COUNT;
        const bool indexed = form != 4, is_list = form >= 2;
        const struct geometry_spheres arrays = {
            .vertex_format = 106,
            .radius_format = 100,
            .index_type = indexed ? INDEX_UINT32 : INDEX_NONE,
            .vertex_stride = 16,
            .radius_stride = 16,
            .index_stride = indexed ? 4 : 0,
            .vertices = {(const unsigned char *)large->vertices, 2 * COUNT * sizeof *large->vertices},
            .radii = {(const unsigned char *)&large->vertices[0][3], 2 * COUNT * sizeof *large->vertices - 12},
            .indices = {indexed ? (const unsigned char *)indices : NULL, (uint64_t)4 * COUNT * (is_list ? 2 : 1)},
        };
        large->geometries[form] = (struct geometry){
            .type = spheres ? GEOMETRY_SPHERES : GEOMETRY_SWEPT_SPHERES,
            .range = {.primitive_count = COUNT - 1 - (uint32_t)form},
        };
        if (spheres)
            large->geometries[form].spheres = arrays;
        else
            large->geometries[form].swept_spheres = (struct geometry_swept_spheres){
                arrays, is_list ? SWEPT_LIST : SWEPT_SUCCESSIVE, form ? SWEPT_CAPS_CHAINED : SWEPT_CAPS_NONE};
    }
    large->input = (struct build_input){.type = STRUCTURE_BOTTOM,
                                        .flags = BUILD_ALLOW_UPDATE,
                                        .geometry_count = FORMS,
                                        .geometries = large->geometries,
                                        .options.target = TARGET_PORTABLE};
}

static void large_finish(struct large *large)
{
    free(large->vertices);
    free(large->chain);
    free(large->pairs);
}

/* A chain goes on from one chunk to the next. */
static void check_chain(const struct canonical *canonical)
{
    const uint32_t *indices = canonical->geometries[1].indices;
    for (uint32_t i = 0; i < COUNT - 2; i++)
        assert_int_equal(indices[i],
                         (i + i / 20000) | CANONICAL_CAP_SECOND | (i % 20000 == 0 ? CANONICAL_CAP_FIRST : 0));
    assert_int_equal(canonical->geometries[2].vertex_count, COUNT - 2);
    assert_int_equal(canonical->geometries[3].vertex_count, 2 * (COUNT - 4));
}

static void threads_do_not_count(void **state)
{
    (void)state;
    for (int spheres = 0; spheres < 2; spheres++) {
        struct large large;
        struct limits limits = limits_default();
        struct canonical one, many;
        large_make(&large, spheres);
        assert_int_equal(prepare(&large.input, 0, &limits, &serial, &one, NULL), BVHD_OK);
        if (!spheres)
            check_chain(&one);
        for (unsigned threads = 2; threads <= 8; threads *= 2) {
            struct workers *workers;
            assert_int_equal(workers_create(threads, &workers, NULL), BVHD_OK);
            struct build_context threaded = {.memory = &memory, .parallel = workers_parallel(workers)};
            assert_int_equal(prepare(&large.input, 0, &limits, &threaded, &many, NULL), BVHD_OK);
            assert_int_equal(one.size, many.size);
            assert_memory_equal(one.bytes, many.bytes, one.size);
            prepare_finish(&many, &memory);
            workers_destroy(workers);
        }
        prepare_finish(&one, &memory);
        assert_int_equal(memory.live, 0);
        large_finish(&large);
    }
}

/* A build that has been cancelled leaves nothing. */
static void cancelled_copies_leave_nothing(void **state)
{
    (void)state;
    struct large large;
    struct limits limits = limits_default();
    struct canonical canonical;
    atomic_bool cancel = true;
    const struct build_context cancelled = {.memory = &memory, .parallel = &parallel_serial, .cancel = &cancel};
    large_make(&large, false);
    assert_int_equal(prepare(&large.input, 0, &limits, &cancelled, &canonical, NULL), BVHD_CANCELLED);
    assert_int_equal(memory.live, 0);
    large_finish(&large);
}

struct scribbler {
    _Atomic uint32_t *indices;
    uint32_t count;
    atomic_bool stop;
};

static void *scribble(void *context)
{
    struct scribbler *scribbler = context;
    struct random random = {5};
    while (!atomic_load(&scribbler->stop))
        for (int i = 0; i < 1000; i++) {
            _Atomic uint32_t *at = &scribbler->indices[random_next(&random) % scribbler->count];
            atomic_store_explicit(at, i % 100 ? 1000 + 80 * (uint32_t)i : UINT32_MAX, memory_order_relaxed);
            for (volatile int wait = 0; wait < 50; wait++)
                ;
            atomic_store_explicit(at, 0, memory_order_relaxed);
        }
    return NULL;
}

#if defined(__SANITIZE_THREAD__)
enum { RACES_ARE_REPORTED = 1 };
#elif defined(__has_feature)
#if __has_feature(thread_sanitizer)
enum { RACES_ARE_REPORTED = 1 };
#else
enum { RACES_ARE_REPORTED = 0 };
#endif
#else
enum { RACES_ARE_REPORTED = 0 };
#endif

/* The indices that were read are the ones that are checked: what is accepted is a copy that opens. */
static void scribbling_harms_nobody(void **state)
{
    (void)state;
    enum { PRIMITIVES = 10000 };
    if (RACES_ARE_REPORTED)
        return; /* the race is what this test makes */
    struct large large;
    struct limits limits = limits_default();
    uint32_t accepted = 0, refused = 0;
    for (int round = 0; round < 24; round++) {
        large_make(&large, false);
        large.input.geometries = &large.geometries[round % 4];
        large.input.geometry_count = 1;
        large.geometries[round % 4].range.primitive_count = PRIMITIVES;
        if (round % 3 == 0) /* some of what is written is out of range, and all of what was there is in it */
            large.geometries[round % 4].swept_spheres.ends.vertices.size = 60000 * sizeof *large.vertices;
        for (uint32_t i = 0; i < 2 * PRIMITIVES && round % 4 == 3; i++)
            large.pairs[2 * COUNT + i] %= 1000;
        struct scribbler scribbler = {
            .indices = (_Atomic uint32_t *)(round % 4 < 2    ? large.chain
                                            : round % 4 == 2 ? large.pairs
                                                             : large.pairs + 2 * COUNT),
            .count = PRIMITIVES,
        };
        pthread_t thread;
        assert_int_equal(pthread_create(&thread, NULL, scribble, &scribbler), 0);
        for (int i = 0; i < 20; i++) {
            struct canonical canonical, view;
            if (prepare(&large.input, 0, &limits, &serial, &canonical, NULL) != BVHD_OK) {
                refused++;
                continue;
            }
            accepted++;
            assert_int_equal(prepare_open((struct bytes){canonical.bytes, canonical.size}, &memory, &view, NULL),
                             BVHD_OK);
            prepare_finish(&view, &memory);
            prepare_finish(&canonical, &memory);
        }
        atomic_store(&scribbler.stop, true);
        pthread_join(thread, NULL);
        assert_int_equal(memory.live, 0);
        large_finish(&large);
    }
    assert_true(accepted > 0);
    print_message("accepted %u copies, refused %u\n", accepted, refused);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(threads_do_not_count),
        cmocka_unit_test(cancelled_copies_leave_nothing),
        cmocka_unit_test(scribbling_harms_nobody),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
