// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_closest_exact.glsl - the exact tests of bvhd_triangle.glsl and bvhd_ray_query.glsl in doubles, for devices where
 * doubles are fast. The steps are the same, and are explained there. A vertex's position across the ray is rounded to
 * float as there, so that signs are decided by exact products: a product of two floats fits a double. Values that are
 * `precise` must be equal for all triangles that share them, and exactly 0 for flat triangles.
 */
#ifndef BVHD_CLOSEST_EXACT_GLSL
#define BVHD_CLOSEST_EXACT_GLSL

// In the space of a bottom level.
struct ExactRay {
    dvec3 origin, direction;
};

dvec3 exact_to_object(dvec3 value, dmat3 rows, dmat3 inverse_rows)
{
    dvec3 guess = value * inverse_rows;
    return guess + (value - guess * rows) * inverse_rows;
}

void exact_enter(inout ExactRay ray, BvhdBody upper, uint in_instance)
{
    vec4 m0, m1, m2, i0, i1, i2;
    bvhdMatrix(upper, in_instance, 0u, m0, m1, m2);
    bvhdMatrix(upper, in_instance, 3u, i0, i1, i2);
    dmat3 rows = dmat3(m0.xyz, m1.xyz, m2.xyz), inverse_rows = dmat3(i0.xyz, i1.xyz, i2.xyz);
    ray.origin = exact_to_object(ray.origin - dvec3(m0.w, m1.w, m2.w), rows, inverse_rows);
    ray.direction = exact_to_object(ray.direction, rows, inverse_rows);
}

dvec3 exact_permute(dvec3 value, int main_axis, bool is_backward)
{
    dvec3 permuted = main_axis == 0 ? value.yzx : main_axis == 1 ? value.zxy : value;
    return is_backward ? permuted.yxz : permuted;
}

// bvhdEdge in doubles. The sign is that of the rounded positions, `value` that of the unrounded ones.
int exact_side(dvec2 from, dvec2 to, out double value)
{
    dvec2 a = dvec2(vec2(from)), b = dvec2(vec2(to));
    precise double left = b.x * a.y, right = b.y * a.x, side = left - right;
    side = side == 0.0 ? b.y - a.y : side;
    side = side == 0.0 ? a.x - b.x : side;
    value = to.x * from.y - to.y * from.x;
    return (side > 0.0 ? 1 : 0) - (side < 0.0 ? 1 : 0);
}

bool exact_is_flat(vec3 v0, vec3 v1, vec3 v2)
{
    dvec3 a = dvec3(v1) - dvec3(v0), b = dvec3(v2) - dvec3(v0);
    precise dvec3 left = a.yzx * b.zxy, right = a.zxy * b.yzx, area = left - right;
    return vec3(area) == vec3(0.0);
}

// A double as the sum of two floats. The second one is 0 where the first one overflows.
vec2 exact_pair(double value)
{
    float high_part = float(value);
    return vec2(high_part, isinf(high_part) ? 0.0 : float(value - double(high_part)));
}

// bvhdTriangleHit in doubles.
bool exact_triangle_hit(ExactRay ray, vec3 v0, vec3 v1, vec3 v2, out BvhdTriangleHit hit)
{
    vec3 towards = vec3(ray.direction), from = vec3(ray.origin), size = abs(towards);
    int main_axis = size.y > size.x ? 1 : 0;
    main_axis = size.z > max(size.x, size.y) ? 2 : main_axis;
    bool is_backward = (main_axis == 0 ? towards.x : main_axis == 1 ? towards.y : towards.z) < 0.0;
    dvec3 direction = exact_permute(ray.direction, main_axis, is_backward);
    precise dvec2 shear = direction.xy / direction.z;

    vec3 farthest = max(max(abs(v0 - from), abs(v1 - from)), abs(v2 - from));
    uint exponent = floatBitsToUint(max(max(farthest.x, farthest.y), farthest.z)) & 0x7f800000u;
    double scale = uintBitsToFloat(0x7f000000u - exponent), unscale = uintBitsToFloat(exponent);
    precise dvec3 a = exact_permute(dvec3(v0) - ray.origin, main_axis, is_backward) * scale;
    precise dvec3 b = exact_permute(dvec3(v1) - ray.origin, main_axis, is_backward) * scale;
    precise dvec3 c = exact_permute(dvec3(v2) - ray.origin, main_axis, is_backward) * scale;
    a.xy -= shear * a.z;
    b.xy -= shear * b.z;
    c.xy -= shear * c.z;

    dvec3 edges;
    int side = exact_side(b.xy, c.xy, edges.x) + exact_side(c.xy, a.xy, edges.y) + exact_side(a.xy, b.xy, edges.z);
    if (abs(side) != 3)
        return false;
    double sign = side > 0 ? 1.0 : -1.0;
    edges = mix(dvec3(0.0), edges, greaterThan(edges * sign, dvec3(0.0)));
    double sum = edges.x + edges.y + edges.z;
    double reach = (abs(a.x) + abs(b.x) + abs(c.x)) * (abs(a.y) + abs(b.y) + abs(c.y));
    if (sum == 0.0 || abs(sum) < 0.00390625 * reach && exact_is_flat(v0, v1, v2))
        return false;
    hit.t = exact_pair(dot(edges, dvec3(a.z, b.z, c.z)) / sum / direction.z * unscale);
    hit.barycentrics = vec2(edges.yz / sum);
    hit.isFront = side > 0;
    return true;
}

#endif
