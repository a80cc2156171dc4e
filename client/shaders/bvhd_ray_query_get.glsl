// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_ray_query_get.glsl - the functions of bvhd_ray_query.glsl (which includes it) that return what was hit. They
 * correspond to rayQueryGet...EXT: with `committed` false they return the candidate, from Proceed until the next one.
 */
#ifndef BVHD_RAY_QUERY_GET_GLSL
#define BVHD_RAY_QUERY_GET_GLSL

BvhdIntersection bvhdIntersection(BvhdRayQuery query, bool committed)
{
    if (committed)
        return query.committed;
    return query.candidate;
}

// (geometry, primitive)
uvec2 bvhdPrimitiveOf(BvhdRayQuery query, bool committed)
{
    BvhdIntersection intersection = bvhdIntersection(query, committed);
    BvhdBody body = bvhdBodyOf(query, intersection);
    return bvhdGeometryOf(body, bvhdId(body, intersection.record) & BVHD_ID_MASK);
}

// BVHD_CANDIDATE_ or BVHD_COMMITTED_.
uint bvhdRayQueryGetIntersectionType(BvhdRayQuery query, bool committed)
{
    if (committed)
        return query.committed.type;
#ifdef BVHD_ROUND
    if (query.candidate.type > BVHD_COMMITTED_GENERATED)
        return query.candidate.type - BVHD_COMMITTED_SPHERE + BVHD_CANDIDATE_SPHERE;
#endif
    return query.candidate.type == BVHD_COMMITTED_TRIANGLE ? BVHD_CANDIDATE_TRIANGLE : BVHD_CANDIDATE_AABB;
}

// tmax without a committed intersection. Of an AABB candidate: the t where the ray enters it, within the interval.
float bvhdRayQueryGetIntersectionT(BvhdRayQuery query, bool committed)
{
    return bvhdIntersection(query, committed).t.x;
}

// position = (1 - x - y) v0 + x v1 + y v2
vec2 bvhdRayQueryGetIntersectionBarycentrics(BvhdRayQuery query, bool committed)
{
    return bvhdIntersection(query, committed).barycentrics;
}

bool bvhdRayQueryGetIntersectionFrontFace(BvhdRayQuery query, bool committed)
{
    return bvhdIntersection(query, committed).isFront;
}

uint bvhdRayQueryGetIntersectionGeometryIndex(BvhdRayQuery query, bool committed)
{
    return bvhdPrimitiveOf(query, committed).x;
}

uint bvhdRayQueryGetIntersectionPrimitiveIndex(BvhdRayQuery query, bool committed)
{
    return bvhdPrimitiveOf(query, committed).y;
}

// The exact corners of a triangle, in object space; of a motion triangle, those at the ray's time.
void bvhdRayQueryGetIntersectionTriangleVertexPositions(BvhdRayQuery query, bool committed, out vec3 positions[3])
{
    BvhdIntersection intersection = bvhdIntersection(query, committed);
    bvhdCorners(bvhdBodyOf(query, intersection), intersection.record, positions[0], positions[1], positions[2]);
}

#ifdef BVHD_ROUND
// The ends of a linear swept sphere, in object space: a centre each, and its radius in w. Both ends of a sphere are it.
void bvhdRayQueryGetIntersectionEnds(BvhdRayQuery query, bool committed, out vec4 ends[2])
{
    BvhdIntersection intersection = bvhdIntersection(query, committed);
    bvhdEnds(bvhdBodyOf(query, intersection), intersection.record, ends);
}

vec3 bvhdRayQueryGetIntersectionSpherePosition(BvhdRayQuery query, bool committed)
{
    vec4 ends[2];
    bvhdRayQueryGetIntersectionEnds(query, committed, ends);
    return ends[0].xyz;
}

float bvhdRayQueryGetIntersectionSphereRadius(BvhdRayQuery query, bool committed)
{
    vec4 ends[2];
    bvhdRayQueryGetIntersectionEnds(query, committed, ends);
    return ends[0].w;
}

// How far the sphere that touches the point has moved: 0 at the first end, 1 at the second.
float bvhdRayQueryGetIntersectionSweptSphereHitValue(BvhdRayQuery query, bool committed)
{
    return bvhdIntersection(query, committed).barycentrics.x;
}
#endif

// Whether an AABB candidate counts as opaque.
bool bvhdRayQueryGetIntersectionCandidateAABBOpaque(BvhdRayQuery query)
{
    return bvhdIsOpaque(query, bvhdId(query.body, query.candidate.record));
}

// The position of the instance in the request; BVHD_NO_INSTANCE without a top level.
uint bvhdRayQueryGetIntersectionInstanceId(BvhdRayQuery query, bool committed)
{
    BvhdIntersection intersection = bvhdIntersection(query, committed);
    if (intersection.instance == BVHD_NO_INSTANCE)
        return BVHD_NO_INSTANCE;
    return bvhdInstanceOf(query, intersection).index;
}

// The custom index and the table offset are 0 without a top level.
uint bvhdRayQueryGetIntersectionInstanceCustomIndex(BvhdRayQuery query, bool committed)
{
    BvhdIntersection intersection = bvhdIntersection(query, committed);
    if (intersection.instance == BVHD_NO_INSTANCE)
        return 0u;
    return bvhdInstanceOf(query, intersection).customIndex;
}

uint bvhdRayQueryGetIntersectionInstanceShaderBindingTableRecordOffset(BvhdRayQuery query, bool committed)
{
    BvhdIntersection intersection = bvhdIntersection(query, committed);
    if (intersection.instance == BVHD_NO_INSTANCE)
        return 0u;
    return bvhdInstanceOf(query, intersection).sbtOffset;
}

// A matrix of four columns, as GL_EXT_ray_query has them; of a motion instance, that of the ray's time; the identity
// without a top level.
mat4x3 bvhdMatrixOf(BvhdRayQuery query, bool committed, uint first)
{
    BvhdIntersection intersection = bvhdIntersection(query, committed);
    if (intersection.instance == BVHD_NO_INSTANCE)
        return mat4x3(1.0);
    vec4 x, y, z;
#ifdef BVHD_MOTION
    vec4 m0, m1, m2;
    bvhdMatrices(bvhdTopOf(query), intersection.instance, m0, m1, m2, x, y, z);
    if (first == 0u)
        return transpose(mat3x4(m0, m1, m2));
#else
    bvhdMatrix(bvhdTopOf(query), intersection.instance, first, x, y, z);
#endif
    return transpose(mat3x4(x, y, z));
}

mat4x3 bvhdRayQueryGetIntersectionObjectToWorld(BvhdRayQuery query, bool committed)
{
    return bvhdMatrixOf(query, committed, 0u);
}

mat4x3 bvhdRayQueryGetIntersectionWorldToObject(BvhdRayQuery query, bool committed)
{
    return bvhdMatrixOf(query, committed, 3u);
}

vec3 bvhdRayQueryGetIntersectionObjectRayOrigin(BvhdRayQuery query, bool committed)
{
    return bvhdRayOf(query, bvhdIntersection(query, committed)).origin;
}

vec3 bvhdRayQueryGetIntersectionObjectRayDirection(BvhdRayQuery query, bool committed)
{
    return bvhdRayOf(query, bvhdIntersection(query, committed)).direction;
}

#ifdef BVHD_MOTION
float bvhdRayQueryGetRayTime(BvhdRayQuery query)
{
    return query.time;
}
#endif

float bvhdRayQueryGetRayTMin(BvhdRayQuery query)
{
    return query.tmin;
}

uint bvhdRayQueryGetRayFlags(BvhdRayQuery query)
{
    return query.flags;
}

vec3 bvhdRayQueryGetWorldRayOrigin(BvhdRayQuery query)
{
    return query.origin;
}

vec3 bvhdRayQueryGetWorldRayDirection(BvhdRayQuery query)
{
    return query.direction;
}

#endif
