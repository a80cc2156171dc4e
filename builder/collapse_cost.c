/* SPDX-License-Identifier: Apache-2.0 */
#include "collapse_cost.h"

#include <math.h>

#if defined(__SSE2__) && !defined(BVHD_SCALAR)
#define USE_SSE2 1
#include <emmintrin.h>
#endif

/* Sides in the table's scale. Their rounding is no matter for a cost, but it is the same everywhere. */
static inline void sides_of(const struct box *box, float scale, float ret_sides[3])
{
    for (int axis = 0; axis < 3; axis++)
        ret_sides[axis] = box->max[axis] * scale - box->min[axis] * scale;
}

static inline float measure_box(const struct collapse_table *table, const struct box *box)
{
    float d[3];
    sides_of(box, table->scale, d);
    return table->lengths ? d[0] + d[1] + d[2] : d[0] * d[1] + d[1] * d[2] + d[2] * d[0];
}

/* Relative to the root's. Over all motion keys: areas of linearly moving boxes average over time. */
static inline float measure(const struct collapse_table *table, uint32_t node)
{
    float sum = measure_box(table, &table->ir->boxes[0][node]);
    for (uint32_t key = 1; key < table->ir->key_count; key++)
        sum += measure_box(table, &table->ir->boxes[key][node]);
    return sum * table->inverse;
}

/* Brings the longest side between 1 and 2, as far as powers of two that are normal floats allow. */
static float scale_for(const struct box *box)
{
    double longest = 0;
    int exponent;
    for (int axis = 0; axis < 3; axis++)
        longest = fmax(longest, (double)box->max[axis] - box->min[axis]);
    if (longest == 0)
        return 1;
    frexp(longest, &exponent);
    return ldexpf(1, 1 - exponent < -126 ? -126 : 1 - exponent > 126 ? 126 : 1 - exponent);
}

/* Below it an area counts as none: it has lost its bits, and its inverse is not finite. */
static const float smallest_area = 0x1p-100f;

void collapse_table_init(struct collapse_table *table, const struct ir *ir, const struct collapse_options *options)
{
    *table = (struct collapse_table){
        .ir = ir,
        .leaf_max = options->leaf_max,
        .leaf_cost = options->leaf_cost,
        .node_cost = (float)(COLLAPSE_NODE_SHARE / (ir->ref_count + 1.0)),
        .scale = scale_for(&ir->boxes[0][0]),
        .inverse = 1,
    };
    float root = measure(table, 0);
    if (root < smallest_area) {
        table->lengths = true;
        root = measure(table, 0);
    }
    table->inverse = root > 0 ? 1 / root : 0;
}

/*
 * ret[m] = min over a + b = m of left[a] + right[b], for m = 0 .. 6. A minimum does not depend on the order, so both versions give the same
 * bits.
 */
#ifdef USE_SSE2

/* Costs 4 to 6; the last lane, which is no cost, is cleared. */
static inline __m128 load_high(const struct collapse_cost *cost)
{
    const __m128i mask = _mm_setr_epi32(-1, -1, -1, 0);
    __m128i lanes = _mm_loadu_si128((const __m128i *)(const void *)((const unsigned char *)cost + 16));
    return _mm_castsi128_ps(_mm_and_si128(lanes, mask));
}

/* {carry, v0, v1, v2} */
static inline __m128 shift_in(__m128 v, __m128 carry)
{
    return _mm_move_ss(_mm_shuffle_ps(v, v, _MM_SHUFFLE(2, 1, 0, 0)), carry);
}

static inline __m128 last_lane(__m128 v)
{
    return _mm_shuffle_ps(v, v, _MM_SHUFFLE(3, 3, 3, 3));
}

static inline void combine(const struct collapse_cost *left, const struct collapse_cost *right, float ret[8])
{
    const __m128 infinity = _mm_set1_ps(INFINITY);
    __m128 l = _mm_set1_ps(left->as[0]);
    __m128 low[4], high = load_high(right);
    low[0] = _mm_loadu_ps(right->as);
    __m128 best_low = _mm_add_ps(l, low[0]), best_high = _mm_add_ps(l, high);
    for (int a = 1; a < 4; a++) {
        high = shift_in(high, last_lane(low[a - 1]));
        low[a] = shift_in(low[a - 1], infinity);
        l = _mm_set1_ps(left->as[a]);
        best_low = _mm_min_ps(best_low, _mm_add_ps(l, low[a]));
        best_high = _mm_min_ps(best_high, _mm_add_ps(l, high));
    }
    for (int a = 4; a < COLLAPSE_BUDGETS; a++)
        best_high = _mm_min_ps(best_high, _mm_add_ps(_mm_set1_ps(left->as[a]), low[a - 4]));
    _mm_storeu_ps(ret, best_low);
    _mm_storeu_ps(ret + 4, best_high);
}

#else

static inline void combine(const struct collapse_cost *left, const struct collapse_cost *right, float ret[8])
{
    for (int m = 0; m < COLLAPSE_BUDGETS; m++) {
        ret[m] = left->as[0] + right->as[m];
        for (int a = 1; a <= m; a++) {
            float sum = left->as[a] + right->as[m - a];
            ret[m] = sum < ret[m] ? sum : ret[m];
        }
    }
}

#endif

static inline float leaf_cost_of(const struct collapse_table *table, uint32_t leaf)
{
    return measure(table, leaf) * (float)table->ir->nodes[leaf].count * table->leaf_cost;
}

/* The sum of what two children cost, for 2 .. 8 trees. A leaf takes one tree and leaves the rest, which is never worse, to its sibling. */
static inline void forest_of(const struct collapse_table *table, uint32_t first, float ret_forest[8])
{
    bool left_leaf = ir_is_leaf(table->ir, first), right_leaf = ir_is_leaf(table->ir, first + 1);
    if (!left_leaf && !right_leaf) {
        combine(&table->costs[collapse_row(table->ir, first)], &table->costs[collapse_row(table->ir, first + 1)], ret_forest);
        return;
    }
    float cost = leaf_cost_of(table, left_leaf ? first : first + 1);
    if (left_leaf && right_leaf) {
        cost += leaf_cost_of(table, first + 1);
        for (int i = 0; i < COLLAPSE_BUDGETS; i++)
            ret_forest[i] = cost;
        return;
    }
    const struct collapse_cost *other = &table->costs[collapse_row(table->ir, left_leaf ? first + 1 : first)];
    for (int i = 0; i < COLLAPSE_BUDGETS; i++)
        ret_forest[i] = cost + other->as[i];
}

void collapse_cost_of(const struct collapse_table *table, uint32_t node)
{
    uint32_t first = table->ir->nodes[node].first, refs = table->counts[first / 2];
    struct collapse_cost *cost = &table->costs[first / 2];
    float forest[8];
    forest_of(table, first, forest);

    float area = measure(table, node);
    float inner = area + table->node_cost + forest[6];
    float leaf = refs <= table->leaf_max ? area * (float)refs * table->leaf_cost : INFINITY;
    float one = leaf <= inner ? leaf : inner;
    cost->leaf_refs = leaf <= inner ? refs : 0;
    cost->as[0] = one;
    for (int i = 1; i < COLLAPSE_BUDGETS; i++)
        cost->as[i] = forest[i - 1] < one ? forest[i - 1] : one;
}

/* How many of `budget` trees the left one of two siblings takes. */
static unsigned left_share(const struct collapse_table *table, uint32_t first, unsigned budget)
{
    if (ir_is_leaf(table->ir, first))
        return 1;
    if (ir_is_leaf(table->ir, first + 1))
        return budget - 1;
    const float *left = table->costs[collapse_row(table->ir, first)].as, *right = table->costs[collapse_row(table->ir, first + 1)].as;
    unsigned best = 1;
    float least = left[0] + right[budget - 2];
    for (unsigned k = 2; k < budget; k++) {
        float cost = left[k - 1] + right[budget - k - 1];
        best = cost < least ? k : best;
        least = cost < least ? cost : least;
    }
    return best;
}

unsigned collapse_children(const struct collapse_table *table, uint32_t node, uint32_t ret_children[WIDE_ARITY])
{
    struct {
        uint32_t node;
        unsigned budget;
    } stack[WIDE_ARITY + 1];
    unsigned depth = 0, count = 0, budget = WIDE_ARITY;
    for (;;) {
        uint32_t first = table->ir->nodes[node].first;
        unsigned share = left_share(table, first, budget);
        stack[depth].node = first + 1;
        stack[depth++].budget = budget - share;
        stack[depth].node = first;
        stack[depth++].budget = share;
        for (;;) {
            if (depth == 0)
                return count;
            node = stack[--depth].node;
            budget = stack[depth].budget;
            if (budget > 1 && !ir_is_leaf(table->ir, node)) {
                const struct collapse_cost *cost = &table->costs[collapse_row(table->ir, node)];
                if (cost->as[budget - 1] < cost->as[0])
                    break; /* cheaper as a forest */
            }
            ret_children[count++] = node;
        }
    }
}
