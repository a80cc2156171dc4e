/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/reach.h"

#include <math.h>

#include "proto/base/round_outward.h"

/* Groups of four vertices that stay in the first-level cache for the second pass over them. */
enum { NEAR = 256 };

struct reach reach_empty(void)
{
    struct reach reach;
    for (int group = 0; group < REACH_GROUPS; group++) {
        reach.min[group] = vec4_all(FLT_MAX);
        reach.max[group] = vec4_all(-FLT_MAX);
    }
    return reach;
}

/* Grows the group's extents. Lanes that are NaN are ignored. */
static inline void add(struct reach *reach, int group, vec4 min, vec4 max)
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
    add(reach, 0, low, high);
    add(reach, 1, min - vec4_rotate(max), max - vec4_rotate(min));
    add(reach, 2, low + rest_of(max, min), high + rest_of(min, max));
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
        lanes_add(&own, REACH_SUMS, x + y);
        lanes_add(&own, REACH_SUMS + 1, y + z);
        lanes_add(&own, REACH_CORNERS, x + y - z);
        lanes_add(&own, REACH_CORNERS + 1, y + z - x);
        lanes_add(&own, REACH_CORNERS + 3, x + y + z);
    }
    *lanes = own;
}

static void add_second_half(const float *positions, size_t fours, struct slab_lanes *lanes)
{
    struct slab_lanes own = *lanes;
    for (size_t i = 0; i < fours; i++) {
        vec4 x, y, z;
        load_four(positions + 12 * i, &x, &y, &z);
        lanes_add(&own, REACH_SUMS + 2, z + x);
        lanes_add(&own, REACH_DIFFERENCES, x - y);
        lanes_add(&own, REACH_DIFFERENCES + 1, y - z);
        lanes_add(&own, REACH_DIFFERENCES + 2, z - x);
        lanes_add(&own, REACH_CORNERS + 2, z + x - y);
    }
    *lanes = own;
}

static void add_all_lanes(struct reach *reach, const struct slab_lanes *lanes)
{
    for (int slab = 0; slab < SLABS_COUNT; slab++) {
        int group = slab / 3 < 2 ? slab / 3 : 2, lane = slab - 3 * group;
        for (int k = 0; k < 4; k++) {
            reach->min[group][lane] = fminf(reach->min[group][lane], lanes->min[slab][k]);
            reach->max[group][lane] = fmaxf(reach->max[group][lane], lanes->max[slab][k]);
        }
    }
}

void reach_add_vertices(struct reach *reach, const float *positions, size_t count)
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
    add_all_lanes(reach, &lanes);
}

void reach_add_boxes(struct reach *reach, const float *boxes, size_t count)
{
    for (size_t i = 0; i < count; i++, boxes += 6)
        if (!isnan(boxes[0]))
            add_box(reach, vec4_load3(boxes), vec4_load3(boxes + 3));
}

/*
 * Along the sum of two axes a sphere reaches sqrt(2) of its radius from its centre, and along that of three sqrt(3).
 * With u = 2^-24, all roundings together move a value by less than 9 u of the sum of the four magnitudes.
 */
void reach_add_spheres(struct reach *reach, const float *spheres, size_t count)
{
    for (size_t i = 0; i < count; i++, spheres += 4) {
        const vec4 centre = vec4_load3(spheres), sums = sums_of(centre), differences = centre - vec4_rotate(centre);
        const vec4 corners = sums + rest_of(centre, centre);
        const float all = fabsf(centre[0]) + fabsf(centre[1]) + fabsf(centre[2]) + spheres[3];
        const vec4 two = vec4_all(spheres[3] * 0x1.6a09e8p0f + all * 0x1p-20f);
        const vec4 three = vec4_all(spheres[3] * 0x1.bb67b0p0f + all * 0x1p-20f);
        add(reach, 0, sums - two, sums + two);
        add(reach, 1, differences - two, differences + two);
        add(reach, 2, corners - three, corners + three);
    }
}

void reach_join(struct reach *reach, const struct reach *more)
{
    for (int group = 0; group < REACH_GROUPS; group++)
        add(reach, group, more->min[group], more->max[group]);
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

/* Overflow and empty extents give slabs that are not valid, and so unknown ones. */
struct slabs reach_slabs(const struct reach *reach)
{
    struct slabs slabs;
    double sum = 0;
    for (int lane = 0; lane < 3; lane++) {
        sum = fmax(sum, fmax(fabs((double)reach->min[0][lane]), fabs((double)reach->max[0][lane])));
        put(&slabs, REACH_SUMS + lane, reach->min[0][lane], reach->max[0][lane], 0);
        put(&slabs, REACH_DIFFERENCES + lane, reach->min[1][lane], reach->max[1][lane], 0);
    }
    for (int lane = 0; lane < 4; lane++)
        put(&slabs, REACH_CORNERS + lane, reach->min[2][lane], reach->max[2][lane], sum);
    return slabs_are_valid(&slabs) ? slabs : (struct slabs){.min = {0}};
}
