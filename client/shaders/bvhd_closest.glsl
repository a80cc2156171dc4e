// SPDX-License-Identifier: Apache-2.0
/*
 * bvhd_closest.glsl - finds the closest triangle for rays without flags, with the answers of bvhd_ray_query.glsl.
 *
 * Triangles are tested in float with error bounds. A triangle that is certainly hit is kept with bounds on its t; one
 * that is neither certainly hit nor certainly missed is undecided, and goes to a list in memory. After traversal the
 * undecided triangles are resolved exactly (bvhd_closest_resolve.glsl), by another kernel where possible: exact tests
 * inside the traversal loops would need registers in all of them.
 *
 * The state is in private variables: there is one ray for each invocation.
 */
#ifndef BVHD_CLOSEST_GLSL
#define BVHD_CLOSEST_GLSL

const uint NONE = 0xffffffffu;
const uint FIRST_INNER = 0x01000000u; // a group of nodes is not empty if its hits are at least this

uvec2 stack[66];

// The ray in the space of the structure that it is in.
vec3 origin, direction, inverse;
float box_margin; // length by which boxes are enlarged (box_error)
float volume_error, volume_shift; // terms of test_triangle's error bound
float origin_low; // error bound of the origin's components
float tmin;
uint order; // set_order's masks in bits 23 .. 0; the ray's cull mask in bits 31 .. 24
uint content, node_rows, record_rows, vertex_words; // of the current structure; content is used in bottom levels
uint instance; // record in the top level; NONE while the ray is in the root
uvec2 nodes; // a group: first child; hits in bits 31 .. 24, inner mask in bits 7 .. 0
uvec2 records, postponed; // groups of records that have to be tested: first record; hits
int top, level_bottom; // of the stack; where the current structure's entries begin

// The root's sections, for leave_instance.
uint root_nodes, root_records;
#if defined REFILL && !defined COOPERATIVE
#define KEEPS_WORLD
// The ray in world space, for leave_instance. Shared memory is faster to read than the ray's buffer: lanes leave
// instances at different times, and the whole subgroup waits for each. world_inverses has box_margin in w.
shared vec4 world_origins[gl_WorkGroupSize.x], world_directions[gl_WorkGroupSize.x];
shared vec4 world_inverses[gl_WorkGroupSize.x];
shared uint world_orders[gl_WorkGroupSize.x];
#else
float root_box_margin;
#endif

// The closest hit so far; its t is in [low, high].
float low, high;
uint best, best_instance, best_id;
bool best_is_front;
uint index; // of the ray in the buffer

// The last entry of the ray's list of undecided triangles, NONE for an empty list. An entry that does not exist, such
// as FALLBACK, means that the ray is left to the query (bvhd_trace_query.comp).
uint last_undecided;
const uint FALLBACK = 0xfffffffeu;

bool needs_fallback()
{
    return last_undecided != NONE && last_undecided >= undecided_room();
}

bool is_top()
{
    return has_instances && instance == NONE;
}

bool is_indexed()
{
    return (content_of_bottoms == NONE ? content : content_of_bottoms) == BVHD_CONTENT_INDEXED_TRIANGLES;
}

// Converts a location (an address; an offset where scene_base is 0) to an offset in the scene's buffer.
uvec2 offset_of(uvec2 location)
{
    uint borrow;
    uint lower = usubBorrow(location.x, scene_base.x, borrow);
    return uvec2(lower, location.y - scene_base.y - borrow);
}

BvhdBody open_body(uvec2 location)
{
    BvhdExtent unused;
    return bvhdBodyOpen(offset_of(location), unused);
}

// Sets three masks of the slots that are in the nearer half of a node: along the axis of the ray's largest direction
// component in bits 23 .. 16, along the second one in bits 15 .. 8, and along the smallest one in bits 7 .. 0.
void set_order()
{
    vec3 size = abs(inverse);
    uint y_over_x = size.x > size.y ? 8u : 0u, z_over_x = size.x > size.z ? 8u : 0u,
         z_over_y = size.y > size.z ? 8u : 0u;
    uint x = (inverse.x < 0.0 ? 0xaau : 0x55u) << (16u - y_over_x - z_over_x), y = (inverse.y < 0.0 ? 0xccu : 0x33u)
                                                                                   << (8u + y_over_x - z_over_y);
    order = order & 0xff000000u | x | y | (inverse.z < 0.0 ? 0xf0u : 0x0fu) << (z_over_x + z_over_y);
}

/*
 * Bounds how far a structure's points may be from the ray's origin and from 0, as a length and as a t. Steps are
 * multiplied by 2^24 (step_of), and are not larger than the coordinates (vulkan_contents.c checks it): the products
 * have to be finite floats. So have the volumes of test_triangle, which are at most 24 times the product of two ways
 * and of a way or the direction: LARGEST bounds the components of all of them. Rays beyond a bound are left to the
 * query.
 */
const float FARTHEST = 1.0e31, LARGEST = 1.0995116e12;

// The data with which a ray enters a structure.
struct Entry {
    vec3 inverse;
    float box_margin, direction_low;
    BvhdBody body;
    bool can_hit;
};

// The inverse direction. Components below 2^-30 of the longest one are replaced by that, as in bvhdBoxRayInit.
vec3 inverse_of(vec3 towards, float longest)
{
    vec3 moving = max(abs(towards), vec3(9.3132257e-10 * longest));
    return 1.0 / mix(moving, -moving, lessThan(towards, vec3(0.0)));
}

// The error bound of the t at which the ray meets a plane, `offset`. The last term covers underflow.
vec3 box_error(vec3 offset)
{
    return abs(offset) * 9.5367432e-7 + (abs(inverse) * box_margin + 3.0092656e-36);
}

/*
 * Prepares to enter a structure. box_margin is at least bvhdBoxRayInit's slack along every axis, because |inverse| *
 * 2^-29 * longest is 2 where the ray hardly moves and at least 2^-29 elsewhere; it also covers how far a direction with
 * an error of `low_direction` moves the ray within the structure. Rays that miss the structure's bounds do not enter
 * it, so nothing has to be saved for them.
 */
Entry entry_of(uvec2 location, vec3 from, vec3 towards, float low_origin, float low_direction)
{
    Entry entry;
    BvhdExtent extent;
    entry.body = bvhdBodyOpen(offset_of(location), extent);
    float longest = bvhdLargest(towards),
          farthest = max(bvhdLargest(extent.lowest - from), bvhdLargest(extent.highest - from));
    entry.direction_low = low_direction;
    entry.inverse = inverse_of(towards, longest);
    entry.box_margin = 1.001 * (low_origin + farthest / longest * low_direction + 1.8626452e-9 * farthest) + 1.6e-36;
    vec3 a = (extent.lowest - from) * entry.inverse, b = (extent.highest - from) * entry.inverse;
    vec3 error = max(abs(a), abs(b)) * 9.5367432e-7 + (abs(entry.inverse) * entry.box_margin + 3.0092656e-36);
    vec3 near = min(a, b) - error, far = max(a, b) + error;
    bool is_met = max(max(near.x, near.y), max(near.z, tmin)) <= min(min(far.x, far.y), min(far.z, high));
    entry.can_hit = longest > 0.0 && bvhdIsFinite(from) && bvhdIsFinite(towards) && !extent.isEmpty;
    float reach = max(farthest, max(bvhdLargest(extent.lowest), bvhdLargest(extent.highest)));
    if (entry.can_hit &&
        (reach * max(bvhdLargest(entry.inverse), 1.0) > FARTHEST || max(reach, longest) > LARGEST))
        last_undecided = FALLBACK;
    entry.can_hit = entry.can_hit && is_met && last_undecided != FALLBACK;
    return entry;
}

// Enters a structure. Origin and direction have already been transformed to its space.
void enter(Entry entry)
{
    content = entry.body.content;
    node_rows = entry.body.nodes;
    record_rows = entry.body.records;
    vertex_words = entry.body.vertices;
    inverse = entry.inverse;
    box_margin = entry.box_margin;
    float size = 1.001 * length(direction);
    volume_error = 1.2283e-6 * size + 3.5 * entry.direction_low;
    volume_shift = 3.5 * size * origin_low + 1e-36;
    set_order();
    level_bottom = top;
    nodes = uvec2(0u, entry.can_hit ? FIRST_INNER | 1u : 0u);
    records = uvec2(0u);
}

void keep_world()
{
#ifdef KEEPS_WORLD
    uint own = gl_LocalInvocationIndex;
    if (!has_instances)
        return;
    world_origins[own] = vec4(origin, 0.0);
    world_directions[own] = vec4(direction, 0.0);
    world_inverses[own] = vec4(inverse, box_margin);
    world_orders[own] = order;
#else
    root_box_margin = box_margin;
#endif
}

void enter_world()
{
#ifdef KEEPS_WORLD
    uint own = gl_LocalInvocationIndex;
    origin = world_origins[own].xyz;
    direction = world_directions[own].xyz;
    inverse = world_inverses[own].xyz;
    box_margin = world_inverses[own].w;
    order = world_orders[own];
#else
    BvhdRay ray = rays[index];
    origin = ray.origin.xyz;
    direction = ray.direction.xyz;
    inverse = inverse_of(direction, bvhdLargest(direction));
    box_margin = root_box_margin;
    set_order();
#endif
    origin_low = 0.0;
}

void start()
{
    BvhdRay ray = rays[index];
    origin = ray.origin.xyz;
    direction = ray.direction.xyz;
    tmin = ray.origin.w;
    high = low = ray.direction.w;
    origin_low = 0.0;
    best = best_id = best_instance = instance = NONE;
    last_undecided = NONE;
    postponed = uvec2(0u);
    top = 0;
    order = has_instances ? ray.flags.y << 24 : 0u;
    enter(entry_of(extra, origin, direction, 0.0, 0.0));
    root_nodes = node_rows;
    root_records = record_rows;
    keep_world();
    if (!(tmin >= 0.0 && tmin <= high))
        nodes.y = 0u;
}

void leave_instance()
{
    top = level_bottom;
    records = stack[--top];
    nodes = stack[--top];
    enter_world();
    node_rows = root_nodes;
    record_rows = root_records;
    instance = NONE;
    level_bottom = 0;
}

/*
 * Enters an instance's bottom level, with the ray transformed to object space in float. With u = 2^-24, the difference
 * has a relative error of u, each entry of the inverse matrix one of u, each product and sum another u, and the matrix
 * itself is not more accurate than that: 12u times the sum of the absolute terms is a bound. All rows are loaded before
 * any of them is used.
 */
void visit_instance(uint record)
{
    uint row = record_rows + 8u * record;
    uvec4 m0 = BVHD_STORAGE_ROWS[row], m1 = BVHD_STORAGE_ROWS[row + 1u], m2 = BVHD_STORAGE_ROWS[row + 2u];
    uvec4 i0 = BVHD_STORAGE_ROWS[row + 3u], i1 = BVHD_STORAGE_ROWS[row + 4u], i2 = BVHD_STORAGE_ROWS[row + 5u];
    uvec4 words = BVHD_STORAGE_ROWS[row + 6u];
    uvec2 bottom = BVHD_STORAGE_ROWS[row + 7u].xy;
    vec3 place = uintBitsToFloat(uvec3(m0.w, m1.w, m2.w));
    mat3 rows = mat3(uintBitsToFloat(i0.xyz), uintBitsToFloat(i1.xyz), uintBitsToFloat(i2.xyz));
    if (((words.x & order) >> 24) == 0u || bottom == BVHD_NO_LOCATION)
        return;
    vec3 from = origin - place;
    mat3 size = mat3(abs(rows[0]), abs(rows[1]), abs(rows[2]));
    float low_origin = 7.1525574e-7 * bvhdLargest(abs(from) * size),
          low_direction = 7.1525574e-7 * bvhdLargest(abs(direction) * size);
    from = from * rows;
    vec3 towards = direction * rows;
    Entry entry = entry_of(bottom, from, towards, low_origin, low_direction);
    if (!entry.can_hit)
        return;
    stack[top++] = nodes;
    stack[top++] = records;
    origin = from;
    direction = towards;
    origin_low = low_origin;
    instance = record;
    enter(entry);
}

/*
 * Converts four bytes to floats, each times 2^-24: that is the value of a byte's bits as a half. These halves are
 * denormal. With `plain_bytes`, for devices that flush them to 0 or are faster without, bytes are converted by their
 * own value. bvhd_box.glsl sets exponent bits instead, which takes 24 operations more for each node.
 */
vec4 widen(uint bytes)
{
    if (plain_bytes)
        return vec4(uvec4(bytes, bytes >> 8, bytes >> 16, bytes >> 24) & 255u);
    vec2 even = unpackHalf2x16(bytes & 0x00ff00ffu), odd = unpackHalf2x16(bytes >> 8 & 0x00ff00ffu);
    return vec4(even.x, odd.x, even.y, odd.y);
}

// The steps of these exponents, 8 bits each, as factors for what widen returns: without `plain_bytes` times 2^24.
vec3 step_of(uint exponents)
{
    return uintBitsToFloat(uvec3(exponents << 23, exponents << 15, exponents << 7) + (plain_bytes ? 0u : 24u << 23) &
                           0x7f800000u);
}

#define AS_INT floatBitsToInt

/*
 * Tests four children. Shifts four bits into `missed`, that of the last slot first: 1 where the ray misses the child.
 * Floats are compared as integers, which is correct because tmin is not negative; the sign of far - near says whether
 * the interval is empty.
 */
void test_slots(uvec3 near_bytes, uvec3 far_bytes, vec3 scale, vec3 first, vec3 last, inout uint missed)
{
    ivec4 near =
        max(max(AS_INT(widen(near_bytes.x) * scale.x + first.x), AS_INT(widen(near_bytes.y) * scale.y + first.y)),
            max(AS_INT(widen(near_bytes.z) * scale.z + first.z), ivec4(AS_INT(tmin))));
    ivec4 far = min(min(AS_INT(widen(far_bytes.x) * scale.x + last.x), AS_INT(widen(far_bytes.y) * scale.y + last.y)),
                    min(AS_INT(widen(far_bytes.z) * scale.z + last.z), ivec4(AS_INT(high))));
    uvec4 between = floatBitsToUint(intBitsToFloat(far) - intBitsToFloat(near));
    missed = missed << 1 | between.w >> 31;
    missed = missed << 1 | between.z >> 31;
    missed = missed << 1 | between.y >> 31;
    missed = missed << 1 | between.x >> 31;
}

// The hit records of the leaves in these slots. Meta bytes of other slots are set to 0, which stands for no record.
uint records_of(uint leaves, uvec2 meta)
{
    if (leaves == 0u)
        return 0u;
    uvec2 slots = uvec2(leaves, leaves >> 4) & 15u, ones = slots * 0x00204081u & 0x01010101u,
          packed = meta & ones * 255u;
    uvec4 a = uvec4(packed.x, packed.x >> 8, packed.x >> 16, packed.x >> 24) & 255u;
    uvec4 b = uvec4(packed.y, packed.y >> 8, packed.y >> 16, packed.y >> 24) & 255u;
    a = a >> 5 << (a & 31u);
    b = b >> 5 << (b & 31u);
    return a.x | a.y | a.z | a.w | b.x | b.y | b.z | b.w;
}

// Takes the nearest child out of the group, which is not empty, and pushes the rest of the group.
uint next_child()
{
    uint slots = nodes.y & 0xff000000u, nearer = slots & order << 8;
    slots = nearer != 0u ? nearer : slots;
    nearer = slots & order << 16;
    slots = nearer != 0u ? nearer : slots;
    nearer = slots & order << 24;
    slots = nearer != 0u ? nearer : slots;
    uint slot = slots & -slots;
    nodes.y ^= slot;
    if (nodes.y >= FIRST_INNER)
        stack[top++] = nodes;
    return nodes.x + uint(bitCount(nodes.y & ((slot >> 24) - 1u)));
}

// Tests the children of the next node. bvhd_box.glsl derives the error bounds.
void visit_node()
{
    uint row = node_rows + 5u * next_child();
    uvec4 head = BVHD_STORAGE_ROWS[row], meta = BVHD_STORAGE_ROWS[row + 1u];
    uvec4 planes0 = BVHD_STORAGE_ROWS[row + 2u], planes1 = BVHD_STORAGE_ROWS[row + 3u],
          planes2 = BVHD_STORAGE_ROWS[row + 4u];
    vec3 offset = (uintBitsToFloat(head.xyz) - origin) * inverse, error = box_error(offset),
         scale = step_of(head.w) * inverse;
    bvec3 is_negative = lessThan(inverse, vec3(0.0));
    uvec3 low0 = uvec3(planes0.xz, planes1.x), low1 = uvec3(planes0.yw, planes1.y);
    uvec3 high0 = uvec3(planes1.z, planes2.xz), high1 = uvec3(planes1.w, planes2.yw);
    uint missed = 0u;
    test_slots(mix(low1, high1, is_negative), mix(high1, low1, is_negative), scale, offset - error, offset + error,
               missed);
    test_slots(mix(low0, high0, is_negative), mix(high0, low0, is_negative), scale, offset - error, offset + error,
               missed);
    uint inner = head.w >> 24;
    nodes = uvec2(meta.x, (inner & ~missed) << 24 | inner);
    records = uvec2(meta.y, records_of(~missed & ~inner & 255u, meta.zw));
}

uint corners_of(uint record, out vec3 v0, out vec3 v1, out vec3 v2)
{
    if (is_indexed()) {
        uvec4 row = BVHD_STORAGE_ROWS[record_rows + record];
        uvec3 word = row.xyz * 3u + vertex_words;
        v0 = uintBitsToFloat(
            uvec3(BVHD_STORAGE_WORDS[word.x], BVHD_STORAGE_WORDS[word.x + 1u], BVHD_STORAGE_WORDS[word.x + 2u]));
        v1 = uintBitsToFloat(
            uvec3(BVHD_STORAGE_WORDS[word.y], BVHD_STORAGE_WORDS[word.y + 1u], BVHD_STORAGE_WORDS[word.y + 2u]));
        v2 = uintBitsToFloat(
            uvec3(BVHD_STORAGE_WORDS[word.z], BVHD_STORAGE_WORDS[word.z + 1u], BVHD_STORAGE_WORDS[word.z + 2u]));
        return row.w;
    }
    uint row = record_rows + 3u * record;
    uvec4 first = BVHD_STORAGE_ROWS[row];
    v0 = uintBitsToFloat(first.xyz);
    v1 = uintBitsToFloat(BVHD_STORAGE_ROWS[row + 1u].xyz);
    v2 = uintBitsToFloat(BVHD_STORAGE_ROWS[row + 2u].xyz);
    return first.w;
}

// Appends an undecided triangle to the ray's list. A ray that has found no room once does not count any more, so that
// the counter cannot wrap around.
void put_undecided(uint record, float nearest)
{
    if (needs_fallback())
        return;
    uint row = atomicAdd(undecided_count, 1u);
    if (row < undecided_room())
        work_rows[first_undecided() + row] = uvec4(record, instance, floatBitsToUint(nearest), last_undecided);
    last_undecided = row;
}

// The squared length; 1e-37 covers underflow.
float square(vec3 a)
{
    return a.x * a.x + (a.y * a.y + (a.z * a.z + 1e-37));
}

/*
 * An upper bound of the longer vector's length. Sums of absolute components take fewer operations and leave more
 * triangles undecided, which pays for rays that meet many triangles.
 */
float longer_length(vec3 a, vec3 b)
{
#ifdef REFILL
    return max(bvhdSumOfSizes(a), bvhdSumOfSizes(b));
#else
    return sqrt(max(square(a), square(b)));
#endif
}

// The ray that triangles are tested against, in the structure's space.
struct TestRay {
    vec3 origin, direction;
    float volume_error, tmin, low, high;
};

// The result of a test. The hit's t is in [near, far]; far is infinite for undecided triangles.
struct TestOutcome {
    uint kind;
    float near, far;
    uint id;
    bool is_front;
};
const uint IS_MISSED = 0u, IS_CLOSER = 1u, IS_UNDECIDED = 2u;

void accept(TestOutcome outcome, uint record)
{
    low = outcome.near;
    high = outcome.far;
    best = record;
    best_instance = instance;
    best_id = outcome.id;
    best_is_front = outcome.is_front;
}

void keep_undecided(TestOutcome outcome, uint record)
{
    if (outcome.id != best_id || instance != best_instance)
        put_undecided(record, outcome.near);
}

/*
 * Tests a triangle by the volumes that the ray spans with the edges from v0. Error bounds, with u = 2^-24, s the
 * distance of the origin from v0, d the direction's length and e the longer edge: a difference has a relative error of
 * u, a component of a cross product 3u of the sum of its two absolute products, a volume 7u of the sum of its six,
 * which is at most 1.155 s d e. The third volume, det - u - v, has at most the sum of the errors of these three and 2u
 * of each: 20.2u d e (s + e) covers it. An error o of the origin adds at most 3.5 d e o, an error l of the direction at
 * most 3.5 l e (s + e).
 *
 * t: each component of the normal has an error of 4u of the sum of its two absolute products, `spread`, and the sums
 * that use the normal have 8u of their value with `spread` in its place. So t is nearly exact on a large floor along
 * the axes that rays start from.
 *
 * `is_own`: the ray is this lane's own, so the outcome is applied to it at once.
 */
void test_triangle(TestRay ray, uint record, bool is_own, out TestOutcome outcome)
{
    vec3 v0, v1, v2;
    outcome = TestOutcome(IS_MISSED, 0.0, 0.0, 0u, false);
    uint id = corners_of(record, v0, v1, v2);
    vec3 e1 = v1 - v0, e2 = v2 - v0, s = ray.origin - v0;
    vec3 across = cross(s, ray.direction), normal = cross(e1, e2);
    float det = -dot(ray.direction, normal), u = dot(e2, across), v = -dot(e1, across), rest = det - u - v;
    float edge = longer_length(e1, e2);
    float error = edge * (ray.volume_error * (longer_length(s, s) + edge) + volume_shift) + 3.0e-35;
    float least = min(min(u, v), rest), most = max(max(u, v), rest);
    if (least < -error && most > error)
        return;

    vec3 spread = abs(e1.yzx * e2.zxy) + abs(e1.zxy * e2.yzx);
    float spreads = spread.x + spread.y + spread.z;
    float direction_low = has_instances ? 0.29 * ray.volume_error : 0.0;
    float size = abs(det),
          size_error = 7.1525574e-7 * dot(abs(ray.direction), spread) + 1.001 * direction_low * spreads + 3.0e-35;
    float distance = det < 0.0 ? -dot(s, normal) : dot(s, normal);
    float distance_error = 1.001 * origin_low * spreads + 7.1525574e-7 * dot(abs(s), spread) + 3.0e-35;
    float scale = 1.0 / max(size, 1e-37), t = distance * scale;
    float wrong = 1.25 * scale * (distance_error + abs(t) * size_error) + 2.4e-7 * abs(t);
    bool is_steep = size > 16.0 * size_error;
    if (is_steep && (t - wrong > ray.high || t + wrong < ray.tmin))
        return;
    if (is_steep && (least > error || most < -error) && t - wrong > ray.tmin && t + wrong < ray.low) {
        outcome = TestOutcome(IS_CLOSER, t - wrong, t + wrong, id, det > 0.0);
        if (is_own)
            accept(outcome, record);
        return;
    }
    outcome = TestOutcome(IS_UNDECIDED, is_steep ? t - wrong : -3.0e38, INFINITY, id, false);
    if (is_own)
        keep_undecided(outcome, record);
}

void visit_triangle(uint record)
{
    TestOutcome unused;
    test_triangle(TestRay(origin, direction, volume_error, tmin, low, high), record, true, unused);
}

uint take_record(inout uvec2 group)
{
    uint record = group.x + uint(findLSB(group.y));
    group.y &= group.y - 1u;
    return record;
}

// Continues with what is on the stack, or leaves the instance. Returns false when traversal is complete.
bool pop_or_leave()
{
    if (top != level_bottom) {
        nodes = stack[--top];
        return true;
    }
    if (!has_instances || instance == NONE)
        return false;
    leave_instance();
    return true;
}

#endif
