// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_box.glsl - a ray against the eight children of a node. Never misses a box that the ray meets (Ize 2013).
 *
 * Child planes are at origin + q * step and are met at t = offset + q * scale, with offset = (origin - o) / d and scale
 * = step / d. Error bounds, with u = 2^-24, a division of 5u (Vulkan allows 2.5 ulp) and one rounding everywhere else:
 * offset has an error of at most 7u |offset|, of 2u more for a ray in an instance, whose direction is rounded, and the
 * sum one of u of its terms. So 16u |offset| on each side covers every error that does not shrink with the node. Errors
 * that do shrink, at most about 12u * 1279 |scale| (1279: see below), are 1/1000 of a step, and writers leave 1/64 of a
 * step to spare. The slack, in units of t, covers the rest: an instance's origin, which is rounded to float; underflow;
 * and axes along which the ray hardly moves.
 *
 * The direction along such an axis (below 2^-30 of the longest component) is replaced by 2^-30 of the longest. Within
 * the structure's bounds that moves the ray by less than the rounding of positions at that distance, and the slack of
 * that axis covers it.
 *
 * Bytes are converted to floats through half precision: 0x6400 | byte are the bits of 1024 + byte, and the 1024 is
 * subtracted from the offset. With BVHD_PLAIN_BYTES true they are converted by their own value.
 */
#ifndef BVHD_BOX_GLSL
#define BVHD_BOX_GLSL

#ifndef BVHD_PLAIN_BYTES
#define BVHD_PLAIN_BYTES false
#endif

struct BvhdBoxRay {
    vec3 origin;
    vec3 inverse; // of the direction; finite
    vec3 slack;
    float tmin; // >= 0
    uint order; // bvhdFirstSlot's masks
};

bool bvhdIsFinite(vec3 value)
{
    return all(lessThan(floatBitsToUint(value) & 0x7f800000u, uvec3(0x7f800000u)));
}

float bvhdLargest(vec3 value)
{
    return max(max(abs(value.x), abs(value.y)), abs(value.z));
}

/*
 * Prepares a ray, given in a structure's space, for the structure with these bounds. originLow: the rounding error of
 * the origin. Returns false when nothing can be hit: the direction is zero, or a component is not finite.
 */
bool bvhdBoxRayInit(vec3 origin, vec3 originLow, vec3 direction, float tmin, BvhdExtent extent, out BvhdBoxRay ray)
{
    float longest = bvhdLargest(direction);
    float farthest = max(bvhdLargest(extent.lowest - origin), bvhdLargest(extent.highest - origin));
    float reach = farthest / longest; // no point of the structure is met at a greater |t|
    bvec3 isParallel = lessThan(abs(direction), vec3(9.3132257e-10 * longest));
    bvec3 isNegative = lessThan(direction, vec3(0.0));
    vec3 moving =
        mix(direction, mix(vec3(9.3132257e-10 * longest), vec3(-9.3132257e-10 * longest), isNegative), isParallel);
    ray.origin = origin;
    ray.inverse = 1.0 / moving;
    ray.slack = 1.001 * (abs(originLow * ray.inverse) + mix(vec3(9.0949470e-13), vec3(2.0), isParallel) * reach) +
                3.0092656e-36;
    ray.tmin = tmin > 0.0 ? tmin : 0.0;
    ray.order =
        (isNegative.z ? 0xf00000u : 0x0f0000u) | (isNegative.y ? 0xcc00u : 0x3300u) | (isNegative.x ? 0xaau : 0x55u);
    return longest > 0.0 && bvhdIsFinite(origin) && bvhdIsFinite(direction) && !extent.isEmpty;
}

// Returns the slot that the ray meets first, of those in bits 31 .. 24 of `hits`: the one with the least slot ^ octant.
// There must be at least one.
uint bvhdFirstSlot(uint hits, uint order)
{
    uint slots = hits >> 24, part = slots & order >> 16;
    slots = part != 0u ? part : slots;
    part = slots & order >> 8;
    slots = part != 0u ? part : slots;
    part = slots & order;
    slots = part != 0u ? part : slots;
    return uint(findLSB(slots));
}

vec4 bvhdWiden(uint bytes)
{
    if (BVHD_PLAIN_BYTES)
        return vec4(uvec4(bytes, bytes >> 8, bytes >> 16, bytes >> 24) & 0xffu);
    vec2 even = unpackHalf2x16(bytes & 0x00ff00ffu | 0x64006400u),
         odd = unpackHalf2x16(bytes >> 8 & 0x00ff00ffu | 0x64006400u);
    return vec4(even.x, odd.x, even.y, odd.y);
}

/*
 * Tests four slots, given their meta bytes and the bytes of their near and far planes. Returns the bits that their meta
 * bytes stand for. Distances are compared as integers, which is correct because tmin is not negative.
 */
uint bvhdFourHits(uint meta, uvec3 nearBytes, uvec3 farBytes, vec3 scale, vec3 first, vec3 last, int tmin, int tmax)
{
    ivec4 near = max(max(floatBitsToInt(bvhdWiden(nearBytes.x) * scale.x + first.x),
                         floatBitsToInt(bvhdWiden(nearBytes.y) * scale.y + first.y)),
                     max(floatBitsToInt(bvhdWiden(nearBytes.z) * scale.z + first.z), ivec4(tmin)));
    ivec4 far = min(min(floatBitsToInt(bvhdWiden(farBytes.x) * scale.x + last.x),
                        floatBitsToInt(bvhdWiden(farBytes.y) * scale.y + last.y)),
                    min(floatBitsToInt(bvhdWiden(farBytes.z) * scale.z + last.z), ivec4(tmax)));
    uvec4 metas = uvec4(meta, meta >> 8, meta >> 16, meta >> 24) & 0xffu;
    uvec4 bits = mix(uvec4(0u), metas >> 5 << (metas & 31u), lessThanEqual(near, far));
    return bits.x | bits.y | bits.z | bits.w;
}

/*
 * Tests the children of a node, given its five rows, against the ray in [tmin, tmax]. Returns inner children of slots
 * 7 .. 0 in bits 31 .. 24, and records, counted from the node's first one, in bits 23 .. 0.
 */
uint bvhdNodeHits(BvhdBoxRay ray, float tmax, uvec4 head, uvec4 meta, uvec4 planes0, uvec4 planes1, uvec4 planes2)
{
    vec3 step = uintBitsToFloat((uvec3(head.w, head.w >> 8, head.w >> 16) & 0xffu) << 23);
    vec3 offset = (uintBitsToFloat(head.xyz) - ray.origin) * ray.inverse;
    vec3 scale = step * ray.inverse;
    vec3 error = abs(offset) * 9.5367432e-7 + ray.slack;
    vec3 biased = BVHD_PLAIN_BYTES ? offset : offset - 1024.0 * scale;
    bvec3 isNegative = lessThan(ray.inverse, vec3(0.0));
    uvec3 low0 = uvec3(planes0.xz, planes1.x), low1 = uvec3(planes0.yw, planes1.y);
    uvec3 high0 = uvec3(planes1.z, planes2.xz), high1 = uvec3(planes1.w, planes2.yw);
    int start = floatBitsToInt(ray.tmin), end = floatBitsToInt(tmax);
    return bvhdFourHits(meta.z, mix(low0, high0, isNegative), mix(high0, low0, isNegative), scale, biased - error,
                        biased + error, start, end) |
           bvhdFourHits(meta.w, mix(low1, high1, isNegative), mix(high1, low1, isNegative), scale, biased - error,
                        biased + error, start, end);
}

// Tests one exact box against the closed interval. `entry`: the t at which the ray enters, within the interval.
bool bvhdBoxMet(BvhdBoxRay ray, vec3 lowest, vec3 highest, float tmax, out float entry)
{
    bvec3 isNegative = lessThan(ray.inverse, vec3(0.0));
    vec3 first = (mix(lowest, highest, isNegative) - ray.origin) * ray.inverse;
    vec3 last = (mix(highest, lowest, isNegative) - ray.origin) * ray.inverse;
    vec3 firstLow = first - abs(first) * 9.5367432e-7 - ray.slack,
         lastHigh = last + abs(last) * 9.5367432e-7 + ray.slack;
    float end = min(min(last.x, last.y), min(last.z, tmax));
    entry = max(min(max(max(first.x, first.y), first.z), end), ray.tmin);
    return all(lessThanEqual(lowest, highest)) && max(max(firstLow.x, firstLow.y), max(firstLow.z, ray.tmin)) <=
                                                      min(min(lastHigh.x, lastHigh.y), min(lastHigh.z, tmax));
}

#endif
