// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_round.glsl - a ray against a sphere or a linear swept sphere, with nearly the accuracy of doubles but without
 * float64. Like bvhd_triangle.glsl it has two parts: bvhdRoundMayHit is cheap, computes in float with error bounds, and
 * drops what is certainly missed; bvhdRoundHit decides the others in pairs of floats.
 *
 * Both are given as two ends, each a centre with its radius in w. A sphere has the same end twice. Only what a ray
 * enters from outside is hit.
 *
 * A linear swept sphere with both caps is the convex hull of two spheres. It lies inside the cone that touches both,
 * and that cone's surface between the circles where it touches them is the side. So the point where a ray enters the
 * cone decides all: between the circles it is the hit; beyond one of them the ray can only enter through that end's
 * cap, and without a cap it passes into the shape. Because one point decides, no ray slips between side and cap.
 *
 * Let o be the ray's origin relative to the first end's centre, d its direction, D the way from the first to the second
 * centre, r and s the radii, e = r - s. A point X, relative to the first centre, is on the cone if
 *
 *     |X x D|^2 - e^2 X.X + 2 r e X.D - r^2 D.D = 0
 *
 * and the left side is below zero inside it. The circles are at X.D = r e and X.D = D.D + s e. For X = o + t d that is
 * quadratic in t, and the ray enters where its value falls. Before that the origin is moved along the ray, first to the
 * point closest to the first centre and then to the one closest to the axis: otherwise terms as large as the distance
 * would cancel.
 */
#ifndef BVHD_ROUND_GLSL
#define BVHD_ROUND_GLSL

struct BvhdRoundHit {
    vec2 t; // a pair
    float u; // how far the sphere that touches the point has moved: 0 at the first end, 1 at the second
};

/* ---- The float test ---- */

/*
 * Whether the ray meets a ball between tmin and tmax, or may do so. s is its centre relative to the ray's origin. With
 * u = 2^-24, rounding s, the product with the inverse square, the direction and the remainder move the remainder f by
 * less than 16 u |s| altogether; the origin's own error comes on top.
 */
bool bvhdBallMayHit(BvhdTriangleRay ray, float tmin, float tmax, vec3 s, float radius)
{
    float square = dot(ray.direction, ray.direction), t = dot(s, ray.direction) / square;
    vec3 f = s - t * ray.direction;
    float reach = (radius + 1.2e-6 * bvhdSumOfSizes(s) + bvhdSumOfSizes(ray.originLow)) * 1.000002;
    float span = reach * inversesqrt(square) * 1.000002;
    return !(dot(f, f) > reach * reach + 1.0e-37 || t - span > 1.000002 * tmax || t + span < 0.999998 * tmin);
}

/*
 * Whether the ray's line comes as close to the axis of a linear swept sphere as its larger radius, or may do so. s is
 * the first centre relative to the ray's origin. Both directions are scaled to unit length; the triple product then has
 * an error of less than 32 u |s|.
 */
bool bvhdAxisMayHit(BvhdTriangleRay ray, vec3 s, vec3 axis, float radius)
{
    vec3 n = cross(ray.direction * inversesqrt(dot(ray.direction, ray.direction)),
                   axis * inversesqrt(max(dot(axis, axis), 1.0e-37)));
    return !(abs(dot(s, n)) >
             1.000002 * radius * length(n) + 4.0e-6 * bvhdSumOfSizes(s) + bvhdSumOfSizes(ray.originLow));
}

// Returns false when nothing is hit between tmin and tmax; otherwise bvhdRoundHit has to decide, as it has in a large
// structure.
bool bvhdRoundMayHit(BvhdTriangleRay ray, float tmin, float tmax, vec4 ends[2])
{
    if (ray.isLarge)
        return true;
    vec3 s = ends[0].xyz - ray.origin, axis = ends[1].xyz - ends[0].xyz;
    float radius = max(ends[0].w, ends[1].w), size = length(axis);
    return bvhdBallMayHit(ray, tmin, tmax, s + 0.5 * axis, radius + 0.5 * size) &&
           (size == 0.0 || bvhdAxisMayHit(ray, s, axis, radius));
}

/* ---- Vectors of pairs ---- */

#define BvhdPairs mat3x2 // a column for each axis

BvhdPairs bvhdPairs(vec3 high, vec3 low)
{
    return BvhdPairs(high.x, low.x, high.y, low.y, high.z, low.z);
}

vec3 bvhdHigh(BvhdPairs a)
{
    return vec3(a[0].x, a[1].x, a[2].x);
}

vec2 bvhdDot(BvhdPairs a, BvhdPairs b)
{
    return bvhdAdd(bvhdAdd(bvhdMultiply(a[0], b[0]), bvhdMultiply(a[1], b[1])), bvhdMultiply(a[2], b[2]));
}

vec2 bvhdMinor(vec2 a, vec2 b, vec2 c, vec2 d)
{
    return bvhdAdd(bvhdMultiply(a, b), -bvhdMultiply(c, d));
}

BvhdPairs bvhdCross(BvhdPairs a, BvhdPairs b)
{
    return BvhdPairs(bvhdMinor(a[1], b[2], a[2], b[1]), bvhdMinor(a[2], b[0], a[0], b[2]),
                     bvhdMinor(a[0], b[1], a[1], b[0]));
}

// a + t * b
BvhdPairs bvhdMoved(BvhdPairs a, vec2 t, BvhdPairs b)
{
    return BvhdPairs(bvhdAdd(a[0], bvhdMultiply(t, b[0])), bvhdAdd(a[1], bvhdMultiply(t, b[1])),
                     bvhdAdd(a[2], bvhdMultiply(t, b[2])));
}

// The square root; 0 of numbers that are not positive.
vec2 bvhdRoot(vec2 a)
{
    if (!(a.x > 0.0))
        return vec2(0.0);
    precise float root = sqrt(a.x);
    vec2 rest = bvhdAdd(a, -bvhdProduct(root, root));
    precise float correction = rest.x / (2.0 * root);
    return bvhdSumOrdered(root, correction);
}

/* ---- The exact test ---- */

// The ray's direction d and d.d; o is its origin relative to a centre. Returns whether the line meets the sphere, and
// where it enters.
bool bvhdEnterBall(BvhdPairs o, BvhdPairs d, vec2 square, float radius, out vec2 t)
{
    vec2 closest = -bvhdDivide(bvhdDot(o, d), square);
    BvhdPairs f = bvhdMoved(o, closest, d);
    vec2 rest = bvhdAdd(bvhdProduct(radius, radius), -bvhdDot(f, f));
    t = bvhdAdd(closest, -bvhdRoot(bvhdDivide(rest, square)));
    return rest.x >= 0.0 && radius > 0.0;
}

// Which part of a linear swept sphere a ray may enter.
const int BVHD_ENTERS_FIRST = 0, BVHD_ENTERS_SECOND = 1, BVHD_ENTERS_SIDE = 2, BVHD_ENTERS_NOTHING = 3;

/*
 * Where the ray enters the cone of a linear swept sphere of which no end's sphere contains the other. A ray along the
 * axis enters it far away. If the cone's other half is met, the ray comes out of the wide end of this one.
 */
int bvhdEnterCone(BvhdPairs o, BvhdPairs d, vec2 square, BvhdPairs axis, vec2 length2, vec2 radii, out vec2 t,
                  out vec2 along)
{
    const float FAR_AWAY = 1099511627776.0;
    BvhdPairs a = bvhdCross(d, axis), b = bvhdCross(o, axis);
    vec2 slope = bvhdSum(radii.x, -radii.y), slope2 = bvhdMultiply(slope, slope);
    vec2 first = bvhdMultiply(vec2(radii.x, 0.0), slope), speed = bvhdDot(d, axis), place = bvhdDot(o, axis);
    vec2 first2 = bvhdMultiply(bvhdProduct(radii.x, radii.x), length2);
    vec2 k2 = bvhdAdd(bvhdDot(a, a), -bvhdMultiply(slope2, square));
    vec2 k1 = bvhdAdd(bvhdAdd(bvhdDot(a, b), -bvhdMultiply(slope2, bvhdDot(o, d))), bvhdMultiply(first, speed));
    vec2 k0 = bvhdAdd(bvhdAdd(bvhdDot(b, b), -bvhdMultiply(slope2, bvhdDot(o, o))),
                      bvhdAdd(2.0 * bvhdMultiply(first, place), -first2));
    vec2 inside = bvhdAdd(bvhdMultiply(k1, k1), -bvhdMultiply(k0, k2)), root = bvhdRoot(inside);
    if (inside.x < 0.0)
        return BVHD_ENTERS_NOTHING;
    vec2 divisor = k1.x < 0.0 ? bvhdAdd(root, -k1) : k2, dividend = k1.x < 0.0 ? k0 : -bvhdAdd(root, k1);
    bool isFar = abs(dividend.x) >= FAR_AWAY * abs(divisor.x);
    bool isBehind = divisor.x == 0.0 || (dividend.x < 0.0) != (divisor.x < 0.0);
    t = isFar ? vec2(isBehind ? -FAR_AWAY : FAR_AWAY, 0.0) : bvhdDivide(dividend, divisor);
    along = bvhdAdd(place, bvhdMultiply(t, speed));
    vec2 last = bvhdAdd(length2, bvhdMultiply(vec2(radii.y, 0.0), slope));
    if (bvhdAdd(bvhdMultiply(vec2(radii.x, 0.0), length2), -bvhdMultiply(slope, along)).x < 0.0)
        return slope.x > 0.0 ? BVHD_ENTERS_FIRST : BVHD_ENTERS_SECOND;
    if (bvhdAdd(along, -first).x < 0.0)
        return BVHD_ENTERS_FIRST;
    return bvhdAdd(along, -last).x > 0.0 ? BVHD_ENTERS_SECOND : BVHD_ENTERS_SIDE;
}

// A linear swept sphere; o is relative to the first centre. hasCaps: of the first end, of the second.
bool bvhdEnterSwept(BvhdPairs o, BvhdPairs d, vec2 square, BvhdPairs axis, vec2 radii, bvec2 hasCaps, out vec2 t,
                    out float u)
{
    vec2 slope = bvhdSum(radii.x, -radii.y), length2 = bvhdDot(axis, axis);
    vec2 span = bvhdAdd(length2, -bvhdMultiply(slope, slope));
    int part = slope.x < 0.0 ? BVHD_ENTERS_SECOND : BVHD_ENTERS_FIRST;
    vec2 along = vec2(0.0), moved = vec2(0.0);
    if (span.x > 0.0) {
        vec3 across = cross(bvhdHigh(d), bvhdHigh(axis));
        float closest = -dot(across, cross(bvhdHigh(o), bvhdHigh(axis))) / dot(across, across);
        moved.x = abs(closest) <= 16.0 ? closest : 0.0;
        o = bvhdMoved(o, moved, d);
        part = bvhdEnterCone(o, d, square, axis, length2, radii, t, along);
    }
    if (part == BVHD_ENTERS_NOTHING)
        return false;
    u = float(part);
    if (part == BVHD_ENTERS_SIDE) {
        vec2 first = bvhdMultiply(vec2(radii.x, 0.0), slope);
        u = clamp(bvhdDivide(bvhdAdd(along, -first), span).x, 0.0, 1.0);
    } else {
        bool isSecond = part == BVHD_ENTERS_SECOND;
        BvhdPairs from = bvhdMoved(o, vec2(isSecond ? -1.0 : 0.0, 0.0), axis);
        if (!(isSecond ? hasCaps.y : hasCaps.x) || !bvhdEnterBall(from, d, square, isSecond ? radii.y : radii.x, t))
            return false;
    }
    t = bvhdAdd(t, moved);
    return true;
}

// Whether the line of the ray passes closer to the second centre than to the first.
bool bvhdIsSecondCloser(BvhdTriangleRay ray, vec4 ends[2])
{
    vec3 unit = ray.direction * inversesqrt(dot(ray.direction, ray.direction));
    vec3 first = cross(ends[0].xyz - ray.origin, unit), second = cross(ends[1].xyz - ray.origin, unit);
    return dot(second, second) < dot(first, first);
}

/*
 * Returns whether the line of the ray enters the sphere or linear swept sphere from outside, at any t, also behind the
 * origin. Shapes that are not finite, or have no radius, are never hit. Powers of two bring the shape's size and the
 * direction near 1: the errors of products must not underflow. All is relative to the end that the line passes closer
 * to, because the terms, and so their errors, grow with the distance from it.
 */
bool bvhdRoundHit(BvhdTriangleRay ray, vec4 ends[2], bool isSwept, bvec2 hasCaps, out BvhdRoundHit hit)
{
    vec3 way = abs(ends[1].xyz - ends[0].xyz), speeds = abs(ray.direction);
    float size = max(max(max(way.x, way.y), way.z), max(ends[0].w, ends[1].w));
    uint exponent = floatBitsToUint(size) & 0x7f800000u;
    uint speed = floatBitsToUint(max(max(speeds.x, speeds.y), speeds.z)) & 0x7f800000u;
    if (exponent == 0u || exponent == 0x7f800000u || !(max(ends[0].w, ends[1].w) > 0.0))
        return false;
    float scale = uintBitsToFloat(0x7f000000u - exponent), slow = uintBitsToFloat(0x7f000000u - speed);
    bool isTurned = bvhdIsSecondCloser(ray, ends);
    vec4 from = isTurned ? ends[1] : ends[0], to = isTurned ? ends[0] : ends[1];
    vec2 x = bvhdAdd(bvhdSum(ray.origin.x, -from.x), vec2(ray.originLow.x, 0.0));
    vec2 y = bvhdAdd(bvhdSum(ray.origin.y, -from.y), vec2(ray.originLow.y, 0.0));
    vec2 z = bvhdAdd(bvhdSum(ray.origin.z, -from.z), vec2(ray.originLow.z, 0.0));
    BvhdPairs o = BvhdPairs(x, y, z) * scale, d = bvhdPairs(ray.direction, ray.directionLow) * slow;
    vec2 square = bvhdDot(d, d), moved = vec2(-dot(bvhdHigh(o), bvhdHigh(d)) / square.x, 0.0);
    o = bvhdMoved(o, moved, d);
    hit.u = 0.0;
    if (isSwept) {
        BvhdPairs axis = BvhdPairs(bvhdSum(to.x, -from.x), bvhdSum(to.y, -from.y), bvhdSum(to.z, -from.z)) * scale;
        if (!bvhdEnterSwept(o, d, square, axis, vec2(from.w, to.w) * scale, isTurned ? hasCaps.yx : hasCaps, hit.t,
                            hit.u))
            return false;
        hit.u = isTurned ? 1.0 - hit.u : hit.u;
    } else if (!bvhdEnterBall(o, d, square, from.w * scale, hit.t)) {
        return false;
    }
    hit.t = bvhdAdd(hit.t, moved) * slow * uintBitsToFloat(exponent);
    return true;
}

#endif
