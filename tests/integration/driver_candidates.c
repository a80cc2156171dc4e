/* SPDX-License-Identifier: Apache-2.0 */
/*
 * driver_candidates.c - tests which candidates a driver reports for our structures with split references, in the loop
 * of a ray query. Vulkan allows a primitive to be reported twice, unless its geometry has NO_DUPLICATE_ANY_HIT; with
 * the flag it is never reported twice, and no primitive is missing in either case. Skipped (77) where no device loads
 * our structures.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/driver/driver_scene.h"
#include "tests/support/driver/gpu_bed.h"
#include "builder/format/lavapipe.h"
#include "builder/input/prepare.h"
#include "tests/support/driver/query_bed.h"
#include "tests/support/random.h"

#define MUST(call) driver_scene_must((call), &error)

enum { TRIANGLES = 2000, RAYS = 4000, LISTED = 160 };

static struct memory memory;
static struct gpu *gpu;
static struct bvhd_format format;

/* Long, thin triangles across the scene, in all directions, which spatial splits are made for. */
static void make_needles(float *corners)
{
    struct random random = {11};
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        double from[3], to[3], aside[3];
        random_point(&random, from);
        random_point(&random, to);
        random_point(&random, aside);
        for (int axis = 0; axis < 3; axis++) {
            corners[9 * i + (uint32_t)axis] = (float)from[axis];
            corners[9 * i + 3 + (uint32_t)axis] = (float)to[axis];
            corners[9 * i + 6 + (uint32_t)axis] = (float)(to[axis] + 0.05 * aside[axis]);
        }
    }
}

static void prepare_input(const struct build_input *input, struct canonical *ret_canonical)
{
    struct bvhd_error error;
    struct limits limits = limits_default();
    struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    MUST(prepare(input, 0, &limits, &context, ret_canonical, &error));
}

static void prepare_bottom(const float *corners, uint32_t flags, struct canonical *ret_canonical)
{
    const struct geometry geometry = {.type = GEOMETRY_TRIANGLES,
                                      .flags = flags,
                                      .triangles = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                                                    .max_vertex = 3 * TRIANGLES - 1,
                                                    .vertex_stride = 12,
                                                    .index_type = INDEX_NONE,
                                                    .vertices = {(const unsigned char *)corners, 36 * TRIANGLES}},
                                      .range.primitive_count = TRIANGLES};
    const struct build_input input = {
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .geometries = &geometry, .options.target = TARGET_PORTABLE};
    prepare_input(&input, ret_canonical);
}

static void prepare_top(struct canonical *ret_canonical)
{
    static const VkAccelerationStructureInstanceKHR instance = {
        .transform = {.matrix = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}}},
        .mask = 0xff,
        .accelerationStructureReference = 1};
    struct reference reference = {
        .kind = REFERENCE_BLAS, .handle = 1, .has_key = true, .bounds = {{-1.1f, -1.1f, -1.1f}, {1.1f, 1.1f, 1.1f}}};
    const uint64_t number = 1;
    memcpy(&reference.key, &number, sizeof number);
    const struct geometry geometry = {.type = GEOMETRY_INSTANCES,
                                      .instances = {{(const unsigned char *)&instance, sizeof instance}},
                                      .range.primitive_count = 1};
    const struct build_input input = {.type = STRUCTURE_TOP,
                                      .geometry_count = 1,
                                      .geometries = &geometry,
                                      .reference_count = 1,
                                      .references = &reference,
                                      .options.target = TARGET_PORTABLE};
    prepare_input(&input, ret_canonical);
}

static struct ray *make_rays(void)
{
    struct random random = {5};
    struct ray *rays = calloc(RAYS, sizeof *rays);
    assert_non_null(rays);
    for (uint32_t i = 0; i < RAYS; i++) {
        double from[3], to[3];
        random_point(&random, from);
        random_point(&random, to);
        rays[i] = (struct ray){.tmax = 1e30f, .flags = RAY_NO_OPAQUE, .cull_mask = 0xff};
        for (int axis = 0; axis < 3; axis++) {
            rays[i].origin[axis] = (float)(from[axis] * 3);
            rays[i].direction[axis] = (float)(to[axis] - from[axis] * 3);
        }
    }
    return rays;
}

struct count {
    uint64_t reported,
        different; /* candidates of all rays, and how many of them are different primitives of their ray */
    uint64_t missing; /* candidates of the driver's own structure that ours does not have */
};

static bool is_among(const struct query_id *ids, uint32_t count, uint32_t primitive)
{
    for (uint32_t i = 0; i < count; i++)
        if (ids[i].primitive == primitive)
            return true;
    return false;
}

static void count_ray(const struct query_id *ours, uint32_t our_count, const struct query_id *theirs,
                      uint32_t their_count, struct count *count)
{
    assert_true(our_count <= LISTED && their_count <= LISTED);
    count->reported += our_count;
    for (uint32_t i = 0; i < our_count; i++)
        count->different += !is_among(ours, i, ours[i].primitive);
    for (uint32_t i = 0; i < their_count; i++)
        count->missing += !is_among(ours, our_count, theirs[i].primitive);
}

static struct count count_candidates(const struct driver_scene *scene)
{
    struct query_bed *bed = query_bed_create(gpu);
    struct ray *rays = make_rays();
    struct query_answer *ours = calloc(RAYS, sizeof *ours), *theirs = calloc(RAYS, sizeof *theirs);
    struct query_id *our_ids = calloc((size_t)RAYS * LISTED, sizeof *our_ids),
                    *their_ids = calloc((size_t)RAYS * LISTED, sizeof *their_ids);
    struct query_work work = {
        .top = driver_scene_our_top(scene), .rays = rays, .count = RAYS, .policy = QUERY_IGNORE, .listed = LISTED};
    struct count count = {0};
    query_bed_trace(bed, &work, ours, our_ids);
    work.top = scene->top.handle;
    query_bed_trace(bed, &work, theirs, their_ids);
    for (uint32_t i = 0; i < RAYS; i++)
        count_ray(our_ids + (size_t)i * LISTED, ours[i].candidates, their_ids + (size_t)i * LISTED,
                  theirs[i].candidates, &count);
    query_bed_destroy(bed);
    free(their_ids);
    free(our_ids);
    free(theirs);
    free(ours);
    free(rays);
    return count;
}

/* Counts the references to leaves. There are more than triangles only where references were split. */
static uint32_t count_references(const struct bvhd_vulkan_bytes *blob)
{
    struct bvhd_error error;
    struct lavapipe_view view;
    uint32_t count = 0;
    MUST(lavapipe_open_any((struct bytes){blob->data, blob->size}, &memory, &view, &error));
    for (uint32_t at = LAVAPIPE_HEADER; at + sizeof(struct lavapipe_box) <= view.leaf_offset;
         at += sizeof(struct lavapipe_box)) {
        struct lavapipe_box box = lavapipe_box_at(&view, at);
        for (int c = 0; c < 2; c++)
            count +=
                box.children[c] != LAVAPIPE_NONE && (box.children[c] & 3) == LAVAPIPE_TRIANGLE && box.children[c] != 0;
    }
    return count;
}

static struct count count_of(enum build_quality quality, uint32_t flags, uint32_t *ret_references)
{
    float *corners = malloc(9 * TRIANGLES * sizeof *corners);
    struct canonical bottom, top;
    struct driver_scene scene;
    make_needles(corners);
    prepare_bottom(corners, flags, &bottom);
    prepare_top(&top);
    const struct driver_scene_options options = {.gpu = gpu,
                                                 .format = &format,
                                                 .bottoms = &bottom,
                                                 .bottom_count = 1,
                                                 .top = &top,
                                                 .quality = quality,
                                                 .parallel = &parallel_serial};
    driver_scene_init(&scene, &options);
    struct count count = count_candidates(&scene);
    *ret_references = count_references(&scene.blobs[0]);
    print_message("%u references to %u triangles: %llu candidates, %llu of them different ones\n", *ret_references,
                  TRIANGLES, (unsigned long long)count.reported, (unsigned long long)count.different);
    driver_scene_finish(&scene);
    prepare_finish(&top, &memory);
    prepare_finish(&bottom, &memory);
    free(corners);
    return count;
}

static void split_references_report_twice(void **state)
{
    (void)state;
    uint32_t references;
    struct count count = count_of(QUALITY_HIGH, 0, &references);
    assert_true(references > TRIANGLES);
    assert_true(count.reported > count.different);
    assert_true(count.different > RAYS);
    assert_int_equal(count.missing, 0);
}

static void none_is_reported_twice_where_that_is_forbidden(void **state)
{
    (void)state;
    uint32_t references;
    struct count count = count_of(QUALITY_HIGH, GEOMETRY_NO_DUPLICATE_ANY_HIT, &references);
    assert_int_equal(references, TRIANGLES);
    assert_int_equal(count.reported, count.different);
    assert_true(count.different > RAYS);
    assert_int_equal(count.missing, 0);
}

static void without_splits_there_is_nothing_to_repeat(void **state)
{
    (void)state;
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_BALANCED; quality++) {
        uint32_t references;
        struct count count = count_of(quality, 0, &references);
        assert_int_equal(references, TRIANGLES);
        assert_int_equal(count.reported, count.different);
        assert_int_equal(count.missing, 0);
    }
}

int main(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(split_references_report_twice),
        cmocka_unit_test(none_is_reported_twice_where_that_is_forbidden),
        cmocka_unit_test(without_splits_there_is_nothing_to_repeat),
    };
    memory_init(&memory, UINT64_MAX);
    if (!driver_scene_device(&memory, &gpu, &format))
        return GPU_BED_SKIPPED;
    int failed = cmocka_run_group_tests(tests, NULL, NULL);
    gpu_close(gpu);
    return failed || memory.live || gpu_messages();
}
