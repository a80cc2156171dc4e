/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/rays.h"

#include <float.h>
#include <math.h>

enum { PICKS = 64 }; /* random triangles that are tried before a search in order begins */

/* The height, in ulps, from which on a triangle counts as more than a line. */
#define RESOLVED 16
/* The distance, in heights of a triangle, at which one ulp of a unit direction moves a ray by 1/64 of the height. */
#define FARTHEST 0x1p18

uint64_t rays_random(uint64_t *state)
{
    uint64_t value = *state += UINT64_C(0x9e3779b97f4a7c15);
    value = (value ^ value >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    value = (value ^ value >> 27) * UINT64_C(0x94d049bb133111eb);
    return value ^ value >> 31;
}

double rays_uniform(uint64_t *state)
{
    return (double)(rays_random(state) >> 11) * 0x1p-53;
}

struct scene_box {
    double min[3], max[3];
};

static void transform_point(const float *matrix, const float point[3], double ret_world[3])
{
    for (int row = 0; row < 3; row++)
        ret_world[row] = matrix ? (double)matrix[4 * row] * point[0] + (double)matrix[4 * row + 1] * point[1] +
                                      (double)matrix[4 * row + 2] * point[2] + matrix[4 * row + 3]
                                : point[row];
}

/* A triangle in world space, and the dimensions that decide how a ray can be aimed at it. */
struct facet {
    double corners[3][3];
    double longest; /* the longest edge */
    double height; /* the smallest height */
    double ulp; /* the distance between floats at its largest coordinate */
};

static double length3(const double v[3])
{
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static void measure(struct facet *facet)
{
    double sides[3][3], normal[3], largest = 0;
    facet->longest = 0;
    for (int k = 0; k < 3; k++) {
        for (int axis = 0; axis < 3; axis++) {
            sides[k][axis] = facet->corners[(k + 1) % 3][axis] - facet->corners[k][axis];
            largest = fmax(largest, fabs(facet->corners[k][axis]));
        }
        facet->longest = fmax(facet->longest, length3(sides[k]));
    }
    for (int axis = 0; axis < 3; axis++) {
        int y = (axis + 1) % 3, z = (axis + 2) % 3;
        normal[axis] = sides[0][y] * sides[1][z] - sides[0][z] * sides[1][y];
    }
    facet->height = facet->longest > 0 ? length3(normal) / facet->longest : 0;
    facet->ulp = largest * FLT_EPSILON;
}

/* Returns false for a triangle that cannot be hit. */
static bool fetch_triangle(const struct oracle_mesh *mesh, uint32_t triangle, struct facet *ret_facet)
{
    for (int k = 0; k < 3; k++) {
        uint64_t at = (uint64_t)3 * triangle + k;
        double *corner = ret_facet->corners[k];
        transform_point(mesh->transform, mesh->positions + (uint64_t)3 * (mesh->indices ? mesh->indices[at] : at),
                        corner);
        if (!isfinite(corner[0]) || !isfinite(corner[1]) || !isfinite(corner[2]))
            return false;
    }
    measure(ret_facet);
    return ret_facet->height > 0;
}

/* Returns false when no triangle can be hit. */
static bool find_box(const struct oracle_mesh *meshes, uint32_t mesh_count, struct scene_box *ret_box)
{
    struct scene_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (uint32_t mesh = 0; mesh < mesh_count; mesh++)
        for (uint32_t i = 0; i < meshes[mesh].triangle_count; i++) {
            struct facet facet;
            if (!fetch_triangle(&meshes[mesh], i, &facet))
                continue;
            for (int k = 0; k < 9; k++) {
                box.min[k % 3] = fmin(box.min[k % 3], facet.corners[k / 3][k % 3]);
                box.max[k % 3] = fmax(box.max[k % 3], facet.corners[k / 3][k % 3]);
            }
        }
    if (!(box.min[0] <= box.max[0]))
        return false;
    *ret_box = box;
    return true;
}

static bool fetch_flat(const struct oracle_mesh *meshes, uint64_t index, struct facet *ret_facet)
{
    while (index >= meshes->triangle_count)
        index -= (meshes++)->triangle_count;
    return fetch_triangle(meshes, (uint32_t)index, ret_facet);
}

/*
 * Picks a random triangle that can be hit; there must be one. It prefers one that floats can distinguish from a line,
 * if a few random picks find one.
 */
static void pick_triangle(const struct oracle_mesh *meshes, uint64_t total, uint64_t *state, struct facet *ret_facet)
{
    uint64_t index = 0;
    bool found = false;
    for (int pick = 0; pick < PICKS; pick++) {
        struct facet facet;
        index = rays_random(state) % total;
        if (!fetch_flat(meshes, index, &facet))
            continue;
        *ret_facet = facet;
        found = true;
        if (facet.height > RESOLVED * facet.ulp)
            return;
    }
    while (!found && !fetch_flat(meshes, index, ret_facet))
        index = index + 1 < total ? index + 1 : 0;
}

/* Returns a random point inside the triangle, at least a fiftieth of the height away from each edge. */
static void point_within(double corners[3][3], uint64_t *state, double ret_point[3])
{
    const double margin = 0.02;
    double u = rays_uniform(state), v = rays_uniform(state);
    if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    u = margin + (1 - 3 * margin) * u;
    v = margin + (1 - 3 * margin) * v;
    for (int axis = 0; axis < 3; axis++)
        ret_point[axis] = (1 - u - v) * corners[0][axis] + u * corners[1][axis] + v * corners[2][axis];
}

/* Uses no sine or cosine, but only operations that every machine rounds alike. */
static void unit_direction(uint64_t *state, double ret_direction[3])
{
    double square;
    do {
        square = 0;
        for (int axis = 0; axis < 3; axis++) {
            ret_direction[axis] = 2 * rays_uniform(state) - 1;
            square += ret_direction[axis] * ret_direction[axis];
        }
    } while (square > 1 || square < 0.01);
    for (int axis = 0; axis < 3; axis++)
        ret_direction[axis] /= sqrt(square);
}

static void set_origin(struct ray *ray, const double origin[3])
{
    for (int axis = 0; axis < 3; axis++)
        ray->origin[axis] = (float)fmin(fmax(origin[axis], -FLT_MAX), FLT_MAX);
}

static void set_direction(struct ray *ray, const double direction[3])
{
    double length = length3(direction);
    for (int axis = 0; axis < 3; axis++)
        ray->direction[axis] = (float)(direction[axis] / length);
}

static void point_at(struct ray *ray, const double point[3], const double otherwise[3])
{
    double towards[3];
    for (int axis = 0; axis < 3; axis++)
        towards[axis] = point[axis] - ray->origin[axis];
    /* If floats are too coarse to tell the two points apart, any direction will do. */
    set_direction(ray, length3(towards) > 0 ? towards : otherwise);
}

static void aim(struct ray *ray, const struct scene_box *box, struct facet *facet, uint64_t *state)
{
    double point[3], direction[3], origin[3], centre[3], diagonal[3];
    point_within(facet->corners, state, point);
    unit_direction(state, direction);
    for (int axis = 0; axis < 3; axis++) {
        diagonal[axis] = box->max[axis] - box->min[axis];
        centre[axis] = 0.5 * box->min[axis] + 0.5 * box->max[axis];
    }
    double outside = 0.5 * length3(diagonal) * (1.1 + 0.4 * rays_uniform(state));
    /* t must be in the range of floats */
    double near = fmin(fmax(FARTHEST * facet->height, facet->longest), FLT_MAX / 4);
    for (int axis = 0; axis < 3; axis++)
        origin[axis] = near < outside ? point[axis] + near * direction[axis] : centre[axis] + outside * direction[axis];
    set_origin(ray, origin);
    point_at(ray, point, direction);
}

static void start_inside(struct ray *ray, const struct scene_box *box, uint64_t *state)
{
    double direction[3], origin[3], diagonal[3];
    for (int axis = 0; axis < 3; axis++)
        diagonal[axis] = box->max[axis] - box->min[axis];
    for (int axis = 0; axis < 3; axis++) {
        /* the second term leaves the plane of a flat scene */
        double grown = 0.04 * diagonal[axis] + 0.01 * length3(diagonal);
        double low = box->min[axis] - grown, high = box->max[axis] + grown;
        origin[axis] = low + (high - low) * rays_uniform(state);
    }
    unit_direction(state, direction);
    set_origin(ray, origin);
    set_direction(ray, direction);
}

void rays_make(const struct oracle_mesh *meshes, uint32_t mesh_count, uint64_t seed, uint32_t count,
               struct ray *ret_rays)
{
    uint64_t state = seed, total = 0;
    for (uint32_t mesh = 0; mesh < mesh_count; mesh++)
        total += meshes[mesh].triangle_count;
    struct scene_box box = {{-1, -1, -1}, {1, 1, 1}};
    bool any = find_box(meshes, mesh_count, &box);
    for (uint32_t i = 0; i < count; i++) {
        ret_rays[i] = (struct ray){.tmin = 0, .tmax = FLT_MAX, .cull_mask = 0xff};
        if (any && i % 2 == 0) {
            struct facet facet;
            pick_triangle(meshes, total, &state, &facet);
            aim(&ret_rays[i], &box, &facet, &state);
        } else {
            start_inside(&ret_rays[i], &box, &state);
        }
    }
}
