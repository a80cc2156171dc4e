/* SPDX-License-Identifier: Apache-2.0 */
/* test_collapse.c - tests that collapse() gives sound wide trees of least cost, in every version. */
#include "tests/support/unit.h"

#include <float.h>
#include <math.h>
#include <time.h>

#include "builder/wide/collapse.h"
#include "builder/wide/collapse_cost.h"
#include "tests/support/builder/test_ir.h"
#include "builder/workers.h"

/* Include the version without SSE2, which the library leaves out where it has SSE2. */
#define BVHD_SCALAR
#define collapse_cost_of collapse_cost_of_scalar
#define collapse_table_init collapse_table_init_scalar
#define collapse_children collapse_children_scalar
#define collapse_cost_end collapse_cost_end_scalar
void collapse_cost_of_scalar(const struct collapse_table *table, uint32_t row);
void collapse_cost_end_scalar(const struct collapse_table *table);
void collapse_table_init_scalar(struct collapse_table *table, const struct ir *ir,
                                const struct collapse_options *options);
unsigned collapse_children_scalar(const struct collapse_table *table, uint32_t node,
                                  struct wide_child ret_children[WIDE_ARITY]);
#include "builder/wide/collapse_cost.c"
#undef collapse_cost_of
#undef collapse_table_init
#undef collapse_children
#undef collapse_cost_end

static const struct collapse_options options = {.leaf_max = 3, .leaf_cost = 0.3f};

static const struct test_shape cloud = {
    .type = GEOMETRY_AABBS, .geometries = 1, .primitives = 2000, .size = 10, .detail = 0.02};

static void make_cloud(uint32_t count, uint32_t leaf_max, uint64_t seed, struct memory *memory, struct ir *ret_ir)
{
    struct test_shape shape = cloud;
    struct test_model model;
    shape.primitives = count;
    test_model_make(&shape, seed, &model);
    assert_int_equal(test_ir_make(model.boxes, count, leaf_max, memory, ret_ir), BVHD_OK);
    test_model_finish(&model);
}

/* True when `node` is `ancestor` or below it. */
static bool is_below(const struct ir *ir, uint32_t ancestor, uint32_t node)
{
    if (ancestor == node)
        return true;
    if (ir_is_leaf(ir, ancestor) || node < ancestor)
        return false;
    return is_below(ir, ir->nodes[ancestor].first, node) || is_below(ir, ir->nodes[ancestor].first + 1, node);
}

static uint32_t refs_below(const struct ir *ir, uint32_t node, uint32_t *ret_first)
{
    if (ir_is_leaf(ir, node)) {
        *ret_first = ir->nodes[node].first;
        return ir->nodes[node].count;
    }
    uint32_t left, right, count = refs_below(ir, ir->nodes[node].first, &left);
    count += refs_below(ir, ir->nodes[node].first + 1, &right);
    *ret_first = left < right ? left : right;
    return count;
}

/* Checks the order that wide.h states: visits are depth first, each with one block for its inner children. */
static void check_order(const struct wide *wide)
{
    uint32_t *stack = calloc(wide->node_count * 8 + 8, sizeof *stack), depth = 0, next = 1, refs = 0;
    uint32_t *levels = calloc(wide->node_count + 1, sizeof *levels), deepest = 0;
    assert_non_null(stack);
    assert_non_null(levels);
    stack[depth++] = 0;
    levels[0] = 1;
    while (depth > 0) {
        uint32_t i = stack[--depth];
        const struct wide_node *node = &wide->nodes[i];
        uint32_t inner = 0;
        deepest = levels[i] > deepest ? levels[i] : deepest;
        for (int slot = 0; slot < 8; slot++)
            if (wide_kind(&node->slots[slot]) == WIDE_INNER) {
                assert_int_equal(wide->nodes[next + inner].node, node->slots[slot].node);
                levels[next + inner] = levels[i] + 1;
                inner++;
            }
        assert_int_equal(node->first_child, inner ? next : 0);
        for (uint32_t k = inner; k-- > 0;)
            stack[depth++] = next + k;
        next += inner;
    }
    assert_int_equal(next, wide->node_count);
    assert_int_equal(deepest, wide->depth);
    for (uint32_t i = 0; i < wide->node_count; i++) {
        assert_int_equal(wide->nodes[i].first_leaf, refs);
        for (int slot = 0; slot < 8; slot++)
            refs += wide->nodes[i].slots[slot].ref_count;
    }
    assert_int_equal(refs, wide->leaf_refs);
    free(levels);
    free(stack);
}

/* Checks that the children of a node cover its refs once, and are ir nodes below it. */
static void check_cover(const struct ir *ir, const struct wide *wide, uint32_t leaf_max)
{
    uint8_t *seen = calloc(ir->ref_count, 1);
    assert_non_null(seen);
    for (uint32_t i = 0; i < wide->node_count; i++) {
        uint32_t first, own = refs_below(ir, wide->nodes[i].node, &first), sum = 0, children = 0;
        for (int slot = 0; slot < 8; slot++) {
            const struct wide_child *child = &wide->nodes[i].slots[slot];
            if (wide_kind(child) == WIDE_EMPTY) {
                assert_int_equal(child->node | child->first_ref | child->ref_count, 0);
                continue;
            }
            children++;
            assert_true(is_below(ir, wide->nodes[i].node, child->node));
            uint32_t count = refs_below(ir, child->node, &first);
            sum += count;
            if (child->ref_count == 0)
                continue;
            assert_int_equal(child->ref_count, count);
            assert_int_equal(child->first_ref, first);
            assert_true(count <= leaf_max);
            for (uint32_t k = 0; k < count; k++)
                assert_int_equal(seen[first + k]++, 0);
        }
        assert_true(children > 1 || ir->node_count == 1 || wide->nodes[i].node == 0);
        assert_int_equal(sum, own);
    }
    for (uint32_t i = 0; i < ir->ref_count; i++)
        assert_int_equal(seen[i], 1);
    free(seen);
}

/* Returns what a wide node costs beside its area. */
static double node_cost(const struct ir *ir)
{
    return COLLAPSE_NODE_SHARE / (ir->ref_count + 1) * box_half_area(&ir->boxes[0][0]);
}

static double wide_cost(const struct ir *ir, const struct wide *wide, double leaf_cost)
{
    double sum = 0;
    for (uint32_t i = 0; i < wide->node_count; i++) {
        sum += box_half_area(&ir->boxes[0][wide->nodes[i].node]) + node_cost(ir);
        for (int slot = 0; slot < 8; slot++) {
            const struct wide_child *child = &wide->nodes[i].slots[slot];
            sum += child->ref_count * leaf_cost * box_half_area(&ir->boxes[0][child->node]) * (child->ref_count > 0);
        }
    }
    return sum / box_half_area(&ir->boxes[0][0]);
}

/* Returns the least cost of `node` as at most `budget` wide trees, directly by the definition. */
static double least_cost(const struct ir *ir, uint32_t node, unsigned budget, double leaf_cost, uint32_t leaf_max);

static double least_distribution(const struct ir *ir, uint32_t node, unsigned budget, double leaf_cost,
                                 uint32_t leaf_max)
{
    uint32_t first = ir->nodes[node].first;
    double least = INFINITY;
    for (unsigned k = 1; k < budget && k < 8; k++)
        if (budget - k < 8)
            least = fmin(least, least_cost(ir, first, k, leaf_cost, leaf_max) +
                                    least_cost(ir, first + 1, budget - k, leaf_cost, leaf_max));
    return least;
}

static double memo[2048][8];

static double least_cost(const struct ir *ir, uint32_t node, unsigned budget, double leaf_cost, uint32_t leaf_max)
{
    if (memo[node][budget] >= 0)
        return memo[node][budget];
    uint32_t first, refs = refs_below(ir, node, &first);
    double area = box_half_area(&ir->boxes[0][node]);
    double cost = refs <= leaf_max ? area * refs * leaf_cost : INFINITY;
    if (!ir_is_leaf(ir, node)) {
        cost = fmin(cost, area + node_cost(ir) + least_distribution(ir, node, 8, leaf_cost, leaf_max));
        for (unsigned i = 2; i <= budget; i++)
            cost = fmin(cost, least_distribution(ir, node, i, leaf_cost, leaf_max));
    }
    return memo[node][budget] = cost;
}

static void cost_is_the_least(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (uint32_t leaf_max = 1; leaf_max <= 3; leaf_max++)
        for (uint32_t count = 2; count < 700; count = count * 5 / 3 + 1) {
            struct ir ir;
            struct wide wide;
            struct collapse_options asked = {.leaf_max = leaf_max, .leaf_cost = 0.4f};
            make_cloud(count, 1, count, &memory, &ir);
            assert_int_equal(collapse(&ir, &asked, &memory, &parallel_serial, &wide, NULL), BVHD_OK);
            for (unsigned i = 0; i < 2048; i++)
                for (unsigned k = 0; k < 8; k++)
                    memo[i][k] = -1;
            double root = box_half_area(&ir.boxes[0][0]);
            double least = 1 + (node_cost(&ir) + least_distribution(&ir, 0, 8, 0.4f, leaf_max)) / root;
            double cost = wide_cost(&ir, &wide, 0.4f);
            assert_true(fabs(cost - least) <= least * 1e-5);
            wide_finish(&wide);
            ir_finish(&ir);
        }
    assert_int_equal(memory.live, 0);
}

static void scalar_costs_are_the_same_bits(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct ir ir;
    make_cloud(1000, 1, 12, &memory, &ir);
    collapse_cost_function *const functions[] = {collapse_cost_of_scalar, collapse_cost_of, collapse_cost_avx2()};
    struct collapse_table tables[3];
    for (int i = 0; i < 3; i++) {
        (i ? collapse_table_init : collapse_table_init_scalar)(&tables[i], &ir, &options);
        tables[i].counts = calloc(collapse_rows(&ir), sizeof *tables[i].counts);
        tables[i].costs = calloc(collapse_rows(&ir), sizeof *tables[i].costs);
        assert_non_null(tables[i].counts);
        assert_non_null(tables[i].costs);
        for (uint32_t row = collapse_rows(&ir); row-- > 0;)
            functions[i](&tables[i], row);
        (i ? collapse_cost_end : collapse_cost_end_scalar)(&tables[i]);
    }
    for (int i = 1; i < 3; i++) {
        assert_memory_equal(tables[0].costs, tables[i].costs, collapse_rows(&ir) * sizeof *tables[0].costs);
        assert_memory_equal(tables[0].counts, tables[i].counts, collapse_rows(&ir) * sizeof *tables[0].counts);
    }
    assert_int_equal(tables[0].counts[0], 1000);
    for (int i = 0; i < 3; i++) {
        free(tables[i].costs);
        free(tables[i].counts);
    }
    ir_finish(&ir);
    assert_int_equal(memory.live, 0);
}

static void every_size_keeps_the_invariants(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (uint32_t count = 1; count < 1200; count += 1 + count / 9)
        for (uint32_t leaf_max = 1; leaf_max <= 3; leaf_max++) {
            struct ir ir;
            struct wide wide;
            make_cloud(count, leaf_max, 77 + count, &memory, &ir);
            assert_int_equal(collapse(&ir, &options, &memory, &parallel_serial, &wide, NULL), BVHD_OK);
            check_order(&wide);
            check_cover(&ir, &wide, 3);
            wide_finish(&wide);
            ir_finish(&ir);
        }
    assert_int_equal(memory.live, 0);
}

/* The boxes of one key may be far larger than those of the other: then it decides, as if it were alone. */
static void keys_differ_in_scale(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int large = 0; large < 2; large++) {
        struct ir ir;
        struct wide alone, wide;
        make_cloud(2000, 3, 6, &memory, &ir);
        assert_int_equal(collapse(&ir, &options, &memory, &parallel_serial, &alone, NULL), BVHD_OK);
        ir.boxes[1] = memory_array(&memory, ir.node_count, sizeof *ir.boxes[1]);
        assert_non_null(ir.boxes[1]);
        for (uint32_t node = 0; node < ir.node_count; node++)
            for (int axis = 0; axis < 3; axis++) {
                const float min = ir.boxes[0][node].min[axis], max = ir.boxes[0][node].max[axis];
                ir.boxes[large][node].min[axis] = min * 0x1p100f;
                ir.boxes[large][node].max[axis] = max * 0x1p100f;
                ir.boxes[!large][node].min[axis] = min * 0x1p-20f;
                ir.boxes[!large][node].max[axis] = max * 0x1p-20f;
            }
        ir.key_count = 2;
        assert_int_equal(collapse(&ir, &options, &memory, &parallel_serial, &wide, NULL), BVHD_OK);
        check_order(&wide);
        check_cover(&ir, &wide, 3);
        assert_int_equal(wide.node_count, alone.node_count);
        wide_finish(&wide);
        wide_finish(&alone);
        ir_finish(&ir);
    }
    assert_int_equal(memory.live, 0);
}

static void empty_gives_empty(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct ir ir = {.key_count = 1, .memory = &memory};
    struct wide wide;
    assert_int_equal(collapse(&ir, &options, &memory, &parallel_serial, &wide, NULL), BVHD_OK);
    assert_int_equal(wide.node_count | wide.leaf_refs | wide.depth, 0);
    wide_finish(&wide);
    wide_finish(&wide);
    wide_finish(NULL);
}

/* A single leaf becomes one node with one child. */
static void one_leaf_gives_one_node(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (uint32_t count = 1; count <= 3; count++) {
        struct ir ir;
        struct wide wide;
        make_cloud(count, 3, 5, &memory, &ir);
        assert_int_equal(ir.node_count, 1);
        assert_int_equal(collapse(&ir, &options, &memory, &parallel_serial, &wide, NULL), BVHD_OK);
        assert_int_equal(wide.node_count, 1);
        assert_int_equal(wide.depth, 1);
        assert_int_equal(wide.leaf_refs, count);
        check_cover(&ir, &wide, 3);
        wide_finish(&wide);
        ir_finish(&ir);
    }
    assert_int_equal(memory.live, 0);
}

/* The tree is large enough for many tasks. */
static void threads_do_not_matter(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct ir ir;
    struct wide wides[3];
    make_cloud(60000, 2, 3, &memory, &ir);
    static const unsigned threads[] = {1, 2, 8};
    for (int i = 0; i < 3; i++) {
        struct workers *workers;
        assert_int_equal(workers_create(threads[i], &workers, NULL), BVHD_OK);
        assert_int_equal(collapse(&ir, &options, &memory, workers_parallel(workers), &wides[i], NULL), BVHD_OK);
        workers_destroy(workers);
    }
    check_order(&wides[0]);
    check_cover(&ir, &wides[0], 3);
    for (int i = 1; i < 3; i++) {
        assert_int_equal(wides[i].node_count, wides[0].node_count);
        assert_memory_equal(wides[i].nodes, wides[0].nodes, wides[0].node_count * sizeof *wides[0].nodes);
    }
    for (int i = 0; i < 3; i++)
        wide_finish(&wides[i]);
    ir_finish(&ir);
    assert_int_equal(memory.live, 0);
}

/* Makes a tree that is one long path with leaves of one ref beside it: the deepest there is. */
static void make_chain(uint32_t leaves, struct memory *memory, struct ir *ret_ir)
{
    assert_int_equal(ir_init(ret_ir, memory, 2 * leaves - 1, leaves, NULL), BVHD_OK);
    ret_ir->node_count = 2 * leaves - 1;
    ret_ir->ref_count = leaves;
    for (uint32_t i = 0; i < leaves; i++) {
        uint32_t node = i + 1 < leaves ? 2 * i : 2 * leaves - 2;
        float end = (float)(leaves - i);
        struct box box = {{0, 0, 0}, {end, 1, 1}}, leaf_box = {{end - 1, 0, 0}, {end, 1, 1}};
        ret_ir->refs[i] = i;
        ret_ir->boxes[0][node] = box;
        if (i + 1 == leaves) {
            ret_ir->nodes[node] = (struct ir_node){i, 1};
            break;
        }
        ret_ir->nodes[node] = (struct ir_node){node + 1, 0};
        ret_ir->nodes[node + 1] = (struct ir_node){i, 1};
        ret_ir->boxes[0][node + 1] = leaf_box;
    }
    /* The path continues through the second child, so inner nodes have even numbers. */
    for (uint32_t i = 0; i + 1 < leaves; i++)
        assert_false(ir_is_leaf(ret_ir, 2 * i));
}

static void a_long_path_is_no_problem(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct ir ir;
    struct wide wide;
    make_chain(20000, &memory, &ir);
    assert_int_equal(collapse(&ir, &options, &memory, &parallel_serial, &wide, NULL), BVHD_OK);
    check_order(&wide);
    assert_true(wide.depth >= 20000 / 7 / 3);
    assert_int_equal(wide.leaf_refs, 20000);
    wide_finish(&wide);
    ir_finish(&ir);
    assert_int_equal(memory.live, 0);
}

/* Areas are zero, overflow a float, or are tiny: the tree stays sound and its nodes filled. */
static void magnitudes_do_not_matter(void **state)
{
    (void)state;
    static const double sizes[] = {0, 1e-44, 1e-30, 1e19, 3e37};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int i = 0; i < 5; i++) {
        struct test_shape shape = cloud;
        struct test_model model;
        struct ir ir;
        struct wide wide;
        shape.size = sizes[i];
        test_model_make(&shape, 9, &model);
        assert_int_equal(test_ir_make(model.boxes, shape.primitives, 3, &memory, &ir), BVHD_OK);
        assert_int_equal(collapse(&ir, &options, &memory, &parallel_serial, &wide, NULL), BVHD_OK);
        check_order(&wide);
        check_cover(&ir, &wide, 3);
        assert_true(wide.node_count < shape.primitives / 4);
        wide_finish(&wide);
        ir_finish(&ir);
        test_model_finish(&model);
    }
    assert_int_equal(memory.live, 0);
}

/* Returns how many allocations can fail. */
static int fail_everywhere(const struct ir *ir, struct memory *memory, const struct parallel *parallel)
{
    uint64_t live = memory->live;
    enum bvhd_status status = BVHD_NO_MEMORY;
    int failures = 0;
    for (int n = 0; status != BVHD_OK; n++) {
        struct wide wide;
        struct bvhd_error error;
        memory->fail_after = n;
        status = collapse(ir, &options, memory, parallel, &wide, &error);
        memory->fail_after = -1;
        if (status == BVHD_OK) {
            wide_finish(&wide);
        } else {
            assert_int_equal(status, BVHD_NO_MEMORY);
            assert_int_equal(error.status, BVHD_NO_MEMORY);
            failures++;
        }
        assert_int_equal(memory->live, live);
    }
    return failures;
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    const struct parallel as_if_two = {.threads = 2, .for_each = parallel_serial.for_each};
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct ir ir;
    make_cloud(30000, 3, 4, &memory, &ir);
    assert_true(fail_everywhere(&ir, &memory, &as_if_two) >= 6);
    assert_true(fail_everywhere(&ir, &memory, &parallel_serial) >= 4);
    ir_finish(&ir);
}

static void cancel_is_heard(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct ir ir;
    struct wide wide;
    atomic_bool cancel = true;
    struct collapse_options asked = {.leaf_max = 3, .leaf_cost = 0.3f, .cancel = &cancel};
    make_cloud(20000, 3, 4, &memory, &ir);
    uint64_t live = memory.live;
    assert_int_equal(collapse(&ir, &asked, &memory, &parallel_serial, &wide, NULL), BVHD_CANCELLED);
    assert_int_equal(memory.live, live);
    ir_finish(&ir);
}

static void a_leaf_too_large_is_our_bug(void **state)
{
    (void)state;
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct ir ir;
    struct wide wide;
    struct bvhd_error error;
    make_cloud(100, 4, 4, &memory, &ir);
    assert_int_equal(collapse(&ir, &options, &memory, &parallel_serial, &wide, &error), BVHD_INTERNAL);
    assert_non_null(strstr(error.where, "ir.nodes["));
    ir_finish(&ir);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cost_is_the_least),
        cmocka_unit_test(scalar_costs_are_the_same_bits),
        cmocka_unit_test(every_size_keeps_the_invariants),
        cmocka_unit_test(keys_differ_in_scale),
        cmocka_unit_test(empty_gives_empty),
        cmocka_unit_test(one_leaf_gives_one_node),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(a_long_path_is_no_problem),
        cmocka_unit_test(magnitudes_do_not_matter),
        cmocka_unit_test(every_allocation_may_fail),
        cmocka_unit_test(cancel_is_heard),
        cmocka_unit_test(a_leaf_too_large_is_our_bug),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
