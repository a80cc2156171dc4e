/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/scene_model.h"

#include <math.h>
#include <string.h>

/* The position of a part of a scene, and its rotation around the upright axis. */
struct stand {
    double x, y, z, angle;
};

static uint32_t add_at(struct mesh *mesh, const struct stand *stand, double x, double y, double z)
{
    double cosine = cos(stand->angle), sine = sin(stand->angle);
    return mesh_add_vertex(mesh, stand->x + cosine * x - sine * z, stand->y + y, stand->z + sine * x + cosine * z);
}

/* Adds a block with half sizes x and z; a roof replaces the flat top by a ridge of that height. */
static void add_block(struct mesh *mesh, const struct stand *stand, double x, double height, double z, double roof)
{
    static const double signs[4][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}};
    uint32_t first = mesh->vertex_count;
    for (int i = 0; i < 8; i++)
        add_at(mesh, stand, signs[i % 4][0] * x, i < 4 ? 0 : height, signs[i % 4][1] * z);
    for (uint32_t i = 0; i < 4; i++)
        mesh_add_quad(mesh, first + i, first + (i + 1) % 4, first + 4 + (i + 1) % 4, first + 4 + i);
    if (roof > 0) {
        uint32_t a = add_at(mesh, stand, -x, height + roof, 0), b = add_at(mesh, stand, x, height + roof, 0);
        mesh_add_quad(mesh, first + 4, first + 5, b, a);
        mesh_add_quad(mesh, first + 7, first + 6, b, a);
        mesh_add_triangle(mesh, first + 4, first + 7, a);
        mesh_add_triangle(mesh, first + 5, first + 6, b);
    } else
        mesh_add_quad(mesh, first + 4, first + 5, first + 6, first + 7);
}

static void add_column(struct mesh *mesh, double x, double z, double radius, double height, uint32_t sides)
{
    mesh_add_tube(mesh, (double[3]){x, 0, z}, (double[3]){x, height, z}, radius, 0.9 * radius, sides);
}

static double log_between(struct random *random, double low, double high)
{
    return exp(random_between(random, log(low), log(high)));
}

/* Halls side by side: large walls, columns of long thin triangles, furniture, and a vase in each. */
static void make_rooms(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t sides = 12 + (uint32_t)random_between(random, 0, 20), columns = 4 + (uint32_t)random_between(random, 0, 6);
    uint32_t side = (uint32_t)sqrt(size / 900.0) + 1;
    double wide = random_between(random, 6, 14), high = random_between(random, 3, 9);
    for (uint32_t room = 0; mesh->triangle_count < size; room++) {
        double x = wide * (room % side), z = wide * (room / side);
        add_block(mesh, &(struct stand){x, 0, z, 0}, wide / 2, high, wide / 2, 0);
        for (uint32_t i = 0; i < columns; i++)
            add_column(mesh, x + wide * (i % 2 ? 0.3 : -0.3), z + wide * (i / 2 / (columns / 2.0) - 0.4), 0.25, high,
                       sides);
        for (int i = 0; i < 30; i++) {
            struct stand stand = {x + random_between(random, -0.4, 0.4) * wide, 0,
                                  z + random_between(random, -0.4, 0.4) * wide, random_between(random, 0, 6.3)};
            add_block(mesh, &stand, log_between(random, 0.05, 1), log_between(random, 0.05, 1.5),
                      log_between(random, 0.05, 1), 0);
        }
        double centre[3] = {x, high / 3, z};
        mesh_add_sphere(mesh, centre, high / 9, 2, NULL, NULL);
    }
}

static double hill_at(const double waves[4][4], double x, double z)
{
    double height = 0;
    for (int i = 0; i < 4; i++)
        height += waves[i][0] * sin(waves[i][1] * x + waves[i][2] * z + waves[i][3]);
    return height;
}

static void draw_waves(struct random *random, double waves[4][4])
{
    for (int i = 0; i < 4; i++) {
        waves[i][0] = log_between(random, 0.02, 0.3) / (1 + i);
        waves[i][1] = random_between(random, -3, 3) * (1 << i);
        waves[i][2] = random_between(random, -3, 3) * (1 << i);
        waves[i][3] = random_between(random, 0, 6.3);
    }
}

/* A surface over a square, with some roughness. */
static void add_hills(struct mesh *mesh, uint32_t side, double rough, const double waves[4][4], struct random *random)
{
    uint32_t first = mesh->vertex_count;
    for (uint32_t row = 0; row < side; row++)
        for (uint32_t column = 0; column < side; column++) {
            double x = 4.0 * column / side - 2, z = 4.0 * row / side - 2;
            mesh_add_vertex(mesh, x, hill_at(waves, x, z) + random_between(random, -rough, rough) * 4 / side, z);
        }
    mesh_add_rows(mesh, first, side, side, 0);
}

static void make_terrain(struct mesh *mesh, uint32_t size, struct random *random)
{
    double waves[4][4];
    draw_waves(random, waves);
    add_hills(mesh, (uint32_t)sqrt(size / 2.0) + 2, random_between(random, 0, 0.5), (const double(*)[4])waves, random);
}

/* Houses with roofs over coarse ground: long walls at all angles. */
static void make_town(struct mesh *mesh, uint32_t size, struct random *random)
{
    double waves[4][4], scale = 2 / sqrt(size / 16.0);
    draw_waves(random, waves);
    add_hills(mesh, (uint32_t)sqrt(size * random_between(random, 0.05, 0.2)) + 2, 0.2, (const double(*)[4])waves,
              random);
    while (mesh->triangle_count < size) {
        struct stand stand = {random_between(random, -2, 2), 0, random_between(random, -2, 2),
                              random_between(random, 0, 6.3)};
        stand.y = hill_at((const double(*)[4])waves, stand.x, stand.z);
        double x = scale * log_between(random, 0.3, 2);
        add_block(mesh, &stand, x, scale * log_between(random, 0.5, 4), x * random_between(random, 0.3, 1), 0.5 * x);
    }
}

/* Strands of three-sided tubes that start on a head and fall or curl. */
static void make_hair(struct mesh *mesh, uint32_t size, struct random *random)
{
    enum { STEPS = 16 };
    double curl = random_between(random, 0, 0.6), radius = log_between(random, 5e-4, 4e-3);
    while (mesh->triangle_count < size) {
        double point[3], next[3], step[3];
        random_point(random, point);
        double length = sqrt(point[0] * point[0] + point[1] * point[1] + point[2] * point[2]) + 1e-9;
        for (int axis = 0; axis < 3; axis++) {
            point[axis] /= length;
            step[axis] = 0.08 * point[axis];
        }
        for (int i = 0; i < STEPS; i++) {
            for (int axis = 0; axis < 3; axis++) {
                step[axis] += 0.08 * curl * random_between(random, -1, 1) - (axis == 1 ? 0.012 : 0);
                next[axis] = point[axis] + step[axis];
            }
            mesh_add_tube(mesh, point, next, radius, radius, 3);
            memcpy(point, next, sizeof point);
        }
    }
}

/* Balls and blocks of sizes over two decades, which intersect each other. */
static void make_clutter(struct mesh *mesh, uint32_t size, struct random *random)
{
    double low = log_between(random, 0.002, 0.02), part = random_between(random, 0.1, 0.6);
    while (mesh->triangle_count < size) {
        double centre[3], radius = log_between(random, low, 30 * low);
        random_point(random, centre);
        struct stand stand = {centre[0], centre[1], centre[2], random_between(random, 0, 6.3)};
        if (random_between(random, 0, 1) < part)
            mesh_add_sphere(mesh, centre, radius, 2, NULL, NULL);
        else
            for (int i = 0; i < 27; i++) {
                stand.y += radius * 0.2;
                add_block(mesh, &stand, radius * log_between(random, 0.1, 1), radius * 0.1, radius, 0);
            }
    }
}

/* Shafts and pipes at all angles between plates: fans, slivers, and large flat faces. */
static void make_machine(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t sides = 16 + (uint32_t)random_between(random, 0, 48);
    while (mesh->triangle_count < size) {
        double from[3], to[3], radius = log_between(random, 0.003, 0.1);
        random_point(random, from);
        memcpy(to, from, sizeof to);
        to[random_next(random) % 3] += random_between(random, -1, 1);
        if (random_next(random) % 4 == 0)
            random_point(random, to);
        mesh_add_tube(mesh, from, to, radius, radius, sides);
        struct stand stand = {to[0], to[1], to[2], 0};
        add_block(mesh, &stand, 3 * radius, radius * 0.2, 2 * radius, 0);
    }
}

/* Small loose triangles at random places within crowns. */
static void make_leaves(struct mesh *mesh, uint32_t size, struct random *random)
{
    double leaf = log_between(random, 0.5, 3) / sqrt(size);
    while (mesh->triangle_count < size) {
        double crown[3], radius = random_between(random, 0.1, 0.4);
        random_point(random, crown);
        for (int i = 0; i < 2000; i++) {
            double corners[3][3], centre[3];
            random_point(random, centre);
            for (int k = 0; k < 9; k++)
                corners[k / 3][k % 3] = crown[k % 3] + radius * centre[k % 3] + leaf * random_between(random, -1, 1);
            mesh_add_loose_triangle(mesh, corners[0], corners[1], corners[2]);
        }
    }
}

static const struct adversarial models[] = {
    {"rooms", "architecture: walls, columns, furniture", make_rooms},
    {"town", "houses over coarse ground", make_town},
    {"terrain", "hills: even triangles", make_terrain},
    {"hair", "strands of thin tubes", make_hair},
    {"clutter", "things of many sizes through each other", make_clutter},
    {"machine", "shafts, pipes and plates: slivers and flats", make_machine},
    {"leaves", "loose triangles within crowns", make_leaves},
};

const struct adversarial *scene_model_all(uint32_t *ret_count)
{
    *ret_count = sizeof models / sizeof models[0];
    return models;
}
