// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_ray_query.glsl - ray queries over portable structures, for any shader on any device: the life cycle of
 * GL_EXT_ray_query, with other names.
 *
 *     #version 450
 *     #extension GL_GOOGLE_include_directive : require
 *     ... declarations of where structures are: see bvhd_structure.glsl
 *     #include "bvhd_ray_query.glsl"
 *
 *     BvhdRayQuery query;
 *     bvhdRayQueryInitialize(query, root, BVHD_RAY_FLAGS_NONE, 0xffu, origin, tmin, direction, tmax);
 *     while (bvhdRayQueryProceed(query)) {
 *         if (bvhdRayQueryGetIntersectionType(query, false) == BVHD_CANDIDATE_AABB)
 *             ... bvhdRayQueryGenerateIntersection(query, t);
 *         else
 *             ... bvhdRayQueryConfirmIntersection(query);
 *     }
 *     if (bvhdRayQueryGetIntersectionType(query, true) != BVHD_COMMITTED_NONE)
 *         ... bvhdRayQueryGetIntersectionT(query, true)
 *
 * The root is the location of a top level's body, or of a bottom level's alone.
 *
 * With BVHD_ROUND defined, spheres and linear swept spheres can be hit. That takes registers and instructions which
 * other scenes do not need, so it has to be asked for: without BVHD_ROUND, rays pass through structures of these kinds
 * as if they were empty. Their candidates are confirmed as those of triangles are, so the loop above is right for them,
 * too. A shader that is never given a structure of these kinds may define BVHD_NOTHING_ROUND, and saves a comparison
 * for each structure that a ray enters.
 *
 * With BVHD_MOTION defined, motion triangles and motion instances can be hit, too, by queries that begin with
 *
 *     bvhdRayQueryInitializeMotion(query, root, flags, cullMask, origin, tmin, direction, tmax, time);
 *
 * where `time` is between 0 and 1. At any other time everything that moves is missed. bvhdRayQueryInitialize stands
 * for time 0. Without BVHD_MOTION rays pass through structures that move as if they were empty. BVHD_ROUND and
 * BVHD_MOTION are independent of each other, and BVHD_NOTHING_ROUND also says that nothing moves unless BVHD_MOTION is
 * defined.
 *
 * The semantics are Vulkan's: opaque triangles are committed without a candidate, other triangles and AABBs are
 * candidates; triangles are hit for tmin < t < tmax, AABBs for tmin <= t <= tmax; facing is decided in object space.
 * Spheres and linear swept spheres are hit as triangles are, where the ray enters them from outside; facing has no
 * effect on them, and BVHD_RAY_FLAGS_SKIP_TRIANGLES skips them.
 *
 * A candidate is offered only while it may still be the answer. With split references a candidate may be offered more
 * than once, unless its geometry has NO_DUPLICATE_ANY_HIT. Of equal t, the lowest (instance, geometry, primitive) wins.
 * The answers are those of the CPU (traverse.h), except for rays that a last bit decides.
 *
 * Coordinates and directions must be within 2^-60 .. 2^60 (or 0) and tmin must not be negative; otherwise hits may be
 * missed. A ray whose direction is zero, or whose origin or direction is not finite, hits nothing.
 *
 * The stack is a private array of the invocation. If a query begins while another one is under way, BVHD_QUERIES must
 * be defined as the largest number of them, and each begins with bvhdRayQueryInitializeAt and a different number below
 * that.
 */
#ifndef BVHD_RAY_QUERY_GLSL
#define BVHD_RAY_QUERY_GLSL

#include "bvhd_structure.glsl"
#include "bvhd_box.glsl"
#include "bvhd_triangle.glsl"
#ifdef BVHD_ROUND
#include "bvhd_round.glsl"
#endif
#ifdef BVHD_MOTION
#include "bvhd_motion.glsl"
#endif
#include "bvhd_ray_query_names.glsl"

#ifndef BVHD_QUERIES
#define BVHD_QUERIES 1
#endif

// At most one group for each level of nodes, 32 levels in each structure, and two groups saved at an instance.
const int BVHD_STACK_SIZE = 66;
uvec2 bvhdStack[BVHD_QUERIES * BVHD_STACK_SIZE];

// A hit, or a candidate for one.
struct BvhdIntersection {
    vec2 t; // a pair, to 32 significant bits; distances that are equal to that accuracy count as equal
    vec2 barycentrics;
    uint record; // in its bottom level
    uint instance; // record in the top level, BVHD_NO_INSTANCE without one
    uint type; // BVHD_COMMITTED_
    bool isFront;
};

struct BvhdRayQuery {
    vec3 origin, direction;
    float tmin, tmax;
#ifdef BVHD_MOTION
    float time;
#endif
    uint flags, cullMask;
    uvec2 root;
    BvhdIntersection committed, candidate;
    /*
     * The committed distance is in near .. far. During traversal it may be a guess, of which only record, instance and
     * type are known. Guesses that overlap are decided exactly, and so is the last one when traversal ends.
     */
    bool isGuess;
    float near, far;

    // The state of traversal: the current structure, the ray in its space, the groups that have to be visited.
    BvhdBody body;
    BvhdBoxRay boxRay;
    BvhdTriangleRay triangleRay;
    uint instance; // record in the top level; BVHD_NO_INSTANCE while the ray is in the root
    uint instanceFlags;
    uvec2 nodes; // first child; hits in bits 31 .. 24, inner mask in bits 7 .. 0
    uvec2 records; // first record; hits
    int bottom, top, levelBottom; // of the stack: of this query, the next entry, of the current structure
    bool isDone;
};

/* ---- Traversal ---- */

void bvhdPush(inout BvhdRayQuery query, uvec2 group)
{
    bvhdStack[query.top++] = group;
}

uvec2 bvhdPop(inout BvhdRayQuery query)
{
    return bvhdStack[--query.top];
}

// Goes to a structure's root node; query.triangleRay is in its space. Returns false when nothing can be hit there.
bool bvhdEnter(inout BvhdRayQuery query, uvec2 location)
{
    BvhdExtent extent;
    query.body = BVHD_BODY_SEEN(query, location, extent);
    BvhdTriangleRay ray = query.triangleRay;
    bool canHit = bvhdBoxRayInit(ray.origin, ray.originLow, ray.direction, query.tmin, extent, query.boxRay);
    query.triangleRay.isLarge = bvhdIsLarge(ray.origin, ray.direction, extent);
#ifdef BVHD_ROUND
    canHit = canHit && query.body.content <= BVHD_CONTENT_SWEPT_SPHERES;
#elif !defined BVHD_NOTHING_ROUND
    canHit = canHit && query.body.content <= BVHD_CONTENT_INSTANCES;
#endif
#ifdef BVHD_MOTION
    if (query.body.moves) {
        bvhdWidenForMotion(query.boxRay, extent);
        canHit = canHit && query.time >= 0.0 && query.time <= 1.0;
    }
#endif
    query.levelBottom = query.top;
    query.nodes = uvec2(0u, canHit ? 0x01000001u : 0u);
    query.records = uvec2(0u);
    return canHit;
}

void bvhdEnterRoot(inout BvhdRayQuery query)
{
    query.triangleRay.origin = query.origin;
    query.triangleRay.direction = query.direction;
    query.triangleRay.originLow = query.triangleRay.directionLow = vec3(0.0);
    query.instance = BVHD_NO_INSTANCE;
    query.instanceFlags = 0u;
    bvhdEnter(query, query.root);
}

// sum - (row . x), where sum is a pair and x has floats.
float bvhdResidual(vec2 sum, vec3 row, vec3 x)
{
    sum = bvhdAdd(sum, -bvhdProduct(row.x, x.x));
    sum = bvhdAdd(sum, -bvhdProduct(row.y, x.y));
    return bvhdAdd(sum, -bvhdProduct(row.z, x.z)).x;
}

/*
 * Transforms the ray to an instance's object space, as pairs. The stored inverse is rounded to float, which is not
 * accurate enough at shared edges: its result is corrected by the residual with the instance's own matrix. Where there
 * is no inverse, it is 0, and so is the direction, so that nothing is hit.
 */
void bvhdToObject(inout BvhdTriangleRay ray, BvhdBody top, uint record)
{
    vec4 m0, m1, m2, i0, i1, i2;
#ifdef BVHD_MOTION
    bvhdMatrices(top, record, m0, m1, m2, i0, i1, i2);
#else
    bvhdMatrix(top, record, 0u, m0, m1, m2);
    bvhdMatrix(top, record, 3u, i0, i1, i2);
#endif
    mat3 inverse = mat3(i0.xyz, i1.xyz, i2.xyz); // its columns are the rows
    vec2 x = bvhdSum(ray.origin.x, -m0.w), y = bvhdSum(ray.origin.y, -m1.w), z = bvhdSum(ray.origin.z, -m2.w);
    vec3 guess = vec3(x.x, y.x, z.x) * inverse;
    vec3 rest =
        vec3(bvhdResidual(x, m0.xyz, guess), bvhdResidual(y, m1.xyz, guess), bvhdResidual(z, m2.xyz, guess)) * inverse;
    vec3 towards = ray.direction * inverse;
    vec3 restTowards = vec3(bvhdResidual(vec2(ray.direction.x, 0.0), m0.xyz, towards),
                            bvhdResidual(vec2(ray.direction.y, 0.0), m1.xyz, towards),
                            bvhdResidual(vec2(ray.direction.z, 0.0), m2.xyz, towards)) *
                       inverse;
    vec2 sums[6] =
        vec2[](bvhdSum(guess.x, rest.x), bvhdSum(guess.y, rest.y), bvhdSum(guess.z, rest.z),
               bvhdSum(towards.x, restTowards.x), bvhdSum(towards.y, restTowards.y), bvhdSum(towards.z, restTowards.z));
    ray.origin = vec3(sums[0].x, sums[1].x, sums[2].x);
    ray.originLow = vec3(sums[0].y, sums[1].y, sums[2].y);
    ray.direction = vec3(sums[3].x, sums[4].x, sums[5].x);
    ray.directionLow = vec3(sums[3].y, sums[4].y, sums[5].y);
}

// Returns to the top level, with the groups that were saved there.
void bvhdLeaveInstance(inout BvhdRayQuery query)
{
    query.top = query.levelBottom;
    uvec2 records = bvhdPop(query), nodes = bvhdPop(query);
    int top = query.top;
    query.top = query.bottom;
    bvhdEnterRoot(query);
    query.top = top;
    query.nodes = nodes;
    query.records = records;
}

void bvhdVisitInstance(inout BvhdRayQuery query, uint record)
{
    BvhdInstance instance = bvhdInstance(query.body, record);
    if ((instance.mask & query.cullMask) == 0u || instance.bottom == BVHD_NO_LOCATION)
        return;
    bvhdPush(query, query.nodes);
    bvhdPush(query, query.records);
    bvhdToObject(query.triangleRay, query.body, record);
    query.instance = record;
    query.instanceFlags = instance.flags;
    bool canHit = bvhdEnter(query, instance.bottom);
    uint content = query.body.content;
    uint skipped = content == BVHD_CONTENT_AABBS ? BVHD_RAY_FLAGS_SKIP_AABBS : BVHD_RAY_FLAGS_SKIP_TRIANGLES;
    if (!canHit || (query.flags & skipped) != 0u || content == BVHD_CONTENT_INSTANCES)
        bvhdLeaveInstance(query);
}

// Opacity is decided by the ray's flags, then the instance's, then the geometry's.
bool bvhdIsOpaque(BvhdRayQuery query, uint id)
{
    if ((query.flags & (BVHD_RAY_FLAGS_OPAQUE | BVHD_RAY_FLAGS_NO_OPAQUE)) != 0u)
        return (query.flags & BVHD_RAY_FLAGS_OPAQUE) != 0u;
    if ((query.instanceFlags & (BVHD_INSTANCE_FORCE_OPAQUE | BVHD_INSTANCE_FORCE_NO_OPAQUE)) != 0u)
        return (query.instanceFlags & BVHD_INSTANCE_FORCE_OPAQUE) != 0u;
    return (id & BVHD_ID_OPAQUE) != 0u;
}

// The facing of spheres and linear swept spheres has no effect.
bool bvhdIsFacingCulled(BvhdRayQuery query, bool isFront)
{
#ifdef BVHD_ROUND
    if (bvhdIsRound(query.body))
        return false;
#endif
    bool isFlipped = (query.instanceFlags & BVHD_INSTANCE_FLIP_FACING) != 0u;
    uint culls = isFront != isFlipped ? BVHD_RAY_FLAGS_CULL_FRONT_FACING : BVHD_RAY_FLAGS_CULL_BACK_FACING;
    return (query.instanceFlags & BVHD_INSTANCE_CULL_DISABLE) == 0u && (query.flags & culls) != 0u;
}

// The order of intersections with equal t: (instance, flat primitive index).
uvec2 bvhdRank(BvhdRayQuery query, BvhdIntersection intersection)
{
    if (intersection.instance == BVHD_NO_INSTANCE)
        return uvec2(0u, bvhdId(query.body, intersection.record) & BVHD_ID_MASK);
    BvhdExtent unused;
    BvhdBody top = bvhdBodyOpen(query.root, unused);
    BvhdInstance instance = bvhdInstance(top, intersection.instance);
    return uvec2(instance.index, bvhdId(bvhdBodyOpen(instance.bottom, unused), intersection.record) & BVHD_ID_MASK);
}

// Whether the candidate, which is in the ray's interval, is closer than the committed intersection.
bool bvhdIsBetter(BvhdRayQuery query)
{
    vec2 t = query.candidate.t, best = query.committed.t;
    if (query.committed.type == BVHD_COMMITTED_NONE || t != best)
        return t.x < best.x || t.x == best.x && t.y <= best.y;
    uvec2 rank = bvhdRank(query, query.candidate), other = bvhdRank(query, query.committed);
    return rank.x < other.x || rank.x == other.x && rank.y < other.y;
}

void bvhdCommit(inout BvhdRayQuery query)
{
    query.committed = query.candidate;
    query.isGuess = false;
    query.far = query.committed.t.x;
    query.near = query.far - 2.0e-7 * abs(query.far);
    query.isDone = query.isDone || (query.flags & BVHD_RAY_FLAGS_TERMINATE_ON_FIRST_HIT) != 0u;
}

// Whether a distance, which has not been rounded yet, is in the open interval.
bool bvhdIsWithin(vec2 t, float tmin, float tmax)
{
    return (t.x > tmin || t.x == tmin && t.y > 0.0) && (t.x < tmax || t.x == tmax && t.y < 0.0);
}

vec2 bvhdRoundDistance(vec2 t)
{
    uint exponent = max(floatBitsToUint(t.x) & 0x7f800000u, 0x20000000u);
    float shift = 1.5 * uintBitsToFloat(exponent - (8u << 23)); // its last bit is the last one that t keeps
    precise float shifted = t.y + shift;
    precise float low = shifted - shift;
    return vec2(t.x, low);
}

bool bvhdIsCulled(BvhdRayQuery query, bool isOpaque)
{
    return (query.flags & (isOpaque ? BVHD_RAY_FLAGS_CULL_OPAQUE : BVHD_RAY_FLAGS_CULL_NO_OPAQUE)) != 0u;
}

// Returns true when the candidate has to be decided exactly; only its record, instance and type are known then.
bool bvhdVisitTriangle(inout BvhdRayQuery query, uint record)
{
    vec3 v0, v1, v2;
    BvhdTriangleGuess guess;
    uint id = bvhdCorners(query.body, record, v0, v1, v2);
    bool isOpaque = bvhdIsOpaque(query, id);
    if (bvhdIsCulled(query, isOpaque) ||
        !bvhdTriangleMayHit(query.triangleRay, query.tmin, query.far, v0, v1, v2, guess))
        return false;
    BvhdIntersection found =
        BvhdIntersection(vec2(guess.t, 0.0), vec2(0.0), record, query.instance, BVHD_COMMITTED_TRIANGLE, guess.isFront);
    if (!guess.isSure || !isOpaque || !(guess.t - guess.error > query.tmin) || !(guess.t + guess.error < query.near)) {
        query.candidate = found;
        return true;
    }
    if (bvhdIsFacingCulled(query, guess.isFront))
        return false;
    query.committed = found;
    query.isGuess = true;
    query.near = guess.t - guess.error;
    query.far = guess.t + guess.error;
    query.isDone = (query.flags & BVHD_RAY_FLAGS_TERMINATE_ON_FIRST_HIT) != 0u;
    return false;
}

// Returns true when there is a candidate.
bool bvhdVisitAabb(inout BvhdRayQuery query, uint record)
{
    vec3 lowest, highest;
    float entry;
    uint id = bvhdAabb(query.body, record, lowest, highest);
    if (bvhdIsCulled(query, bvhdIsOpaque(query, id)) || !bvhdBoxMet(query.boxRay, lowest, highest, query.far, entry))
        return false;
    query.candidate =
        BvhdIntersection(vec2(entry, 0.0), vec2(0.0), record, query.instance, BVHD_COMMITTED_GENERATED, false);
    return true;
}

#ifdef BVHD_ROUND
// Returns true when the candidate has to be decided exactly; only its record, instance and type are known then.
bool bvhdVisitRound(inout BvhdRayQuery query, uint record)
{
    vec4 ends[2];
    uint id = bvhdEnds(query.body, record, ends);
    uint type = query.body.content == BVHD_CONTENT_SPHERES ? BVHD_COMMITTED_SPHERE : BVHD_COMMITTED_SWEPT_SPHERE;
    query.candidate = BvhdIntersection(vec2(0.0), vec2(0.0), record, query.instance, type, true);
    return !bvhdIsCulled(query, bvhdIsOpaque(query, id)) &&
           bvhdRoundMayHit(query.triangleRay, query.tmin, query.far, ends);
}
#endif

// Returns true when there is a candidate that has to be decided.
bool bvhdVisitRecord(inout BvhdRayQuery query)
{
    uint record = query.records.x + uint(findLSB(query.records.y));
    query.records.y &= query.records.y - 1u;
    if (query.body.content == BVHD_CONTENT_AABBS)
        return bvhdVisitAabb(query, record);
#ifdef BVHD_ROUND
    if (bvhdIsRound(query.body))
        return bvhdVisitRound(query, record);
#endif
    if (query.body.content != BVHD_CONTENT_INSTANCES)
        return bvhdVisitTriangle(query, record);
    bvhdVisitInstance(query, record);
    return false;
}

// Visits the nearest child of the group, which is not empty.
void bvhdVisitNode(inout BvhdRayQuery query)
{
    uint slot = bvhdFirstSlot(query.nodes.y, query.boxRay.order);
    query.nodes.y &= ~(0x01000000u << slot);
    uint child = query.nodes.x + uint(bitCount(query.nodes.y & ((1u << slot) - 1u)));
    if (query.nodes.y >= 0x01000000u)
        bvhdPush(query, query.nodes);

    uint row = query.body.nodes + BVHD_NODE_ROWS(query.body) * child;
    uvec4 head = bvhdRow(query.body.base, row), meta = bvhdRow(query.body.base, row + 1u);
#ifdef BVHD_MOTION
    uint hits = bvhdAnyNodeHits(query.boxRay, query.far, query.body, row, head, meta);
#else
    uint hits = bvhdNodeHits(query.boxRay, query.far, head, meta, bvhdRow(query.body.base, row + 2u),
                             bvhdRow(query.body.base, row + 3u), bvhdRow(query.body.base, row + 4u));
#endif
    query.nodes = uvec2(meta.x, hits & 0xff000000u | head.w >> 24);
    query.records = uvec2(meta.y, hits & 0x00ffffffu);
}

/* ---- Deciding exactly ---- */

BvhdBody bvhdTopOf(BvhdRayQuery query)
{
    BvhdExtent unused;
    return BVHD_BODY_SEEN(query, query.root, unused);
}

// The instance of an intersection. There must be a top level.
BvhdInstance bvhdInstanceOf(BvhdRayQuery query, BvhdIntersection intersection)
{
    return bvhdInstance(bvhdTopOf(query), intersection.instance);
}

BvhdBody bvhdBodyOf(BvhdRayQuery query, BvhdIntersection intersection)
{
    BvhdExtent unused;
    uvec2 location = query.root;
    if (intersection.instance != BVHD_NO_INSTANCE)
        location = bvhdInstanceOf(query, intersection).bottom;
    return BVHD_BODY_SEEN(query, location, unused);
}

// The ray in the object space of an intersection.
BvhdTriangleRay bvhdRayOf(BvhdRayQuery query, BvhdIntersection intersection)
{
    BvhdTriangleRay ray = BvhdTriangleRay(query.origin, query.direction, vec3(0.0), vec3(0.0), false);
    if (intersection.instance != BVHD_NO_INSTANCE)
        bvhdToObject(ray, bvhdTopOf(query), intersection.instance);
    return ray;
}

#ifdef BVHD_ROUND
// bvhdPlace for a sphere or a linear swept sphere of the current structure.
bool bvhdPlaceRound(BvhdRayQuery query, inout BvhdIntersection intersection)
{
    vec4 ends[2];
    BvhdRoundHit hit;
    uint id = bvhdEnds(query.body, intersection.record, ends);
    bvec2 hasCaps = bvec2((id & BVHD_ID_CAP_FIRST) != 0u, (id & BVHD_ID_CAP_SECOND) != 0u);
    bool isSwept = intersection.type == BVHD_COMMITTED_SWEPT_SPHERE;
    if (!bvhdRoundHit(query.triangleRay, ends, isSwept, hasCaps, hit))
        return false;
    intersection.t = hit.t;
    intersection.barycentrics = vec2(hit.u, 0.0);
    return true;
}
#endif

// Computes where a triangle, given by record and instance, is hit. Returns whether it is hit, at any t.
bool bvhdPlace(BvhdRayQuery query, inout BvhdIntersection intersection)
{
#ifdef BVHD_ROUND
    if (intersection.type != BVHD_COMMITTED_TRIANGLE)
        return bvhdPlaceRound(query, intersection);
#endif
    vec3 v0, v1, v2;
    uint flags = 0u;
    BvhdTriangleHit hit;
    bvhdCorners(bvhdBodyOf(query, intersection), intersection.record, v0, v1, v2);
    if (!bvhdTriangleHit(bvhdRayOf(query, intersection), v0, v1, v2, hit))
        return false;
    if (intersection.instance != BVHD_NO_INSTANCE)
        flags = bvhdInstanceOf(query, intersection).flags;
    intersection.t = hit.t;
    intersection.barycentrics = hit.barycentrics;
    intersection.isFront = hit.isFront != ((flags & BVHD_INSTANCE_FLIP_FACING) != 0u);
    return true;
}

// Replaces a guess by the exact intersection.
void bvhdPlaceCommitted(inout BvhdRayQuery query)
{
    if (!query.isGuess)
        return;
    bvhdPlace(query, query.committed);
    query.committed.t = bvhdRoundDistance(query.committed.t);
    query.isGuess = false;
    query.far = query.committed.t.x;
    query.near = query.far - 2.0e-7 * abs(query.far);
}

// Commits the candidate or drops it; returns true when the caller has to decide.
bool bvhdDecide(inout BvhdRayQuery query)
{
#ifdef BVHD_ROUND
    bool isBuiltIn = query.candidate.type != BVHD_COMMITTED_GENERATED;
#else
    bool isBuiltIn = query.candidate.type == BVHD_COMMITTED_TRIANGLE;
#endif
    bvhdPlaceCommitted(query);
    if (isBuiltIn) {
        if (!bvhdPlace(query, query.candidate) || !bvhdIsWithin(query.candidate.t, query.tmin, query.tmax))
            return false;
        bool isFlipped = (query.instanceFlags & BVHD_INSTANCE_FLIP_FACING) != 0u;
        if (bvhdIsFacingCulled(query, query.candidate.isFront != isFlipped))
            return false;
        query.candidate.t = bvhdRoundDistance(query.candidate.t);
    }
    if (!bvhdIsBetter(query))
        return false;
    if (!isBuiltIn || !bvhdIsOpaque(query, bvhdId(query.body, query.candidate.record)))
        return true;
    bvhdCommit(query);
    return false;
}

/* ---- The life of a query ---- */

#ifdef BVHD_MOTION
void bvhdRayQueryInitializeMotionAt(out BvhdRayQuery query, int number, uvec2 root, uint flags, uint cullMask,
                                    vec3 origin, float tmin, vec3 direction, float tmax, float time)
#else
void bvhdRayQueryInitializeAt(out BvhdRayQuery query, int number, uvec2 root, uint flags, uint cullMask, vec3 origin,
                              float tmin, vec3 direction, float tmax)
#endif
{
#ifdef BVHD_MOTION
    query.time = time;
#endif
    query.origin = origin;
    query.direction = direction;
    query.tmin = tmin;
    query.tmax = tmax;
    query.flags = flags;
    query.cullMask = cullMask;
    query.root = root;
    query.committed = BvhdIntersection(vec2(tmax, 0.0), vec2(0.0), 0u, BVHD_NO_INSTANCE, BVHD_COMMITTED_NONE, false);
    query.candidate = query.committed;
    query.isGuess = false;
    query.near = query.far = tmax;
    query.bottom = query.top = number * BVHD_STACK_SIZE;
    bvhdEnterRoot(query);
    uint content = query.body.content;
    bool isSkipped = content == BVHD_CONTENT_AABBS     ? (flags & BVHD_RAY_FLAGS_SKIP_AABBS) != 0u :
                     content != BVHD_CONTENT_INSTANCES ? (flags & BVHD_RAY_FLAGS_SKIP_TRIANGLES) != 0u :
                                                         false;
    query.isDone = !(tmin <= tmax) || isSkipped;
}

#ifdef BVHD_MOTION
void bvhdRayQueryInitializeAt(out BvhdRayQuery query, int number, uvec2 root, uint flags, uint cullMask, vec3 origin,
                              float tmin, vec3 direction, float tmax)
{
    bvhdRayQueryInitializeMotionAt(query, number, root, flags, cullMask, origin, tmin, direction, tmax, 0.0);
}

void bvhdRayQueryInitializeMotion(out BvhdRayQuery query, uvec2 root, uint flags, uint cullMask, vec3 origin,
                                  float tmin, vec3 direction, float tmax, float time)
{
    bvhdRayQueryInitializeMotionAt(query, 0, root, flags, cullMask, origin, tmin, direction, tmax, time);
}
#endif

void bvhdRayQueryInitialize(out BvhdRayQuery query, uvec2 root, uint flags, uint cullMask, vec3 origin, float tmin,
                            vec3 direction, float tmax)
{
    bvhdRayQueryInitializeAt(query, 0, root, flags, cullMask, origin, tmin, direction, tmax);
}

// Continues to the next candidate. Returns false when there is none left: the committed intersection is the answer.
bool bvhdRayQueryProceed(inout BvhdRayQuery query)
{
    while (!query.isDone) {
        if (query.records.y != 0u) {
            if (bvhdVisitRecord(query) && bvhdDecide(query))
                return true;
        } else if (query.nodes.y >= 0x01000000u) {
            bvhdVisitNode(query);
        } else if (query.top != query.levelBottom) {
            query.nodes = bvhdPop(query);
        } else if (query.instance != BVHD_NO_INSTANCE) {
            bvhdLeaveInstance(query);
        } else {
            query.isDone = true;
        }
    }
    bvhdPlaceCommitted(query);
    return false;
}

// Commits a triangle candidate. A closer one may still replace it.
void bvhdRayQueryConfirmIntersection(inout BvhdRayQuery query)
{
    bvhdCommit(query);
}

// Commits an AABB candidate that is hit at t. A t below tmin or beyond the committed one has no effect.
void bvhdRayQueryGenerateIntersection(inout BvhdRayQuery query, float t)
{
    query.candidate.t = vec2(t, 0.0);
    if (t >= query.tmin && bvhdIsBetter(query))
        bvhdCommit(query);
}

void bvhdRayQueryTerminate(inout BvhdRayQuery query)
{
    query.isDone = true;
}

#include "bvhd_ray_query_get.glsl"

#endif
