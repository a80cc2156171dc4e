/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/surface.h"

#include <math.h>
#include <stdlib.h>

#include "tests/bench/bvhd_bench/tree.h"

/* Computes a normal whose length is twice the triangle's area, and returns that length. */
static double perpendicular(const struct ply *mesh, uint32_t triangle, double ret_normal[3])
{
    double edges[2][3];
    const float *corners[3];
    for (int k = 0; k < 3; k++)
        corners[k] = mesh->positions + (size_t)3 * mesh->indices[(size_t)3 * triangle + (size_t)k];
    for (int k = 0; k < 2; k++)
        for (int axis = 0; axis < 3; axis++)
            edges[k][axis] = (double)corners[k + 1][axis] - corners[0][axis];
    for (int axis = 0; axis < 3; axis++) {
        int next = (axis + 1) % 3, last = (axis + 2) % 3;
        ret_normal[axis] = edges[0][next] * edges[1][last] - edges[0][last] * edges[1][next];
    }
    return hypot(hypot(ret_normal[0], ret_normal[1]), ret_normal[2]);
}

void surface_normal(const struct ply *mesh, uint32_t triangle, double ret_normal[3])
{
    double length = perpendicular(mesh, triangle, ret_normal);
    for (int axis = 0; axis < 3; axis++)
        ret_normal[axis] /= length;
}

struct surface surface_of(const struct ply *mesh)
{
    struct surface surface = {.mesh = mesh};
    double sum = 0, normal[3];
    surface.triangles = tree_need(mesh->triangle_count, sizeof *surface.triangles);
    surface.sums = tree_need(mesh->triangle_count, sizeof *surface.sums);
    for (uint32_t i = 0; i < mesh->triangle_count; i++) {
        double area = perpendicular(mesh, i, normal);
        if (!(area > 0) || !isfinite(area))
            continue;
        surface.triangles[surface.count] = i;
        surface.sums[surface.count++] = sum += area;
    }
    return surface;
}

void surface_finish(struct surface *surface)
{
    if (!surface)
        return;
    free(surface->triangles);
    free(surface->sums);
    *surface = (struct surface){0};
}

static struct surface_point draw_from(const struct ply *mesh, uint32_t triangle, double u, double v)
{
    struct surface_point point = {.triangle = triangle};
    if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    const uint32_t *corners = mesh->indices + (size_t)3 * triangle;
    for (int axis = 0; axis < 3; axis++) {
        double a = mesh->positions[(size_t)3 * corners[0] + (size_t)axis],
               b = mesh->positions[(size_t)3 * corners[1] + (size_t)axis];
        double c = mesh->positions[(size_t)3 * corners[2] + (size_t)axis], value = (1 - u - v) * a + u * b + v * c;
        /* Rounding must not move the point out of the triangle's box. */
        point.position[axis] = fmin(fmax(value, fmin(fmin(a, b), c)), fmax(fmax(a, b), c));
    }
    return point;
}

/* The first triangle whose summed area exceeds `area`. */
static uint32_t triangle_at(const struct surface *surface, double area)
{
    uint32_t low = 0, high = surface->count - 1;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (surface->sums[middle] > area)
            high = middle;
        else
            low = middle + 1;
    }
    return surface->triangles[low];
}

struct surface_point surface_draw(const struct surface *surface, struct random *random)
{
    double at = random_between(random, 0, surface->sums[surface->count - 1]);
    double u = random_between(random, 0, 1), v = random_between(random, 0, 1);
    return draw_from(surface->mesh, triangle_at(surface, at), u, v);
}

struct surface_point surface_draw_triangle(const struct surface *surface, struct random *random)
{
    uint32_t triangle = surface->triangles[random_next(random) % surface->count];
    double u = random_between(random, 0, 1), v = random_between(random, 0, 1);
    return draw_from(surface->mesh, triangle, u, v);
}
