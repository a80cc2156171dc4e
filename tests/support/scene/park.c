/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/park.h"

#include <math.h>

#include "tests/support/scene/plants.h"

static const double island_radius = 53, plateau_radius = 17, plateau_height = 3;
static const double pond[2] = {-27, -17}, pond_radius = 12, water_height = -0.2;

struct materials {
    int grass, soil, water, marble, bronze, wood, needles, leaves, blossom, stone, blades;
};

static struct materials add_materials(struct gltf *gltf)
{
    return (struct materials){
        .grass = gltf_add_material(gltf, "grass", 0.22, 0.36, 0.10),
        .soil = gltf_add_material(gltf, "soil", 0.30, 0.20, 0.13),
        .water = gltf_add_material(gltf, "water", 0.10, 0.28, 0.36),
        .marble = gltf_add_material(gltf, "marble", 0.80, 0.77, 0.70),
        .bronze = gltf_add_material(gltf, "bronze", 0.75, 0.38, 0.14),
        .wood = gltf_add_material(gltf, "wood", 0.28, 0.17, 0.09),
        .needles = gltf_add_material(gltf, "needles", 0.07, 0.22, 0.11),
        .leaves = gltf_add_material(gltf, "leaves", 0.25, 0.42, 0.08),
        .blossom = gltf_add_material(gltf, "blossom", 0.78, 0.38, 0.42),
        .stone = gltf_add_material(gltf, "stone", 0.42, 0.40, 0.37),
        .blades = gltf_add_material(gltf, "blades", 0.32, 0.48, 0.12),
    };
}

/* 0 below `low`, 1 above `high`, and smooth in between. */
static double smooth(double low, double high, double x)
{
    double t = fmin(1, fmax(0, (x - low) / (high - low)));
    return t * t * (3 - 2 * t);
}

static double ground(double x, double z)
{
    double hills = 1.5 * sin(0.07 * x + 0.6) * cos(0.062 * z) + 0.9 * sin(0.13 * x - 0.11 * z + 1) +
                   0.12 * sin(0.71 * x) * sin(0.63 * z);
    double height =
        1.2 + hills + (plateau_height - 1.2 - hills) * smooth(plateau_radius + 7, plateau_radius, hypot(x, z));
    double from_pond = hypot(x - pond[0], z - pond[1]) * (1 + 0.12 * sin(3 * atan2(z - pond[1], x - pond[0])));
    return height + (-2.2 - height) * smooth(pond_radius + 4, pond_radius - 6, from_pond);
}

static double underside(double x, double z)
{
    double r = fmin(1, hypot(x, z) / island_radius),
           rough = sin(0.21 * x + 0.13 * z) * sin(0.17 * z - 1) + 0.5 * sin(0.47 * x) * cos(0.41 * z);
    return -1.5 - 24 * pow(1 - r * r, 0.8) * (1 + 0.16 * rough) - 5 * (1 - r) * fabs(rough);
}

/* Adds a disc as a square grid bent to a circle, so that no triangle is thin. */
static void add_disc(struct mesh *mesh, uint32_t side, double (*height)(double x, double z), int upside)
{
    uint32_t first = mesh->vertex_count;
    for (uint32_t row = 0; row < side; row++)
        for (uint32_t column = 0; column < side; column++) {
            double u = 2.0 * column / (side - 1) - 1, v = 2.0 * row / (side - 1) - 1;
            double x = island_radius * u * sqrt(1 - v * v / 2), z = island_radius * v * sqrt(1 - u * u / 2);
            mesh_add_vertex(mesh, upside ? x : -x, height(x, z), z);
        }
    mesh_add_rows(mesh, first, side, side, 0);
    if (!upside)
        for (uint32_t i = first; i < mesh->vertex_count; i++)
            mesh->vertices[i][0] = -mesh->vertices[i][0];
}

static void place(struct gltf *gltf, const char *name, int number, int mesh, int parent, const double at[3],
                  double turn, const double scale[3])
{
    double c = cos(turn), s = sin(turn);
    struct gltf_node node = {
        name,
        number,
        mesh,
        parent,
        {c * scale[0], 0, s * scale[2], at[0], 0, scale[1], 0, at[1], -s * scale[0], 0, c * scale[2], at[2]}};
    gltf_add_node(gltf, &node);
}

static int add_group(struct gltf *gltf, const char *name)
{
    static const double at[3] = {0, 0, 0}, scale[3] = {1, 1, 1};
    place(gltf, name, -1, GLTF_NONE, GLTF_NONE, at, 0, scale);
    return gltf->node_count - 1;
}

static double rim(double x, double z)
{
    return -1.5 + (ground(x, z) + 1.5) * 0.5;
}

static void add_island(struct gltf *gltf, const struct materials *materials, uint32_t size)
{
    static const double at[3] = {0, 0, 0}, scale[3] = {1, 1, 1};
    static const double disc[2][2] = {{18, 0}, {0, 0}};
    enum { EDGE = 512 };
    double lake[3] = {pond[0], water_height, pond[1]};
    int island = gltf_add_mesh(gltf, "island"), water = gltf_add_mesh(gltf, "pond");
    uint32_t side = (uint32_t)sqrt(size / 2.5) + 8;
    add_disc(gltf_add_part(gltf, island, materials->grass), side, ground, 1);
    struct mesh *soil = gltf_add_part(gltf, island, materials->soil);
    add_disc(soil, side / 2, underside, 0);
    uint32_t first = soil->vertex_count;
    for (int row = 0; row < 3; row++)
        for (int i = 0; i < EDGE; i++) {
            double angle = 2 * M_PI * i / EDGE, x = island_radius * cos(angle), z = island_radius * sin(angle);
            double y = row == 0   ? -1.5
                       : row == 1 ? rim(x, z)
                                  : ground(x, z),
                   bulge = row == 1 ? 1.004 + 0.004 * sin(40 * angle) : 1;
            mesh_add_vertex(soil, x * bulge, y, z * bulge);
        }
    mesh_add_rows(soil, first, 3, EDGE, 1);
    mesh_add_lathe(gltf_add_part(gltf, water, materials->water), disc, 2, 96);
    place(gltf, "island", -1, island, GLTF_NONE, at, 0, scale);
    place(gltf, "pond", -1, water, GLTF_NONE, lake, 0, scale);
}

/* Adds a (2, 3) torus knot: a tube around a curve on a torus. */
static void add_knot(struct mesh *mesh)
{
    enum { ALONG = 420, AROUND = 28 };
    uint32_t first = mesh->vertex_count;
    for (int i = 0; i < ALONG; i++) {
        double t = 2 * M_PI * i / ALONG, r = 2 + cos(3 * t),
               centre[3] = {r * cos(2 * t), r * sin(2 * t), -1.25 * sin(3 * t)};
        double out[3] = {cos(3 * t) * cos(2 * t), cos(3 * t) * sin(2 * t), -sin(3 * t)};
        double way[3] = {-3 * sin(3 * t) * cos(2 * t) - 2 * r * sin(2 * t),
                         -3 * sin(3 * t) * sin(2 * t) + 2 * r * cos(2 * t), -3.75 * cos(3 * t)};
        double side[3] = {way[1] * out[2] - way[2] * out[1], way[2] * out[0] - way[0] * out[2],
                          way[0] * out[1] - way[1] * out[0]};
        double length = sqrt(side[0] * side[0] + side[1] * side[1] + side[2] * side[2]);
        for (int j = 0; j < AROUND; j++) {
            double angle = 2 * M_PI * j / AROUND, radius = 0.52 + 0.05 * sin(7 * angle + 12 * t), x[3];
            for (int axis = 0; axis < 3; axis++)
                x[axis] = centre[axis] + radius * (cos(angle) * out[axis] + sin(angle) * side[axis] / length);
            mesh_add_vertex(mesh, x[0], x[1], x[2]);
        }
    }
    mesh_add_rows(mesh, first, ALONG, AROUND, 1);
    uint32_t last = first + (ALONG - 1) * AROUND;
    for (uint32_t j = 0; j < AROUND; j++)
        mesh_add_quad(mesh, last + j, first + j, first + (j + 1) % AROUND, last + (j + 1) % AROUND);
}

/* Adds a Doric column: 20 flutes, tapering, with a round foot and head. */
static void add_column(struct mesh *mesh)
{
    enum { ROWS = 9, SIDES = 20 * 4 };
    static const double foot[5][2] = {{0.62, 0}, {0.66, 0.1}, {0.62, 0.22}, {0.52, 0.3}, {0, 0.3}};
    static const double head[5][2] = {{0.36, 5.6}, {0.5, 5.75}, {0.62, 5.95}, {0.62, 6.15}, {0, 6.15}};
    mesh_add_lathe(mesh, foot, 5, 40);
    uint32_t first = mesh->vertex_count;
    for (int row = 0; row < ROWS; row++)
        for (int i = 0; i < SIDES; i++) {
            double part = (double)row / (ROWS - 1), angle = 2 * M_PI * i / SIDES, flute = fabs(sin(10 * angle));
            double radius = (0.5 - 0.12 * part * part) * (0.93 + 0.07 * (1 - flute));
            mesh_add_vertex(mesh, radius * cos(angle), 0.3 + 5.35 * part, radius * sin(angle));
        }
    mesh_add_rows(mesh, first, ROWS, SIDES, 1);
    mesh_add_lathe(mesh, head, 5, 40);
}

static void add_temple(struct gltf *gltf, const struct materials *materials)
{
    enum { COLUMNS = 14 };
    static const double steps[8][2] = {{12.2, -0.6}, {12.2, 0.4}, {11.4, 0.4}, {11.4, 0.8},
                                       {10.6, 0.8},  {10.6, 1.2}, {4, 1.2},    {0, 1.2}};
    static const double beam[9][2] = {{8.5, 7.35}, {9.6, 7.35}, {9.6, 8},    {9.75, 8},  {9.75, 8.2},
                                      {9.6, 8.2},  {9.6, 9},    {10.1, 9.3}, {10.1, 9.5}};
    static const double inner[3][2] = {{10.1, 9.5}, {8.5, 9.5}, {8.5, 7.35}};
    static const double pedestal[7][2] = {{3, 1.2}, {3, 1.7}, {2.6, 1.8}, {2.2, 2.2}, {2.2, 3.6}, {2.5, 3.8}, {0, 3.8}};
    static const double scale[3] = {1, 1, 1}, big[3] = {1.75, 1.75, 1.75};
    double centre[3] = {0, plateau_height, 0}, above[3] = {0, plateau_height + 9.2, 0};
    int temple = gltf_add_mesh(gltf, "temple"), column = gltf_add_mesh(gltf, "column"),
        knot = gltf_add_mesh(gltf, "knot");
    struct mesh *marble = gltf_add_part(gltf, temple, materials->marble);
    mesh_add_lathe(marble, steps, 8, 112);
    mesh_add_lathe(marble, beam, 9, 112);
    mesh_add_lathe(marble, inner, 3, 112);
    mesh_add_lathe(gltf_add_part(gltf, temple, materials->stone), pedestal, 7, 80);
    add_column(gltf_add_part(gltf, column, materials->marble));
    add_knot(gltf_add_part(gltf, knot, materials->bronze));
    place(gltf, "temple", -1, temple, GLTF_NONE, centre, 0, scale);
    place(gltf, "knot", -1, knot, GLTF_NONE, above, 0.6, big);
    int group = add_group(gltf, "columns");
    for (int i = 0; i < COLUMNS; i++) {
        double angle = 2 * M_PI * (i + 0.5) / COLUMNS,
               at[3] = {9.1 * cos(angle), plateau_height + 1.2, 9.1 * sin(angle)};
        place(gltf, "column", i, column, group, at, -angle, scale);
    }
}

/* Finds a free spot on the island, outside of the temple's grounds and the pond. */
static void find_spot(struct random *random, double margin, double ret_at[3])
{
    do {
        ret_at[0] = random_between(random, -island_radius, island_radius);
        ret_at[2] = random_between(random, -island_radius, island_radius);
        ret_at[1] = ground(ret_at[0], ret_at[2]);
    } while (hypot(ret_at[0], ret_at[2]) > island_radius - margin ||
             hypot(ret_at[0], ret_at[2]) < plateau_radius + margin || ret_at[1] < water_height + 0.25);
}

/* The density of the woods; a path from the temple to the island's edge stays free. */
static double woodland(double x, double z)
{
    if (z < 0 && fabs(x + 3 * sin(0.1 * z)) < 5)
        return 0;
    return smooth(-0.5, 0.9, sin(0.085 * x + 2) * sin(0.075 * z - 0.5) + 0.35 * sin(0.2 * x + 0.17 * z)) *
           smooth(plateau_radius + 3, plateau_radius + 14, hypot(x, z));
}

struct kind {
    const char *name;
    int meshes[3];
    int mesh_count, count;
    double low, high; /* range of scales */
    int wooded;
};

static void scatter(struct gltf *gltf, const char *group_name, const struct kind *kind, struct random *random)
{
    int group = add_group(gltf, group_name);
    for (int i = 0; i < kind->count; i++) {
        double at[3], size = random_between(random, kind->low, kind->high);
        do
            find_spot(random, 2, at);
        while (kind->wooded && random_between(random, 0, 1) > woodland(at[0], at[2]));
        double scale[3] = {size * random_between(random, 0.85, 1.15), size * random_between(random, 0.85, 1.2),
                           size * random_between(random, 0.85, 1.15)};
        int mesh = kind->meshes[random_next(random) % (uint64_t)kind->mesh_count];
        place(gltf, kind->name, i, mesh, group, at, random_between(random, 0, 2 * M_PI), scale);
    }
}

void park_make(struct gltf *gltf, uint32_t size, struct random *random)
{
    struct materials m = add_materials(gltf);
    add_island(gltf, &m, size);
    add_temple(gltf, &m);
    struct kind conifers = {"conifer", {0}, 2, 200, 0.8, 1.7, 1}, broadleaf = {"tree", {0}, 3, 56, 0.9, 1.7, 1};
    struct kind rocks = {"rock", {0}, 3, 130, 0.15, 1.1, 0}, grass = {"tuft", {0}, 2, 1900, 0.6, 1.3, 0};
    conifers.meshes[0] = plants_add_conifer(gltf, "spruce", m.wood, m.needles, random);
    conifers.meshes[1] = plants_add_conifer(gltf, "fir", m.wood, m.needles, random);
    broadleaf.meshes[0] = plants_add_broadleaf(gltf, "lime", m.wood, m.leaves, random);
    broadleaf.meshes[1] = plants_add_broadleaf(gltf, "oak", m.wood, m.leaves, random);
    broadleaf.meshes[2] = plants_add_broadleaf(gltf, "cherry", m.wood, m.blossom, random);
    rocks.meshes[0] = plants_add_rock(gltf, "boulder", m.stone, random);
    rocks.meshes[1] = plants_add_rock(gltf, "slab", m.stone, random);
    rocks.meshes[2] = plants_add_rock(gltf, "pebble", m.stone, random);
    grass.meshes[0] = plants_add_grass(gltf, "sedge", m.blades, random);
    grass.meshes[1] = plants_add_grass(gltf, "fescue", m.blades, random);
    scatter(gltf, "conifers", &conifers, random);
    scatter(gltf, "trees", &broadleaf, random);
    scatter(gltf, "rocks", &rocks, random);
    scatter(gltf, "grass", &grass, random);
}
