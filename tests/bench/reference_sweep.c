/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "tests/bench/reference_builder.h"

/* Refs sorted by their centroids along each axis; each node has the same range in all three orders. */
struct sweep {
    const struct primitive_ref *refs;
    uint32_t *orders[3], *other;
    double *right_costs;
    bool *goes_left;
};

struct range {
    uint32_t first, count;
};

static int by_centroid(const void *a, const void *b, void *context)
{
    const float *centroids = context;
    uint32_t i = *(const uint32_t *)a, k = *(const uint32_t *)b;
    if (centroids[i] != centroids[k])
        return centroids[i] < centroids[k] ? -1 : 1;
    return (i > k) - (i < k);
}

static void grow(struct box *box, const struct primitive_ref *ref)
{
    struct box own = primitive_ref_box(ref);
    box_grow(box, &own);
}

/* Returns the least sum of area * refs over both sides, and the split that has it. */
static double best_place(const struct sweep *sweep, const struct range *range, int *ret_axis, uint32_t *ret_left)
{
    double best = INFINITY;
    for (int axis = 0; axis < 3; axis++) {
        const uint32_t *order = sweep->orders[axis] + range->first;
        struct box right = box_empty(), left = box_empty();
        for (uint32_t i = range->count - 1; i > 0; i--) {
            grow(&right, &sweep->refs[order[i]]);
            sweep->right_costs[i] = box_half_area(&right) * (range->count - i);
        }
        for (uint32_t i = 1; i < range->count; i++) {
            grow(&left, &sweep->refs[order[i - 1]]);
            double cost = box_half_area(&left) * i + sweep->right_costs[i];
            if (cost < best) {
                best = cost;
                *ret_axis = axis;
                *ret_left = i;
            }
        }
    }
    return best;
}

/* Moves the refs of the left side to the front of the range in all three orders. */
static void divide(const struct sweep *sweep, const struct range *range, int axis, uint32_t left)
{
    for (uint32_t i = 0; i < range->count; i++)
        sweep->goes_left[sweep->orders[axis][range->first + i]] = i < left;
    for (int k = 0; k < 3; k++) {
        uint32_t *order = sweep->orders[k] + range->first, kept = 0, moved = 0;
        for (uint32_t i = 0; i < range->count; i++) {
            uint32_t ref = order[i];
            if (sweep->goes_left[ref])
                order[kept++] = ref;
            else
                sweep->other[moved++] = ref;
        }
        memcpy(order + kept, sweep->other, moved * sizeof *order);
    }
}

static double sum_of_costs(const struct sweep *sweep, uint32_t count)
{
    struct range waiting[33], range = {0, count};
    uint32_t waiting_count = 0;
    double sum = 0;
    for (;;) {
        struct box box = box_empty();
        int axis = 0;
        uint32_t left = 0;
        for (uint32_t i = 0; i < range.count; i++)
            grow(&box, &sweep->refs[sweep->orders[0][range.first + i]]);
        double area = box_half_area(&box), divided = best_place(sweep, &range, &axis, &left);
        if (range.count == 1 || area + divided >= area * range.count) {
            sum += area * range.count;
            if (waiting_count == 0)
                return sum;
            range = waiting[--waiting_count];
            continue;
        }
        sum += area;
        divide(sweep, &range, axis, left);
        struct range sides[2] = {{range.first, left}, {range.first + left, range.count - left}};
        bool right_first = sides[1].count < sides[0].count;
        waiting[waiting_count++] = sides[!right_first];
        range = sides[right_first];
    }
}

static bool sort(struct sweep *sweep, uint32_t count)
{
    float *centroids = malloc(count * sizeof *centroids);
    for (int axis = 0; axis < 3 && centroids; axis++) {
        for (uint32_t i = 0; i < count; i++) {
            sweep->orders[axis][i] = i;
            centroids[i] = sweep->refs[i].min[axis] + sweep->refs[i].max[axis];
        }
        qsort_r(sweep->orders[axis], count, sizeof(uint32_t), by_centroid, centroids);
    }
    free(centroids);
    return centroids;
}

double reference_sweep_sah(const struct primitive_ref *refs, uint32_t count)
{
    uint32_t *indices = calloc(count, 4 * sizeof *indices);
    struct sweep sweep = {
        .refs = refs,
        .right_costs = malloc(count * sizeof *sweep.right_costs),
        .goes_left = malloc(count * sizeof *sweep.goes_left),
    };
    double sah = 0;
    if (indices && sweep.right_costs && sweep.goes_left) {
        for (uint64_t axis = 0; axis < 3; axis++)
            sweep.orders[axis] = indices + axis * count;
        sweep.other = indices + (uint64_t)3 * count;
        struct box bounds, centroids;
        primitive_ref_bounds(refs, count, &bounds, &centroids);
        double area = box_half_area(&bounds);
        if (area > 0 && sort(&sweep, count))
            sah = sum_of_costs(&sweep, count) / area;
    }
    free(indices);
    free(sweep.right_costs);
    free(sweep.goes_left);
    return sah;
}
