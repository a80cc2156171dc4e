/* SPDX-License-Identifier: Apache-2.0 */
/* Tracers on a Vulkan device against the traversal on the CPU. */
#include "tests/support/unit.h"

#include <math.h>

#include "tests/support/driver/driver_structure.h"
#include "tests/support/driver/gpu_bed.h"
#include "client/bvhctl/oracle/rays.h"
#include "tests/support/client/bvhctl/test_world.h"
#include "client/bvhctl/trace/tracer_device.h"
#include "client/bvhctl/trace/tracer_portable.h"

enum { RAYS = 20000 };

static struct memory memory;
static struct gpu *gpu;
static struct bvhd_format format; /* the device's own; its target is 0 where there is none */
static struct ray rays[RAYS];

static void find_format(void)
{
    void *probe;
    uint64_t size;
    if (bvhd_vulkan_probe(gpu->library, &gpu->queue, &probe, &size, NULL) != BVHD_OK)
        return;
    if (bvhd_format_from_probe(probe, size, &format, NULL) != BVHD_OK)
        format.target = 0;
    bvhd_vulkan_free(probe);
}

/* From above the world to everywhere in it: where cubes stand on the ground, from below, either is right. */
static void make_rays(void)
{
    uint64_t state = 1;
    for (int i = 0; i < RAYS; i++) {
        struct ray *ray = &rays[i];
        *ray = (struct ray){.tmax = i % 7 ? INFINITY : 4, .cull_mask = 0xff};
        for (int axis = 0; axis < 3; axis++) {
            float to = (float)(rays_uniform(&state) * 8 - 3);
            ray->origin[axis] = (float)(axis == 1 ? 2.5 + rays_uniform(&state) * 8 : rays_uniform(&state) * 20 - 10);
            ray->direction[axis] = to - ray->origin[axis];
        }
        if (i % 5 == 0)
            ray->flags = i % 2 ? RAY_CULL_BACK_FACING : RAY_TERMINATE_ON_FIRST_HIT;
        if (i % 11 == 0)
            ray->cull_mask = 0;
    }
}

static int open_device(void **state)
{
    (void)state;
    memory_init(&memory, UINT64_MAX);
    if (gpu_open("auto", &memory, &gpu, NULL) != BVHD_OK)
        return -1;
    find_format();
    make_rays();
    return 0;
}

static int close_device(void **state)
{
    (void)state;
    gpu_close(gpu);
    return memory.live ? -1 : 0;
}

typedef enum bvhd_status (*creator)(struct gpu *, const struct structures *, struct memory *, struct tracer **,
                                    struct bvhd_error *);

static struct tracer *create(creator function, const struct structures *structures)
{
    struct tracer *tracer = NULL;
    struct bvhd_error error = {0};
    if (function(gpu, structures, &memory, &tracer, &error) != BVHD_OK)
        fail_msg("%s: %s", error.where, error.text);
    assert_string_equal(tracer->device, gpu->properties.name);
    assert_int_equal(tracer->target, structures->target);
    return tracer;
}

static bool is_same(const struct tracer_hit *a, const struct tracer_hit *b)
{
    if (isinf(a->t) || isinf(b->t))
        return isinf(a->t) && isinf(b->t) && a->instance == RAY_NO_INSTANCE;
    return fabsf(a->t - b->t) <= 1e-5f * b->t && fabsf(a->u - b->u) < 1e-3f && fabsf(a->v - b->v) < 1e-3f &&
           a->instance == b->instance && a->custom_index == b->custom_index && a->geometry == b->geometry &&
           a->primitive == b->primitive && a->flags == b->flags;
}

/* Returns the CPU's answer in portable structures. */
static struct tracer_hit expect(const struct bvhd_cpu_scene *scene, const struct ray *ray)
{
    struct tracer_hit hit;
    const struct bvhd_cpu_trace trace = {.struct_size = sizeof trace,
                                         .rays = ray,
                                         .ray_size = sizeof *ray,
                                         .hits = &hit,
                                         .hit_size = sizeof hit,
                                         .ray_count = 1};
    assert_int_equal(bvhd_cpu_scene_trace(scene, &trace, NULL), BVHD_OK);
    return hit;
}

/*
 * The first hit that is found is any: it need only be there. Along edges, and where surfaces cross, more than one
 * answer is right.
 */
static void compare(struct tracer *tracer, const struct bvhd_cpu_scene *scene)
{
    static struct tracer_hit hits[RAYS];
    double seconds = -1;
    unsigned hit = 0, different = 0;
    assert_int_equal(tracer->trace(tracer, rays, RAYS, hits, &seconds, NULL), BVHD_OK);
    assert_true(seconds > 0 && seconds < 60);
    for (int i = 0; i < RAYS; i++) {
        struct tracer_hit expected = expect(scene, &rays[i]);
        bool is_any = rays[i].flags & RAY_TERMINATE_ON_FIRST_HIT;
        hit += !isinf(expected.t);
        different += is_any ? isinf(hits[i].t) != isinf(expected.t) : !is_same(&hits[i], &expected);
    }
    assert_true(hit > RAYS / 20 && hit < RAYS);
    assert_in_range(different, 0, RAYS / 2000);
}

/*
 * Portions: none, a part of a workgroup, more than one dispatch, when no more rays of 48 bytes can be bound than are in
 * one.
 */
static void trace_counts(struct tracer *tracer)
{
    enum { PORTION = TRACER_GROUP * 1000, MOST = PORTION * 3 + 3 };
    static const uint64_t counts[] = {0, 1, TRACER_GROUP + 1, MOST, 2, PORTION};
    const struct gpu_properties properties = gpu->properties;
    uint64_t most = MOST;
    gpu->properties.max_storage_range = (PORTION + 1) * 48;
    struct ray *many = memory_array(&memory, most, sizeof *many);
    struct tracer_hit *hits = memory_array(&memory, most + 1, sizeof *hits);
    for (uint64_t i = 0; i < most; i++)
        many[i] = rays[i % 100];
    for (size_t k = 0; k < sizeof counts / sizeof *counts; k++) {
        memset(hits, 0x55, (most + 1) * sizeof *hits);
        assert_int_equal(tracer->trace(tracer, many, counts[k], hits, NULL, NULL), BVHD_OK);
        for (uint64_t i = 100; i < counts[k]; i++)
            if (memcmp(&hits[i], &hits[i % 100], sizeof *hits) != 0)
                fail_msg("ray %llu of %llu", (unsigned long long)i, (unsigned long long)counts[k]);
        assert_int_equal(hits[counts[k]].instance, 0x55555555);
    }
    gpu->properties = properties;
    memory_free(&memory, hits);
    memory_free(&memory, many);
}

/* Traces rays that Vulkan forbids, and one that aims away: none hits anything. */
static void trace_nothing(struct tracer *tracer)
{
    struct ray bad[6];
    struct tracer_hit hits[6];
    for (int i = 0; i < 6; i++)
        bad[i] = (struct ray){.origin = {0, 50, 0}, .direction = {0, -1, 0}, .tmax = INFINITY, .cull_mask = 0xff};
    bad[0].direction[1] = 0;
    bad[1].origin[0] = NAN;
    bad[2].direction[2] = INFINITY;
    bad[3].tmin = 100;
    bad[3].tmax = 1;
    bad[4].direction[1] = 1;
    assert_int_equal(tracer->trace(tracer, bad, 6, hits, NULL, NULL), BVHD_OK);
    for (int i = 0; i < 5; i++)
        assert_memory_equal(&hits[i], &tracer_miss, sizeof tracer_miss);
    assert_false(isinf(hits[5].t));
}

/* A bottom level alone: the cube. */
static void compare_alone(creator function, const struct structures *structures, const struct structures *portable)
{
    struct bytes blob = structures->blobs[1];
    const struct bvhd_cpu_blob cube_blob = {portable->blobs[1].data, portable->blobs[1].size};
    const struct bvhd_cpu_scene_options options = {.struct_size = sizeof options, .blobs = &cube_blob, .blob_count = 1};
    struct bvhd_cpu_scene *cube = NULL;
    assert_int_equal(bvhd_cpu_scene_create(&options, &cube, NULL), BVHD_OK);
    const struct structures one = {
        .name = structures->name, .target = structures->target, .file_count = 1, .blobs = &blob};
    struct tracer *tracer = create(function, &one);
    compare(tracer, cube);
    tracer_destroy(tracer);
    bvhd_cpu_scene_destroy(cube);
}

static void fail_each_allocation(creator function, const struct structures *structures)
{
    struct memory small;
    memory_init(&small, UINT64_MAX);
    enum bvhd_status status = BVHD_NO_MEMORY;
    int tries = 0;
    for (; status != BVHD_OK && tries < 100; tries++) {
        struct tracer *tracer = NULL;
        small.fail_after = tries;
        status = function(gpu, structures, &small, &tracer, NULL);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        tracer_destroy(tracer);
        assert_int_equal(small.live, 0);
    }
    assert_in_range(tries, 2, 99);
}

static void try_all(creator function, const struct test_world *world, const struct test_world *portable)
{
    struct tracer *tracer = create(function, &world->structures);
    compare(tracer, portable->structures.scene);
    trace_counts(tracer);
    trace_nothing(tracer);
    tracer_destroy(tracer);
    compare_alone(function, &world->structures, &portable->structures);
    fail_each_allocation(function, &world->structures);
}

static void portable_structures_by_shader(void **state)
{
    (void)state;
    struct test_world world;
    struct tracer *tracer = NULL;
    struct bvhd_error error;
    test_world_init(&world, 1);
    try_all(tracer_portable_create, &world, &world);
    assert_int_equal(tracer_native_create(gpu, &world.structures, &memory, &tracer, &error), BVHD_INCOMPATIBLE);
    assert_null(tracer);
    test_world_finish(&world);
}

/* As on a device without buffer addresses: the whole scene is one binding, found by offsets. */
static void portable_structures_in_one_binding(void **state)
{
    (void)state;
    struct test_world world;
    struct tracer *tracer = NULL;
    struct bvhd_error error;
    const struct gpu_properties properties = gpu->properties;
    test_world_init(&world, 1);
    gpu->properties.has_buffer_address = false;
    tracer = create(tracer_portable_create, &world.structures);
    compare(tracer, world.structures.scene);
    tracer_destroy(tracer);
    tracer = NULL;
    const uint64_t range = gpu->library->limits.storage_range;
    gpu->library->limits.storage_range = 1000;
    assert_int_equal(tracer_portable_create(gpu, &world.structures, &memory, &tracer, &error), BVHD_TOO_LARGE);
    gpu->library->limits.storage_range = range;
    assert_null(tracer);
    gpu->properties = properties;
    test_world_finish(&world);
}

/* The kernels for rays without flags through instances, with doubles and without. */
static void portable_structures_by_closest_kernels(void **state)
{
    (void)state;
    struct test_world world;
    const struct gpu_properties properties = gpu->properties;
    test_world_init(&world, 1);
    for (int i = 0; i < RAYS; i++)
        rays[i].flags = 0;
    for (int has_doubles = 0; has_doubles < 2; has_doubles++) {
        gpu->properties.has_doubles = has_doubles && properties.has_doubles;
        struct tracer *tracer = create(tracer_portable_create, &world.structures);
        for (int way = TRACER_WAY_COHERENT; way <= TRACER_WAY_INCOHERENT; way++) {
            tracer_portable_set_way(tracer, (enum tracer_way)way);
            compare(tracer, world.structures.scene);
        }
        tracer_destroy(tracer);
    }
    gpu->properties = properties;
    make_rays();
    test_world_finish(&world);
}

/* Rays with flags need the ray query, whatever way a tracer has been set to. */
static void flags_need_the_query(void **state)
{
    (void)state;
    struct test_world world;
    test_world_init(&world, 1);
    struct tracer *tracer = create(tracer_portable_create, &world.structures);
    for (int way = TRACER_WAY_COHERENT; way <= TRACER_WAY_INCOHERENT; way++) {
        tracer_portable_set_way(tracer, (enum tracer_way)way);
        compare(tracer, world.structures.scene);
    }
    tracer_destroy(tracer);
    test_world_finish(&world);
}

static void native_structures_by_ray_queries(void **state)
{
    (void)state;
    struct test_world world, portable;
    struct tracer *tracer = NULL;
    if (!format.target || !gpu->properties.has_ray_query)
        skip();
    test_world_init_for(&world, 1, &format);
    test_world_init(&portable, 1);
    try_all(tracer_native_create, &world, &portable);
    assert_int_equal(tracer_portable_create(gpu, &world.structures, &memory, &tracer, NULL), BVHD_INCOMPATIBLE);
    assert_null(tracer);
    test_world_finish(&portable);
    test_world_finish(&world);
}

static void another_versions_structures_are_refused(void **state)
{
    (void)state;
    struct test_world world;
    struct tracer *tracer = NULL;
    struct bvhd_format other = format;
    struct bvhd_error error;
    if (!format.target || !gpu->properties.has_ray_query)
        skip();
    other.driver_uuid[15] ^= 1;
    test_world_init_for(&world, 1, &other);
    assert_int_equal(tracer_native_create(gpu, &world.structures, &memory, &tracer, &error), BVHD_INCOMPATIBLE);
    assert_null(tracer);
    assert_non_null(strstr(error.text, bvhd_target_name(format.target)));
    test_world_finish(&world);
}

enum { SPREAD_BOXES = 60, MORE_BOXES = 20 };

/* Boxes of a bottom level that the driver builds: two geometries. */
struct box_world {
    float boxes[SPREAD_BOXES + MORE_BOXES][6];
    struct canonical_geometry geometries[2];
    struct canonical canonical;
    struct driver_structure bottom, top;
};

static void box_world_open(struct box_world *world)
{
    uint64_t state = 7;
    for (int i = 0; i < SPREAD_BOXES + MORE_BOXES; i++)
        for (int axis = 0; axis < 3; axis++) {
            world->boxes[i][axis] = (float)(rays_uniform(&state) * 8 - 4);
            world->boxes[i][3 + axis] = world->boxes[i][axis] + (float)rays_uniform(&state);
        }
    world->geometries[0] =
        (struct canonical_geometry){.type = GEOMETRY_AABBS, .primitive_count = SPREAD_BOXES, .boxes = world->boxes[0]};
    world->geometries[1] = (struct canonical_geometry){.type = GEOMETRY_AABBS,
                                                       .flags = GEOMETRY_OPAQUE,
                                                       .primitive_count = MORE_BOXES,
                                                       .first_primitive = SPREAD_BOXES,
                                                       .boxes = world->boxes[SPREAD_BOXES]};
    world->canonical = (struct canonical){.bytes = (const unsigned char *)world->boxes,
                                          .size = sizeof world->boxes,
                                          .type = STRUCTURE_BOTTOM,
                                          .geometry_count = 2,
                                          .primitive_count = SPREAD_BOXES + MORE_BOXES,
                                          .geometries = world->geometries};
    assert_int_equal(driver_structure_build(gpu, &world->canonical, NULL, &memory, &world->bottom, NULL), BVHD_OK);
    assert_int_equal(driver_structure_top_of(gpu, world->bottom.address, &world->top, NULL), BVHD_OK);
}

/* Where they are a ray query does not tell. */
static void aabbs_are_nothing_to_ray_queries(void **state)
{
    (void)state;
    static struct tracer_hit hits[RAYS];
    struct box_world world;
    struct tracer *tracer = NULL;
    if (!gpu->properties.has_ray_query)
        skip();
    box_world_open(&world);
    assert_int_equal(tracer_query_create(gpu, world.top.handle, &memory, &tracer, NULL), BVHD_OK);
    assert_int_equal(tracer->trace(tracer, rays, RAYS, hits, NULL, NULL), BVHD_OK);
    for (int i = 0; i < RAYS; i++)
        assert_true(isinf(hits[i].t));
    tracer_destroy(tracer);
    driver_structure_destroy(gpu, &world.top);
    driver_structure_destroy(gpu, &world.bottom);
}

static void validation_layers_are_silent(void **state)
{
    (void)state;
    assert_int_equal(gpu_messages(), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(portable_structures_by_shader),
        cmocka_unit_test(portable_structures_in_one_binding),
        cmocka_unit_test(portable_structures_by_closest_kernels),
        cmocka_unit_test(flags_need_the_query),
        cmocka_unit_test(native_structures_by_ray_queries),
        cmocka_unit_test(another_versions_structures_are_refused),
        cmocka_unit_test(aabbs_are_nothing_to_ray_queries),
        cmocka_unit_test(validation_layers_are_silent),
    };
    if (gpu_bed_is_missing(false))
        return GPU_BED_SKIPPED;
    return cmocka_run_group_tests(tests, open_device, close_device);
}
