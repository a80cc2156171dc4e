/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/gltf_sampler.h"

#include <math.h>
#include <stddef.h>

/* Returns the last key that is not after the time, or 0. */
static uint32_t find_key(const struct gltf_sampler *sampler, double time)
{
    uint32_t low = 0, high = sampler->count;
    while (high - low > 1) {
        uint32_t middle = low + (high - low) / 2;
        if ((double)sampler->times[middle] <= time)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Returns part `part` of a key of a cubic spline: 0 is the in-tangent, 1 the value, 2 the out-tangent. */
static const float *spline_part(const struct gltf_sampler *sampler, uint32_t key, uint32_t part)
{
    return sampler->values + ((size_t)3 * key + part) * sampler->width;
}

static const float *key_value(const struct gltf_sampler *sampler, uint32_t key)
{
    return sampler->interpolation == GLTF_CUBICSPLINE ? spline_part(sampler, key, 1)
                                                      : sampler->values + (size_t)key * sampler->width;
}

static void make_unit(double q[4])
{
    double length = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    for (int i = 0; i < 4 && length > 0; i++)
        q[i] /= length;
}

/* Interpolates on the sphere. Quaternions that are nearly equal are on a line. */
static void slerp(const float *from, const float *to, double share, double ret_rotation[4])
{
    double a[4] = {from[0], from[1], from[2], from[3]}, b[4] = {to[0], to[1], to[2], to[3]};
    make_unit(a);
    make_unit(b);
    double cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3], sign = cosine < 0 ? -1 : 1;
    double angle = acos(fmin(fabs(cosine), 1.0)), sine = sin(angle);
    double first = sine > 1e-6 ? sin((1 - share) * angle) / sine : 1 - share;
    double second = sine > 1e-6 ? sin(share * angle) / sine : share;
    for (int i = 0; i < 4; i++)
        ret_rotation[i] = first * a[i] + sign * second * b[i];
}

/* The cubic Hermite spline of glTF, whose tangents are per second. */
static void interpolate_spline(const struct gltf_sampler *sampler, uint32_t key, double share, double seconds,
                               double *ret_value)
{
    const float *from = spline_part(sampler, key, 1), *out = spline_part(sampler, key, 2);
    const float *in = spline_part(sampler, key + 1, 0), *to = spline_part(sampler, key + 1, 1);
    double square = share * share, cube = square * share;
    for (uint32_t i = 0; i < sampler->width; i++)
        ret_value[i] = (2 * cube - 3 * square + 1) * from[i] + seconds * (cube - 2 * square + share) * out[i] +
                       (3 * square - 2 * cube) * to[i] + seconds * (cube - square) * in[i];
}

static void interpolate(const struct gltf_sampler *sampler, uint32_t key, double time, double *ret_value)
{
    double start = sampler->times[key], seconds = sampler->times[key + 1] - start, share = (time - start) / seconds;
    const float *from = key_value(sampler, key), *to = key_value(sampler, key + 1);
    if (sampler->interpolation == GLTF_CUBICSPLINE)
        interpolate_spline(sampler, key, share, seconds, ret_value);
    else if (sampler->is_rotation)
        slerp(from, to, share, ret_value);
    else
        for (uint32_t i = 0; i < sampler->width; i++)
            ret_value[i] = (1 - share) * from[i] + share * to[i];
}

void gltf_sampler_at(const struct gltf_sampler *sampler, double time, double *ret_value)
{
    uint32_t key = find_key(sampler, time);
    bool is_between = time > (double)sampler->times[key] && key + 1 < sampler->count;
    if (is_between && sampler->interpolation != GLTF_STEP)
        interpolate(sampler, key, time, ret_value);
    else
        for (uint32_t i = 0; i < sampler->width; i++)
            ret_value[i] = key_value(sampler, key)[i];
    if (sampler->is_rotation)
        make_unit(ret_value);
}
