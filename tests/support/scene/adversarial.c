/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/adversarial.h"

#include <math.h>
#include <string.h>

/* Returns the smallest level of a sphere that has `size` triangles or more. */
static uint32_t level_for(uint32_t size)
{
    uint32_t level = 0;
    while (level < 10 && (UINT64_C(20) << 2 * level) < size)
        level++;
    return level;
}

static double bumps(const double d[3], const void *context)
{
    (void)context;
    return 0.2 * sin(5 * d[0] + 1) * sin(4 * d[1] - 2 * d[2]) + 0.05 * sin(17 * d[1] + 11 * d[0] * d[2]);
}

/* Adds the plain subject of many scenes: a closed, irregular surface of radius 1. */
static void add_subject(struct mesh *mesh, uint32_t size)
{
    static const double centre[3] = {0, 0, 0};
    mesh_add_sphere(mesh, centre, 1, level_for(size), bumps, NULL);
}

static void make_scaled(struct mesh *mesh, uint32_t size, double scale)
{
    add_subject(mesh, size);
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        for (int axis = 0; axis < 3; axis++)
            mesh->vertices[i][axis] = (float)(mesh->vertices[i][axis] * scale);
}

static void make_sphere(struct mesh *mesh, uint32_t size, struct random *random)
{
    static const double centre[3] = {0.5, -0.25, 3};
    (void)random;
    mesh_add_sphere(mesh, centre, 2, level_for(size), NULL, NULL);
}

/* A plane perpendicular to an axis: every box has zero thickness. */
static void make_grid(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t side = (uint32_t)ceil(sqrt(size / 2.0)) + 1;
    (void)random;
    for (uint32_t row = 0; row < side; row++)
        for (uint32_t column = 0; column < side; column++)
            mesh_add_vertex(mesh, column, 1.5, row);
    mesh_add_rows(mesh, 0, side, side, 0);
}

static void make_dup(struct mesh *mesh, uint32_t size, struct random *random)
{
    static const double corners[3][3] = {{0.1, 0.2, 0.3}, {1.1, 0.3, 0.4}, {0.2, 1.4, 0.6}};
    (void)random;
    for (uint32_t i = 0; i < size; i++)
        mesh_add_loose_triangle(mesh, corners[0], corners[1], corners[2]);
}

/* Triangles with one common centroid and sizes over 24 octaves. */
static void make_colocated(struct mesh *mesh, uint32_t size, struct random *random)
{
    for (uint32_t i = 0; i < size; i++) {
        double corners[3][3], scale = exp2(random_between(random, -20, 4));
        random_point(random, corners[0]);
        random_point(random, corners[1]);
        for (int axis = 0; axis < 3; axis++) {
            corners[0][axis] *= scale;
            corners[1][axis] *= scale;
            corners[2][axis] = -corners[0][axis] - corners[1][axis];
        }
        mesh_add_loose_triangle(mesh, corners[0], corners[1], corners[2]);
    }
}

/* Boxes with one common centre, and in groups equal extents. */
static void make_samecenter(struct mesh *mesh, uint32_t size, struct random *random)
{
    for (uint32_t i = 0; i < size; i++) {
        double r = exp2(floor(random_between(random, -12, 12)));
        double corners[3][3] = {
            {-r, -r, random_between(random, -r, r)}, {r, random_between(random, -r, r), -r}, {0, r, r}};
        mesh_add_loose_triangle(mesh, corners[0], corners[1], corners[2]);
    }
}

/* Long diagonals with an aspect ratio of 1e4. */
static void make_slivers(struct mesh *mesh, uint32_t size, struct random *random)
{
    for (uint32_t i = 0; i < size; i++) {
        double corners[3][3], along[3];
        random_point(random, corners[0]);
        random_point(random, along);
        double length = sqrt(along[0] * along[0] + along[1] * along[1] + along[2] * along[2]) + 1e-9;
        for (int axis = 0; axis < 3; axis++) {
            corners[1][axis] = corners[0][axis] + along[axis] / length;
            corners[2][axis] = corners[0][axis] + 0.5 * along[axis] / length + random_between(random, -1e-4, 1e-4);
        }
        mesh_add_loose_triangle(mesh, corners[0], corners[1], corners[2]);
    }
}

/* Replaces component `axis` of one vertex in a hundred. */
static void sprinkle(struct mesh *mesh, struct random *random, int axis, float value)
{
    for (uint32_t i = 0; i <= mesh->vertex_count / 100; i++)
        mesh->vertices[random_next(random) % mesh->vertex_count][axis] = value;
}

static void make_nan(struct mesh *mesh, uint32_t size, struct random *random)
{
    add_subject(mesh, size);
    sprinkle(mesh, random, 0, NAN);
}

static void make_nan_inf(struct mesh *mesh, uint32_t size, struct random *random)
{
    add_subject(mesh, size);
    sprinkle(mesh, random, 1, NAN);
    sprinkle(mesh, random, 2, INFINITY);
    sprinkle(mesh, random, 0, -INFINITY);
}

static void make_large(struct mesh *mesh, uint32_t size, struct random *random)
{
    (void)random;
    make_scaled(mesh, size, 1e19);
}

static void make_huge(struct mesh *mesh, uint32_t size, struct random *random)
{
    (void)random;
    make_scaled(mesh, size, 1e37);
}

static void make_tiny(struct mesh *mesh, uint32_t size, struct random *random)
{
    (void)random;
    make_scaled(mesh, size, 1e-20);
}

static void make_denormal(struct mesh *mesh, uint32_t size, struct random *random)
{
    (void)random;
    make_scaled(mesh, size, 1e-41);
}

/* A subject of radius 10 at a million from the origin, where an ulp is 0.06. */
static void make_offset(struct mesh *mesh, uint32_t size, struct random *random)
{
    (void)random;
    make_scaled(mesh, size, 10);
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        for (int axis = 0; axis < 3; axis++)
            mesh->vertices[i][axis] += 1e6f;
}

static void make_outlier(struct mesh *mesh, uint32_t size, struct random *random)
{
    static const double corners[3][3] = {{1e7, 1e7, 1e7}, {1e7 + 1, 1e7, 1e7}, {1e7, 1e7 + 1, 1e7}};
    (void)random;
    add_subject(mesh, size);
    mesh_add_loose_triangle(mesh, corners[0], corners[1], corners[2]);
}

/*
 * Distances that grow by half from one triangle to the next, in chains of 200 along three axes, which give the deepest
 * trees.
 */
static void make_expchain(struct mesh *mesh, uint32_t size, struct random *random)
{
    enum { LINKS = 200 };
    for (uint32_t i = 0; i < size; i++) {
        double at = 1e-17 * pow(1.5, i % LINKS), aside = 1e-3 * at * (i / LINKS + 1);
        int axis = (int)(i / LINKS % 3);
        double corners[3][3] = {{0}};
        for (int k = 0; k < 3; k++) {
            corners[k][axis] = at * (1 + 0.1 * k);
            corners[k][(axis + 1) % 3] = aside * (k == 1 ? 2 : 1);
            corners[k][(axis + 2) % 3] = random_between(random, 0.9, 1.1) * aside * k;
        }
        mesh_add_loose_triangle(mesh, corners[0], corners[1], corners[2]);
    }
}

/* A strip of 10 km by 10 m, one row of triangles that share their edges, through which no ray may pass. */
static void make_strip(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t columns = size / 2 + 2;
    for (int side = 0; side < 2; side++)
        for (uint32_t column = 0; column < columns; column++)
            mesh_add_vertex(mesh, 10000.0 * column / (columns - 1), random_between(random, -1, 1), 10 * side);
    mesh_add_rows(mesh, 0, 2, columns, 0);
}

/* Points and segments, and one real triangle in fifty. */
static void make_degenerate(struct mesh *mesh, uint32_t size, struct random *random)
{
    for (uint32_t i = 0; i < size; i++) {
        double corners[3][3];
        for (int k = 0; k < 3; k++)
            random_point(random, corners[k]);
        if (i % 50 != 0)
            memcpy(corners[1], corners[0], sizeof corners[0]);
        if (i % 50 != 0 && i % 2 == 0)
            memcpy(corners[2], corners[0], sizeof corners[0]);
        mesh_add_loose_triangle(mesh, corners[0], corners[1], corners[2]);
    }
}

/* Wavy strands from a common centre, whose boxes overlap everywhere. */
static void make_hairball(struct mesh *mesh, uint32_t size, struct random *random)
{
    enum { LINKS = 20, TRIANGLES = LINKS * 6 };
    for (uint32_t strand = 0; strand <= size / TRIANGLES; strand++) {
        double at[3] = {0}, way[3];
        random_point(random, way);
        uint32_t first = mesh->vertex_count;
        for (int link = 0; link <= LINKS; link++) {
            for (int axis = 0; axis < 3; axis++) {
                at[axis] += way[axis] * 0.1;
                way[axis] += random_between(random, -0.6, 0.6);
            }
            mesh_add_vertex(mesh, at[0] + 0.01, at[1], at[2]);
            mesh_add_vertex(mesh, at[0] - 0.005, at[1] + 0.008, at[2]);
            mesh_add_vertex(mesh, at[0] - 0.005, at[1] - 0.004, at[2] + 0.007);
        }
        mesh_add_rows(mesh, first, LINKS + 1, 3, 1);
    }
}

/* A ground of 20 km in two triangles, a bowl of 300 m, a ball of 15 cm and one of 3 mm: seven decades of size. */
static void make_stadium(struct mesh *mesh, uint32_t size, struct random *random)
{
    static const double bowl[6][2] = {{60, 0.5}, {80, 6}, {100, 16}, {130, 32}, {150, 50}, {151, 51}};
    static const double ball[3] = {1, 0.15, 2}, bead[3] = {1.2, 0.003, 2.1};
    (void)random;
    uint32_t first = mesh_add_vertex(mesh, -10000, 0, -10000), level = level_for(size / 4);
    mesh_add_vertex(mesh, -10000, 0, 10000);
    mesh_add_vertex(mesh, 10000, 0, 10000);
    mesh_add_vertex(mesh, 10000, 0, -10000);
    mesh_add_quad(mesh, first, first + 1, first + 2, first + 3);
    mesh_add_lathe(mesh, bowl, 6, size / 20 + 3);
    mesh_add_sphere(mesh, ball, 0.15, level, bumps, NULL);
    mesh_add_sphere(mesh, bead, 0.003, level, bumps, NULL);
}

static const struct adversarial scenes[] = {
    {"sphere", "nothing: the plain case", make_sphere},
    {"grid", "zero-thickness boxes, zero exponents in quantised nodes", make_grid},
    {"dup", "identical triangles that nothing separates", make_dup},
    {"colocated", "one centroid, 24 octaves of size", make_colocated},
    {"samecenter", "boxes of one centre: all bins and codes equal", make_samecenter},
    {"slivers", "diagonals of aspect 1e4: split blow-up, missed edges", make_slivers},
    {"nan", "NaN in x: inactive triangles", make_nan},
    {"nan-inf", "NaN in y, infinities in x and z", make_nan_inf},
    {"large", "coordinates of 1e19: areas overflow", make_large},
    {"huge", "coordinates of 1e37: squares overflow", make_huge},
    {"tiny", "coordinates of 1e-20: areas underflow", make_tiny},
    {"denormal", "all coordinates denormal", make_denormal},
    {"offset", "far from the origin: an ulp is 0.06", make_offset},
    {"outlier", "one triangle 1e7 away", make_outlier},
    {"expchain", "exponential spacing: the deepest trees", make_expchain},
    {"strip", "a long strip of shared edges: watertightness", make_strip},
    {"degenerate", "points and segments", make_degenerate},
    {"hairball-small", "strands that overlap everywhere", make_hairball},
    {"stadium-like", "seven decades of size", make_stadium},
};

const struct adversarial *adversarial_scenes(uint32_t *ret_count)
{
    *ret_count = sizeof scenes / sizeof scenes[0];
    return scenes;
}

const struct adversarial *adversarial_find(const char *name)
{
    for (size_t i = 0; i < sizeof scenes / sizeof scenes[0]; i++)
        if (strcmp(scenes[i].name, name) == 0)
            return &scenes[i];
    return NULL;
}
