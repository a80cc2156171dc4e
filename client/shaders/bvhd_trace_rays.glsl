// SPDX-License-Identifier: Apache-2.0
// trace_rays.glsl - rays in and hits out, as tracer_device.c packs and unpacks them: a thread a ray.
#ifndef BVHD_TRACE_RAYS_GLSL
#define BVHD_TRACE_RAYS_GLSL

layout(local_size_x_id = 0) in;

struct Ray {
    vec4 origin; // w: tmin
    vec4 direction; // w: tmax
    uvec4 flags; // ray flags, cull mask
};

struct Hit {
    float t, u, v;
    uint instance, custom_index, geometry, primitive, flags;
};

layout(set = 0, binding = 0, std430) readonly buffer Rays { Ray rays[]; };
#ifdef HITS_AS_ROWS
layout(set = 0, binding = 1, std430) buffer Hits { uvec4 hit_rows[]; }; // two each
#else
layout(set = 0, binding = 1, std430) writeonly buffer Hits { Hit hits[]; };
#endif

layout(push_constant) uniform Push {
    uint count;
    uint has_top; // 0: there is one bottom level, and no instance to tell of
    uvec2 extra; // for the kind of tracer
    uvec2 scene_base; // address of the scene's buffer; 0 where locations are offsets in it
    uint ray_flags; // of all rays, besides those of each ray's own
};

const uint NO_INSTANCE = 0xffffffffu, FRONT_FACE = 1u, IS_AABB = 2u;
#define INFINITY uintBitsToFloat(0x7f800000u)

Hit miss()
{
    return Hit(INFINITY, 0.0, 0.0, NO_INSTANCE, 0u, 0u, 0u, 0u);
}

bool is_finite(vec3 x)
{
    return !any(isnan(x)) && !any(isinf(x));
}

// What Vulkan lets a shader trace; others hit nothing.
bool is_valid(Ray ray)
{
    return is_finite(ray.origin.xyz) && is_finite(ray.direction.xyz) && any(notEqual(ray.direction.xyz, vec3(0.0))) && ray.origin.w >= 0.0 &&
           ray.origin.w <= ray.direction.w;
}

#endif
