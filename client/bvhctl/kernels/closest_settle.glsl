// SPDX-License-Identifier: Apache-2.0
// closest_settle.glsl - the end of closest.glsl: the answer is written; of rays with doubts after these have been decided: with DOUBLES at once, in doubles, else by the kernel
// that comes after, SETTLE, in pairs of floats.
#ifndef CLOSEST_SETTLE_GLSL
#define CLOSEST_SETTLE_GLSL

#if defined SETTLE || defined DOUBLES

#ifdef DOUBLES
#include "closest_exact.glsl"
#define EXACT_RAY(origin, direction) ExactRay(dvec3(origin), dvec3(direction))
#define EXACT_ENTER exact_enter
#define EXACT_TRIANGLE_HIT exact_triangle_hit
#else
#define ExactRay BvhdTriangleRay
#define EXACT_RAY(origin, direction) BvhdTriangleRay(origin, direction, vec3(0.0), vec3(0.0))
#define EXACT_ENTER bvhdToObject
#define EXACT_TRIANGLE_HIT bvhdTriangleHit
#endif

bool exact_hit(uint in_instance, uint record, out BvhdTriangleHit hit, out uint id)
{
    Ray ray = rays[index];
    ExactRay exact = EXACT_RAY(ray.origin.xyz, ray.direction.xyz);
    uvec2 location = extra;
    if (has_instances) {
        BvhdBody upper = open_body(extra);
        EXACT_ENTER(exact, upper, in_instance);
        location = bvhdRow(upper.base, upper.records + 8u * in_instance + 7u).xy;
    }
    vec3 v0, v1, v2;
    id = bvhdCorners(open_body(location), record, v0, v1, v2);
    return EXACT_TRIANGLE_HIT(exact, v0, v1, v2, hit);
}

uint place_of(uint in_instance)
{
    if (!has_instances)
        return 0u;
    BvhdBody upper = open_body(extra);
    return bvhdRow(upper.base, upper.records + 8u * in_instance + 6u).z;
}

bool is_below(vec2 a, vec2 b)
{
    return a.x < b.x || a.x == b.x && a.y < b.y;
}

/*
 * Decides on all doubts. The answer so far is looked at exactly only when something comes close to it; one call stands for both, since its code is long and
 * compilers put it wherever it is called.
 */
void settle()
{
    bool asks_best = false, is_known = false, is_front = false;
    vec2 t = vec2(0.0), best_t = vec2(0.0);
    uint id = 0u;
    float tmax = rays[index].direction.w;
    while (last_doubt != NONE) {
        uvec4 one = work_rows[first_doubt() + last_doubt];
        if (!asks_best && uintBitsToFloat(one.z) > high) {
            last_doubt = one.w;
            continue;
        }
        BvhdTriangleHit hit;
        uint hit_id;
        bool is_met = exact_hit(asks_best ? best_instance : one.y, asks_best ? best : one.x, hit, hit_id);
        if (asks_best) {
            best_t = bvhdRoundDistance(hit.t);
            is_known = true;
            asks_best = false;
        } else {
            if (!is_met || !is_below(vec2(tmin, 0.0), hit.t) || !is_below(hit.t, vec2(tmax, 0.0)) || hit.t.x > high) {
                last_doubt = one.w;
                continue;
            }
            t = bvhdRoundDistance(hit.t);
            id = hit_id;
            is_front = hit.isFront;
            asks_best = best != NONE && t.x >= low && !is_known;
            if (asks_best)
                continue;
        }
        bool is_closer = best == NONE || t.x < low || is_below(t, best_t);
        if (!is_closer && t == best_t) {
            uint place = place_of(one.y), best_place = place_of(best_instance);
            is_closer = place < best_place || place == best_place && (id & BVHD_ID_MASK) < (best_id & BVHD_ID_MASK);
        }
        if (is_closer) {
            best = one.x;
            best_instance = one.y;
            best_id = id;
            best_is_front = is_front;
            low = t.x * (1.0 - 2.4e-7);
            high = min(t.x * (1.0 + 2.4e-7), high);
            best_t = t;
            is_known = true;
        }
        last_doubt = one.w;
    }
}

#endif

#ifdef SETTLE

// A ray with its doubts, as leave_doubts has put it into the place of its hit.
void take_unsettled(uint ray)
{
    index = ray;
    uvec4 answer = hit_rows[2u * index], bounds = hit_rows[2u * index + 1u];
    best = answer.x;
    best_instance = answer.y;
    best_id = answer.z;
    last_doubt = answer.w;
    low = uintBitsToFloat(bounds.x);
    high = uintBitsToFloat(bounds.y);
    best_is_front = bounds.z != 0u;
    tmin = rays[index].origin.w;
}

#elif !defined DOUBLES

// Leaves the ray to SETTLE.
void leave_doubts()
{
    hit_rows[2u * index] = uvec4(best, best_instance, best_id, last_doubt);
    hit_rows[2u * index + 1u] = uvec4(floatBitsToUint(vec2(low, high)), best_is_front ? 1u : 0u, 0u);
    set_number(count - 1u - atomicAdd(unsettled_count, 1u), index);
}

#endif

void store(Hit hit)
{
    hit_rows[2u * index] = uvec4(floatBitsToUint(vec3(hit.t, hit.u, hit.v)), hit.instance);
    hit_rows[2u * index + 1u] = uvec4(hit.custom_index, hit.geometry, hit.primitive, hit.flags);
}

// Each component as one subtraction rounds it, where fma() rounds once: slim triangles have no other normal.
vec3 cross_closely(vec3 a, vec3 b)
{
    precise vec3 second = a.zxy * b.yzx, rounding = fma(-a.zxy, b.yzx, second), difference = fma(a.yzx, b.zxy, -second);
    return difference + rounding;
}

// After the walk. Rays that have lost doubts are left to the query. t once more from a place in the triangle's plane, so that little is lost; within what is known of it.
void finish()
{
#ifndef SETTLE
    if (last_doubt != NONE) {
        if (last_doubt >= doubt_room()) {
            set_number(atomicAdd(left_count, 1u), index);
            return;
        }
#ifdef DOUBLES
        settle();
#else
        leave_doubts();
        return;
#endif
    }
#endif
    Hit hit = miss();
    if (best == NONE) {
        store(hit);
        return;
    }
    Ray ray = rays[index];
    vec3 from = ray.origin.xyz, towards = ray.direction.xyz;
    uvec2 location = extra;
    hit.flags = best_is_front ? FRONT_FACE : 0u;
    if (has_instances) {
        BvhdBody upper = open_body(extra);
        BvhdInstance place = bvhdInstance(upper, best_instance);
        vec4 x, y, z, i0, i1, i2;
        bvhdMatrix(upper, best_instance, 0u, x, y, z);
        bvhdMatrix(upper, best_instance, 3u, i0, i1, i2);
        mat3 rows = mat3(i0.xyz, i1.xyz, i2.xyz);
        from = (from - vec3(x.w, y.w, z.w)) * rows;
        towards = towards * rows;
        location = place.bottom;
        hit.instance = place.index;
        hit.custom_index = place.customIndex;
        hit.flags ^= (place.flags & BVHD_INSTANCE_FLIP_FACING) != 0u ? FRONT_FACE : 0u;
    }
    BvhdBody body = open_body(location);
    vec3 v0, v1, v2;
    hit.primitive = bvhdCorners(body, best, v0, v1, v2) & BVHD_ID_MASK;
    vec3 e1 = v1 - v0, e2 = v2 - v0, s = from - v0, normal = cross_closely(e1, e2), p = cross(towards, e2);
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
