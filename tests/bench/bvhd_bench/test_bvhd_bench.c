/* SPDX-License-Identifier: Apache-2.0 */
/* test_bvhd_bench.c - tests that the parts of bvhd-bench compute what is known for small cases. */
#include "tests/support/unit.h"

#include <math.h>
#include <string.h>

#include "tests/bench/bvhd_bench/choice.h"
#include "tests/bench/bvhd_bench/scene_source.h"
#include "tests/bench/bvhd_bench/surface.h"
#include "tests/bench/bvhd_bench/sweep.h"

/* Two right triangles with legs of 1 in the plane z = 0, ten apart. */
static float positions[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 10, 0, 0, 11, 0, 0, 10, 1, 0};
static uint32_t indices[] = {0, 1, 2, 3, 4, 5};
static const struct ply pair = {6, 2, positions, indices};
static const struct primitive_ref pair_refs[] = {{{0, 0, 0}, 0, {1, 1, 0}, 0}, {{10, 0, 0}, 0, {11, 1, 0}, 1}};
/* A ray from above at the first of them. */
static const struct ray down = {.origin = {0.2f, 0.2f, 5}, .direction = {0, 0, -1}, .tmax = 100, .cull_mask = 0xff};

static void test_statistic(void **state)
{
    struct statistic values = {.count = 0};
    (void)state;
    assert_true(statistic_median(&values) == 0 && statistic_least(&values) == 0 && statistic_most(&values) == 0);
    statistic_add(&values, 5);
    statistic_add(&values, 1);
    assert_true(statistic_median(&values) == 3 && statistic_mad(&values) == 2);
    statistic_add(&values, 100);
    assert_true(statistic_median(&values) == 5 && statistic_mad(&values) == 4);
    assert_true(statistic_least(&values) == 1 && statistic_most(&values) == 100);
    for (int i = 0; i < 2 * STATISTIC_MAX; i++)
        statistic_add(&values, 7);
    assert_int_equal(values.count, STATISTIC_MAX);
}

static void test_sweep(void **state)
{
    struct tree tree = sweep_build(pair_refs, 2);
    (void)state;
    assert_int_equal(tree.node_count, 3);
    assert_int_equal(tree_depth(&tree), 2);
    assert_true(fabs(tree_sah(&tree) - 13.0 / 11) < 1e-12);
    assert_true(tree_overlap(&tree, &pair, 100) == 0);
    struct tree_work work = tree_trace(&tree, &pair, &down, 1);
    assert_true(work.inner == 1 && work.triangles == 1);
    tree_finish(&tree);
    tree = sweep_build(pair_refs, 0);
    assert_true(tree_sah(&tree) == 0 && tree_depth(&tree) == 0 && tree_trace(&tree, &pair, &down, 1).inner == 0);
    tree_finish(&tree);
}

/* Equal refs become one leaf, because no split is cheaper. */
static void test_sweep_ties(void **state)
{
    const struct primitive_ref refs[] = {pair_refs[0], pair_refs[0], pair_refs[0]};
    struct tree tree = sweep_build(refs, 3);
    (void)state;
    assert_int_equal(tree.node_count, 1);
    assert_true(tree_sah(&tree) == 3);
    tree_finish(&tree);
}

/*
 * The second triangle is a hundred times as large as the first. The third, which is a line, and the fourth, with a NaN
 * corner, have no points.
 */
static void test_surface(void **state)
{
    float corners[] = {0,  0, 0, 1,  0, 0, 0,  1, 0, 20, 0, 0, 30,  0, 0, 20, 10, 0,
                       40, 0, 0, 50, 0, 0, 60, 0, 0, 70, 0, 0, NAN, 0, 0, 70, 1,  0};
    uint32_t each[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11};
    const struct ply mesh = {12, 4, corners, each};
    struct surface surface = surface_of(&mesh);
    struct random random = {1};
    uint32_t by_area[4] = {0}, alike[4] = {0};
    double normal[3];
    (void)state;
    for (int i = 0; i < 10000; i++) {
        struct surface_point point = surface_draw(&surface, &random);
        by_area[point.triangle]++;
        point = surface_draw_triangle(&surface, &random);
        alike[point.triangle]++;
        const double *p = point.position, size = point.triangle ? 10 : 1, x = p[0] - (point.triangle ? 20 : 0);
        assert_true(x >= 0 && p[1] >= 0 && x + p[1] <= size * (1 + 1e-12) && p[2] == 0);
    }
    assert_true(by_area[0] > 50 && by_area[0] < 150 && by_area[0] + by_area[1] == 10000);
    assert_true(alike[0] > 4800 && alike[0] < 5200 && alike[0] + alike[1] == 10000);
    surface_normal(&mesh, 1, normal);
    assert_true(normal[0] == 0 && normal[1] == 0 && normal[2] == 1);
    surface_finish(&surface);
    surface_finish(&surface);
    const struct ply line = {12, 2, corners, each + 6};
    surface = surface_of(&line);
    assert_int_equal(surface.count, 0);
    surface_finish(&surface);
}

/* Both leaves are as large as the root. */
static void test_overlap(void **state)
{
    const struct box all = {{0, 0, 0}, {11, 1, 0}};
    struct tree_node nodes[] = {{all, 1, 2, 0}, {all, 0, 0, 1}, {all, 1, 0, 1}};
    uint32_t refs[] = {0, 1};
    const struct tree tree = {3, 2, nodes, refs};
    (void)state;
    assert_true(tree_sah(&tree) == 3);
    assert_true(tree_overlap(&tree, &pair, 100) == 1);
    struct tree_work work = tree_trace(&tree, &pair, &down, 1);
    assert_true(work.inner == 1 && work.triangles == 2);
}

/* Adds a method `name` to the scene, which took `ms` to build and traces `mrays`. */
static void put(struct results *results, struct measure_options *options, const char *name, double ms, double mrays)
{
    struct figures *figures = &results->scenes[0].methods[options->method_count];
    options->methods[options->method_count++] = figures->method = method_find(name);
    assert_non_null(figures->method);
    statistic_add(&figures->ms[0], ms / 2);
    statistic_add(&figures->ms[1], ms);
    statistic_add(&figures->mrays[RAYS_DIFFUSE], mrays);
}

static void test_choice(void **state)
{
    static struct measure_options options;
    static struct scene_figures scene = {.name = "scene", .triangles = 1000};
    struct results results = {&options, &scene, 1};
    struct choice choice;
    (void)state;
    put(&results, &options, "fast", 1, 1);
    put(&results, &options, "balanced", 2, 2);
    assert_false(choice_of(&results, 0, 0, &choice));
    put(&results, &options, "high", 20, 4);
    for (int hint = 0; hint < CHOICE_HINTS; hint++)
        put(&results, &options, choice_method(hint), 2, 2);
    /* A tenth of a ray a primitive takes 0.1 ms with fast; 100 take 25 ms with high. */
    assert_true(choice_of(&results, 0, 0, &choice));
    assert_string_equal(choice.best, "fast");
    assert_true(fabs(choice.best_ms - 1.1) < 1e-9 && fabs(choice.auto_ms - 2.05) < 1e-9 && !choice.is_good);
    assert_true(choice_of(&results, 0, 3, &choice));
    assert_string_equal(choice.best, "high");
    assert_true(choice_of(&results, 0, 2, &choice));
    assert_string_equal(choice.best, "balanced");
    assert_true(choice.is_good);
}

static void test_means(void **state)
{
    static struct measure_options options;
    static struct scene_figures scenes[2] = {{.name = "a", .triangles = 1000}, {.name = "b", .triangles = 1000}};
    struct results results = {&options, scenes, 1};
    (void)state;
    put(&results, &options, "fast", 1, 1);
    put(&results, &options, "balanced", 2, 2);
    results.scene_count = 2;
    scenes[1].methods[0] = scenes[0].methods[0];
    statistic_add(&scenes[1].methods[1].ms[1], 8);
    struct mean mean = mean_of(&results, "balanced", "fast", FIGURE_RATE_ONE);
    assert_int_equal(mean.count, 2);
    assert_true(fabs(mean.value - 0.25) < 1e-12 && fabs(mean.least - 0.125) < 1e-12);
    assert_string_equal(mean.least_scene, "b");
    assert_string_equal(mean.most_scene, "a");
    assert_int_equal(mean_of(&results, "balanced", "fast", FIGURE_SAH).count, 0);
    assert_int_equal(mean_of(&results, "high", NULL, FIGURE_RATE_ONE).count, 0);
    /* A method that failed on a scene has no figure there. */
    strcpy(scenes[1].methods[1].failure, "crashed");
    assert_int_equal(mean_of(&results, "balanced", "fast", FIGURE_RATE_ONE).count, 1);
}

/* Every generated scene has triangles, a unique name, and indices in range. */
static void test_scenes(void **state)
{
    uint32_t count;
    const struct scene_source *sources = scene_source_all(&count);
    (void)state;
    assert_true(count >= 20);
    for (uint32_t i = 0; i < count; i++) {
        struct ply *mesh = scene_source_open(sources[i].name, 300, 1);
        assert_non_null(mesh);
        assert_true(mesh->triangle_count > 0);
        for (uint32_t k = 0; k < 3 * mesh->triangle_count; k++)
            assert_true(mesh->indices[k] < mesh->vertex_count);
        ply_free(mesh);
        for (uint32_t k = 0; k < i; k++)
            assert_string_not_equal(sources[i].name, sources[k].name);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_statistic), cmocka_unit_test(test_sweep),   cmocka_unit_test(test_sweep_ties),
        cmocka_unit_test(test_overlap),   cmocka_unit_test(test_surface), cmocka_unit_test(test_choice),
        cmocka_unit_test(test_means),     cmocka_unit_test(test_scenes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
