/* SPDX-License-Identifier: Apache-2.0 */
/* test_rays.c - tests that test rays are reproducible, aim at primitives, and work at any magnitude. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>

#include "tests/support/builder/moved.h"

enum { SIDE = 12, VERTICES = (SIDE + 1) * (SIDE + 1), TRIANGLES = 2 * SIDE * SIDE, RAYS = 600 };

/* A bumpy sheet over [-1, 1]^2, multiplied by a scale and moved by an offset. */
struct sheet {
    float positions[3 * VERTICES];
    uint32_t indices[3 * TRIANGLES];
    struct oracle_mesh mesh;
};

static void sheet_init(struct sheet *sheet, double scale, double offset)
{
    for (uint32_t i = 0; i < VERTICES; i++) {
        double x = 2.0 * (i % (SIDE + 1)) / SIDE - 1, y = 2.0 * (double)(i / (SIDE + 1)) / SIDE - 1;
        sheet->positions[3 * i] = (float)(offset + scale * x);
        sheet->positions[3 * i + 1] = (float)(offset + scale * y);
        sheet->positions[3 * i + 2] = (float)(offset + scale * 0.3 * x * x * (1 - 2 * y * y));
    }
    for (uint32_t i = 0; i < SIDE * SIDE; i++) {
        uint32_t at = i / SIDE * (SIDE + 1) + i % SIDE;
        const uint32_t quad[6] = {at, at + 1, at + SIDE + 2, at, at + SIDE + 2, at + SIDE + 1};
        memcpy(sheet->indices + 6 * i, quad, sizeof quad);
    }
    sheet->mesh = (struct oracle_mesh){.positions = sheet->positions,
                                       .indices = sheet->indices,
                                       .primitive_count = TRIANGLES,
                                       .instance = RAY_NO_INSTANCE};
}

static bool hits_any(const struct oracle_mesh *mesh, const struct ray *ray)
{
    for (uint32_t i = 0; i < mesh->primitive_count; i++) {
        struct moved exact;
        long double t;
        for (int k = 0; k < 9; k++) {
            uint32_t vertex = mesh->indices[3 * i + (uint32_t)(k / 3)];
            const float *corner = mesh->positions + 3 * vertex;
            const float *row = mesh->transform ? mesh->transform + 4 * (k % 3) : NULL;
            exact.corners[k / 3][k % 3] = row ? (long double)row[0] * corner[0] + (long double)row[1] * corner[1] +
                                                    (long double)row[2] * corner[2] + row[3]
                                              : corner[k % 3];
        }
        for (int axis = 0; axis < 3; axis++) {
            exact.origin[axis] = ray->origin[axis];
            exact.direction[axis] = ray->direction[axis];
        }
        if (moved_meet(&exact, &t) && t > ray->tmin && t < ray->tmax)
            return true;
    }
    return false;
}

static void check_form(const struct ray *ray)
{
    double square = 0;
    for (int axis = 0; axis < 3; axis++) {
        assert_true(isfinite(ray->origin[axis]) && isfinite(ray->direction[axis]));
        square += (double)ray->direction[axis] * ray->direction[axis];
    }
    assert_true(fabs(square - 1) < 1e-6);
    assert_true(ray->tmin == 0 && ray->tmax == FLT_MAX);
    assert_int_equal(ray->cull_mask, 0xff);
    assert_int_equal(ray->flags, 0);
}

static void the_generator_is_splitmix64(void **state)
{
    (void)state;
    uint64_t seed = 1234567;
    assert_true(rays_random(&seed) == UINT64_C(6457827717110365317));
    assert_true(rays_random(&seed) == UINT64_C(3203168211198807973));
    double sum = 0, least = 1, most = 0;
    for (int i = 0; i < 100000; i++) {
        double value = rays_uniform(&seed);
        assert_true(value >= 0 && value < 1);
        sum += value;
        least = fmin(least, value);
        most = fmax(most, value);
    }
    assert_true(fabs(sum / 100000 - 0.5) < 0.01 && least < 0.001 && most > 0.999);
}

static void aimed_rays_hit_at_every_magnitude(void **state)
{
    (void)state;
    static const double magnitudes[][2] = {{1, 0},    {1e-20, 0}, {1e19, 0},    {1e37, 0},
                                           {3e38, 0}, {1e-40, 0}, {100, 10000}, {0.2, 0.1}};
    for (size_t i = 0; i < sizeof magnitudes / sizeof magnitudes[0]; i++) {
        struct sheet sheet;
        struct ray rays[RAYS];
        int aimed = 0, inside = 0;
        sheet_init(&sheet, magnitudes[i][0], magnitudes[i][1]);
        rays_make(&sheet.mesh, 1, i, RAYS, rays);
        for (int k = 0; k < RAYS; k++) {
            check_form(&rays[k]);
            *(k % 2 ? &inside : &aimed) += hits_any(&sheet.mesh, &rays[k]);
        }
        assert_true(aimed >= RAYS / 2 * 98 / 100);
        assert_true(inside > RAYS / 40 && inside < RAYS / 2 * 9 / 10);
    }
}

static void even_rays_start_outside_odd_ones_in_the_box(void **state)
{
    (void)state;
    struct sheet sheet;
    struct ray rays[RAYS];
    sheet_init(&sheet, 1, 0);
    rays_make(&sheet.mesh, 1, 11, RAYS, rays);
    int octants[8] = {0};
    for (int k = 0; k < RAYS; k++) {
        const float *o = rays[k].origin;
        bool in_box = fabsf(o[0]) <= 1 && fabsf(o[1]) <= 1 && fabsf(o[2]) <= 0.3f;
        bool near_box = fabsf(o[0]) <= 1.2f && fabsf(o[1]) <= 1.2f && fabsf(o[2]) <= 0.5f;
        assert_true(k % 2 ? near_box : !in_box);
        octants[(rays[k].direction[0] > 0) | (rays[k].direction[1] > 0) << 1 | (rays[k].direction[2] > 0) << 2]++;
    }
    for (int i = 0; i < 8; i++)
        assert_true(octants[i] > RAYS / 32);
}

static void the_seed_decides(void **state)
{
    (void)state;
    struct sheet sheet;
    struct ray a[RAYS], b[RAYS], c[RAYS];
    sheet_init(&sheet, 1, 0);
    memset(a, 1, sizeof a);
    memset(b, 2, sizeof b);
    rays_make(&sheet.mesh, 1, 5, RAYS, a);
    rays_make(&sheet.mesh, 1, 5, RAYS, b);
    rays_make(&sheet.mesh, 1, 6, RAYS, c);
    int same = 0;
    for (int k = 0; k < RAYS; k++) {
        assert_memory_equal(a[k].origin, b[k].origin, sizeof a[k].origin);
        assert_memory_equal(a[k].direction, b[k].direction, sizeof a[k].direction);
        same += memcmp(a[k].origin, c[k].origin, sizeof a[k].origin) == 0;
    }
    assert_int_equal(same, 0);
    /* The rays are the same on every machine; these two values check it. */
    assert_true(a[0].origin[0] == 1.91684508f && a[1].direction[2] == -0.716765881f);
}

static void unusable_triangles_are_not_aimed_at(void **state)
{
    (void)state;
    struct sheet sheet;
    struct ray rays[RAYS];
    sheet_init(&sheet, 1, 0);
    /* All triangles but one are inactive, infinite or degenerate, so that random picks do not find it. */
    for (uint32_t i = 0; i < TRIANGLES; i++) {
        if (i != 100)
            sheet.indices[3 * i] = i % 3 == 0 ? 0 : i % 3 == 1 ? 1 : sheet.indices[3 * i + 1];
    }
    memcpy(sheet.indices + 300, (const uint32_t[]){100, 101, 120}, 12);
    sheet.positions[0] = NAN;
    sheet.positions[5] = INFINITY;
    rays_make(&sheet.mesh, 1, 1, RAYS, rays);
    for (int k = 0; k < RAYS; k += 2)
        assert_true(hits_any(&sheet.mesh, &rays[k]));
    /* There is no usable triangle, and then no mesh. */
    sheet.indices[300] = 0;
    rays_make(&sheet.mesh, 1, 1, RAYS, rays);
    for (int k = 0; k < RAYS; k++)
        check_form(&rays[k]);
    rays_make(NULL, 0, 1, RAYS, rays);
    for (int k = 0; k < RAYS; k++)
        check_form(&rays[k]);
}

static void instances_are_aimed_at_where_they_stand(void **state)
{
    (void)state;
    static const float matrices[2][12] = {{0.1f, 0, 0, 50, 0, -0.2f, 0, 3, 0, 0, 0.1f, 0},
                                          {0, 1, 0, -50, 1, 0, 0, 0, 0, 0, 2, 9}};
    struct sheet sheet;
    struct ray rays[RAYS];
    sheet_init(&sheet, 1, 0);
    struct oracle_mesh meshes[2] = {sheet.mesh, sheet.mesh};
    meshes[0].transform = matrices[0];
    meshes[1].transform = matrices[1];
    meshes[1].primitive_count = TRIANGLES / 2;
    rays_make(meshes, 2, 4, RAYS, rays);
    int hits[2] = {0, 0};
    for (int k = 0; k < RAYS; k += 2)
        for (int i = 0; i < 2; i++)
            hits[i] += hits_any(&meshes[i], &rays[k]);
    assert_true(hits[0] + hits[1] >= RAYS / 2);
    assert_true(hits[0] > hits[1] * 3 / 2 && hits[0] < hits[1] * 3); /* the ratio is about two to one */
}

static void rays_come_near_where_an_ulp_would_miss(void **state)
{
    (void)state;
    /* A sheet of a millimetre with a far outlier: an ulp of the direction of a ray from outside is a metre there. */
    struct sheet sheet;
    struct ray rays[RAYS];
    sheet_init(&sheet, 1e-3, 0);
    sheet.positions[0] = 1e7f;
    rays_make(&sheet.mesh, 1, 2, RAYS, rays);
    int hits = 0;
    for (int k = 0; k < RAYS; k += 2)
        hits += hits_any(&sheet.mesh, &rays[k]);
    assert_true(hits >= RAYS / 2 * 98 / 100);
}

/* Chains of swept spheres, of which some ends have no radius, and spheres. */
static void round_shapes_are_aimed_at(void **state)
{
    (void)state;
    enum { COUNT = 40 };
    static const double scales[] = {1, 1e-19, 1e30};
    static const float matrix[12] = {0.5f, 0.25f, 0, 3, -1, 2, 0.5f, 0, 0, 0.125f, 0.75f, -2};
    uint64_t random = 5;
    for (int round = 0; round < 12; round++) {
        const double scale = scales[round % 3];
        float centres[2 * COUNT][3], radii[2 * COUNT];
        struct oracle_mesh mesh = {.shape = round % 2 ? ORACLE_SPHERES : ORACLE_SWEPT_SPHERES,
                                   .positions = centres[0],
                                   .radii = radii,
                                   .primitive_count = COUNT,
                                   .transform = round % 3 == 0 && round > 5 ? matrix : NULL};
        struct ray rays[RAYS];
        struct oracle_answer answers[RAYS];
        struct memory memory;
        int hits = 0;
        for (int k = 0; k < 2 * COUNT; k++) {
            for (int axis = 0; axis < 3; axis++)
                centres[k][axis] = (float)(scale * (2 * rays_uniform(&random) - 1));
            radii[k] = k % 7 == 0 ? 0 : (float)(scale * 0.05 * (0.1 + rays_uniform(&random)));
        }
        memory_init(&memory, UINT64_MAX);
        rays_make(&mesh, 1, 3, RAYS, rays);
        assert_int_equal(oracle_trace(&mesh, 1, rays, RAYS, &memory, &parallel_serial, NULL, NULL, answers, NULL),
                         BVHD_OK);
        for (int k = 0; k < RAYS; k += 2)
            hits += answers[k].outcome == ORACLE_HIT;
        assert_true(hits >= RAYS / 2 * 98 / 100);
        oracle_finish(answers, RAYS, &memory);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_generator_is_splitmix64),
        cmocka_unit_test(aimed_rays_hit_at_every_magnitude),
        cmocka_unit_test(even_rays_start_outside_odd_ones_in_the_box),
        cmocka_unit_test(the_seed_decides),
        cmocka_unit_test(unusable_triangles_are_not_aimed_at),
        cmocka_unit_test(instances_are_aimed_at_where_they_stand),
        cmocka_unit_test(rays_come_near_where_an_ulp_would_miss),
        cmocka_unit_test(round_shapes_are_aimed_at),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
