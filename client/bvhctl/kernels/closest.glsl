// SPDX-License-Identifier: Apache-2.0
/*
 * closest.glsl - the closest triangle for rays without flags. It answers as a query does (bvhd_ray_query.glsl), but asks nobody on its way: triangles
 * that are hit beyond doubt are remembered with bounds on their t, those in doubt are put by until the end, and only then are pairs of floats computed.
 *
 * State lies in private variables: one ray an invocation. closest_settle.glsl has the end.
 */
#ifndef CLOSEST_GLSL
#define CLOSEST_GLSL

const uint NONE = 0xffffffffu;
const uint FIRST_INNER = 0x01000000u; // groups of nodes have a bit of this or above, groups of records have none

uvec2 stack[66];
vec4 at_root[2]; // what leave_instance takes up again

// The ray in the space of the structure that it is in.
vec3 origin, direction, inverse, slack;
float origin_low, direction_low; // what their components may be off by
float inverse_length, tmin;
uint order; // bvhdFirstSlot's masks; the ray's mask in bits 31 .. 24
uint content, node_rows, record_rows, vertex_words;
uint instance; // record in the top level; NONE: in the root
uvec2 nodes; // first child; hits in bits 31 .. 24, inner mask in bits 7 .. 0
uvec2 records, waiting; // first record; hits. Those that wait have not been looked at either.
int top, level_bottom; // of the stack

// The answer so far: its t lies between low and high.
float low, high;
uint best, best_instance, best_id;
bool best_is_front;
uint index; // of the ray

// Triangles that only pairs of floats can decide on: record, instance, a lower bound of t.
const uint MOST_DOUBTS = 8u;
uvec3 doubts[MOST_DOUBTS];
uint doubt_count; // NONE: more than there is room for, the ray has been left to the query

// Leaves the ray to a kernel that comes after this one: to decide here and go on would make the loops keep everything that deciding takes.
void leave_ray()
{
    left[atomicAdd(left_count, 1u)] = index;
    nodes.y = records.y = waiting.y = 0u;
    top = level_bottom = 0;
    instance = NONE;
    doubt_count = NONE;
}

// Locations are addresses, or offsets where scene_base is 0; here, all of a scene is found by its rows.
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

void set_order()
{
    bvec3 is_negative = lessThan(inverse, vec3(0.0));
    order = order & 0xff000000u | (is_negative.z ? 0xf00000u : 0x0f0000u) | (is_negative.y ? 0xcc00u : 0x3300u) | (is_negative.x ? 0xaau : 0x55u);
}

// What a ray needs of a structure.
struct Entry {
    vec3 inverse, slack;
    BvhdBody body;
    bool can_hit;
};

/*
 * Slack is what bvhdBoxRayInit says, and what a direction that is off by `low_direction` moves the ray by within the structure. Rays that miss its bounds are sent away
 * here, as at a node: before anything is put by for them.
 */
Entry entry_of(uvec2 location, vec3 from, vec3 towards, vec3 low_origin, vec3 low_direction)
{
    Entry entry;
    BvhdExtent extent;
    entry.body = bvhdBodyOpen(offset_of(location), extent);
    float longest = bvhdLargest(towards);
    float reach = max(bvhdLargest(extent.lowest - from), bvhdLargest(extent.highest - from)) / longest;
    bvec3 is_parallel = lessThan(abs(towards), vec3(9.3132257e-10 * longest)), is_negative = lessThan(towards, vec3(0.0));
    vec3 moving = mix(towards, mix(vec3(9.3132257e-10 * longest), vec3(-9.3132257e-10 * longest), is_negative), is_parallel);
    entry.inverse = 1.0 / moving;
    entry.slack = 1.001 * (abs(entry.inverse) * (low_origin + reach * low_direction) + mix(vec3(9.0949470e-13), vec3(2.0), is_parallel) * reach) + 3.0092656e-36;
    vec3 a = (extent.lowest - from) * entry.inverse, b = (extent.highest - from) * entry.inverse;
    vec3 error = max(abs(a), abs(b)) * 9.5367432e-7 + entry.slack, near = min(a, b) - error, far = max(a, b) + error;
    bool is_met = max(max(near.x, near.y), max(near.z, tmin)) <= min(min(far.x, far.y), min(far.z, high));
    entry.can_hit = longest > 0.0 && bvhdIsFinite(from) && bvhdIsFinite(towards) && !extent.isEmpty && is_met;
    return entry;
}

// Origin and direction are those in the structure's space.
void enter(Entry entry)
{
    content = entry.body.content;
    node_rows = entry.body.nodes;
    record_rows = entry.body.records;
    vertex_words = entry.body.vertices;
    inverse = entry.inverse;
    slack = entry.slack;
    inverse_length = 1.0 / dot(direction, direction);
    set_order();
    level_bottom = top;
    nodes = uvec2(0u, entry.can_hit ? FIRST_INNER | 1u : 0u);
    records = uvec2(0u);
}

void start()
{
    Ray ray = rays[index];
    origin = ray.origin.xyz;
    direction = ray.direction.xyz;
    tmin = ray.origin.w;
    high = low = ray.direction.w;
    origin_low = direction_low = 0.0;
    best = best_id = best_instance = instance = NONE;
    doubt_count = 0u;
    waiting = uvec2(0u);
    top = 0;
    order = ray.flags.y << 24;
    enter(entry_of(extra, origin, direction, vec3(0.0), vec3(0.0)));
    if (has_instances) {
        at_root[0] = vec4(inverse, uintBitsToFloat(node_rows));
        at_root[1] = vec4(slack, uintBitsToFloat(record_rows));
    }
    if (!(tmin >= 0.0 && tmin <= high))
        nodes.y = 0u;
}

void leave_instance()
{
    top = level_bottom;
    records = stack[--top];
    nodes = stack[--top];
    Ray ray = rays[index];
    origin = ray.origin.xyz;
    direction = ray.direction.xyz;
    origin_low = direction_low = 0.0;
    inverse = at_root[0].xyz;
    slack = at_root[1].xyz;
    node_rows = floatBitsToUint(at_root[0].w);
    record_rows = floatBitsToUint(at_root[1].w);
    content = BVHD_CONTENT_INSTANCES;
    instance = NONE;
    level_bottom = 0;
    set_order();
}

/*
 * The ray goes to object space in float. With u = 2^-24, the difference is wrong by u, the inverse matrix by u for each of its entries and each product and sum by
 * u again, and the matrix itself is told to no better than that: 12u of the sum of the sizes cover it.
 */
void visit_instance(uint record)
{
    uint row = record_rows + 8u * record;
    uvec4 words = BVHD_STORAGE_ROWS[row + 6u];
    uvec2 bottom = BVHD_STORAGE_ROWS[row + 7u].xy;
    if (((words.x & order) >> 24) == 0u || bottom == BVHD_NO_LOCATION)
        return;
    vec3 place = uintBitsToFloat(uvec3(BVHD_STORAGE_ROWS[row].w, BVHD_STORAGE_ROWS[row + 1u].w, BVHD_STORAGE_ROWS[row + 2u].w));
    mat3 rows = mat3(uintBitsToFloat(BVHD_STORAGE_ROWS[row + 3u].xyz), uintBitsToFloat(BVHD_STORAGE_ROWS[row + 4u].xyz),
                     uintBitsToFloat(BVHD_STORAGE_ROWS[row + 5u].xyz));
    mat3 sizes = mat3(abs(rows[0]), abs(rows[1]), abs(rows[2]));
    vec3 from = origin - place, low_origin = 7.1525574e-7 * (abs(from) * sizes), low_direction = 7.1525574e-7 * (abs(direction) * sizes);
    from = from * rows;
    vec3 towards = direction * rows;
    Entry entry = entry_of(bottom, from, towards, low_origin, low_direction);
    if (!entry.can_hit)
        return;
    stack[top++] = nodes;
    stack[top++] = records;
    origin = from;
    direction = towards;
    origin_low = bvhdLargest(low_origin);
    direction_low = bvhdLargest(low_direction);
    instance = record;
    enter(entry);
}

// Which of four slots the ray meets, in bits 3 .. 0.
uint slots_hit(uvec3 near_bytes, uvec3 far_bytes, vec3 scale, vec3 first, vec3 last)
{
    ivec4 near = max(max(floatBitsToInt(bvhdWiden(near_bytes.x) * scale.x + first.x), floatBitsToInt(bvhdWiden(near_bytes.y) * scale.y + first.y)),
                     max(floatBitsToInt(bvhdWiden(near_bytes.z) * scale.z + first.z), ivec4(floatBitsToInt(tmin))));
    ivec4 far = min(min(floatBitsToInt(bvhdWiden(far_bytes.x) * scale.x + last.x), floatBitsToInt(bvhdWiden(far_bytes.y) * scale.y + last.y)),
                    min(floatBitsToInt(bvhdWiden(far_bytes.z) * scale.z + last.z), ivec4(floatBitsToInt(high))));
    return (near.x <= far.x ? 1u : 0u) | (near.y <= far.y ? 2u : 0u) | (near.z <= far.z ? 4u : 0u) | (near.w <= far.w ? 8u : 0u);
}

// The records of the leaves in these slots: meta bytes of other slots become 0, which stands for no record.
uint records_of(uint leaves, uvec2 meta)
{
    if (leaves == 0u)
        return 0u;
    uvec2 slots = uvec2(leaves, leaves >> 4) & 15u, ones = slots * 0x00204081u & 0x01010101u, packed = meta & ones * 255u;
    uvec4 a = uvec4(packed.x, packed.x >> 8, packed.x >> 16, packed.x >> 24) & 255u;
    uvec4 b = uvec4(packed.y, packed.y >> 8, packed.y >> 16, packed.y >> 24) & 255u;
    a = a >> 5 << (a & 31u);
    b = b >> 5 << (b & 31u);
    return a.x | a.y | a.z | a.w | b.x | b.y | b.z | b.w;
}

// Goes to the next child of the group, which has one. bvhd_box.glsl says what is covered.
void visit_node()
{
    uint slot = bvhdFirstSlot(nodes.y, order);
    nodes.y &= ~(FIRST_INNER << slot);
    uint child = nodes.x + uint(bitCount(nodes.y & ((1u << slot) - 1u)));
    if (nodes.y >= FIRST_INNER)
        stack[top++] = nodes;
    uint row = node_rows + 5u * child;
    uvec4 head = BVHD_STORAGE_ROWS[row], meta = BVHD_STORAGE_ROWS[row + 1u];
    uvec4 planes0 = BVHD_STORAGE_ROWS[row + 2u], planes1 = BVHD_STORAGE_ROWS[row + 3u], planes2 = BVHD_STORAGE_ROWS[row + 4u];
    vec3 offset = (uintBitsToFloat(head.xyz) - origin) * inverse, error = abs(offset) * 9.5367432e-7 + slack;
    vec3 scale = uintBitsToFloat((uvec3(head.w, head.w >> 8, head.w >> 16) & 255u) << 23) * inverse;
    bvec3 is_negative = lessThan(inverse, vec3(0.0));
    uvec3 low0 = uvec3(planes0.xz, planes1.x), low1 = uvec3(planes0.yw, planes1.y);
    uvec3 high0 = uvec3(planes1.z, planes2.xz), high1 = uvec3(planes1.w, planes2.yw);
    uint found = slots_hit(mix(low0, high0, is_negative), mix(high0, low0, is_negative), scale, offset - error, offset + error) |
                 slots_hit(mix(low1, high1, is_negative), mix(high1, low1, is_negative), scale, offset - error, offset + error) << 4;
    uint inner = head.w >> 24;
    nodes = uvec2(meta.x, (found & inner) << 24 | inner);
    records = uvec2(meta.y, records_of(found & ~inner, meta.zw));
}

uint corners_of(uint record, out vec3 v0, out vec3 v1, out vec3 v2)
{
    if (content == BVHD_CONTENT_INDEXED_TRIANGLES) {
        uvec4 row = BVHD_STORAGE_ROWS[record_rows + record];
        uvec3 word = row.xyz * 3u + vertex_words;
        v0 = uintBitsToFloat(uvec3(BVHD_STORAGE_WORDS[word.x], BVHD_STORAGE_WORDS[word.x + 1u], BVHD_STORAGE_WORDS[word.x + 2u]));
        v1 = uintBitsToFloat(uvec3(BVHD_STORAGE_WORDS[word.y], BVHD_STORAGE_WORDS[word.y + 1u], BVHD_STORAGE_WORDS[word.y + 2u]));
        v2 = uintBitsToFloat(uvec3(BVHD_STORAGE_WORDS[word.z], BVHD_STORAGE_WORDS[word.z + 1u], BVHD_STORAGE_WORDS[word.z + 2u]));
        return row.w;
    }
    uint row = record_rows + 3u * record;
    uvec4 first = BVHD_STORAGE_ROWS[row];
    v0 = uintBitsToFloat(first.xyz);
    v1 = uintBitsToFloat(BVHD_STORAGE_ROWS[row + 1u].xyz);
    v2 = uintBitsToFloat(BVHD_STORAGE_ROWS[row + 2u].xyz);
    return first.w;
}

/*
 * Volumes as in bvhdTriangleMayHit, but seen from a point of the ray beside the triangle, which keeps them small: `near` is off by u of its size, or where fma() rounds
 * twice by u of the product as well, and by what the ray is off by. With E the sum of the sizes of both edges, S of near - v0, D the longest component of d: a volume is then off by 2 D E off + 12u D E (S + E) and,
 * where the direction is off by l, by 4 l E (S + E). Near the origin that is the point of the ray, and off by nothing.
 *
 * t is told better than by E * E: each component of the normal is off by 4u of the sum of the sizes of its two products, `spread`, and so are the sums that it goes into, by 8u of
 * what they are with `spread` in its place. On a long floor along the axes, which rays start from, t is nearly exact then; by E * E it would be in doubt whether it is below tmin.
 */
void visit_triangle(uint record)
{
    vec3 v0, v1, v2;
    uint id = corners_of(record, v0, v1, v2);
    vec3 e1 = v1 - v0, e2 = v2 - v0;
    float edges = bvhdSumOfSizes(e1) + bvhdSumOfSizes(e2), longest = bvhdLargest(direction);
    float ahead = dot(v0 - origin, direction) * inverse_length;
    if (abs(ahead) * longest < max(edges, 0.02 * bvhdLargest(origin)))
        ahead = 0.0;
    vec3 near = fma(vec3(ahead), direction, origin), s = near - v0;
    vec3 p1 = cross(direction, e1), p2 = cross(direction, e2), normal = cross(e1, e2);
    float det = dot(e1, p2), u = dot(s, p2), v = -dot(s, p1), rest = det - u - v;
    float sizes = bvhdSumOfSizes(s) + edges;
    float off = BVHD_FUSED_FMA ? bvhdLargest(near) : 2.0 * bvhdLargest(near) + bvhdLargest(origin);
    off = (ahead == 0.0 ? 0.0 : 6.5e-8 * off) + origin_low + abs(ahead) * direction_low;
    float error = longest * edges * (2.0 * off + 7.1525574e-7 * sizes) + 4.0 * direction_low * edges * sizes + 3.0e-35;
    float least = min(min(u, v), rest), most = max(max(u, v), rest);
    if (least < -error && most > error || id == best_id && instance == best_instance)
        return;

    vec3 spread = abs(e1.yzx * e2.zxy) + abs(e1.zxy * e2.yzx);
    float spreads = spread.x + spread.y + spread.z;
    float size = abs(det), size_error = 7.1525574e-7 * dot(abs(direction), spread) + 4.0 * direction_low * spreads + 3.0e-35;
    float distance = det < 0.0 ? -dot(s, normal) : dot(s, normal);
    float distance_error = 1.001 * off * spreads + 7.1525574e-7 * dot(abs(s), spread) + 3.0e-35;
    float scale = 1.0 / max(size, 1e-37), beyond = distance * scale, t = ahead + beyond;
    float wrong = 1.25 * scale * (distance_error + abs(beyond) * size_error) + 2.4e-7 * (abs(ahead) + abs(beyond));
    bool is_steep = size > 16.0 * size_error;
    if (is_steep && (t - wrong > high || t + wrong < tmin))
        return;
    if (is_steep && (least > error || most < -error) && t - wrong > tmin && t + wrong < low) {
        low = t - wrong;
        high = t + wrong;
        best = record;
        best_instance = instance;
        best_id = id;
        best_is_front = det > 0.0;
        return;
    }
    if (doubt_count < MOST_DOUBTS)
        doubts[doubt_count++] = uvec3(record, instance, floatBitsToUint(is_steep ? t - wrong : -3.0e38));
    else if (doubt_count == MOST_DOUBTS)
        leave_ray();
}

uint take(inout uvec2 group)
{
    uint record = group.x + uint(findLSB(group.y));
    group.y &= group.y - 1u;
    return record;
}

void visit_record()
{
    uint record = take(records);
    if (has_instances && content == BVHD_CONTENT_INSTANCES)
        visit_instance(record);
    else
        visit_triangle(record);
}

// Takes up what waits. False: there is nothing left.
bool resume()
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
