/* SPDX-License-Identifier: Apache-2.0 */
#include "collapse_cost.h"

#include <math.h>

#ifdef __SSE2__
#include <emmintrin.h>
#endif

/*
 * A wide node costs its area, plus this share of the root's area divided by the number of refs: it breaks ties among nodes without area
 * and fills nodes better where that costs next to nothing.
 */
static const double NODE_SHARE = 0.05;

static double lengths_of(const struct box *box)
{
    return ((double)box->max[0] - box->min[0]) + ((double)box->max[1] - box->min[1]) + ((double)box->max[2] - box->min[2]);
}

/* Over all motion keys: areas of linearly moving boxes average over time. */
static double measure(const struct collapse_table *table, uint32_t node)
{
    double sum = 0;
    for (uint32_t key = 0; key < table->ir->key_count; key++) {
        const struct box *box = &table->ir->boxes[key][node];
        sum += table->lengths ? lengths_of(box) : box_half_area(box);
    }
    return sum * table->inverse_measure;
}

void collapse_table_init(struct collapse_table *table, const struct ir *ir, const struct collapse_options *options)
{
    *table = (struct collapse_table){
        .ir = ir,
        .leaf_max = options->leaf_max,
        .leaf_cost = options->leaf_cost,
        .node_cost = NODE_SHARE / (ir->ref_count + 1.0),
        .inverse_measure = 1,
    };
    double root = measure(table, 0);
    if (root == 0) {
        table->lengths = true;
        root = measure(table, 0);
    }
    table->inverse_measure = root > 0 ? 1 / root : 0;
}

/*
 * ret[m] = min over a + b = m of left[a] + right[b], for m = 0 .. 6. A minimum does not depend on the order, so both versions give the same
 * bits.
 */
#ifdef __SSE2__

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

static void cost_of_leaf(const struct collapse_table *table, uint32_t node, struct collapse_cost *cost)
{
    float leaf = (float)(measure(table, node) * table->counts[node] * table->leaf_cost);
    for (int i = 0; i < COLLAPSE_BUDGETS; i++)
        cost->as[i] = leaf;
    cost->leaf_refs = table->counts[node];
}

void collapse_cost_of(const struct collapse_table *table, uint32_t node)
{
    struct collapse_cost *cost = &table->costs[node];
    if (ir_is_leaf(table->ir, node)) {
        cost_of_leaf(table, node, cost);
        return;
    }
    uint32_t first = table->ir->nodes[node].first, refs = table->counts[node];
    float forest[8];
    combine(&table->costs[first], &table->costs[first + 1], forest);

    double area = measure(table, node);
    float inner = (float)(area + table->node_cost) + forest[6];
    float leaf = refs <= table->leaf_max ? (float)(area * refs * table->leaf_cost) : INFINITY;
    float one = leaf <= inner ? leaf : inner;
    cost->leaf_refs = leaf <= inner ? refs : 0;
    cost->as[0] = one;
    for (int i = 1; i < COLLAPSE_BUDGETS; i++)
        cost->as[i] = forest[i - 1] < one ? forest[i - 1] : one;
}

/* How many of `budget` trees the left child takes. */
static unsigned left_share(const struct collapse_cost *left, const struct collapse_cost *right, unsigned budget)
{
    unsigned best = 1;
    float least = left->as[0] + right->as[budget - 2];
    for (unsigned k = 2; k < budget; k++) {
        float cost = left->as[k - 1] + right->as[budget - k - 1];
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
        unsigned share = left_share(&table->costs[first], &table->costs[first + 1], budget);
        stack[depth].node = first + 1;
        stack[depth++].budget = budget - share;
        stack[depth].node = first;
        stack[depth++].budget = share;
        for (;;) {
            if (depth == 0)
                return count;
            node = stack[--depth].node;
            budget = stack[depth].budget;
            const struct collapse_cost *cost = &table->costs[node];
            if (budget > 1 && cost->as[budget - 1] < cost->as[0])
                break; /* cheaper as a forest */
            ret_children[count++] = node;
        }
    }
}
