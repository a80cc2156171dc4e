// SPDX-License-Identifier: Apache-2.0
// rays.glsl - shared by the shaders of ray_pipeline.h: the payload, and the bits of a hit's flags.
#ifndef RAYS_GLSL
#define RAYS_GLSL

struct Hit {
    float t, u, v;
    uint instance, custom, geometry, primitive, flags;
};

const uint FRONT_FACE = 1u, IS_AABB = 2u;
#define INFINITY uintBitsToFloat(0x7f800000u)

#endif
