/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/scene_variety.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

#include "tests/bench/bvhd_bench/scene_model.h"

/* The placement of a part of a scene: axes[i] is the direction of its i-th axis, multiplied by its scale. */
struct frame {
    double origin[3], axes[3][3];
};

static double log_between(struct random *random, double low, double high)
{
    return exp(random_between(random, log(low), log(high)));
}

/* A frame that is rotated around the upright axis first, then by `tilt` around another. */
static struct frame frame_at(const double origin[3], double scale, double turn, double tilt)
{
    double c = scale * cos(turn), s = scale * sin(turn), ct = cos(tilt), st = sin(tilt);
    return (struct frame){{origin[0], origin[1], origin[2]},
                          {{c, s * st, s * ct}, {0, scale * ct, -scale * st}, {-s, c * st, c * ct}}};
}

/* A frame of random orientation. */
static struct frame any_frame(struct random *random, const double origin[3], double scale)
{
    double turn = random_between(random, 0, 2 * M_PI);
    return frame_at(origin, scale, turn, random_between(random, 0, 2 * M_PI));
}

static void place(const struct frame *frame, const double at[3], double ret_point[3])
{
    for (int axis = 0; axis < 3; axis++)
        ret_point[axis] = frame->origin[axis] + at[0] * frame->axes[0][axis] + at[1] * frame->axes[1][axis] +
                          at[2] * frame->axes[2][axis];
}

static uint32_t add_at(struct mesh *mesh, const struct frame *frame, double x, double y, double z)
{
    double point[3];
    place(frame, (double[3]){x, y, z}, point);
    return mesh_add_vertex(mesh, point[0], point[1], point[2]);
}

/* Moves all vertices from `first` on into the frame. */
static void move_from(struct mesh *mesh, uint32_t first, const struct frame *frame)
{
    for (uint32_t i = first; i < mesh->vertex_count; i++) {
        double at[3] = {mesh->vertices[i][0], mesh->vertices[i][1], mesh->vertices[i][2]}, point[3];
        place(frame, at, point);
        for (int axis = 0; axis < 3; axis++)
            mesh->vertices[i][axis] = (float)point[axis];
    }
}

/* Rotates half of the scenes at random; the other half stay aligned with the axes. */
static void turn_whole(struct mesh *mesh, struct random *random)
{
    static const double origin[3] = {0, 0, 0};
    double turn = random_between(random, 0, 1.5), tilt = random_between(random, 0, 1.5);
    if (random_next(random) % 2)
        return;
    struct frame frame = frame_at(origin, 1, turn, random_next(random) % 2 ? tilt : 0);
    move_from(mesh, 0, &frame);
}

static void add_box(struct mesh *mesh, const struct frame *frame, double x, double y, double z)
{
    static const unsigned char sides[6][4] = {{0, 1, 3, 2}, {4, 6, 7, 5}, {0, 4, 5, 1},
                                              {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}};
    uint32_t first = mesh->vertex_count;
    for (int i = 0; i < 8; i++)
        add_at(mesh, frame, i & 1 ? x : -x, i & 2 ? y : -y, i & 4 ? z : -z);
    for (int i = 0; i < 6; i++)
        mesh_add_quad(mesh, first + sides[i][0], first + sides[i][1], first + sides[i][2], first + sides[i][3]);
}

/* Adds a surface of revolution around the upright axis of the frame. */
static void add_lathe(struct mesh *mesh, const struct frame *frame, const double (*profile)[2], uint32_t count,
                      uint32_t sides)
{
    uint32_t first = mesh->vertex_count;
    mesh_add_lathe(mesh, profile, count, sides);
    move_from(mesh, first, frame);
}

/* Adds a wavy sheet over [-1, 1]^2. */
static void add_sheet(struct mesh *mesh, const struct frame *frame, uint32_t side, double height, double waves)
{
    uint32_t first = mesh->vertex_count;
    for (uint32_t i = 0; i < side * side; i++) {
        double x = 2.0 * (i % side) / (side - 1) - 1, z = 2.0 * (i / side) / (side - 1) - 1;
        add_at(mesh, frame, x, height * sin(waves * x) * cos(0.7 * waves * z), z);
    }
    mesh_add_rows(mesh, first, side, side, 0);
}

/*
 * Adds a flat disc, triangulated as modelling programs do it: all triangles from one corner, or in zigzag. The long
 * thin triangles overlap each other's boxes.
 */
static void add_disc(struct mesh *mesh, const struct frame *frame, double radius, double y, uint32_t sides, bool zigzag)
{
    uint32_t first = mesh->vertex_count;
    for (uint32_t i = 0; i < sides; i++)
        add_at(mesh, frame, radius * cos(2 * M_PI * i / sides), y, radius * sin(2 * M_PI * i / sides));
    for (uint32_t i = 1; i + 1 < sides && !zigzag; i++)
        mesh_add_triangle(mesh, first, first + i, first + i + 1);
    for (uint32_t low = 0, high = sides - 1; low + 1 < high && zigzag; low++, high--) {
        mesh_add_triangle(mesh, first + low, first + low + 1, first + high);
        if (low + 1 < high - 1)
            mesh_add_triangle(mesh, first + low + 1, first + high - 1, first + high);
    }
}

/* A courtyard: floors and walls of few triangles, columns and arches of long ones, draperies and pots of small ones. */
static void make_atrium(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t sides = 10 + random_next(random) % 20, fine = 8 + random_next(random) % 16,
             storeys = 1 + random_next(random) % 3;
    static const double shaft[6][2] = {{0.3, 0}, {0.3, 0.2}, {0.2, 0.3}, {0.17, 3}, {0.3, 3.2}, {0.3, 3.5}};
    for (uint32_t bay = 0; mesh->triangle_count < size; bay++) {
        double x = 3.0 * (bay / 2 / storeys), y = 4.2 * (bay / 2 % storeys), z = bay % 2 ? 5 : -5;
        struct frame frame = frame_at((double[3]){x, y, z}, 1, 0, 0), arch = frame, pot = frame;
        add_lathe(mesh, &frame, shaft, 6, sides);
        add_box(mesh, &frame, 1.5, 0.05, 2);
        arch.origin[1] += 3.5;
        uint32_t first = mesh->vertex_count;
        for (uint32_t i = 0; i <= fine; i++)
            for (int k = 0; k < 4; k++) {
                double angle = M_PI * i / fine, radius = k == 1 || k == 2 ? 1.3 : 1.1;
                add_at(mesh, &arch, 1.5 + radius * cos(angle), 0.5 * radius * sin(angle), k < 2 ? -0.2 : 0.2);
            }
        mesh_add_rows(mesh, first, fine + 1, 4, 1);
        pot.origin[0] += random_between(random, -1, 1);
        struct frame wall = {{x, y + 2, 1.6 * z}, {{3, 0, 0}, {0, 2.2, 0}, {0, 0, 0.2}}};
        add_box(mesh, &wall, 1, 1, 1);
        struct frame cloth = {{x, y + 1.8, 0.7 * z}, {{0, 1.2, 0}, {0.3, 0, 0}, {0, 0, 0.6}}};
        if (random_next(random) % 3 == 0)
            add_sheet(mesh, &cloth, fine + 4, 0.5, 9);
        if (random_next(random) % 3 == 0)
            mesh_add_sphere(mesh, pot.origin, 0.2, 2, NULL, NULL);
    }
    turn_whole(mesh, random);
}

/* Plates with bores, shafts and rims, tessellated like surfaces with few curvatures. */
static void make_fixture(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t sides = 16 + random_next(random) % 40;
    double spread = random_between(random, 0.3, 2);
    while (mesh->triangle_count < size) {
        double origin[3], radius = log_between(random, 0.01, 0.3), height = radius * log_between(random, 0.1, 10);
        random_point(random, origin);
        origin[1] *= 0.4;
        struct frame frame =
            frame_at(origin, 1, random_next(random) % 3 * M_PI / 4 * spread, random_next(random) % 3 * M_PI / 2);
        bool zigzag = random_next(random) % 2;
        for (int end = 0; end < 2; end++)
            add_disc(mesh, &frame, radius, end * height, sides, zigzag);
        add_lathe(mesh, &frame, (const double[2][2]){{radius, 0}, {radius, height}}, 2, sides);
        for (uint32_t i = 0; i < random_next(random) % 6; i++) {
            struct frame bolt = frame;
            place(&frame,
                  (double[3]){random_between(random, -1, 1) * radius, height, random_between(random, -1, 1) * radius},
                  bolt.origin);
            add_lathe(
                mesh, &bolt,
                (const double[4][2]){
                    {0, 0.1 * radius}, {0.08 * radius, 0.1 * radius}, {0.1 * radius, 0.08 * radius}, {0.1 * radius, 0}},
                4, sides / 2);
        }
        if (random_next(random) % 4 == 0)
            add_box(mesh, &frame, radius * 2, 0.1 * radius, radius);
    }
    turn_whole(mesh, random);
}

/* Bricks with studs and tubes, stacked and stuck into each other. */
static void make_bricks(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t sides = 8 + random_next(random) % 12;
    double high = log_between(random, 0.3, 1.5), extent = cbrt(size / 150.0) * random_between(random, 0.8, 2);
    while (mesh->triangle_count < size) {
        double origin[3];
        random_point(random, origin);
        for (int axis = 0; axis < 3; axis++)
            origin[axis] = round(extent * origin[axis]);
        struct frame frame = frame_at(origin, 1, random_next(random) % 4 * M_PI / 2,
                                      random_next(random) % 8 ? 0 : random_between(random, 0, 1.5));
        int x = 1 + (int)(random_next(random) % 3), z = 1 + (int)(random_next(random) % 2);
        add_box(mesh, &frame, 0.5 * x, 0.5 * high, 0.5 * z);
        add_box(mesh, &frame, 0.5 * x - 0.1, 0.5 * high - 0.1, 0.5 * z - 0.1);
        for (int i = 0; i < x * z; i++) {
            struct frame stud = frame;
            place(&frame, (double[3]){i % x - 0.5 * (x - 1), 0.5 * high, i / x - 0.5 * (z - 1)}, stud.origin);
            add_lathe(mesh, &stud, (const double[2][2]){{0.3, 0}, {0.3, 0.2}}, 2, sides);
            add_disc(mesh, &stud, 0.3, 0.2, sides, false);
        }
    }
    turn_whole(mesh, random);
}

/* One huge ground, and things on it of ever smaller sizes. */
static void make_arena(struct mesh *mesh, uint32_t size, struct random *random)
{
    double ratio = log_between(random, 0.02, 0.5), scale = 1, origin[3] = {0, 0, 0};
    uint32_t things = 3 + random_next(random) % 4, level = 0;
    while (level < 6 && (UINT64_C(20) * things << 2 * (level + 1)) < size)
        level++;
    struct frame ground = any_frame(random, origin, 3);
    add_sheet(mesh, &ground, 2 + random_next(random) % 3 * 20, 0, 0);
    for (uint32_t i = 0; mesh->triangle_count < size; i++, scale *= i % things ? ratio : pow(ratio, 1.0 - things)) {
        double centre[3];
        for (int axis = 0; axis < 3; axis++)
            centre[axis] = origin[axis] + scale * (axis == 1 ? 0.3 : random_between(random, -1, 1));
        mesh_add_sphere(mesh, centre, 0.3 * scale, level, NULL, NULL);
        struct frame box = any_frame(random, centre, 0.5 * scale);
        add_box(mesh, &box, 1, random_between(random, 0.05, 1), 0.5);
    }
}

static double bumps_at(const double direction[3], const void *context)
{
    const double *waves = context;
    double sum = 0;
    for (int i = 0; i < 4; i++)
        sum += waves[0] / (1 << i) *
               sin(waves[i + 1] * (2 << i) * direction[i % 3] + waves[4 - i] * (3 << i) * direction[(i + 1) % 3]);
    return sum;
}

/* Scanned figures: even, bumpy, some on a table. */
static void make_scan(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t level = 0, figures = 0;
    double waves[5] = {random_between(random, 0.05, 0.3)};
    uint32_t wanted = 1 + random_next(random) % 5;
    for (int i = 1; i < 5; i++)
        waves[i] = random_between(random, 1, 3);
    while (level < 9 && (UINT64_C(20) * wanted << 2 * (level + 1)) < size * 3 / 2)
        level++;
    for (; mesh->triangle_count < size; figures++)
        mesh_add_sphere(mesh, (double[3]){2.0 * (figures % 3), 0, 2.0 * (figures / 3)}, random_between(random, 0.3, 1),
                        level, bumps_at, waves);
    if (random_next(random) % 2)
        add_box(mesh, &(struct frame){{2, -1, 2}, {{4, 0, 0}, {0, 0.1, 0}, {0, 0, 4}}}, 1, 1, 1);
    turn_whole(mesh, random);
}

/* Many concentric balls. */
static void make_shells(struct mesh *mesh, uint32_t size, struct random *random)
{
    static const double centre[3] = {0, 0, 0};
    uint32_t level = 1 + random_next(random) % 4;
    double step = random_between(random, 0.8, 0.995), radius = 1;
    for (; mesh->triangle_count < size; radius *= step)
        mesh_add_sphere(mesh, centre, radius, level, NULL, NULL);
}

/* Trees on hills: trunks and boughs of long triangles, and many small leaves. */
static void make_forest(struct mesh *mesh, uint32_t size, struct random *random)
{
    double leaf = log_between(random, 0.01, 0.08), share = random_between(random, 0.1, 0.5),
           extent = sqrt(size / 1500.0);
    struct frame ground = frame_at((double[3]){0, 0, 0}, extent, 0, 0);
    add_sheet(mesh, &ground, (uint32_t)sqrt(size * share / 4) + 2, 0.1, 6);
    while (mesh->triangle_count < size) {
        double foot[3] = {random_between(random, -extent, extent), 0, random_between(random, -extent, extent)};
        double top[3] = {foot[0], random_between(random, 0.5, 1.5), foot[2]};
        mesh_add_tube(mesh, foot, top, 0.04, 0.01, 7);
        for (int bough = 0; bough < 12; bough++) {
            double from[3], to[3], part = random_between(random, 0.3, 1);
            for (int axis = 0; axis < 3; axis++) {
                from[axis] = foot[axis] + part * (top[axis] - foot[axis]);
                to[axis] = from[axis] + random_between(random, -0.4, 0.4);
            }
            mesh_add_tube(mesh, from, to, 0.01, 0.003, 4);
            for (int i = 0; i < 40; i++) {
                double at = random_between(random, 0.2, 1), point[3];
                for (int axis = 0; axis < 3; axis++)
                    point[axis] = from[axis] + at * (to[axis] - from[axis]) + random_between(random, -2, 2) * leaf;
                struct frame frame = any_frame(random, point, leaf);
                uint32_t first = add_at(mesh, &frame, -1, 0, -0.5);
                add_at(mesh, &frame, 1, 0, -0.5);
                add_at(mesh, &frame, 1, 0, 0.5);
                add_at(mesh, &frame, -1, 0, 0.5);
                mesh_add_quad(mesh, first, first + 1, first + 2, first + 3);
            }
        }
    }
}

/* Layered sheets, closer to each other than their folds are high. */
static void make_cloth(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t layers = 1 + random_next(random) % 12;
    uint32_t side = (uint32_t)sqrt(size / 2.0 / layers) + 2;
    double height = log_between(random, 0.02, 0.4), waves = random_between(random, 3, 20),
           gap = log_between(random, 0.002, 0.1);
    for (uint32_t i = 0; i < layers; i++) {
        struct frame frame = frame_at((double[3]){0, i * gap, 0}, 1, random_between(random, 0, 0.2) * i, 0);
        add_sheet(mesh, &frame, side, height, waves);
    }
    turn_whole(mesh, random);
}

/* Thin bars along the axes, some of them across: lattices. */
static void make_scaffold(struct mesh *mesh, uint32_t size, struct random *random)
{
    double thin = log_between(random, 0.002, 0.05), across = random_between(random, 0, 0.5);
    uint32_t cells = (uint32_t)cbrt(size / 40.0) + 1;
    while (mesh->triangle_count < size) {
        double origin[3];
        struct frame frame;
        random_point(random, origin);
        for (int axis = 0; axis < 3; axis++)
            origin[axis] = floor(origin[axis] * cells) / cells;
        if (random_between(random, 0, 1) < across)
            frame = any_frame(random, origin, 1.0 / cells);
        else
            frame =
                frame_at(origin, 1.0 / cells, random_next(random) % 2 * M_PI / 2, random_next(random) % 2 * M_PI / 2);
        add_box(mesh, &frame, thin, thin, log_between(random, 0.5, 3));
    }
    turn_whole(mesh, random);
}

/* Loose triangles of many sizes and proportions. */
static void make_soup(struct mesh *mesh, uint32_t size, struct random *random)
{
    double largest = log_between(random, 0.5, 8) / cbrt(size), range = log_between(random, 1, 100),
           thin = log_between(random, 1, 30);
    for (uint32_t i = 0; i < size; i++) {
        double origin[3], length = largest / log_between(random, 1, range);
        random_point(random, origin);
        struct frame frame = any_frame(random, origin, length);
        uint32_t first = add_at(mesh, &frame, 0, 0, -1);
        add_at(mesh, &frame, 0.5 / thin, 0, 1);
        add_at(mesh, &frame, -0.5 / thin, 0, 1);
        mesh_add_triangle(mesh, first, first + 1, first + 2);
    }
}

/* Signs and gears: flat outlines cut into long triangles, and their rims. */
static void make_signs(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t sides = 12 + random_next(random) % 80;
    double low = log_between(random, 0.02, 0.2);
    bool zigzag = random_next(random) % 2;
    while (mesh->triangle_count < size) {
        double origin[3], radius = log_between(random, low, 4 * low);
        random_point(random, origin);
        struct frame frame = random_next(random) % 2 ? any_frame(random, origin, 1) : frame_at(origin, 1, 0, M_PI / 2);
        for (int end = 0; end < 2; end++)
            add_disc(mesh, &frame, radius, end * radius * 0.1, sides, zigzag);
        add_lathe(mesh, &frame, (const double[2][2]){{radius, 0}, {radius, 0.1 * radius}}, 2, sides);
    }
}

/* Fine balls far apart from each other, with sizes over decades. */
static void make_clusters(struct mesh *mesh, uint32_t size, struct random *random)
{
    uint32_t level = 2 + random_next(random) % 3;
    double low = log_between(random, 1e-4, 1e-1);
    while (mesh->triangle_count < size) {
        double centre[3];
        random_point(random, centre);
        mesh_add_sphere(mesh, centre, log_between(random, low, 0.2), level, NULL, NULL);
    }
}

/* A sheet of fine hills with large plain things stuck into it. */
static void make_park(struct mesh *mesh, uint32_t size, struct random *random)
{
    double share = random_between(random, 0.5, 0.98);
    struct frame ground = frame_at((double[3]){0, 0, 0}, 1, 0, 0);
    add_sheet(mesh, &ground, (uint32_t)sqrt(size * share / 2) + 2, log_between(random, 0.01, 0.3),
              random_between(random, 2, 30));
    while (mesh->triangle_count < size) {
        double centre[3], radius = log_between(random, 0.01, 0.2);
        random_point(random, centre);
        centre[1] *= 0.1;
        struct frame frame = any_frame(random, centre, radius);
        if (random_next(random) % 2)
            add_box(mesh, &frame, 1, random_between(random, 0.1, 1), 0.3);
        else
            add_lathe(mesh, &frame, (const double[3][2]){{0.01, 1.5}, {0.3, -1}, {0.3, -1.1}}, 3, 16);
    }
}

/* One of the models of scene_model.h, which stand upright, rotated at random. */
static void make_tilted(struct mesh *mesh, uint32_t size, struct random *random)
{
    static const double origin[3] = {0, 0, 0};
    uint32_t count;
    const struct adversarial *models = scene_model_all(&count);
    models[random_next(random) % count].make(mesh, size, random);
    struct frame frame = any_frame(random, origin, 1);
    move_from(mesh, 0, &frame);
}

static const struct adversarial varieties[] = {
    {"atrium", "a courtyard: few large, many small", make_atrium},
    {"fixture", "plates, bores, shafts", make_fixture},
    {"bricks", "bricks with studs, stuck into each other", make_bricks},
    {"arena", "one huge ground, ever smaller things", make_arena},
    {"scan", "scanned figures: even triangles", make_scan},
    {"shells", "balls within balls", make_shells},
    {"forest", "trees with leaves on hills", make_forest},
    {"cloth", "folded sheets upon each other", make_cloth},
    {"scaffold", "thin bars", make_scaffold},
    {"soup", "loose triangles of many sizes", make_soup},
    {"signs", "flat outlines cut into long triangles", make_signs},
    {"clusters", "fine balls far apart", make_clusters},
    {"park", "large plain things in a fine sheet", make_park},
    {"tilted", "another model at an angle", make_tilted},
};

const struct adversarial *scene_variety_all(uint32_t *ret_count)
{
    *ret_count = sizeof varieties / sizeof varieties[0];
    return varieties;
}
