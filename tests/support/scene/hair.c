/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/hair.h"

#include <math.h>
#include <stddef.h>

static const double golden_angle = 2.39996322972865332;

static double length_of(const double v[3])
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static void normalize(double v[3])
{
    double length = length_of(v);
    for (int axis = 0; axis < 3; axis++)
        v[axis] /= length;
}

/* Finds a root: directions wind down from the crown, and those on the face are turned to the back. */
static void find_root(uint32_t strand, uint32_t strands, double ret_root[3])
{
    double y = 1 - 1.25 * (strand + 0.5) / strands, around = sqrt(1 - y * y), angle = golden_angle * strand;
    double z = around * sin(angle);
    bool is_face = z > 0.35 && y < 0.55;
    ret_root[0] = around * cos(angle);
    ret_root[1] = y;
    ret_root[2] = is_face ? -z : z;
}

/*
 * Moves the tip of a strand by one step: it keeps its direction in part, falls, curls, and stays outside the head. The
 * curls of neighbours are alike, because their phase follows from the root.
 */
static void grow_strand(const double root[3], double step, double t, double curl, double at[3], double direction[3])
{
    double phase = 9 * t + 4 * root[0] + 3 * root[2];
    direction[0] += curl * sin(phase) + 0.03 * root[0];
    direction[1] -= 0.16 + 0.1 * t;
    direction[2] += curl * cos(phase) - 0.02;
    normalize(direction);
    for (int axis = 0; axis < 3; axis++)
        at[axis] += step * direction[axis];
    double distance = length_of(at), least = 1.03 + 0.06 * t;
    for (int axis = 0; axis < 3 && distance < least; axis++)
        at[axis] *= least / distance;
}

static void add_strand(struct mesh *mesh, uint32_t strand, uint32_t strands, struct random *random)
{
    double root[3], at[3], direction[3];
    find_root(strand, strands, root);
    double step = random_between(random, 1.9, 2.5) / (HAIR_POINTS - 1), curl = random_between(random, 0.1, 0.2);
    double radius = random_between(random, 0.011, 0.015);
    for (int axis = 0; axis < 3; axis++) {
        at[axis] = root[axis];
        direction[axis] = root[axis] + random_between(random, -0.15, 0.15);
    }
    for (uint32_t i = 0; i < HAIR_POINTS; i++) {
        double t = (double)i / (HAIR_POINTS - 1);
        uint32_t vertex = mesh_add_round_vertex(mesh, at, radius * (1 - 0.85 * t));
        if (i)
            mesh_add_line(mesh, vertex - 1, vertex);
        grow_strand(root, step, t, curl, at, direction);
    }
}

void hair_make(struct mesh *mesh, uint32_t strands, struct random *random)
{
    for (uint32_t i = 0; i < strands; i++)
        add_strand(mesh, i, strands, random);
}

/* The direction of a strand at its vertex `i` of HAIR_POINTS. */
static void tangent_at(const float (*strand)[3], uint32_t i, double ret_tangent[3])
{
    const float *before = strand[i ? i - 1 : 0], *after = strand[i + 1 < HAIR_POINTS ? i + 1 : i];
    for (int axis = 0; axis < 3; axis++)
        ret_tangent[axis] = (double)after[axis] - before[axis];
    normalize(ret_tangent);
}

/* Takes the part along the tangent from `side`, so that rings of neighbours are not twisted against each other. */
static void carry_side(const double tangent[3], double side[3])
{
    double along = side[0] * tangent[0] + side[1] * tangent[1] + side[2] * tangent[2];
    for (int axis = 0; axis < 3; axis++)
        side[axis] -= along * tangent[axis];
    normalize(side);
}

static void add_ring(struct mesh *mesh, const float centre[3], double radius, const double tangent[3],
                     const double side[3], uint32_t sides)
{
    for (uint32_t k = 0; k < sides; k++) {
        double angle = -2 * M_PI * k / sides, point[3];
        for (int axis = 0; axis < 3; axis++) {
            int next = (axis + 1) % 3, last = (axis + 2) % 3;
            double other = tangent[next] * side[last] - tangent[last] * side[next];
            point[axis] = centre[axis] + radius * (cos(angle) * side[axis] + sin(angle) * other);
        }
        mesh_add_vertex(mesh, point[0], point[1], point[2]);
    }
}

static void add_tube(struct mesh *mesh, const float (*strand)[3], const float *radii, uint32_t sides)
{
    uint32_t first = mesh->vertex_count, last = first + (HAIR_POINTS - 1) * sides;
    double side[3] = {0.31, 0.52, 0.79}, tangent[3];
    for (uint32_t i = 0; i < HAIR_POINTS; i++) {
        tangent_at(strand, i, tangent);
        carry_side(tangent, side);
        add_ring(mesh, strand[i], (double)radii[i], tangent, side, sides);
    }
    mesh_add_rows(mesh, first, HAIR_POINTS, sides, 1);
    for (uint32_t k = 1; k + 1 < sides; k++) {
        mesh_add_triangle(mesh, first, first + k, first + k + 1);
        mesh_add_triangle(mesh, last, last + k + 1, last + k);
    }
}

void hair_make_tubes(const struct mesh *hair, uint32_t sides, struct mesh *mesh)
{
    for (uint32_t first = 0; first < hair->vertex_count; first += HAIR_POINTS)
        add_tube(mesh, (const float(*)[3])hair->vertices + first, hair->radii + first, sides);
}

/* Adds a mesh of one material, and a node for it. */
static struct mesh *add_part(struct gltf *gltf, const char *name, int material)
{
    struct gltf_node node = {.name = name,
                             .number = -1,
                             .mesh = gltf_add_mesh(gltf, name),
                             .parent = GLTF_NONE,
                             .matrix = {1, [5] = 1, [10] = 1}};
    gltf_add_node(gltf, &node);
    return gltf_add_part(gltf, node.mesh, material);
}

void hair_make_scene(struct gltf *gltf, uint32_t strands, bool is_tubes, struct random *random)
{
    static const double centre[3] = {0, 0, 0};
    struct mesh *scalp = add_part(gltf, "scalp", gltf_add_material(gltf, "skin", 0.62, 0.4, 0.3));
    gltf->materials[0].is_smooth = true;
    mesh_add_sphere(scalp, centre, 1, 4, NULL, NULL);
    struct mesh *part = add_part(gltf, "hair", gltf_add_material(gltf, "hair", 0.34, 0.14, 0.05)), lines = {0};
    hair_make(is_tubes ? &lines : part, strands, random);
    if (is_tubes)
        hair_make_tubes(&lines, HAIR_SIDES, part);
    mesh_finish(&lines);
}

/*
 * The shell is swept by a circle that grows while it turns around the axis and moves down. Points are as dense in its
 * late parts as in its early ones in proportion to their radii, which grow with the circle.
 */
static void add_shell_point(struct mesh *plain, struct mesh *stripes, struct random *random)
{
    const double turns = 6.5, growth = 0.068, most = exp(growth * 2 * M_PI * turns);
    double size = pow(most, sqrt(random_between(random, 0, 1))) / most, angle = log(size) / growth;
    double around = random_between(random, 0, 2 * M_PI), rib = 1 + 0.05 * sin(16 * angle);
    double reach = size * (0.62 + 0.6 * rib * cos(around));
    double at[3] = {reach * cos(angle), 1.35 - size * (1.95 - 0.62 * rib * sin(around)), -reach * sin(angle)};
    bool in_stripe = sin(5 * around + 1.5 * sin(3 * angle)) > 0.45;
    mesh_add_round_vertex(in_stripe ? stripes : plain, at, size * random_between(random, 0.01, 0.018));
}

void cloud_make(struct mesh *plain, struct mesh *stripes, uint32_t points, struct random *random)
{
    for (uint32_t i = 0; i < points; i++)
        add_shell_point(plain, stripes, random);
}

void cloud_make_scene(struct gltf *gltf, uint32_t points, struct random *random)
{
    struct mesh *plain = add_part(gltf, "shell", gltf_add_material(gltf, "cream", 0.8, 0.66, 0.48));
    struct mesh *stripes = add_part(gltf, "stripes", gltf_add_material(gltf, "brown", 0.42, 0.16, 0.07));
    cloud_make(plain, stripes, points, random);
}
