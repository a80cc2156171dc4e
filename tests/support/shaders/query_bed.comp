// SPDX-License-Identifier: Apache-2.0
// Traces a device's own ray queries and writes all that they report about the committed hit and about every candidate.
#version 460
#extension GL_EXT_ray_query : require
#extension GL_EXT_ray_flags_primitive_culling : require

layout(local_size_x = 64) in;

struct Ray {
    vec4 origin; // w: tmin
    vec4 direction; // w: tmax
    uvec4 flags; // ray flags, cull mask
};

// The layout of struct query_answer.
struct Answer {
    float t, u, v;
    uint instance, custom_index, geometry, primitive, flags, sbt_offset;
    uint matrices; // a checksum of both matrices and the ray in object space
    uint candidates, reserved;
};

layout(set = 0, binding = 0, std430) readonly buffer Rays { Ray rays[]; };
layout(set = 0, binding = 1, std430) writeonly buffer Answers { Answer answers[]; };
// three words for each ray: instance, geometry, primitive
layout(set = 0, binding = 2, std430) readonly buffer Targets { uint targets[]; };
// `listed` times three words for each ray
layout(set = 0, binding = 3, std430) writeonly buffer Candidates { uint candidates[]; };
layout(set = 0, binding = 4, std430) readonly buffer Boxes { float bounds[]; };
layout(set = 0, binding = 5, std430) readonly buffer First { uint first[]; };
layout(set = 0, binding = 6) uniform accelerationStructureEXT top;
layout(push_constant) uniform Push { uint count, policy, listed, geometry_stride; };

const uint ACCEPT = 0u, IGNORE = 1u, SOME = 2u, END = 3u, ONLY = 4u;
const uint FRONT_FACE = 1u, IS_AABB = 2u, IS_HIT = 4u;

uint mix_in(uint sum, uint value)
{
    return (sum ^ value) * 16777619u;
}

bool accepts(uvec3 id)
{
    uint ray = gl_GlobalInvocationID.x;
    if (policy == IGNORE)
        return false;
    if (policy == SOME)
        return (mix_in(mix_in(mix_in(2166136261u, id.x), id.y), id.z) >> 16) % 3u != 0u;
    if (policy == ONLY)
        return id == uvec3(targets[3u * ray], targets[3u * ray + 1u], targets[3u * ray + 2u]);
    return true;
}

// Hits the box half way through it, so that the driver's rounding of boxes decides nothing.
bool cross_box(rayQueryEXT query, Ray ray, uvec3 id, out float t)
{
    uint row = 6u * (first[id.x * geometry_stride + id.y] + id.z);
    vec3 origin = rayQueryGetIntersectionObjectRayOriginEXT(query, false),
         direction = rayQueryGetIntersectionObjectRayDirectionEXT(query, false);
    float enter = ray.origin.w, leave = ray.direction.w;
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
    t = 0.5 * enter + 0.5 * leave;
    return enter <= leave;
}

void list_candidate(uint number, uvec3 id)
{
    if (number >= listed)
        return;
    uint at = 3u * (gl_GlobalInvocationID.x * listed + number);
    for (int i = 0; i < 3; i++)
        candidates[at + i] = id[i];
}

// Runs the query and returns the number of candidates.
uint see_candidates(rayQueryEXT query, Ray ray)
{
    float nearest = ray.direction.w, t;
    uint number = 0u;
    while (rayQueryProceedEXT(query)) {
        uvec3 id = uvec3(rayQueryGetIntersectionInstanceIdEXT(query, false),
                         rayQueryGetIntersectionGeometryIndexEXT(query, false),
                         rayQueryGetIntersectionPrimitiveIndexEXT(query, false));
        bool is_triangle = rayQueryGetIntersectionTypeEXT(query, false) == gl_RayQueryCandidateIntersectionTriangleEXT;
        list_candidate(number++, id);
        if (!accepts(id))
            continue;
        if (is_triangle) {
            rayQueryConfirmIntersectionEXT(query);
            nearest = rayQueryGetIntersectionTEXT(query, true);
        } else {
            if (!cross_box(query, ray, id, t) || t >= nearest)
                continue;
            rayQueryGenerateIntersectionEXT(query, t);
            nearest = t;
        }
        if (policy == END)
            rayQueryTerminateEXT(query);
    }
    return number;
}

uint sum_matrix(uint sum, mat4x3 matrix)
{
    for (int column = 0; column < 4; column++)
        for (int row = 0; row < 3; row++)
            sum = mix_in(sum, floatBitsToUint(matrix[column][row]));
    return sum;
}

uint sum_spaces(rayQueryEXT query)
{
    uint sum = sum_matrix(2166136261u, rayQueryGetIntersectionObjectToWorldEXT(query, true));
    sum = sum_matrix(sum, rayQueryGetIntersectionWorldToObjectEXT(query, true));
    vec3 origin = rayQueryGetIntersectionObjectRayOriginEXT(query, true),
         direction = rayQueryGetIntersectionObjectRayDirectionEXT(query, true);
    for (int axis = 0; axis < 3; axis++)
        sum = mix_in(mix_in(sum, floatBitsToUint(origin[axis])), floatBitsToUint(direction[axis]));
    return sum;
}

Answer committed(rayQueryEXT query)
{
    Answer answer = Answer(uintBitsToFloat(0x7f800000u), 0.0, 0.0, 0xffffffffu, 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u);
    uint type = rayQueryGetIntersectionTypeEXT(query, true);
    if (type == gl_RayQueryCommittedIntersectionNoneEXT)
        return answer;
    answer.t = rayQueryGetIntersectionTEXT(query, true);
    answer.instance = rayQueryGetIntersectionInstanceIdEXT(query, true);
    answer.custom_index = rayQueryGetIntersectionInstanceCustomIndexEXT(query, true);
    answer.geometry = rayQueryGetIntersectionGeometryIndexEXT(query, true);
    answer.primitive = rayQueryGetIntersectionPrimitiveIndexEXT(query, true);
    answer.sbt_offset = rayQueryGetIntersectionInstanceShaderBindingTableRecordOffsetEXT(query, true);
    answer.matrices = sum_spaces(query);
    answer.flags = IS_HIT;
    if (type == gl_RayQueryCommittedIntersectionGeneratedEXT) {
        answer.flags |= IS_AABB;
        return answer;
    }
    vec2 barycentrics = rayQueryGetIntersectionBarycentricsEXT(query, true);
    answer.u = barycentrics.x;
    answer.v = barycentrics.y;
    answer.flags |= rayQueryGetIntersectionFrontFaceEXT(query, true) ? FRONT_FACE : 0u;
    return answer;
}

void main()
{
    uint index = gl_GlobalInvocationID.x;
    if (index >= count)
        return;
    Ray ray = rays[index];
    rayQueryEXT query;
    rayQueryInitializeEXT(query, top, ray.flags.x, ray.flags.y & 0xffu, ray.origin.xyz, ray.origin.w, ray.direction.xyz,
                          ray.direction.w);
    uint number = see_candidates(query, ray);
    Answer answer = committed(query);
    answer.candidates = number;
    answers[index] = answer;
}
