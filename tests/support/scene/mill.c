/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/mill.h"

#include <math.h>

#include "tests/support/scene/shapes.h"

enum { KEYS = 49, PLANES = 3 };
static const double pi = 3.14159265358979323846, seconds = 4, hub_height = 4.5;

static double time_of(int key)
{
    return seconds * key / (KEYS - 1);
}

static void add_mill(struct gltf *gltf)
{
    struct mesh *walls = shapes_part(gltf, "walls", 0.85, 0.83, 0.78),
                *cap = shapes_part(gltf, "cap", 0.35, 0.12, 0.08), *wood = shapes_part(gltf, "wood", 0.4, 0.25, 0.13),
                *grass = shapes_part(gltf, "grass", 0.3, 0.42, 0.16);
    shapes_cylinder(walls, (struct at){0, 0, 0}, 1.7, 1.1, 4.6);
    shapes_cylinder(cap, (struct at){0, 4.6, 0}, 1.25, 0, 1.2);
    shapes_box(wood, (struct at){0, 0.7, 1.6}, (struct at){0.7, 1.4, 0.2});
    shapes_rod(wood, (struct at){0, hub_height, 0}, (struct at){0, hub_height, 1.8}, 0.15);
    shapes_cylinder(grass, (struct at){0, -0.5, 0}, 8, 7, 0.5);
}

/* Makes the sails around the origin, where their hub is. */
static void add_sails(struct gltf *gltf)
{
    struct mesh *wood = shapes_part(gltf, "sails", 0.45, 0.28, 0.14),
                *cloth = shapes_part(gltf, "cloth", 0.8, 0.3, 0.2);
    for (int i = 0; i < 4; i++) {
        uint32_t first = wood->vertex_count, first_cloth = cloth->vertex_count;
        shapes_box(wood, (struct at){0, 1.7, 0}, (struct at){0.12, 3.4, 0.08});
        for (int k = 0; k < 9; k++)
            shapes_box(wood, (struct at){0.38, 0.8 + 0.31 * k, 0}, (struct at){0.7, 0.06, 0.05});
        shapes_box(cloth, (struct at){0.42, 2.04, 0.02}, (struct at){0.62, 2.5, 0.01});
        shapes_turn(wood, first, (struct at){0, 0, 0}, 2, pi / 2 * i);
        shapes_turn(cloth, first_cloth, (struct at){0, 0, 0}, 2, pi / 2 * i);
    }
}

/* The sails turn by a quarter in a second. */
static void turn_sails(struct gltf *gltf, int node)
{
    struct gltf_key keys[KEYS];
    for (int i = 0; i < KEYS; i++) {
        const double half = (0.5 - pi / 2 * time_of(i)) / 2;
        keys[i] = (struct gltf_key){time_of(i), {0, hub_height, 1.7}, {0, 0, sin(half), cos(half)}};
    }
    gltf_move(gltf, node, keys, KEYS);
}

/* Makes a folded dart, which flies towards +z. */
static void add_plane(struct mesh *paper)
{
    const double nose[3] = {0, 0, 1.4}, left[3] = {-0.8, 0.12, -1}, right[3] = {0.8, 0.12, -1},
                 left_fold[3] = {-0.06, 0, -1}, right_fold[3] = {0.06, 0, -1}, keel[3] = {0, -0.35, -1};
    mesh_add_loose_triangle(paper, nose, left_fold, left);
    mesh_add_loose_triangle(paper, nose, right, right_fold);
    mesh_add_loose_triangle(paper, nose, keel, left_fold);
    mesh_add_loose_triangle(paper, nose, right_fold, keel);
}

/* Flies once round the mill, to the left, and leans towards it. */
static void fly(struct gltf *gltf, int node, double radius, double height, double phase)
{
    const double lean_sine = sin(-0.25), lean_cosine = cos(-0.25);
    struct gltf_key keys[KEYS];
    for (int i = 0; i < KEYS; i++) {
        const double angle = phase + 2 * pi * time_of(i) / seconds, sine = sin((angle + pi) / 2),
                     cosine = cos((angle + pi) / 2);
        keys[i] = (struct gltf_key){
            .time = time_of(i),
            .translation = {radius * cos(angle), height + 0.4 * sin(2 * angle), -radius * sin(angle)},
            .rotation = {sine * lean_sine, sine * lean_cosine, cosine * lean_sine, cosine * lean_cosine}};
    }
    gltf_move(gltf, node, keys, KEYS);
}

void mill_make(struct gltf *gltf)
{
    static const double heights[PLANES] = {3, 4.6, 6.2}, radii[PLANES] = {5, 4.6, 4.2};
    static const double colours[PLANES][3] = {{0.15, 0.35, 0.7}, {0.9, 0.65, 0.15}, {0.85, 0.85, 0.8}};
    add_mill(gltf);
    const int sails = gltf->node_count;
    add_sails(gltf);
    turn_sails(gltf, sails);
    turn_sails(gltf, sails + 1);
    for (int i = 0; i < PLANES; i++) {
        const int node = gltf->node_count;
        add_plane(shapes_part(gltf, "plane", colours[i][0], colours[i][1], colours[i][2]));
        fly(gltf, node, radii[i], heights[i], 2 * pi * i / PLANES + 2.6);
    }
}
