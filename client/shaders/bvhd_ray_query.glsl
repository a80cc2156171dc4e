// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_ray_query.glsl - ray queries over portable structures, for any shader of any device: the life cycle of
 * GL_EXT_ray_query with names of its own.
 *
 *     #version 450
 *     #extension GL_GOOGLE_include_directive : require
 *     ... where structures are: see bvhd_structure.glsl
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
 * Vulkan's semantics: opaque triangles are committed by themselves, others and AABBs are candidates; triangles are hit
 * for tmin < t < tmax, AABBs may be for tmin <= t <= tmax; facing is that of object space. A candidate could be the
 * answer when it is offered. With split references one may be offered more than once, unless its geometry says
 * NO_DUPLICATE_ANY_HIT. Of equal t, the lowest (instance, geometry, primitive) wins. The same answers as on the CPU
 * (traverse.h) but for rays that a last bit decides.
 *
 * Coordinates and directions lie within 2^-60 .. 2^60 (or are 0) and tmin is not negative; otherwise hits may be
 * missed. A direction of zero, and an origin or direction that is not finite, hit nothing.
 *
 * The stack is a private array of the invocation. When a query begins while another one is under way, BVHD_QUERIES is
 * defined as how many there may be, and each begins with bvhdRayQueryInitializeAt and a number of its own below that.
 */
#ifndef BVHD_RAY_QUERY_GLSL
#define BVHD_RAY_QUERY_GLSL

#include "bvhd_structure.glsl"
#include "bvhd_box.glsl"
#include "bvhd_triangle.glsl"

#ifndef BVHD_QUERIES
#define BVHD_QUERIES 1
#endif

// As gl_RayFlags...EXT.
const uint BVHD_RAY_FLAGS_NONE = 0x0u;
const uint BVHD_RAY_FLAGS_OPAQUE = 0x1u;
const uint BVHD_RAY_FLAGS_NO_OPAQUE = 0x2u;
const uint BVHD_RAY_FLAGS_TERMINATE_ON_FIRST_HIT = 0x4u;
const uint BVHD_RAY_FLAGS_CULL_BACK_FACING = 0x10u;
const uint BVHD_RAY_FLAGS_CULL_FRONT_FACING = 0x20u;
const uint BVHD_RAY_FLAGS_CULL_OPAQUE = 0x40u;
const uint BVHD_RAY_FLAGS_CULL_NO_OPAQUE = 0x80u;
const uint BVHD_RAY_FLAGS_SKIP_TRIANGLES = 0x100u;
const uint BVHD_RAY_FLAGS_SKIP_AABBS = 0x200u;

const uint BVHD_CANDIDATE_TRIANGLE = 0u;
const uint BVHD_CANDIDATE_AABB = 1u;
const uint BVHD_COMMITTED_NONE = 0u;
const uint BVHD_COMMITTED_TRIANGLE = 1u;
const uint BVHD_COMMITTED_GENERATED = 2u;

const uint BVHD_NO_INSTANCE = 0xffffffffu; // without a top level

// VkGeometryInstanceFlagsKHR.
const uint BVHD_INSTANCE_CULL_DISABLE = 0x1u;
const uint BVHD_INSTANCE_FLIP_FACING = 0x2u;
const uint BVHD_INSTANCE_FORCE_OPAQUE = 0x4u;
const uint BVHD_INSTANCE_FORCE_NO_OPAQUE = 0x8u;

// At most one group for each of 32 levels of nodes in each structure, and the rest of a leaf of the top level.
const int BVHD_STACK_SIZE = 66;
uvec2 bvhdStack[BVHD_QUERIES * BVHD_STACK_SIZE];

// Something that was hit, or may be.
struct BvhdIntersection {
    vec2 t; // a pair to 32 significant bits: what is equal there counts as equal
    vec2 barycentrics;
    uint record; // in its bottom level
    uint instance; // record in the top level, BVHD_NO_INSTANCE without one
    uint type; // BVHD_COMMITTED_
    bool isFront;
};

struct BvhdRayQuery {
    vec3 origin, direction;
    float tmin, tmax;
    uint flags, cullMask;
    uvec2 root;
    BvhdIntersection committed, candidate;
    /*
     * The committed distance lies in near .. far. While traversal goes on it may be a guess, with nothing but record,
     * instance and type known; guesses that overlap are decided exactly, and so is the last one when traversal ends.
     */
    bool isGuess;
    float near, far;

    // The state of the traversal: the structure, the ray in its space, and the groups that are left there.
    BvhdBody body;
    BvhdBoxRay boxRay;
    BvhdTriangleRay triangleRay;
    uint instance; // record in the top level; BVHD_NO_INSTANCE: in the root
    uint instanceFlags;
    uvec2 nodes; // first child; hits in bits 31 .. 24, inner mask in bits 7 .. 0
    uvec2 records; // first record; hits
    int bottom, top, levelBottom; // of the stack
    bool isDone;
};

/* ---- Inside ---- */

void bvhdPush(inout BvhdRayQuery query, uvec2 group)
{
    bvhdStack[query.top++] = group;
}

uvec2 bvhdPop(inout BvhdRayQuery query)
{
    return bvhdStack[--query.top];
}

// Goes to a structure's root node; query.triangleRay is in its space. False when nothing is hit there.
bool bvhdEnter(inout BvhdRayQuery query, uvec2 location)
{
    BvhdExtent extent;
    query.body = bvhdBodyOpen(location, extent);
    BvhdTriangleRay ray = query.triangleRay;
    bool canHit = bvhdBoxRayInit(ray.origin, ray.originLow, ray.direction, query.tmin, extent, query.boxRay);
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

// sum - (row . x), as a pair, where x is one of floats.
float bvhdResidual(vec2 sum, vec3 row, vec3 x)
{
    sum = bvhdAdd(sum, -bvhdProduct(row.x, x.x));
    sum = bvhdAdd(sum, -bvhdProduct(row.y, x.y));
    return bvhdAdd(sum, -bvhdProduct(row.z, x.z)).x;
}

/*
 * The ray in an instance's object space, as pairs. The stored inverse, rounded to float, is not enough for rays to meet
 * at shared edges what the exact ray meets: its answer is corrected by what the instance's own matrix makes of it.
 */
void bvhdToObject(inout BvhdTriangleRay ray, BvhdBody top, uint record)
{
    vec4 m0, m1, m2, i0, i1, i2;
    bvhdMatrix(top, record, 0u, m0, m1, m2);
    bvhdMatrix(top, record, 3u, i0, i1, i2);
    mat3 inverse = mat3(i0.xyz, i1.xyz, i2.xyz); // its columns are the rows
    vec2 x = bvhdSum(ray.origin.x, -m0.w), y = bvhdSum(ray.origin.y, -m1.w), z = bvhdSum(ray.origin.z, -m2.w);
    vec3 guess = vec3(x.x, y.x, z.x) * inverse;
    vec3 rest = vec3(bvhdResidual(x, m0.xyz, guess), bvhdResidual(y, m1.xyz, guess), bvhdResidual(z, m2.xyz, guess)) * inverse;
    vec3 towards = ray.direction * inverse;
    vec3 restTowards = vec3(bvhdResidual(vec2(ray.direction.x, 0.0), m0.xyz, towards), bvhdResidual(vec2(ray.direction.y, 0.0), m1.xyz, towards),
                            bvhdResidual(vec2(ray.direction.z, 0.0), m2.xyz, towards)) *
                       inverse;
    vec2 sums[6] = vec2[](bvhdSum(guess.x, rest.x), bvhdSum(guess.y, rest.y), bvhdSum(guess.z, rest.z), bvhdSum(towards.x, restTowards.x),
                          bvhdSum(towards.y, restTowards.y), bvhdSum(towards.z, restTowards.z));
    ray.origin = vec3(sums[0].x, sums[1].x, sums[2].x);
    ray.originLow = vec3(sums[0].y, sums[1].y, sums[2].y);
    ray.direction = vec3(sums[3].x, sums[4].x, sums[5].x);
    ray.directionLow = vec3(sums[3].y, sums[4].y, sums[5].y);
}

// Returns to the top level, and takes its nodes and records that are left off the stack.
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

// Opacity: the ray's flags come before the instance's, those before the geometry's.
bool bvhdIsOpaque(BvhdRayQuery query, uint id)
{
    if ((query.flags & (BVHD_RAY_FLAGS_OPAQUE | BVHD_RAY_FLAGS_NO_OPAQUE)) != 0u)
        return (query.flags & BVHD_RAY_FLAGS_OPAQUE) != 0u;
    if ((query.instanceFlags & (BVHD_INSTANCE_FORCE_OPAQUE | BVHD_INSTANCE_FORCE_NO_OPAQUE)) != 0u)
        return (query.instanceFlags & BVHD_INSTANCE_FORCE_OPAQUE) != 0u;
    return (id & BVHD_ID_OPAQUE) != 0u;
}

bool bvhdIsFacingCulled(BvhdRayQuery query, bool isFront)
{
    bool isFlipped = (query.instanceFlags & BVHD_INSTANCE_FLIP_FACING) != 0u;
    uint culls = isFront != isFlipped ? BVHD_RAY_FLAGS_CULL_FRONT_FACING : BVHD_RAY_FLAGS_CULL_BACK_FACING;
    return (query.instanceFlags & BVHD_INSTANCE_CULL_DISABLE) == 0u && (query.flags & culls) != 0u;
}

// (instance, flat primitive index) of an intersection: the order of equal t.
uvec2 bvhdRank(BvhdRayQuery query, BvhdIntersection intersection)
{
    if (intersection.instance == BVHD_NO_INSTANCE)
        return uvec2(0u, bvhdId(query.body, intersection.record) & BVHD_ID_MASK);
    BvhdExtent unused;
    BvhdBody top = bvhdBodyOpen(query.root, unused);
    BvhdInstance instance = bvhdInstance(top, intersection.instance);
    return uvec2(instance.index, bvhdId(bvhdBodyOpen(instance.bottom, unused), intersection.record) & BVHD_ID_MASK);
}

// Whether the candidate, which lies in the ray's interval, is closer than the answer so far.
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

// The open interval, for a distance that has not been rounded yet.
bool bvhdIsWithin(vec2 t, float tmin, float tmax)
{
    return (t.x > tmin || t.x == tmin && t.y > 0.0) && (t.x < tmax || t.x == tmax && t.y < 0.0);
}

vec2 bvhdRoundDistance(vec2 t)
{
    uint exponent = max(floatBitsToUint(t.x) & 0x7f800000u, 0x20000000u);
    float shift = 1.5 * uintBitsToFloat(exponent - (8u << 23)); // its last bit is the last one that is kept
    precise float shifted = t.y + shift;
    precise float low = shifted - shift;
    return vec2(t.x, low);
}

bool bvhdIsCulled(BvhdRayQuery query, bool isOpaque)
{
    return (query.flags & (isOpaque ? BVHD_RAY_FLAGS_CULL_OPAQUE : BVHD_RAY_FLAGS_CULL_NO_OPAQUE)) != 0u;
}

// True: the candidate has to be decided. It has no more than a record, an instance and a type then.
bool bvhdVisitTriangle(inout BvhdRayQuery query, uint record)
{
    vec3 v0, v1, v2;
    BvhdTriangleGuess guess;
    uint id = bvhdCorners(query.body, record, v0, v1, v2);
    bool isOpaque = bvhdIsOpaque(query, id);
    if (bvhdIsCulled(query, isOpaque) || !bvhdTriangleMayHit(query.triangleRay, query.tmin, query.far, v0, v1, v2, guess))
        return false;
    BvhdIntersection found = BvhdIntersection(vec2(guess.t, 0.0), vec2(0.0), record, query.instance, BVHD_COMMITTED_TRIANGLE, guess.isFront);
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

// True: there is a candidate.
bool bvhdVisitAabb(inout BvhdRayQuery query, uint record)
{
    vec3 lowest, highest;
    float entry;
    uint id = bvhdAabb(query.body, record, lowest, highest);
    if (bvhdIsCulled(query, bvhdIsOpaque(query, id)) || !bvhdBoxMet(query.boxRay, lowest, highest, query.far, entry))
        return false;
    query.candidate = BvhdIntersection(vec2(entry, 0.0), vec2(0.0), record, query.instance, BVHD_COMMITTED_GENERATED, false);
    return true;
}

// True: there is a candidate, to be decided.
bool bvhdVisitRecord(inout BvhdRayQuery query)
{
    uint record = query.records.x + uint(findLSB(query.records.y));
    query.records.y &= query.records.y - 1u;
    if (query.body.content == BVHD_CONTENT_AABBS)
        return bvhdVisitAabb(query, record);
    if (query.body.content != BVHD_CONTENT_INSTANCES)
        return bvhdVisitTriangle(query, record);
    bvhdVisitInstance(query, record);
    return false;
}

// Goes to the next child of the group, which has one.
void bvhdVisitNode(inout BvhdRayQuery query)
{
    uint slot = bvhdFirstSlot(query.nodes.y, query.boxRay.order);
    query.nodes.y &= ~(0x01000000u << slot);
    uint child = query.nodes.x + uint(bitCount(query.nodes.y & ((1u << slot) - 1u)));
    if (query.nodes.y >= 0x01000000u)
        bvhdPush(query, query.nodes);

    uint row = query.body.nodes + 5u * child;
    uvec4 head = bvhdRow(query.body.base, row), meta = bvhdRow(query.body.base, row + 1u);
    uint hits = bvhdNodeHits(query.boxRay, query.far, head, meta, bvhdRow(query.body.base, row + 2u),
                             bvhdRow(query.body.base, row + 3u), bvhdRow(query.body.base, row + 4u));
    query.nodes = uvec2(meta.x, hits & 0xff000000u | head.w >> 24);
    query.records = uvec2(meta.y, hits & 0x00ffffffu);
}

/* ---- Deciding exactly ---- */

BvhdBody bvhdTopOf(BvhdRayQuery query)
{
    BvhdExtent unused;
    return bvhdBodyOpen(query.root, unused);
}

// The instance that an intersection is in. Not without a top level.
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
    return bvhdBodyOpen(location, unused);
}

// The ray in the space of an intersection.
BvhdTriangleRay bvhdRayOf(BvhdRayQuery query, BvhdIntersection intersection)
{
    BvhdTriangleRay ray = BvhdTriangleRay(query.origin, query.direction, vec3(0.0), vec3(0.0));
    if (intersection.instance != BVHD_NO_INSTANCE)
        bvhdToObject(ray, bvhdTopOf(query), intersection.instance);
    return ray;
}

// Fills in where a triangle is hit, by record and instance. Returns whether it is, at any t.
bool bvhdPlace(BvhdRayQuery query, inout BvhdIntersection intersection)
{
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

// The end of a guess.
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

// Commits the candidate, or not. True: that is for the caller to decide.
bool bvhdDecide(inout BvhdRayQuery query)
{
    bool isTriangle = query.candidate.type == BVHD_COMMITTED_TRIANGLE;
    bvhdPlaceCommitted(query);
    if (isTriangle) {
        if (!bvhdPlace(query, query.candidate) || !bvhdIsWithin(query.candidate.t, query.tmin, query.tmax))
            return false;
        bool isFlipped = (query.instanceFlags & BVHD_INSTANCE_FLIP_FACING) != 0u;
        if (bvhdIsFacingCulled(query, query.candidate.isFront != isFlipped))
            return false;
        query.candidate.t = bvhdRoundDistance(query.candidate.t);
    }
    if (!bvhdIsBetter(query))
        return false;
    if (!isTriangle || !bvhdIsOpaque(query, bvhdId(query.body, query.candidate.record)))
        return true;
    bvhdCommit(query);
    return false;
}

/* ---- The life of a query ---- */

void bvhdRayQueryInitializeAt(out BvhdRayQuery query, int number, uvec2 root, uint flags, uint cullMask, vec3 origin, float tmin,
                              vec3 direction, float tmax)
{
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

void bvhdRayQueryInitialize(out BvhdRayQuery query, uvec2 root, uint flags, uint cullMask, vec3 origin, float tmin, vec3 direction,
                            float tmax)
{
    bvhdRayQueryInitializeAt(query, 0, root, flags, cullMask, origin, tmin, direction, tmax);
}

// Goes on to the next candidate; false when there is none left and the committed intersection is the answer.
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

// Takes a triangle candidate for the answer, unless a closer one comes.
void bvhdRayQueryConfirmIntersection(inout BvhdRayQuery query)
{
    bvhdCommit(query);
}

// Takes an AABB candidate, hit at t. Outside of tmin and the closest answer so far it has no effect.
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
