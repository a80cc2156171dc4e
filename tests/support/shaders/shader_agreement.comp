// SPDX-License-Identifier: Apache-2.0
// Writes what ray queries over portable structures report about each ray, in the layout that shader_bed.h reads. It is
// compiled with each combination of BVHD_BUFFER_ADDRESS, BVHD_ROUND and BVHD_MOTION.
#version 450
#extension GL_GOOGLE_include_directive : require
#ifdef BVHD_BUFFER_ADDRESS
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#endif

layout(local_size_x = 64) in;
layout(constant_id = 0) const bool plain_bytes = false;
layout(constant_id = 1) const bool fused_fma = false;
#define BVHD_PLAIN_BYTES plain_bytes
#define BVHD_FUSED_FMA fused_fma

layout(set = 0, binding = 0, std430) readonly buffer SceneRows { uvec4 scene_rows[]; };
layout(set = 0, binding = 0, std430) readonly buffer SceneWords { uint scene_words[]; };
#ifndef BVHD_BUFFER_ADDRESS
#define BVHD_STORAGE_ROWS scene_rows
#define BVHD_STORAGE_WORDS scene_words
#endif
#include "bvhd_ray_query.glsl"

struct Ray {
    vec4 origin; // w: tmin
    vec4 direction; // w: tmax
    uvec4 flags; // ray flags, cull mask, time
};
layout(set = 0, binding = 1, std430) readonly buffer Rays { Ray rays[]; };
layout(set = 0, binding = 2, std430) writeonly buffer Answers { uint answers[]; };

layout(push_constant) uniform Push {
    uint count;
    uint policy;
    uvec2 root;
    uint most_candidates; // 0: hits only
};

const uint POLICY_ACCEPT = 0u, POLICY_IGNORE = 1u, POLICY_SOME = 2u, POLICY_END = 3u;

void note(inout uint at, uint value)
{
    answers[at++] = value;
}

void note3(inout uint at, vec3 value)
{
    note(at, floatBitsToUint(value.x));
    note(at, floatBitsToUint(value.y));
    note(at, floatBitsToUint(value.z));
}

// Writes ten words.
void note_intersection(inout uint at, BvhdRayQuery query, bool committed)
{
    vec2 barycentrics = bvhdRayQueryGetIntersectionBarycentrics(query, committed);
    note(at, floatBitsToUint(bvhdRayQueryGetIntersectionT(query, committed)));
    note(at, floatBitsToUint(barycentrics.x));
    note(at, floatBitsToUint(barycentrics.y));
    note(at, bvhdRayQueryGetIntersectionInstanceId(query, committed));
    note(at, bvhdRayQueryGetIntersectionInstanceCustomIndex(query, committed));
    note(at, bvhdRayQueryGetIntersectionGeometryIndex(query, committed));
    note(at, bvhdRayQueryGetIntersectionPrimitiveIndex(query, committed));
    uint type = bvhdRayQueryGetIntersectionType(query, committed);
    bool isAabb = committed ? type == BVHD_COMMITTED_GENERATED : type == BVHD_CANDIDATE_AABB;
    bool isSphere = type == (committed ? BVHD_COMMITTED_SPHERE : BVHD_CANDIDATE_SPHERE);
    bool isSwept = type == (committed ? BVHD_COMMITTED_SWEPT_SPHERE : BVHD_CANDIDATE_SWEPT_SPHERE);
    note(at, (bvhdRayQueryGetIntersectionFrontFace(query, committed) ? 1u : 0u) | (isAabb ? 2u : 0u) |
                 (isSphere ? 4u : 0u) | (isSwept ? 8u : 0u));
    note(at, bvhdRayQueryGetIntersectionInstanceShaderBindingTableRecordOffset(query, committed));
    note(at, !committed && isAabb && bvhdRayQueryGetIntersectionCandidateAABBOpaque(query) ? 1u : 0u);
}

// Writes 39 words: the corners, or both centres and the radii; the ray in object space, and both matrices.
void note_details(inout uint at, BvhdRayQuery query)
{
    vec3 corners[3] = vec3[](vec3(0.0), vec3(0.0), vec3(0.0));
    uint type = bvhdRayQueryGetIntersectionType(query, true);
    if (type == BVHD_COMMITTED_TRIANGLE)
        bvhdRayQueryGetIntersectionTriangleVertexPositions(query, true, corners);
#ifdef BVHD_ROUND
    if (type == BVHD_COMMITTED_SPHERE || type == BVHD_COMMITTED_SWEPT_SPHERE) {
        vec4 ends[2];
        bvhdRayQueryGetIntersectionEnds(query, true, ends);
        corners = vec3[](ends[0].xyz, ends[1].xyz, vec3(ends[0].w, ends[1].w, 0.0));
    }
#endif
    note3(at, corners[0]);
    note3(at, corners[1]);
    note3(at, corners[2]);
    note3(at, bvhdRayQueryGetIntersectionObjectRayOrigin(query, true));
    note3(at, bvhdRayQueryGetIntersectionObjectRayDirection(query, true));
    mat4x3 there = bvhdRayQueryGetIntersectionObjectToWorld(query, true),
           back = bvhdRayQueryGetIntersectionWorldToObject(query, true);
    for (int column = 0; column < 4; column++)
        note3(at, there[column]);
    for (int column = 0; column < 4; column++)
        note3(at, back[column]);
}

bool is_accepted(BvhdRayQuery query)
{
    uint hash = bvhdRayQueryGetIntersectionInstanceId(query, false) * 73856093u ^
                bvhdRayQueryGetIntersectionGeometryIndex(query, false) * 19349663u ^
                bvhdRayQueryGetIntersectionPrimitiveIndex(query, false) * 83492791u;
    return policy == POLICY_ACCEPT || policy == POLICY_END || policy == POLICY_SOME && (hash >> 7 & 1u) != 0u;
}

void main()
{
    uint index = gl_GlobalInvocationID.x;
    if (index >= count)
        return;
    uint row = index * (12u + (most_candidates > 0u ? 39u + 10u * most_candidates : 0u)), candidates = 0u;
    Ray ray = rays[index];
    BvhdRayQuery query;
#ifdef BVHD_MOTION
    bvhdRayQueryInitializeMotion(query, root, ray.flags.x, ray.flags.y, ray.origin.xyz, ray.origin.w, ray.direction.xyz,
                                 ray.direction.w, uintBitsToFloat(ray.flags.z));
#else
    bvhdRayQueryInitialize(query, root, ray.flags.x, ray.flags.y, ray.origin.xyz, ray.origin.w, ray.direction.xyz,
                           ray.direction.w);
#endif
    while (bvhdRayQueryProceed(query)) {
        uint at = row + 51u + 10u * candidates;
        if (candidates < most_candidates)
            note_intersection(at, query, false);
        candidates++;
        if (!is_accepted(query))
            continue;
        if (bvhdRayQueryGetIntersectionType(query, false) == BVHD_CANDIDATE_AABB)
            bvhdRayQueryGenerateIntersection(query, bvhdRayQueryGetIntersectionT(query, false));
        else
            bvhdRayQueryConfirmIntersection(query);
        if (policy == POLICY_END)
            bvhdRayQueryTerminate(query);
    }
    uint at = row, type = bvhdRayQueryGetIntersectionType(query, true);
    answers[row + 10u] = type;
    answers[row + 11u] = candidates;
    if (type == BVHD_COMMITTED_NONE)
        return;
    note_intersection(at, query, true);
    at += 2u;
    if (most_candidates > 0u)
        note_details(at, query);
}
