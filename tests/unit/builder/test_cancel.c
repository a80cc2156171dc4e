/* SPDX-License-Identifier: Apache-2.0 */
/* test_cancel.c - tests that prepare, content_key and build stop soon after a cancellation, and hold nothing. */
#include "tests/support/unit.h"

#include <math.h>
#include <pthread.h>
#include <time.h>

#include "builder/build.h"
#include "builder/content_key.h"
#include "builder/input/fetch.h"
#include "builder/input/prepare.h"
#include "tests/support/builder/builders.h"
#include "tests/support/random.h"
#include "builder/input/validate.h"
#include "builder/workers.h"

/* Runs tasks one after another, and sets the flag before task number `at`, counted over all loops. */
struct clock {
    struct parallel face;
    size_t tasks, at;
    atomic_bool cancel;
};

static void tick_for_each(const struct parallel *self, size_t count, parallel_task task, void *context)
{
    struct clock *clock = (struct clock *)(uintptr_t)self;
    for (size_t i = 0; i < count; i++) {
        if (clock->tasks++ == clock->at)
            atomic_store(&clock->cancel, true);
        task(context, i);
    }
}

/* So many triangles that all threads cut the first range together (builder/top/split.c). */
enum { TRIANGLES = 40000, VERTICES = 50000, INSTANCES = 30000, BOXES = 20000 };

struct scene {
    struct build_input input;
    struct geometry geometry;
    struct reference references[2];
    float (*vertices)[3];
    uint32_t *indices;
    float (*boxes)[6];
    uint32_t (*records)[16];
};

static void *zeroed(size_t count, size_t size)
{
    void *block = calloc(count, size);
    assert_non_null(block);
    return block;
}

static void scene_start(struct scene *scene, uint32_t type)
{
    memset(scene, 0, sizeof *scene);
    scene->input = (struct build_input){.type = type,
                                        .geometry_count = 1,
                                        .geometries = &scene->geometry,
                                        .options = {.target = TARGET_PORTABLE, .builder = builders_asked()}};
}

static void scene_finish(struct scene *scene)
{
    free(scene->vertices);
    free(scene->indices);
    free(scene->boxes);
    free(scene->records);
}

/* Small triangles in random places; the lowest vertices and some others are not used. */
static void make_triangles(struct scene *scene, float size)
{
    struct random random = {3};
    scene_start(scene, STRUCTURE_BOTTOM);
    scene->vertices = zeroed(VERTICES, sizeof *scene->vertices);
    scene->indices = zeroed(3 * TRIANGLES, sizeof *scene->indices);
    for (uint32_t i = 0; i < VERTICES; i++)
        for (int axis = 0; axis < 3; axis++)
            scene->vertices[i][axis] = size * (float)(i % 997 * (axis == 0) + random_between(&random, 0, 9));
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        uint32_t corner = 100 + (uint32_t)(random_next(&random) % (VERTICES - 5000));
        for (uint32_t k = 0; k < 3; k++)
            scene->indices[3 * i + k] = corner + 2 * k;
    }
    scene->geometry = (struct geometry){
        .type = GEOMETRY_TRIANGLES,
        .triangles = {.vertex_format = 106,
                      .max_vertex = VERTICES - 1,
                      .vertex_stride = 12,
                      .index_type = INDEX_UINT32,
                      .vertices = {(const unsigned char *)scene->vertices, VERTICES * sizeof *scene->vertices},
                      .indices = {(const unsigned char *)scene->indices, 3 * TRIANGLES * sizeof *scene->indices}},
        .range = {.primitive_count = TRIANGLES},
    };
}

/*
 * Each box is a little farther out than the one before, which makes a tree so deep that it is limited. Some are
 * inactive.
 */
static void make_chain(struct scene *scene)
{
    scene_start(scene, STRUCTURE_BOTTOM);
    scene->boxes = zeroed(BOXES, sizeof *scene->boxes);
    for (uint32_t i = 0; i < BOXES; i++)
        for (int axis = 0; axis < 3; axis++) {
            scene->boxes[i][axis] = axis ? 0 : i % 7 == 3 ? NAN : (float)pow(1.012, i % 4500);
            scene->boxes[i][3 + axis] = axis ? 1 : i % 7 == 3 ? 0 : 1.001f * scene->boxes[i][axis];
        }
    scene->geometry = (struct geometry){
        .type = GEOMETRY_AABBS,
        .aabbs = {24, {(const unsigned char *)scene->boxes, BOXES * sizeof *scene->boxes}},
        .range = {.primitive_count = BOXES},
    };
}

static void make_instances(struct scene *scene)
{
    scene_start(scene, STRUCTURE_TOP);
    scene->records = zeroed(INSTANCES, sizeof *scene->records);
    for (uint32_t i = 0; i < INSTANCES; i++) {
        const float matrix[12] = {1, 0, 0, (float)(i % 171), 0, 1, 0, (float)(i / 171), 0, 0, 1, 0};
        uint64_t handle = 5 + i % 2;
        memcpy(scene->records[i], matrix, sizeof matrix);
        memcpy(scene->records[i] + 14, &handle, sizeof handle);
    }
    for (uint32_t i = 0; i < 2; i++)
        scene->references[i] =
            (struct reference){.kind = REFERENCE_BLAS, .handle = 5 + i, .bounds = {{0, 0, 0}, {1, 1, 1}}};
    scene->input.references = scene->references;
    scene->input.reference_count = 2;
    scene->geometry = (struct geometry){
        .type = GEOMETRY_INSTANCES,
        .instances = {{(const unsigned char *)scene->records, INSTANCES * sizeof *scene->records}},
        .range = {.primitive_count = INSTANCES},
    };
}

static enum bvhd_status run_all(const struct build_input *input, const struct build_context *context,
                                struct bvhd_error *error)
{
    struct limits limits = limits_default();
    struct canonical canonical;
    struct key key;
    struct build_stats stats;
    unsigned char *blob = NULL;
    enum bvhd_status status = prepare(input, 0, &limits, context, &canonical, error);
    if (status != BVHD_OK)
        return status;
    status = content_key(&canonical, &input->options, context, &key, error);
    if (status == BVHD_OK)
        status = build(&canonical, &input->options, context, &blob, &stats, error);
    assert_true((blob != NULL) == (status == BVHD_OK));
    memory_free(context->memory, blob);
    prepare_finish(&canonical, context->memory);
    return status;
}

/* Returns how many tasks the whole run takes. */
static size_t cancel_everywhere(struct scene *scene, enum build_quality quality)
{
    enum bvhd_status status = BVHD_CANCELLED;
    size_t tasks = 0;
    const size_t closeness = builders_asked() == BUILDER_OWN ? 4 : 1; /* Embree is slower */
    scene->input.options.quality = quality;
    for (size_t at = 0; status == BVHD_CANCELLED; at += 1 + at / closeness) {
        struct memory memory;
        struct clock clock = {{1, tick_for_each}, 0, at, false};
        struct build_context context = {.memory = &memory, .parallel = &clock.face, .cancel = &clock.cancel};
        struct bvhd_error error = {.status = BVHD_OK};
        memory_init(&memory, UINT64_MAX);
        status = run_all(&scene->input, &context, &error);
        assert_int_equal(memory.live, 0);
        assert_int_equal(error.status, status);
        assert_int_equal(status, atomic_load(&clock.cancel) ? BVHD_CANCELLED : BVHD_OK);
        tasks = clock.tasks;
    }
    return tasks;
}

static void triangles_of_each_quality(void **state)
{
    (void)state;
    struct scene scene;
    make_triangles(&scene, 0.01f);
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
        assert_true(cancel_everywhere(&scene, quality) > 100);
    scene_finish(&scene);
}

static void extreme_magnitudes(void **state)
{
    (void)state;
    struct scene scene;
    make_triangles(&scene, 1e20f);
    assert_true(cancel_everywhere(&scene, QUALITY_BALANCED) > 100);
    scene_finish(&scene);
}

static void deep_trees(void **state)
{
    (void)state;
    struct scene scene;
    make_chain(&scene);
    assert_true(cancel_everywhere(&scene, QUALITY_BALANCED) > 50);
    scene_finish(&scene);
}

static void top_levels(void **state)
{
    (void)state;
    struct scene scene;
    make_instances(&scene);
    assert_true(cancel_everywhere(&scene, QUALITY_HIGH) > 50);
    scene_finish(&scene);
}

/* The flag is set before anything is done: each step checks it by itself. */
static void a_set_flag_stops_each_step(void **state)
{
    (void)state;
    struct scene scene;
    struct limits limits = limits_default();
    struct memory memory;
    struct canonical canonical;
    struct key key;
    struct build_stats stats;
    unsigned char *blob;
    atomic_bool cancel = true;
    memory_init(&memory, UINT64_MAX);
    make_triangles(&scene, 1);
    struct build_context whole = {.memory = &memory, .parallel = &parallel_serial}, none = whole;
    none.cancel = &cancel;
    assert_int_equal(prepare(&scene.input, 0, &limits, &none, &canonical, NULL), BVHD_CANCELLED);
    assert_int_equal(memory.live, 0);
    assert_int_equal(prepare(&scene.input, 0, &limits, &whole, &canonical, NULL), BVHD_OK);
    uint64_t live = memory.live;
    assert_int_equal(content_key(&canonical, &scene.input.options, &none, &key, NULL), BVHD_CANCELLED);
    assert_int_equal(memory.live, live);
    assert_int_equal(build(&canonical, &scene.input.options, &none, &blob, &stats, NULL), BVHD_CANCELLED);
    assert_int_equal(memory.live, live);
    prepare_finish(&canonical, &memory);
    assert_int_equal(memory.live, 0);
    scene_finish(&scene);
}

/* The functions that only go through the rows of geometries and references check the flag too. */
static void a_set_flag_stops_going_through_rows(void **state)
{
    (void)state;
    struct scene scenes[2];
    make_triangles(&scenes[0], 1);
    make_instances(&scenes[1]);
    for (int i = 0; i < 2; i++) {
        const struct build_input *input = &scenes[i].input;
        struct limits limits = limits_default();
        struct memory memory;
        struct fetch fetch;
        struct reference_lookup lookup;
        struct bvhd_error error = {0};
        atomic_bool cancel = true;
        struct build_context context = {.memory = &memory, .parallel = &parallel_serial, .cancel = &cancel};
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(validate_input_until(input, 4, &limits, &cancel, &error), BVHD_CANCELLED);
        assert_string_equal(error.where, "infos[4]");
        assert_int_equal(fetch_init(&fetch, input, 4, &context, &error), BVHD_CANCELLED);
        assert_int_equal(reference_lookup_init(input, 4, &context, &lookup, NULL),
                         input->reference_count ? BVHD_CANCELLED : BVHD_OK);
        assert_int_equal(memory.live, 0);
        cancel = false;
        assert_int_equal(validate_input_until(input, 4, &limits, &cancel, NULL), BVHD_OK);
        scene_finish(&scenes[i]);
    }
}

struct setter {
    atomic_bool cancel;
    long after_ns;
};

static void *set_later(void *context)
{
    struct setter *setter = context;
    struct timespec wait = {0, setter->after_ns};
    nanosleep(&wait, NULL);
    atomic_store(&setter->cancel, true);
    return NULL;
}

/* Several threads build, and another thread sets the flag. */
static void from_another_thread(void **state)
{
    (void)state;
    struct scene scene;
    struct workers *workers;
    make_triangles(&scene, 1);
    assert_int_equal(workers_create(3, &workers, NULL), BVHD_OK);
    for (int i = 0; i < (builders_asked() == BUILDER_OWN ? 30 : 9); i++) {
        struct memory memory;
        struct setter setter = {.after_ns = 300000L * i};
        struct build_context context = {
            .memory = &memory, .parallel = workers_parallel(workers), .cancel = &setter.cancel};
        pthread_t thread;
        scene.input.options.quality = (enum build_quality)(QUALITY_FAST + i % 3);
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(pthread_create(&thread, NULL, set_later, &setter), 0);
        enum bvhd_status status = run_all(&scene.input, &context, NULL);
        pthread_join(thread, NULL);
        assert_true(status == BVHD_OK || status == BVHD_CANCELLED);
        assert_int_equal(memory.live, 0);
    }
    workers_destroy(workers);
    scene_finish(&scene);
}

enum { ROWS = 400000 };

/*
 * There are hundreds of thousands of geometries with almost no content: whichever loop over rows is running, it notices
 * the flag.
 */
static void among_many_rows(void **state)
{
    (void)state;
    static const float box[6] = {0, 0, 0, 1, 1, 1};
    struct geometry *geometries = zeroed(ROWS, sizeof *geometries);
    struct limits limits = limits_default();
    struct build_input input = {
        .type = STRUCTURE_BOTTOM, .geometry_count = ROWS, .geometries = geometries, .options.target = TARGET_PORTABLE};
    for (uint32_t i = 0; i < ROWS; i++)
        geometries[i] = (struct geometry){.type = GEOMETRY_AABBS,
                                          .aabbs = {24, {(const unsigned char *)box, sizeof box}},
                                          .range = {.primitive_count = 1}};
    for (int i = 0; i < 20; i++) {
        struct memory memory;
        struct setter setter = {.after_ns = 3000000L * i};
        struct build_context context = {.memory = &memory, .parallel = &parallel_serial, .cancel = &setter.cancel};
        struct canonical canonical = {0};
        pthread_t thread;
        memory_init(&memory, UINT64_MAX);
        assert_int_equal(pthread_create(&thread, NULL, set_later, &setter), 0);
        enum bvhd_status status = prepare(&input, 0, &limits, &context, &canonical, NULL);
        pthread_join(thread, NULL);
        assert_true(status == BVHD_OK || status == BVHD_CANCELLED);
        if (status == BVHD_OK)
            prepare_finish(&canonical, &memory);
        assert_int_equal(memory.live, 0);
    }
    free(geometries);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(triangles_of_each_quality),
        cmocka_unit_test(extreme_magnitudes),
        cmocka_unit_test(deep_trees),
        cmocka_unit_test(top_levels),
        cmocka_unit_test(a_set_flag_stops_each_step),
        cmocka_unit_test(a_set_flag_stops_going_through_rows),
        cmocka_unit_test(from_another_thread),
        cmocka_unit_test(among_many_rows),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
