/* SPDX-License-Identifier: Apache-2.0 */
/* test_wide_pieces.c - tests that wide trees of pieces are joined into one sound wide tree. */
#include "tests/support/unit.h"

#include <string.h>

#include "tests/support/builder/test_ir.h"
#include "builder/top/wide_pieces.h"
#include "builder/workers.h"

enum { PIECES = 23, EACH = 300, MOST = PIECES * EACH };

static const struct collapse_options options = {.leaf_max = 3, .leaf_cost = 0.3f, .quick_order = true};

/* Primitives in consecutive pieces, the tree of each piece, and a tree of the pieces. */
struct world {
    struct test_model model;
    struct box bounds[PIECES];
    struct ir irs[PIECES], top;
    struct wide_piece pieces[PIECES];
    const struct wide_piece *list[PIECES];
    uint32_t firsts[PIECES + 1];
    bool moves; /* trees have a second key, whose boxes are those of the first one elsewhere */
};

static struct box box_elsewhere(const struct box *box)
{
    struct box other = *box;
    for (int axis = 0; axis < 3; axis++) {
        other.min[axis] += 100;
        other.max[axis] += 100;
    }
    return other;
}

static enum bvhd_status add_key(const struct world *w, struct ir *ir)
{
    if (!w->moves)
        return BVHD_OK;
    ir->boxes[1] = memory_array(ir->memory, ir->node_count, sizeof *ir->boxes[1]);
    if (!ir->boxes[1])
        return BVHD_NO_MEMORY;
    for (uint32_t i = 0; i < ir->node_count; i++)
        ir->boxes[1][i] = box_elsewhere(&ir->boxes[0][i]);
    ir->key_count = 2;
    return BVHD_OK;
}

/* Returns the size of a piece. Sizes differ: the first piece has one primitive, the second four. */
static uint32_t size_of(uint32_t piece)
{
    return piece < 2 ? 1 + 3 * piece : EACH - 7 * piece;
}

static void world_init(struct world *w)
{
    const struct test_shape shape = {
        .type = GEOMETRY_AABBS, .geometries = 1, .primitives = MOST, .size = 10, .detail = 0.02};
    memset(w, 0, sizeof *w);
    test_model_make(&shape, 7, &w->model);
    for (uint32_t i = 0; i < PIECES; i++) {
        w->firsts[i + 1] = w->firsts[i] + size_of(i);
        w->bounds[i] = box_empty();
        for (uint32_t k = w->firsts[i]; k < w->firsts[i + 1]; k++)
            box_grow(&w->bounds[i], &w->model.boxes[k]);
        w->list[i] = &w->pieces[i];
    }
}

static void world_finish(struct world *w)
{
    for (uint32_t i = 0; i < PIECES; i++) {
        ir_finish(&w->irs[i]);
        wide_piece_finish(&w->pieces[i]);
        wide_piece_finish(&w->pieces[i]);
    }
    ir_finish(&w->top);
}

static enum bvhd_status make(struct world *w, struct memory *memory, const struct parallel *parallel, struct ir *ret_ir,
                             struct wide *ret_wide, struct bvhd_error *error)
{
    const struct wide_join request = {&w->top, w->list, PIECES, &options, memory, parallel};
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; i < PIECES && status == BVHD_OK; i++) {
        status = test_ir_make(w->model.boxes + w->firsts[i], size_of(i), 3, memory, &w->irs[i]);
        if (status == BVHD_OK)
            status = add_key(w, &w->irs[i]);
        if (status == BVHD_OK)
            status = wide_piece_make(&w->irs[i], &options, memory, &w->pieces[i]);
    }
    if (status == BVHD_OK)
        status = test_ir_make(w->bounds, PIECES, 1, memory, &w->top);
    if (status == BVHD_OK)
        status = add_key(w, &w->top);
    return status == BVHD_OK ? wide_pieces_join(&request, ret_ir, ret_wide, error) : status;
}

/* The state of a walk through a joined tree. */
struct seen {
    const struct world *w;
    const struct ir *ir;
    const struct wide *wide;
    uint8_t refs[MOST];
    uint32_t next; /* node that starts the next block */
};

static void check_leaf(struct seen *seen, const struct wide_child *child)
{
    const struct box *box = &seen->ir->boxes[0][child->node];
    assert_in_range(child->ref_count, 1, 3);
    for (uint32_t k = 0; k < child->ref_count; k++) {
        uint32_t at = child->first_ref + k, piece = 0;
        assert_int_equal(seen->refs[at]++, 0);
        while (at >= seen->w->firsts[piece + 1])
            piece++;
        assert_true(box_contains(box, &seen->w->model.boxes[seen->w->firsts[piece] + seen->ir->refs[at]]));
    }
}

/* Checks a node and all below it, depth first; returns the number of levels. */
static uint32_t check_node(struct seen *seen, uint32_t at, const struct box *box)
{
    const struct wide_node *node = &seen->wide->nodes[at];
    uint32_t inner = 0, depth = 0, block = seen->next;
    for (int slot = 0; slot < WIDE_ARITY; slot++) {
        const struct wide_child *child = &node->slots[slot];
        if (wide_kind(child) == WIDE_EMPTY) {
            assert_int_equal(child->node | child->first_ref | child->ref_count, 0);
            continue;
        }
        assert_in_range(child->node, 1, seen->ir->node_count - 1);
        assert_true(box_contains(box, &seen->ir->boxes[0][child->node]));
        if (wide_kind(child) == WIDE_LEAF)
            check_leaf(seen, child);
        else
            inner++;
    }
    assert_int_equal(node->first_child, inner ? block : 0);
    seen->next += inner;
    for (int slot = 0; slot < WIDE_ARITY; slot++)
        if (wide_kind(&node->slots[slot]) == WIDE_INNER) {
            uint32_t levels = check_node(seen, block++, &seen->ir->boxes[0][node->slots[slot].node]);
            depth = levels > depth ? levels : depth;
        }
    return depth + 1;
}

static void check(const struct world *w, const struct ir *ir, const struct wide *wide)
{
    struct seen seen = {.w = w, .ir = ir, .wide = wide, .next = 1};
    uint32_t refs = 0;
    assert_int_equal(ir->ref_count, w->firsts[PIECES]);
    assert_int_equal(wide->leaf_refs, ir->ref_count);
    assert_int_equal(check_node(&seen, 0, &ir->boxes[0][0]), wide->depth);
    assert_int_equal(seen.next, wide->node_count);
    for (uint32_t i = 0; i < ir->ref_count; i++)
        assert_int_equal(seen.refs[i], 1);
    assert_int_equal(ir->key_count, w->moves ? 2 : 1);
    for (uint32_t i = 0; w->moves && i < WIDE_ARITY * wide->node_count; i++) {
        const struct wide_child *child = &wide->nodes[i / WIDE_ARITY].slots[i % WIDE_ARITY];
        const uint32_t node = wide_kind(child) == WIDE_EMPTY ? 0 : child->node; /* the root has a box, too */
        const struct box expected = box_elsewhere(&ir->boxes[0][node]);
        assert_memory_equal(&ir->boxes[1][node], &expected, sizeof expected);
    }
    for (uint32_t i = 0; i < wide->node_count; i++) {
        assert_int_equal(wide->nodes[i].first_leaf, refs);
        for (int slot = 0; slot < WIDE_ARITY; slot++)
            refs += wide->nodes[i].slots[slot].ref_count;
    }
}

static void pieces_become_one_tree(void **state)
{
    (void)state;
    struct memory memory;
    struct world w;
    struct ir ir;
    struct wide wide;
    memory_init(&memory, UINT64_MAX);
    for (int moves = 0; moves < 2; moves++) {
        world_init(&w);
        w.moves = moves;
        assert_int_equal(make(&w, &memory, &parallel_serial, &ir, &wide, NULL), BVHD_OK);
        check(&w, &ir, &wide);
        ir_finish(&ir);
        wide_finish(&wide);
        world_finish(&w);
        test_model_finish(&w.model);
    }
    assert_int_equal(memory.live, 0);
}

static void threads_do_not_matter(void **state)
{
    (void)state;
    static const unsigned threads[] = {1, 2, 8};
    struct memory memory;
    struct ir irs[3];
    struct wide wides[3];
    memory_init(&memory, UINT64_MAX);
    for (int i = 0; i < 3; i++) {
        struct workers *workers;
        struct world w;
        world_init(&w);
        assert_int_equal(workers_create(threads[i], &workers, NULL), BVHD_OK);
        assert_int_equal(make(&w, &memory, workers_parallel(workers), &irs[i], &wides[i], NULL), BVHD_OK);
        workers_destroy(workers);
        world_finish(&w);
        test_model_finish(&w.model);
    }
    for (int i = 1; i < 3; i++) {
        assert_int_equal(wides[i].node_count, wides[0].node_count);
        assert_memory_equal(wides[i].nodes, wides[0].nodes, wides[0].node_count * sizeof *wides[0].nodes);
        assert_int_equal(irs[i].node_count, irs[0].node_count);
        assert_memory_equal(irs[i].boxes[0], irs[0].boxes[0], irs[0].node_count * sizeof *irs[0].boxes[0]);
        assert_memory_equal(irs[i].refs, irs[0].refs, irs[0].ref_count * sizeof *irs[0].refs);
    }
    for (int i = 0; i < 3; i++) {
        ir_finish(&irs[i]);
        wide_finish(&wides[i]);
    }
    assert_int_equal(memory.live, 0);
}

static void every_allocation_may_fail(void **state)
{
    (void)state;
    enum bvhd_status status = BVHD_NO_MEMORY;
    struct world *w = malloc(sizeof *w);
    assert_non_null(w);
    world_init(w);
    w->moves = true;
    int64_t n = 0;
    for (; status == BVHD_NO_MEMORY; n++) {
        struct memory memory;
        struct bvhd_error error;
        struct ir ir;
        struct wide wide;
        memory_init(&memory, UINT64_MAX);
        memory.fail_after = n;
        status = make(w, &memory, &parallel_serial, &ir, &wide, &error);
        if (status == BVHD_OK) {
            ir_finish(&ir);
            wide_finish(&wide);
        }
        world_finish(w);
        assert_int_equal(memory.live, 0);
    }
    assert_int_equal(status, BVHD_OK);
    assert_true(n > 6 * PIECES);
    test_model_finish(&w->model);
    free(w);
}

static void cancel_is_heard(void **state)
{
    (void)state;
    atomic_bool cancel = true;
    struct collapse_options cancelled = options;
    struct memory memory;
    struct world w;
    struct ir ir;
    struct wide wide;
    struct bvhd_error error = {.status = BVHD_OK};
    memory_init(&memory, UINT64_MAX);
    world_init(&w);
    assert_int_equal(make(&w, &memory, &parallel_serial, &ir, &wide, NULL), BVHD_OK);
    ir_finish(&ir);
    wide_finish(&wide);
    cancelled.cancel = &cancel;
    const struct wide_join request = {&w.top, w.list, PIECES, &cancelled, &memory, &parallel_serial};
    assert_int_equal(wide_pieces_join(&request, &ir, &wide, &error), BVHD_CANCELLED);
    assert_int_equal(error.status, BVHD_CANCELLED);
    struct wide_piece piece = {0};
    assert_int_equal(test_ir_make(w.model.boxes, EACH, 3, &memory, &w.irs[0]), BVHD_OK);
    assert_int_equal(wide_piece_make(&w.irs[0], &cancelled, &memory, &piece), BVHD_CANCELLED);
    assert_null(piece.memory);
    world_finish(&w);
    test_model_finish(&w.model);
    assert_int_equal(memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pieces_become_one_tree),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(every_allocation_may_fail),
        cmocka_unit_test(cancel_is_heard),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
