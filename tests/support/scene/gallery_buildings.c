/* SPDX-License-Identifier: Apache-2.0 */
/* gallery_buildings.c - scenes of buildings, streets and rooms. */
#include <math.h>

#include "tests/support/scene/gallery.h"
#include "tests/support/scene/shapes.h"

static void make_stairs(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *stone = shapes_part(gltf, "stone", 0.6, 0.56, 0.5),
                *rail = shapes_part(gltf, "rail", 0.25, 0.13, 0.07);
    for (int i = 0; i < 10; i++) {
        shapes_box(stone, (struct at){0, 0.1 + 0.1 * i, -0.35 * i}, (struct at){2.4, 0.2 + 0.2 * i, 0.35});
        shapes_rod(rail, (struct at){1.1, 0.2 + 0.2 * i, -0.35 * i}, (struct at){1.1, 1.1 + 0.2 * i, -0.35 * i}, 0.03);
    }
    shapes_rod(rail, (struct at){1.1, 1.1, 0}, (struct at){1.1, 2.9, -3.15}, 0.05);
}

static void make_spiral_stairs(struct gltf *gltf, struct random *random)
{
    (void)random;
    enum { STEPS = 26 };
    struct mesh *steps = shapes_part(gltf, "steps", 0.5, 0.3, 0.15),
                *iron = shapes_part(gltf, "iron", 0.12, 0.12, 0.13);
    struct at rail[STEPS];
    shapes_cylinder(iron, (struct at){0, 0, 0}, 0.12, 0.12, 5.4);
    for (int i = 0; i < STEPS; i++) {
        double angle = 0.34 * i, height = 0.2 + 0.19 * i;
        uint32_t first = steps->vertex_count;
        shapes_box(steps, (struct at){0.8, height, 0}, (struct at){1.4, 0.07, 0.5});
        shapes_turn(steps, first, (struct at){0, height, 0}, 1, angle);
        rail[i] = (struct at){1.45 * cos(angle), height + 0.9, -1.45 * sin(angle)};
        shapes_rod(iron, (struct at){rail[i].x, height, rail[i].z}, rail[i], 0.02);
    }
    shapes_pipe(iron, rail, STEPS, 0.04, 0.04, 10, 0);
}

static void add_crown(struct mesh *mesh, struct at foot, double radius, int teeth)
{
    for (int i = 0; i < teeth; i++) {
        double angle = 2 * M_PI * i / teeth;
        uint32_t first = mesh->vertex_count;
        struct at at = {foot.x + radius, foot.y + 0.2, foot.z};
        shapes_box(mesh, at, (struct at){0.2, 0.4, 2.2 * radius / teeth * 1.6});
        shapes_turn(mesh, first, foot, 1, angle);
    }
}

static void make_castle(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *stone = shapes_part(gltf, "stone", 0.55, 0.52, 0.46),
                *roofs = shapes_part(gltf, "roofs", 0.45, 0.1, 0.07),
                *gate = shapes_part(gltf, "gate", 0.16, 0.09, 0.05);
    for (int i = 0; i < 4; i++) {
        struct at corner = {i & 1 ? 4 : -4, 0, i & 2 ? 3.5 : -3.5};
        shapes_cylinder(stone, corner, 1, 0.95, 4);
        add_crown(stone, (struct at){corner.x, 4, corner.z}, 0.95, 9);
        shapes_cylinder(roofs, (struct at){corner.x, 4.1, corner.z}, 0.8, 0, 1.6);
    }
    for (int i = 0; i < 2; i++) {
        shapes_box(stone, (struct at){0, 1.2, i ? 3.5 : -3.5}, (struct at){7, 2.4, 0.5});
        shapes_box(stone, (struct at){i ? 4 : -4, 1.2, 0}, (struct at){0.5, 2.4, 6});
        for (int k = -4; k <= 4; k++)
            shapes_box(stone, (struct at){0.7 * k, 2.6, i ? 3.5 : -3.5}, (struct at){0.4, 0.4, 0.5});
    }
    shapes_box(gate, (struct at){0, 0.8, 3.7}, (struct at){1.4, 1.6, 0.2});
    shapes_box(stone, (struct at){0, 2, -0.5}, (struct at){3, 4, 2.6});
    shapes_cylinder(stone, (struct at){0.4, 4, -0.5}, 0.9, 0.9, 2.4);
    shapes_cylinder(roofs, (struct at){0.4, 6.4, -0.5}, 1.1, 0, 2);
}

static void make_bridge(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *stone = shapes_part(gltf, "stone", 0.58, 0.54, 0.47),
                *river = shapes_part(gltf, "river", 0.1, 0.28, 0.4);
    shapes_box(river, (struct at){0, -0.05, 0}, (struct at){12, 0.1, 5});
    shapes_box(stone, (struct at){0, 2.5, 0}, (struct at){12, 0.3, 1.8});
    for (int side = 0; side < 2; side++)
        shapes_box(stone, (struct at){0, 2.85, side ? 0.8 : -0.8}, (struct at){12, 0.5, 0.15});
    for (int arch = 0; arch < 3; arch++)
        for (int i = 0; i < 40; i++) {
            double x = -1.9 + 3.8 * (i + 0.5) / 40, under = sqrt(fmax(0, 1.6 * 1.6 - x * x)) * 1.25;
            shapes_box(stone, (struct at){4 * (arch - 1) + x, (under + 2.4) / 2, 0},
                       (struct at){0.1, 2.4 - under, 1.6});
        }
    for (int pier = 0; pier < 4; pier++)
        shapes_box(stone, (struct at){4 * pier - 6, 1.2, 0}, (struct at){0.4, 2.4, 1.8});
}

static void paint_bricks(double u, double v, unsigned char rgba[4])
{
    double row = floor(16 * v), column = 8 * u + (fmod(row, 2) > 0 ? 0.5 : 0), across = column - floor(column),
           up = 16 * v - row;
    double tone = 0.8 + 0.2 * sin(12.9 * floor(column) + 78.2 * row);
    int is_mortar = across < 0.05 || up < 0.1;
    rgba[0] = (unsigned char)(is_mortar ? 190 : 175 * tone);
    rgba[1] = (unsigned char)(is_mortar ? 185 : 85 * tone);
    rgba[2] = (unsigned char)(is_mortar ? 175 : 65 * tone);
    rgba[3] = 255;
}

/* Adds a roof with gables along x. */
static void add_roof(struct mesh *mesh, struct at foot, double length, double width, double height)
{
    static const int faces[8][3] = {{0, 1, 5}, {0, 5, 4}, {2, 3, 4}, {2, 4, 5},
                                    {3, 0, 4}, {1, 2, 5}, {0, 3, 2}, {0, 2, 1}};
    const double corners[6][3] = {{-length / 2, 0, width / 2},  {length / 2, 0, width / 2}, {length / 2, 0, -width / 2},
                                  {-length / 2, 0, -width / 2}, {-length / 2, height, 0},   {length / 2, height, 0}};
    for (int i = 0; i < 8; i++) {
        double at[3][3];
        for (int k = 0; k < 3; k++) {
            const double *corner = corners[faces[i][k]];
            at[k][0] = foot.x + corner[0];
            at[k][1] = foot.y + corner[1];
            at[k][2] = foot.z + corner[2];
        }
        mesh_add_loose_triangle(mesh, at[0], at[1], at[2]);
    }
}

static void make_house(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *walls = shapes_part(gltf, "walls", 1, 1, 1);
    gltf->materials[0].image = 1 + gltf_add_image(gltf, 256, 256, paint_bricks);
    gltf->materials[0].scale = 0.5;
    struct mesh *roof = shapes_part(gltf, "roof", 0.25, 0.1, 0.08), *wood = shapes_part(gltf, "wood", 0.3, 0.16, 0.08),
                *glass = shapes_part(gltf, "glass", 0.25, 0.4, 0.55),
                *grass = shapes_part(gltf, "grass", 0.2, 0.4, 0.1);
    shapes_box(grass, (struct at){0, -0.1, 0}, (struct at){9, 0.2, 7});
    shapes_box(walls, (struct at){0, 1.25, 0}, (struct at){5, 2.5, 3.6});
    add_roof(roof, (struct at){0, 2.5, 0}, 5.6, 4.4, 1.8);
    shapes_box(walls, (struct at){1.4, 3.9, -0.6}, (struct at){0.5, 1.6, 0.5});
    shapes_box(wood, (struct at){0, 0.95, 1.8}, (struct at){0.9, 1.9, 0.12});
    for (int side = -1; side <= 1; side += 2) {
        shapes_box(wood, (struct at){1.6 * side, 1.4, 1.8}, (struct at){1.1, 1.1, 0.1});
        shapes_box(glass, (struct at){1.6 * side, 1.4, 1.84}, (struct at){0.9, 0.9, 0.1});
    }
}

static void make_city(struct gltf *gltf, struct random *random)
{
    struct mesh *ground = shapes_part(gltf, "street", 0.2, 0.2, 0.21),
                *towers[3] = {shapes_part(gltf, "glass", 0.3, 0.42, 0.52),
                              shapes_part(gltf, "concrete", 0.6, 0.58, 0.54),
                              shapes_part(gltf, "brick", 0.5, 0.25, 0.17)};
    shapes_box(ground, (struct at){0, -0.1, 0}, (struct at){26, 0.2, 26});
    for (int i = 0; i < 64; i++) {
        double x = 3 * (i % 8 - 3.5), z = 3 * (i / 8 - 3.5), near = hypot(x, z);
        double height =
            random_between(random, 1.2, 2.5) + 7 * exp(-near * near / 40) * random_between(random, 0.5, 1.2);
        struct mesh *mesh = towers[random_next(random) % 3];
        shapes_box(mesh, (struct at){x, height / 2, z}, (struct at){2, height, 2});
        if (height > 3)
            shapes_box(mesh, (struct at){x, height + 0.5, z}, (struct at){1.2, 1, 1.2});
        for (double y = 0.4; y < height - 0.3; y += 0.5)
            shapes_box(ground, (struct at){x, y, z}, (struct at){2.04, 0.16, 1.7});
    }
}

static void add_chair(struct mesh *wood, struct at at, double angle)
{
    uint32_t first = wood->vertex_count;
    shapes_box(wood, (struct at){at.x, at.y + 0.45, at.z}, (struct at){0.5, 0.06, 0.5});
    shapes_box(wood, (struct at){at.x, at.y + 0.75, at.z - 0.23}, (struct at){0.5, 0.6, 0.05});
    for (int i = 0; i < 4; i++)
        shapes_box(wood, (struct at){at.x + (i & 1 ? 0.2 : -0.2), at.y + 0.22, at.z + (i & 2 ? 0.2 : -0.2)},
                   (struct at){0.06, 0.44, 0.06});
    shapes_turn(wood, first, at, 1, angle);
}

static void add_table(struct mesh *wood, struct at at)
{
    shapes_box(wood, (struct at){at.x, at.y + 0.75, at.z}, (struct at){1.8, 0.07, 1});
    for (int i = 0; i < 4; i++)
        shapes_box(wood, (struct at){at.x + (i & 1 ? 0.8 : -0.8), at.y + 0.36, at.z + (i & 2 ? 0.4 : -0.4)},
                   (struct at){0.08, 0.72, 0.08});
}

static void make_table(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *wood = shapes_part(gltf, "oak", 0.5, 0.3, 0.15), *china = shapes_part(gltf, "china", 0.85, 0.85, 0.85);
    add_table(wood, (struct at){0, 0, 0});
    add_chair(wood, (struct at){0.5, 0, 0.85}, M_PI);
    add_chair(wood, (struct at){-0.5, 0, -0.85}, 0);
    add_chair(wood, (struct at){-1.3, 0, 0}, M_PI / 2);
    shapes_cylinder(china, (struct at){0.3, 0.79, 0.1}, 0.16, 0.2, 0.04);
    shapes_cylinder(china, (struct at){-0.4, 0.79, -0.1}, 0.06, 0.08, 0.25);
}

/* A closed room whose light comes through windows in its wall and a lantern in its ceiling. */
static void make_room(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *walls = shapes_part(gltf, "walls", 0.85, 0.8, 0.7), *wood = shapes_part(gltf, "oak", 0.45, 0.25, 0.12),
                *rug = shapes_part(gltf, "rug", 0.5, 0.08, 0.07), *sofa = shapes_part(gltf, "sofa", 0.1, 0.28, 0.35),
                *boards = shapes_part(gltf, "boards", 0.5, 0.36, 0.2);
    shapes_box(boards, (struct at){0, -0.1, 0}, (struct at){7.4, 0.2, 5.4});
    shapes_box(walls, (struct at){0, 1.5, -2.6}, (struct at){7.4, 3, 0.2});
    shapes_box(walls, (struct at){0, 1.5, 2.6}, (struct at){7.4, 3, 0.2});
    shapes_box(walls, (struct at){3.6, 1.5, 0}, (struct at){0.2, 3, 5});
    for (int i = 0; i < 3; i++) /* the wall between and below two windows */
        shapes_box(walls, (struct at){-3.6, 1.5, 2.2 * (i - 1)}, (struct at){0.2, 3, 0.7});
    shapes_box(walls, (struct at){-3.6, 0.4, 0}, (struct at){0.2, 0.8, 5});
    shapes_box(walls, (struct at){-3.6, 2.8, 0}, (struct at){0.2, 0.4, 5});
    shapes_box(walls, (struct at){0, 3.1, -1.7}, (struct at){7.4, 0.2, 2});
    shapes_box(walls, (struct at){0, 3.1, 1.9}, (struct at){7.4, 0.2, 1.6});
    shapes_box(walls, (struct at){2.4, 3.1, 0.2}, (struct at){2.6, 0.2, 1.9});
    shapes_box(walls, (struct at){-2.6, 3.1, 0.2}, (struct at){2.2, 0.2, 1.9});
    shapes_box(rug, (struct at){0.2, 0.01, 0}, (struct at){3, 0.02, 2.4});
    add_table(wood, (struct at){0.2, 0, 0});
    add_chair(wood, (struct at){0.2, 0, 0.9}, M_PI);
    add_chair(wood, (struct at){0.2, 0, -0.9}, 0);
    shapes_box(sofa, (struct at){2.8, 0.3, -0.8}, (struct at){0.9, 0.5, 2});
    shapes_box(sofa, (struct at){3.2, 0.7, -0.8}, (struct at){0.25, 0.7, 2});
    for (int shelf = 0; shelf < 5; shelf++)
        shapes_box(wood, (struct at){-1, 0.3 + 0.5 * shelf, -2.3}, (struct at){1.8, 0.06, 0.35});
    for (int book = 0; book < 40; book++)
        shapes_box(book % 3 ? sofa : rug, (struct at){-1.8 + 0.2 * (book % 9), 0.5 + 0.5 * (book / 10), -2.3},
                   (struct at){0.07, 0.3, 0.22});
}

/* Columns and arches on both sides of an aisle under a roof that is open in the middle. */
static void make_hall(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *stone = shapes_part(gltf, "stone", 0.75, 0.68, 0.55),
                *floor_mesh = shapes_part(gltf, "floor", 0.5, 0.42, 0.36);
    shapes_box(floor_mesh, (struct at){0, -0.1, 0}, (struct at){12, 0.2, 24});
    for (int side = -1; side <= 1; side += 2) {
        shapes_box(stone, (struct at){6 * side, 3.5, 0}, (struct at){0.4, 7, 24});
        shapes_box(stone, (struct at){0, 3.5, 12 * side}, (struct at){12.4, 7, 0.4});
        shapes_box(stone, (struct at){4.4 * side, 7.1, 0}, (struct at){3.6, 0.3, 24});
        shapes_box(stone, (struct at){2.8 * side, 6.2, 0}, (struct at){0.6, 1.6, 24});
        for (int i = 0; i < 8; i++) {
            double z = 3 * (i - 3.5);
            shapes_cylinder(stone, (struct at){2.8 * side, 0, z}, 0.42, 0.34, 3.9);
            shapes_box(stone, (struct at){2.8 * side, 0.12, z}, (struct at){1.1, 0.24, 1.1});
            shapes_box(stone, (struct at){2.8 * side, 4, z}, (struct at){0.9, 0.3, 0.9});
            for (int k = 0; k < 16; k++) {
                double at = -1.5 + 3 * (k + 0.5) / 16, top = 4.1 + sqrt(fmax(0, 1.1 * 1.1 - at * at)) * 1.1;
                shapes_box(stone, (struct at){2.8 * side, (top + 5.5) / 2, z + 1.5 + at},
                           (struct at){0.5, 5.5 - top, 0.19});
            }
        }
    }
}

static void make_temple(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *marble = shapes_part(gltf, "marble", 0.85, 0.82, 0.75);
    for (int i = 0; i < 3; i++)
        shapes_box(marble, (struct at){0, 0.15 + 0.3 * i, 0}, (struct at){9 - 0.6 * i, 0.3, 13 - 0.6 * i});
    for (int i = 0; i < 26; i++) {
        double x = i < 12  ? -3.3 + 6.6 * (i % 6) / 5
                   : i % 2 ? 3.3
                           : -3.3,
               z = i < 6    ? 5.4
                   : i < 12 ? -5.4
                            : -3.85 + 1.28 * ((i - 12) / 2);
        shapes_cylinder(marble, (struct at){x, 0.9, z}, 0.42, 0.34, 4.2);
        shapes_box(marble, (struct at){x, 5.2, z}, (struct at){0.95, 0.2, 0.95});
    }
    shapes_box(marble, (struct at){0, 5.7, 0}, (struct at){7.8, 0.8, 12});
    shapes_box(marble, (struct at){0, 3, 0}, (struct at){4, 4.6, 8});
    uint32_t first = marble->vertex_count;
    add_roof(marble, (struct at){0, 6.1, 0}, 12.6, 8.4, 1.7);
    shapes_turn(marble, first, (struct at){0, 0, 0}, 1, M_PI / 2);
}

static void make_pyramid(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *sand = shapes_part(gltf, "sandstone", 0.7, 0.55, 0.32),
                *ramp = shapes_part(gltf, "stairs", 0.55, 0.42, 0.25);
    for (int i = 0; i < 9; i++)
        shapes_box(sand, (struct at){0, 0.4 + 0.8 * i, 0}, (struct at){16 - 1.6 * i, 0.8, 16 - 1.6 * i});
    for (int i = 0; i < 27; i++)
        shapes_box(ramp, (struct at){0, 0.15 + 0.267 * i, 8.4 - 0.267 * i}, (struct at){2.2, 0.3, 0.6});
    shapes_box(ramp, (struct at){0, 7.9, 0}, (struct at){2, 1.4, 2});
}

static void make_windmill(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *walls = shapes_part(gltf, "walls", 0.85, 0.83, 0.78),
                *cap = shapes_part(gltf, "cap", 0.35, 0.12, 0.08), *wood = shapes_part(gltf, "sails", 0.4, 0.25, 0.13);
    shapes_cylinder(walls, (struct at){0, 0, 0}, 1.7, 1.1, 4.6);
    shapes_cylinder(cap, (struct at){0, 4.6, 0}, 1.25, 0, 1.2);
    shapes_box(wood, (struct at){0, 0.7, 1.6}, (struct at){0.7, 1.4, 0.2});
    shapes_rod(wood, (struct at){0, 4.5, 0}, (struct at){0, 4.5, 1.8}, 0.15);
    for (int i = 0; i < 4; i++) {
        uint32_t first = wood->vertex_count;
        shapes_box(wood, (struct at){0, 6.2, 1.7}, (struct at){0.12, 3.4, 0.08});
        for (int k = 0; k < 9; k++)
            shapes_box(wood, (struct at){0.38, 5.3 + 0.31 * k, 1.7}, (struct at){0.7, 0.2, 0.04});
        shapes_turn(wood, first, (struct at){0, 4.5, 1.7}, 2, M_PI / 2 * i + 0.5);
    }
}

static void paint_pickets(double u, double v, unsigned char rgba[4])
{
    double at = 4 * u - floor(4 * u), across = fabs(at - 0.5);
    int is_picket = across < 0.3 && v > 0.12 + 0.25 * across, is_rail = fabs(v - 0.35) < 0.05 || fabs(v - 0.8) < 0.05;
    rgba[0] = rgba[1] = 235;
    rgba[2] = 225;
    rgba[3] = is_picket || is_rail ? 255 : 0;
}

/* Its pickets are holes in a texture; a ball is behind it. */
static void make_fence(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *fence = shapes_part(gltf, "fence", 1, 1, 1);
    gltf->materials[0].image = 1 + gltf_add_image(gltf, 256, 256, paint_pickets);
    gltf->materials[0].has_holes = true;
    struct mesh *grass = shapes_part(gltf, "grass", 0.2, 0.42, 0.1), *ball = shapes_part(gltf, "ball", 0.8, 0.12, 0.08);
    shapes_box(grass, (struct at){2, -0.05, 0}, (struct at){4.6, 0.1, 3});
    for (uint32_t i = 0; i < 4; i++) {
        uint32_t first = mesh_add_vertex(fence, i, 0, 0.6);
        mesh_add_vertex(fence, i + 1.0, 0, 0.6);
        mesh_add_vertex(fence, i + 1.0, 1, 0.6);
        mesh_add_vertex(fence, i, 1, 0.6);
        mesh_add_quad(fence, first, first + 1, first + 2, first + 3);
    }
    shapes_ball(ball, (struct at){2.2, 0.55, -0.4}, 0.55);
    shapes_smooth(gltf);
}

const struct gallery_scene gallery_buildings[GALLERY_BUILDINGS] = {
    {"house", make_house},     {"castle", make_castle},     {"temple", make_temple},
    {"pyramid", make_pyramid}, {"windmill", make_windmill}, {"bridge", make_bridge},
    {"city", make_city},       {"stairs", make_stairs},     {"spiral-stairs", make_spiral_stairs},
    {"table", make_table},     {"room", make_room},         {"hall", make_hall},
    {"fence", make_fence},
};
