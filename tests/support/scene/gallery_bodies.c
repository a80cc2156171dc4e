/* SPDX-License-Identifier: Apache-2.0 */
/* gallery_bodies.c - scenes of things that stand on a table. */
#include <math.h>
#include <stddef.h>

#include "tests/support/scene/gallery.h"
#include "tests/support/scene/shapes.h"

#define COUNT(array) (sizeof(array) / sizeof *(array))

static void make_torus(struct gltf *gltf, struct random *random)
{
    (void)random;
    shapes_ring(shapes_part(gltf, "torus", 0.75, 0.2, 0.12), (struct at){0, 0.4, 0}, 1, 1, 0.4);
    shapes_smooth(gltf);
}

static void make_knot(struct gltf *gltf, struct random *random)
{
    (void)random;
    enum { POINTS = 300 };
    struct at path[POINTS];
    for (int i = 0; i < POINTS; i++) {
        double t = 2 * M_PI * i / POINTS, r = 2 + cos(3 * t);
        path[i] = (struct at){r * cos(2 * t), 3 + r * sin(2 * t), sin(3 * t)};
    }
    shapes_pipe(shapes_part(gltf, "knot", 0.8, 0.5, 0.1), path, POINTS, 0.45, 0.45, 24, 1);
    shapes_smooth(gltf);
}

static void make_teapot(struct gltf *gltf, struct random *random)
{
    (void)random;
    static const double body[][2] = {{0, 0},     {0.6, 0},    {0.75, 0.1}, {1.0, 0.35}, {1.12, 0.7},
                                     {1.1, 1.0}, {0.95, 1.3}, {0.7, 1.5},  {0.62, 1.55}};
    static const double lid[][2] = {{0.66, 1.55}, {0.6, 1.65}, {0.3, 1.8}, {0.12, 1.86}, {0.1, 1.95},
                                    {0.2, 2.02},  {0.2, 2.12}, {0.1, 2.2}, {0, 2.22}};
    struct at spout[20], handle[24];
    struct mesh *pot = shapes_part(gltf, "pot", 0.85, 0.85, 0.82);
    shapes_smooth(gltf);
    shapes_lathe(pot, (struct at){0, 0, 0}, body, COUNT(body), 64);
    shapes_lathe(pot, (struct at){0, 0, 0}, lid, COUNT(lid), 64);
    for (int i = 0; i < 20; i++) {
        double t = i / 19.0;
        spout[i] = (struct at){0.95 + 0.9 * t, 0.55 + 0.95 * t * t + 0.1 * t, 0};
    }
    shapes_pipe(pot, spout, 20, 0.27, 0.1, 24, 0);
    for (int i = 0; i < 24; i++) {
        double t = M_PI * (i / 23.0 - 0.5);
        handle[i] = (struct at){-0.9 - 0.75 * cos(t), 0.85 + 0.48 * sin(t), 0};
    }
    shapes_pipe(pot, handle, 24, 0.11, 0.11, 20, 0);
}

static void make_vase(struct gltf *gltf, struct random *random)
{
    (void)random;
    double profile[60][2];
    for (int i = 0; i < 60; i++) {
        double t = i / 59.0;
        profile[i][0] = i ? 0.55 + 0.35 * sin(5 * t + 0.2) * (1 - 0.4 * t) + 0.02 * sin(60 * t) : 0;
        profile[i][1] = 2.6 * t;
    }
    shapes_lathe(shapes_part(gltf, "clay", 0.6, 0.27, 0.14), (struct at){0, 0, 0}, (const double(*)[2])profile, 60, 80);
    shapes_smooth(gltf);
}

static void make_goblet(struct gltf *gltf, struct random *random)
{
    (void)random;
    static const double profile[][2] = {{0, 0},      {0.7, 0},    {0.7, 0.06}, {0.2, 0.16}, {0.1, 0.3},  {0.1, 0.9},
                                        {0.16, 1.0}, {0.1, 1.1},  {0.4, 1.3},  {0.72, 1.7}, {0.78, 2.2}, {0.74, 2.7},
                                        {0.7, 2.7},  {0.73, 2.2}, {0.66, 1.7}, {0.3, 1.4},  {0, 1.36}};
    shapes_lathe(shapes_part(gltf, "gold", 0.9, 0.62, 0.2), (struct at){0, 0, 0}, profile, COUNT(profile), 72);
    shapes_smooth(gltf);
}

static const double pawn_profile[][2] = {{0, 0},       {0.5, 0},    {0.5, 0.12}, {0.4, 0.2}, {0.42, 0.28}, {0.25, 0.4},
                                         {0.17, 0.7},  {0.15, 0.9}, {0.3, 0.95}, {0.3, 1.0}, {0.16, 1.04}, {0.25, 1.15},
                                         {0.28, 1.28}, {0.24, 1.4}, {0.12, 1.5}, {0, 1.53}};
static const double rook_profile[][2] = {{0, 0},      {0.52, 0},   {0.52, 0.14}, {0.4, 0.24}, {0.28, 0.5},  {0.25, 1.1},
                                         {0.36, 1.2}, {0.4, 1.25}, {0.4, 1.6},   {0.28, 1.6}, {0.28, 1.45}, {0, 1.45}};
static const double bishop_profile[][2] = {{0, 0},      {0.5, 0},     {0.5, 0.14},  {0.38, 0.24}, {0.2, 0.6},
                                           {0.15, 1.2}, {0.3, 1.26},  {0.14, 1.34}, {0.25, 1.5},  {0.24, 1.7},
                                           {0.1, 2.0},  {0.04, 2.06}, {0.07, 2.14}, {0, 2.2}};

static void make_pawn(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *mesh = shapes_part(gltf, "ivory", 0.86, 0.8, 0.66);
    shapes_lathe(mesh, (struct at){0, 0, 0}, pawn_profile, COUNT(pawn_profile), 64);
    shapes_smooth(gltf);
}

static void make_chess(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *squares[2] = {shapes_part(gltf, "dark", 0.2, 0.1, 0.05), shapes_part(gltf, "light", 0.8, 0.66, 0.45)};
    struct mesh *frame = shapes_part(gltf, "frame", 0.3, 0.16, 0.08);
    for (int i = 0; i < 64; i++)
        shapes_box(squares[(i + i / 8) % 2], (struct at){i % 8 - 3.5, -0.1, i / 8 - 3.5}, (struct at){1, 0.2, 1});
    shapes_box(frame, (struct at){0, -0.2, 0}, (struct at){9, 0.3, 9});
    for (int side = 0; side < 2; side++) {
        struct mesh *men =
            shapes_part(gltf, side ? "white" : "black", side ? 0.85 : 0.06, side ? 0.8 : 0.05, side ? 0.7 : 0.05);
        double back = side ? 3.5 : -3.5, front = side ? 2.5 : -2.5;
        for (int i = 0; i < 8; i++) {
            shapes_lathe(men, (struct at){i - 3.5, 0, front}, pawn_profile, COUNT(pawn_profile), 28);
            if (i == 0 || i == 7)
                shapes_lathe(men, (struct at){i - 3.5, 0, back}, rook_profile, COUNT(rook_profile), 28);
            else
                shapes_lathe(men, (struct at){i - 3.5, 0, back}, bishop_profile, COUNT(bishop_profile), 28);
        }
    }
}

static void make_gear(struct gltf *gltf, struct random *random)
{
    (void)random;
    enum { TEETH = 14 };
    double outline[4 * TEETH][2];
    for (int i = 0; i < 4 * TEETH; i++) {
        double angle = 2 * M_PI * (i + (i % 4 == 1 ? 0.25 : i % 4 == 2 ? -0.25 : 0)) / (4 * TEETH);
        double radius = i % 4 == 1 || i % 4 == 2 ? 1.25 : 1;
        outline[i][0] = radius * cos(angle);
        outline[i][1] = radius * sin(angle);
    }
    struct mesh *steel = shapes_part(gltf, "steel", 0.5, 0.52, 0.55), *hub = shapes_part(gltf, "hub", 0.25, 0.26, 0.3);
    shapes_plate(steel, (struct at){0, 1.3, 0}, (const double(*)[2])outline, 4 * TEETH, 0.4);
    uint32_t first = hub->vertex_count;
    shapes_cylinder(hub, (struct at){0, 1.3 - 0.35, 0}, 0.35, 0.35, 0.7);
    shapes_turn(hub, first, (struct at){0, 1.3, 0}, 0, M_PI / 2);
}

static void make_spring(struct gltf *gltf, struct random *random)
{
    (void)random;
    enum { POINTS = 400 };
    struct at path[POINTS];
    for (int i = 0; i < POINTS; i++) {
        double t = i / (POINTS - 1.0);
        path[i] = (struct at){cos(14 * M_PI * t), 0.15 + 3 * t, sin(14 * M_PI * t)};
    }
    shapes_pipe(shapes_part(gltf, "wire", 0.45, 0.47, 0.5), path, POINTS, 0.13, 0.13, 16, 0);
    shapes_smooth(gltf);
}

static void make_bolt(struct gltf *gltf, struct random *random)
{
    (void)random;
    enum { POINTS = 360 };
    struct mesh *steel = shapes_part(gltf, "steel", 0.5, 0.5, 0.52);
    struct at path[POINTS];
    double hexagon[6][2];
    for (int i = 0; i < 6; i++) {
        hexagon[i][0] = 0.95 * cos(M_PI * i / 3);
        hexagon[i][1] = 0.95 * sin(M_PI * i / 3);
    }
    uint32_t first = steel->vertex_count;
    shapes_plate(steel, (struct at){0, 0.3, 0}, (const double(*)[2])hexagon, 6, 0.6);
    shapes_turn(steel, first, (struct at){0, 0.3, 0}, 0, -M_PI / 2);
    shapes_cylinder(steel, (struct at){0, 0.6, 0}, 0.45, 0.45, 2.6);
    for (int i = 0; i < POINTS; i++) {
        double t = i / (POINTS - 1.0);
        path[i] = (struct at){0.45 * cos(24 * M_PI * t), 1.2 + 1.95 * t, 0.45 * sin(24 * M_PI * t)};
    }
    shapes_pipe(steel, path, POINTS, 0.07, 0.07, 8, 0);
}

static void make_chain(struct gltf *gltf, struct random *random)
{
    (void)random;
    enum { LINKS = 7, POINTS = 60 };
    struct mesh *iron = shapes_part(gltf, "iron", 0.33, 0.33, 0.36);
    shapes_smooth(gltf);
    for (int link = 0; link < LINKS; link++) {
        struct at path[POINTS];
        for (int i = 0; i < POINTS; i++) {
            double angle = 2 * M_PI * i / POINTS, along = 0.62 * cos(angle) + 0.3 * tanh(4 * cos(angle)),
                   out = 0.42 * sin(angle);
            path[i] = (struct at){1.35 * link + along, 0.6 + (link % 2 ? out : 0), link % 2 ? 0 : out};
        }
        shapes_pipe(iron, path, POINTS, 0.15, 0.15, 16, 1);
    }
}

static void paint_planks(double u, double v, unsigned char rgba[4])
{
    double plank = floor(5 * u), edge = fabs(5 * u - plank - 0.5) > 0.46 || v < 0.1 || v > 0.9 || fabs(u - v) < 0.07;
    double grain = 0.85 + 0.1 * sin(40 * v + 9 * sin(5 * u + plank)) + 0.05 * sin(170 * u + plank);
    double shade = grain * (edge > 0 ? 0.6 : 1);
    rgba[0] = (unsigned char)(190 * shade);
    rgba[1] = (unsigned char)(135 * shade);
    rgba[2] = (unsigned char)(80 * shade);
    rgba[3] = 255;
}

static void make_crate(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *wood = shapes_part(gltf, "wood", 1, 1, 1);
    gltf->materials[0].image = 1 + gltf_add_image(gltf, 256, 256, paint_planks);
    shapes_box(wood, (struct at){0.5, 0.5, 0.5}, (struct at){1, 1, 1});
    shapes_box(wood, (struct at){-0.7, 0.5, 0.4}, (struct at){1, 1, 1});
    uint32_t first = wood->vertex_count;
    shapes_box(wood, (struct at){0, 1.5, 0.5}, (struct at){1, 1, 1});
    shapes_turn(wood, first, (struct at){0, 1.5, 0.5}, 1, 0.5);
}

/* Rounded cubes have pips on their faces. */
static void make_dice(struct gltf *gltf, struct random *random)
{
    (void)random;
    static const double pips[][3] = {{0, 0, 1},        {0.28, 0.28, 2},  {-0.28, -0.28, 2}, {0.28, -0.28, 3},
                                     {0, 0, 3},        {-0.28, 0.28, 3}, {0.28, 0.28, 4},   {-0.28, 0.28, 4},
                                     {0.28, -0.28, 4}, {-0.28, -0.28, 4}};
    struct mesh *body = shapes_part(gltf, "body", 0.85, 0.1, 0.08), *dots = shapes_part(gltf, "pips", 0.95, 0.95, 0.92);
    for (int die = 0; die < 2; die++) {
        struct at middle = {die ? 0.85 : -0.6, 0.5, die ? 0.35 : -0.2};
        uint32_t first = body->vertex_count, first_dot = dots->vertex_count;
        shapes_box(body, middle, (struct at){1, 1, 1});
        for (size_t i = 0; i < COUNT(pips); i++) {
            double a = pips[i][0], b = pips[i][1];
            struct at at = pips[i][2] <= 1   ? (struct at){a, 0.47, b}
                           : pips[i][2] <= 2 ? (struct at){0.47, a, b}
                           : pips[i][2] <= 3 ? (struct at){a, b, 0.47}
                                             : (struct at){-0.47, a, b};
            shapes_ball(dots, (struct at){middle.x + at.x, middle.y + at.y, middle.z + at.z}, 0.1);
        }
        shapes_turn(body, first, middle, 1, die ? 0.9 : 0.2);
        shapes_turn(dots, first_dot, middle, 1, die ? 0.9 : 0.2);
    }
}

static void make_umbrella(struct gltf *gltf, struct random *random)
{
    (void)random;
    double profile[16][2];
    struct at hook[16];
    struct mesh *cloth = shapes_part(gltf, "cloth", 0.1, 0.25, 0.6), *wood = shapes_part(gltf, "wood", 0.4, 0.24, 0.12);
    for (int i = 0; i < 16; i++) {
        double t = i / 15.0;
        profile[i][0] = 1.6 * cos(M_PI / 2 * t);
        profile[i][1] = 2.2 + 0.8 * sin(M_PI / 2 * t);
        hook[i] = (struct at){0.2 - 0.2 * cos(M_PI * t), 0.22 - 0.2 * sin(M_PI * t), 0};
    }
    shapes_lathe(cloth, (struct at){0, 0, 0}, (const double(*)[2])profile, 16, 8);
    shapes_rod(wood, (struct at){0, 0.22, 0}, (struct at){0, 3.2, 0}, 0.05);
    shapes_pipe(wood, hook, 16, 0.05, 0.05, 12, 0);
}

const struct gallery_scene gallery_bodies[GALLERY_BODIES] = {
    {"teapot", make_teapot}, {"torus", make_torus},       {"knot", make_knot},   {"vase", make_vase},
    {"goblet", make_goblet}, {"pawn", make_pawn},         {"chess", make_chess}, {"gear", make_gear},
    {"spring", make_spring}, {"bolt", make_bolt},         {"chain", make_chain}, {"crate", make_crate},
    {"dice", make_dice},     {"umbrella", make_umbrella},
};
