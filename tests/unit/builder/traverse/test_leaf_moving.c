/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_leaf_moving.c - tests that rays through motion triangles and motion instances, in every walk, have the answers
 * of brute force at their time. The structures are made here, so that nothing but the traversal can be at fault.
 */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "builder/traverse/motion.h"
#include "builder/traverse/traverse_group.h"
#include "builder/traverse/traverse_state.h"
#include "tests/support/builder/moving_structure.h"
#include "tests/support/random.h"

enum { RAYS = 40000 };

/* How a scene moves, and where it is. */
struct motion {
    double size, speed, offset;
    bool is_flat; /* all stays in the plane z = offset */
};

static void make_place(struct random *random, const struct motion *motion, const double centre[3], double spread,
                       float ret_place[3])
{
    double apart[3];
    random_point(random, apart);
    for (int axis = 0; axis < 3; axis++)
        ret_place[axis] =
            (float)(motion->offset +
                    (motion->is_flat && axis == 2 ? 0 : motion->size * (centre[axis] + spread * apart[axis])));
}

/* Makes triangles of which each vertex moves; each of the two geometries has a half of them. */
static void make_triangles(struct made *made, struct random *random, const struct motion *motion, uint32_t count)
{
    struct span *spans = calloc(count, sizeof *spans);
    struct portable_indexed_triangle *triangles = calloc(count, sizeof *triangles);
    *made = (struct made){.header = {.content = PORTABLE_MOVING_TRIANGLES, .geometry_count = 2}};
    made->vertices = calloc((size_t)3 * count + 1, sizeof *made->vertices);
    made->triangles = calloc(count, sizeof *made->triangles);
    assert_true(spans && triangles && made->vertices && made->triangles);
    for (uint32_t i = 0; i < count; i++) {
        double centre[3], moved[3];
        random_point(random, centre);
        random_point(random, moved);
        for (int axis = 0; axis < 3; axis++)
            moved[axis] = centre[axis] + motion->speed * moved[axis];
        spans[i] = (struct span){{box_empty(), box_empty()}, i};
        for (int k = 0; k < 3; k++) {
            struct portable_moving_vertex *vertex = &made->vertices[3 * i + k];
            make_place(random, motion, centre, 0.3, vertex->start);
            make_place(random, motion, i % 5 == 0 ? centre : moved, 0.3, vertex->end);
            box_add_point(&spans[i].keys[0], vertex->start);
            box_add_point(&spans[i].keys[1], vertex->end);
            triangles[i].vertices[k] = 3 * i + (uint32_t)k;
        }
        triangles[i].id = i | (i % 3 ? PORTABLE_ID_OPAQUE : 0);
    }
    make_nodes(made, spans, count);
    for (uint32_t i = 0; i < count; i++)
        made->triangles[i] = triangles[made->order[i]];
    made->geometries[0].primitive_count = count / 2;
    made->geometries[1] =
        (struct portable_geometry){.first_primitive = count / 2, .primitive_count = count - count / 2};
    made->view.records = made->triangles;
    made->view.vertices = (const float *)made->vertices;
    free(spans);
    free(triangles);
}

/* ---- Brute force ---- */

/* What the candidates of rays are asked: whether a triangle counts depends on its id. */
static bool is_taken(uint32_t id, bool asks)
{
    return !asks || id & PORTABLE_ID_OPAQUE || id % 2 == 0;
}

static enum candidate_verdict ask(void *context, const struct ray *ray, const struct candidate_space *space,
                                  struct ray_hit *hit)
{
    const struct made *made = context;
    const uint32_t id = made->geometries[hit->geometry].first_primitive + hit->primitive;
    (void)ray;
    assert_false(space->is_opaque);
    return is_taken(id, true) ? CANDIDATE_ACCEPT : CANDIDATE_IGNORE;
}

/* The closest hit so far. */
struct expected {
    double t;
    uint32_t instance, id;
    bool is_hit;
};

static void search(const struct made *made, const struct ray *ray, const double origin[3], const double direction[3],
                   uint32_t instance, bool asks, struct expected *expected)
{
    struct triangle_ray prepared;
    triangle_ray_init(origin, direction, &prepared);
    for (uint32_t i = 0; i < made->header.record_count; i++) {
        float corners[3][3];
        struct triangle_hit hit;
        for (int k = 0; k < 3; k++)
            for (int axis = 0; axis < 3; axis++) {
                const struct portable_moving_vertex *vertex = &made->vertices[made->triangles[i].vertices[k]];
                const volatile float first = vertex->start[axis] * (1 - ray->time),
                                     second = vertex->end[axis] * ray->time;
                corners[k][axis] = first + second;
            }
        const uint32_t id = made->triangles[i].id;
        if (!is_taken(id, asks) || !triangle_intersect(&prepared, corners[0], corners[1], corners[2], &hit) ||
            !(hit.t > ray->tmin && hit.t < ray->tmax))
            continue;
        const double apart = hit.t - expected->t, same = 0x1p-32 * fabs(hit.t);
        if (expected->is_hit && apart > same)
            continue;
        if (expected->is_hit && fabs(apart) <= same &&
            (instance != expected->instance ? instance > expected->instance : (id & PORTABLE_ID_MASK) > expected->id))
            continue;
        *expected = (struct expected){hit.t, instance, id & PORTABLE_ID_MASK, true};
    }
}

static float pick_time(struct random *random)
{
    const uint64_t kind = random_next(random) % 6;
    return kind == 0 ? 0 : kind == 1 ? 1 : kind == 2 ? nextafterf(1, 0) : (float)random_between(random, 0, 1);
}

/* Makes a ray from around the structure to a point of one of its triangles, at the ray's time, or to near it. */
static struct ray make_ray(struct random *random, const struct made *made)
{
    struct ray ray = {.tmax = FLT_MAX, .cull_mask = 0xff, .time = pick_time(random)};
    const uint32_t record = (uint32_t)(random_next(random) % made->header.record_count);
    const float *bounds = made->header.bounds;
    const double v = random_between(random, -0.1, 0.6), w = random_between(random, -0.1, 0.6);
    const bool is_parallel = random_next(random) % 8 == 0;
    float corners[3][3];
    double from[3], size = 0;
    random_point(random, from);
    motion_corners(&made->view, record, motion_weights_at(ray.time), corners);
    for (int axis = 0; axis < 3; axis++)
        size = fmax(size, ((double)bounds[3 + axis] - bounds[axis]) / 2);
    for (int axis = 0; axis < 3; axis++) {
        const double to = (1 - v - w) * corners[0][axis] + v * corners[1][axis] + w * corners[2][axis];
        ray.origin[axis] = (float)(((double)bounds[axis] + bounds[3 + axis]) / 2 + 1.5 * size * from[axis]);
        ray.direction[axis] = (float)(to - ray.origin[axis]);
        if (is_parallel && axis == (int)(random_next(random) % 3)) {
            ray.origin[axis] = (float)to;
            ray.direction[axis] = random_next(random) % 2 ? 0 : -0.0f;
        }
    }
    if (random_next(random) % 4 == 0)
        ray.tmax = (float)random_between(random, 0, 1.2);
    if (random_next(random) % 16 == 0)
        ray.tmin = (float)random_between(random, -0.5, 0.5);
    return ray;
}

/* UNPACKED: with the copy that AVX2 walks. */
enum way { DEFAULT, UNPACKED, BASELINE, EXACT, FLIPPED, ASKING, WAYS };

static const struct traverse_options ways[WAYS] = {
    [BASELINE] = {.baseline_only = true},
    [EXACT] = {.exact_only = true},
    [FLIPPED] = {.flip_order = true},
    [ASKING] = {.candidate = ask},
};

static void check_ray(const struct scene *scene, const struct made *made, struct ray *ray, enum way way,
                      const struct expected *expected)
{
    struct traverse_options options = ways[way];
    struct ray_hit hit = {.t = -7};
    options.context = (void *)(uintptr_t)made;
    struct scene way_scene = *scene;
    way_scene.unpacked = way == UNPACKED ? scene->unpacked : NULL;
    const bool is_hit = traverse(&way_scene, ray, way <= UNPACKED ? NULL : &options, &hit, NULL);
    if (is_hit != expected->is_hit ||
        (is_hit && !(ray->flags & RAY_TERMINATE_ON_FIRST_HIT) &&
         (hit.t != (float)expected->t ||
          made->geometries[hit.geometry].first_primitive + hit.primitive != expected->id ||
          hit.instance != expected->instance)))
        fail_msg("way %d, time %.9g: %d %g, not %d %g (%u)", way, (double)ray->time, is_hit, (double)hit.t,
                 expected->is_hit, expected->t, expected->id);
}

static uint32_t ray_count(void)
{
    const char *more = getenv("BVHD_TEST_RAYS");
    return more ? (uint32_t)strtoul(more, NULL, 10) : RAYS;
}

static void check_triangles(const struct motion *motion, uint32_t seed, uint32_t rays)
{
    struct random random = {seed};
    struct made made;
    uint32_t hits = 0;
    make_triangles(&made, &random, motion, 150);
    const struct portable_view *view = &made.view;
    const struct unpacked_node *unpacked = unpack(&made);
    const struct scene scene = {.bottoms = &view, .bottom_count = 1, .unpacked = &unpacked};
    for (uint32_t i = 0; i < rays; i++) {
        struct ray ray = make_ray(&random, &made);
        const double origin[3] = {ray.origin[0], ray.origin[1], ray.origin[2]},
                     direction[3] = {ray.direction[0], ray.direction[1], ray.direction[2]};
        const enum way way = (enum way)(i % WAYS);
        struct expected expected = {.is_hit = false};
        if (way != ASKING && i % 3 == 0)
            ray.flags = RAY_TERMINATE_ON_FIRST_HIT;
        search(&made, &ray, origin, direction, RAY_NO_INSTANCE, way == ASKING, &expected);
        check_ray(&scene, &made, &ray, way, &expected);
        hits += expected.is_hit;
    }
    if (hits <= rays / 50)
        fail_msg("seed %u: only %u of %u rays hit", seed, hits, rays);
    finish_made(&made);
}

/* ---- Motion instances ---- */

enum { BOTTOMS = 3, INSTANCES = 40 };

/* A top level over some bottom levels. */
struct world {
    struct made bottoms[BOTTOMS], top;
    const struct portable_view *views[BOTTOMS];
    const struct unpacked_node *unpacked[BOTTOMS];
    struct scene scene;
};

/* Returns the box of a bottom level under a matrix, with room for the rounding of the matrix at any time. */
static struct box moved_box(const float bounds[6], const float matrix[12])
{
    struct box box;
    for (int row = 0; row < 3; row++) {
        double least = matrix[4 * row + 3], most = least, size = fabs(least);
        for (int k = 0; k < 3; k++) {
            const double a = (double)matrix[4 * row + k] * bounds[k], b = (double)matrix[4 * row + k] * bounds[3 + k];
            least += fmin(a, b);
            most += fmax(a, b);
            size += fmax(fabs(a), fabs(b));
        }
        box.min[row] = nextafterf((float)(least - 0x1p-20 * size), -INFINITY);
        box.max[row] = nextafterf((float)(most + 0x1p-20 * size), INFINITY);
    }
    return box;
}

static void set_identity(float numbers[16])
{
    numbers[0] = numbers[5] = numbers[10] = 1;
}

static void make_matrix(struct random *random, double scale, float numbers[16])
{
    set_identity(numbers);
    for (int i = 0; i < 12; i++)
        numbers[i] = (float)(scale * (numbers[i] + random_between(random, -0.5, 0.5)) +
                             (i % 4 == 3 ? random_between(random, -20, 20) : 0));
}

static void make_srt(struct random *random, float numbers[16])
{
    for (int i = 0; i < 16; i++)
        numbers[i] = (float)(i >= 13 ? random_between(random, -20, 20) : random_between(random, -1, 1));
    numbers[0] += 2; /* the scale */
    numbers[4] += 2;
    numbers[7] += 2;
}

/* Returns a box of all times of an instance with a scale, a rotation and a translation. */
static struct box srt_box(const float bounds[6], const struct portable_moving_instance *instance)
{
    struct box box = box_empty();
    double reach = 0, farthest = 0;
    for (int axis = 0; axis < 3; axis++)
        farthest += pow(fmax(fabs((double)bounds[axis]), fabs((double)bounds[3 + axis])), 2);
    farthest = sqrt(farthest);
    for (int i = 0; i < 9; i++)
        reach += fmax(fabs((double)instance->start[i]), fabs((double)instance->end[i])) * fmax(1, farthest);
    for (int key = 0; key < 2; key++)
        for (int sign = -1; sign <= 1; sign += 2) {
            float point[3];
            for (int axis = 0; axis < 3; axis++)
                point[axis] = (float)((key ? instance->end : instance->start)[13 + axis] + 1.001 * sign * reach);
            box_add_point(&box, point);
        }
    return box;
}

static void make_world(struct world *world, struct random *random)
{
    static const struct motion motions[BOTTOMS] = {{1, 0.5, 0, false}, {1, 0, 1, false}, {0.1, 3, -1, false}};
    struct span spans[INSTANCES];
    struct portable_moving_instance instances[INSTANCES] = {{0}};
    for (uint32_t i = 0; i < BOTTOMS; i++) {
        make_triangles(&world->bottoms[i], random, &motions[i], 30);
        world->views[i] = &world->bottoms[i].view;
        world->unpacked[i] = unpack(&world->bottoms[i]);
    }
    world->top = (struct made){.header = {.content = PORTABLE_MOVING_INSTANCES}};
    for (uint32_t i = 0; i < INSTANCES; i++) {
        struct portable_moving_instance *instance = &instances[i];
        const float *bounds = world->bottoms[i % BOTTOMS].header.bounds;
        *instance = (struct portable_moving_instance){.motion = random_next(random) % MOTION_TYPES,
                                                      .custom_and_mask = (i % 7 == 0 ? 0x0fu : 0xf0u) << 24 | i,
                                                      .instance = i,
                                                      .handle = i % BOTTOMS};
        if (instance->motion == MOTION_SRT) {
            make_srt(random, instance->start);
            make_srt(random, instance->end);
            spans[i].keys[0] = spans[i].keys[1] = srt_box(bounds, instance);
        } else {
            make_matrix(random, 2, instance->start);
            make_matrix(random, i % 9 == 0 ? -2 : 2, instance->end); /* of which some pass a singular one */
            if (instance->motion == MOTION_STATIC)
                memcpy(instance->end, instance->start, sizeof instance->end);
            spans[i].keys[0] = moved_box(bounds, instance->start);
            spans[i].keys[1] = moved_box(bounds, instance->end);
        }
        spans[i].index = i;
    }
    make_nodes(&world->top, spans, INSTANCES);
    world->top.instances = calloc(INSTANCES, sizeof *world->top.instances);
    assert_non_null(world->top.instances);
    for (uint32_t i = 0; i < INSTANCES; i++)
        world->top.instances[i] = instances[world->top.order[i]];
    world->top.view.records = world->top.instances;
    world->scene = (struct scene){
        .top = &world->top.view, .bottoms = world->views, .bottom_count = BOTTOMS, .unpacked = world->unpacked};
}

static void search_world(const struct world *world, const struct ray *ray, struct expected *expected)
{
    for (uint32_t i = 0; i < INSTANCES; i++) {
        const struct portable_moving_instance *instance = &world->top.instances[i];
        struct traverse_state state = {.ray = ray};
        float matrix[12];
        if (!(instance->custom_and_mask >> 24 & ray->cull_mask) || !motion_matrix(instance, ray->time, matrix))
            continue;
        traverse_state_to_object(&state, matrix);
        if (traverse_state_is_usable(&state))
            search(&world->bottoms[instance->handle], ray, state.origin, state.direction, instance->instance, false,
                   expected);
    }
}

/* Makes a ray to the place of an instance at the ray's time. */
static struct ray make_world_ray(struct random *random, const struct world *world)
{
    struct ray ray = {.tmax = FLT_MAX, .cull_mask = random_next(random) % 4 ? 0xff : 0xf0, .time = pick_time(random)};
    float matrix[12];
    double from[3], near[3];
    if (!motion_matrix(&world->top.instances[random_next(random) % INSTANCES], ray.time, matrix))
        memset(matrix, 0, sizeof matrix);
    random_point(random, from);
    random_point(random, near);
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)(40 * from[axis]);
        ray.direction[axis] = (float)(matrix[4 * axis + 3] + near[axis] - ray.origin[axis]);
    }
    return ray;
}

/* ---- The tests ---- */

static void test_triangles(void **state)
{
    (void)state;
    static const struct motion motions[] = {
        {1, 0, 0, false}, {1, 0.3, 0, false}, {1, 5, 0, false}, {1, 0.3, 1000, false}, {1e-3, 0.1, -3000, false},
    };
    for (uint32_t i = 0; i < sizeof motions / sizeof *motions; i++)
        check_triangles(&motions[i], 10 + i, ray_count());
}

/* Velocities of many times the size, numbers at the ends of float, structures without extent along an axis. */
static void test_extremes(void **state)
{
    (void)state;
    static const struct motion motions[] = {
        {1, 1e6, 0, false},  {1e-30, 1e12, 0, false}, {1e20, 1e15, 0, false}, {1e-40, 1, 0, false},
        {1e37, 1, 0, false}, {1, 0.5, 0.7, true},     {1, 0.5, 1e6, false},   {40, 1, 16777216, false},
    };
    for (uint32_t i = 0; i < sizeof motions / sizeof *motions; i++) {
        const struct motion *motion = &motions[i];
        check_triangles(motion, 30 + i, ray_count() / 4);
    }
}

/* Instances of structures that move, by matrices and by scale, rotation and translation, seen through masks. */
static void test_instances(void **state)
{
    (void)state;
    struct random random = {77};
    struct world world;
    uint32_t hits = 0;
    const uint32_t rays = ray_count();
    make_world(&world, &random);
    for (uint32_t i = 0; i < rays; i++) {
        struct ray ray = make_world_ray(&random, &world);
        struct expected expected = {.is_hit = false};
        if (i % 3 == 0)
            ray.flags = RAY_TERMINATE_ON_FIRST_HIT;
        search_world(&world, &ray, &expected);
        check_ray(&world.scene, &world.bottoms[expected.is_hit ? expected.instance % BOTTOMS : 0], &ray,
                  (enum way)(i % ASKING), &expected);
        hits += expected.is_hit;
    }
    assert_true(hits > rays / 20);
    for (int i = 0; i < BOTTOMS; i++)
        finish_made(&world.bottoms[i]);
    finish_made(&world.top);
}

/* Rays of one time from one place, and others: each has in a group the answer that it has alone. */
static void test_groups(void **state)
{
    (void)state;
    static const struct motion motion = {1, 0.4, 5, false};
    struct random random = {99};
    struct made made;
    make_triangles(&made, &random, &motion, 400);
    const struct portable_view *view = &made.view;
    const struct unpacked_node *unpacked = unpack(&made);
    const struct scene scene = {.bottoms = &view, .bottom_count = 1, .unpacked = &unpacked};
    struct traverse_stream stream = {.scene = &scene};
    for (uint32_t turn = 0; turn < ray_count() / TRAVERSE_GROUP; turn++) {
        struct ray rays[TRAVERSE_GROUP];
        struct ray_hit hits[TRAVERSE_GROUP], alone;
        for (uint32_t i = 0; i < TRAVERSE_GROUP; i++) {
            rays[i] = make_ray(&random, &made);
            rays[i].flags = turn % 3 == 0 ? RAY_TERMINATE_ON_FIRST_HIT : 0;
            for (int axis = 0; turn % 5 != 0 && axis < 3; axis++)
                rays[i].direction[axis] += rays[i].origin[axis] - rays[0].origin[axis];
            for (int axis = 0; turn % 5 != 0 && axis < 3; axis++)
                rays[i].origin[axis] = rays[0].origin[axis];
            rays[i].time = turn % 7 == 0 ? rays[i].time : rays[0].time;
        }
        uint64_t is_hit = 0, in_turns = 0;
        for (uint32_t i = 0; turn % 2 != 0 && i < TRAVERSE_GROUP; i++)
            in_turns |= (uint64_t)ray_is_plain(&rays[i]) << i;
        in_turns = turns_avx2_trace(&stream, rays, in_turns, hits, &is_hit);
        if (turn % 2 == 0)
            is_hit = traverse_group(&stream, rays, TRAVERSE_GROUP, hits);
        for (uint32_t i = 0; i < TRAVERSE_GROUP; i++) {
            if (turn % 2 != 0 && !(in_turns >> i & 1))
                continue;
            assert_int_equal(traverse(&scene, &rays[i], NULL, &alone, NULL), is_hit >> i & 1);
            if (is_hit >> i & 1)
                assert_memory_equal(&alone, &hits[i], sizeof alone);
        }
    }
    assert_true(stream.visits_together > 0 || stream.pause > 0);
    finish_made(&made);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_instances),
        cmocka_unit_test(test_groups),
        cmocka_unit_test(test_triangles),
        cmocka_unit_test(test_extremes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
