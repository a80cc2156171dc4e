// SPDX-License-Identifier: Apache-2.0
// bvhd_trace_rays.glsl - the bindings and push constants that all tracing kernels share (vulkan_tracer.h).
#ifndef BVHD_TRACE_RAYS_GLSL
#define BVHD_TRACE_RAYS_GLSL

layout(local_size_x_id = 0) in;

#include "bvhd_ray.glsl"

layout(set = 0, binding = 0, std430) readonly buffer Rays { BvhdRay rays[]; };
#ifdef HITS_AS_ROWS
layout(set = 0, binding = 1, std430) buffer Hits { uvec4 hit_rows[]; }; // two rows for each hit
#else
layout(set = 0, binding = 1, std430) writeonly buffer Hits { BvhdHit hits[]; };
#endif

layout(push_constant) uniform Push {
    uint count; // of rays
    uint has_top; // 0: there is one bottom level alone, so hits have no instance
    uvec2 extra; // location of the root
    uvec2 scene_base; // address of the scene's buffer; 0 where locations are offsets in it
    uint ray_flags; // of all rays, in addition to each ray's own
};

const uint NO_INSTANCE = 0xffffffffu, FRONT_FACE = 1u, IS_AABB = 2u;
#ifdef BVHD_ROUND
const uint IS_SPHERE = 4u, IS_SWEPT_SPHERE = 8u;
#endif
#define INFINITY uintBitsToFloat(0x7f800000u)

BvhdHit miss()
{
    return BvhdHit(INFINITY, 0.0, 0.0, NO_INSTANCE, 0u, 0u, 0u, 0u);
}

bool is_finite(vec3 x)
{
    return !any(isnan(x)) && !any(isinf(x));
}

// Whether Vulkan allows a shader to trace the ray. Other rays hit nothing.
bool is_valid(BvhdRay ray)
{
    return is_finite(ray.origin.xyz) && is_finite(ray.direction.xyz) && any(notEqual(ray.direction.xyz, vec3(0.0))) &&
           ray.origin.w >= 0.0 && ray.origin.w <= ray.direction.w;
}

#endif
