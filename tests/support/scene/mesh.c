/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/mesh.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void *grow(void *array, uint32_t count, uint32_t *capacity, size_t size)
{
    if (count < *capacity)
        return array;
    *capacity = *capacity ? *capacity * 2 : 64;
    void *grown = realloc(array, *capacity * size);
    if (!grown) {
        fprintf(stderr, "no memory for a mesh\n");
        exit(1);
    }
    return grown;
}

void mesh_finish(struct mesh *mesh)
{
    if (!mesh)
        return;
    free(mesh->vertices);
    free(mesh->radii);
    free(mesh->triangles);
    free(mesh->lines);
    *mesh = (struct mesh){0};
}

uint32_t mesh_add_vertex(struct mesh *mesh, double x, double y, double z)
{
    mesh->vertices = grow(mesh->vertices, mesh->vertex_count, &mesh->vertex_capacity, sizeof *mesh->vertices);
    float *vertex = mesh->vertices[mesh->vertex_count];
    vertex[0] = (float)x;
    vertex[1] = (float)y;
    vertex[2] = (float)z;
    return mesh->vertex_count++;
}

uint32_t mesh_add_round_vertex(struct mesh *mesh, const double centre[3], double radius)
{
    mesh->radii = grow(mesh->radii, mesh->vertex_count, &mesh->radius_capacity, sizeof *mesh->radii);
    mesh->radii[mesh->vertex_count] = (float)radius;
    return mesh_add_vertex(mesh, centre[0], centre[1], centre[2]);
}

void mesh_add_line(struct mesh *mesh, uint32_t a, uint32_t b)
{
    mesh->lines = grow(mesh->lines, mesh->line_count, &mesh->line_capacity, sizeof *mesh->lines);
    mesh->lines[mesh->line_count][0] = a;
    mesh->lines[mesh->line_count++][1] = b;
}

void mesh_add_triangle(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t c)
{
    mesh->triangles = grow(mesh->triangles, mesh->triangle_count, &mesh->triangle_capacity, sizeof *mesh->triangles);
    uint32_t *triangle = mesh->triangles[mesh->triangle_count++];
    triangle[0] = a;
    triangle[1] = b;
    triangle[2] = c;
}

void mesh_add_quad(struct mesh *mesh, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    mesh_add_triangle(mesh, a, b, c);
    mesh_add_triangle(mesh, a, c, d);
}

void mesh_add_loose_triangle(struct mesh *mesh, const double a[3], const double b[3], const double c[3])
{
    uint32_t first = mesh_add_vertex(mesh, a[0], a[1], a[2]);
    mesh_add_vertex(mesh, b[0], b[1], b[2]);
    mesh_add_vertex(mesh, c[0], c[1], c[2]);
    mesh_add_triangle(mesh, first, first + 1, first + 2);
}

void mesh_add_rows(struct mesh *mesh, uint32_t first, uint32_t rows, uint32_t columns, int closed)
{
    for (uint32_t row = 0; row + 1 < rows; row++)
        for (uint32_t column = 0; column < (closed ? columns : columns - 1); column++) {
            uint32_t next = (column + 1) % columns, low = first + row * columns, high = low + columns;
            mesh_add_quad(mesh, low + column, high + column, high + next, low + next);
        }
}

void mesh_add_lathe(struct mesh *mesh, const double (*profile)[2], uint32_t profile_count, uint32_t sides)
{
    uint32_t first = mesh->vertex_count;
    for (uint32_t i = 0; i < profile_count; i++)
        for (uint32_t side = 0; side < sides; side++) {
            double angle = 2 * M_PI * side / sides;
            mesh_add_vertex(mesh, profile[i][0] * cos(angle), profile[i][1], profile[i][0] * sin(angle));
        }
    mesh_add_rows(mesh, first, profile_count, sides, 1);
}

/* Finds two unit vectors perpendicular to `along` and to each other. */
static void across(const double along[3], double ret_u[3], double ret_v[3])
{
    int least = fabs(along[0]) < fabs(along[1]) ? 0 : 1;
    least = fabs(along[2]) < fabs(along[least]) ? 2 : least;
    int next = (least + 1) % 3, last = (least + 2) % 3;
    double length = hypot(along[next], along[last]), full = sqrt(along[least] * along[least] + length * length);
    ret_u[least] = 0;
    ret_u[next] = -along[last] / length;
    ret_u[last] = along[next] / length;
    for (int axis = 0; axis < 3; axis++)
        ret_v[axis] =
            (along[(axis + 1) % 3] * ret_u[(axis + 2) % 3] - along[(axis + 2) % 3] * ret_u[(axis + 1) % 3]) / full;
}

void mesh_add_tube(struct mesh *mesh, const double from[3], const double to[3], double from_radius, double to_radius,
                   uint32_t sides)
{
    double along[3] = {to[0] - from[0], to[1] - from[1], to[2] - from[2]}, u[3], v[3];
    across(along, u, v);
    uint32_t first = mesh->vertex_count;
    for (int end = 0; end < 2; end++)
        for (uint32_t side = 0; side < sides; side++) {
            double angle = 2 * M_PI * side / sides, radius = end ? to_radius : from_radius, x[3];
            for (int axis = 0; axis < 3; axis++)
                x[axis] = (end ? to : from)[axis] + radius * (u[axis] * cos(angle) - v[axis] * sin(angle));
            mesh_add_vertex(mesh, x[0], x[1], x[2]);
        }
    mesh_add_rows(mesh, first, 2, sides, 1);
    for (uint32_t side = 1; side + 1 < sides; side++) {
        mesh_add_triangle(mesh, first, first + side, first + side + 1);
        mesh_add_triangle(mesh, first + sides, first + sides + side + 1, first + sides + side);
    }
}

/* The vertex number of the point (i, j) of a triangular patch of n rows. */
static uint32_t patch_index(uint32_t n, uint32_t i, uint32_t j)
{
    return i * (n + 1) - i * (i - 1) / 2 + j;
}

struct bumpy {
    const double *centre;
    double radius;
    double (*bumps)(const double direction[3], const void *context);
    const void *context;
};

static void add_on_sphere(struct mesh *mesh, const struct bumpy *sphere, const double point[3])
{
    double length = sqrt(point[0] * point[0] + point[1] * point[1] + point[2] * point[2]);
    double direction[3] = {point[0] / length, point[1] / length, point[2] / length};
    double radius = sphere->radius * (1 + (sphere->bumps ? sphere->bumps(direction, sphere->context) : 0));
    mesh_add_vertex(mesh, sphere->centre[0] + radius * direction[0], sphere->centre[1] + radius * direction[1],
                    sphere->centre[2] + radius * direction[2]);
}

/*
 * Adds one face of the icosahedron, cut into n * n triangles. Vertices on seams exist once for each face, at equal
 * positions.
 */
static void add_patch(struct mesh *mesh, const struct bumpy *sphere, const double *corners[3], uint32_t n)
{
    uint32_t first = mesh->vertex_count;
    for (uint32_t i = 0; i <= n; i++)
        for (uint32_t j = 0; i + j <= n; j++) {
            double point[3];
            for (int axis = 0; axis < 3; axis++)
                point[axis] = corners[0][axis] * (n - i - j) + corners[1][axis] * i + corners[2][axis] * j;
            add_on_sphere(mesh, sphere, point);
        }
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = 0; i + j < n; j++) {
            uint32_t a = first + patch_index(n, i, j), b = first + patch_index(n, i + 1, j),
                     c = first + patch_index(n, i, j + 1);
            mesh_add_triangle(mesh, a, b, c);
            if (i + j + 1 < n)
                mesh_add_triangle(mesh, b, first + patch_index(n, i + 1, j + 1), c);
        }
}

void mesh_add_sphere(struct mesh *mesh, const double centre[3], double radius, uint32_t level,
                     double (*bumps)(const double direction[3], const void *context), const void *context)
{
    static const double g = 1.6180339887498949;
    static const double corners[12][3] = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                                          {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
    static const unsigned char faces[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                                               {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                                               {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                                               {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
    struct bumpy sphere = {centre, radius, bumps, context};
    for (int face = 0; face < 20; face++) {
        const double *patch[3] = {corners[faces[face][0]], corners[faces[face][1]], corners[faces[face][2]]};
        add_patch(mesh, &sphere, patch, 1u << level);
    }
}

static int write_body(const struct mesh *mesh, FILE *file)
{
    for (uint32_t i = 0; i < mesh->vertex_count; i++)
        if (fwrite(mesh->vertices[i], sizeof mesh->vertices[i], 1, file) != 1 ||
            (mesh->radii && fwrite(&mesh->radii[i], sizeof mesh->radii[i], 1, file) != 1))
            return -1;
    for (uint32_t i = 0; i < mesh->triangle_count; i++)
        if (putc(3, file) == EOF || fwrite(mesh->triangles[i], sizeof mesh->triangles[i], 1, file) != 1)
            return -1;
    return 0;
}

static int write_header(const struct mesh *mesh, const char *comment, FILE *file)
{
    fprintf(file, "ply\nformat binary_little_endian 1.0\ncomment %s\nelement vertex %u\n", comment, mesh->vertex_count);
    fprintf(file, "property float x\nproperty float y\nproperty float z\n%s",
            mesh->radii ? "property float radius\n" : "");
    if (mesh->triangle_count || !mesh->radii)
        fprintf(file, "element face %u\nproperty list uchar int vertex_indices\n", mesh->triangle_count);
    fprintf(file, "end_header\n");
    return ferror(file) ? -1 : 0;
}

int mesh_write_ply(const struct mesh *mesh, const char *comment, const char *path)
{
    FILE *file = fopen(path, "wb");
    if (!file)
        return -1;
    int result = write_header(mesh, comment, file) != 0 ? -1 : write_body(mesh, file);
    return fclose(file) != 0 ? -1 : result;
}
