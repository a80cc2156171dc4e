/* SPDX-License-Identifier: Apache-2.0 */
#include "oracle_triangle.h"

#include <math.h>
#include <string.h>

/* A few roundings of a double, and the roundings made while radii themselves are computed. */
#define ROUNDING (2 * DBL_EPSILON)
#define WIDEN (1 + 8 * DBL_EPSILON)

struct radial radial_input(float value)
{
    float power = fabsf(value);
    uint32_t bits;
    memcpy(&bits, &power, sizeof bits);
    bits &= 0x7f800000; /* the exponent alone: the power of two at or below the value */
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

/* The caller knows that 0 does not lie in b. */
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
    /* Written so that a NaN at either end is empty too. */
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

/* The corner relative to the ray: on it where x = y = 0; z along it, in which the origin counts as exact. */
static void shear_corner(const struct oracle_ray *ray, const struct radial corner[3], struct radial ret_sheared[3])
{
    struct radial z = radial_sub(corner[ray->z], ray->origin[2]);
    ret_sheared[0] = radial_sub(radial_sub(corner[ray->x], ray->origin[0]), radial_mul(ray->shear[0], z));
    ret_sheared[1] = radial_sub(radial_sub(corner[ray->y], ray->origin[1]), radial_mul(ray->shear[1], z));
    ret_sheared[2] = radial_sub(corner[ray->z], (struct radial){ray->origin[2].centre, 0});
}

/* All three corners on one side of the ray, along x or y. */
static bool lies_aside(struct radial sheared[3][3])
{
    for (int axis = 0; axis < 2; axis++) {
        if (surely_positive(sheared[0][axis]) && surely_positive(sheared[1][axis]) && surely_positive(sheared[2][axis]))
            return true;
        if (surely_negative(sheared[0][axis]) && surely_negative(sheared[1][axis]) && surely_negative(sheared[2][axis]))
            return true;
    }
    return false;
}

static struct radial edge_function(const struct radial from[3], const struct radial to[3])
{
    return radial_sub(radial_mul(to[0], from[1]), radial_mul(to[1], from[0]));
}

/* edges[i] is the function of the edge opposite to corner i. */
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
 * z where the ray meets the plane: a mean of the corners' z, weighted by the edge functions, taken about the middle corner, where the radii of
 * the weights count least. Never outside of the corners' own range.
 */
static void meeting_z(struct radial sheared[3][3], const struct radial edges[3], struct radial det, double *ret_z, double *ret_low,
                      double *ret_high)
{
    double low = INFINITY, high = -INFINITY, middle = (sheared[0][2].centre + sheared[1][2].centre + sheared[2][2].centre) / 3;
    struct radial sum = {0, 0};
    for (int i = 0; i < 3; i++) {
        struct radial z = sheared[i][2];
        low = fmin(low, z.centre - z.radius);
        high = fmax(high, z.centre + z.radius);
        sum = radial_add(sum, radial_mul(edges[i], radial_sub(z, (struct radial){middle, 0})));
    }
    double z = middle;
    if (surely_nonzero(det)) {
        struct radial offset = radial_add((struct radial){middle, 0}, radial_div(sum, det));
        low = fmax(low, offset.centre - offset.radius);
        high = fmin(high, offset.centre + offset.radius);
        z = offset.centre;
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
    crossing.low = fmin(a, b) - ROUNDING * fabs(fmin(a, b));
    crossing.high = fmax(a, b) + ROUNDING * fabs(fmax(a, b));
    return crossing;
}

static enum oracle_presence worse(enum oracle_presence a, enum oracle_presence b)
{
    return a < b ? a : b;
}

/* The open interval tmin < t < tmax. */
static enum oracle_presence presence_between(const struct oracle_ray *ray, const struct oracle_crossing *crossing)
{
    double low = crossing->low - crossing->shift, high = crossing->high + crossing->shift;
    if (high <= ray->tmin || low >= ray->tmax)
        return ORACLE_ABSENT;
    return low > ray->tmin && high < ray->tmax ? ORACLE_SURE : ORACLE_POSSIBLE;
}

/* Front: the normal (b - a) x (c - a), in the space of the mesh, points against the ray. */
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

/* Two edges are sure and agree, one is not sure. */
static void find_open_edge(const struct radial edges[3], struct oracle_crossing *crossing)
{
    int open = 0;
    crossing->open_edge = -1;
    for (int k = 0; k < 3; k++)
        if (!surely_nonzero(edges[k])) {
            open++;
            crossing->open_edge = k;
            crossing->positive = edges[(k + 1) % 3].centre > 0;
        }
    if (open != 1)
        crossing->open_edge = -1;
}

enum oracle_presence oracle_triangle_meet(const struct oracle_ray *ray, const struct oracle_triangle *triangle,
                                          struct oracle_crossing *ret_crossing)
{
    struct radial sheared[3][3];
    for (int k = 0; k < 3; k++)
        shear_corner(ray, triangle->corners[k], sheared[k]);
    if (lies_aside(sheared))
        return ORACLE_ABSENT;
    struct radial edges[3];
    for (int k = 0; k < 3; k++)
        edges[k] = edge_function(sheared[(k + 1) % 3], sheared[(k + 2) % 3]);
    struct radial det = radial_add(radial_add(edges[0], edges[1]), edges[2]);
    enum oracle_presence inside = presence_of(edges), facing = presence_of_facing(ray, det, triangle->mirrored);
    if (worse(inside, facing) == ORACLE_ABSENT)
        return ORACLE_ABSENT;
    double z, low, high;
    meeting_z(sheared, edges, det, &z, &low, &high);
    struct oracle_crossing crossing = crossing_of(ray, z, low, high);
    enum oracle_presence otherwise = worse(facing, presence_between(ray, &crossing));
    if (otherwise == ORACLE_ABSENT)
        return ORACLE_ABSENT;
    crossing.open_edge = -1;
    if (otherwise == ORACLE_SURE && inside == ORACLE_POSSIBLE)
        find_open_edge(edges, &crossing);
    *ret_crossing = crossing;
    return worse(inside, otherwise);
}
