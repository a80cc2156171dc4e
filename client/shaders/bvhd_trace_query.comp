// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_trace_query.comp - traces every kind of ray with bvhd_ray_query.glsl. Triangles that are not opaque are
 * accepted, AABBs are hit where the ray enters them.
 *
 * Variants: with BVHD_BUFFER_ADDRESS the scene is found by address, without it the scene is binding 2. With FALLBACK
 * only the rays that bvhd_trace_closest.comp has left are traced. With BVHD_ROUND the scene may have spheres and linear
 * swept spheres, and with BVHD_MOTION it may move.
 */
#version 450
#extension GL_GOOGLE_include_directive : require
#ifdef BVHD_BUFFER_ADDRESS
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#endif

#ifndef BVHD_ROUND
#define BVHD_NOTHING_ROUND
#endif
#include "bvhd_trace_rays.glsl"

layout(constant_id = 1) const bool plain_bytes = false;
layout(constant_id = 2) const bool fused_fma = false;
#define BVHD_PLAIN_BYTES plain_bytes
#define BVHD_FUSED_FMA fused_fma

#ifndef BVHD_BUFFER_ADDRESS
layout(set = 0, binding = 2, std430) readonly buffer SceneRows { uvec4 scene_rows[]; };
layout(set = 0, binding = 2, std430) readonly buffer SceneWords { uint scene_words[]; };
#define BVHD_STORAGE_ROWS scene_rows
#define BVHD_STORAGE_WORDS scene_words
#endif

#ifdef FALLBACK
layout(set = 0, binding = 3, std430) readonly buffer Work
{
    uint next_ray, fallback_count, unresolved_count, undecided_count, fallback_rays[];
};
#endif

#include "bvhd_ray_query.glsl"

// Whether a candidate is hit where the query says.
#ifdef BVHD_ROUND
#define IS_BUILT_IN(type) (type != BVHD_CANDIDATE_AABB)
#else
#define IS_BUILT_IN(type) (type == BVHD_CANDIDATE_TRIANGLE)
#endif

BvhdHit committed(BvhdRayQuery query)
{
    BvhdHit hit = miss();
    uint type = bvhdRayQueryGetIntersectionType(query, true);
    if (type == BVHD_COMMITTED_NONE)
        return hit;
    uvec2 primitive = bvhdPrimitiveOf(query, true);
    vec2 barycentrics = bvhdRayQueryGetIntersectionBarycentrics(query, true);
    hit.t = bvhdRayQueryGetIntersectionT(query, true);
    hit.u = barycentrics.x;
    hit.v = barycentrics.y;
    hit.instance = bvhdRayQueryGetIntersectionInstanceId(query, true);
    hit.custom_index = bvhdRayQueryGetIntersectionInstanceCustomIndex(query, true);
    hit.geometry = primitive.x;
    hit.primitive = primitive.y;
    hit.flags = (bvhdRayQueryGetIntersectionFrontFace(query, true) ? FRONT_FACE : 0u) |
                (type == BVHD_COMMITTED_GENERATED ? IS_AABB : 0u);
#ifdef BVHD_ROUND
    hit.flags |= type == BVHD_COMMITTED_SPHERE ? IS_SPHERE : type == BVHD_COMMITTED_SWEPT_SPHERE ? IS_SWEPT_SPHERE : 0u;
#endif
    return hit;
}

void trace(uint index)
{
    BvhdRay ray = rays[index];
    BvhdRayQuery query;
#ifdef BVHD_MOTION
    bvhdRayQueryInitializeMotion(query, extra, ray.flags.x | ray_flags, ray.flags.y & 0xffu, ray.origin.xyz,
                                 ray.origin.w, ray.direction.xyz, ray.direction.w, uintBitsToFloat(ray.flags.z));
#else
    bvhdRayQueryInitialize(query, extra, ray.flags.x | ray_flags, ray.flags.y & 0xffu, ray.origin.xyz, ray.origin.w,
                           ray.direction.xyz, ray.direction.w);
#endif
    while (bvhdRayQueryProceed(query))
        if (IS_BUILT_IN(bvhdRayQueryGetIntersectionType(query, false)))
            bvhdRayQueryConfirmIntersection(query);
        else
            bvhdRayQueryGenerateIntersection(query, bvhdRayQueryGetIntersectionT(query, false));
    hits[index] = committed(query);
}

void main()
{
#ifdef FALLBACK
    for (uint i = gl_GlobalInvocationID.x; i < fallback_count; i += gl_NumWorkGroups.x * gl_WorkGroupSize.x)
        trace(fallback_rays[i]);
#else
    if (gl_GlobalInvocationID.x < count)
        trace(gl_GlobalInvocationID.x);
#endif
}
