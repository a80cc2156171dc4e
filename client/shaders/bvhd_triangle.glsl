// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_triangle.glsl - the watertight ray-triangle test, with nearly the accuracy of doubles but without float64.
 *
 * It has two parts. bvhdTriangleMayHit is cheap: it computes in float with error bounds, drops triangles that are
 * certainly missed, and recognises those that are certainly hit, with bounds on their distance. bvhdTriangleHit decides
 * the others, and computes the exact hit: for about one triangle of each ray.
 *
 * bvhdTriangleHit is Woop's test (2013) in pairs of floats. Vertices are moved so that the ray starts at the origin,
 * and sheared so that it runs along its main axis, with an accuracy of about 2^-44; then the two coordinates across the
 * ray are rounded to float. That shifts a vertex by at most half an ulp of its distance from the ray, which is less
 * than the accuracy of the ray itself, and by the same shift for all triangles that share it. The edge functions of the
 * rounded positions have exact signs: the difference of two products is compared with the products' rounding errors. An
 * edge function that is 0 takes its sign from the edge's direction, as if the ray were moved by (e, e * e) for an
 * infinitely small e. So exactly one of the triangles around an edge or a closed fan is hit: no ray slips through, none
 * hits twice. t and the barycentrics are computed from the pairs and rounded once.
 *
 * Rounding errors of products are computed by splitting factors into halves, which needs no fused operation. Where
 * fma() is known to round once, as on most GPUs, BVHD_FUSED_FMA true is faster and gives the same answers. Vulkan does
 * not guarantee it, and lavapipe rounds twice: there distances would lose their last bits and rays would leak through
 * edges.
 */
#ifndef BVHD_TRIANGLE_GLSL
#define BVHD_TRIANGLE_GLSL

#ifndef BVHD_FUSED_FMA
#define BVHD_FUSED_FMA false
#endif

/* ---- Pairs: the number x + y, with y at most half an ulp of x ---- */

vec2 bvhdSum(float a, float b)
{
    precise float sum = a + b;
    precise float part = sum - a;
    precise float error = (a - (sum - part)) + (b - part);
    return vec2(sum, error);
}

// bvhdSum for |a| >= |b| or a == 0.
vec2 bvhdSumOrdered(float a, float b)
{
    precise float sum = a + b;
    precise float error = b - (sum - a);
    return vec2(sum, error);
}

vec2 bvhdProduct(float a, float b)
{
    precise float product = a * b;
    if (BVHD_FUSED_FMA) {
        precise float fused = fma(a, b, -product);
        return vec2(product, fused);
    }
    precise float aHigh = uintBitsToFloat(floatBitsToUint(a) & 0xfffff000u);
    precise float bHigh = uintBitsToFloat(floatBitsToUint(b) & 0xfffff000u);
    precise float aLow = a - aHigh;
    precise float bLow = b - bHigh;
    precise float error = ((aHigh * bHigh - product) + aHigh * bLow + aLow * bHigh) + aLow * bLow;
    return vec2(product, error);
}

vec2 bvhdAdd(vec2 a, vec2 b)
{
    vec2 sum = bvhdSum(a.x, b.x);
    precise float low = sum.y + (a.y + b.y);
    return bvhdSumOrdered(sum.x, low);
}

vec2 bvhdMultiply(vec2 a, vec2 b)
{
    vec2 product = bvhdProduct(a.x, b.x);
    precise float low = product.y + (a.x * b.y + a.y * b.x);
    return bvhdSumOrdered(product.x, low);
}

vec2 bvhdDivide(vec2 a, vec2 b)
{
    precise float quotient = a.x / b.x;
    vec2 rest = bvhdAdd(a, -bvhdMultiply(vec2(quotient, 0.0), b));
    precise float correction = rest.x / b.x;
    return bvhdSumOrdered(quotient, correction);
}

/* ---- Rays ---- */

// A ray in an object's space, as pairs: the low halves are not 0 for rays in instances.
struct BvhdTriangleRay {
    vec3 origin, direction;
    vec3 originLow, directionLow;
    bool isLarge; // bvhdIsLarge of the structure that it is in
};

struct BvhdTriangleHit {
    vec2 t; // a pair
    vec2 barycentrics;
    bool isFront; // (v1 - v0) x (v2 - v0) points against the ray
};

/* ---- The float test ---- */

/*
 * Whether products of the float tests could overflow for primitives within these bounds. Compilers may assume that
 * nothing is infinite or NaN, so that a test whose products are could drop what is hit. With f the largest component of
 * the way from the origin to a point of the structure, and D that of the direction, components of edges are at most 2 f
 * and volumes at most 24 f * f * max(f, D), which has to be below 2^127.
 */
bool bvhdIsLarge(vec3 origin, vec3 direction, BvhdExtent extent)
{
    float farthest = max(bvhdLargest(extent.lowest - origin), bvhdLargest(extent.highest - origin));
    return max(farthest, bvhdLargest(direction)) > 1.0995116e12;
}

float bvhdSumOfSizes(vec3 value)
{
    return abs(value.x) + abs(value.y) + abs(value.z);
}

struct BvhdTriangleGuess {
    bool isSure; // it is certainly hit, at a t in [t - error, t + error]; otherwise bvhdTriangleHit has to decide
    float t, error;
    bool isFront;
};

/*
 * Möller and Trumbore's test (1997) with error bounds. Let D be the longest component of d, S and E the sums of the
 * absolute components of s and of both edges, u = 2^-24 and l the rounding error of the origin. Each component of d x e
 * has an error of at most 4u D E, a volume one of 8u D E S + 3 l D E, and the third one the sum of all. So (12u (S + E)
 * + 4 l) D E covers them and the shift of vertices in bvhdTriangleHit; with E * E for D E it covers the numerator of t.
 * The last term covers underflow. Returns false when the triangle is missed, or not within tmin .. tmax. In a large
 * structure bvhdTriangleHit decides every triangle.
 */
bool bvhdTriangleMayHit(BvhdTriangleRay ray, float tmin, float tmax, vec3 v0, vec3 v1, vec3 v2,
                        out BvhdTriangleGuess guess)
{
    guess = BvhdTriangleGuess(false, 0.0, 0.0, false);
    if (ray.isLarge)
        return true;
    vec3 e1 = v1 - v0, e2 = v2 - v0, s = ray.origin - v0;
    vec3 p = cross(ray.direction, e2), q = cross(s, e1);
    float det = dot(e1, p), u = dot(s, p), v = dot(ray.direction, q);
    float w = det - u - v;

    float longest = max(max(abs(ray.direction.x), abs(ray.direction.y)), abs(ray.direction.z));
    float low = max(max(abs(ray.originLow.x), abs(ray.originLow.y)), abs(ray.originLow.z));
    float edges = bvhdSumOfSizes(e1) + bvhdSumOfSizes(e2);
    float share = edges * (7.1525574e-7 * (bvhdSumOfSizes(s) + edges) + 4.0 * low);
    float error = longest * share + 3.0e-35;
    float least = min(min(u, v), w), most = max(max(u, v), w);
    if (least < -error && most > error)
        return false;

    float distance = det < 0.0 ? -dot(e2, q) : dot(e2, q), size = abs(det), distanceError = edges * share + 3.0e-35;
    if (distance - distanceError > 1.000001 * tmax * (size + error))
        return false;
    if (size > error && distance + distanceError < 0.999999 * tmin * (size - error))
        return false;

    // With |det| above 3 errors, 1 / (|det| - error) is below 1.5 / |det|.
    float inverse = 1.0 / size;
    guess.isSure = least > error || most < -error;
    guess.t = distance * inverse;
    guess.error = 1.5 * inverse * (distanceError + abs(guess.t) * error) + 1.0e-6 * abs(guess.t);
    guess.isFront = det > 0.0;
    return true;
}

/* ---- The exact test ---- */

// A vertex in the ray's space, scaled. The ray runs along z through the origin of x and y.
struct BvhdCorner {
    vec2 x, y, z; // pairs; signs are decided with x and y rounded to their first halves
};

// Reorders x, y, z so that the ray's main axis is last and the winding stays.
vec3 bvhdPermute(vec3 value, int mainAxis, bool isBackward)
{
    vec3 permuted = mainAxis == 0 ? value.yzx : mainAxis == 1 ? value.zxy : value;
    return isBackward ? permuted.yxz : permuted;
}

BvhdCorner bvhdCornerOf(vec3 vertex, vec3 origin, vec3 originLow, vec2 shearX, vec2 shearY, float scale)
{
    BvhdCorner corner;
    vec2 x = bvhdAdd(bvhdSum(vertex.x, -origin.x), vec2(-originLow.x, 0.0)) * scale;
    vec2 y = bvhdAdd(bvhdSum(vertex.y, -origin.y), vec2(-originLow.y, 0.0)) * scale;
    corner.z = bvhdAdd(bvhdSum(vertex.z, -origin.z), vec2(-originLow.z, 0.0)) * scale;
    corner.x = bvhdAdd(x, -bvhdMultiply(shearX, corner.z));
    corner.y = bvhdAdd(y, -bvhdMultiply(shearY, corner.z));
    return corner;
}

// Returns the sign of an edge function of the rounded positions, which is 0 only for an edge without length. `value` is
// that of the unrounded positions.
int bvhdEdge(BvhdCorner from, BvhdCorner to, out vec2 value)
{
    vec2 left = bvhdProduct(to.x.x, from.y.x), right = bvhdProduct(to.y.x, from.x.x);
    precise float side = (left.x - right.x) + (left.y - right.y);
    if (side == 0.0)
        side = to.y.x - from.y.x;
    if (side == 0.0)
        side = from.x.x - to.x.x;
    precise float low =
        (left.y - right.y) + ((to.x.x * from.y.y + to.x.y * from.y.x) - (to.y.x * from.x.y + to.y.y * from.x.x));
    vec2 difference = bvhdSum(left.x, -right.x);
    value = bvhdSumOrdered(difference.x, difference.y + low);
    return (side > 0.0 ? 1 : 0) - (side < 0.0 ? 1 : 0);
}

// Whether the triangle has no area. In the ray's space rounding can make an area of it.
bool bvhdIsFlat(vec3 v0, vec3 v1, vec3 v2)
{
    vec2 ax = bvhdSum(v1.x, -v0.x), ay = bvhdSum(v1.y, -v0.y), az = bvhdSum(v1.z, -v0.z);
    vec2 bx = bvhdSum(v2.x, -v0.x), by = bvhdSum(v2.y, -v0.y), bz = bvhdSum(v2.z, -v0.z);
    vec2 x = bvhdAdd(bvhdMultiply(ay, bz), -bvhdMultiply(az, by));
    vec2 y = bvhdAdd(bvhdMultiply(az, bx), -bvhdMultiply(ax, bz));
    vec2 z = bvhdAdd(bvhdMultiply(ax, by), -bvhdMultiply(ay, bx));
    return x.x == 0.0 && y.x == 0.0 && z.x == 0.0;
}

/*
 * Returns whether the line of the ray meets the triangle, at any t, also behind the origin. Triangles of zero area, and
 * those that are seen edge-on, are never hit.
 */
bool bvhdTriangleHit(BvhdTriangleRay ray, vec3 v0, vec3 v1, vec3 v2, out BvhdTriangleHit hit)
{
    vec3 size = abs(ray.direction);
    int mainAxis = size.y > size.x ? 1 : 0;
    mainAxis = size.z > max(size.x, size.y) ? 2 : mainAxis;
    bool isBackward = (mainAxis == 0 ? ray.direction.x : mainAxis == 1 ? ray.direction.y : ray.direction.z) < 0.0;

    vec3 origin = bvhdPermute(ray.origin, mainAxis, isBackward),
         originLow = bvhdPermute(ray.originLow, mainAxis, isBackward);
    vec3 direction = bvhdPermute(ray.direction, mainAxis, isBackward);
    vec3 directionLow = bvhdPermute(ray.directionLow, mainAxis, isBackward);
    vec2 along = vec2(direction.z, directionLow.z);
    vec2 shearX = bvhdDivide(vec2(direction.x, directionLow.x), along),
         shearY = bvhdDivide(vec2(direction.y, directionLow.y), along);

    // A power of two brings distances near 1: the errors of products must not underflow.
    vec3 farthest = max(max(abs(v0 - ray.origin), abs(v1 - ray.origin)), abs(v2 - ray.origin));
    uint exponent = floatBitsToUint(max(max(farthest.x, farthest.y), farthest.z)) & 0x7f800000u;
    float scale = uintBitsToFloat(0x7f000000u - exponent), unscale = uintBitsToFloat(exponent);

    BvhdCorner a = bvhdCornerOf(bvhdPermute(v0, mainAxis, isBackward), origin, originLow, shearX, shearY, scale);
    BvhdCorner b = bvhdCornerOf(bvhdPermute(v1, mainAxis, isBackward), origin, originLow, shearX, shearY, scale);
    BvhdCorner c = bvhdCornerOf(bvhdPermute(v2, mainAxis, isBackward), origin, originLow, shearX, shearY, scale);
    vec2 edgeA, edgeB, edgeC;
    int side = bvhdEdge(b, c, edgeA);
    side += bvhdEdge(c, a, edgeB);
    side += bvhdEdge(a, b, edgeC);
    if (abs(side) != 3)
        return false;

    // Rounded positions and pairs may disagree about which edge functions are 0.
    float sign = side > 0 ? 1.0 : -1.0;
    edgeA = edgeA.x * sign > 0.0 ? edgeA : vec2(0.0);
    edgeB = edgeB.x * sign > 0.0 ? edgeB : vec2(0.0);
    edgeC = edgeC.x * sign > 0.0 ? edgeC : vec2(0.0);
    vec2 sum = bvhdAdd(bvhdAdd(edgeA, edgeB), edgeC);
    float reach = bvhdSumOfSizes(vec3(a.x.x, b.x.x, c.x.x)) * bvhdSumOfSizes(vec3(a.y.x, b.y.x, c.y.x));
    if (sum.x == 0.0 || abs(sum.x) < 0.00390625 * reach && bvhdIsFlat(v0, v1, v2))
        return false;

    vec2 weighted = bvhdAdd(bvhdAdd(bvhdMultiply(edgeA, a.z), bvhdMultiply(edgeB, b.z)), bvhdMultiply(edgeC, c.z));
    hit.t = bvhdDivide(bvhdDivide(weighted, sum), along) * unscale;
    hit.barycentrics = vec2(bvhdDivide(edgeB, sum).x, bvhdDivide(edgeC, sum).x);
    hit.isFront = side > 0;
    return true;
}

#endif
