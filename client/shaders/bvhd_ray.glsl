// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_ray.glsl - the rays and hits of bvhd_trace.h, for shaders that make rays or read hits. Their layout is std430:
 * 48 bytes and 32 bytes. bvhd_trace.h says what the fields mean.
 */
#ifndef BVHD_RAY_GLSL
#define BVHD_RAY_GLSL

struct BvhdRay {
    vec4 origin; // w: tmin
    vec4 direction; // w: tmax
    uvec4 flags; // ray flags, cull mask, the bits of the time, and a word that is not read
};

struct BvhdHit {
    float t, u, v; // t is infinite when nothing was hit
    uint instance, custom_index, geometry, primitive;
    uint flags; // BVHD_HIT_ of bvhd_trace.h
};

#endif
