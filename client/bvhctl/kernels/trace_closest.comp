// SPDX-License-Identifier: Apache-2.0
/*
 * The closest triangles through portable structures, for rays without flags and scenes without AABBs. Compiled six times: with BVHD_BUFFER_ADDRESS, where the scene is
 * found by the address of its buffer, and without, when it is binding 2; and
 *
 *   for rays that go together   a thread a ray, each by itself;
 *   for others, REFILL defined  as many workgroups as the device holds: lanes that are done take new rays once enough of them are, and triangles
 *                               wait until enough lanes have some. Needs subgroup operations (ballot);
 *   after either, SETTLE        for the rays with doubts: what decides on them takes so many registers that the others are quicker without it.
 */
#version 450
#extension GL_GOOGLE_include_directive : require
#ifdef BVHD_BUFFER_ADDRESS
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#endif
#ifdef REFILL
#extension GL_KHR_shader_subgroup_ballot : require
#endif

#define HITS_AS_ROWS
#include "trace_rays.glsl"

layout(constant_id = 1) const bool has_instances = true;
layout(constant_id = 2) const bool fused_fma = false;
#define BVHD_PLAIN_BYTES true
#define BVHD_FUSED_FMA fused_fma

#ifdef BVHD_BUFFER_ADDRESS
layout(buffer_reference, std430, buffer_reference_align = 16) readonly buffer SceneRows { uvec4 row[]; };
layout(buffer_reference, std430, buffer_reference_align = 4) readonly buffer SceneWords { uint word[]; };
#define BVHD_STORAGE_ROWS SceneRows(scene_base).row
#define BVHD_STORAGE_WORDS SceneWords(scene_base).word
#undef BVHD_BUFFER_ADDRESS
#else
layout(set = 0, binding = 2, std430) readonly buffer SceneRows { uvec4 scene_rows[]; };
layout(set = 0, binding = 2, std430) readonly buffer SceneWords { uint scene_words[]; };
#define BVHD_STORAGE_ROWS scene_rows
#define BVHD_STORAGE_WORDS scene_words
#endif

layout(set = 0, binding = 3, std430) buffer Work {
    uint next_ray; // for REFILL
    uint left_count; // rays that are left to trace_portable.comp
    uint unsettled_count; // rays that are left to SETTLE; more than there is room for count too
    uint reserved;
    uint left[1 << 20];
    uvec4 unsettled[]; // UNSETTLED_ROWS each
};
const uint UNSETTLED_ROWS = 8u;

#include "bvhd_ray_query.glsl"
#include "closest.glsl"
#include "closest_settle.glsl"

#ifdef SETTLE

void main()
{
    uint end = min(unsettled_count, uint(unsettled.length()) / UNSETTLED_ROWS);
    for (uint i = gl_GlobalInvocationID.x; i < end; i += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        take_unsettled(UNSETTLED_ROWS * i);
        settle();
        finish();
    }
}

#elif defined REFILL

const uint BUSY_SHARE = 11u, BUSY_OF = 16u; // fewer lanes than this share: the others take new rays
const uint STALLED_SHARE = 2u; // triangles are looked at when one lane in so many can do nothing else

uint count_lanes(bool which)
{
    return subgroupBallotBitCount(subgroupBallot(which));
}

// A node, if there is room for its records. False: the ray is done.
bool advance(inout bool is_stalled)
{
    if (nodes.y < FIRST_INNER) {
        if (top == level_bottom && waiting.y != 0u) {
            is_stalled = true;
            return true;
        }
        if (!resume())
            return false;
    }
    if (nodes.y >= FIRST_INNER && records.y == 0u)
        visit_node();
    return true;
}

// One step of all lanes. False: this one's ray is done.
bool step_together(bool is_working)
{
    bool is_top = has_instances && content == BVHD_CONTENT_INSTANCES;
    if (is_working && records.y != 0u && waiting.y == 0u && !is_top) {
        waiting = records;
        records.y = 0u;
    }
    bool is_stalled = is_working && records.y != 0u;
    if (is_working && !is_stalled)
        is_working = advance(is_stalled);
    uint stalled = count_lanes(is_stalled);
    if (stalled == 0u || stalled * STALLED_SHARE < count_lanes(is_working))
        return is_working;
    while (waiting.y != 0u) {
        visit_triangle(take(waiting));
        if (waiting.y == 0u) {
            waiting = records;
            records.y = 0u;
        }
    }
    if (has_instances && is_working && content == BVHD_CONTENT_INSTANCES && records.y != 0u)
        visit_record();
    return is_working;
}

void main()
{
    bool is_working = false, is_finished = false, is_exhausted = false;
    while (true) {
        if (is_finished)
            finish();
        is_finished = false;
        uint wanted = count_lanes(!is_working);
        if (!is_exhausted && wanted != 0u) {
            uint first = 0u;
            if (subgroupElect())
                first = atomicAdd(next_ray, wanted);
            first = subgroupBroadcastFirst(first);
            uint taken = subgroupBallotExclusiveBitCount(subgroupBallot(!is_working));
            if (!is_working && first + taken < count) {
                index = first + taken;
                is_working = true;
                start();
            }
            is_exhausted = first + wanted >= count;
        }
        uint busy = count_lanes(is_working);
        if (busy == 0u)
            break;
        while (busy != 0u && (is_exhausted || busy * BUSY_OF >= gl_SubgroupSize * BUSY_SHARE)) {
            bool was_working = is_working;
            is_working = step_together(is_working);
            is_finished = is_finished || was_working && !is_working;
            busy = count_lanes(is_working);
        }
    }
}

#else

void main()
{
    index = gl_GlobalInvocationID.x;
    if (index >= count)
        return;
    start();
    do {
        if (nodes.y >= FIRST_INNER && records.y == 0u)
            visit_node();
        while (records.y != 0u)
            visit_record();
    } while (nodes.y >= FIRST_INNER || resume());
    finish();
}

#endif
