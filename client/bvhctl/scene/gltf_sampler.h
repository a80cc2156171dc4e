/* SPDX-License-Identifier: Apache-2.0 */
/* gltf_sampler.h - interpolates between the keys of a glTF animation, in double precision. Internal to gltf_pose.h. */
#ifndef BVHCTL_GLTF_SAMPLER_H
#define BVHCTL_GLTF_SAMPLER_H

#include <stdbool.h>
#include <stdint.h>

enum gltf_interpolation { GLTF_LINEAR, GLTF_STEP, GLTF_CUBICSPLINE };

struct gltf_sampler {
    enum gltf_interpolation interpolation;
    bool is_rotation; /* values are quaternions: x, y, z, w */
    uint32_t count; /* of keys, at least one */
    uint32_t width; /* numbers in a value */
    const float *times; /* of the keys, ascending */
    const float *values; /* a value for each key; for cubic splines in-tangent, value, out-tangent for each */
};

/*
 * Writes the `width` numbers at a time. Before the first key and after the last one the values of these hold. Rotations
 * go the shorter way round and become unit quaternions.
 */
void gltf_sampler_at(const struct gltf_sampler *sampler, double time, double *ret_value);

#endif
