/* SPDX-License-Identifier: Apache-2.0 */
/* test_outline.c - tests in long double that slabs hold their structure, and instance boxes their instances. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/build.h"
#include "builder/input/outline.h"
#include "builder/input/prepare.h"
#include "builder/input/primitive.h"
#include "tests/support/random.h"
#include "builder/workers.h"

static struct memory memory = {.limit = UINT64_MAX, .fail_after = -1};
static const struct build_context context = {.memory = &memory, .parallel = &parallel_serial};

/* The directions of slabs.h. */
static const int directions[SLABS_COUNT][3] = {{1, 1, 0},  {0, 1, 1},  {1, 0, 1},  {1, -1, 0}, {0, 1, -1},
                                               {-1, 0, 1}, {1, 1, -1}, {-1, 1, 1}, {1, -1, 1}, {1, 1, 1}};

static struct canonical_geometry vertices_of(const float *positions, uint32_t count)
{
    return (struct canonical_geometry){
        .type = GEOMETRY_TRIANGLES, .primitive_count = count / 3, .vertex_count = count, .positions = positions};
}

static struct canonical bottom_of(struct canonical_geometry *geometries, uint32_t count)
{
    struct canonical canonical = {.type = STRUCTURE_BOTTOM, .geometry_count = count, .geometries = geometries};
    for (uint32_t i = 0; i < count; i++) {
        geometries[i].first_primitive = canonical.primitive_count;
        geometries[i].first_vertex = canonical.vertex_count;
        canonical.primitive_count += geometries[i].primitive_count;
        canonical.vertex_count += geometries[i].vertex_count;
    }
    return canonical;
}

static struct slabs find_of(const float *positions, uint32_t count)
{
    struct canonical_geometry geometry = vertices_of(positions, count);
    struct canonical canonical = bottom_of(&geometry, 1);
    struct slabs slabs;
    memset(&slabs, 0xee, sizeof slabs);
    assert_true(outline_find(&canonical, &context, &slabs));
    return slabs;
}

static long double along(const int direction[3], const float point[3])
{
    return (long double)direction[0] * point[0] + (long double)direction[1] * point[1] +
           (long double)direction[2] * point[2];
}

/*
 * Makes points whose magnitudes span over a hundred binary orders, on any side of the origin; the points are sometimes
 * flat along an axis.
 */
static void random_points(struct random *random, float *ret_positions, uint32_t count)
{
    double centre[3], size[3];
    for (int axis = 0; axis < 3; axis++) {
        centre[axis] = random_between(random, -1, 1) * exp2(random_between(random, -60, 60));
        size[axis] = random_next(random) % 5 ? exp2(random_between(random, -60, 60)) : 0;
    }
    for (uint32_t i = 0; i < count; i++)
        for (int axis = 0; axis < 3; axis++)
            ret_positions[3 * i + (uint32_t)axis] = (float)(centre[axis] + size[axis] * random_between(random, -1, 1));
}

static void slabs_hold_all_vertices(void **state)
{
    (void)state;
    struct random random = {1};
    for (int round = 0; round < 3000; round++) {
        float positions[3 * 30];
        uint32_t count = 3 + (uint32_t)(random_next(&random) % 28);
        random_points(&random, positions, count);
        struct slabs slabs = find_of(positions, count);
        assert_true(slabs_are_known(&slabs) && slabs_are_valid(&slabs));
        for (int k = 0; k < SLABS_COUNT; k++) {
            long double low = INFINITY, high = -INFINITY, size = 0;
            for (uint32_t i = 0; i < count; i++) {
                long double at = along(directions[k], positions + (size_t)3 * i);
                low = at < low ? at : low;
                high = at > high ? at : high;
                for (int axis = 0; axis < 3; axis++)
                    size = fmaxl(size, fabsl((long double)positions[3 * i + (uint32_t)axis]));
            }
            assert_true(slabs.min[k] <= low && slabs.max[k] >= high);
            assert_true(low - slabs.min[k] <= size * 0x1p-20L && slabs.max[k] - high <= size * 0x1p-20L);
        }
    }
}

/* Spheres reach as far from their centres along a direction as its length says; a NaN adds nothing. */
static void slabs_hold_all_spheres(void **state)
{
    (void)state;
    struct random random = {11};
    static uint32_t starts[30];
    for (int round = 0; round < 3000; round++) {
        float positions[3 * 30], spheres[4 * 30];
        const uint32_t count = 2 + (uint32_t)(random_next(&random) % 28);
        const int exponent = (int)(random_next(&random) % 120) - 60;
        random_points(&random, positions, count);
        for (uint32_t i = 0; i < count; i++) {
            memcpy(spheres + (size_t)4 * i, positions + (size_t)3 * i, 12);
            spheres[4 * i + 3] = random_next(&random) % 4 ? ldexpf((float)random_between(&random, 0, 1), exponent) : 0;
            starts[i] = i;
        }
        if (count > 4)
            spheres[4 * 3 + random_next(&random) % 4] = NAN;
        struct canonical_geometry geometry = {
            .type = GEOMETRY_SPHERES, .primitive_count = count, .vertex_count = count, .positions = spheres};
        if (round % 2) {
            geometry.type = GEOMETRY_SWEPT_SPHERES;
            geometry.primitive_count = count - 1;
            geometry.indices = starts;
        }
        struct canonical canonical = bottom_of(&geometry, 1);
        struct slabs slabs;
        assert_true(outline_find(&canonical, &context, &slabs));
        assert_true(slabs_are_known(&slabs) && slabs_are_valid(&slabs));
        for (int k = 0; k < SLABS_COUNT; k++) {
            long double low = INFINITY, high = -INFINITY, size = 0;
            const long double length = sqrtl(k < 6 ? 2 : 3);
            for (uint32_t i = 0; i < count; i++) {
                const float *sphere = spheres + (size_t)4 * i;
                if (count > 4 && i == 3)
                    continue;
                const long double at = along(directions[k], sphere);
                low = fminl(low, at - sphere[3] * length);
                high = fmaxl(high, at + sphere[3] * length);
                for (int axis = 0; axis < 4; axis++)
                    size = fmaxl(size, fabsl((long double)sphere[axis]));
            }
            assert_true(slabs.min[k] <= low && slabs.max[k] >= high);
            assert_true(low - slabs.min[k] <= size * 0x1p-16L && slabs.max[k] - high <= size * 0x1p-16L);
        }
    }
}

/* Slabs stay unknown when there is nothing, or when values overflow. */
static void what_does_not_fit_is_not_known(void **state)
{
    (void)state;
    float positions[12] = {1, 2, 3, 4, 5, 6, 7, 8, 10, 3e38f, -3e38f, 1};
    static const struct slabs none;
    struct slabs slabs = find_of(positions, 3), other;
    assert_true(slabs_are_known(&slabs));
    other = find_of(positions, 4);
    assert_memory_equal(&other, &none, sizeof none);
    positions[9] = INFINITY;
    other = find_of(positions, 4);
    assert_memory_equal(&other, &none, sizeof none);
    positions[9] = positions[10] = positions[11] = NAN; /* no triangle with this corner can be hit */
    other = find_of(positions, 4);
    assert_memory_equal(&other, &slabs, sizeof slabs);
    for (int i = 0; i < 9; i++)
        positions[i] = NAN;
    other = find_of(positions, 4);
    assert_memory_equal(&other, &none, sizeof none);
    other = find_of(positions, 0);
    assert_memory_equal(&other, &none, sizeof none);
    struct canonical canonical = {.type = STRUCTURE_BOTTOM};
    assert_true(outline_find(&canonical, &context, &other));
    assert_memory_equal(&other, &none, sizeof none);
}

/* The slabs of a box are those of its eight corners. */
static void slabs_of_boxes_are_those_of_their_corners(void **state)
{
    (void)state;
    enum { BOXES = 50 };
    struct random random = {2};
    for (int round = 0; round < 200; round++) {
        float points[6 * BOXES], boxes[6 * BOXES], corners[3 * 8 * BOXES];
        uint32_t count = 1 + (uint32_t)(random_next(&random) % BOXES),
                 inactive = count > 1 ? (uint32_t)(random_next(&random) % count) : count;
        random_points(&random, points, 2 * count);
        uint32_t made = 0;
        for (uint32_t i = 0; i < count; i++) {
            for (uint32_t axis = 0; axis < 3; axis++) {
                boxes[6 * i + axis] = fminf(points[6 * i + axis], points[6 * i + 3 + axis]);
                boxes[6 * i + 3 + axis] = fmaxf(points[6 * i + axis], points[6 * i + 3 + axis]);
            }
            for (uint32_t corner = 0; corner < 8 && i != inactive; corner++, made++)
                for (uint32_t axis = 0; axis < 3; axis++)
                    corners[3 * made + axis] = boxes[6 * i + axis + 3 * (corner >> axis & 1)];
            if (i == inactive)
                boxes[6 * i] = NAN;
        }
        struct canonical_geometry geometry = {.type = GEOMETRY_AABBS, .primitive_count = count, .boxes = boxes};
        struct canonical canonical = bottom_of(&geometry, 1);
        struct slabs slabs, want = find_of(corners, made);
        assert_true(outline_find(&canonical, &context, &slabs));
        assert_memory_equal(&slabs, &want, sizeof want);
    }
}

/* Many geometries, some of them empty, are divided among any number of threads. */
static void threads_do_not_matter(void **state)
{
    (void)state;
    enum { GEOMETRIES = 700, COUNT = 2000000 };
    static struct canonical_geometry geometries[GEOMETRIES];
    struct random random = {3};
    float *positions = malloc((size_t)3 * COUNT * sizeof *positions);
    assert_non_null(positions);
    for (size_t i = 0; i < (size_t)3 * COUNT; i++)
        positions[i] = (float)random_between(&random, -5, 7);
    uint32_t at = 0;
    for (uint32_t i = 0; i < GEOMETRIES; i++) {
        uint32_t count = i % 7 == 3 ? 0 : i + 1 < GEOMETRIES ? (uint32_t)(random_next(&random) % 5000) : COUNT - at;
        geometries[i] = vertices_of(positions + (size_t)3 * at, count);
        at += count;
    }
    struct canonical canonical = bottom_of(geometries, GEOMETRIES);
    struct slabs want = find_of(positions, COUNT), slabs;
    assert_true(outline_find(&canonical, &context, &slabs));
    assert_memory_equal(&slabs, &want, sizeof want);
    struct workers *workers;
    assert_int_equal(workers_create(4, &workers, NULL), BVHD_OK);
    const struct build_context several = {.memory = &memory, .parallel = workers_parallel(workers)};
    assert_true(outline_find(&canonical, &several, &slabs));
    assert_memory_equal(&slabs, &want, sizeof want);
    atomic_bool cancel = true;
    const struct build_context cancelled = {
        .memory = &memory, .parallel = workers_parallel(workers), .cancel = &cancel};
    assert_false(outline_find(&canonical, &cancelled, &slabs));
    workers_destroy(workers);
    free(positions);
}

struct top {
    unsigned char record[64];
    struct canonical_reference reference;
    struct canonical_geometry geometry;
    struct canonical canonical;
};

/* Returns the box of an instance as the builders get it. */
static struct box box_of(struct top *top, const float matrix[12], const struct box *bounds, const struct slabs *slabs)
{
    memset(top, 0, sizeof *top);
    memcpy(top->record, matrix, 48);
    top->record[56] = 1;
    top->reference = (struct canonical_reference){.kind = REFERENCE_BLAS, .bounds = *bounds};
    if (slabs)
        top->reference.slabs = *slabs;
    top->geometry =
        (struct canonical_geometry){.type = GEOMETRY_INSTANCES, .primitive_count = 1, .instances = top->record};
    top->canonical = (struct canonical){.type = STRUCTURE_TOP,
                                        .geometry_count = 1,
                                        .reference_count = 1,
                                        .primitive_count = 1,
                                        .geometries = &top->geometry,
                                        .references = &top->reference};
    return primitive_box(&top->canonical, &top->geometry, 0);
}

/* Makes a rotating, shearing, mirroring or flattening matrix, or one along the axes. */
static void random_matrix(struct random *random, float ret_matrix[12])
{
    for (int k = 0; k < 12; k++) {
        double size = random_next(random) % 3 ? 1 : exp2(random_between(random, -60, 60));
        ret_matrix[k] = random_next(random) % 5 ? (float)(random_between(random, -1, 1) * size) : k % 2 ? 0.0f : -0.0f;
    }
    for (int k = 0; k < 12; k += 4)
        if (random_next(random) % 4 == 0) /* along one of the slabs' directions */
            for (int axis = 0; axis < 3; axis++)
                ret_matrix[k + axis] = (float)((int)(random_next(random) % 3) - 1) * fabsf(ret_matrix[k]);
}

static long double moved(const float row[4], const float point[3])
{
    return (long double)row[0] * point[0] + (long double)row[1] * point[1] + (long double)row[2] * point[2] + row[3];
}

static void boxes_of_instances_hold_all_vertices(void **state)
{
    (void)state;
    struct random random = {4};
    struct top top;
    for (int round = 0; round < 20000; round++) {
        float positions[3 * 12], matrix[12];
        uint32_t count = 3 + (uint32_t)(random_next(&random) % 10);
        random_points(&random, positions, count);
        random_matrix(&random, matrix);
        struct slabs slabs = find_of(positions, count);
        struct box bounds = box_empty();
        for (uint32_t i = 0; i < count; i++)
            box_add_point(&bounds, positions + (size_t)3 * i);
        struct box loose = box_of(&top, matrix, &bounds, NULL), box = box_of(&top, matrix, &bounds, &slabs);
        assert_true(box_contains(&loose, &box));
        for (uint32_t i = 0; i < count; i++)
            for (int axis = 0; axis < 3; axis++) {
                long double at = moved(matrix + 4 * axis, positions + (size_t)3 * i);
                assert_true(box.min[axis] <= at && at <= box.max[axis]);
            }
    }
}

static float clamped(double value)
{
    return value > FLT_MAX ? FLT_MAX : value < -FLT_MAX ? -FLT_MAX : (float)value;
}

/* Instance boxes hold for denormals, and for points beyond the largest float, to which boxes are clamped. */
static void boxes_hold_at_any_magnitude(void **state)
{
    (void)state;
    enum { COUNT = 9 };
    struct random random = {7};
    struct top top;
    for (int round = 0; round < 20000; round++) {
        float positions[3 * COUNT], matrix[12];
        struct box bounds = box_empty();
        bool is_huge = random_next(&random) % 2;
        double low = is_huge ? 90 : -149, high = is_huge ? 126 : -100;
        for (int i = 0; i < 3 * COUNT; i++)
            positions[i] = (float)(random_between(&random, -1, 1) * exp2(random_between(&random, low, high)));
        for (int k = 0; k < 12; k++)
            matrix[k] = clamped(random_between(&random, -1, 1) * exp2(random_between(&random, -149, 128)));
        for (uint32_t i = 0; i < COUNT; i++)
            box_add_point(&bounds, positions + (size_t)3 * i);
        struct slabs slabs = find_of(positions, COUNT);
        struct box box = box_of(&top, matrix, &bounds, &slabs);
        for (uint32_t i = 0; i < 3 * COUNT; i++) {
            long double at = moved(matrix + i % 3 * 4, positions + i / 3 * 3);
            at = fmaxl(fminl(at, FLT_MAX), -FLT_MAX);
            assert_true(box.min[i % 3] <= at && at <= box.max[i % 3]);
        }
    }
}

/* An octahedron fills a sixth of its bounds; rotated by 45 degrees its box is half as wide as that of its bounds. */
static void boxes_of_turned_instances_are_small(void **state)
{
    (void)state;
    static const float positions[18] = {1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1};
    const struct box bounds = {{-1, -1, -1}, {1, 1, 1}};
    const float half = 0.70710678f;
    const float matrix[12] = {half, -half, 0, 5, half, half, 0, 6, 0, 0, -1, 7};
    struct slabs slabs = find_of(positions, 6);
    struct top top;
    struct box loose = box_of(&top, matrix, &bounds, NULL), box = box_of(&top, matrix, &bounds, &slabs);
    assert_true(loose.max[0] > 6.414f && loose.min[1] < 4.586f);
    assert_true(box.max[0] < 5.7072f && box.min[0] > 4.2928f && box.max[1] < 6.7072f && box.min[1] > 5.2928f);
    assert_true(box.min[2] >= 5.9999f && box.max[2] <= 8.0001f);
}

/* A caller may describe a reference wrongly: the result is then wrong, but the boxes stay valid. */
static void contradictions_leave_a_box(void **state)
{
    (void)state;
    struct random random = {5};
    struct top top;
    for (int round = 0; round < 20000; round++) {
        float matrix[12];
        struct slabs slabs;
        struct box bounds = {{-1, -1, -1}, {1, 1, 1}};
        random_matrix(&random, matrix);
        for (int i = 0; i < SLABS_COUNT; i++) {
            slabs.min[i] = (float)(random_between(&random, -1, 1) * exp2(random_between(&random, -126, 127)));
            slabs.max[i] =
                random_next(&random) % 4 ? fmaxf(slabs.min[i], (float)random_between(&random, -9, 9)) : FLT_MAX;
        }
        struct box loose = box_of(&top, matrix, &bounds, NULL), box = box_of(&top, matrix, &bounds, &slabs);
        assert_true(!box_is_empty(&box) && box_contains(&loose, &box));
    }
}

enum { TREES = 200 };

static uint64_t build_forest(const struct slabs *slabs, enum target target, unsigned char **ret_blob, double *ret_sah)
{
    struct random random = {6};
    static unsigned char records[TREES][64];
    for (uint32_t i = 0; i < TREES; i++) {
        double angle = random_between(&random, -3, 3);
        float c = (float)cos(angle), s = (float)sin(angle),
              at[2] = {(float)random_between(&random, 0, 30), (float)random_between(&random, 0, 30)};
        const float matrix[12] = {c, -s, 0, at[0], s, c, 0, at[1], 0, 0, 1, 0};
        memset(records[i], 0, 64);
        memcpy(records[i], matrix, sizeof matrix);
        records[i][51] = 0xff;
        records[i][56] = 9;
    }
    struct geometry geometry = {
        .type = GEOMETRY_INSTANCES, .instances = {{records[0], sizeof records}}, .range = {.primitive_count = TREES}};
    struct reference reference = {.kind = REFERENCE_BLAS, .handle = 9, .bounds = {{-1, -1, -1}, {1, 1, 1}}};
    if (slabs)
        reference.slabs = *slabs;
    struct build_input input = {.type = STRUCTURE_TOP,
                                .geometry_count = 1,
                                .geometries = &geometry,
                                .reference_count = 1,
                                .references = &reference,
                                .options = {.target = target, .device.variant = target == TARGET_LAVAPIPE}};
    struct limits limits = limits_default();
    struct canonical canonical;
    struct build_stats stats;
    assert_int_equal(prepare(&input, 0, &limits, &context, &canonical, NULL), BVHD_OK);
    assert_int_equal(build(&canonical, &input.options, &context, ret_blob, &stats, NULL), BVHD_OK);
    prepare_finish(&canonical, &memory);
    assert_false(slabs_are_known(&stats.slabs)); /* no instance can name a top level */
    *ret_sah = stats.sah;
    return stats.sizes.total;
}

/*
 * The build of a bottom level returns its slabs. They make portable top levels better; native ones do not change,
 * because the driver needs its own boxes.
 */
static void builds_find_and_use_slabs(void **state)
{
    (void)state;
    static const float positions[18] = {1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1};
    struct canonical_geometry geometry = vertices_of(positions, 6);
    struct canonical canonical = bottom_of(&geometry, 1);
    struct slabs slabs = find_of(positions, 6);
    struct build_options options = {.target = TARGET_PORTABLE};
    struct build_stats stats;
    unsigned char *blob, *plain;
    double sah, plain_sah;
    assert_int_equal(build(&canonical, &options, &context, &blob, &stats, NULL), BVHD_OK);
    assert_memory_equal(&stats.slabs, &slabs, sizeof slabs);
    memory_free(&memory, blob);

    build_forest(NULL, TARGET_PORTABLE, &plain, &plain_sah);
    build_forest(&slabs, TARGET_PORTABLE, &blob, &sah);
    assert_true(sah < 0.9 * plain_sah);
    memory_free(&memory, blob);
    memory_free(&memory, plain);

    uint64_t plain_size = build_forest(NULL, TARGET_LAVAPIPE, &plain, &plain_sah),
             size = build_forest(&slabs, TARGET_LAVAPIPE, &blob, &sah);
    assert_int_equal(size, plain_size);
    assert_memory_equal(blob, plain, size);
    memory_free(&memory, blob);
    memory_free(&memory, plain);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slabs_hold_all_vertices),        cmocka_unit_test(slabs_hold_all_spheres),
        cmocka_unit_test(what_does_not_fit_is_not_known), cmocka_unit_test(slabs_of_boxes_are_those_of_their_corners),
        cmocka_unit_test(threads_do_not_matter),          cmocka_unit_test(boxes_of_instances_hold_all_vertices),
        cmocka_unit_test(boxes_hold_at_any_magnitude),    cmocka_unit_test(boxes_of_turned_instances_are_small),
        cmocka_unit_test(contradictions_leave_a_box),     cmocka_unit_test(builds_find_and_use_slabs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
