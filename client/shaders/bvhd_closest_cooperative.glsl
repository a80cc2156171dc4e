// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_closest_cooperative.glsl - tests the triangles of few lanes with all lanes of a subgroup: each lane that has
 * triangles gets a team of four or eight lanes, which test one triangle each and share the outcomes. It is for scenes
 * of one structure without instances. All lanes of the subgroup have to take part, also those without a ray.
 */
#ifndef BVHD_CLOSEST_COOPERATIVE_GLSL
#define BVHD_CLOSEST_COOPERATIVE_GLSL

// Log2 of the sizes of teams: teams of two lanes cost more than they gain.
const int LEAST_TEAM = 2, LARGEST_TEAM = 3;

// The lane whose triangles each team tests. A subgroup's entries begin at the place of its first lane.
shared uint leaders[gl_WorkGroupSize.x];

// Publishes the lane's ray to its subgroup, in the arrays `requests` and `results`, which are not needed before the
// end.
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

// The bits of a set that this member of a team tests: those whose number modulo the team's size is its own.
uint share_of(uint set, int level)
{
    return set & (level == LEAST_TEAM ? 0x11111111u : 0x01010101u) << (gl_SubgroupInvocationID & (1u << level) - 1u);
}

// The set without the lowest bit of each member's share.
uint remaining_of(uint set, int level)
{
    uint size = 1u << level, later = set << size;
    later |= later << size;
    later |= later << 2u * size;
    return set & (later | later << 16);
}

// Merges the outcomes of lanes `first` + i, for each bit i of `sources`. A certain hit may overlap another lane's
// bounds, so it is compared again and may become undecided.
void merge_hits(TestOutcome outcome, uint record, uint first, uint sources)
{
    const uint FRONT_BIT = 0x80000000u;
    uint packed = record | (outcome.is_front ? FRONT_BIT : 0u);
    while (subgroupAny(sources != 0u)) {
        uint source = first + uint(findLSB(sources)) & gl_SubgroupSize - 1u;
        float near = subgroupShuffle(outcome.near, source), far = subgroupShuffle(outcome.far, source);
        uint id = subgroupShuffle(outcome.id, source), source_packed = subgroupShuffle(packed, source),
             source_record = source_packed & ~FRONT_BIT;
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

// Each member of each lane's team tests one triangle. `having` has the lanes with triangles, `lanes` of them. The
// shuffles need all lanes and their reads of `leaders`, so no lane can overwrite these too early.
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
    merge_hits(outcome, record, first_member,
               group.y != 0u ? bitfieldExtract(have_outcome.x, int(first_member), 1 << level) : 0u);
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
