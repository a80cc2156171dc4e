/* SPDX-License-Identifier: Apache-2.0 */
/* test_pieces.c - tests that trees of pieces are built and joined, on any threads, with cancellation and failures. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/top/pieces.h"
#include "tests/support/builder/test_refs.h"
#include "builder/workers.h"

enum { COUNT = 6000, PIECE_SIZE = 700 };

/* Refs that have been split, in blocks of `memory`. */
struct fixture {
    struct memory memory;
    struct primitive_ref *refs, *scratch;
    struct box *boxes;
    struct split_tree tree;
    struct pieces_request request;
};

/* A joined tree. */
struct joined {
    struct ir ir;
    uint32_t depth;
    double cost;
};

static void start(struct fixture *f, enum test_refs_kind kind, uint32_t count, uint32_t piece_size)
{
    memory_init(&f->memory, UINT64_MAX);
    struct primitive_ref *made = test_refs_make(kind, count, 3);
    f->boxes = test_refs_boxes(made, count);
    f->refs = memory_array(&f->memory, count, sizeof *f->refs);
    f->scratch = memory_array(&f->memory, count, sizeof *f->scratch);
    assert_true(f->refs && f->scratch);
    memcpy(f->refs, made, count * sizeof *made);
    memset(f->scratch, 0, count * sizeof *made);
    free(made);
    struct split_request split = {.refs = f->refs, .scratch = f->scratch, .count = count, .piece_size = piece_size};
    primitive_ref_bounds(f->refs, count, &split.bounds, &split.centroids);
    assert_int_equal(split_refs(&split, &f->memory, &parallel_serial, &f->tree, NULL), BVHD_OK);
    f->request = (struct pieces_request){
        .tree = &f->tree,
        .refs = f->refs,
        .scratch = f->scratch,
        .capacity = count,
        .method = PIECES_PLOC,
        .leaf_max = 8,
        .cut_cost = 2.9f,
    };
}

/* Frees everything, and checks that nothing else is live. */
static void finish(struct fixture *f)
{
    memory_free(&f->memory, f->refs);
    memory_free(&f->memory, f->scratch);
    memory_free(&f->memory, f->tree.nodes);
    free(f->boxes);
    assert_int_equal(f->memory.live, 0);
}

/* Joins the pieces; the spare blocks have room for `spare_count` refs, and the fixture keeps those that are left. */
static enum bvhd_status join(struct fixture *f, const struct pieces *pieces, uint32_t spare_count,
                             const struct parallel *parallel, struct joined *ret_joined)
{
    struct pieces_spare spare = {f->refs, f->scratch, spare_count};
    enum bvhd_status status =
        pieces_join(pieces, &spare, parallel, &ret_joined->ir, &ret_joined->depth, &ret_joined->cost, NULL);
    f->refs = spare.refs;
    f->scratch = spare.scratch;
    return status;
}

static enum bvhd_status build(struct fixture *f, uint32_t spare_count, const struct parallel *parallel,
                              struct joined *ret_joined)
{
    struct pieces pieces;
    enum bvhd_status status = pieces_build(&f->request, &f->memory, parallel, &pieces, NULL);
    if (status != BVHD_OK)
        return status;
    status = join(f, &pieces, spare_count, parallel, ret_joined);
    pieces_finish(&pieces);
    pieces_finish(&pieces);
    return status;
}

static void expect_same(const struct joined *a, const struct joined *b)
{
    assert_int_equal(a->ir.node_count, b->ir.node_count);
    assert_int_equal(a->ir.ref_count, b->ir.ref_count);
    assert_memory_equal(a->ir.nodes, b->ir.nodes, a->ir.node_count * sizeof *a->ir.nodes);
    assert_memory_equal(a->ir.boxes[0], b->ir.boxes[0], a->ir.node_count * sizeof *a->ir.boxes[0]);
    assert_memory_equal(a->ir.refs, b->ir.refs, a->ir.ref_count * sizeof *a->ir.refs);
    assert_int_equal(a->depth, b->depth);
    assert_true(a->cost == b->cost);
}

static void joined_trees_are_whole(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 2, 50, COUNT}, sizes[] = {1, 7, PIECE_SIZE, COUNT};
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++)
            for (size_t s = counts[c] == COUNT ? 1 : 0; s < sizeof sizes / sizeof *sizes; s++) {
                struct fixture f;
                struct joined joined;
                start(&f, (enum test_refs_kind)kind, counts[c], sizes[s]);
                uint32_t above = f.tree.node_count;
                f.request.cut_cost = s % 2 ? f.request.cut_cost : 0;
                assert_int_equal(build(&f, counts[c], &parallel_serial, &joined), BVHD_OK);
                assert_int_equal(ir_check(&joined.ir, counts[c], f.boxes, false, &f.memory, NULL), BVHD_OK);
                assert_int_equal(joined.ir.ref_count, counts[c]);
                assert_true(joined.ir.node_count >= above);
                assert_int_equal(joined.depth, ir_depth(&joined.ir, &f.memory));
                double cost = ir_cost(&joined.ir, 0, joined.ir.node_count);
                assert_true(fabs(joined.cost - cost) <= 1e-9 * cost);
                ir_finish(&joined.ir);
                finish(&f);
            }
}

/*
 * Blocks that are too small stay with the caller, those that are large enough become the tree's. The tree is the same.
 */
static void spare_blocks_are_used_where_they_are_large_enough(void **state)
{
    (void)state;
    struct fixture with, without;
    struct joined used, unused;
    start(&with, REFS_CLOUD, COUNT, PIECE_SIZE);
    start(&without, REFS_CLOUD, COUNT, PIECE_SIZE);
    struct primitive_ref *refs = with.refs, *scratch = with.scratch, *kept = without.refs;
    assert_int_equal(build(&with, COUNT, &parallel_serial, &used), BVHD_OK);
    uint32_t enough = (uint32_t)((used.ir.node_count * sizeof *used.ir.boxes[0] + sizeof *refs - 1) / sizeof *refs);
    assert_true(enough <= COUNT);
    assert_int_equal(build(&without, enough - 1, &parallel_serial, &unused), BVHD_OK);
    assert_true(!with.refs && !with.scratch && without.refs == kept && without.scratch);
    assert_ptr_equal(used.ir.nodes, refs);
    assert_ptr_equal(used.ir.boxes[0], scratch);
    expect_same(&used, &unused);
    ir_finish(&used.ir);
    ir_finish(&unused.ir);
    finish(&with);
    finish(&without);
    start(&with, REFS_CLOUD, COUNT, PIECE_SIZE);
    assert_int_equal(build(&with, enough, &parallel_serial, &used), BVHD_OK);
    assert_null(with.refs);
    ir_finish(&used.ir);
    finish(&with);
}

static void threads_do_not_matter(void **state)
{
    (void)state;
    static const float cuts[] = {0, 2.9f};
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (int cut = 0; cut < 2; cut++) {
            struct fixture first, other;
            struct joined one, many;
            struct workers *workers;
            assert_int_equal(workers_create(4, &workers, NULL), BVHD_OK);
            start(&first, (enum test_refs_kind)kind, COUNT, PIECE_SIZE);
            start(&other, (enum test_refs_kind)kind, COUNT, PIECE_SIZE);
            first.request.cut_cost = other.request.cut_cost = cuts[cut];
            assert_int_equal(build(&first, COUNT, &parallel_serial, &one), BVHD_OK);
            assert_int_equal(build(&other, COUNT, workers_parallel(workers), &many), BVHD_OK);
            expect_same(&one, &many);
            ir_finish(&one.ir);
            ir_finish(&many.ir);
            finish(&first);
            finish(&other);
            workers_destroy(workers);
        }
}

/* Counts progress reports; sets `stop`, which may be NULL, after `stop_after` of them. */
struct reports {
    _Atomic uint32_t count;
    uint64_t last;
    uint32_t stop_after;
    atomic_bool *stop;
};

static void report(void *context, uint64_t done, uint64_t total)
{
    struct reports *reports = context;
    assert_true(done > reports->last && done <= total);
    reports->last = done;
    if (++reports->count == reports->stop_after && reports->stop)
        atomic_store(reports->stop, true);
}

static void each_piece_is_progress(void **state)
{
    (void)state;
    struct fixture f;
    struct joined joined;
    struct reports reports = {0};
    start(&f, REFS_CLOUD, COUNT, PIECE_SIZE);
    f.request.progress = report;
    f.request.progress_context = &reports;
    f.request.progress_total = 3 * COUNT;
    assert_int_equal(build(&f, COUNT, &parallel_serial, &joined), BVHD_OK);
    assert_int_equal(reports.count, f.tree.piece_count);
    assert_int_equal(reports.last, 3 * COUNT);
    ir_finish(&joined.ir);
    finish(&f);
}

static void a_build_is_cancelled_between_pieces(void **state)
{
    (void)state;
    for (uint32_t after = 0; after < 4; after++) {
        struct fixture f;
        struct joined joined;
        struct bvhd_error error;
        struct pieces pieces = {0};
        atomic_bool cancel = after == 0;
        struct reports reports = {.stop_after = after, .stop = &cancel};
        start(&f, REFS_CLOUD, COUNT, PIECE_SIZE);
        assert_true(f.tree.piece_count > 4);
        f.request.cancel = &cancel;
        f.request.progress = report;
        f.request.progress_context = &reports;
        f.request.progress_total = COUNT;
        assert_int_equal(pieces_build(&f.request, &f.memory, &parallel_serial, &pieces, &error), BVHD_CANCELLED);
        assert_int_equal(error.status, BVHD_CANCELLED);
        assert_null(pieces.pieces);
        assert_int_equal(reports.count, after);
        assert_int_equal(build(&f, COUNT, &parallel_serial, &joined), BVHD_CANCELLED);
        finish(&f);
    }
}

/* Cancels with the spare blocks taken over, and with blocks of its own. */
static void a_join_is_cancelled(void **state)
{
    (void)state;
    for (uint32_t spare = 0; spare <= COUNT; spare += COUNT) {
        struct fixture f;
        struct joined joined;
        struct pieces pieces;
        atomic_bool cancel = false;
        start(&f, REFS_CLOUD, COUNT, PIECE_SIZE);
        f.request.cancel = &cancel;
        assert_int_equal(pieces_build(&f.request, &f.memory, &parallel_serial, &pieces, NULL), BVHD_OK);
        atomic_store(&cancel, true);
        assert_int_equal(join(&f, &pieces, spare, &parallel_serial, &joined), BVHD_CANCELLED);
        assert_int_equal(f.refs == NULL, spare == COUNT);
        pieces_finish(&pieces);
        finish(&f);
    }
}

/* After each failed allocation only the caller's blocks are live. */
static void allocations_fail(void **state)
{
    (void)state;
    for (uint32_t spare = 0; spare <= COUNT; spare += COUNT) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        int64_t fail_after = 0;
        for (; status != BVHD_OK; fail_after++) {
            struct fixture f;
            struct joined joined;
            start(&f, REFS_CLUSTERS, COUNT, 4 * PIECE_SIZE);
            f.memory.fail_after = fail_after;
            status = build(&f, spare, &parallel_serial, &joined);
            f.memory.fail_after = -1;
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
            if (status == BVHD_OK)
                ir_finish(&joined.ir);
            finish(&f);
        }
        assert_true(fail_after > 4);
    }
}

/* Builds pieces and joins them into a wide tree; the pieces are finished. */
static enum bvhd_status build_wide(struct fixture *f, const struct parallel *parallel, struct joined *ret_joined,
                                   struct wide *ret_wide)
{
    struct pieces pieces;
    enum bvhd_status status = pieces_build(&f->request, &f->memory, parallel, &pieces, NULL);
    if (status != BVHD_OK)
        return status;
    status =
        pieces_join_wide(&pieces, parallel, &ret_joined->ir, ret_wide, &ret_joined->depth, &ret_joined->cost, NULL);
    pieces_finish(&pieces);
    return status;
}

static const struct collapse_options wide_options = {.leaf_max = 8, .leaf_cost = 0.3f, .quick_order = true};

/* Depth and cost are those of the binary tree, and all refs are there. */
static void wide_trees_are_of_the_same_pieces(void **state)
{
    (void)state;
    static const uint32_t sizes[] = {7, PIECE_SIZE, COUNT / 2};
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
            struct fixture binary, collapsed;
            struct joined one, other;
            struct wide wide;
            uint8_t seen[COUNT] = {0};
            start(&binary, (enum test_refs_kind)kind, COUNT, sizes[s]);
            start(&collapsed, (enum test_refs_kind)kind, COUNT, sizes[s]);
            collapsed.request.collapse_at_once = &wide_options;
            assert_true(binary.tree.piece_count > 1);
            assert_int_equal(build(&binary, COUNT, &parallel_serial, &one), BVHD_OK);
            assert_int_equal(build_wide(&collapsed, &parallel_serial, &other, &wide), BVHD_OK);
            assert_int_equal(other.depth, one.depth);
            assert_true(other.cost == one.cost);
            assert_memory_equal(&other.ir.boxes[0][0], &one.ir.boxes[0][0], sizeof *one.ir.boxes[0]);
            assert_int_equal(wide.leaf_refs, COUNT);
            assert_int_equal(other.ir.ref_count, COUNT);
            for (uint32_t i = 0; i < COUNT; i++)
                assert_int_equal(seen[other.ir.refs[i]]++, 0);
            ir_finish(&one.ir);
            ir_finish(&other.ir);
            wide_finish(&wide);
            finish(&binary);
            finish(&collapsed);
        }
}

static void a_wide_join_is_cancelled(void **state)
{
    (void)state;
    struct fixture f;
    struct joined joined;
    struct wide wide;
    struct pieces pieces;
    struct bvhd_error error;
    atomic_bool cancel = false;
    struct collapse_options options = wide_options;
    options.cancel = &cancel;
    start(&f, REFS_CLOUD, COUNT, PIECE_SIZE);
    f.request.cancel = &cancel;
    f.request.collapse_at_once = &options;
    assert_int_equal(pieces_build(&f.request, &f.memory, &parallel_serial, &pieces, NULL), BVHD_OK);
    atomic_store(&cancel, true);
    assert_int_equal(
        pieces_join_wide(&pieces, &parallel_serial, &joined.ir, &wide, &joined.depth, &joined.cost, &error),
        BVHD_CANCELLED);
    assert_int_equal(error.status, BVHD_CANCELLED);
    pieces_finish(&pieces);
    finish(&f);
}

static void allocations_of_wide_trees_fail(void **state)
{
    (void)state;
    enum bvhd_status status = BVHD_NO_MEMORY;
    int64_t fail_after = 0;
    for (; status != BVHD_OK; fail_after++) {
        struct fixture f;
        struct joined joined;
        struct wide wide;
        start(&f, REFS_CLUSTERS, COUNT, 4 * PIECE_SIZE);
        f.request.collapse_at_once = &wide_options;
        f.memory.fail_after = fail_after;
        status = build_wide(&f, &parallel_serial, &joined, &wide);
        f.memory.fail_after = -1;
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        if (status == BVHD_OK) {
            ir_finish(&joined.ir);
            wide_finish(&wide);
        }
        finish(&f);
    }
    assert_true(fail_after > 10);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(joined_trees_are_whole),
        cmocka_unit_test(spare_blocks_are_used_where_they_are_large_enough),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(each_piece_is_progress),
        cmocka_unit_test(a_build_is_cancelled_between_pieces),
        cmocka_unit_test(a_join_is_cancelled),
        cmocka_unit_test(allocations_fail),
        cmocka_unit_test(wide_trees_are_of_the_same_pieces),
        cmocka_unit_test(a_wide_join_is_cancelled),
        cmocka_unit_test(allocations_of_wide_trees_fail),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
