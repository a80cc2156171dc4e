/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/oracle.h"
#include "client/bvhctl/oracle/oracle_kind.h"

#include <math.h>

static bool corners_equal(const float a[3], const float b[3])
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* Returns false for a triangle that no ray can hit. */
static bool fetch_corners(const struct oracle_moment *moment, uint32_t triangle, float ret_corners[3][3])
{
    const uint32_t *indices = moment->mesh->indices;
    for (int k = 0; k < 3; k++) {
        uint64_t at = (uint64_t)3 * triangle + k;
        float *corner = ret_corners[k];
        oracle_moment_vertex(moment, indices ? indices[at] : at, corner);
        if (!isfinite(corner[0]) || !isfinite(corner[1]) || !isfinite(corner[2]))
            return false;
    }
    return !corners_equal(ret_corners[0], ret_corners[1]) && !corners_equal(ret_corners[1], ret_corners[2]) &&
           !corners_equal(ret_corners[2], ret_corners[0]);
}

static void transform_corner(const struct oracle_moment *moment, const float corner[3], struct radial ret_world[3])
{
    for (int row = 0; row < 3; row++) {
        if (!moment->has_matrix) {
            ret_world[row] = radial_input(corner[row]);
            continue;
        }
        const struct radial *entries = moment->matrix + 4 * row;
        struct radial sum = entries[3];
        for (int column = 0; column < 3; column++)
            sum = radial_add(sum, radial_mul(entries[column], radial_input(corner[column])));
        ret_world[row] = sum;
    }
}

static bool fetch(const struct oracle_moment *moment, uint32_t primitive, union oracle_subject *ret_subject)
{
    float corners[3][3];
    if (!fetch_corners(moment, primitive, corners))
        return false;
    ret_subject->triangle.mirrored = moment->mirrored;
    ret_subject->triangle.vague = moment->vague;
    for (int k = 0; k < 3; k++)
        transform_corner(moment, corners[k], ret_subject->triangle.corners[k]);
    return true;
}

static void sphere(const union oracle_subject *subject, double ret_centre[3], double *ret_radius)
{
    const struct radial(*corners)[3] = subject->triangle.corners;
    double square = 0;
    for (int axis = 0; axis < 3; axis++) {
        double a = corners[0][axis].centre, b = corners[1][axis].centre, c = corners[2][axis].centre;
        ret_centre[axis] = 0.5 * fmin(a, fmin(b, c)) + 0.5 * fmax(a, fmax(b, c));
    }
    for (int k = 0; k < 3; k++) {
        double away[3];
        for (int axis = 0; axis < 3; axis++)
            away[axis] = fabs(corners[k][axis].centre - ret_centre[axis]) + corners[k][axis].radius;
        square = fmax(square, away[0] * away[0] + away[1] * away[1] + away[2] * away[2]);
    }
    *ret_radius = sqrt(square);
}

/*
 * The corners relative to the ray, which is at x = y = 0 and runs along z. The ray's origin counts as exact there. The
 * radii contain the moves of each corner alone. Moves of the ray, which shift all corners alike, are in `common`.
 */
struct sheared {
    struct radial corners[3][3];
    double common[2];
};

static void shear(const struct oracle_ray *ray, const struct oracle_triangle *triangle, struct sheared *ret_sheared)
{
    struct radial z[3];
    for (int k = 0; k < 3; k++)
        z[k] = radial_sub(triangle->corners[k][ray->z], radial_exact(ray->origin[2].centre));
    double middle = (z[0].centre + z[1].centre + z[2].centre) / 3;
    for (int axis = 0; axis < 2; axis++) {
        struct radial slope = ray->shear[axis], start = ray->origin[axis];
        for (int k = 0; k < 3; k++) {
            struct radial across = radial_sub(triangle->corners[k][axis ? ray->y : ray->x], radial_exact(start.centre));
            struct radial moved = radial_sub(across, radial_mul(radial_exact(slope.centre), z[k]));
            moved.radius += slope.radius * (fabs(z[k].centre - middle) + z[k].radius) * RADIAL_WIDEN;
            ret_sheared->corners[k][axis] = moved;
            ret_sheared->corners[k][2] = z[k];
        }
        double turned = slope.radius * (fabs(middle) + ray->origin[2].radius);
        ret_sheared->common[axis] = (start.radius + fabs(slope.centre) * ray->origin[2].radius + turned) * RADIAL_WIDEN;
    }
}

/* Returns whether all corners except `but` (-1: no exception) are surely on one side of the ray, along x or y. */
static bool lies_aside(const struct sheared *sheared, int but)
{
    for (int axis = 0; axis < 2; axis++) {
        double low = INFINITY, high = -INFINITY;
        for (int k = 0; k < 3; k++) {
            struct radial at = sheared->corners[k][axis];
            low = k == but ? low : fmin(low, at.centre - at.radius);
            high = k == but ? high : fmax(high, at.centre + at.radius);
        }
        if (low > sheared->common[axis] || high < -sheared->common[axis])
            return true;
    }
    return false;
}

static struct radial edge_function(const struct sheared *sheared, int from_corner, int to_corner)
{
    const struct radial *from = sheared->corners[from_corner], *to = sheared->corners[to_corner];
    struct radial edge = radial_sub(radial_mul(to[0], from[1]), radial_mul(to[1], from[0]));
    double x = fabs(to[0].centre - from[0].centre) + to[0].radius + from[0].radius;
    double y = fabs(to[1].centre - from[1].centre) + to[1].radius + from[1].radius;
    edge.radius = (edge.radius + sheared->common[0] * y + sheared->common[1] * x) * RADIAL_WIDEN;
    return edge;
}

/* Returns the sum of the edge functions, which does not depend on the position of the ray. */
static struct radial determinant(const struct sheared *sheared)
{
    struct radial sides[2][2];
    for (int k = 0; k < 2; k++)
        for (int axis = 0; axis < 2; axis++)
            sides[k][axis] = radial_sub(sheared->corners[k + 1][axis], sheared->corners[0][axis]);
    return radial_sub(radial_mul(sides[1][0], sides[0][1]), radial_mul(sides[1][1], sides[0][0]));
}

/* edges[i] is the function of the edge that is opposite to corner i. */
static enum oracle_presence presence_of(const struct radial edges[3])
{
    int positive = 0, negative = 0;
    for (int i = 0; i < 3; i++) {
        positive += radial_is_positive(edges[i]);
        negative += radial_is_negative(edges[i]);
    }
    if (positive && negative)
        return ORACLE_ABSENT;
    return positive == 3 || negative == 3 ? ORACLE_SURE : ORACLE_POSSIBLE;
}

/*
 * Computes z where the ray meets the plane: the mean of the corners' z, weighted by the edge functions. The mean is
 * taken of the differences from the middle of the corners, because the radii of the weights add least to those. It is
 * clamped to the range of the corners.
 */
static void meeting_z(const struct sheared *sheared, const struct radial edges[3], struct radial det, double *ret_z,
                      double *ret_low, double *ret_high)
{
    double low = INFINITY, high = -INFINITY;
    double middle = (sheared->corners[0][2].centre + sheared->corners[1][2].centre + sheared->corners[2][2].centre) / 3;
    struct radial sum = {0, 0};
    for (int i = 0; i < 3; i++) {
        struct radial z = sheared->corners[i][2];
        low = fmin(low, z.centre - z.radius);
        high = fmax(high, z.centre + z.radius);
        sum = radial_add(sum, radial_mul(edges[i], radial_sub(z, radial_exact(middle))));
    }
    double z = det.centre != 0 ? middle + sum.centre / det.centre : middle;
    if (radial_is_nonzero(det)) {
        struct radial offset = radial_add(radial_exact(middle), radial_div(sum, det));
        low = fmax(low, offset.centre - offset.radius);
        high = fmin(high, offset.centre + offset.radius);
    }
    *ret_z = fmin(fmax(z, low), high);
    *ret_low = low;
    *ret_high = high;
}

static struct oracle_crossing crossing_of(const struct oracle_ray *ray, double z, double low, double high)
{
    double scale = ray->direction_z.centre, a = low / scale, b = high / scale;
    struct radial depth = {fmax(fabs(low), fabs(high)), ray->origin[2].radius};
    return oracle_crossing_make(z / scale, fmin(a, b), fmax(a, b), radial_div(depth, ray->direction_z).radius);
}

/*
 * Returns whether culling by facing keeps the triangle. It is front-facing if its normal (b - a) x (c - a), in the
 * space of the mesh, points against the ray.
 */
static enum oracle_presence presence_of_facing(const struct oracle_ray *ray, struct radial det, bool mirrored)
{
    bool keep_front = !(ray->flags & RAY_CULL_FRONT_FACING), keep_back = !(ray->flags & RAY_CULL_BACK_FACING);
    if (keep_front && keep_back)
        return ORACLE_SURE;
    if (!radial_is_nonzero(det))
        return keep_front || keep_back ? ORACLE_POSSIBLE : ORACLE_ABSENT;
    bool front = (det.centre > 0) == (ray->direction_z.centre > 0);
    return (front != mirrored ? keep_front : keep_back) ? ORACLE_SURE : ORACLE_ABSENT;
}

static struct oracle_outline outline_of(const struct oracle_triangle *triangle, const struct sheared *sheared,
                                        const struct radial edges[3], struct radial det, bool open)
{
    struct oracle_outline outline = {.positive = det.centre > 0, .open = open};
    for (int k = 0; k < 3; k++) {
        outline.sure[k] = radial_is_nonzero(edges[k]) || lies_aside(sheared, k);
        for (int axis = 0; axis < 3; axis++)
            outline.corners[k][axis] = triangle->corners[k][axis].centre;
        for (int axis = 0; axis < 2; axis++)
            outline.seen[k][axis] = sheared->corners[k][axis].centre;
    }
    return outline;
}

static enum oracle_presence meet(const struct oracle_ray *ray, const union oracle_subject *subject,
                                 struct oracle_crossing *ret_crossing, struct oracle_outline *ret_outline)
{
    const struct oracle_triangle *triangle = &subject->triangle;
    struct sheared sheared;
    shear(ray, triangle, &sheared);
    if (lies_aside(&sheared, -1))
        return ORACLE_ABSENT;
    struct radial edges[3];
    for (int k = 0; k < 3; k++)
        edges[k] = edge_function(&sheared, (k + 1) % 3, (k + 2) % 3);
    struct radial det = determinant(&sheared);
    enum oracle_presence inside = presence_of(edges), facing = presence_of_facing(ray, det, triangle->mirrored);
    if (oracle_worse(inside, facing) == ORACLE_ABSENT)
        return ORACLE_ABSENT;
    double z, low, high;
    meeting_z(&sheared, edges, det, &z, &low, &high);
    struct oracle_crossing crossing = crossing_of(ray, z, low, high);
    enum oracle_presence otherwise = oracle_worse(facing, oracle_crossing_between(&crossing, ray));
    if (triangle->vague)
        otherwise = oracle_worse(otherwise, ORACLE_POSSIBLE);
    if (otherwise == ORACLE_ABSENT)
        return ORACLE_ABSENT;
    if (oracle_worse(inside, otherwise) == ORACLE_POSSIBLE)
        *ret_outline = outline_of(triangle, &sheared, edges, det, otherwise == ORACLE_SURE);
    *ret_crossing = crossing;
    return oracle_worse(inside, otherwise);
}

const struct oracle_kind oracle_triangles = {fetch, sphere, meet};
