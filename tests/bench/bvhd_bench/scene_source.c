/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/scene_source.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/scene/adversarial.h"
#include "tests/bench/bvhd_bench/scene_model.h"
#include "tests/bench/bvhd_bench/scene_variety.h"
#include "tests/bench/bvhd_bench/tree.h"

enum { SOURCES_MAX = 64 };

/* Parallel triangles around one axis, each within the next: every box contains all smaller ones. */
static void make_nested(struct mesh *mesh, uint32_t size, struct random *random)
{
    (void)random;
    for (uint32_t i = 0; i < size; i++) {
        double r = (i + 1.0) / size, y = 1e-3 * r;
        double corners[3][3] = {{-r, y, -r}, {r, y, -r}, {0, y, r}};
        mesh_add_loose_triangle(mesh, corners[0], corners[1], corners[2]);
    }
}

/* Every triangle of a sphere three times, each time with its own vertices: ties everywhere. */
static void make_coincident(struct mesh *mesh, uint32_t size, struct random *random)
{
    static const double centre[3] = {1, 2, 3};
    uint32_t level = 0;
    (void)random;
    while (level < 8 && (UINT64_C(60) << 2 * level) < size)
        level++;
    for (int copy = 0; copy < 3; copy++)
        mesh_add_sphere(mesh, centre, 1, level, NULL, NULL);
}

/* A ball of 20 um, which is smaller than absolute epsilons. */
static void make_micro(struct mesh *mesh, uint32_t size, struct random *random)
{
    static const double centre[3] = {0, 0, 0};
    uint32_t level = 0;
    (void)random;
    while (level < 8 && (UINT64_C(20) << 2 * level) < size)
        level++;
    mesh_add_sphere(mesh, centre, 1e-5, level, NULL, NULL);
}

/*
 * Balls of 10 cm at distances of 10 km, one of them far away: the boxes on grids of eight bits are much larger than
 * their contents.
 */
static void make_islands(struct mesh *mesh, uint32_t size, struct random *random)
{
    enum { ISLANDS = 9 };
    uint32_t level = 0;
    while (level < 8 && (UINT64_C(20) * ISLANDS << 2 * level) < size)
        level++;
    for (int i = 0; i < ISLANDS; i++) {
        double centre[3];
        for (int axis = 0; axis < 3; axis++)
            centre[axis] = random_between(random, -1, 1) * (i == 0 ? 1e6 : 1e4);
        mesh_add_sphere(mesh, centre, 0.1, level, NULL, NULL);
    }
}

/* Long thin diagonals across each other, whose references multiply without end in spatial splits. */
static void make_sticks(struct mesh *mesh, uint32_t size, struct random *random)
{
    for (uint32_t i = 0; i < size / 2; i++) {
        double a[3], b[3], c[3], d[3];
        random_point(random, a);
        for (int axis = 0; axis < 3; axis++) {
            b[axis] = -a[axis] + random_between(random, -0.1, 0.1);
            c[axis] = b[axis] + 2e-3;
            d[axis] = a[axis] - 2e-3;
        }
        mesh_add_loose_triangle(mesh, a, b, c);
        mesh_add_loose_triangle(mesh, a, b, d);
    }
}

/* All corners are NaN, so that nothing can be hit. */
static void make_nothing(struct mesh *mesh, uint32_t size, struct random *random)
{
    static const double corners[3][3] = {{NAN, 0, 0}, {NAN, 1, 0}, {NAN, 0, 1}};
    (void)random;
    for (uint32_t i = 0; i < size; i++)
        mesh_add_loose_triangle(mesh, corners[0], corners[1], corners[2]);
}

/* Triangles from 1e-30 to 1e30, log-uniform, each as large as its distance from the origin. */
static void make_decades(struct mesh *mesh, uint32_t size, struct random *random)
{
    for (uint32_t i = 0; i < size; i++) {
        double corners[3][3], scale = pow(10, random_between(random, -30, 30));
        for (int k = 0; k < 3; k++) {
            random_point(random, corners[k]);
            for (int axis = 0; axis < 3; axis++)
                corners[k][axis] *= scale;
        }
        mesh_add_loose_triangle(mesh, corners[0], corners[1], corners[2]);
    }
}

/* One level of triangles over a plane that is displaced by about an ulp: the boxes are flat but for rounding. */
static void make_almost_flat(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t side = (uint32_t)sqrt(size / 2.0) + 2;
    for (uint32_t row = 0; row < side; row++)
        for (uint32_t column = 0; column < side; column++)
            mesh_add_vertex(mesh, column, 1000 + random_between(random, 0, 1.3e-4), row);
    mesh_add_rows(mesh, 0, side, side, 0);
}

static const struct adversarial more[] = {
    {"nested", "each box holds all smaller ones", make_nested},
    {"coincident", "every triangle three times: ties", make_coincident},
    {"micro", "20 um across: absolute epsilons", make_micro},
    {"islands", "10 cm balls 10 km apart: quantisation", make_islands},
    {"sticks", "diagonals across each other: split blow-up", make_sticks},
    {"decades", "60 decades of size", make_decades},
    {"almost-flat", "flat but for an ulp", make_almost_flat},
    {"nothing", "all NaN: nothing to hit", make_nothing},
};

enum { MORE = sizeof more / sizeof more[0] };

/* The scene of that index; hard scenes come first. */
static struct adversarial numbered(uint32_t index)
{
    uint32_t hard, ordinary, various;
    const struct adversarial *scenes = adversarial_scenes(&hard), *models = scene_model_all(&ordinary);
    if (index < hard)
        return scenes[index];
    index -= hard;
    if (index < MORE)
        return more[index];
    index -= MORE;
    return index < ordinary ? models[index] : scene_variety_all(&various)[index - ordinary];
}

const struct scene_source *scene_source_all(uint32_t *ret_count)
{
    static struct scene_source sources[SOURCES_MAX];
    uint32_t hard, ordinary, various, count;
    adversarial_scenes(&hard);
    scene_model_all(&ordinary);
    scene_variety_all(&various);
    hard += MORE;
    count = hard + ordinary + various < SOURCES_MAX ? hard + ordinary + various : SOURCES_MAX;
    for (uint32_t i = 0; i < count; i++)
        sources[i] = (struct scene_source){numbered(i).name, numbered(i).shows, i < hard};
    *ret_count = count;
    return sources;
}

static struct ply *generate(const struct adversarial *scene, uint32_t size, uint64_t seed)
{
    struct mesh mesh = {0};
    struct random random = {seed};
    struct ply *ply = tree_need(1, sizeof *ply);
    scene->make(&mesh, size, &random);
    *ply = (struct ply){mesh.vertex_count, mesh.triangle_count, (float *)mesh.vertices, (uint32_t *)mesh.triangles};
    return ply;
}

struct ply *scene_source_open(const char *name, uint32_t size, uint64_t seed)
{
    uint32_t count;
    const struct scene_source *sources = scene_source_all(&count);
    size_t length = strcspn(name, "@");
    if (name[length])
        sscanf(name + length, "@%" SCNu64 "@%" SCNu32, &seed, &size);
    for (uint32_t i = 0; i < count; i++)
        if (strncmp(sources[i].name, name, length) == 0 && !sources[i].name[length]) {
            struct adversarial scene = numbered(i);
            return generate(&scene, size, seed);
        }
    return ply_read(name);
}
