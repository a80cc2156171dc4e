// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_trace_closest.comp - the closest triangles for rays without flags, in scenes of portable structures without
 * AABBs. It is compiled in variants (meson.build):
 *
 *   (nothing)            for coherent rays: one thread for each ray.
 *   BATCH_RECORDS        the same, but records are tested only when enough lanes have some. That pays where many
 *                        records are instances, or where triangles are so small that neighbouring rays meet different
 *                        ones.
 *   REFILL               for incoherent rays: persistent threads, as many as the device holds. Lanes without a ray take
 *                        new ones once enough lanes are free, and triangles are postponed until enough lanes have some.
 *   RESOLVE              runs after the others, and resolves undecided triangles. The code for that needs so many
 *                        registers that the others are faster without it.
 *   DOUBLES              resolves in doubles, where these are fast. The kernel for coherent rays then resolves its
 *                        undecided triangles itself, so that no ray waits for the last one of another kernel. It runs
 *                        in one workgroup for each multiprocessor, whose subgroups take rays when they are done: the
 *                        size of the workgroup is what bounds the registers that compilers use.
 *   COOPERATIVE          with DOUBLES, for one structure without instances: all lanes of a subgroup test the triangles
 *                        of few lanes. For coherent rays that is done wherever triangles are small; with REFILL only in
 *                        the tail of the launch, and each subgroup resolves its rays when it has no more rays.
 *   BVHD_BUFFER_ADDRESS  the scene is found by the address of its buffer; without it the scene is binding 2.
 *
 * All need subgroup ballots. COOPERATIVE also needs shuffles and votes, and full subgroups of at most 32 lanes.
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

#define BVHD_NOTHING_ROUND
#define HITS_AS_ROWS
#include "bvhd_trace_rays.glsl"

#ifdef COOPERATIVE
const bool has_instances = false;
#else
layout(constant_id = 1) const bool has_instances = true;
#endif
layout(constant_id = 2) const bool fused_fma = false;
layout(constant_id = 3) const bool plain_bytes = false;
layout(constant_id = 4) const uint content_of_bottoms = 0xffffffffu; // of all bottom levels, if they have the same
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
    uint next_ray; // the first ray that no persistent thread has taken
    uint fallback_count; // rays that are left to bvhd_trace_query.comp
    uint unresolved_count; // rays that are left to RESOLVE
    uint undecided_count; // undecided triangles, also those without room
    // First the numbers of `count` rays: those for the fallback from the front, those for RESOLVE from the back. Then
    // the undecided triangles: record, instance, a lower bound of t, and the entry before it in the ray's list.
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

// The number of lanes before this one for which it is true.
uint count_before(bool which)
{
    return subgroupBallotExclusiveBitCount(subgroupBallot(which));
}

// Waits until all lanes of the subgroup have written shared memory. On a CPU the lanes are those of a vector, which
// needs no wait; llvmpipe miscompiles subgroup barriers in loops.
void sync_subgroup()
{
    if (is_cpu)
        subgroupMemoryBarrierShared();
    else
        subgroupBarrier();
}

// Takes `wanted` rays from the queue, for the active lanes. Returns the first one.
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

// The state of a lane without a ray.
void go_idle()
{
    nodes = records = postponed = uvec2(0u);
    top = level_bottom = 0;
    last_undecided = NONE;
}
#endif

#ifdef RESOLVE

// Each workgroup takes few rays: lanes without one compute exact tests of the others.
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

const uint BUSY_SHARE = 13u, BUSY_OF = 16u; // when fewer lanes than this fraction are busy, the others take new rays
#ifdef COOPERATIVE
const uint TAIL_SHARE = 2u; // trace_tail begins when at most one lane in TAIL_SHARE has one of the last rays
#else
const uint TAIL_SHARE = 129u; // never: no subgroup has that many lanes
#endif
// Triangles are tested when one lane in STALLED_SHARE can do nothing else, and for as long as more than one lane in
// POSTPONED_SHARE has some: lanes with many triangles do not hold up the others.
const uint STALLED_SHARE = 3u;
const uint POSTPONED_SHARE = 4u;

// Postpones records of triangles until many lanes test some. Records of instances are not postponed.
void postpone_records()
{
    if (postponed.y == 0u && !is_top()) {
        postponed = records;
        records.y = 0u;
    }
}

// Visits a node, if there is room for its records. Returns false when the ray is done.
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

// One step of all lanes. Returns false when this lane's ray is done. `busy`: the number of lanes whose rays are not.
bool step_together(bool is_working, out uint busy)
{
    if (is_working)
        is_working = advance();
    bool is_stalled =
        is_working && (records.y != 0u || postponed.y != 0u && nodes.y < FIRST_INNER && top == level_bottom);
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

// Traces the tail of the launch, the last few rays, with all lanes: those without a ray test triangles of the others.
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

// Resolves the rays with undecided triangles that the subgroup has traced, one of each lane at a time.
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
    postponed = records = uvec2(0u); // for lanes that never get a ray
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

const uint POSTPONED_SHARE = 2u; // records are tested when one lane in POSTPONED_SHARE has some

// Visits one instance, because its nodes come next, or tests all triangles.
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
 * The order in which rays are started: from a quarter of them on to the last, then the first quarter. The rays of a
 * picture's middle usually take longest; started late, they would be a long tail of the launch. Whole workgroups are
 * moved, so that coherent rays stay together.
 */
uint ray_at(uint place)
{
    uint skipped = count / 4u & ~127u, after = count - skipped;
    return place < after ? place + skipped : place - after;
}

#ifdef DOUBLES
const bool takes_rays = !has_instances; // with instances, rays take too different times
#else
const bool takes_rays = false;
#endif

#ifdef COOPERATIVE

// Traces the rays of a subgroup. All lanes take part until the last ray is done.
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
