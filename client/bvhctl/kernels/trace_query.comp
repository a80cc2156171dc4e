// SPDX-License-Identifier: Apache-2.0
// Rays by the device's own ray queries. Triangles that are not opaque are accepted, AABBs where the ray enters them.
#version 460
#extension GL_EXT_ray_query : require
#extension GL_EXT_ray_flags_primitive_culling : require
#extension GL_GOOGLE_include_directive : require

#include "trace_rays.glsl"

layout(set = 0, binding = 2, std430) readonly buffer Boxes { float bounds[]; };
layout(set = 0, binding = 3, std430) readonly buffer First { uint first[]; };
layout(set = 0, binding = 4) uniform accelerationStructureEXT top;

// The closed interval in which the ray is in the box of the candidate; false when it is empty.
bool enter_box(rayQueryEXT query, vec2 interval, out float enter)
{
    uint geometry = rayQueryGetIntersectionInstanceIdEXT(query, false) * extra.x + rayQueryGetIntersectionGeometryIndexEXT(query, false);
    uint row = 6u * (first[geometry] + rayQueryGetIntersectionPrimitiveIndexEXT(query, false));
    vec3 origin = rayQueryGetIntersectionObjectRayOriginEXT(query, false), direction = rayQueryGetIntersectionObjectRayDirectionEXT(query, false);
    enter = interval.x;
    float leave = interval.y;
    for (int axis = 0; axis < 3; axis++) {
        float low = bounds[row + axis], high = bounds[row + 3 + axis];
        if (direction[axis] == 0.0) {
            if (origin[axis] < low || origin[axis] > high)
                return false;
            continue;
        }
        float a = (low - origin[axis]) / direction[axis], b = (high - origin[axis]) / direction[axis];
        enter = max(enter, min(a, b));
        leave = min(leave, max(a, b));
    }
    return enter <= leave;
}

void accept_candidates(rayQueryEXT query, Ray ray)
{
    float nearest = ray.direction.w, enter;
    while (rayQueryProceedEXT(query))
        if (rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionTriangleEXT) {
            rayQueryConfirmIntersectionEXT(query);
            nearest = rayQueryGetIntersectionTEXT(query, true);
        } else if (extra.x > 0u && enter_box(query, vec2(ray.origin.w, nearest), enter)) {
            rayQueryGenerateIntersectionEXT(query, enter);
            nearest = enter;
        }
}

Hit committed(rayQueryEXT query)
{
    Hit hit = miss();
    uint type = rayQueryGetIntersectionTypeEXT(query, true);
    if (type == gl_RayQueryCommittedIntersectionNoneEXT)
        return hit;
    hit.t = rayQueryGetIntersectionTEXT(query, true);
    hit.geometry = rayQueryGetIntersectionGeometryIndexEXT(query, true);
    hit.primitive = rayQueryGetIntersectionPrimitiveIndexEXT(query, true);
    if (has_top != 0u) {
        hit.instance = rayQueryGetIntersectionInstanceIdEXT(query, true);
        hit.custom_index = rayQueryGetIntersectionInstanceCustomIndexEXT(query, true);
    }
    if (type == gl_RayQueryCommittedIntersectionGeneratedEXT) {
        hit.flags = IS_AABB;
        return hit;
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
    Ray ray = rays[index];
    if (!is_valid(ray)) {
        hits[index] = miss();
        return;
    }
    rayQueryEXT query;
    uint mask = has_top != 0u ? ray.flags.y & 0xffu : 0xffu; // the instance around a bottom level alone is nobody's to cull
    rayQueryInitializeEXT(query, top, ray.flags.x, mask, ray.origin.xyz, ray.origin.w, ray.direction.xyz, ray.direction.w);
    accept_candidates(query, ray);
    hits[index] = committed(query);
}
