/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/oracle_triangle.h"

#include <math.h>
#include <string.h>

/* Relative errors: of a few roundings of a double, and of the computation of the radii themselves. */
#define ROUNDING (2 * DBL_EPSILON)
#define WIDEN (1 + 8 * DBL_EPSILON)

/*
 * Half of what two distances differ by at most, relative to them, if they are rounded to the same number of 32
 * significant bits: their spacing is at most 2^-31.
 */
#define EQUAL_WITHIN 0x1p-32

struct radial radial_input(float value)
{
    float power = fabsf(value);
    uint32_t bits;
    memcpy(&bits, &power, sizeof bits);
    bits &= 0x7f800000; /* only the exponent is left: the power of two at or below the value */
    memcpy(&power, &bits, sizeof bits);
    return (struct radial){value, bits ? power * (double)FLT_EPSILON : FLT_TRUE_MIN};
}

static struct radial rounded(double centre, double radius, double magnitude)
{
    return (struct radial){centre, (radius + ROUNDING * magnitude) * WIDEN};
}

struct radial radial_add(struct radial a, struct radial b)
{
    double sum = a.centre + b.centre;
    return rounded(sum, a.radius + b.radius, fabs(sum));
}

struct radial radial_sub(struct radial a, struct radial b)
{
    double difference = a.centre - b.centre;
    return rounded(difference, a.radius + b.radius, fabs(difference));
}

struct radial radial_mul(struct radial a, struct radial b)
{
    double product = a.centre * b.centre;
    double radius = fabs(a.centre) * b.radius + fabs(b.centre) * a.radius + a.radius * b.radius;
    return rounded(product, radius, fabs(product));
}

/* The interval b must not contain 0. */
static struct radial radial_div(struct radial a, struct radial b)
{
    double quotient = a.centre / b.centre;
    double radius = (a.radius + fabs(quotient) * b.radius) / (fabs(b.centre) - b.radius);
    return rounded(quotient, radius, fabs(quotient));
}

static bool surely_positive(struct radial a)
{
    return a.centre > a.radius;
}

static bool surely_negative(struct radial a)
{
    return a.centre < -a.radius;
}

static bool surely_nonzero(struct radial a)
{
    return fabs(a.centre) > a.radius;
}

enum oracle_ray_kind oracle_ray_init(struct oracle_ray *ret_prepared, const struct ray *ray)
{
    int z = 0;
    for (int axis = 0; axis < 3; axis++) {
        if (!isfinite(ray->origin[axis]) || !isfinite(ray->direction[axis]))
            return ORACLE_RAY_EMPTY;
        z = fabsf(ray->direction[axis]) > fabsf(ray->direction[z]) ? axis : z;
    }
    /* The comparison is false, and the ray empty, also if tmin or tmax is NaN. */
    if (ray->direction[z] == 0 || !(ray->tmin < ray->tmax))
        return ORACLE_RAY_EMPTY;
    struct radial along = radial_input(ray->direction[z]);
    if (!surely_nonzero(along))
        return ORACLE_RAY_VAGUE;

    struct oracle_ray prepared = {.x = (z + 1) % 3, .y = (z + 2) % 3, .z = z, .direction_z = along};
    prepared.origin[0] = radial_input(ray->origin[prepared.x]);
    prepared.origin[1] = radial_input(ray->origin[prepared.y]);
    prepared.origin[2] = radial_input(ray->origin[z]);
    prepared.shear[0] = radial_div(radial_input(ray->direction[prepared.x]), along);
    prepared.shear[1] = radial_div(radial_input(ray->direction[prepared.y]), along);
    prepared.tmin = ray->tmin;
    prepared.tmax = ray->tmax;
    prepared.flags = ray->flags;
    *ret_prepared = prepared;
    return ORACLE_RAY_GOOD;
}

static struct radial exact(double value)
{
    return (struct radial){value, 0};
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
        z[k] = radial_sub(triangle->corners[k][ray->z], exact(ray->origin[2].centre));
    double middle = (z[0].centre + z[1].centre + z[2].centre) / 3;
    for (int axis = 0; axis < 2; axis++) {
        struct radial slope = ray->shear[axis], start = ray->origin[axis];
        for (int k = 0; k < 3; k++) {
            struct radial across = radial_sub(triangle->corners[k][axis ? ray->y : ray->x], exact(start.centre));
            struct radial moved = radial_sub(across, radial_mul(exact(slope.centre), z[k]));
            moved.radius += slope.radius * (fabs(z[k].centre - middle) + z[k].radius) * WIDEN;
            ret_sheared->corners[k][axis] = moved;
            ret_sheared->corners[k][2] = z[k];
        }
        double turned = slope.radius * (fabs(middle) + ray->origin[2].radius);
        ret_sheared->common[axis] = (start.radius + fabs(slope.centre) * ray->origin[2].radius + turned) * WIDEN;
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
    edge.radius = (edge.radius + sheared->common[0] * y + sheared->common[1] * x) * WIDEN;
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
        positive += surely_positive(edges[i]);
        negative += surely_negative(edges[i]);
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
        sum = radial_add(sum, radial_mul(edges[i], radial_sub(z, exact(middle))));
    }
    double z = det.centre != 0 ? middle + sum.centre / det.centre : middle;
    if (surely_nonzero(det)) {
        struct radial offset = radial_add(exact(middle), radial_div(sum, det));
        low = fmax(low, offset.centre - offset.radius);
        high = fmin(high, offset.centre + offset.radius);
    }
    *ret_z = fmin(fmax(z, low), high);
    *ret_low = low;
    *ret_high = high;
}

static struct oracle_crossing crossing_of(const struct oracle_ray *ray, double z, double low, double high)
{
    double scale = ray->direction_z.centre;
    struct radial depth = {fmax(fabs(low), fabs(high)), ray->origin[2].radius};
    struct oracle_crossing crossing = {.t = z / scale, .shift = radial_div(depth, ray->direction_z).radius};
    double a = low / scale, b = high / scale;
    crossing.low = fmin(a, b) - (EQUAL_WITHIN + ROUNDING) * fabs(fmin(a, b));
    crossing.high = fmax(a, b) + (EQUAL_WITHIN + ROUNDING) * fabs(fmax(a, b));
    return crossing;
}

static enum oracle_presence worse(enum oracle_presence a, enum oracle_presence b)
{
    return a < b ? a : b;
}

/* Returns whether t is in the open interval tmin < t < tmax. */
static enum oracle_presence presence_between(const struct oracle_ray *ray, const struct oracle_crossing *crossing)
{
    double low = crossing->low - crossing->shift, high = crossing->high + crossing->shift;
    if (high <= ray->tmin || low >= ray->tmax)
        return ORACLE_ABSENT;
    return low > ray->tmin && high < ray->tmax ? ORACLE_SURE : ORACLE_POSSIBLE;
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
    if (!surely_nonzero(det))
        return keep_front || keep_back ? ORACLE_POSSIBLE : ORACLE_ABSENT;
    bool front = (det.centre > 0) == (ray->direction_z.centre > 0);
    return (front != mirrored ? keep_front : keep_back) ? ORACLE_SURE : ORACLE_ABSENT;
}

static struct oracle_outline outline_of(const struct sheared *sheared, const struct radial edges[3], struct radial det,
                                        bool open)
{
    struct oracle_outline outline = {.positive = det.centre > 0, .open = open};
    for (int k = 0; k < 3; k++) {
        outline.sure[k] = surely_nonzero(edges[k]) || lies_aside(sheared, k);
        outline.corners[k][0] = sheared->corners[k][0].centre;
        outline.corners[k][1] = sheared->corners[k][1].centre;
    }
    return outline;
}

enum oracle_presence oracle_triangle_meet(const struct oracle_ray *ray, const struct oracle_triangle *triangle,
                                          struct oracle_crossing *ret_crossing, struct oracle_outline *ret_outline)
{
    struct sheared sheared;
    shear(ray, triangle, &sheared);
    if (lies_aside(&sheared, -1))
        return ORACLE_ABSENT;
    struct radial edges[3];
    for (int k = 0; k < 3; k++)
        edges[k] = edge_function(&sheared, (k + 1) % 3, (k + 2) % 3);
    struct radial det = determinant(&sheared);
    enum oracle_presence inside = presence_of(edges), facing = presence_of_facing(ray, det, triangle->mirrored);
    if (worse(inside, facing) == ORACLE_ABSENT)
        return ORACLE_ABSENT;
    double z, low, high;
    meeting_z(&sheared, edges, det, &z, &low, &high);
    struct oracle_crossing crossing = crossing_of(ray, z, low, high);
    enum oracle_presence otherwise = worse(facing, presence_between(ray, &crossing));
    if (otherwise == ORACLE_ABSENT)
        return ORACLE_ABSENT;
    if (worse(inside, otherwise) == ORACLE_POSSIBLE)
        *ret_outline = outline_of(&sheared, edges, det, otherwise == ORACLE_SURE);
    *ret_crossing = crossing;
    return worse(inside, otherwise);
}
