/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/plants.h"

#include <math.h>

/* Adds a tier of drooping boughs: a rim that goes in and out, with an upper and a lower side. */
static void add_tier(struct mesh *mesh, double low, double high, double radius, struct random *random)
{
    enum { BOUGHS = 11, POINTS = 4, RIM = BOUGHS * POINTS };
    static const double reach[POINTS] = {1, 0.82, 0.55, 0.82};
    uint32_t top = mesh_add_vertex(mesh, 0, high, 0), below = mesh_add_vertex(mesh, 0, low + 0.45 * (high - low), 0);
    uint32_t rim = mesh->vertex_count;
    double turn = random_between(random, 0, M_PI);
    for (int i = 0; i < RIM; i++) {
        double angle = turn + 2 * M_PI * i / RIM, r = radius * reach[i % POINTS] * random_between(random, 0.9, 1.1);
        mesh_add_vertex(mesh, r * cos(angle),
                        low + (1 - reach[i % POINTS]) * 0.5 * (high - low) + random_between(random, -0.05, 0.05),
                        r * sin(angle));
    }
    for (uint32_t i = 0; i < RIM; i++) {
        mesh_add_triangle(mesh, top, rim + (i + 1) % RIM, rim + i);
        mesh_add_triangle(mesh, below, rim + i, rim + (i + 1) % RIM);
    }
}

int plants_add_conifer(struct gltf *gltf, const char *name, int wood, int needles, struct random *random)
{
    enum { TIERS = 8 };
    static const double foot[3] = {0, -0.5, 0}, tip[3] = {0, 6, 0};
    int tree = gltf_add_mesh(gltf, name);
    mesh_add_tube(gltf_add_part(gltf, tree, wood), foot, tip, 0.22, 0.03, 9);
    struct mesh *mesh = gltf_add_part(gltf, tree, needles);
    for (int tier = 0; tier < TIERS; tier++) {
        double part = (double)tier / TIERS, low = 0.9 + 6.2 * part * (1 - 0.12 * part);
        add_tier(mesh, low, low + 1.75 - 0.7 * part, 1.75 * pow(1 - part, 0.85) + 0.12, random);
    }
    return tree;
}

/* Adds a leaf of two folded triangles, at a random point of a ball and with a random orientation. */
static void add_leaf(struct mesh *mesh, const double centre[3], double radius, struct random *random)
{
    double out[3], across[3], length, size = random_between(random, 0.12, 0.24);
    do {
        random_point(random, out);
        length = sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2]);
    } while (length < 0.1 || length > 1);
    random_point(random, across);
    double at[3], far = radius * random_between(random, 0.86, 1.08) / length;
    for (int axis = 0; axis < 3; axis++) {
        at[axis] = centre[axis] + out[axis] * far;
        out[axis] = out[axis] / length + 0.5 * across[axis];
    }
    out[1] -= 0.4;
    uint32_t first = mesh->vertex_count;
    mesh_add_vertex(mesh, at[0], at[1], at[2]);
    mesh_add_vertex(mesh, at[0] + size * (out[0] + across[0]), at[1] + size * (out[1] + across[1]),
                    at[2] + size * (out[2] + across[2]));
    mesh_add_vertex(mesh, at[0] + 2 * size * out[0], at[1] + 2 * size * out[1] - 0.03, at[2] + 2 * size * out[2]);
    mesh_add_vertex(mesh, at[0] + size * (out[0] - across[0]), at[1] + size * (out[1] - across[1]),
                    at[2] + size * (out[2] - across[2]));
    mesh_add_quad(mesh, first, first + 1, first + 2, first + 3);
}

static double leafy(const double d[3], const void *context)
{
    double phase = *(const double *)context;
    return 0.12 * sin(6 * d[0] + phase) * sin(5 * d[1] + phase) + 0.08 * sin(9 * d[2] - 4 * d[0] + phase);
}

int plants_add_broadleaf(struct gltf *gltf, const char *name, int wood, int leaves, struct random *random)
{
    enum { BALLS = 7, LEAVES = 260 };
    static const double foot[3] = {0, -0.5, 0}, fork[3] = {0.1, 2.2, 0};
    int tree = gltf_add_mesh(gltf, name);
    struct mesh *trunk = gltf_add_part(gltf, tree, wood), *crown = gltf_add_part(gltf, tree, leaves);
    mesh_add_tube(trunk, foot, fork, 0.28, 0.18, 10);
    for (int ball = 0; ball < BALLS; ball++) {
        double angle = 2 * M_PI * ball / (BALLS - 1) + random_between(random, -0.3, 0.3),
               out = ball == BALLS - 1 ? 0 : 1.25;
        double centre[3] = {out * cos(angle), (out > 0 ? 3.1 : 4.2) + random_between(random, -0.35, 0.45),
                            out * sin(angle)};
        double radius = random_between(random, 0.9, 1.25), phase = random_between(random, 0, 6);
        mesh_add_tube(trunk, fork, centre, 0.14, 0.04, 7);
        mesh_add_sphere(crown, centre, radius * 0.93, 2, leafy, &phase);
        for (int leaf = 0; leaf < LEAVES; leaf++)
            add_leaf(crown, centre, radius, random);
    }
    return tree;
}

static double rocky(const double d[3], const void *context)
{
    double p = *(const double *)context;
    double ridges = fabs(sin(2.3 * d[0] + p) + sin(2.9 * d[1] - 1.7 * d[2] + p)),
           grain = sin(13 * d[0] + p) * sin(11 * d[2] + 7 * d[1]);
    return -0.22 * ridges + 0.03 * grain + 0.1 * sin(4 * d[2] + p);
}

int plants_add_rock(struct gltf *gltf, const char *name, int stone, struct random *random)
{
    static const double centre[3] = {0, 0.25, 0};
    double phase = random_between(random, 0, 6);
    int rock = gltf_add_mesh(gltf, name);
    mesh_add_sphere(gltf_add_part(gltf, rock, stone), centre, 1, 3, rocky, &phase);
    return rock;
}

int plants_add_grass(struct gltf *gltf, const char *name, int green, struct random *random)
{
    enum { BLADES = 36 };
    int tuft = gltf_add_mesh(gltf, name);
    struct mesh *mesh = gltf_add_part(gltf, tuft, green);
    for (int blade = 0; blade < BLADES; blade++) {
        double angle = random_between(random, 0, 2 * M_PI), c = cos(angle), s = sin(angle),
               r = random_between(random, 0, 0.35);
        double bend = random_between(random, 0.1, 0.4), height = random_between(random, 0.4, 0.9),
               turn = random_between(random, -1, 1);
        double x = r * cos(angle + turn), z = r * sin(angle + turn), wide = 0.03;
        uint32_t first = mesh_add_vertex(mesh, x - wide * s, -0.1, z + wide * c);
        mesh_add_vertex(mesh, x + wide * s, -0.1, z - wide * c);
        mesh_add_vertex(mesh, x + bend * 0.4 * c + wide * 0.7 * s, height * 0.6, z + bend * 0.4 * s - wide * 0.7 * c);
        mesh_add_vertex(mesh, x + bend * 0.4 * c - wide * 0.7 * s, height * 0.6, z + bend * 0.4 * s + wide * 0.7 * c);
        mesh_add_vertex(mesh, x + bend * c, height, z + bend * s);
        mesh_add_quad(mesh, first, first + 1, first + 2, first + 3);
        mesh_add_triangle(mesh, first + 3, first + 2, first + 4);
    }
    return tuft;
}
