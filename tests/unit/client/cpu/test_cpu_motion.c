/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_cpu_motion.c - tests rays at times through built structures that move, and what their hits say: corners,
 * transforms, candidates.
 */
#include "tests/support/unit.h"

#include <math.h>

#include <bvhd/bvhd_cpu.h>

#include "builder/build.h"
#include "builder/input/prepare.h"

enum { MATRIX_RECORD = 30 }; /* words of a record of a matrix motion instance, without its end */

/* A triangle in the plane z = 0 that moves by 8 along x, and one that stands still. */
static const float start_vertices[6][3] = {{0, 0, 0}, {2, 0, 0}, {0, 2, 0}, {0, 8, 0}, {2, 8, 0}, {0, 10, 0}};
static const float end_vertices[6][3] = {{8, 0, 0}, {10, 0, 0}, {8, 2, 0}, {0, 8, 0}, {2, 8, 0}, {0, 10, 0}};

/* What the tests trace through: the bottom level alone, and an instance of it that moves by 16 along z. */
struct bed {
    struct memory memory;
    unsigned char *blobs[2];
    uint64_t sizes[2];
    struct bvhd_cpu_scene *alone, *instanced;
};

static void make(struct bed *bed, int which, struct build_input *input)
{
    const struct build_context context = {.memory = &bed->memory, .parallel = &parallel_serial};
    const struct limits limits = limits_default();
    struct canonical canonical;
    struct build_stats stats;
    struct bvhd_error error = {0};
    input->flags = BUILD_MOTION | BUILD_ALLOW_DATA_ACCESS;
    input->geometry_count = 1;
    input->options = (struct build_options){.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE};
    if (prepare(input, 0, &limits, &context, &canonical, &error) != BVHD_OK ||
        build(&canonical, &input->options, &context, &bed->blobs[which], &stats, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    bed->sizes[which] = stats.sizes.total;
    prepare_finish(&canonical, &bed->memory);
}

static struct bvhd_cpu_scene *open_scene(const struct bed *bed, uint32_t count)
{
    const struct bvhd_cpu_blob blobs[2] = {{bed->blobs[0], bed->sizes[0]}, {bed->blobs[1], bed->sizes[1]}};
    const struct bvhd_cpu_scene_options options = {.struct_size = sizeof options, .blobs = blobs, .blob_count = count};
    struct bvhd_cpu_scene *scene;
    struct bvhd_error error;
    if (bvhd_cpu_scene_create(&options, &scene, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    return scene;
}

static void bed_start(struct bed *bed)
{
    static const struct reference reference = {.kind = REFERENCE_BLAS, .handle = 5, .bounds = {{0, 0, 0}, {10, 10, 0}}};
    struct geometry triangles = {
        .type = GEOMETRY_MOVING_TRIANGLES,
        .triangles = {.vertex_format = 106,
                      .max_vertex = 5,
                      .vertex_stride = 12,
                      .index_type = INDEX_NONE,
                      .vertices = {(const unsigned char *)start_vertices, sizeof start_vertices},
                      .end_vertices = {(const unsigned char *)end_vertices, sizeof end_vertices}},
        .range.primitive_count = 2,
    };
    union {
        uint32_t words[40];
        float numbers[40];
    } record = {.words = {MOTION_MATRIX}};
    for (int key = 0; key < 2; key++) {
        for (int i = 0; i < 3; i++)
            record.numbers[2 + 12 * key + 5 * i] = 1;
        record.numbers[2 + 12 * key + 11] = key ? 16 : 0;
    }
    record.words[MATRIX_RECORD - 4] = 0xff000000;
    record.words[MATRIX_RECORD - 2] = 5;
    struct geometry instances = {
        .type = GEOMETRY_MOVING_INSTANCES,
        .instances = {.records = {(const unsigned char *)record.words, sizeof record.words}},
        .range.primitive_count = 1,
    };
    struct build_input bottom = {.type = STRUCTURE_BOTTOM, .geometries = &triangles}, top = {.type = STRUCTURE_TOP,
                                                                                             .geometries = &instances,
                                                                                             .reference_count = 1,
                                                                                             .references = &reference};
    memory_init(&bed->memory, UINT64_MAX);
    make(bed, 0, &bottom);
    make(bed, 1, &top);
    bed->alone = open_scene(bed, 1);
    bed->instanced = open_scene(bed, 2);
}

static void bed_finish(struct bed *bed)
{
    bvhd_cpu_scene_destroy(bed->alone);
    bvhd_cpu_scene_destroy(bed->instanced);
    for (int i = 0; i < 2; i++)
        memory_free(&bed->memory, bed->blobs[i]);
}

/* Traces a ray along -z from above a place. */
static struct bvhd_cpu_hit trace_down(const struct bvhd_cpu_scene *scene, float x, float y, float time, size_t ray_size,
                                      bvhd_cpu_candidate_function candidate, void *context)
{
    const struct bvhd_cpu_ray ray = {
        .origin = {x, y, 20}, .direction = {0, 0, -1}, .tmax = 100, .mask = 0xff, .time = time};
    struct bvhd_cpu_hit hit;
    const struct bvhd_cpu_trace trace = {.struct_size = sizeof trace,
                                         .rays = &ray,
                                         .ray_size = ray_size,
                                         .hits = &hit,
                                         .hit_size = sizeof hit,
                                         .ray_count = 1,
                                         .candidate = candidate,
                                         .context = context};
    assert_int_equal(bvhd_cpu_scene_trace(scene, &trace, NULL), BVHD_OK);
    return hit;
}

static void test_times(void **state)
{
    (void)state;
    struct bed bed;
    bed_start(&bed);
    for (int x = 0; x < 10; x++)
        for (int step = 0; step <= 8; step++) {
            const float time = (float)step / 8;
            struct bvhd_cpu_hit hit = trace_down(bed.alone, (float)x + 0.5f, 0.5f, time, 48, NULL, NULL);
            assert_int_equal(hit.blob, x == step ? 0 : BVHD_CPU_NO_BLOB);
            hit = trace_down(bed.instanced, (float)x + 0.5f, 0.5f, time, 48, NULL, NULL);
            assert_int_equal(hit.blob, x == step ? 0 : BVHD_CPU_NO_BLOB);
            if (x == step)
                assert_true(hit.t == 20 - 16 * time && hit.instance == 0 && hit.primitive == 0);
            hit = trace_down(bed.alone, 0.5f, 8.5f, time, 48, NULL, NULL);
            assert_true(hit.blob == 0 && hit.primitive == 1 && hit.t == 20);
            /* A ray without a time has the time 0. */
            hit = trace_down(bed.alone, (float)x + 0.5f, 0.5f, time, 40, NULL, NULL);
            assert_int_equal(hit.blob, x == 0 ? 0 : BVHD_CPU_NO_BLOB);
        }
    bed_finish(&bed);
}

static void test_corners(void **state)
{
    (void)state;
    struct bed bed;
    struct bvhd_error error;
    float corners[3][3];
    bed_start(&bed);
    const struct bvhd_cpu_hit hit = trace_down(bed.alone, 2.5f, 0.5f, 0.25f, 48, NULL, NULL);
    assert_int_equal(bvhd_cpu_scene_corners_at(bed.alone, &hit, 0.25f, corners, NULL), BVHD_OK);
    for (int k = 0; k < 3; k++) {
        assert_true(corners[k][0] == start_vertices[k][0] + 2);
        assert_true(corners[k][1] == start_vertices[k][1] && corners[k][2] == 0);
    }
    assert_int_equal(bvhd_cpu_scene_corners(bed.alone, &hit, corners, &error), BVHD_INVALID);
    assert_string_equal(error.where, "hit.record");
    float positions[3][3];
    const uint32_t geometry = hit.geometry, primitive = hit.primitive;
    assert_int_equal(bvhd_cpu_scene_positions_at(bed.alone, 0, geometry, primitive, 0.25f, positions, NULL), BVHD_OK);
    assert_memory_equal(positions, corners, sizeof corners);
    assert_int_equal(bvhd_cpu_scene_positions_at(bed.alone, 0, geometry, primitive, 1, positions, NULL), BVHD_OK);
    assert_true(positions[0][0] == end_vertices[3 * primitive][0]);
    assert_int_equal(bvhd_cpu_scene_positions(bed.alone, 0, geometry, primitive, positions, &error), BVHD_INVALID);
    assert_string_equal(error.where, "geometry");
    assert_int_equal(bvhd_cpu_scene_positions_at(bed.alone, 0, geometry, primitive, 1.5f, positions, &error),
                     BVHD_INVALID);
    assert_string_equal(error.where, "time");
    assert_int_equal(bvhd_cpu_scene_corners_at(bed.alone, &hit, -1, corners, &error), BVHD_INVALID);
    assert_string_equal(error.where, "time");
    bed_finish(&bed);
}

static uint32_t look(void *context, struct bvhd_cpu_candidate *candidate)
{
    float *height = context;
    *height = candidate->object_to_world[11];
    assert_true(candidate->world_to_object[11] == -*height && candidate->object_origin[2] == 20 - *height);
    return BVHD_CPU_CONFIRM;
}

static void test_transforms(void **state)
{
    (void)state;
    struct bed bed;
    struct bvhd_error error;
    float matrix[12], height = -1;
    bed_start(&bed);
    const struct bvhd_cpu_hit hit = trace_down(bed.instanced, 4.5f, 0.5f, 0.5f, 48, look, &height);
    assert_int_equal(hit.blob, 0);
    assert_true(height == 8);
    assert_int_equal(bvhd_cpu_scene_object_to_world_at(bed.instanced, &hit, 0.75f, matrix, NULL), BVHD_OK);
    for (int i = 0; i < 12; i++)
        assert_true(matrix[i] == (i == 11 ? 12 : i % 5 == 0));
    assert_int_equal(bvhd_cpu_scene_object_to_world(bed.instanced, &hit, matrix, &error), BVHD_INVALID);
    assert_string_equal(error.where, "hit.instance_record");
    assert_int_equal(bvhd_cpu_scene_object_to_world_at(bed.alone, &hit, 0, matrix, NULL), BVHD_OK);
    bed_finish(&bed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_times),
        cmocka_unit_test(test_corners),
        cmocka_unit_test(test_transforms),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
