/* SPDX-License-Identifier: Apache-2.0 */
/* test_prepare_threads.c - tests prepare on several threads, and with a caller that writes meanwhile. */
#include "tests/support/unit.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>

#include "tests/support/builder/inputs.h"
#include "builder/input/prepare.h"
#include "tests/support/random.h"
#include "builder/workers.h"

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static const struct build_context serial = {.memory = &memory, .parallel = &parallel_serial};

/* A mesh of several chunks, with a count that no chunk size divides. */
struct large {
    struct build_input input;
    struct geometry geometries[5];
    float (*vertices)[4];
    uint32_t *indices;
    uint32_t triangles;
};

static void large_make(struct large *large)
{
    const float matrix[12] = {1, 0.5f, 0, 0, 0, 1, 0, 0, 0, 0, 1, 7};
    static float transform[12];
    struct random random = {11};
    memcpy(transform, matrix, sizeof matrix);
    *large = (struct large){.triangles = 150001};
    uint32_t vertices = 90007;
    large->vertices = malloc(vertices * sizeof *large->vertices);
    large->indices = malloc((size_t)3 * large->triangles * 4);
    assert_true(large->vertices && large->indices);
    for (uint32_t i = 0; i < vertices; i++)
        for (int k = 0; k < 4; k++)
            large->vertices[i][k] = (float)random_between(&random, -1, 1);
    for (uint32_t i = 0; i < 3 * large->triangles; i++)
        large->indices[i] = (uint32_t)(random_next(&random) % vertices);
    for (int g = 0; g < 5; g++)
        large->geometries[g] = (struct geometry){
            .type = GEOMETRY_TRIANGLES,
            .triangles = {.vertex_format = g == 3 ? 103 : 106,
                          .max_vertex = vertices - 1,
                          .vertex_stride = 16,
                          .index_type = g == 1 ? INDEX_NONE : INDEX_UINT32,
                          .vertices = {(const unsigned char *)large->vertices, vertices * sizeof *large->vertices},
                          .indices = {(const unsigned char *)large->indices, (uint64_t)12 * large->triangles},
                          .transform = {g == 4 ? (const unsigned char *)transform : NULL, 48}},
            .range = {.primitive_count = g == 1   ? 30000
                                         : g == 2 ? 0
                                                  : large->triangles - (uint32_t)g},
        };
    large->input = (struct build_input){.type = STRUCTURE_BOTTOM,
                                        .geometry_count = 5,
                                        .geometries = large->geometries,
                                        .options.target = TARGET_PORTABLE};
}

static void large_finish(struct large *large)
{
    free(large->vertices);
    free(large->indices);
}

static void threads_do_not_count(void **state)
{
    (void)state;
    struct large large;
    struct limits limits = limits_default();
    struct canonical one, many;
    large_make(&large);
    assert_int_equal(prepare(&large.input, 0, &limits, &serial, &one, NULL), BVHD_OK);
    for (uint32_t i = 0; i < 3 * large.triangles; i += 977) {
        const struct canonical_geometry *geometry = &one.geometries[0];
        assert_memory_equal(geometry->positions + (size_t)3 * geometry->indices[i], large.vertices[large.indices[i]],
                            12);
    }
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
    large.indices[123457] = 90007;
    struct bvhd_error error;
    assert_int_equal(prepare(&large.input, 0, &limits, &serial, &many, &error), BVHD_INVALID);
    assert_string_equal(error.where, "infos[0].geometries[0].triangles.indices[123457]");
    prepare_finish(&one, &memory);
    assert_int_equal(memory.live, 0);
    large_finish(&large);
}

/*
 * Another thread that writes to the memory while it is prepared, as a client with a shared mapping can. At any time
 * about one index is large, sometimes over maxVertex, so two reads of it would disagree.
 */
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

/* The bytes that were read are the ones that are checked: an accepted copy has its indices in range. */
static void scribbling_harms_nobody(void **state)
{
    (void)state;
    if (RACES_ARE_REPORTED)
        return; /* the race is what this test makes */
    struct large large;
    struct limits limits = limits_default();
    large_make(&large);
    large.input.geometry_count = 1;
    large.geometries[0].range.primitive_count = 20000;
    for (uint32_t i = 0; i < 60000; i++)
        large.indices[i] %= 1000;
    struct scribbler scribbler = {.indices = (_Atomic uint32_t *)large.indices, .count = 60000};
    pthread_t thread;
    uint32_t accepted = 0, seen = 0;
    for (int round = 0; round < 60; round++) {
        large.geometries[0].triangles.vertex_stride = round % 4 ? 16 : 0;
        large.geometries[0].triangles.max_vertex = round % 3 ? 90006 : UINT32_MAX;
        atomic_store(&scribbler.stop, false);
        assert_int_equal(pthread_create(&thread, NULL, scribble, &scribbler), 0);
        for (int i = 0; i < 10; i++) {
            struct canonical canonical;
            enum bvhd_status status = prepare(&large.input, 0, &limits, &serial, &canonical, NULL);
            if (status != BVHD_OK)
                continue;
            const struct canonical_geometry *geometry = canonical.geometries;
            accepted++;
            seen += geometry->vertex_count > 1000;
            for (uint32_t k = 0; k < 60000; k++)
                assert_true(geometry->indices[k] < geometry->vertex_count);
            prepare_finish(&canonical, &memory);
        }
        atomic_store(&scribbler.stop, true);
        pthread_join(thread, NULL);
    }
    assert_int_equal(memory.live, 0);
    assert_true(accepted > 0);
    print_message("accepted %u copies, %u with a large index\n", accepted, seen);
    large_finish(&large);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(threads_do_not_count),
        cmocka_unit_test(scribbling_harms_nobody),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
