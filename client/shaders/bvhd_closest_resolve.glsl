// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_closest_resolve.glsl - the end of bvhd_closest.glsl: resolves undecided triangles exactly, and writes hits.
 *
 * Exact tests are computed in doubles with DOUBLES, otherwise in pairs of floats. They run at the end of each ray, or
 * when a subgroup has no more rays, or in a kernel of their own (RESOLVE). The including shader defines count_lanes,
 * count_before and sync_subgroup.
 */
#ifndef BVHD_CLOSEST_RESOLVE_GLSL
#define BVHD_CLOSEST_RESOLVE_GLSL

#if defined RESOLVE || defined DOUBLES

#ifdef DOUBLES
#include "bvhd_closest_exact.glsl"
#define EXACT_RAY(origin, direction) ExactRay(dvec3(origin), dvec3(direction))
#define EXACT_ENTER exact_enter
#define EXACT_TRIANGLE_HIT exact_triangle_hit
#else
#define ExactRay BvhdTriangleRay
#define EXACT_RAY(origin, direction) BvhdTriangleRay(origin, direction, vec3(0.0), vec3(0.0), false)
#define EXACT_ENTER bvhdToObject
#define EXACT_TRIANGLE_HIT bvhdTriangleHit
#endif

bool is_below(vec2 a, vec2 b)
{
    return a.x < b.x || a.x == b.x && a.y < b.y;
}

bool exact_hit(uint of_ray, uint in_instance, uint record, out BvhdTriangleHit hit, out uint id)
{
    BvhdRay ray = rays[of_ray];
    ExactRay exact = EXACT_RAY(ray.origin.xyz, ray.direction.xyz);
    uvec2 location = extra;
    if (has_instances) {
        BvhdBody upper = open_body(extra);
        EXACT_ENTER(exact, upper, in_instance);
        location = bvhdRow(upper.base, upper.records + 8u * in_instance + 7u).xy;
    }
    vec3 v0, v1, v2;
    id = bvhdCorners(open_body(location), record, v0, v1, v2);
    return EXACT_TRIANGLE_HIT(exact, v0, v1, v2, hit) && is_below(vec2(ray.origin.w, 0.0), hit.t) &&
           is_below(hit.t, vec2(ray.direction.w, 0.0));
}

uint place_of(uint in_instance)
{
    if (!has_instances)
        return 0u;
    BvhdBody upper = open_body(extra);
    return bvhdRow(upper.base, upper.records + 8u * in_instance + 6u).z;
}

/*
 * Exact tests that lanes of a subgroup request, which any of its lanes compute: a record, its instance, the ray, and
 * the number of the requesting lane. Results: t (two words), the id, and the bits below. A subgroup's requests begin at
 * the place of its first active lane.
 */
shared uvec4 requests[gl_WorkGroupSize.x], results[gl_WorkGroupSize.x];
const uint IS_MET = 1u, IS_FRONT = 2u;

uvec4 run_request(uvec4 request)
{
    BvhdTriangleHit hit;
    uint id;
    bool is_met = exact_hit(request.z, request.y, request.x, hit, id);
    return uvec4(floatBitsToUint(bvhdRoundDistance(hit.t)), id, (is_met ? IS_MET : 0u) | (hit.isFront ? IS_FRONT : 0u));
}

// A lane's undecided triangles from entry `next` on, and the exact t of its closest hit once has_best_t is true.
struct Pending {
    uint next;
    bool has_best_t;
    vec2 best_t;
};

// Skips entries that are farther away than the closest hit, and returns the next one.
uvec4 next_undecided(inout Pending pending)
{
    uvec4 undecided = uvec4(0u);
    while (pending.next != NONE) {
        undecided = work_rows[first_undecided() + pending.next];
        if (uintBitsToFloat(undecided.z) <= high)
            break;
        pending.next = undecided.w;
    }
    return undecided;
}

// Gathers requests, one of each lane at a time, until there are as many as lanes or none is left. The first request of
// a lane that has a hit is for the exact t of that hit. Returns the number of requests.
uint gather_requests(inout Pending pending, uint own, uint lanes, uint begin)
{
    uint gathered = 0u;
    while (gathered < lanes) {
        uvec4 undecided = next_undecided(pending);
        bool has_request = pending.next != NONE, requests_best = best != NONE && !pending.has_best_t;
        uint place = gathered + count_before(has_request), all = count_lanes(has_request);
        if (all == 0u)
            break;
        if (has_request && place < lanes) {
            requests[begin + place] = uvec4(requests_best ? uvec2(best, best_instance) : undecided.xy, index, own);
            pending.next = requests_best ? pending.next : undecided.w;
            pending.has_best_t = true;
        }
        gathered += all;
    }
    return min(gathered, lanes);
}

void merge_result(uvec4 request, uvec4 result, inout Pending pending)
{
    vec2 t = uintBitsToFloat(result.xy);
    if (request.x == best && request.y == best_instance) {
        pending.best_t = t;
        return;
    }
    if ((result.w & IS_MET) == 0u || t.x > high)
        return;
    bool is_closer = best == NONE || is_below(t, pending.best_t);
    if (!is_closer && t == pending.best_t) {
        uint place = place_of(request.y), best_place = place_of(best_instance);
        is_closer = place < best_place || place == best_place && (result.z & BVHD_ID_MASK) < (best_id & BVHD_ID_MASK);
    }
    if (!is_closer)
        return;
    best = request.x;
    best_instance = request.y;
    best_id = result.z;
    best_is_front = (result.w & IS_FRONT) != 0u;
    low = t.x * (1.0 - 2.4e-7);
    high = min(t.x * (1.0 + 2.4e-7), high);
    pending.best_t = t;
}

// Resolves the undecided triangles of all active lanes' rays. The lanes share the tests, because one ray may have
// dozens of undecided triangles where others have none.
void resolve()
{
    uint lanes = count_lanes(true), own = count_before(true), begin = subgroupBroadcastFirst(gl_LocalInvocationIndex);
    Pending pending = Pending(needs_fallback() ? NONE : last_undecided, false, vec2(0.0));
    while (true) {
        uint gathered = gather_requests(pending, own, lanes, begin);
        if (gathered == 0u)
            break;
        sync_subgroup();
        if (own < gathered)
            results[begin + own] = run_request(requests[begin + own]);
        sync_subgroup();
        for (uint i = begin; i < begin + gathered; i++)
            if (requests[i].w == own)
                merge_result(requests[i], results[i], pending);
        sync_subgroup();
    }
    last_undecided = needs_fallback() ? last_undecided : NONE;
}

#endif

#if defined RESOLVE || defined DOUBLES && !defined REFILL
const bool resolves_at_once = true;
#else
const bool resolves_at_once = false;
#endif

// Rays with undecided triangles that are resolved later: the RESOLVE kernel finds them by their numbers; with DOUBLES,
// each lane has a linked list of them for the end of its subgroup, and this is its last ray (NONE: the list is empty).
uint last_unresolved = NONE;

// Saves the state of a ray in the place of its hit, with the ray before it in the lane's list.
void store_unresolved()
{
    hit_rows[2u * index] = uvec4(best, best_instance, best_id, last_undecided);
    hit_rows[2u * index + 1u] = uvec4(floatBitsToUint(vec2(low, high)), best_is_front ? 1u : 0u, last_unresolved);
#ifdef DOUBLES
    last_unresolved = index;
#else
    set_ray_number(count - 1u - atomicAdd(unresolved_count, 1u), index);
#endif
}

void load_unresolved(uint ray)
{
    index = ray;
    origin = rays[index].origin.xyz;
    direction = rays[index].direction.xyz;
    uvec4 answer = hit_rows[2u * index], bounds = hit_rows[2u * index + 1u];
    best = answer.x;
    best_instance = answer.y;
    best_id = answer.z;
    last_undecided = answer.w;
    low = uintBitsToFloat(bounds.x);
    high = uintBitsToFloat(bounds.y);
    best_is_front = bounds.z != 0u;
    last_unresolved = bounds.w;
}

void store(BvhdHit hit)
{
    hit_rows[2u * index] = uvec4(floatBitsToUint(vec3(hit.t, hit.u, hit.v)), hit.instance);
    hit_rows[2u * index + 1u] = uvec4(hit.custom_index, hit.geometry, hit.primitive, hit.flags);
}

// The cross product, each component with the error of a single rounding: slim triangles need that accuracy. Where fma()
// rounds once it is the faster way.
vec3 cross_accurately(vec3 a, vec3 b)
{
    if (fused_fma) {
        precise vec3 second = a.zxy * b.yzx, rounding = fma(-a.zxy, b.yzx, second),
                     difference = fma(a.yzx, b.zxy, -second);
        return difference + rounding;
    }
    vec3 closely;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        closely[i] = bvhdAdd(bvhdProduct(a[j], b[k]), -bvhdProduct(a[k], b[j])).x;
    }
    return closely;
}

// Writes the ray's hit, or hands the ray on: to the query if it needs the fallback, to the resolve step if triangles
// are undecided. t is computed twice, the second time from a point in the triangle's plane, which is more accurate; the
// result must be in [low, high].
void finish()
{
    if (needs_fallback()) {
        set_ray_number(atomicAdd(fallback_count, 1u), index);
        return;
    }
    if (!resolves_at_once && last_undecided != NONE) {
        store_unresolved();
        return;
    }
    BvhdHit hit = miss();
    if (best == NONE) {
        store(hit);
        return;
    }
    vec3 from = origin, towards = direction;
    uvec2 location = extra;
    hit.flags = best_is_front ? FRONT_FACE : 0u;
    if (has_instances) {
        BvhdRay ray = rays[index];
        BvhdBody upper = open_body(extra);
        BvhdInstance place = bvhdInstance(upper, best_instance);
        vec4 x, y, z, i0, i1, i2;
        bvhdMatrix(upper, best_instance, 0u, x, y, z);
        bvhdMatrix(upper, best_instance, 3u, i0, i1, i2);
        mat3 rows = mat3(i0.xyz, i1.xyz, i2.xyz);
        from = (ray.origin.xyz - vec3(x.w, y.w, z.w)) * rows;
        towards = ray.direction.xyz * rows;
        location = place.bottom;
        hit.instance = place.index;
        hit.custom_index = place.customIndex;
        hit.flags ^= (place.flags & BVHD_INSTANCE_FLIP_FACING) != 0u ? FRONT_FACE : 0u;
    }
    BvhdBody body = open_body(location);
    vec3 v0, v1, v2;
    hit.primitive = bvhdCorners(body, best, v0, v1, v2) & BVHD_ID_MASK;
    vec3 e1 = v1 - v0, e2 = v2 - v0, s = from - v0, normal = cross_accurately(e1, e2), p = cross(towards, e2);
    float along = -1.0 / dot(normal, towards), scale = 1.0 / dot(e1, p), t = dot(normal, s) * along;
    t += dot(normal, from + t * towards - v0) * along;
    hit.t = t >= low && t <= high ? t : 0.5 * (low + high);
    hit.u = clamp(dot(s, p) * scale, 0.0, 1.0);
    hit.v = clamp(dot(towards, cross(s, e1)) * scale, 0.0, 1.0 - hit.u);
    if (bvhdRow(body.base, bvhdFirstRow(body.base) + 3u).z > 1u) {
        uvec2 primitive = bvhdGeometryOf(body, hit.primitive);
        hit.geometry = primitive.x;
        hit.primitive = primitive.y;
    }
    store(hit);
}

#endif
