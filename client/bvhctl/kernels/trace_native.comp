// SPDX-License-Identifier: Apache-2.0
// trace_native.comp - traces rays with the device's own ray queries. Triangles that are not opaque are accepted, AABBs
// are not.
#version 460
#extension GL_EXT_ray_query : require
#extension GL_EXT_ray_flags_primitive_culling : require
#extension GL_GOOGLE_include_directive : require

#include "bvhd_trace_rays.glsl"

layout(set = 0, binding = 2) uniform accelerationStructureEXT top;

void accept_triangles(rayQueryEXT query)
{
    while (rayQueryProceedEXT(query))
        if (rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionTriangleEXT)
            rayQueryConfirmIntersectionEXT(query);
}

BvhdHit committed(rayQueryEXT query)
{
    BvhdHit hit = miss();
    if (rayQueryGetIntersectionTypeEXT(query, true) == gl_RayQueryCommittedIntersectionNoneEXT)
        return hit;
    hit.t = rayQueryGetIntersectionTEXT(query, true);
    hit.geometry = rayQueryGetIntersectionGeometryIndexEXT(query, true);
    hit.primitive = rayQueryGetIntersectionPrimitiveIndexEXT(query, true);
    if (has_top != 0u) {
        hit.instance = rayQueryGetIntersectionInstanceIdEXT(query, true);
        hit.custom_index = rayQueryGetIntersectionInstanceCustomIndexEXT(query, true);
    }
    vec2 barycentrics = rayQueryGetIntersectionBarycentricsEXT(query, true);
    hit.u = barycentrics.x;
    hit.v = barycentrics.y;
    hit.flags = rayQueryGetIntersectionFrontFaceEXT(query, true) ? FRONT_FACE : 0u;
    return hit;
}

void main()
{
    uint index = gl_GlobalInvocationID.x;
    if (index >= count)
        return;
    BvhdRay ray = rays[index];
    if (!is_valid(ray)) {
        hits[index] = miss();
        return;
    }
    rayQueryEXT query;
    // The instance around a bottom level alone is not the scene's, so rays do not cull it.
    uint mask = has_top != 0u ? ray.flags.y & 0xffu : 0xffu;
    rayQueryInitializeEXT(query, top, ray.flags.x, mask, ray.origin.xyz, ray.origin.w, ray.direction.xyz,
                          ray.direction.w);
    accept_triangles(query);
    hits[index] = committed(query);
}
