// SPDX-License-Identifier: Apache-2.0
/*
 * closest_teams.glsl - triangles of few lanes, looked at by all lanes of a subgroup: each lane that has some gets a
 * team of four or eight, who look at one each and tell what they have seen. For one structure, without instances, and
 * where all lanes of the subgroup come along, those without a ray too.
 */
#ifndef BVHD_CLOSEST_COOPERATIVE_GLSL
#define BVHD_CLOSEST_COOPERATIVE_GLSL

// As powers of two: teams of two cost more than they give.
const int LEAST_TEAM = 2, LARGEST_TEAM = 3;

// The lane that each team works for. A subgroup's begin at the place of its first lane.
shared uint leaders[gl_WorkGroupSize.x];

// For the others of the subgroup to look with: until questions and answers are needed, rays lie in their place.
void share_test_ray()
{
    requests[gl_LocalInvocationIndex] = floatBitsToUint(vec4(origin, volume_error));
    results[gl_LocalInvocationIndex] = floatBitsToUint(vec4(direction, tmin));
    sync_subgroup();
}

TestRay test_ray_of(uint lane)
{
    uint place = gl_LocalInvocationIndex - gl_SubgroupInvocationID + lane;
    vec4 from = uintBitsToFloat(requests[place]), towards = uintBitsToFloat(results[place]);
    return TestRay(from.xyz, towards.xyz, from.w, towards.w, subgroupShuffle(low, lane), subgroupShuffle(high, lane));
}

// What of a set may be this member's: the numbers whose rest by the team's size is its own.
uint share_of(uint set, int level)
{
    return set & (level == LEAST_TEAM ? 0x11111111u : 0x01010101u) << (gl_SubgroupInvocationID & (1u << level) - 1u);
}

// What is left when each member has had the first of its share.
uint remaining_of(uint set, int level)
{
    uint size = 1u << level, later = set << size;
    later |= later << size;
    later |= later << 2u * size;
    return set & (later | later << 16);
}

// Takes what the lanes in `tellers`, counted from `first`, have seen. What one is sure of may be in doubt after another's, and is compared again.
void merge_hits(TestOutcome outcome, uint record, uint first, uint sources)
{
    const uint FRONT_BIT = 0x80000000u;
    uint packed = record | (outcome.is_front ? FRONT_BIT : 0u);
    while (subgroupAny(sources != 0u)) {
        uint source = first + uint(findLSB(sources)) & gl_SubgroupSize - 1u;
        float near = subgroupShuffle(outcome.near, source), far = subgroupShuffle(outcome.far, source);
        uint id = subgroupShuffle(outcome.id, source), source_packed = subgroupShuffle(packed, source), source_record = source_packed & ~FRONT_BIT;
        TestOutcome source_outcome = TestOutcome(IS_CLOSER, near, far, id, (source_packed & FRONT_BIT) != 0u);
        if (sources != 0u && near <= high) {
            if (far < low)
                accept(source_outcome, source_record);
            else
                keep_undecided(source_outcome, source_record);
        }
        sources &= sources - 1u;
    }
}

// One triangle for each member of each lane's team. `having`: which lanes have any, so many. The shuffles need what was read of `leaders`, and all lanes: nobody is
// early with the next ones.
void test_cooperatively(inout uvec2 group, uvec4 having, uint lanes, int level)
{
    uint begin = gl_LocalInvocationIndex - gl_SubgroupInvocationID, team = gl_SubgroupInvocationID >> level;
    uint own_team = subgroupBallotExclusiveBitCount(having);
    if (group.y != 0u)
        leaders[begin + own_team] = gl_SubgroupInvocationID;
    sync_subgroup();
    uint leader = team < lanes ? leaders[begin + team] : 0u;
    uint set = subgroupShuffle(group.y, leader), first = subgroupShuffle(group.x, leader);
    TestRay ray = test_ray_of(leader);
    uint own = team < lanes ? share_of(set, level) : 0u, record = first + uint(findLSB(own));
    TestOutcome outcome = TestOutcome(IS_MISSED, 0.0, 0.0, 0u, false);
    if (own != 0u)
        test_triangle(ray, record, false, outcome);
    uint first_member = own_team << level;
    uvec4 have_outcome = subgroupBallot(outcome.kind != IS_MISSED);
    merge_hits(outcome, record, first_member, group.y != 0u ? bitfieldExtract(have_outcome.x, int(first_member), 1 << level) : 0u);
    group.y = remaining_of(group.y, level);
}

void visit_triangles(inout uvec2 group)
{
    while (true) {
        uvec4 having = subgroupBallot(group.y != 0u);
        uint lanes = subgroupBallotBitCount(having);
        if (lanes == 0u)
            return;
        int level = min(findMSB(gl_SubgroupSize) - 1 - findMSB(lanes - 1u), LARGEST_TEAM);
        if (level >= LEAST_TEAM)
            test_cooperatively(group, having, lanes, level);
        else if (group.y != 0u)
            visit_triangle(take_record(group));
    }
}

#endif
