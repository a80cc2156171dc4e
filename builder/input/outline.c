/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/outline.h"

#include <math.h>

#include "builder/kernel/vec4.h"
#include "proto/base/prefix.h"
#include "proto/base/round_outward.h"

/*
 * First lanes of the directions: sums and differences of an axis and the next one, and the corners. GROUPS vectors of
 * lanes hold them all.
 */
enum { SUMS = 0, DIFFERENCES = 3, CORNERS = 6, GROUPS = 3 };

/*
 * The work is divided into at most MOST_SHARES shares, so that their results need no allocation; how it is divided does
 * not depend on the threads. LOOK elements are added between two checks of the cancel flag.
 */
enum { MOST_SHARES = 64, LEAST_SHARE = 4096, LOOK = 8192 };

/* Groups of four vertices that stay in the first-level cache for the second pass over them. */
enum { NEAR = 256 };

struct reach {
    vec4 min[GROUPS], max[GROUPS];
};

static struct reach reach_empty(void)
{
    struct reach reach;
    for (int group = 0; group < GROUPS; group++) {
        reach.min[group] = vec4_all(FLT_MAX);
        reach.max[group] = vec4_all(-FLT_MAX);
    }
    return reach;
}

/* Grows the group's extents. Lanes that are NaN are ignored. */
static inline void reach_add(struct reach *reach, int group, vec4 min, vec4 max)
{
    reach->min[group] = vec4_min(min, reach->min[group]);
    reach->max[group] = vec4_max(max, reach->max[group]);
}

/* Returns x + y, y + z, z + x, x + y. */
static inline vec4 sums_of(vec4 v)
{
    vec4 sums = v + vec4_rotate(v);
    return __builtin_shufflevector(sums, sums, 0, 1, 2, 0);
}

/* Returns what the sums lack of the corner directions: -z, -x, -y of `away`, and z of `along`. */
static inline vec4 rest_of(vec4 away, vec4 along)
{
    return __builtin_shufflevector(-away, along, 2, 0, 1, 6);
}

static inline void add_box(struct reach *reach, vec4 min, vec4 max)
{
    vec4 low = sums_of(min), high = sums_of(max);
    reach_add(reach, 0, low, high);
    reach_add(reach, 1, min - vec4_rotate(max), max - vec4_rotate(min));
    reach_add(reach, 2, low + rest_of(max, min), high + rest_of(min, max));
}

struct extent_search {
    const struct canonical *canonical;
    size_t count; /* vertices or boxes, of all geometries */
    const atomic_bool *cancel;
    struct reach shares[MOST_SHARES];
    size_t share_size;
};

static bool is_of_boxes(const struct canonical *canonical)
{
    return canonical->geometries[0].type == GEOMETRY_AABBS;
}

static size_t first_of(const struct canonical *canonical, uint32_t geometry)
{
    const struct canonical_geometry *found = &canonical->geometries[geometry];
    return is_of_boxes(canonical) ? found->first_primitive : found->first_vertex;
}

/* Returns the geometry that the element is in: the last one that starts at or before it. */
static uint32_t geometry_of(const struct canonical *canonical, size_t element)
{
    const struct canonical_geometry *geometries = canonical->geometries;
    const uint32_t *firsts = is_of_boxes(canonical) ? &geometries[0].first_primitive : &geometries[0].first_vertex;
    return prefix_find(firsts, sizeof geometries[0], canonical->geometry_count, element);
}

/* Extents along each direction, separately for four vertices at a time. */
struct slab_lanes {
    vec4 min[SLABS_COUNT], max[SLABS_COUNT];
};

static inline vec4 load(const float at[4])
{
    return *(const vec4_loose *)at;
}

/* Loads x, y and z of four consecutive vertices. */
static inline void load_four(const float at[12], vec4 *ret_x, vec4 *ret_y, vec4 *ret_z)
{
    vec4 a = load(at), b = load(at + 4), c = load(at + 8);
    vec4 upper = __builtin_shufflevector(b, c, 2, 3, 5, 6), lower = __builtin_shufflevector(a, b, 1, 2, 4, 5);
    *ret_x = __builtin_shufflevector(a, upper, 0, 3, 4, 6);
    *ret_y = __builtin_shufflevector(lower, upper, 0, 2, 5, 7);
    *ret_z = __builtin_shufflevector(lower, c, 1, 3, 4, 7);
}

static inline void lanes_add(struct slab_lanes *lanes, int slab, vec4 value)
{
    lanes->min[slab] = vec4_min(value, lanes->min[slab]);
    lanes->max[slab] = vec4_max(value, lanes->max[slab]);
}

/* Adds the vertices along half of the directions: there are enough registers for that many. */
static void add_first_half(const float *positions, size_t fours, struct slab_lanes *lanes)
{
    struct slab_lanes own = *lanes;
    for (size_t i = 0; i < fours; i++) {
        vec4 x, y, z;
        load_four(positions + 12 * i, &x, &y, &z);
        lanes_add(&own, SUMS, x + y);
        lanes_add(&own, SUMS + 1, y + z);
        lanes_add(&own, CORNERS, x + y - z);
        lanes_add(&own, CORNERS + 1, y + z - x);
        lanes_add(&own, CORNERS + 3, x + y + z);
    }
    *lanes = own;
}

static void add_second_half(const float *positions, size_t fours, struct slab_lanes *lanes)
{
    struct slab_lanes own = *lanes;
    for (size_t i = 0; i < fours; i++) {
        vec4 x, y, z;
        load_four(positions + 12 * i, &x, &y, &z);
        lanes_add(&own, SUMS + 2, z + x);
        lanes_add(&own, DIFFERENCES, x - y);
        lanes_add(&own, DIFFERENCES + 1, y - z);
        lanes_add(&own, DIFFERENCES + 2, z - x);
        lanes_add(&own, CORNERS + 2, z + x - y);
    }
    *lanes = own;
}

static void reach_add_lanes(struct reach *reach, const struct slab_lanes *lanes)
{
    for (int slab = 0; slab < SLABS_COUNT; slab++) {
        int group = slab / 3 < 2 ? slab / 3 : 2, lane = slab - 3 * group;
        for (int k = 0; k < 4; k++) {
            reach->min[group][lane] = fminf(reach->min[group][lane], lanes->min[slab][k]);
            reach->max[group][lane] = fmaxf(reach->max[group][lane], lanes->max[slab][k]);
        }
    }
}

static void add_vertices(const float *positions, size_t count, struct reach *reach)
{
    struct slab_lanes lanes;
    for (int slab = 0; slab < SLABS_COUNT; slab++) {
        lanes.min[slab] = vec4_all(FLT_MAX);
        lanes.max[slab] = vec4_all(-FLT_MAX);
    }
    while (count >= 4) {
        size_t fours = count / 4 < NEAR ? count / 4 : NEAR;
        add_first_half(positions, fours, &lanes);
        add_second_half(positions, fours, &lanes);
        positions += 12 * fours;
        count -= 4 * fours;
    }
    for (; count > 0; count--, positions += 3) {
        vec4 point = vec4_load3(positions);
        add_box(reach, point, point);
    }
    reach_add_lanes(reach, &lanes);
}

static void add_boxes(const float *boxes, size_t count, struct reach *reach)
{
    for (size_t i = 0; i < count; i++, boxes += 6)
        if (!isnan(boxes[0]))
            add_box(reach, vec4_load3(boxes), vec4_load3(boxes + 3));
}

/* Adds elements [begin, end), numbered through over all geometries. */
static void add_elements(const struct canonical *canonical, size_t begin, size_t end, struct reach *reach)
{
    while (begin < end) {
        uint32_t geometry = geometry_of(canonical, begin);
        size_t first = first_of(canonical, geometry);
        const struct canonical_geometry *found = &canonical->geometries[geometry];
        size_t last = first + (is_of_boxes(canonical) ? found->primitive_count : found->vertex_count), count;
        count = (last < end ? last : end) - begin;
        if (is_of_boxes(canonical))
            add_boxes(found->boxes + 6 * (begin - first), count, reach);
        else
            add_vertices(found->positions + 3 * (begin - first), count, reach);
        begin += count;
    }
}

static void find_share(void *context, size_t index)
{
    struct extent_search *finding = context;
    size_t begin, end;
    parallel_chunk(index, finding->share_size, finding->count, &begin, &end);
    struct reach reach = reach_empty();
    for (; begin < end && !parallel_cancelled(finding->cancel); begin += LOOK)
        add_elements(finding->canonical, begin, end - begin < LOOK ? end : begin + LOOK, &reach);
    finding->shares[index] = reach;
}

/*
 * Rounds outward, and -0 to 0, so that equal geometry has equal slabs. A sum or a difference has been rounded once; a
 * corner has been rounded at its sum of two and once more. 2^-23 of both magnitudes is more than these errors.
 */
static void put(struct slabs *slabs, int slab, float min, float max, double sum)
{
    slabs->min[slab] = round_down(min - (fabs((double)min) + sum) * 0x1p-23) + 0.0f;
    slabs->max[slab] = round_up(max + (fabs((double)max) + sum) * 0x1p-23) + 0.0f;
}

/* Makes slabs from the extents; overflow and empty extents give slabs that are not valid, and so unknown ones. */
static struct slabs slabs_of(const struct reach *reach)
{
    struct slabs slabs;
    double sum = 0;
    for (int lane = 0; lane < 3; lane++) {
        sum = fmax(sum, fmax(fabs((double)reach->min[0][lane]), fabs((double)reach->max[0][lane])));
        put(&slabs, SUMS + lane, reach->min[0][lane], reach->max[0][lane], 0);
        put(&slabs, DIFFERENCES + lane, reach->min[1][lane], reach->max[1][lane], 0);
    }
    for (int lane = 0; lane < 4; lane++)
        put(&slabs, CORNERS + lane, reach->min[2][lane], reach->max[2][lane], sum);
    return slabs_are_valid(&slabs) ? slabs : (struct slabs){.min = {0}};
}

bool outline_find(const struct canonical *canonical, const struct build_context *context, struct slabs *ret_slabs)
{
    struct extent_search finding = {.canonical = canonical, .cancel = context->cancel};
    struct reach reach = reach_empty();
    if (canonical->geometry_count > 0)
        finding.count = is_of_boxes(canonical) ? canonical->primitive_count : canonical->vertex_count;
    finding.share_size = finding.count / MOST_SHARES + 1;
    finding.share_size = finding.share_size < LEAST_SHARE ? LEAST_SHARE : finding.share_size;
    size_t shares = parallel_chunks(finding.share_size, finding.count);
    if (!parallel_for_until(context->parallel, context->cancel, shares, find_share, &finding) ||
        parallel_cancelled(context->cancel))
        return false;
    for (size_t i = 0; i < shares; i++)
        for (int group = 0; group < GROUPS; group++)
            reach_add(&reach, group, finding.shares[i].min[group], finding.shares[i].max[group]);
    *ret_slabs = slabs_of(&reach);
    return true;
}

/* ---- The box of an instance ---- */

/* A direction: the sum of one to three axes, some of them negated. */
struct direction {
    int sign[3]; /* -1, 0, 1 */
};

/*
 * Returns the slab of a direction of two or three axes; *ret_is_opposite says whether the slab is along the negated
 * direction.
 */
static int slab_of(const struct direction *direction, bool *ret_is_opposite)
{
    const int *sign = direction->sign;
    for (int axis = 0; axis < 3; axis++) {
        int next = (axis + 1) % 3, last = (axis + 2) % 3;
        if (sign[last] == 0) {
            *ret_is_opposite = sign[axis] < 0;
            return sign[axis] == sign[next] ? SUMS + axis : DIFFERENCES + axis;
        }
    }
    for (int axis = 0; axis < 3; axis++) {
        int next = (axis + 1) % 3, last = (axis + 2) % 3;
        if (sign[axis] == sign[next] && sign[last] != sign[axis]) {
            *ret_is_opposite = sign[axis] < 0;
            return CORNERS + axis;
        }
    }
    *ret_is_opposite = sign[0] < 0;
    return CORNERS + 3;
}

/* Returns how far the structure reaches in a direction of `axes` axes. */
static double reach_along(const struct direction *direction, int axes, int first, const struct box *bounds,
                          const struct slabs *slabs)
{
    bool is_opposite = direction->sign[first] < 0;
    if (axes == 1)
        return is_opposite ? -(double)bounds->min[first] : bounds->max[first];
    int slab = slab_of(direction, &is_opposite);
    return is_opposite ? -(double)slabs->min[slab] : slabs->max[slab];
}

/* Sorts the axes by the size of their components, largest first. */
static void sort_axes(const double size[3], int ret_axes[3])
{
    int a = size[0] >= size[1] ? 0 : 1, b = 1 - a;
    ret_axes[0] = size[2] > size[a] ? 2 : a;
    ret_axes[1] = size[2] > size[a] ? a : size[2] > size[b] ? 2 : b;
    ret_axes[2] = 3 - ret_axes[0] - ret_axes[1];
}

/*
 * Returns an upper bound, a little above the exact value, of how far any point of the structure lies along `row` times
 * `sign`. With components a >= b >= c >= 0, the row is (a - b) times one axis, plus (b - c) times the sum of two, plus
 * c times the sum of all three; the reach along a sum is at most the sum of the reaches.
 */
static double reach_of(const float row[3], int sign, const struct box *bounds, const struct slabs *slabs)
{
    struct direction direction = {{0, 0, 0}};
    double size[3], reach = 0, magnitude = 0;
    int axes[3];
    for (int axis = 0; axis < 3; axis++)
        size[axis] = fabs((double)row[axis]);
    sort_axes(size, axes);
    for (int k = 0; k < 3; k++) {
        direction.sign[axes[k]] = row[axes[k]] < 0 ? -sign : sign;
        double along = reach_along(&direction, k + 1, axes[0], bounds, slabs);
        reach += (k < 2 ? size[axes[k]] - size[axes[k + 1]] : size[axes[k]]) * along;
        magnitude += size[axes[0]] * fabs(along);
    }
    return reach + magnitude * 0x1p-48;
}

void outline_narrow(const float matrix[12], const struct box *bounds, const struct slabs *slabs, struct box *box)
{
    if (!slabs_are_known(slabs))
        return;
    for (int axis = 0; axis < 3; axis++) {
        const float *row = matrix + 4 * axis;
        double slack = fabs((double)row[3]) * 0x1p-48;
        float low = round_down(row[3] - reach_of(row, -1, bounds, slabs) - slack) + 0.0f;
        float high = round_up(row[3] + reach_of(row, 1, bounds, slabs) + slack) + 0.0f;
        low = low > box->min[axis] ? low : box->min[axis];
        high = high < box->max[axis] ? high : box->max[axis];
        if (low > high)
            continue;
        box->min[axis] = low;
        box->max[axis] = high;
    }
}
