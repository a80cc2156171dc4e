/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/wide/collapse_cost.h"

#include <math.h>
#include <string.h>

#include "builder/wide/octants.h"

#if defined(__SSE2__) && !defined(BVHD_SCALAR)
#define USE_SSE2 1
#include <emmintrin.h>
#endif

/*
 * Computes the sides in the table's scale. Their rounding does not matter for a cost, but it is the same on every
 * machine.
 */
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

/*
 * Returns the measure (area or length) of a node relative to the root's, summed over all motion keys: areas of linearly
 * moving boxes average over time.
 */
static inline float measure(const struct collapse_table *table, uint32_t node)
{
    float sum = measure_box(table, &table->ir->boxes[0][node]);
    for (uint32_t key = 1; key < table->ir->key_count; key++)
        sum += measure_box(table, &table->ir->boxes[key][node]);
    return sum * table->inverse;
}

/* Returns the power of two that brings the longest side to between 1 and 2, as far as normal floats allow. */
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

/* Smaller areas count as none: they have lost their bits, and their inverse is not finite. */
static const float smallest_area = 0x1p-100f;

void collapse_table_init(struct collapse_table *table, const struct ir *ir, const struct collapse_options *options)
{
    struct box all = ir->boxes[0][0];
    for (uint32_t key = 1; key < ir->key_count; key++)
        box_grow(&all, &ir->boxes[key][0]);
    *table = (struct collapse_table){
        .ir = ir,
        .leaf_max = options->leaf_max,
        .order_rounds = options->quick_order ? 1 : OCTANTS_ROUNDS,
        .leaf_cost = options->leaf_cost,
        .node_cost = (float)(COLLAPSE_NODE_SHARE / (ir->ref_count + 1.0)),
        .scale = scale_for(&all),
        .inverse = 1,
    };
    float root = measure(table, 0);
    if (root < smallest_area) {
        table->lengths = true;
        root = measure(table, 0);
    }
    table->inverse = root > 0 ? 1 / root : 0;
}

/* The row of a leaf of the ir: it can be one tree, but not a forest of more. */
#define NO_FOREST                                                                                                      \
    {                                                                                                                  \
        {INFINITY, INFINITY, INFINITY, INFINITY, INFINITY, INFINITY, INFINITY}, 0                                      \
    }

/*
 * Three functions that exist with SSE2 and without. measure_pair: the measures of two siblings. worth: the costs of a
 * node, from its forests and its measure; with more than leaf_max refs it cannot be a leaf. combine: ret[m] = min over
 * a + b = m of left[a] + right[b], for m = 0 .. 6. A minimum does not depend on the order, so both versions give the
 * same bits. There are no branches, because which of two siblings are leaves is unpredictable.
 */
struct costs {
#ifdef USE_SSE2
    __m128 low, high; /* the eighth lane is no cost */
#else
    float as[COLLAPSE_BUDGETS];
#endif
};

#ifdef USE_SSE2

static inline __m128 sides_in_lanes(const struct box *box, __m128 scale)
{
    __m128 end = _mm_loadu_ps(box->min + 2), max = _mm_shuffle_ps(end, end, _MM_SHUFFLE(3, 3, 2, 1));
    return _mm_sub_ps(_mm_mul_ps(max, scale), _mm_mul_ps(_mm_loadu_ps(box->min), scale));
}

static inline void measure_pair(const struct collapse_table *table, uint32_t first, float ret_measures[2])
{
    const __m128 scale = _mm_set1_ps(table->scale);
    __m128 sum = _mm_setzero_ps();
    for (uint32_t key = 0; key < table->ir->key_count; key++) {
        const struct box *boxes = &table->ir->boxes[key][first];
        __m128 left = sides_in_lanes(&boxes[0], scale), right = sides_in_lanes(&boxes[1], scale);
        __m128 x = _mm_unpacklo_ps(left, right), y = _mm_movehl_ps(x, x), z = _mm_unpackhi_ps(left, right), own;
        if (table->lengths)
            own = _mm_add_ps(_mm_add_ps(x, y), z);
        else
            own = _mm_add_ps(_mm_add_ps(_mm_mul_ps(x, y), _mm_mul_ps(y, z)), _mm_mul_ps(z, x));
        sum = key == 0 ? own : _mm_add_ps(sum, own);
    }
    _mm_storel_epi64((__m128i *)(void *)ret_measures, _mm_castps_si128(_mm_mul_ps(sum, _mm_set1_ps(table->inverse))));
}

#define LANE(v, i) _mm_shuffle_ps(v, v, _MM_SHUFFLE(i, i, i, i))

/* Returns {carry, v0, v1, v2}. */
static inline __m128 shift_in(__m128 v, __m128 carry)
{
    return _mm_move_ss(_mm_shuffle_ps(v, v, _MM_SHUFFLE(2, 1, 0, 0)), carry);
}

/*
 * Loads a cost in the same halves in which it was stored: a load across both halves would be slow directly afterwards.
 */
static inline void load_cost(const struct collapse_cost *cost, __m128 *ret_low, __m128 *ret_high)
{
    *ret_low = _mm_loadu_ps(cost->as);
    *ret_high = _mm_castsi128_ps(_mm_loadu_si128((const __m128i *)(const void *)((const unsigned char *)cost + 16)));
}

static inline void store_cost(struct costs costs, __m128i number, struct collapse_cost *ret)
{
    const __m128i last = _mm_setr_epi32(0, 0, 0, -1);
    __m128i high = _mm_or_si128(_mm_andnot_si128(last, _mm_castps_si128(costs.high)), _mm_and_si128(last, number));
    _mm_storeu_ps(ret->as, costs.low);
    _mm_storeu_si128((__m128i *)(void *)((unsigned char *)ret + 16), high);
}

static inline struct costs worth(const struct collapse_table *table, const struct collapse_cost *forest, float area,
                                 uint32_t refs, struct collapse_cost *ret_cost)
{
    const __m128 infinity = _mm_set1_ps(INFINITY);
    __m128 low, high, areas = _mm_set1_ps(area);
    __m128i count = _mm_set1_epi32((int32_t)refs);
    load_cost(forest, &low, &high);
    __m128 inner = _mm_add_ps(_mm_add_ps(areas, _mm_set1_ps(table->node_cost)), LANE(high, 2));
    __m128 leaf = _mm_mul_ps(_mm_mul_ps(areas, _mm_cvtepi32_ps(count)), _mm_set1_ps(table->leaf_cost));
    __m128 large = _mm_castsi128_ps(_mm_cmpgt_epi32(count, _mm_set1_epi32((int32_t)table->leaf_max)));
    leaf = _mm_max_ps(leaf, _mm_and_ps(large, infinity));
    __m128 one = _mm_min_ps(leaf, inner);
    __m128i leaf_refs = _mm_and_si128(_mm_castps_si128(_mm_cmple_ps(leaf, inner)), count);
    struct costs costs = {_mm_min_ps(one, shift_in(low, one)), _mm_min_ps(one, shift_in(high, LANE(low, 3)))};
    store_cost(costs, leaf_refs, ret_cost);
    return costs;
}

/* Selects two lanes of v and two of w: v0, v1 | w0, w1. */
#define LANES(v, v0, v1, w, w0, w1) _mm_shuffle_ps(v, w, _MM_SHUFFLE(w1, w0, v1, v0))

/* Takes the minima as a tree, to keep the chain short: rows wait for the row before. */
static inline void combine(const struct costs *left, const struct costs *right, uint32_t refs,
                           struct collapse_cost *ret)
{
    const __m128 infinity = _mm_set1_ps(INFINITY), low = right->low, high = right->high;
    const __m128 low2 = _mm_movelh_ps(infinity, low), high2 = LANES(low, 2, 3, high, 0, 1);
    const __m128 lows[4] = {low, LANES(low2, 1, 2, low, 1, 2), low2, LANES(infinity, 0, 0, low2, 0, 2)};
    const __m128 highs[4] = {high, LANES(high2, 1, 2, high, 1, 2), high2, LANES(low, 1, 2, high2, 1, 2)};
    const __m128 l[4] = {LANE(left->low, 0), LANE(left->low, 1), LANE(left->low, 2), LANE(left->low, 3)};
    __m128 sums[4], upper[4], least = _mm_add_ps(LANE(left->high, 0), low);
    for (int a = 0; a < 4; a++) {
        sums[a] = _mm_add_ps(l[a], lows[a]);
        upper[a] = _mm_add_ps(l[a], highs[a]);
    }
    least = _mm_min_ps(least,
                       _mm_min_ps(_mm_add_ps(LANE(left->high, 1), lows[1]), _mm_add_ps(LANE(left->high, 2), lows[2])));
    struct costs best = {
        _mm_min_ps(_mm_min_ps(sums[0], sums[1]), _mm_min_ps(sums[2], sums[3])),
        _mm_min_ps(least, _mm_min_ps(_mm_min_ps(upper[0], upper[1]), _mm_min_ps(upper[2], upper[3]))),
    };
    store_cost(best, _mm_set1_epi32((int32_t)refs), ret);
}

#else

static inline void measure_pair(const struct collapse_table *table, uint32_t first, float ret_measures[2])
{
    ret_measures[0] = measure(table, first);
    ret_measures[1] = measure(table, first + 1);
}

static inline struct costs worth(const struct collapse_table *table, const struct collapse_cost *forest, float area,
                                 uint32_t refs, struct collapse_cost *ret_cost)
{
    struct costs costs;
    float inner = area + table->node_cost + forest->as[6];
    float leaf = refs <= table->leaf_max ? area * (float)refs * table->leaf_cost : INFINITY;
    float one = leaf <= inner ? leaf : inner;
    costs.as[0] = one;
    for (int i = 1; i < COLLAPSE_BUDGETS; i++)
        costs.as[i] = forest->as[i - 1] < one ? forest->as[i - 1] : one;
    memcpy(ret_cost->as, costs.as, sizeof costs.as);
    ret_cost->leaf_refs = leaf <= inner ? refs : 0;
    return costs;
}

static inline void combine(const struct costs *left, const struct costs *right, uint32_t refs,
                           struct collapse_cost *ret)
{
    for (int m = 0; m < COLLAPSE_BUDGETS; m++) {
        ret->as[m] = left->as[0] + right->as[m];
        for (int a = 1; a <= m; a++) {
            float sum = left->as[a] + right->as[m - a];
            ret->as[m] = sum < ret->as[m] ? sum : ret->as[m];
        }
    }
    ret->leaf_refs = refs;
}

#endif

/* A leaf takes one tree and leaves the rest of the budget to its sibling, which is never worse. */
void collapse_cost_of(const struct collapse_table *table, uint32_t row)
{
    struct collapse_cost leaves[2] = {NO_FOREST, NO_FOREST};
    const struct ir_node *pair = &table->ir->nodes[2 * row + 1];
    struct costs costs[2];
    float measures[2];
    uint32_t sum = 0;
    measure_pair(table, 2 * row + 1, measures);
    for (int side = 0; side < 2; side++) {
        bool leaf = pair[side].count != 0;
        struct collapse_cost *const choice[2] = {&table->costs[leaf ? 0 : pair[side].first / 2], &leaves[side]};
        struct collapse_cost *own = choice[leaf];
        uint32_t refs = pair[side].count + own->leaf_refs;
        costs[side] = worth(table, own, measures[side], refs, own);
        sum += refs;
    }
    combine(&costs[0], &costs[1], sum, &table->costs[row]);
    table->counts[row] = sum;
}

void collapse_cost_end(const struct collapse_table *table)
{
    struct collapse_cost *root = &table->costs[0];
    worth(table, root, measure(table, 0), root->leaf_refs, root);
}

/* Returns how many of `budget` trees the left one of two siblings gets. */
static unsigned left_share(const struct collapse_table *table, uint32_t first, unsigned budget)
{
    if (ir_is_leaf(table->ir, first))
        return 1;
    if (ir_is_leaf(table->ir, first + 1))
        return budget - 1;
    const float *left = table->costs[collapse_row(table->ir, first)].as,
                *right = table->costs[collapse_row(table->ir, first + 1)].as;
    unsigned best = 1;
    float least = left[0] + right[budget - 2];
    for (unsigned k = 2; k < budget; k++) {
        float cost = left[k - 1] + right[budget - k - 1];
        best = cost < least ? k : best;
        least = cost < least ? cost : least;
    }
    return best;
}

/* Returns the first ref below a node. The recursion is short: a subtree that becomes a leaf has only a few nodes. */
static uint32_t first_ref(const struct ir *ir, uint32_t node)
{
    uint32_t first = ir->nodes[node].first;
    if (ir_is_leaf(ir, node))
        return first;
    uint32_t left = first_ref(ir, first), right = first_ref(ir, first + 1);
    return left < right ? left : right;
}

unsigned collapse_children(const struct collapse_table *table, uint32_t node,
                           struct wide_child ret_children[WIDE_ARITY])
{
    struct {
        uint32_t node;
        unsigned budget;
    } stack[WIDE_ARITY + 1];
    const struct ir *ir = table->ir;
    unsigned depth = 0, count = 0;
    stack[depth].node = node;
    stack[depth++].budget = WIDE_ARITY;
    while (depth > 0) {
        uint32_t at = stack[--depth].node, first = ir->nodes[at].first, refs = ir->nodes[at].count;
        unsigned budget = stack[depth].budget;
        if (refs == 0) {
            const struct collapse_cost *cost = &table->costs[first / 2];
            if (budget == WIDE_ARITY || (budget > 1 && cost->as[budget - 1] < cost->as[0])) { /* cheaper as a forest */
                unsigned share = left_share(table, first, budget);
                stack[depth].node = first + 1;
                stack[depth++].budget = budget - share;
                stack[depth].node = first;
                stack[depth++].budget = share;
                continue;
            }
            refs = cost->leaf_refs;
            first = refs ? first_ref(ir, at) : 0;
        }
        ret_children[count++] = (struct wide_child){at, first, refs};
    }
    return count;
}
