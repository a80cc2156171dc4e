// SPDX-License-Identifier: Apache-2.0
/*
 * The closest triangles through portable structures, for rays without flags and scenes without AABBs. Compiled thirteen
 * times: with BVHD_BUFFER_ADDRESS, where the scene is found by the address of its buffer, and without, when it is
 * binding 2; and
 *
 *   for rays that go together   a thread a ray; with WAIT records are looked at when enough lanes have some: that pays where many of them are instances, or
 *                               triangles so small that neighbours meet others;
 *   for others, REFILL defined  as many workgroups as the device holds: lanes that are done take new rays once enough of them are, and triangles
 *                               wait until enough lanes have some;
 *   after either, SETTLE        for the rays with doubts: what decides on them takes so many registers that the others are quicker without it;
 *   with DOUBLES, addresses     in doubles where these are quick. Rays that go together are decided by their own kernel then, and none waits for the last one of a
 *                               kernel to be decided by another. It runs in one workgroup a multiprocessor, whose subgroups take rays as they get done: nothing
 *                               else bounds the registers that compilers use.
 *   with TEAMS, too             one structure alone. Of rays that go together, where its triangles are small, few lanes' triangles are looked at by all; with REFILL those
 *                               of the last rays, and each subgroup decides on its doubts when it has no more rays.
 *
 * All need subgroup operations (ballot; with TEAMS shuffle and vote, and subgroups of 32 lanes at most, of which none
 * is missing).
 */
#version 450
#extension GL_GOOGLE_include_directive : require
#ifdef BVHD_BUFFER_ADDRESS
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_buffer_reference_uvec2 : require
#endif
#extension GL_KHR_shader_subgroup_ballot : require
#ifdef COOPERATIVE
#extension GL_KHR_shader_subgroup_shuffle : require
#extension GL_KHR_shader_subgroup_vote : require
#endif

#define HITS_AS_ROWS
#include "bvhd_trace_rays.glsl"

#ifdef COOPERATIVE
const bool has_instances = false;
#else
layout(constant_id = 1) const bool has_instances = true;
#endif
layout(constant_id = 2) const bool fused_fma = false;
layout(constant_id = 3) const bool plain_bytes = false;
layout(constant_id = 4) const uint content_of_bottoms = 0xffffffffu; // of all of them, if it is the same
layout(constant_id = 5) const bool is_cpu = false;
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
    uint next_ray; // where rays are handed out
    uint fallback_count; // rays that are left to trace_portable.comp
    uint unresolved_count; // rays that are left to SETTLE
    uint undecided_count; // those that there is no room for too
    // Numbers of rays, `count` of them: of those left from the first on, of those for SETTLE from the last. Then doubts: record, instance, a lower bound of t,
    // the same ray's doubt before it.
    uvec4 work_rows[];
};

uint first_undecided()
{
    return (count + 3u) / 4u;
}

uint undecided_room()
{
    return uint(work_rows.length()) - first_undecided();
}

void set_ray_number(uint place, uint ray)
{
    work_rows[place / 4u][place % 4u] = ray;
}

uint count_lanes(bool which)
{
    return subgroupBallotBitCount(subgroupBallot(which));
}

// How many lanes before this one.
uint count_before(bool which)
{
    return subgroupBallotExclusiveBitCount(subgroupBallot(which));
}

// Until all of a subgroup have written. On a CPU lanes are those of a vector, and llvmpipe goes wrong at a subgroup's barriers in loops.
void sync_subgroup()
{
    if (is_cpu)
        subgroupMemoryBarrierShared();
    else
        subgroupBarrier();
}

// The first of so many rays, for the lanes that are here.
uint take_rays(uint wanted)
{
    uint first = 0u;
    if (subgroupElect())
        first = atomicAdd(next_ray, wanted);
    return subgroupBroadcastFirst(first);
}

#include "bvhd_ray_query.glsl"
#include "bvhd_closest.glsl"
#include "bvhd_closest_resolve.glsl"
#ifdef COOPERATIVE
#include "bvhd_closest_cooperative.glsl"

// Of a lane without a ray.
void go_idle()
{
    nodes = records = postponed = uvec2(0u);
    top = level_bottom = 0;
    last_undecided = NONE;
}
#endif

#ifdef RESOLVE

// Few rays for each workgroup: lanes without one help to decide.
void main()
{
    uint own = gl_LocalInvocationIndex * gl_NumWorkGroups.x + gl_WorkGroupID.x;
    for (uint first = 0u; first < unresolved_count; first += gl_NumWorkGroups.x * gl_WorkGroupSize.x) {
        uint i = first + own, place = count - 1u - i;
        last_undecided = NONE;
        if (i < unresolved_count)
            load_unresolved(work_rows[place / 4u][place % 4u]);
        resolve();
        if (i < unresolved_count)
            finish();
    }
}

#else

#ifdef REFILL

const uint BUSY_SHARE = 13u, BUSY_OF = 16u; // fewer lanes than this share: the others take new rays
#ifdef COOPERATIVE
const uint TAIL_SHARE = 2u; // no more lanes than one in so many have the last rays: all help them
#else
const uint TAIL_SHARE = 129u; // never, since no subgroup has that many lanes
#endif
const uint STALLED_SHARE = 3u; // triangles are looked at when one lane in so many can do nothing else
const uint POSTPONED_SHARE = 4u; // and for as long as more than one in so many have any: those with many go on with nodes beside the others

// Records of triangles wait until they are looked at by many lanes; those of instances stay.
void postpone_records()
{
    if (postponed.y == 0u && !is_top()) {
        postponed = records;
        records.y = 0u;
    }
}

// A node, if there is room for its records. False: the ray is done.
bool advance()
{
    if (nodes.y < FIRST_INNER && records.y == 0u) {
        if (top != level_bottom)
            nodes = stack[--top];
        else if (postponed.y == 0u && !pop_or_leave())
            return false;
    }
    postpone_records();
    if (nodes.y >= FIRST_INNER && records.y == 0u) {
        visit_node();
        postpone_records();
    }
    return true;
}

// One step of all lanes. False: this one's ray is done. `busy`: how many are not.
bool step_together(bool is_working, out uint busy)
{
    if (is_working)
        is_working = advance();
    bool is_stalled = is_working && (records.y != 0u || postponed.y != 0u && nodes.y < FIRST_INNER && top == level_bottom);
    uint stalled = count_lanes(is_stalled);
    busy = count_lanes(is_working);
    if (stalled == 0u || stalled * STALLED_SHARE < busy)
        return is_working;
    do {
        if (postponed.y != 0u)
            visit_triangle(take_record(postponed));
        postpone_records();
    } while (count_lanes(postponed.y != 0u) * POSTPONED_SHARE > busy);
    if (is_top() && is_working && records.y != 0u)
        visit_instance(take_record(records));
    return is_working;
}

#ifdef COOPERATIVE

// The rest of the way of the last few rays. All lanes go along: there are no others for them.
void trace_tail(bool is_working)
{
    if (!is_working)
        go_idle();
    share_test_ray();
    do {
        postpone_records();
        visit_triangles(postponed);
        if (records.y == 0u) {
            if (nodes.y < FIRST_INNER && top != 0)
                nodes = stack[--top];
            if (nodes.y >= FIRST_INNER)
                visit_node();
        }
    } while (subgroupAny(records.y != 0u || nodes.y >= FIRST_INNER || top != 0));
    if (is_working)
        finish();
}

// The subgroup's rays with doubts, of all lanes side by side.
void resolve_rest()
{
    sync_subgroup();
    while (subgroupAny(last_unresolved != NONE)) {
        bool has_ray = last_unresolved != NONE;
        last_undecided = NONE;
        if (has_ray)
            load_unresolved(last_unresolved);
        resolve();
        if (has_ray)
            finish();
    }
}

#endif

void main()
{
    postponed = records = uvec2(0u); // of lanes that no ray is left for
    bool is_working = false, is_finished = false, is_exhausted = false;
    while (true) {
        if (is_finished)
            finish();
        is_finished = false;
        uint wanted = count_lanes(!is_working);
        if (!is_exhausted && wanted != 0u) {
            uint first = take_rays(wanted), own = first + count_before(!is_working);
            if (!is_working && own < count) {
                index = own;
                is_working = true;
                start();
            }
            is_exhausted = first + wanted >= count;
        }
        uint busy = count_lanes(is_working);
        if (busy == 0u)
            break;
#ifdef COOPERATIVE
        if (is_exhausted && busy * TAIL_SHARE <= gl_SubgroupSize) {
            trace_tail(is_working);
            break;
        }
#endif
        while (busy * BUSY_OF >= gl_SubgroupSize * BUSY_SHARE || is_exhausted && busy * TAIL_SHARE > gl_SubgroupSize) {
            bool was_working = is_working;
            is_working = step_together(is_working, busy);
            is_finished = is_finished || was_working && !is_working;
        }
    }
#ifdef COOPERATIVE
    resolve_rest();
#endif
}

#else

const uint POSTPONED_SHARE = 2u; // records are looked at when one lane in so many has some

// Instances one at a time, since what is behind them is nodes again.
void visit_records()
{
    if (is_top()) {
        if (records.y != 0u)
            visit_instance(take_record(records));
    } else
        while (records.y != 0u)
            visit_triangle(take_record(records));
}

/*
 * The ray that is begun at this place of a portion (a picture or a part of one): from a quarter on to the last, then
 * those before. What a picture shows is in its middle, and takes longest; begun late, it would go on when most lanes
 * have nothing left to do. Whole workgroups are skipped, so that rays stay beside those that they go with.
 */
uint ray_at(uint place)
{
    uint skipped = count / 4u & ~127u, after = count - skipped;
    return place < after ? place + skipped : place - after;
}

#ifdef DOUBLES
const bool takes_rays = !has_instances; // instances make rays differ too much
#else
const bool takes_rays = false;
#endif

#ifdef COOPERATIVE

// All lanes go along until the last one's ray is done.
void trace(bool has_ray)
{
    go_idle();
    if (has_ray)
        start();
    share_test_ray();
    do {
        if (nodes.y >= FIRST_INNER)
            visit_node();
        visit_triangles(records);
        if (nodes.y < FIRST_INNER && top != 0)
            nodes = stack[--top];
    } while (subgroupAny(nodes.y >= FIRST_INNER));
    sync_subgroup();
    resolve();
    if (has_ray)
        finish();
}

void main()
{
    while (true) {
        uint place = take_rays(gl_SubgroupSize) + gl_SubgroupInvocationID;
        bool has_ray = place < count;
        if (!subgroupAny(has_ray))
            return;
        index = ray_at(place);
        trace(has_ray);
    }
}

#else

void trace()
{
    start();
    do {
        if (nodes.y >= FIRST_INNER && records.y == 0u)
            visit_node();
#ifdef BATCH_RECORDS
        if (count_lanes(records.y != 0u) * POSTPONED_SHARE >= count_lanes(true))
#endif
            visit_records();
    } while (records.y != 0u || nodes.y >= FIRST_INNER || pop_or_leave());
#ifdef DOUBLES
    resolve();
#endif
    finish();
}

void main()
{
    do {
        uint place = takes_rays ? take_rays(count_lanes(true)) + count_before(true) : gl_GlobalInvocationID.x;
        if (place >= count)
            return;
        index = ray_at(place);
        trace();
    } while (takes_rays);
}

#endif
#endif
#endif
