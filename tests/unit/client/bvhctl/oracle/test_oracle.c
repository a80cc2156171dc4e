/* SPDX-License-Identifier: Apache-2.0 */
/* test_oracle.c - tests the oracle: single triangles, neighbours and ties, whole scenes, and its judgement. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "tests/support/builder/moved.h"
#include "builder/workers.h"

/* ---- helpers ---- */

static struct memory memory;

static struct ray make_ray(float ox, float oy, float oz, float dx, float dy, float dz)
{
    return (struct ray){
        .origin = {ox, oy, oz}, .direction = {dx, dy, dz}, .tmin = 0, .tmax = FLT_MAX, .cull_mask = 0xff};
}

static struct oracle_mesh make_mesh(const float *positions, const uint32_t *indices, uint32_t triangle_count)
{
    return (struct oracle_mesh){
        .positions = positions, .indices = indices, .primitive_count = triangle_count, .instance = RAY_NO_INSTANCE};
}

static struct oracle_answer ask(const struct oracle_mesh *meshes, uint32_t count, struct ray ray)
{
    struct oracle_answer answer;
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(oracle_trace(meshes, count, &ray, 1, &memory, &parallel_serial, NULL, NULL, &answer, NULL),
                     BVHD_OK);
    return answer;
}

static void forget(struct oracle_answer *answer)
{
    oracle_finish(answer, 1, &memory);
    assert_int_equal(memory.live, 0);
}

static enum oracle_outcome outcome_of(const struct oracle_mesh *meshes, uint32_t count, struct ray ray)
{
    struct oracle_answer answer = ask(meshes, count, ray);
    enum oracle_outcome outcome = answer.outcome;
    forget(&answer);
    return outcome;
}

static uint32_t tied_triangles(const struct oracle_answer *answer)
{
    uint32_t sum = 0;
    for (uint32_t i = 0; i < answer->tied_count; i++)
        sum += answer->tied[i].count;
    return sum;
}

static const float corner_triangle[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};

/* ---- single triangles ---- */

static void a_plain_hit_and_plain_misses(void **state)
{
    (void)state;
    struct oracle_mesh mesh = make_mesh(corner_triangle, NULL, 1);
    struct oracle_answer answer = ask(&mesh, 1, make_ray(0.25f, 0.25f, 3, 0, 0, -2));
    assert_int_equal(answer.outcome, ORACLE_HIT);
    assert_float_equal(answer.t, 1.5, 1e-12);
    assert_true(answer.t_low < 1.5 && answer.t_high > 1.5 && answer.t_high - answer.t_low < 1e-5);
    assert_int_equal(answer.tied_count, 1);
    assert_int_equal(answer.tied[0].count, 1);
    assert_int_equal(answer.tied[0].instance, RAY_NO_INSTANCE);
    forget(&answer);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.75f, 0.75f, 3, 0, 0, -2)), ORACLE_MISS);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, 3, 0, 0, 2)), ORACLE_MISS);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, 3, 1, 0, 0)), ORACLE_MISS);
    assert_int_equal(outcome_of(&mesh, 0, make_ray(0.25f, 0.25f, 3, 0, 0, -2)), ORACLE_MISS);
}

static void the_interval_is_open_and_its_ends_are_uncertain(void **state)
{
    (void)state;
    struct oracle_mesh mesh = make_mesh(corner_triangle, NULL, 1);
    struct ray ray = make_ray(0.25f, 0.25f, 3, 0, 0, -1);
    const struct {
        float tmin, tmax;
        enum oracle_outcome outcome;
    } cases[] = {{2, 4, ORACLE_HIT},     {3, 4, ORACLE_UNCERTAIN}, {2, 3, ORACLE_UNCERTAIN},
                 {3.1f, 4, ORACLE_MISS}, {0, 2.9f, ORACLE_MISS},   {4, 2, ORACLE_MISS},
                 {NAN, 4, ORACLE_MISS},  {0, NAN, ORACLE_MISS},    {0, INFINITY, ORACLE_HIT}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        ray.tmin = cases[i].tmin;
        ray.tmax = cases[i].tmax;
        assert_int_equal(outcome_of(&mesh, 1, ray), cases[i].outcome);
    }
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, 0, 0, 0, -1)), ORACLE_UNCERTAIN);
}

static void facing_is_honoured_in_the_mesh_s_own_space(void **state)
{
    (void)state;
    static const float mirror[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0},
                       turn[12] = {-1, 0, 0, 0.5f, 0, 1, 0, 0, 0, 0, -1, 0};
    struct oracle_mesh mesh = make_mesh(corner_triangle, NULL, 1);
    const struct {
        const float *transform;
        float z;
        enum oracle_outcome front_culled, back_culled;
    } cases[] = {
        {NULL, 1, ORACLE_MISS, ORACLE_HIT},
        {NULL, -1, ORACLE_HIT, ORACLE_MISS}, /* the winding seen from +z is counter-clockwise */
        {mirror, -1, ORACLE_MISS, ORACLE_HIT},
        {mirror, 1, ORACLE_HIT, ORACLE_MISS}, /* -z of the world is +z of the mesh */
        {turn, -1, ORACLE_MISS, ORACLE_HIT},
        {turn, 1, ORACLE_HIT, ORACLE_MISS},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        mesh.transform = cases[i].transform;
        struct ray ray = make_ray(0.25f, 0.25f, cases[i].z, 0, 0, -cases[i].z);
        assert_int_equal(outcome_of(&mesh, 1, ray), ORACLE_HIT);
        ray.flags = RAY_CULL_FRONT_FACING;
        assert_int_equal(outcome_of(&mesh, 1, ray), cases[i].front_culled);
        ray.flags = RAY_CULL_BACK_FACING;
        assert_int_equal(outcome_of(&mesh, 1, ray), cases[i].back_culled);
    }
}

static void what_cannot_be_hit_is_missed(void **state)
{
    (void)state;
    const float odd[] = {NAN, INFINITY, -INFINITY};
    for (int which = 0; which < 3; which++)
        for (int component = 0; component < 9; component++) {
            float positions[9];
            memcpy(positions, corner_triangle, sizeof positions);
            positions[component] = odd[which];
            struct oracle_mesh mesh = make_mesh(positions, NULL, 1);
            assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, 3, 0, 0, -2)), ORACLE_MISS);
        }
    static const uint32_t repeated[3][3] = {{0, 0, 1}, {0, 1, 1}, {1, 0, 1}};
    for (int which = 0; which < 3; which++) {
        struct oracle_mesh mesh = make_mesh(corner_triangle, repeated[which], 1);
        assert_int_equal(outcome_of(&mesh, 1, make_ray(0.5f, 0, 3, 0, 0, -2)), ORACLE_MISS);
    }
    static const float on_a_line[9] = {0, 0, 0, 1, 0, 0, 2, 0, 0};
    struct oracle_mesh mesh = make_mesh(on_a_line, NULL, 1);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.5f, 0, 3, 0, 0, -2)), ORACLE_UNCERTAIN);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.5f, 0.001f, 3, 0, 0, -2)), ORACLE_MISS);
}

static void odd_rays(void **state)
{
    (void)state;
    struct oracle_mesh mesh = make_mesh(corner_triangle, NULL, 1);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, 3, 0, 0, 0)), ORACLE_MISS);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(NAN, 0.25f, 3, 0, 0, -1)), ORACLE_MISS);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, INFINITY, 0, 0, -1)), ORACLE_MISS);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, 3, 0, NAN, -1)), ORACLE_MISS);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, 3, 0, INFINITY, -1)), ORACLE_MISS);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, 3, 0, 0, -FLT_TRUE_MIN)), ORACLE_UNCERTAIN);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, 3, 0, 0, -0x1p-120f)), ORACLE_HIT);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, 3, 0, 0, -0x1p120f)), ORACLE_HIT);
}

/* ---- neighbours and ties ---- */

static void inner_edges_and_corners_are_certain(void **state)
{
    (void)state;
    /* A square of four triangles around its centre; the windings of the first two agree, the others are reversed. */
    static const float positions[15] = {-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0, 0.125f, 0.0625f, 0};
    static const uint32_t alike[12] = {0, 1, 4, 1, 2, 4, 2, 3, 4, 3, 0, 4},
                          mixed[12] = {0, 1, 4, 2, 1, 4, 2, 3, 4, 0, 3, 4};
    for (int turned = 0; turned < 2; turned++) {
        struct oracle_mesh mesh = make_mesh(positions, turned ? mixed : alike, 4);
        struct oracle_answer answer = ask(&mesh, 1, make_ray(0.125f, 0.0625f, 1, 0, 0, -1));
        assert_int_equal(answer.outcome, ORACLE_HIT);
        assert_int_equal(tied_triangles(&answer), 4);
        forget(&answer);
        answer = ask(&mesh, 1, make_ray(0.5625f, 0.53125f, 1, 0, 0, -1)); /* half way from the centre to corner 2 */
        assert_int_equal(answer.outcome, ORACLE_HIT);
        assert_int_equal(tied_triangles(&answer), 2); /* 1 and 2 */
        assert_int_equal(answer.tied[0].primitive + answer.tied[answer.tied_count - 1].primitive,
                         answer.tied_count == 1 ? 2 : 3);
        forget(&answer);
        mesh.primitive_count = 3; /* the centre is on the boundary now */
        assert_int_equal(outcome_of(&mesh, 1, make_ray(0.125f, 0.0625f, 1, 0, 0, -1)), ORACLE_UNCERTAIN);
        assert_int_equal(outcome_of(&mesh, 1, make_ray(1, 0, 1, 0, 0, -1)), ORACLE_UNCERTAIN);
        assert_int_equal(outcome_of(&mesh, 1, make_ray(-0.75f, 0, 1, 0, 0, -1)), ORACLE_MISS);
    }
}

static void a_fold_seen_from_aside_stays_uncertain(void **state)
{
    (void)state;
    /* Two triangles on the same side of their common edge, as at the silhouette of a solid. */
    static const float positions[12] = {0, -1, 0, 0, 1, 0, 1, 0, 1, 1, 0, -1};
    static const uint32_t indices[6] = {0, 1, 2, 1, 0, 3};
    struct oracle_mesh mesh = make_mesh(positions, indices, 2);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0, 0, 5, 0, 0, -1)), ORACLE_UNCERTAIN);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.01f, 0, 5, 0, 0, -1)), ORACLE_HIT);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(-0.01f, 0, 5, 0, 0, -1)), ORACLE_MISS);
}

static void a_sliver_thinner_than_an_ulp_leaves_no_gap(void **state)
{
    (void)state;
    const float x = nextafterf(1, 2);
    const float positions[15] = {0, 0, 0, 1, -1, 0, x, 0, 0, 1, 1, 0, 2, 0, 0};
    static const uint32_t indices[12] = {0, 1, 3, 1, 2, 3, 1, 4, 2, 2, 4, 3};
    struct oracle_mesh mesh = make_mesh(positions, indices, 4);
    struct oracle_answer answer = ask(&mesh, 1, make_ray(1, 0.5f, 1, 0, 0, -1));
    assert_int_equal(answer.outcome, ORACLE_HIT);
    assert_true(tied_triangles(&answer) >= 3);
    forget(&answer);
}

static void an_equal_edge_of_another_instance_settles_nothing(void **state)
{
    (void)state;
    static const float positions[12] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
    static const uint32_t indices[6] = {0, 1, 2, 0, 2, 3};
    struct oracle_mesh meshes[2] = {make_mesh(positions, indices, 1), make_mesh(positions, indices + 3, 1)};
    struct ray ray = make_ray(0.5f, 0.5f, 1, 0, 0, -1);
    meshes[1].geometry = 1;
    assert_int_equal(outcome_of(meshes, 2, ray), ORACLE_HIT);
    meshes[1].instance = 0;
    assert_int_equal(outcome_of(meshes, 2, ray), ORACLE_UNCERTAIN);
}

static void doubts_behind_the_answer_do_not_matter(void **state)
{
    (void)state;
    static const float positions[18] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0.25f, 0.25f, -1, 1, 0, -1, 0, 1, -1};
    struct oracle_mesh mesh = make_mesh(positions, NULL, 2);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, 1, 0, 0, -1)), ORACLE_HIT);
    assert_int_equal(outcome_of(&mesh, 1, make_ray(0.25f, 0.25f, -3, 0, 0, 1)), ORACLE_UNCERTAIN);
}

static struct ray_hit make_hit(uint32_t instance, uint32_t geometry, uint32_t primitive, float t)
{
    return (struct ray_hit){.t = t, .instance = instance, .geometry = geometry, .primitive = primitive};
}

static void coincident_triangles_are_tied_and_told_in_runs(void **state)
{
    (void)state;
    uint32_t indices[300];
    for (uint32_t i = 0; i < 300; i++)
        indices[i] = i % 3;
    struct oracle_mesh meshes[2] = {make_mesh(corner_triangle, indices, 100), make_mesh(corner_triangle, NULL, 1)};
    meshes[0].instance = 4;
    meshes[1].instance = 2;
    meshes[1].geometry = 7;
    struct oracle_answer answer = ask(meshes, 2, make_ray(0.25f, 0.25f, 1, 0, 0, -1));
    assert_int_equal(answer.outcome, ORACLE_HIT);
    assert_int_equal(answer.tied_count, 2);
    assert_int_equal(answer.tied[0].instance, 2);
    assert_int_equal(answer.tied[1].count, 100);
    const struct {
        struct ray_hit hit;
        enum oracle_verdict verdict;
    } cases[] = {
        {make_hit(4, 0, 0, 1), ORACLE_RIGHT},
        {make_hit(4, 0, 99, 1), ORACLE_RIGHT},
        {make_hit(4, 0, 100, 1), ORACLE_WRONG_PRIMITIVE},
        {make_hit(2, 7, 0, 1), ORACLE_RIGHT},
        {make_hit(2, 0, 0, 1), ORACLE_WRONG_PRIMITIVE},
        {make_hit(2, 7, 0, 1.001f), ORACLE_WRONG_HIT},
        {make_hit(2, 7, 0, NAN), ORACLE_WRONG_HIT},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_int_equal(oracle_judge(&answer, &cases[i].hit, NULL), cases[i].verdict);
    assert_int_equal(oracle_judge(&answer, NULL, NULL), ORACLE_WRONG_MISS);
    double t_rel_err = -1;
    struct ray_hit close = make_hit(4, 0, 5, 1 + FLT_EPSILON);
    assert_int_equal(oracle_judge(&answer, &close, &t_rel_err), ORACLE_RIGHT);
    assert_true(t_rel_err > 0 && t_rel_err < 2 * FLT_EPSILON);
    forget(&answer);
}

/* From afar, triangles 2^-17 apart are at the same distance to 32 significant bits, and 2^-14 apart they are not. */
static void triangles_at_equal_distances_are_tied(void **state)
{
    (void)state;
    const struct {
        float gap;
        uint32_t tied;
    } cases[] = {{0x1p-17f, 2}, {0x1p-14f, 1}};
    for (int i = 0; i < 2; i++) {
        const float low = 0.75f - cases[i].gap,
                    positions[18] = {0, 0, low, 1, 0, low, 0, 1, low, 0, 0, 0.75f, 1, 0, 0.75f, 0, 1, 0.75f};
        const struct oracle_mesh mesh = make_mesh(positions, NULL, 2);
        struct oracle_answer answer = ask(&mesh, 1, make_ray(0.25f, 0.25f, 49339.5f, 0, 0, -1));
        const struct ray_hit lower = make_hit(RAY_NO_INSTANCE, 0, 0, 49338.75f);
        assert_int_equal(answer.outcome, ORACLE_HIT);
        assert_int_equal(tied_triangles(&answer), cases[i].tied);
        assert_int_equal(oracle_judge(&answer, &lower, NULL),
                         cases[i].tied == 2 ? ORACLE_RIGHT : ORACLE_WRONG_PRIMITIVE);
        forget(&answer);
    }
}

static void misses_and_doubts_are_judged(void **state)
{
    (void)state;
    struct oracle_answer answer = {.outcome = ORACLE_MISS};
    struct ray_hit hit = make_hit(0, 0, 0, 1);
    double t_rel_err = -1;
    assert_int_equal(oracle_judge(&answer, NULL, &t_rel_err), ORACLE_RIGHT);
    assert_true(t_rel_err == 0);
    assert_int_equal(oracle_judge(&answer, &hit, NULL), ORACLE_WRONG_HIT);
    answer.outcome = ORACLE_UNCERTAIN;
    assert_int_equal(oracle_judge(&answer, NULL, NULL), ORACLE_UNDECIDED);
    assert_int_equal(oracle_judge(&answer, &hit, NULL), ORACLE_UNDECIDED);
}

/* ---- whole scenes ---- */

enum { RINGS = 24, SCENE_TRIANGLES = 2 * RINGS * RINGS, SCENE_RAYS = 700 };

/* A closed torus, so that every ray meets it an even number of times and every edge has a neighbour. */
static void make_torus(float positions[3 * RINGS * RINGS], uint32_t indices[3 * SCENE_TRIANGLES])
{
    for (uint32_t i = 0; i < RINGS * RINGS; i++) {
        double a = 6.283185307179586 * (i % RINGS) / RINGS, b = 6.283185307179586 * (double)(i / RINGS) / RINGS;
        positions[3 * i] = (float)((2 + cos(a)) * cos(b));
        positions[3 * i + 1] = (float)((2 + cos(a)) * sin(b));
        positions[3 * i + 2] = (float)sin(a);
        uint32_t right = i % RINGS + 1 < RINGS ? i + 1 : i + 1 - RINGS, up = (i + RINGS) % (RINGS * RINGS);
        uint32_t across = right % RINGS + up / RINGS * RINGS;
        const uint32_t quad[6] = {i, right, across, i, across, up};
        memcpy(indices + 6 * i, quad, sizeof quad);
    }
}

static const float scene_matrix[12] = {0.5f, -0.25f, 0.125f, 3, 0.375f, 1.5f, -0.5f, -2, 0.25f, 0, 0.75f, 1};

/* Makes a scene of three tori, and rays, many of which aim exactly at corners of the first torus. */
static void make_scene(struct oracle_mesh meshes[3], struct ray rays[SCENE_RAYS])
{
    static float positions[3 * RINGS * RINGS];
    static uint32_t indices[3 * SCENE_TRIANGLES];
    static const float mirror[12] = {-1, 0, 0, 1, 0, 1, 0, 3, 0, 0, 2, 0};
    make_torus(positions, indices);
    const float *transforms[3] = {NULL, scene_matrix, mirror};
    for (uint32_t i = 0; i < 3; i++)
        meshes[i] = (struct oracle_mesh){.positions = positions,
                                         .indices = indices,
                                         .primitive_count = SCENE_TRIANGLES,
                                         .transform = transforms[i],
                                         .instance = i,
                                         .geometry = i % 2};
    rays_make(meshes, 3, 5, SCENE_RAYS, rays);
    for (uint32_t i = 0; i < SCENE_RAYS; i += 3)
        for (int axis = 0; axis < 3; axis++)
            rays[i].direction[axis] = positions[3 * (i % (RINGS * RINGS)) + (uint32_t)axis] - rays[i].origin[axis];
}

static bool answers_equal(const struct oracle_answer *a, const struct oracle_answer *b)
{
    if (a->outcome != b->outcome || a->t != b->t || a->t_low != b->t_low || a->t_high != b->t_high ||
        a->t_end != b->t_end)
        return false;
    return a->tied_count == b->tied_count &&
           (!a->tied_count || memcmp(a->tied, b->tied, a->tied_count * sizeof *a->tied) == 0);
}

/*
 * Answers hold when all inputs of a scene are moved: the closest hit is one of the tied triangles, and a ray that
 * certainly hits never misses.
 */
static void whole_answers_hold_for_moved_rays(void **state)
{
    (void)state;
    struct oracle_mesh meshes[3];
    struct ray rays[SCENE_RAYS];
    struct oracle_answer answers[SCENE_RAYS];
    uint64_t random = 3;
    uint32_t outcomes[3] = {0, 0, 0};
    make_scene(meshes, rays);
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(oracle_trace(meshes, 1, rays, SCENE_RAYS, &memory, &parallel_serial, NULL, NULL, answers, NULL),
                     BVHD_OK);
    for (uint32_t i = 0; i < SCENE_RAYS; i++) {
        struct moved moved;
        long double closest = INFINITY;
        uint32_t primitive = 0;
        outcomes[answers[i].outcome]++;
        for (int axis = 0; axis < 3; axis++) {
            moved.origin[axis] = moved_value(rays[i].origin[axis], &random);
            moved.direction[axis] = moved_value(rays[i].direction[axis], &random);
        }
        for (uint32_t k = 0; k < SCENE_TRIANGLES; k++) {
            long double t;
            for (int c = 0; c < 9; c++)
                moved.corners[c / 3][c % 3] =
                    meshes[0].positions[3 * meshes[0].indices[3 * k + (uint32_t)(c / 3)] + (uint32_t)(c % 3)];
            if (!moved_meet(&moved, &t) || t <= 0 || t >= closest)
                continue;
            closest = t;
            primitive = k;
        }
        struct ray_hit hit = make_hit(0, 0, primitive, (float)closest);
        enum oracle_verdict verdict = oracle_judge(&answers[i], closest < INFINITY ? &hit : NULL, NULL);
        assert_true(verdict == ORACLE_RIGHT || verdict == ORACLE_UNDECIDED);
    }
    assert_true(outcomes[ORACLE_HIT] > SCENE_RAYS / 2 && outcomes[ORACLE_MISS] > SCENE_RAYS / 20 &&
                outcomes[ORACLE_UNCERTAIN] < SCENE_RAYS / 20);
    oracle_finish(answers, SCENE_RAYS, &memory);
    assert_int_equal(memory.live, 0);
}

struct progress {
    _Atomic uint64_t calls, last, total;
};

static void note_progress(void *context, uint64_t done, uint64_t total)
{
    struct progress *progress = context;
    progress->calls++;
    progress->last = done > progress->last ? done : progress->last;
    progress->total = total;
}

static void threads_change_nothing(void **state)
{
    (void)state;
    struct oracle_mesh meshes[3];
    struct ray rays[SCENE_RAYS];
    struct oracle_answer alone[SCENE_RAYS], together[SCENE_RAYS];
    struct workers *workers;
    struct progress progress = {0};
    make_scene(meshes, rays);
    memory_init(&memory, UINT64_MAX);
    assert_int_equal(workers_create(3, &workers, NULL), BVHD_OK);
    assert_int_equal(oracle_trace(meshes, 3, rays, SCENE_RAYS, &memory, &parallel_serial, NULL, NULL, alone, NULL),
                     BVHD_OK);
    assert_int_equal(oracle_trace(meshes, 3, rays, SCENE_RAYS, &memory, workers_parallel(workers), note_progress,
                                  &progress, together, NULL),
                     BVHD_OK);
    for (uint32_t i = 0; i < SCENE_RAYS; i++)
        assert_true(answers_equal(&alone[i], &together[i]));
    assert_true(progress.calls > 0 && progress.last == progress.total);
    assert_int_equal(progress.total, UINT64_C(3) * SCENE_TRIANGLES * SCENE_RAYS);
    workers_destroy(workers);
    oracle_finish(alone, SCENE_RAYS, &memory);
    oracle_finish(together, SCENE_RAYS, &memory);
    assert_int_equal(memory.live, 0);
}

static void every_failing_allocation_leaves_nothing_behind(void **state)
{
    (void)state;
    enum { RAYS = 30 };
    struct oracle_mesh meshes[3];
    struct ray rays[SCENE_RAYS];
    struct oracle_answer answers[RAYS];
    struct bvhd_error error;
    enum bvhd_status status = BVHD_NO_MEMORY;
    make_scene(meshes, rays);
    int64_t successes = 0;
    for (; status != BVHD_OK; successes++) {
        memory_init(&memory, UINT64_MAX);
        memory.fail_after = successes;
        status = oracle_trace(meshes, 1, rays, RAYS, &memory, &parallel_serial, NULL, NULL, answers, &error);
        if (status == BVHD_OK)
            break;
        assert_int_equal(status, BVHD_NO_MEMORY);
        assert_int_equal(error.status, BVHD_NO_MEMORY);
        assert_true(error.text[0] != 0);
        assert_int_equal(memory.live, 0);
    }
    assert_true(successes > RAYS / 2);
    oracle_finish(answers, RAYS, &memory);
    oracle_finish(NULL, 0, &memory);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_plain_hit_and_plain_misses),
        cmocka_unit_test(the_interval_is_open_and_its_ends_are_uncertain),
        cmocka_unit_test(facing_is_honoured_in_the_mesh_s_own_space),
        cmocka_unit_test(what_cannot_be_hit_is_missed),
        cmocka_unit_test(odd_rays),
        cmocka_unit_test(inner_edges_and_corners_are_certain),
        cmocka_unit_test(a_fold_seen_from_aside_stays_uncertain),
        cmocka_unit_test(a_sliver_thinner_than_an_ulp_leaves_no_gap),
        cmocka_unit_test(an_equal_edge_of_another_instance_settles_nothing),
        cmocka_unit_test(doubts_behind_the_answer_do_not_matter),
        cmocka_unit_test(coincident_triangles_are_tied_and_told_in_runs),
        cmocka_unit_test(triangles_at_equal_distances_are_tied),
        cmocka_unit_test(misses_and_doubts_are_judged),
        cmocka_unit_test(whole_answers_hold_for_moved_rays),
        cmocka_unit_test(threads_change_nothing),
        cmocka_unit_test(every_failing_allocation_leaves_nothing_behind),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
