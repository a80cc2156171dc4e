// SPDX-License-Identifier: Apache-2.0
// Traces one ray straight down at each of 64 x 64 places over [0, 4) x [0, 4), and writes how far it goes, or -1. It is
// compiled with one of these defined:
//   NATIVE     the device's own ray queries, through an acceleration structure
//   PORTABLE   bvhd_ray_query.glsl, through a storage buffer; root is an offset in it
//   ADDRESSES  the same, through buffer addresses; root is an address
#version 460
#extension GL_GOOGLE_include_directive : require

layout(local_size_x = 64) in;
layout(set = 0, binding = 0, std430) writeonly buffer Distances { float distances[]; };
layout(push_constant) uniform Push { uvec2 root; };

#if defined(NATIVE)
#extension GL_EXT_ray_query : require
layout(set = 0, binding = 1) uniform accelerationStructureEXT scene;
#elif defined(ADDRESSES)
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#define BVHD_BUFFER_ADDRESS
#include "bvhd_ray_query.glsl"
#else
layout(set = 0, binding = 1, std430) readonly buffer SceneRows { uvec4 scene_rows[]; };
layout(set = 0, binding = 1, std430) readonly buffer SceneWords { uint scene_words[]; };
#define BVHD_STORAGE_ROWS scene_rows
#define BVHD_STORAGE_WORDS scene_words
#include "bvhd_ray_query.glsl"
#endif

void main()
{
    uint index = gl_GlobalInvocationID.x;
    vec3 origin = vec3((float(index % 64u) + 0.25) / 16.0, (float(index / 64u) + 0.5) / 16.0, 10.0),
         direction = vec3(0.0, 0.0, -1.0);
    float distance = -1.0;
#if defined(NATIVE)
    rayQueryEXT query;
    rayQueryInitializeEXT(query, scene, gl_RayFlagsNoneEXT, 0xffu, origin, 0.0, direction, 100.0);
    while (rayQueryProceedEXT(query))
        rayQueryConfirmIntersectionEXT(query);
    if (rayQueryGetIntersectionTypeEXT(query, true) != gl_RayQueryCommittedIntersectionNoneEXT)
        distance = rayQueryGetIntersectionTEXT(query, true);
#else
    BvhdRayQuery query;
    bvhdRayQueryInitialize(query, root, BVHD_RAY_FLAGS_NONE, 0xffu, origin, 0.0, direction, 100.0);
    while (bvhdRayQueryProceed(query))
        bvhdRayQueryConfirmIntersection(query);
    if (bvhdRayQueryGetIntersectionType(query, true) != BVHD_COMMITTED_NONE)
        distance = bvhdRayQueryGetIntersectionT(query, true);
#endif
    distances[index] = distance;
}
