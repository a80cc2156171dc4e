// SPDX-License-Identifier: Apache-2.0
/*
 * closest_teams.glsl - triangles of few lanes, looked at by all lanes of a subgroup: each lane that has some gets a
 * team of four or eight, who look at one each and tell what they have seen. For one structure, without instances, and
 * where all lanes of the subgroup come along, those without a ray too.
 */
#ifndef CLOSEST_TEAMS_GLSL
#define CLOSEST_TEAMS_GLSL

// As powers of two: teams of two cost more than they give.
const int LEAST_TEAM = 2, LARGEST_TEAM = 3;

// The lane that each team works for. A subgroup's begin at the place of its first lane.
shared uint leaders[gl_WorkGroupSize.x];

// For the others of the subgroup to look with: until questions and answers are needed, rays lie in their place.
void keep_look()
{
    questions[gl_LocalInvocationIndex] = floatBitsToUint(vec4(origin, volume_error));
    answers[gl_LocalInvocationIndex] = floatBitsToUint(vec4(direction, tmin));
    share();
}

Look look_of(uint lane)
{
    uint place = gl_LocalInvocationIndex - gl_SubgroupInvocationID + lane;
    vec4 from = uintBitsToFloat(questions[place]), towards = uintBitsToFloat(answers[place]);
    return Look(from.xyz, towards.xyz, from.w, towards.w, subgroupShuffle(low, lane), subgroupShuffle(high, lane));
}

// What of a set may be this member's: the numbers whose rest by the team's size is its own.
uint share_of(uint set, int level)
{
    return set & (level == LEAST_TEAM ? 0x11111111u : 0x01010101u) << (gl_SubgroupInvocationID & (1u << level) - 1u);
}

// What is left when each member has had the first of its share.
uint left_of(uint set, int level)
{
    uint size = 1u << level, later = set << size;
    later |= later << size;
    later |= later << 2u * size;
    return set & (later | later << 16);
}

// Takes what the lanes in `tellers`, counted from `first`, have seen. What one is sure of may be in doubt after another's, and is compared again.
void hear(Sight sight, uint record, uint first, uint tellers)
{
    const uint FRONT_BIT = 0x80000000u;
    uint packed = record | (sight.is_front ? FRONT_BIT : 0u);
    while (subgroupAny(tellers != 0u)) {
        uint teller = first + uint(findLSB(tellers)) & gl_SubgroupSize - 1u;
        float near = subgroupShuffle(sight.near, teller), far = subgroupShuffle(sight.far, teller);
        uint id = subgroupShuffle(sight.id, teller), told = subgroupShuffle(packed, teller), told_record = told & ~FRONT_BIT;
        Sight told_sight = Sight(IS_CLOSER, near, far, id, (told & FRONT_BIT) != 0u);
        if (tellers != 0u && near <= high) {
            if (far < low)
                accept(told_sight, told_record);
            else
                doubt(told_sight, told_record);
        }
        tellers &= tellers - 1u;
    }
}

// One triangle for each member of each lane's team. `having`: which lanes have any, so many. The shuffles need what was read of `leaders`, and all lanes: nobody is
// early with the next ones.
void visit_by_teams(inout uvec2 group, uvec4 having, uint lanes, int level)
{
    uint begin = gl_LocalInvocationIndex - gl_SubgroupInvocationID, team = gl_SubgroupInvocationID >> level;
    uint own_team = subgroupBallotExclusiveBitCount(having);
    if (group.y != 0u)
        leaders[begin + own_team] = gl_SubgroupInvocationID;
    share();
    uint leader = team < lanes ? leaders[begin + team] : 0u;
    uint set = subgroupShuffle(group.y, leader), first = subgroupShuffle(group.x, leader);
    Look look = look_of(leader);
    uint own = team < lanes ? share_of(set, level) : 0u, record = first + uint(findLSB(own));
    Sight sight = Sight(IS_MISSED, 0.0, 0.0, 0u, false);
    if (own != 0u)
        look_at_triangle(look, record, false, sight);
    uint first_member = own_team << level;
    uvec4 seeing = subgroupBallot(sight.kind != IS_MISSED);
    hear(sight, record, first_member, group.y != 0u ? bitfieldExtract(seeing.x, int(first_member), 1 << level) : 0u);
    group.y = left_of(group.y, level);
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
            visit_by_teams(group, having, lanes, level);
        else if (group.y != 0u)
            visit_triangle(take(group));
    }
}

#endif
