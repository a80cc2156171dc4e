/* SPDX-License-Identifier: Apache-2.0 */
#include "rays.h"

#include <float.h>
#include <math.h>

enum { PICKS = 64 }; /* random triangles that are looked at before a search in order begins */

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

/* World-space corners; false for a triangle that cannot be hit. */
static bool fetch_triangle(const struct oracle_mesh *mesh, uint32_t triangle, double ret_corners[3][3])
{
    for (int k = 0; k < 3; k++) {
        uint64_t at = (uint64_t)3 * triangle + k;
        transform_point(mesh->transform, mesh->positions + (uint64_t)3 * (mesh->indices ? mesh->indices[at] : at), ret_corners[k]);
        for (int axis = 0; axis < 3; axis++)
            if (!isfinite(ret_corners[k][axis]))
                return false;
    }
    double area = 0;
    for (int axis = 0; axis < 3; axis++) {
        int y = (axis + 1) % 3, z = (axis + 2) % 3;
        double a[2] = {ret_corners[1][y] - ret_corners[0][y], ret_corners[1][z] - ret_corners[0][z]};
        double b[2] = {ret_corners[2][y] - ret_corners[0][y], ret_corners[2][z] - ret_corners[0][z]};
        area += fabs(a[0] * b[1] - a[1] * b[0]);
    }
    return area > 0;
}

/* False when no triangle can be hit. */
static bool find_box(const struct oracle_mesh *meshes, uint32_t mesh_count, struct scene_box *ret_box)
{
    struct scene_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (uint32_t mesh = 0; mesh < mesh_count; mesh++)
        for (uint32_t i = 0; i < meshes[mesh].triangle_count; i++) {
            double corners[3][3];
            if (!fetch_triangle(&meshes[mesh], i, corners))
                continue;
            for (int k = 0; k < 9; k++) {
                box.min[k % 3] = fmin(box.min[k % 3], corners[k / 3][k % 3]);
                box.max[k % 3] = fmax(box.max[k % 3], corners[k / 3][k % 3]);
            }
        }
    if (!(box.min[0] <= box.max[0]))
        return false;
    *ret_box = box;
    return true;
}

static bool fetch_flat(const struct oracle_mesh *meshes, uint64_t index, double ret_corners[3][3])
{
    while (index >= meshes->triangle_count)
        index -= (meshes++)->triangle_count;
    return fetch_triangle(meshes, (uint32_t)index, ret_corners);
}

/* There is a triangle that can be hit. */
static void pick_triangle(const struct oracle_mesh *meshes, uint64_t total, uint64_t *state, double ret_corners[3][3])
{
    uint64_t index = 0;
    for (int pick = 0; pick < PICKS; pick++) {
        index = rays_random(state) % total;
        if (fetch_flat(meshes, index, ret_corners))
            return;
    }
    while (!fetch_flat(meshes, index, ret_corners))
        index = index + 1 < total ? index + 1 : 0;
}

/* Inside, at least a fiftieth of the height away from each edge. */
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

/* Only operations that every machine rounds alike: no sine, no cosine. */
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
    double length = sqrt(direction[0] * direction[0] + direction[1] * direction[1] + direction[2] * direction[2]);
    for (int axis = 0; axis < 3; axis++)
        ray->direction[axis] = (float)(direction[axis] / length);
}

static void aim_from_outside(struct ray *ray, const struct scene_box *box, const double target[3], uint64_t *state)
{
    double direction[3], origin[3], diagonal = 0;
    for (int axis = 0; axis < 3; axis++)
        diagonal += (box->max[axis] - box->min[axis]) * (box->max[axis] - box->min[axis]);
    double distance = 0.5 * sqrt(diagonal) * (1.1 + 0.4 * rays_uniform(state));
    unit_direction(state, direction);
    for (int axis = 0; axis < 3; axis++)
        origin[axis] = 0.5 * box->min[axis] + 0.5 * box->max[axis] + distance * direction[axis];
    set_origin(ray, origin);
    double square = 0, towards[3];
    for (int axis = 0; axis < 3; axis++) {
        towards[axis] = target[axis] - ray->origin[axis];
        square += towards[axis] * towards[axis];
    }
    /* Where floats are too coarse to leave the target, any direction will do. */
    set_direction(ray, square > 0 ? towards : direction);
}

static void start_inside(struct ray *ray, const struct scene_box *box, uint64_t *state)
{
    double direction[3], origin[3];
    for (int axis = 0; axis < 3; axis++) {
        double grown = 0.05 * (box->max[axis] - box->min[axis]);
        double low = box->min[axis] - grown, high = box->max[axis] + grown;
        origin[axis] = low + (high - low) * rays_uniform(state);
    }
    unit_direction(state, direction);
    set_origin(ray, origin);
    set_direction(ray, direction);
}

void rays_make(const struct oracle_mesh *meshes, uint32_t mesh_count, uint64_t seed, uint32_t count, struct ray *ret_rays)
{
    uint64_t state = seed, total = 0;
    for (uint32_t mesh = 0; mesh < mesh_count; mesh++)
        total += meshes[mesh].triangle_count;
    struct scene_box box = {{-1, -1, -1}, {1, 1, 1}};
    bool any = find_box(meshes, mesh_count, &box);
    for (uint32_t i = 0; i < count; i++) {
        ret_rays[i] = (struct ray){.tmin = 0, .tmax = FLT_MAX, .cull_mask = 0xff};
        if (any && i % 2 == 0) {
            double corners[3][3], target[3];
            pick_triangle(meshes, total, &state, corners);
            point_within(corners, &state, target);
            aim_from_outside(&ret_rays[i], &box, target, &state);
        } else {
            start_inside(&ret_rays[i], &box, &state);
        }
    }
}
