/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/scene/shapes.h"

#include <math.h>

struct mesh *shapes_part_of(struct gltf *gltf, const char *name, int material)
{
    const struct gltf_node node = {.name = name,
                                   .number = -1,
                                   .mesh = gltf_add_mesh(gltf, name),
                                   .parent = GLTF_NONE,
                                   .matrix = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    gltf_add_node(gltf, &node);
    return gltf_add_part(gltf, node.mesh, material);
}

struct mesh *shapes_part(struct gltf *gltf, const char *name, double red, double green, double blue)
{
    return shapes_part_of(gltf, name, gltf_add_material(gltf, name, red, green, blue));
}

void shapes_smooth(struct gltf *gltf)
{
    gltf->materials[gltf->material_count - 1].is_smooth = true;
}

static void add_faces(struct mesh *mesh, struct at middle, struct at size, int inward)
{
    static const int faces[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
    for (int face = 0; face < 6; face++) {
        uint32_t first = mesh->vertex_count;
        for (int k = 0; k < 4; k++) {
            int corner = faces[face][inward ? 3 - k : k];
            mesh_add_vertex(mesh, middle.x + size.x * ((corner & 1) - 0.5),
                            middle.y + size.y * ((corner >> 1 & 1) - 0.5), middle.z + size.z * ((corner >> 2) - 0.5));
        }
        mesh_add_quad(mesh, first, first + 1, first + 2, first + 3);
    }
}

void shapes_box(struct mesh *mesh, struct at middle, struct at size)
{
    add_faces(mesh, middle, size, 0);
}

void shapes_room(struct mesh *mesh, struct at middle, struct at size)
{
    add_faces(mesh, middle, size, 1);
}

static void move(struct mesh *mesh, uint32_t first, struct at by)
{
    for (uint32_t i = first; i < mesh->vertex_count; i++) {
        mesh->vertices[i][0] += (float)by.x;
        mesh->vertices[i][1] += (float)by.y;
        mesh->vertices[i][2] += (float)by.z;
    }
}

void shapes_lathe(struct mesh *mesh, struct at foot, const double (*profile)[2], uint32_t count, uint32_t sides)
{
    uint32_t first = mesh->vertex_count;
    mesh_add_lathe(mesh, profile, count, sides);
    move(mesh, first, foot);
}

void shapes_cylinder(struct mesh *mesh, struct at foot, double radius, double top_radius, double height)
{
    const double body[2][2] = {{radius, 0}, {top_radius, height}}, lid[2][2] = {{top_radius, height}, {0, height}},
                 base[2][2] = {{0, 0}, {radius, 0}};
    shapes_lathe(mesh, foot, base, 2, 40);
    shapes_lathe(mesh, foot, body, 2, 40);
    shapes_lathe(mesh, foot, lid, 2, 40);
}

void shapes_ball(struct mesh *mesh, struct at middle, double radius)
{
    double profile[25][2];
    for (int i = 0; i < 25; i++) {
        double angle = M_PI * (i / 24.0 - 0.5);
        profile[i][0] = i % 24 ? radius * cos(angle) : 0;
        profile[i][1] = radius * sin(angle);
    }
    shapes_lathe(mesh, middle, (const double(*)[2])profile, 25, 40);
}

void shapes_rod(struct mesh *mesh, struct at from, struct at to, double radius)
{
    const double a[3] = {from.x, from.y, from.z}, b[3] = {to.x, to.y, to.z};
    mesh_add_tube(mesh, a, b, radius, radius, 20);
}

static struct at minus(struct at a, struct at b)
{
    return (struct at){a.x - b.x, a.y - b.y, a.z - b.z};
}

static double dot(struct at a, struct at b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static struct at cross(struct at a, struct at b)
{
    return (struct at){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static struct at unit(struct at a)
{
    double length = sqrt(dot(a, a));
    return (struct at){a.x / length, a.y / length, a.z / length};
}

/* Returns the part of `side` that is perpendicular to the unit vector `along`, as a unit vector. */
static struct at straighten(struct at side, struct at along)
{
    double part = dot(side, along);
    return unit((struct at){side.x - part * along.x, side.y - part * along.y, side.z - part * along.z});
}

static struct at direction(const struct at *path, uint32_t count, uint32_t i, int closed)
{
    uint32_t next = i + 1 < count ? i + 1 : closed ? 0 : i, last = i ? i - 1 : closed ? count - 1 : 0;
    return unit(minus(path[next], path[last]));
}

/* Returns by which angle the section of a closed pipe is twisted after one round. */
static double find_twist(const struct at *path, uint32_t count, struct at first_side)
{
    struct at side = first_side, along = direction(path, count, 0, 1);
    for (uint32_t i = 1; i <= count; i++)
        side = straighten(side, direction(path, count, i % count, 1));
    return atan2(dot(side, cross(along, first_side)), dot(side, first_side));
}

void shapes_pipe(struct mesh *mesh, const struct at *path, uint32_t count, double radius, double last_radius,
                 uint32_t sides, int closed)
{
    uint32_t first = mesh->vertex_count;
    struct at along = direction(path, count, 0, closed), side = {0.3, 1, 0.2};
    side = straighten(fabs(along.y) > 0.9 ? (struct at){1, 0.1, 0} : side, along);
    double twist = closed ? find_twist(path, count, side) : 0;
    for (uint32_t i = 0; i < count; i++) {
        along = direction(path, count, i, closed);
        side = straighten(side, along);
        struct at other = cross(along, side);
        double r = radius + (last_radius - radius) * i / (count - 1.0);
        for (uint32_t k = 0; k < sides; k++) {
            double angle = -2 * M_PI * k / sides - twist * i / count, c = r * cos(angle), s = r * sin(angle);
            mesh_add_vertex(mesh, path[i].x + c * side.x + s * other.x, path[i].y + c * side.y + s * other.y,
                            path[i].z + c * side.z + s * other.z);
        }
    }
    mesh_add_rows(mesh, first, count, sides, 1);
    uint32_t last = first + (count - 1) * sides;
    for (uint32_t k = 0; k < sides && closed; k++)
        mesh_add_quad(mesh, last + k, first + k, first + (k + 1) % sides, last + (k + 1) % sides);
    for (uint32_t k = 1; k + 1 < sides && !closed; k++) {
        mesh_add_triangle(mesh, first, first + k, first + k + 1);
        mesh_add_triangle(mesh, last, last + k + 1, last + k);
    }
}

void shapes_ring(struct mesh *mesh, struct at middle, int axis, double radius, double thickness)
{
    enum { POINTS = 64 };
    struct at path[POINTS];
    for (int i = 0; i < POINTS; i++) {
        double c = radius * cos(2 * M_PI * i / POINTS), s = radius * sin(2 * M_PI * i / POINTS);
        path[i] = axis == 0   ? (struct at){middle.x, middle.y + c, middle.z + s}
                  : axis == 1 ? (struct at){middle.x + s, middle.y, middle.z + c}
                              : (struct at){middle.x + c, middle.y + s, middle.z};
    }
    shapes_pipe(mesh, path, POINTS, thickness, thickness, 24, 1);
}

void shapes_plate(struct mesh *mesh, struct at middle, const double (*outline)[2], uint32_t count, double depth)
{
    for (int side = 0; side < 2; side++) { /* the front, and then the back */
        double z = middle.z + depth * (side ? -0.5 : 0.5);
        uint32_t hub = mesh_add_vertex(mesh, middle.x, middle.y, z), rim = mesh->vertex_count;
        for (uint32_t i = 0; i < count; i++)
            mesh_add_vertex(mesh, middle.x + outline[i][0], middle.y + outline[i][1], z);
        for (uint32_t i = 0; i < count; i++) {
            uint32_t a = rim + i, b = rim + (i + 1) % count;
            mesh_add_triangle(mesh, hub, side ? b : a, side ? a : b);
        }
    }
    for (uint32_t i = 0; i < count; i++) {
        uint32_t edge = mesh->vertex_count, next = (i + 1) % count;
        for (int k = 0; k < 4; k++) {
            const double *point = outline[k == 0 || k == 3 ? i : next];
            mesh_add_vertex(mesh, middle.x + point[0], middle.y + point[1], middle.z + depth * (k < 2 ? -0.5 : 0.5));
        }
        mesh_add_quad(mesh, edge, edge + 1, edge + 2, edge + 3);
    }
}

void shapes_turn(struct mesh *mesh, uint32_t first, struct at middle, int axis, double angle)
{
    const double centre[3] = {middle.x, middle.y, middle.z}, c = cos(angle), s = sin(angle);
    int y = (axis + 1) % 3, z = (axis + 2) % 3;
    for (uint32_t i = first; i < mesh->vertex_count; i++) {
        float *vertex = mesh->vertices[i];
        double a = (double)vertex[y] - centre[y], b = (double)vertex[z] - centre[z];
        vertex[y] = (float)(centre[y] + c * a - s * b);
        vertex[z] = (float)(centre[z] + s * a + c * b);
    }
}
