/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/rays.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "client/bvhctl/oracle/oracle_moment.h"

enum {
    PICKS = 64, /* random primitives that are tried before a search in order begins */
    TIMES = 8, /* where something moves: rays have so many times, those of one time after the other */
};

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

static void transform_point(const struct oracle_moment *moment, const float point[3], double ret_world[3])
{
    for (int row = 0; row < 3; row++) {
        const struct radial *m = moment->matrix + 4 * row;
        ret_world[row] = moment->has_matrix
                             ? m[0].centre * point[0] + m[1].centre * point[1] + m[2].centre * point[2] + m[3].centre
                             : point[row];
    }
}

/*
 * A triangle in world space, and the dimensions that decide how a ray can be aimed at it. For a round primitive it is
 * one that lies inside it.
 */
struct facet {
    double corners[3][3];
    double margin[3]; /* how far the primitive may reach beyond the corners, along each axis */
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

/*
 * Makes a corner of a round primitive's facet: of the equilateral triangle at right angles to (1, 1, 1) in the sphere
 * round this vertex. Its size is a number less than 1, so that the corner stays inside when it is rounded to a float.
 */
static void round_corner(const struct oracle_mesh *mesh, uint64_t vertex, int k, float ret_corner[3])
{
    const double size = 0.4; /* sqrt(1 / 6) is on the surface */
    for (int axis = 0; axis < 3; axis++)
        ret_corner[axis] =
            (float)(mesh->positions[3 * vertex + (uint64_t)axis] + size * mesh->radii[vertex] * (axis == k ? 2 : -1));
}

/* How many vertices a primitive has. */
static const uint32_t vertex_counts[ORACLE_SHAPES] = {3, 1, 2};

static uint64_t vertex_of(const struct oracle_mesh *mesh, uint32_t primitive, uint32_t k)
{
    const uint64_t at = (uint64_t)vertex_counts[mesh->shape] * primitive + k;
    return mesh->indices ? mesh->indices[at] : at;
}

/*
 * Makes corner k of a primitive's facet, before the transform. Two corners of a swept sphere are at the end with the
 * larger radius, and one at the other.
 */
static void facet_corner(const struct oracle_moment *moment, uint32_t primitive, int k, float ret_corner[3])
{
    const struct oracle_mesh *mesh = moment->mesh;
    const uint32_t count = vertex_counts[mesh->shape];
    uint64_t at = vertex_of(mesh, primitive, (uint32_t)k % count);
    if (mesh->shape == ORACLE_TRIANGLES) {
        oracle_moment_vertex(moment, at, ret_corner);
        return;
    }
    uint64_t other = vertex_of(mesh, primitive, count - 1 - (uint32_t)k % count);
    if (k == 2 && mesh->radii[other] > mesh->radii[at])
        at = other;
    round_corner(mesh, at, k, ret_corner);
}

/*
 * Returns how far a round primitive can reach beyond its corners along a row of the transform. Its corners may be on
 * one side of a centre, by 0.4 radii.
 */
static double margin_of(const struct oracle_moment *moment, uint32_t primitive, int row)
{
    const struct oracle_mesh *mesh = moment->mesh;
    const struct radial *m = moment->matrix + 4 * row;
    double stretch = moment->has_matrix ? hypot(m[0].centre, hypot(m[1].centre, m[2].centre)) : 1, radius = 0;
    for (uint32_t end = 0; end < vertex_counts[mesh->shape]; end++)
        radius = fmax(radius, mesh->radii[vertex_of(mesh, primitive, end)]);
    return 1.4 * stretch * radius;
}

/* Returns false for a primitive that cannot be hit. */
static bool fetch_facet(const struct oracle_moment *moment, uint32_t primitive, struct facet *ret_facet)
{
    for (int k = 0; k < 3; k++) {
        double *world = ret_facet->corners[k];
        float corner[3];
        facet_corner(moment, primitive, k, corner);
        transform_point(moment, corner, world);
        if (!isfinite(world[0]) || !isfinite(world[1]) || !isfinite(world[2]))
            return false;
        ret_facet->margin[k] = moment->mesh->shape == ORACLE_TRIANGLES ? 0 : margin_of(moment, primitive, k);
    }
    measure(ret_facet);
    return ret_facet->height > 0;
}

static void box_grow(struct scene_box *box, const struct facet *facet)
{
    for (int k = 0; k < 9; k++) {
        const double at = facet->corners[k / 3][k % 3], margin = facet->margin[k % 3];
        box->min[k % 3] = fmin(box->min[k % 3], at - margin);
        box->max[k % 3] = fmax(box->max[k % 3], at + margin);
    }
}

/* Returns false when no primitive can be hit at that time. */
static bool find_box(const struct oracle_mesh *meshes, uint32_t mesh_count, float time, struct scene_box *ret_box)
{
    struct scene_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (uint32_t mesh = 0; mesh < mesh_count; mesh++) {
        struct oracle_moment moment;
        if (!oracle_moment_make(&meshes[mesh], time, &moment))
            continue;
        for (uint32_t i = 0; i < meshes[mesh].primitive_count; i++) {
            struct facet facet;
            if (fetch_facet(&moment, i, &facet))
                box_grow(&box, &facet);
        }
    }
    const bool any = box.min[0] <= box.max[0];
    *ret_box = any ? box : (struct scene_box){{-1, -1, -1}, {1, 1, 1}};
    return any;
}

static bool fetch_flat(const struct oracle_mesh *meshes, uint64_t index, float time, struct facet *ret_facet)
{
    struct oracle_moment moment;
    while (index >= meshes->primitive_count)
        index -= (meshes++)->primitive_count;
    return oracle_moment_make(meshes, time, &moment) && fetch_facet(&moment, (uint32_t)index, ret_facet);
}

/*
 * Picks a random primitive that can be hit at that time; there must be one. It prefers one that floats can distinguish
 * from a line, if a few random picks find one.
 */
static void pick_facet(const struct oracle_mesh *meshes, uint64_t total, float time, uint64_t *state,
                       struct facet *ret_facet)
{
    uint64_t index = 0;
    bool found = false;
    for (int pick = 0; pick < PICKS; pick++) {
        struct facet facet;
        index = rays_random(state) % total;
        if (!fetch_flat(meshes, index, time, &facet))
            continue;
        *ret_facet = facet;
        found = true;
        if (facet.height > RESOLVED * facet.ulp)
            return;
    }
    while (!found && !fetch_flat(meshes, index, time, ret_facet))
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

/* Makes the time of a stretch of rays: both ends, the middle, and random ones. */
static float time_of(uint64_t seed, uint32_t stretch)
{
    static const float certain[] = {0, 1, 0.5F};
    uint64_t state = seed ^ (uint64_t)stretch << 32;
    return stretch < sizeof certain / sizeof certain[0] ? certain[stretch] : (float)rays_uniform(&state);
}

void rays_make(const struct oracle_mesh *meshes, uint32_t mesh_count, uint64_t seed, uint32_t count,
               struct ray *ret_rays)
{
    uint64_t state = seed, total = 0;
    for (uint32_t mesh = 0; mesh < mesh_count; mesh++)
        total += meshes[mesh].primitive_count;
    const bool moves = oracle_moves(meshes, mesh_count);
    struct scene_box box;
    bool any = false;
    float time = -1;
    for (uint32_t i = 0; i < count; i++) {
        const float next = moves ? time_of(seed, (uint32_t)((uint64_t)i * TIMES / count)) : 0;
        if (next != time)
            any = find_box(meshes, mesh_count, next, &box);
        time = next;
        ret_rays[i] = (struct ray){.tmin = 0, .tmax = FLT_MAX, .cull_mask = 0xff, .time = time};
        if (any && i % 2 == 0) {
            struct facet facet;
            pick_facet(meshes, total, time, &state, &facet);
            aim(&ret_rays[i], &box, &facet, &state);
        } else {
            start_inside(&ret_rays[i], &box, &state);
        }
    }
}
