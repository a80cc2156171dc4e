// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_motion.glsl - what moves, at the time of a ray: the boxes of moving nodes, and the matrices of motion instances.
 * (bvhd_structure.glsl has the vertices.)
 *
 * A number at time t is start * (1 - t) + end * t, with each operation rounded once. On the CPU it has the same bits.
 *
 * The box of a moving node's child at time t is interpolated between its boxes at both keys. With the terms of
 * bvhd_box.glsl there are these errors more. Bytes are interpolated as q + t (q' - q), where only the product and the
 * sum are rounded: by 255u and 1279u of a step at most, or 1/10000 of it, and writers leave 1/64 on each side. A vertex
 * at t, and so what surrounds it, is off by 3u M, where M is the structure's largest coordinate along the axis: its
 * products and its sum are rounded, and so is 1 - t. The slack gets 8u M. The boxes of motion instances hold what
 * their rounded matrices reach.
 */
#ifndef BVHD_MOTION_GLSL
#define BVHD_MOTION_GLSL

/* ---- Boxes ---- */

// Widens the slack of a ray that has been prepared for a structure with these bounds, to that of one that moves.
void bvhdWidenForMotion(inout BvhdBoxRay ray, BvhdExtent extent)
{
    ray.slack += 4.8e-7 * max(abs(extent.lowest), abs(extent.highest)) * abs(ray.inverse);
}

vec4 bvhdWidenAtTime(uint start, uint end, float time)
{
    vec4 first = bvhdWiden(start);
    return first + time * (bvhdWiden(end) - first);
}

// bvhdFourHits, with the planes of both keys.
uint bvhdFourMovingHits(uint meta, uvec3 nearStart, uvec3 nearEnd, uvec3 farStart, uvec3 farEnd, float time, vec3 scale,
                        vec3 first, vec3 last, int tmin, int tmax)
{
    ivec4 near = ivec4(tmin), far = ivec4(tmax);
    for (int axis = 0; axis < 3; axis++) {
        vec4 nearPlanes = bvhdWidenAtTime(nearStart[axis], nearEnd[axis], time);
        vec4 farPlanes = bvhdWidenAtTime(farStart[axis], farEnd[axis], time);
        near = max(near, floatBitsToInt(nearPlanes * scale[axis] + first[axis]));
        far = min(far, floatBitsToInt(farPlanes * scale[axis] + last[axis]));
    }
    uvec4 metas = uvec4(meta, meta >> 8, meta >> 16, meta >> 24) & 0xffu;
    uvec4 bits = mix(uvec4(0u), metas >> 5 << (metas & 31u), lessThanEqual(near, far));
    return bits.x | bits.y | bits.z | bits.w;
}

// The bytes of four slots at one key: lowest and highest planes of all axes, by what the ray meets first.
struct BvhdPlanes {
    uvec3 near, far;
};

BvhdPlanes bvhdPlanes(uvec3 low, uvec3 high, bvec3 isNegative)
{
    return BvhdPlanes(mix(low, high, isNegative), mix(high, low, isNegative));
}

// bvhdNodeHits for a moving node, which begins at `row` with `head` and `meta`.
uint bvhdMovingNodeHits(BvhdBoxRay ray, float tmax, BvhdBody body, uint row, uvec4 head, uvec4 meta)
{
    uvec4 rows[6];
    for (uint i = 0u; i < 6u; i++)
        rows[i] = bvhdRow(body.base, row + 2u + i);
    vec3 step = uintBitsToFloat((uvec3(head.w, head.w >> 8, head.w >> 16) & 0xffu) << 23);
    vec3 offset = (uintBitsToFloat(head.xyz) - ray.origin) * ray.inverse;
    vec3 scale = step * ray.inverse;
    vec3 error = abs(offset) * 9.5367432e-7 + ray.slack;
    vec3 biased = BVHD_PLAIN_BYTES ? offset : offset - 1024.0 * scale;
    bvec3 isNegative = lessThan(ray.inverse, vec3(0.0));
    uint hits = 0u;
    for (uint part = 0u; part < 2u; part++) {
        uint one = part, other = 2u + part; // words of a row: slots 0 .. 3, or 4 .. 7, of two groups of planes
        BvhdPlanes start = bvhdPlanes(uvec3(rows[0][one], rows[0][other], rows[1][one]),
                                      uvec3(rows[1][other], rows[2][one], rows[2][other]), isNegative);
        BvhdPlanes end = bvhdPlanes(uvec3(rows[3][one], rows[3][other], rows[4][one]),
                                    uvec3(rows[4][other], rows[5][one], rows[5][other]), isNegative);
        hits |=
            bvhdFourMovingHits(part == 0u ? meta.z : meta.w, start.near, end.near, start.far, end.far, body.time, scale,
                               biased - error, biased + error, floatBitsToInt(ray.tmin), floatBitsToInt(tmax));
    }
    return hits;
}

// The same for a node that need not be a moving one.
uint bvhdAnyNodeHits(BvhdBoxRay ray, float tmax, BvhdBody body, uint row, uvec4 head, uvec4 meta)
{
    if (body.moves)
        return bvhdMovingNodeHits(ray, tmax, body, row, head, meta);
    return bvhdNodeHits(ray, tmax, head, meta, bvhdRow(body.base, row + 2u), bvhdRow(body.base, row + 3u),
                        bvhdRow(body.base, row + 4u));
}

/* ---- Matrices ---- */

// The type of a motion instance, VkAccelerationStructureMotionInstanceTypeNV. Others have a matrix that does not move.
const uint BVHD_MOTION_MATRIX = 1u;
const uint BVHD_MOTION_SRT = 2u;

// The power of two by which numbers are multiplied to bring the largest of them near 1, so that errors of products do
// not underflow; 0 if the largest is 0 or not finite.
float bvhdScaleToOne(float largest)
{
    uint exponent = floatBitsToUint(largest) & 0x7f800000u;
    return exponent == 0u || exponent == 0x7f800000u ? 0.0 : uintBitsToFloat(0x7f000000u - exponent);
}

vec2 bvhdSumOfProducts(vec2 a, float x, vec2 b, float y, vec2 c, float z)
{
    return bvhdAdd(bvhdAdd(bvhdMultiply(a, vec2(x, 0.0)), bvhdMultiply(b, vec2(y, 0.0))),
                   bvhdMultiply(c, vec2(z, 0.0)));
}

// A row of an SRT's matrix, without its translation. r: the row of the rotation, times the quaternion's square; back:
// one divided by that.
vec4 bvhdSrtRow(vec2 r0, vec2 r1, vec2 r2, vec2 back, vec4 scale0, vec4 scale1, vec4 scale2, float translation)
{
    vec2 x = bvhdMultiply(bvhdMultiply(r0, vec2(scale0.x, 0.0)), back);
    vec2 y = bvhdMultiply(bvhdSumOfProducts(r0, scale0.y, r1, scale1.y, r2, 0.0), back);
    vec2 z = bvhdMultiply(bvhdSumOfProducts(r0, scale0.z, r1, scale1.z, r2, scale2.z), back);
    vec2 w = bvhdMultiply(bvhdSumOfProducts(r0, scale0.w, r1, scale1.w, r2, scale2.w), back);
    return vec4(x.x, y.x, z.x, bvhdAdd(w, vec2(translation, 0.0)).x);
}

/*
 * Translation * rotation * scale of the 16 numbers of VkSRTDataNV, in pairs, and rounded once. The quaternion counts as
 * divided by its length; zeros, if it has none.
 */
void bvhdSrtMatrix(vec4 n0, vec4 n1, vec4 n2, vec4 n3, out vec4 x, out vec4 y, out vec4 z)
{
    vec4 scale0 = n0, scale1 = vec4(0.0, n1.xyz), scale2 = vec4(0.0, 0.0, n1.w, n2.x);
    vec4 q = vec4(n2.yzw, n3.x);
    q *= bvhdScaleToOne(max(bvhdLargest(q.xyz), abs(q.w)));
    vec2 xx = bvhdProduct(q.x, q.x), yy = bvhdProduct(q.y, q.y), zz = bvhdProduct(q.z, q.z), ww = bvhdProduct(q.w, q.w);
    vec2 xy = bvhdProduct(2.0 * q.x, q.y), xz = bvhdProduct(2.0 * q.x, q.z), yz = bvhdProduct(2.0 * q.y, q.z);
    vec2 xw = bvhdProduct(2.0 * q.x, q.w), yw = bvhdProduct(2.0 * q.y, q.w), zw = bvhdProduct(2.0 * q.z, q.w);
    vec2 square = bvhdAdd(bvhdAdd(xx, yy), bvhdAdd(zz, ww));
    x = y = z = vec4(0.0);
    if (!(square.x > 0.0))
        return;
    vec2 back = bvhdDivide(vec2(1.0, 0.0), square);
    x = bvhdSrtRow(bvhdAdd(bvhdAdd(ww, -yy), bvhdAdd(xx, -zz)), bvhdAdd(xy, -zw), bvhdAdd(xz, yw), back, scale0, scale1,
                   scale2, n3.y);
    y = bvhdSrtRow(bvhdAdd(xy, zw), bvhdAdd(bvhdAdd(ww, -xx), bvhdAdd(yy, -zz)), bvhdAdd(yz, -xw), back, scale0, scale1,
                   scale2, n3.z);
    z = bvhdSrtRow(bvhdAdd(xz, -yw), bvhdAdd(yz, xw), bvhdAdd(bvhdAdd(ww, -xx), bvhdAdd(zz, -yy)), back, scale0, scale1,
                   scale2, n3.w);
}

// The cross product of two vectors of floats, as pairs.
mat3x2 bvhdCrossPairs(vec3 a, vec3 b)
{
    return mat3x2(bvhdAdd(bvhdProduct(a.y, b.z), -bvhdProduct(a.z, b.y)),
                  bvhdAdd(bvhdProduct(a.z, b.x), -bvhdProduct(a.x, b.z)),
                  bvhdAdd(bvhdProduct(a.x, b.y), -bvhdProduct(a.y, b.x)));
}

// The inverse of a matrix, in pairs, and rounded once; zeros if there is none.
void bvhdInvert(vec4 x, vec4 y, vec4 z, out vec4 i0, out vec4 i1, out vec4 i2)
{
    float scale = bvhdScaleToOne(max(max(bvhdLargest(x.xyz), bvhdLargest(y.xyz)), bvhdLargest(z.xyz)));
    vec3 a = scale * x.xyz, b = scale * y.xyz, c = scale * z.xyz;
    mat3x2 columns[3] = mat3x2[](bvhdCrossPairs(b, c), bvhdCrossPairs(c, a), bvhdCrossPairs(a, b));
    vec2 det = bvhdSumOfProducts(columns[0][0], a.x, columns[0][1], a.y, columns[0][2], a.z);
    vec4 rows[3] = vec4[](vec4(0.0), vec4(0.0), vec4(0.0));
    vec2 back = det.x != 0.0 ? bvhdDivide(vec2(scale, 0.0), det) : vec2(0.0);
    for (int row = 0; row < 3; row++) {
        vec2 e0 = bvhdMultiply(columns[0][row], back), e1 = bvhdMultiply(columns[1][row], back),
             e2 = bvhdMultiply(columns[2][row], back);
        rows[row] = vec4(e0.x, e1.x, e2.x, -bvhdSumOfProducts(e0, x.w, e1, y.w, e2, z.w).x);
    }
    i0 = rows[0];
    i1 = rows[1];
    i2 = rows[2];
}

// The matrices of an instance at the body's time as three rows each: object to world, and world to object.
void bvhdMatrices(BvhdBody top, uint record, out vec4 m0, out vec4 m1, out vec4 m2, out vec4 i0, out vec4 i1,
                  out vec4 i2)
{
    if (!top.moves) {
        bvhdMatrix(top, record, 0u, m0, m1, m2);
        bvhdMatrix(top, record, 3u, i0, i1, i2);
        return;
    }
    uint row = top.records + 10u * record, type = bvhdRow(top.base, row).x;
    vec4 numbers[4];
    for (uint i = 0u; i < 4u; i++) {
        numbers[i] = uintBitsToFloat(bvhdRow(top.base, row + 2u + i));
        if (type == BVHD_MOTION_MATRIX || type == BVHD_MOTION_SRT)
            numbers[i] = bvhdAtTime(numbers[i], uintBitsToFloat(bvhdRow(top.base, row + 6u + i)), top.time);
    }
    m0 = numbers[0];
    m1 = numbers[1];
    m2 = numbers[2];
    if (type == BVHD_MOTION_SRT)
        bvhdSrtMatrix(numbers[0], numbers[1], numbers[2], numbers[3], m0, m1, m2);
    bvhdInvert(m0, m1, m2, i0, i1, i2);
}

#endif
