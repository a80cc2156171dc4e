/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The kernels for the closest triangle against the traversal on the CPU: each of them, with triangles that leave doubts
 * by the dozen. Skipped without a device.
 */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/build.h"
#include "builder/input/prepare.h"
#include "tests/support/random.h"
#include "client/bvhctl/trace/tracer_closest.h"

enum {
    SKIPPED = 77,
    SCATTERED = 1500,
    COPIES = 60,
    STRIP = 40,
    SLIVERS = 30,
    FIRST_GEOMETRY = 1000,
    TRIANGLES = SCATTERED + COPIES + STRIP + SLIVERS,
    RAYS = 4000,
    FEW = 50,
    EDGES = 2,
    FINE_BYTES = 1 << 24,
    FINE_COPIES = 240
};

static struct memory memory;
static struct gpu *gpu;
static float positions[TRIANGLES * 3][3];
static struct ray rays[RAYS];
static float unit = 1; /* of t */

/* Long and slim, each in a direction of its own: their normals are lost in products of floats. */
static void make_slivers(float (*corners)[3])
{
    struct random random = {13};
    for (int i = 0; i < SLIVERS; i++, corners += 3)
        for (int axis = 0; axis < 3; axis++) {
            float along = (float)random_between(&random, -4, 4);
            corners[0][axis] = (float)random_between(&random, -3, 3);
            corners[1][axis] = corners[0][axis] + along;
            corners[2][axis] = corners[0][axis] + along / 2 + (float)random_between(&random, -2e-3, 2e-3);
        }
}

/* Scattered triangles; one large one many times over; a strip whose triangles share their edges; slivers. */
static void make_triangles(void)
{
    struct random random = {7};
    for (int i = 0; i < SCATTERED * 3; i++)
        for (int axis = 0; axis < 3; axis++)
            positions[i][axis] =
                (float)random_between(&random, -1, 1) + (i % 3 ? positions[i - i % 3][axis] * 0.9f : 0);
    static const float copied[3][3] = {{-3, -3, 2.5f}, {3, -3, 2.5f}, {0, 4, 2.5f}};
    for (int i = 0; i < COPIES; i++)
        memcpy(positions[(SCATTERED + i) * 3], copied, sizeof copied);
    for (int i = 0; i < STRIP; i++)
        for (int k = 0; k < 3; k++) {
            float *corner = positions[(SCATTERED + COPIES + i) * 3 + k];
            corner[0] = (float)((i + k) / 2) * 0.2f - 4;
            corner[1] = (i + k) % 2 ? 1 : -1;
            corner[2] = -3;
        }
    make_slivers(&positions[(SCATTERED + COPIES + STRIP) * 3]);
}

/* From where the ray is to a place within a sliver. */
static void aim_at_sliver(struct ray *ray, int i)
{
    float(*corners)[3] = &positions[(SCATTERED + COPIES + STRIP + i % SLIVERS) * 3];
    for (int axis = 0; axis < 3; axis++)
        ray->direction[axis] =
            (corners[0][axis] * 0.2f + corners[1][axis] * 0.3f + corners[2][axis] * 0.5f) - ray->origin[axis];
}

/*
 * Half of them next to each other and nearly parallel, along edges of the strip too; half of them in all directions,
 * some to slivers.
 */
static void make_rays(void)
{
    struct random random = {11};
    for (int i = 0; i < RAYS; i++) {
        rays[i] = (struct ray){.tmax = i % 9 ? INFINITY : 5, .cull_mask = 0xff};
        bool is_parallel = i < RAYS / 2;
        for (int axis = 0; axis < 3; axis++) {
            rays[i].origin[axis] = is_parallel ? (axis == 2 ? 6 : 0) : (float)random_between(&random, -4, 4);
            rays[i].direction[axis] = (float)random_between(&random, -1, 1);
        }
        if (is_parallel) {
            rays[i].origin[0] = (float)(i % 50) * 0.1f - 4;
            rays[i].origin[1] = (float)(i / 50) * 0.1f - 2;
            rays[i].direction[0] = rays[i].direction[1] = 0;
            rays[i].direction[2] = -1;
        } else if (i % 8 == 0)
            aim_at_sliver(&rays[i], i);
    }
}

static void build_blob(uint32_t layout_flags, struct bytes *ret_blob)
{
    struct bvhd_error error;
    struct canonical canonical;
    struct build_stats stats;
    unsigned char *blob;
    struct limits limits = limits_default();
    struct build_context context = {.memory = &memory, .parallel = &parallel_serial};
    struct geometry geometries[2];
    for (int i = 0; i < 2; i++)
        geometries[i] =
            (struct geometry){.type = GEOMETRY_TRIANGLES,
                              .triangles = {.vertex_format = VK_FORMAT_R32G32B32_SFLOAT,
                                            .max_vertex = TRIANGLES * 3 - 1,
                                            .vertex_stride = 12,
                                            .index_type = INDEX_NONE,
                                            .vertices = {(const unsigned char *)positions, sizeof positions}},
                              .range = {.primitive_count = i ? TRIANGLES - FIRST_GEOMETRY : FIRST_GEOMETRY,
                                        .first_vertex = i ? 3 * FIRST_GEOMETRY : 0}};
    struct build_input input = {
        .type = STRUCTURE_BOTTOM,
        .geometry_count = 2,
        .geometries = geometries,
        .options = {.quality = QUALITY_BALANCED, .target = TARGET_PORTABLE, .layout_flags = layout_flags}};
    assert_int_equal(prepare(&input, 0, &limits, &context, &canonical, &error), BVHD_OK);
    assert_int_equal(build(&canonical, &input.options, &context, &blob, &stats, &error), BVHD_OK);
    prepare_finish(&canonical, &memory);
    *ret_blob = (struct bytes){blob, stats.sizes.total};
}

/* Whose barycentrics are all rounding. */
static bool is_sliver(const struct ray_hit *hit)
{
    return hit->geometry == 1 && hit->primitive >= TRIANGLES - FIRST_GEOMETRY - SLIVERS;
}

/*
 * t to some float ulps, and by whom: where triangles share an edge, or are the same, the CPU and the kernels choose
 * alike. Along an edge that no other triangle shares, a last bit decides.
 */
static unsigned count_differing(const struct scene *scene, const struct tracer_hit *hits, unsigned *ret_hit)
{
    unsigned differing = 0, met = 0;
    for (int i = 0; i < RAYS; i++) {
        struct ray_hit hit;
        bool is_hit = traverse(scene, &rays[i], NULL, &hit, NULL);
        met += is_hit;
        if (!is_hit || isinf(hits[i].t))
            differing += is_hit != !isinf(hits[i].t);
        else
            differing += fabsf(hits[i].t - hit.t) > 2e-5f * hit.t + 1e-6f * unit || hits[i].geometry != hit.geometry ||
                         hits[i].primitive != hit.primitive || (hits[i].flags & 1) != hit.front_face ||
                         (!is_sliver(&hit) && (fabsf(hits[i].u - hit.u) > 1e-3f || fabsf(hits[i].v - hit.v) > 1e-3f));
    }
    *ret_hit = met;
    return differing;
}

/* What the kernel has counted, of the last trace of so many rays. */
static struct counts {
    uint32_t next, left, unsettled, doubts;
} counts_of(const struct tracer *tracer, uint32_t count)
{
    struct counts counts;
    const struct tracer_device *device = (const struct tracer_device *)tracer;
    memcpy(&counts, (const struct tracer_hit *)device->readback.mapped + count, sizeof counts);
    return counts;
}

/* All rays, so many at a time. `ret_sum`: of what has been counted. */
static void trace_in_batches(struct tracer *tracer, enum tracer_way way, const struct scene *scene, uint32_t batch,
                             struct counts *ret_sum)
{
    static struct tracer_hit hits[RAYS];
    struct counts sum = {0};
    unsigned hit;
    tracer_portable_set_way(tracer, way);
    memset(hits, 0x55, sizeof hits);
    for (uint32_t at = 0; at < RAYS; at += batch) {
        assert_int_equal(tracer->trace(tracer, rays + at, batch, hits + at, NULL, NULL), BVHD_OK);
        struct counts counts = counts_of(tracer, batch);
        sum.left += counts.left;
        sum.unsettled += counts.unsettled;
        sum.doubts += counts.doubts;
    }
    unsigned differing = count_differing(scene, hits, &hit);
    if (differing > EDGES || hit < RAYS / 4)
        fail_msg("way %d, %u at a time: %u of %d rays differ, %u hit", way, batch, differing, RAYS, hit);
    *ret_sum = sum;
}

/*
 * Directions so short that steps of boxes would leave floats along axes that a ray hardly moves on: such rays are left
 * to the query.
 */
static void trace_from_afar(struct tracer *tracer, enum tracer_way way, const struct scene *scene)
{
    static struct ray near_rays[RAYS];
    struct counts counts;
    memcpy(near_rays, rays, sizeof rays);
    for (int i = 0; i < RAYS; i++)
        for (int axis = 0; axis < 3; axis++)
            rays[i].direction[axis] *= 0x1p-84f;
    unit = 0x1p84f;
    trace_in_batches(tracer, way, scene, FEW, &counts);
    memcpy(rays, near_rays, sizeof rays);
    unit = 1;
    assert_in_range(counts.left, RAYS / 2, RAYS - 1);
}

/* Of few rays all doubts find room and are decided; of all rays together some are left to the query. */
static void trace_with_doubts(struct tracer *tracer, enum tracer_way way, const struct scene *scene, bool settles)
{
    struct counts counts;
    trace_in_batches(tracer, way, scene, FEW, &counts);
    assert_true(counts.doubts > RAYS && !counts.left);
    assert_int_equal(counts.unsettled != 0, settles);
    trace_in_batches(tracer, way, scene, RAYS, &counts);
    assert_in_range(counts.left, 1, RAYS - 1);
}

static void try_tracer(const struct structures *structures, const struct scene *scene, bool has_whole)
{
    struct tracer *tracer;
    struct counts counts;
    struct bvhd_error error;
    if (tracer_portable_create(gpu, structures, &memory, &tracer, &error))
        fail_msg("%s: %s", error.where, error.text);
    assert_int_equal(((struct tracer_device *)tracer)->choices[0].is_whole, has_whole);
    trace_in_batches(tracer, TRACER_WAY_AUTO, scene, RAYS, &counts);
    trace_in_batches(tracer, TRACER_WAY_QUERY, scene, RAYS, &counts);
    assert_int_equal(counts.doubts, 0);
    trace_with_doubts(tracer, TRACER_WAY_TOGETHER, scene, !has_whole);
    trace_with_doubts(tracer, TRACER_WAY_REFILL, scene, !has_whole);
    trace_from_afar(tracer, TRACER_WAY_TOGETHER, scene);
    trace_from_afar(tracer, TRACER_WAY_REFILL, scene);
    tracer_destroy(tracer);
}

enum device_kind { WITH_DOUBLES, WITHOUT_DOUBLES, WITHOUT_ADDRESSES, WITH_SMALL_HALVES };

/* Through the first blob, as on a device of that kind. */
static void try_blobs(const struct bytes *blobs, uint32_t count, enum device_kind kind)
{
    struct portable_view view;
    const struct gpu_properties properties = gpu->properties;
    const bool has_small_halves = gpu->has_small_halves;
    assert_int_equal(portable_open(blobs[0], &memory, &view, NULL), BVHD_OK);
    const struct portable_view *const bottoms[] = {&view};
    const struct scene scene = {NULL, bottoms, 1};
    const struct structures structures = {.name = (char *)(uintptr_t) "triangles",
                                          .target = TARGET_PORTABLE,
                                          .file_count = count,
                                          .blobs = (struct bytes *)(uintptr_t)blobs};
    gpu->properties.has_quick_doubles = properties.has_doubles && kind != WITHOUT_DOUBLES;
    gpu->properties.has_buffer_address = properties.has_buffer_address && kind != WITHOUT_ADDRESSES;
    gpu->has_small_halves = kind == WITH_SMALL_HALVES && gpu_keeps_small_halves(gpu);
    try_tracer(&structures, &scene, gpu->properties.has_quick_doubles && gpu->properties.has_buffer_address);
    gpu->properties = properties;
    gpu->has_small_halves = has_small_halves;
}

static void try_layout(uint32_t layout_flags, enum device_kind kind)
{
    struct bytes blob;
    build_blob(layout_flags, &blob);
    try_blobs(&blob, 1, kind);
    memory_free(&memory, (void *)(uintptr_t)blob.data);
}

/* Kernels that know the layout of all bottom levels leave out the others. Here there are two. */
static void test_both(void **state)
{
    struct bytes blobs[2];
    (void)state;
    build_blob(0, &blobs[0]);
    build_blob(PORTABLE_FAST_TRIANGLES, &blobs[1]);
    try_blobs(blobs, 2, WITH_DOUBLES);
    for (int i = 0; i < 2; i++)
        memory_free(&memory, (void *)(uintptr_t)blobs[i].data);
}

/* As many structures as make one that is traced like many small triangles. */
static void test_fine(void **state)
{
    (void)state;
    struct bytes blobs[FINE_COPIES];
    build_blob(PORTABLE_FAST_TRIANGLES, &blobs[0]);
    assert_true(blobs[0].size * FINE_COPIES > FINE_BYTES);
    for (int i = 1; i < FINE_COPIES; i++)
        blobs[i] = blobs[0];
    try_blobs(blobs, FINE_COPIES, WITH_DOUBLES);
    try_blobs(blobs, FINE_COPIES, WITHOUT_DOUBLES);
    memory_free(&memory, (void *)(uintptr_t)blobs[0].data);
}

static void test_indexed(void **state)
{
    (void)state;
    for (int kind = WITH_DOUBLES; kind <= WITH_SMALL_HALVES; kind++)
        try_layout(0, (enum device_kind)kind);
}

/* A root whose boxes are sound, but far larger than what they hold: steps that do not fit are not taken 2^24 times. */
static void test_large_steps(void **state)
{
    (void)state;
    struct bytes blob;
    struct portable_view view;
    struct bvhd_error error;
    struct tracer *tracer;
    static struct tracer_hit hits[RAYS];
    const bool has_small_halves = gpu->has_small_halves;
    build_blob(0, &blob);
    assert_int_equal(portable_open(blob, &memory, &view, NULL), BVHD_OK);
    struct portable_node *root = (struct portable_node *)(uintptr_t)view.nodes;
    for (int axis = 0; axis < 3; axis++) {
        root->origin[axis] = -0x1p106f;
        root->exponent[axis] = 127 + 108;
        for (int slot = 0; slot < 8; slot++)
            if (root->meta[slot]) {
                root->lo[axis][slot] = 0;
                root->hi[axis][slot] = 255;
            }
    }
    const struct structures structures = {
        .name = (char *)(uintptr_t) "large", .target = TARGET_PORTABLE, .file_count = 1, .blobs = &blob};
    gpu->has_small_halves = gpu_keeps_small_halves(gpu);
    if (tracer_portable_create(gpu, &structures, &memory, &tracer, &error))
        fail_msg("%s: %s", error.where, error.text);
    const struct portable_view *const bottoms[] = {&view};
    const struct scene scene = {NULL, bottoms, 1};
    for (int way = TRACER_WAY_TOGETHER; way <= TRACER_WAY_REFILL; way++) {
        unsigned hit = 0, differing = 0;
        tracer_portable_set_way(tracer, (enum tracer_way)way);
        assert_int_equal(tracer->trace(tracer, rays + RAYS / 2, RAYS / 2, hits, NULL, NULL), BVHD_OK);
        for (int i = 0; i < RAYS / 2; i++) {
            struct ray_hit one;
            bool is_hit = traverse(&scene, &rays[RAYS / 2 + i], NULL, &one, NULL);
            hit += is_hit;
            differing += is_hit != !isinf(hits[i].t);
        }
        assert_true(hit > RAYS / 16 && differing <= EDGES);
    }
    tracer_destroy(tracer);
    gpu->has_small_halves = has_small_halves;
    memory_free(&memory, (void *)(uintptr_t)blob.data);
}

static void test_fast_triangles(void **state)
{
    (void)state;
    try_layout(PORTABLE_FAST_TRIANGLES, WITHOUT_DOUBLES);
}

static void test_choice(void **state)
{
    (void)state;
    struct tracer_closest closest = {.together = 0, .refill = 1};
    struct ray some[64];
    memcpy(some, rays, sizeof some);
    assert_int_equal(tracer_closest_choose(&closest, some, 64), 0);
    assert_int_equal(tracer_closest_choose(&closest, rays + RAYS / 2, 1024), 1);
    assert_int_equal(tracer_closest_choose(&closest, some, 0), 0);
    closest.way = TRACER_WAY_REFILL;
    assert_int_equal(tracer_closest_choose(&closest, some, 64), 1);
    some[63].flags = RAY_CULL_BACK_FACING;
    assert_int_equal(tracer_closest_choose(&closest, some, 64), -1);
    some[63].flags = 0;
    some[0].tmin = -1;
    assert_int_equal(tracer_closest_choose(&closest, some, 64), -1);
    closest.together = -1;
    assert_int_equal(tracer_closest_choose(&closest, rays, 64), -1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_choice), cmocka_unit_test(test_indexed),        cmocka_unit_test(test_large_steps),
        cmocka_unit_test(test_fine),   cmocka_unit_test(test_fast_triangles), cmocka_unit_test(test_both),
    };
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    if (gpu_open("auto", &memory, &gpu, &error)) {
        printf("skipped: %s: %s\n", error.where, error.text);
        return SKIPPED;
    }
    make_triangles();
    make_rays();
    int failed = cmocka_run_group_tests(tests, NULL, NULL) + (int)gpu_messages();
    gpu_close(gpu);
    return failed || atomic_load(&memory.live) != 0;
}
