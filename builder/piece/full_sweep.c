/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/full_sweep.h"

#include <math.h>
#include <string.h>

#include "builder/kernel/vec4.h"

enum { AXES = 3 };

_Static_assert(FULL_SWEEP_MOST <= 64, "a set of boxes is a word");

struct sweep {
    struct vec4_box boxes[FULL_SWEEP_MOST]; /* maxima are negated, so that one operation grows both ends */
    vec4 right_costs[FULL_SWEEP_MOST]; /* cost of the right side of a cut before each place, one lane for each axis */
    /* boxes sorted along each axis; those of one subtree are adjacent, at the same places on all axes */
    uint8_t order[AXES][FULL_SWEEP_MOST];
    struct full_sweep_pair *pairs;
    uint32_t count, pair_count;
};

/* A cut: boxes before place `at` along the axis go left. */
struct cut {
    uint32_t axis, at;
};

static inline struct vec4_box unite(struct vec4_box a, struct vec4_box b)
{
    return (struct vec4_box){vec4_min(a.min, b.min), vec4_min(a.max, b.max)};
}

static inline void grow_all(struct vec4_box grown[AXES], const struct sweep *s, uint32_t at)
{
    for (int axis = 0; axis < AXES; axis++)
        grown[axis] = unite(s->boxes[s->order[axis][at]], grown[axis]);
}

static inline void start_all(struct vec4_box grown[AXES], const struct sweep *s, uint32_t at)
{
    for (int axis = 0; axis < AXES; axis++)
        grown[axis] = s->boxes[s->order[axis][at]];
}

/* Sides come out negated, which does not change the products. */
static inline vec4 half_areas(const struct vec4_box boxes[AXES])
{
    vec4 x, y, z;
    vec4_transpose3(boxes[0].min + boxes[0].max, boxes[1].min + boxes[1].max, boxes[2].min + boxes[2].max, &x, &y, &z);
    return x * y + y * z + z * x;
}

static inline void sweep_right(struct sweep *s, uint32_t begin, uint32_t end)
{
    struct vec4_box grown[AXES];
    vec4 count = vec4_all(1);
    uint32_t i = end - 1;
    for (start_all(grown, s, i);; count += vec4_all(1)) {
        s->right_costs[i] = half_areas(grown) * count;
        if (--i == begin)
            return;
        grow_all(grown, s, i);
    }
}

/*
 * Among cuts of equal cost it takes the one in the middle, or the nearest before it, so that equal boxes do not become
 * a chain.
 */
static inline struct cut sweep_left(const struct sweep *s, uint32_t begin, uint32_t end)
{
    const vec4 middle = vec4_all((float)(end - begin) / 2);
    struct vec4_box grown[AXES];
    vec4 count = vec4_all(1), best = vec4_all(INFINITY), best_at = vec4_all(0);
    uint32_t i = begin;
    for (start_all(grown, s, i++);; count += vec4_all(1)) {
        vec4 cost = half_areas(grown) * count + s->right_costs[i];
        vec4_int better = (cost < best) | ((cost == best) & (count <= middle));
        best_at = vec4_select(better, count, best_at);
        best = vec4_min(cost, best);
        if (i + 1 == end)
            break;
        grow_all(grown, s, i++);
    }
    uint32_t axis = best[1] < best[0] ? 1 : 0;
    axis = best[2] < best[axis] ? 2 : axis;
    return (struct cut){axis, begin + (uint32_t)best_at[axis]};
}

/* Divides the boxes along all three axes, so that both sides stay sorted. */
static void divide(struct sweep *s, const struct cut *cut, uint32_t begin, uint32_t end)
{
    uint64_t left = 0;
    for (uint32_t i = begin; i < cut->at; i++)
        left |= UINT64_C(1) << s->order[cut->axis][i];
    for (uint32_t axis = 0; axis < AXES; axis++) {
        uint8_t *order = s->order[axis], right[FULL_SWEEP_MOST];
        uint32_t lefts = begin, rights = 0;
        for (uint32_t i = begin; i < end && axis != cut->axis; i++) {
            uint8_t box = order[i];
            uint32_t is_left = left >> box & 1;
            order[lefts] = right[rights] = box;
            lefts += is_left;
            rights += 1 - is_left;
        }
        memcpy(order + lefts, right, rights);
    }
}

static inline uint32_t join(struct sweep *s, uint32_t left, uint32_t right)
{
    s->pairs[s->pair_count] = (struct full_sweep_pair){(uint8_t)left, (uint8_t)right};
    return s->count + s->pair_count++;
}

static inline float half_area(struct vec4_box box)
{
    vec4 side = box.min + box.max, product = side * vec4_rotate(side);
    return product[0] + product[1] + product[2];
}

/* Joins three boxes in the cheapest of the three possible ways. */
static uint32_t join_three(struct sweep *s, const uint8_t boxes[3])
{
    const uint8_t a = boxes[0], b = boxes[1], c = boxes[2];
    const struct vec4_box *all = s->boxes;
    float costs[3] = {half_area(all[a]) + 2 * half_area(unite(all[b], all[c])),
                      half_area(all[b]) + 2 * half_area(unite(all[a], all[c])),
                      half_area(all[c]) + 2 * half_area(unite(all[a], all[b]))};
    uint32_t alone = costs[1] < costs[0] ? 1 : 0;
    alone = costs[2] < costs[alone] ? 2 : alone;
    return join(s, join(s, boxes[alone == 0], boxes[alone == 2 ? 1 : 2]), boxes[alone]);
}

/*
 * Builds the subtree of the boxes at [begin, end), and returns its root's number. The recursion is at most as deep as
 * there are boxes.
 */
static uint32_t build_below(struct sweep *s, uint32_t begin, uint32_t end)
{
    const uint8_t *boxes = s->order[0] + begin;
    if (end - begin == 1)
        return boxes[0];
    if (end - begin == 2)
        return join(s, boxes[0], boxes[1]);
    if (end - begin == 3)
        return join_three(s, boxes);
    sweep_right(s, begin, end);
    struct cut cut = sweep_left(s, begin, end);
    divide(s, &cut, begin, end);
    uint32_t left = build_below(s, begin, cut.at);
    return join(s, left, build_below(s, cut.at, end));
}

/* Returns the centroids as integers that have the order of the floats. */
static inline vec4_int key_of(const struct vec4_box *box)
{
    vec4_int bits = (vec4_int)(box->min - box->max);
    return bits ^ (bits >> 31 & INT32_MAX);
}

/* Sorts by counting, for each box, how many lie before it, which is quick for so few. Equal boxes keep their order. */
static void sort(struct sweep *s)
{
    int32_t keys[AXES][FULL_SWEEP_MOST] = {{0}};
    for (uint32_t i = 0; i < s->count; i++) {
        vec4_int key = key_of(&s->boxes[i]);
        for (int axis = 0; axis < AXES; axis++)
            keys[axis][i] = key[axis];
    }
    for (int axis = 0; axis < AXES; axis++) {
        int32_t ranks[FULL_SWEEP_MOST] = {0};
        uint8_t equals[FULL_SWEEP_MOST] = {0};
        for (uint32_t k = 0; k < s->count; k++)
            for (uint32_t i = 0; i < FULL_SWEEP_MOST; i++) /* a constant length, which the compiler vectorises */
                ranks[i] += keys[axis][i] > keys[axis][k];
        for (uint32_t i = 0; i < s->count; i++)
            s->order[axis][ranks[i] + equals[ranks[i]]++] = (uint8_t)i;
    }
}

void full_sweep(const struct primitive_ref *refs, uint32_t count, struct full_sweep_pair *ret_pairs)
{
    struct sweep s;
    s.pairs = ret_pairs;
    s.count = count;
    s.pair_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        /*
         * The fourth lanes hold integers, which may look like denormals and be slow to multiply, so they are cleared.
         */
        struct vec4_box box = vec4_box_load(&refs[i]);
        s.boxes[i] = (struct vec4_box){vec4_xyz(box.min), -vec4_xyz(box.max)};
    }
    sort(&s);
    build_below(&s, 0, count);
}
