/* SPDX-License-Identifier: Apache-2.0 */
/* gallery_nature.c - scenes of plants, land, sky and of mathematics. */
#include <math.h>
#include <stddef.h>

#include "tests/support/scene/gallery.h"
#include "tests/support/scene/plants.h"
#include "tests/support/scene/shapes.h"

static void place(struct gltf *gltf, int mesh, struct at at, double angle, double size)
{
    double c = size * cos(angle), s = size * sin(angle);
    const struct gltf_node node = {.name = "plant",
                                   .number = gltf->node_count,
                                   .mesh = mesh,
                                   .parent = GLTF_NONE,
                                   .matrix = {c, 0, s, at.x, 0, size, 0, at.y, -s, 0, c, at.z}};
    gltf_add_node(gltf, &node);
}

static int add_tree(struct gltf *gltf, int is_conifer, struct random *random)
{
    int wood = gltf_add_material(gltf, "wood", 0.28, 0.17, 0.09),
        leaves = is_conifer ? gltf_add_material(gltf, "needles", 0.07, 0.22, 0.11)
                            : gltf_add_material(gltf, "leaves", 0.25, 0.42, 0.08);
    return is_conifer ? plants_add_conifer(gltf, "conifer", wood, leaves, random)
                      : plants_add_broadleaf(gltf, "tree", wood, leaves, random);
}

static void make_tree(struct gltf *gltf, struct random *random)
{
    place(gltf, add_tree(gltf, 0, random), (struct at){0, 0, 0}, 0, 1);
}

static void make_conifer(struct gltf *gltf, struct random *random)
{
    place(gltf, add_tree(gltf, 1, random), (struct at){0, 0, 0}, 0, 1);
}

static void make_forest(struct gltf *gltf, struct random *random)
{
    int trees[2] = {add_tree(gltf, 0, random), add_tree(gltf, 1, random)};
    shapes_box(shapes_part(gltf, "ground", 0.2, 0.33, 0.1), (struct at){0, -0.6, 0}, (struct at){44, 1.2, 44});
    for (int i = 0; i < 130; i++) {
        struct at at = {random_between(random, -20, 20), 0, random_between(random, -20, 20)};
        if (fabs(at.x - 3 * sin(0.2 * at.z)) > 2) /* a path leads through it */
            place(gltf, trees[random_next(random) % 3 > 0], at, random_between(random, 0, 6),
                  random_between(random, 0.7, 1.3));
    }
}

static double peak(double x, double z)
{
    double height = 0, size = 1;
    for (int i = 0; i < 6; i++, size *= 0.5) {
        double a = x / (9 * size) + 2.3 * i, b = z / (9 * size) - 1.7 * i;
        height += 4.2 * size * (1 - fabs(sin(a + 0.8 * sin(b)) * cos(b - 0.6 * sin(a))) * 1.6);
    }
    return height;
}

static void make_mountains(struct gltf *gltf, struct random *random)
{
    (void)random;
    enum { SIDE = 160 };
    static const double limits[4] = {-1e9, 1.2, 4.6, 1e9};
    struct mesh *bands[3] = {shapes_part(gltf, "meadow", 0.18, 0.32, 0.08), shapes_part(gltf, "rock", 0.33, 0.28, 0.24),
                             shapes_part(gltf, "snow", 0.9, 0.92, 0.95)};
    for (int i = 0; i < SIDE * SIDE; i++) {
        double corners[4][3], mean = 0;
        for (int k = 0; k < 4; k++) {
            corners[k][0] = 0.25 * (i % SIDE + (k == 1 || k == 2) - SIDE / 2.0);
            corners[k][2] = 0.25 * (i / SIDE + (k > 1) - SIDE / 2.0);
            corners[k][1] = fmax(peak(corners[k][0], corners[k][2]), -0.3);
            mean += corners[k][1] / 4;
        }
        for (int band = 0; band < 3; band++)
            if (mean >= limits[band] && mean < limits[band + 1]) {
                mesh_add_loose_triangle(bands[band], corners[0], corners[2], corners[1]);
                mesh_add_loose_triangle(bands[band], corners[0], corners[3], corners[2]);
            }
    }
    shapes_box(shapes_part(gltf, "lake", 0.08, 0.22, 0.35), (struct at){0, -0.6, 0}, (struct at){40, 0.9, 40});
}

static void make_snowman(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *snow = shapes_part(gltf, "snow", 0.95, 0.96, 0.98);
    shapes_smooth(gltf);
    struct mesh *coal = shapes_part(gltf, "coal", 0.03, 0.03, 0.03),
                *carrot = shapes_part(gltf, "carrot", 0.85, 0.3, 0.04),
                *wood = shapes_part(gltf, "wood", 0.25, 0.14, 0.07);
    shapes_ball(snow, (struct at){0, 0.9, 0}, 1);
    shapes_ball(snow, (struct at){0, 2.2, 0}, 0.7);
    shapes_ball(snow, (struct at){0, 3.2, 0}, 0.5);
    for (int i = 0; i < 5; i++)
        shapes_ball(
            coal, i < 2 ? (struct at){i ? 0.17 : -0.17, 3.32, 0.44} : (struct at){0, 1.9 + 0.27 * (i - 2), 0.66}, 0.07);
    uint32_t first = carrot->vertex_count;
    shapes_cylinder(carrot, (struct at){0, 3.2, 0.45}, 0.09, 0, 0.6);
    shapes_turn(carrot, first, (struct at){0, 3.2, 0.45}, 0, M_PI / 2);
    shapes_cylinder(coal, (struct at){0, 3.6, 0}, 0.6, 0.6, 0.07);
    shapes_cylinder(coal, (struct at){0, 3.6, 0}, 0.36, 0.36, 0.65);
    for (int side = -1; side <= 1; side += 2)
        shapes_rod(wood, (struct at){0.5 * side, 2.4, 0}, (struct at){1.5 * side, 2.9, 0.2}, 0.05);
}

static void make_rocket(struct gltf *gltf, struct random *random)
{
    (void)random;
    double hull[24][2];
    for (int i = 0; i < 24; i++) {
        double t = i / 23.0;
        hull[i][0] = 0.75 * sqrt(fmax(0, sin(M_PI * (0.2 + 0.8 * t))));
        hull[i][1] = 0.8 + 4.4 * t;
    }
    struct mesh *body = shapes_part(gltf, "hull", 0.85, 0.85, 0.86);
    shapes_smooth(gltf);
    struct mesh *red = shapes_part(gltf, "fins", 0.75, 0.08, 0.05), *glass = shapes_part(gltf, "window", 0.1, 0.3, 0.5);
    static const double fin[4][2] = {{0, -0.7}, {1.1, -1.6}, {1.1, -0.9}, {0.1, 0.6}};
    shapes_lathe(body, (struct at){0, 0, 0}, (const double(*)[2])hull, 24, 48);
    shapes_cylinder(red, (struct at){0, 0.4, 0}, 0.55, 0.4, 0.5);
    for (int i = 0; i < 3; i++) {
        uint32_t first = red->vertex_count;
        shapes_plate(red, (struct at){0.5, 1.7, 0}, fin, 4, 0.1);
        shapes_turn(red, first, (struct at){0, 0, 0}, 1, 2 * M_PI * i / 3 + M_PI / 6);
    }
    shapes_ring(red, (struct at){0, 3.4, 0.7}, 2, 0.28, 0.06);
    shapes_ball(glass, (struct at){0, 3.4, 0.52}, 0.27);
}

/* Adds what is left of a cube after Menger's removal of its middles. */
static void add_sponge(struct mesh *mesh, struct at middle, double side, int level)
{
    if (level == 0) {
        shapes_box(mesh, middle, (struct at){side, side, side});
        return;
    }
    for (int i = 0; i < 27; i++) {
        int x = i % 3 - 1, y = i / 3 % 3 - 1, z = i / 9 - 1;
        if ((x == 0) + (y == 0) + (z == 0) < 2)
            add_sponge(mesh, (struct at){middle.x + x * side / 3, middle.y + y * side / 3, middle.z + z * side / 3},
                       side / 3, level - 1);
    }
}

static void make_sponge(struct gltf *gltf, struct random *random)
{
    (void)random;
    add_sponge(shapes_part(gltf, "sponge", 0.75, 0.55, 0.2), (struct at){0, 1.5, 0}, 3, 3);
}

static void make_helix(struct gltf *gltf, struct random *random)
{
    (void)random;
    enum { POINTS = 160 };
    struct mesh *strands[2] = {shapes_part(gltf, "strand", 0.1, 0.3, 0.65), shapes_part(gltf, "other", 0.7, 0.12, 0.1)},
                *rungs = shapes_part(gltf, "rungs", 0.75, 0.72, 0.62);
    struct at path[2][POINTS];
    for (int i = 0; i < POINTS; i++)
        for (int strand = 0; strand < 2; strand++) {
            double angle = 0.085 * i + M_PI * strand;
            path[strand][i] = (struct at){1.1 * cos(angle), 0.2 + 0.04 * i, 1.1 * sin(angle)};
        }
    for (int strand = 0; strand < 2; strand++)
        shapes_pipe(strands[strand], path[strand], POINTS, 0.17, 0.17, 20, 0);
    for (int i = 4; i < POINTS; i += 8)
        shapes_rod(rungs, path[0][i], path[1][i], 0.07);
}

/* Continents are where some waves add up, with ice at the poles. */
static void paint_globe(double u, double v, unsigned char rgba[4])
{
    double east = 2 * M_PI * u, north = M_PI * (0.5 - v), x = cos(north) * sin(east), y = sin(north),
           z = cos(north) * cos(east);
    double land = sin(3.1 * x + 1.3) * sin(2.7 * y + 0.4) + 0.8 * sin(4.3 * z - 1.9 * x + 2) +
                  0.35 * sin(9 * x + 7 * y) + 0.3 * sin(11 * z - 8 * y) + 0.15 * sin(23 * x + 19 * z);
    int is_ice = fabs(y) > 0.9 + 0.03 * sin(9 * east), is_land = land > 0.12;
    rgba[0] = (unsigned char)(is_ice ? 240 : is_land ? 100 + 50 * land : 20);
    rgba[1] = (unsigned char)(is_ice ? 245 : is_land ? 140 - 20 * fabs(y) : 70);
    rgba[2] = (unsigned char)(is_ice ? 250 : is_land ? 60 : 150);
    rgba[3] = 255;
}

static void make_globe(struct gltf *gltf, struct random *random)
{
    (void)random;
    struct mesh *earth = shapes_part(gltf, "earth", 1, 1, 1);
    shapes_smooth(gltf);
    gltf->materials[0].image = 1 + gltf_add_image(gltf, 512, 256, paint_globe);
    gltf->materials[0].mapping = GLTF_BY_SPHERE;
    static const double centre[3] = {0, 0, 0};
    mesh_add_sphere(earth, centre, 1, 5, NULL, NULL);
    struct mesh *brass = shapes_part(gltf, "brass", 0.7, 0.45, 0.15);
    struct at arc[40];
    for (int i = 0; i < 40; i++) {
        double angle = -M_PI / 2 + M_PI * i / 39;
        arc[i] = (struct at){-1.12 * cos(angle), 1.12 * sin(angle), 0};
    }
    shapes_pipe(brass, arc, 40, 0.05, 0.05, 12, 0);
    shapes_cylinder(brass, (struct at){0, -1.7, 0}, 0.6, 0.5, 0.12);
    shapes_rod(brass, (struct at){0, -1.6, 0}, (struct at){0, -1.1, 0}, 0.08);
}

static void make_saturn(struct gltf *gltf, struct random *random)
{
    (void)random;
    static const double rings[3][2] = {{1.35, 1.75}, {1.82, 2.1}, {2.16, 2.3}};
    struct mesh *planet = shapes_part(gltf, "planet", 0.8, 0.62, 0.38);
    shapes_smooth(gltf);
    struct mesh *ice = shapes_part(gltf, "rings", 0.72, 0.66, 0.55);
    shapes_ball(planet, (struct at){0, 0, 0}, 1);
    for (int i = 0; i < 3; i++) {
        const double profile[5][2] = {
            {rings[i][0], -0.01}, {rings[i][1], -0.01}, {rings[i][1], 0.01}, {rings[i][0], 0.01}, {rings[i][0], -0.01}};
        shapes_lathe(ice, (struct at){0, 0, 0}, profile, 5, 96);
    }
    shapes_turn(ice, 0, (struct at){0, 0, 0}, 2, 0.35);
    shapes_turn(planet, 0, (struct at){0, 0, 0}, 2, 0.35);
}

static void make_mushrooms(struct gltf *gltf, struct random *random)
{
    static const double stem[][2] = {{0, 0}, {0.3, 0}, {0.24, 0.3}, {0.2, 0.7}, {0.18, 1.1}};
    static const double cap[][2] = {{0.18, 1.0}, {0.75, 0.95}, {0.82, 1.05}, {0.72, 1.3}, {0.45, 1.52}, {0, 1.6}};
    struct mesh *stems = shapes_part(gltf, "stems", 0.85, 0.8, 0.7),
                *caps = shapes_part(gltf, "caps", 0.75, 0.07, 0.04),
                *dots = shapes_part(gltf, "dots", 0.95, 0.93, 0.88);
    for (int i = 0; i < 3; i++) {
        struct at foot = {i == 1 ? 1.3 : i == 2 ? -1.1 : 0, 0, i == 0 ? 0 : 0.5};
        double size = i == 0 ? 1.3 : 0.75;
        uint32_t first[3] = {stems->vertex_count, caps->vertex_count, dots->vertex_count};
        struct mesh *meshes[3] = {stems, caps, dots};
        shapes_lathe(stems, (struct at){0, 0, 0}, stem, 5, 32);
        shapes_lathe(caps, (struct at){0, 0, 0}, cap, 6, 48);
        for (int dot = 0; dot < 11; dot++) {
            double angle = 2.4 * dot + random_between(random, 0, 0.4), out = 0.1 + 0.6 * sqrt(dot / 11.0);
            shapes_ball(dots, (struct at){out * cos(angle), 1.6 - 0.75 * out * out, out * sin(angle)}, 0.08);
        }
        for (int k = 0; k < 3; k++)
            for (uint32_t v = first[k]; v < meshes[k]->vertex_count; v++) {
                float *at = meshes[k]->vertices[v];
                at[0] = (float)(foot.x + size * (double)at[0]);
                at[1] = (float)(foot.y + size * (double)at[1]);
                at[2] = (float)(foot.z + size * (double)at[2]);
            }
    }
}

static void make_boat(struct gltf *gltf, struct random *random)
{
    (void)random;
    enum { RIBS = 21, POINTS = 9 };
    struct mesh *hull = shapes_part(gltf, "hull", 0.4, 0.2, 0.1), *wood = shapes_part(gltf, "mast", 0.5, 0.35, 0.2),
                *cloth = shapes_part(gltf, "sails", 0.9, 0.87, 0.78), *sea = shapes_part(gltf, "sea", 0.06, 0.25, 0.4);
    uint32_t first = hull->vertex_count;
    for (int i = 0; i < RIBS; i++)
        for (int k = 0; k < POINTS; k++) {
            double t = 2.0 * i / (RIBS - 1) - 1, wide = 0.75 * sqrt(fmax(0, 1 - t * t)),
                   angle = M_PI * k / (POINTS - 1);
            mesh_add_vertex(hull, 2.2 * t, 0.75 + 0.15 * t * t - 0.8 * sin(angle) * sqrt(fmax(0, 1 - t * t)),
                            wide * cos(angle));
        }
    mesh_add_rows(hull, first, RIBS, POINTS, 0);
    shapes_box(wood, (struct at){0, 0.62, 0}, (struct at){2.6, 0.05, 1.1});
    shapes_rod(wood, (struct at){0, 0.3, 0}, (struct at){0, 4.2, 0}, 0.06);
    shapes_rod(wood, (struct at){0, 1.1, 0}, (struct at){-1.9, 1.1, 0}, 0.04);
    static const double sail[3][2] = {{-1.15, -0.9}, {0.6, -0.9}, {0.6, 2}},
                        jib[3][2] = {{-0.5, 1.6}, {-0.5, -1}, {0.9, -1}};
    shapes_plate(cloth, (struct at){-0.65, 2.1, 0}, sail, 3, 0.03);
    shapes_plate(cloth, (struct at){0.75, 2.0, 0}, jib, 3, 0.03);
    shapes_box(sea, (struct at){0, 0.05, 0}, (struct at){7, 0.3, 4});
}

static void make_flower(struct gltf *gltf, struct random *random)
{
    (void)random;
    enum { PETALS = 14 };
    struct mesh *petals = shapes_part(gltf, "petals", 0.95, 0.72, 0.05),
                *seeds = shapes_part(gltf, "seeds", 0.2, 0.1, 0.04),
                *green = shapes_part(gltf, "green", 0.15, 0.38, 0.08);
    struct at stem[30];
    double petal[20][2];
    for (int i = 0; i < 30; i++)
        stem[i] = (struct at){0.25 * sin(i / 12.0), 3.0 * i / 29, -0.15};
    for (int i = 0; i < 20; i++) {
        petal[i][0] = 0.26 * cos(2 * M_PI * i / 20);
        petal[i][1] = 0.62 * sin(2 * M_PI * i / 20);
    }
    struct at head = {stem[29].x, 3.1, 0};
    shapes_pipe(green, stem, 30, 0.09, 0.07, 14, 0);
    for (int i = 0; i < PETALS; i++) {
        uint32_t first = petals->vertex_count;
        shapes_plate(petals, (struct at){head.x, head.y + 1, i % 2 * 0.06}, (const double(*)[2])petal, 20, 0.03);
        shapes_turn(petals, first, head, 2, 2 * M_PI * i / PETALS);
    }
    uint32_t first = seeds->vertex_count;
    shapes_cylinder(seeds, (struct at){head.x, head.y, -0.05}, 0.55, 0.45, 0.2);
    shapes_turn(seeds, first, head, 0, M_PI / 2);
    for (int side = -1; side <= 1; side += 2) {
        first = green->vertex_count;
        shapes_plate(green, (struct at){0.25 + 0.7 * side, 1.2, -0.15}, (const double(*)[2])petal, 20, 0.03);
        shapes_turn(green, first, (struct at){0.25 + 0.7 * side, 1.2, -0.15}, 2, -side * 1.0);
    }
}

const struct gallery_scene gallery_nature[GALLERY_NATURE] = {
    {"tree", make_tree},     {"conifer", make_conifer},     {"forest", make_forest},   {"mountains", make_mountains},
    {"flower", make_flower}, {"mushrooms", make_mushrooms}, {"snowman", make_snowman}, {"boat", make_boat},
    {"rocket", make_rocket}, {"globe", make_globe},         {"saturn", make_saturn},   {"helix", make_helix},
    {"sponge", make_sponge},
};
