/* SPDX-License-Identifier: Apache-2.0 */
/* test_scatter.c - tests that refs are sent to the right pieces, in bounded sizes, for any threads, gaps and orders. */
#include "tests/support/unit.h"

#include <string.h>

#include "builder/top/scatter.h"
#include "tests/support/builder/test_refs.h"
#include "builder/workers.h"

struct fixture {
    struct memory memory;
    struct primitive_ref *given, *refs, *scratch;
    struct split_request request;
};

static void start(struct fixture *f, enum test_refs_kind kind, uint32_t count, uint32_t piece_size)
{
    memory_init(&f->memory, UINT64_MAX);
    f->given = test_refs_make(kind, count, 1 + count);
    f->refs = test_refs_make(kind, count, 1 + count);
    f->scratch = test_refs_make(REFS_SAME, count, 0);
    f->request =
        (struct split_request){.refs = f->refs, .scratch = f->scratch, .count = count, .piece_size = piece_size};
    primitive_ref_bounds(f->refs, count, &f->request.bounds, &f->request.centroids);
}

static void finish(struct fixture *f)
{
    free(f->given);
    free(f->refs);
    free(f->scratch);
    assert_int_equal(f->memory.live, 0);
}

/* Checks every promise of scatter.h. */
static void check_tree(const struct fixture *f, const struct split_tree *tree)
{
    uint32_t count = f->request.count, pieces = 0;
    unsigned char *seen = calloc(count, 1);
    assert_non_null(seen);
    for (uint32_t i = 0; i < count; i++) {
        const struct primitive_ref *ref = &f->scratch[i];
        assert_true(ref->id < count && !seen[ref->id]);
        seen[ref->id] = 1;
        assert_memory_equal(ref, &f->given[ref->id], sizeof *ref);
    }
    assert_memory_equal(&tree->nodes[0].bounds, &f->request.bounds, sizeof f->request.bounds);
    uint64_t in_pieces = 0;
    for (uint32_t i = 0; i < tree->node_count; i++) {
        const struct split_node *node = &tree->nodes[i];
        if (node->child) {
            assert_true(node->child > i && node->child % 2 == 1 && node->child + 1 < tree->node_count);
            continue;
        }
        assert_true(node->count > 0 && node->count / 2 <= f->request.piece_size);
        assert_true(node->first <= count && node->count <= count - node->first);
        in_pieces += node->count;
        pieces++;
        for (uint32_t k = node->first; k < node->first + node->count; k++) {
            assert_int_equal(seen[f->scratch[k].id], 1);
            seen[f->scratch[k].id] = 2;
        }
    }
    assert_int_equal(in_pieces, count);
    assert_int_equal(pieces, tree->piece_count);
    assert_int_equal(tree->node_count, 2 * pieces - 1);
    free(seen);
}

/*
 * Checks that the refs below a node are contiguous, the left child's before the right one's, and start at `first`.
 * Returns how many there are.
 */
static uint32_t check_order(const struct split_tree *tree, uint32_t node, uint32_t first)
{
    const struct split_node *n = &tree->nodes[node];
    if (n->child == 0) {
        assert_int_equal(n->first, first);
        return n->count;
    }
    uint32_t left = check_order(tree, n->child, first);
    return left + check_order(tree, n->child + 1, first + left);
}

static void every_kind_is_cut_into_pieces(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 2, 7, 8, 100, 5000, 40000}, sizes[] = {1, 100, 4096};
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++)
            for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
                struct fixture f;
                struct split_tree tree;
                if (counts[c] > 1000 && sizes[s] == 1)
                    continue;
                start(&f, (enum test_refs_kind)kind, counts[c], sizes[s]);
                assert_int_equal(scatter_refs(&f.request, &f.memory, &parallel_serial, &tree, NULL), BVHD_OK);
                check_tree(&f, &tree);
                assert_int_equal(check_order(&tree, 0, 0), counts[c]);
                memory_free(&f.memory, tree.nodes);
                finish(&f);
            }
}

static void outsize_refs_are_set_apart(void **state)
{
    (void)state;
    struct fixture f;
    struct split_tree tree;
    start(&f, REFS_CLOUD, 20000, 4096);
    static const uint32_t large[] = {5, 777, 19999};
    for (int i = 0; i < 3; i++)
        for (int axis = 0; axis < 3; axis++) {
            f.refs[large[i]].min[axis] = f.given[large[i]].min[axis] = -100;
            f.refs[large[i]].max[axis] = f.given[large[i]].max[axis] = 100;
        }
    primitive_ref_bounds(f.refs, 20000, &f.request.bounds, &f.request.centroids);
    assert_int_equal(scatter_refs(&f.request, &f.memory, &parallel_serial, &tree, NULL), BVHD_OK);
    check_tree(&f, &tree);
    assert_int_equal(tree.nodes[0].child, 1);
    assert_int_equal(tree.nodes[2].child, 0);
    assert_int_equal(tree.nodes[2].count, 3);
    for (uint32_t i = 0; i < 3; i++)
        assert_int_equal(f.scratch[tree.nodes[2].first + i].id, large[i]);
    memory_free(&f.memory, tree.nodes);
    finish(&f);
}

/* Blocks may be empty, short or full; gaps hold arbitrary bytes. */
static void gaps_do_not_matter(void **state)
{
    (void)state;
    enum { BLOCK = 8192 };
    static const uint32_t blocks[] = {0, 1, BLOCK, 5000, 0, 0, 4095, BLOCK - 1, 7, 0};
    enum { BLOCKS = sizeof blocks / sizeof *blocks };
    uint32_t count = 0;
    for (int i = 0; i < BLOCKS; i++)
        count += blocks[i];
    for (int kind = 0; kind < REFS_KINDS; kind++) {
        struct fixture whole, gaps;
        struct split_tree tree, other;
        start(&whole, (enum test_refs_kind)kind, count, 1000);
        start(&gaps, (enum test_refs_kind)kind, count, 1000);
        struct primitive_ref *places = malloc(BLOCKS * BLOCK * sizeof *places);
        assert_non_null(places);
        memset(places, 0xff, BLOCKS * BLOCK * sizeof *places);
        for (uint32_t i = 0, at = 0; i < BLOCKS; at += blocks[i++])
            memcpy(places + (size_t)i * BLOCK, gaps.given + at, blocks[i] * sizeof *places);
        gaps.request.refs = places;
        gaps.request.blocks = blocks;
        gaps.request.block_count = BLOCKS;
        gaps.request.block_size = BLOCK;
        assert_int_equal(scatter_refs(&whole.request, &whole.memory, &parallel_serial, &tree, NULL), BVHD_OK);
        assert_int_equal(scatter_refs(&gaps.request, &gaps.memory, &parallel_serial, &other, NULL), BVHD_OK);
        check_tree(&gaps, &other);
        assert_int_equal(other.node_count, tree.node_count);
        assert_int_equal(other.piece_count, tree.piece_count);
        assert_memory_equal(other.nodes, tree.nodes, tree.node_count * sizeof *tree.nodes);
        assert_memory_equal(gaps.scratch, whole.scratch, count * sizeof *whole.scratch);
        memory_free(&whole.memory, tree.nodes);
        memory_free(&gaps.memory, other.nodes);
        free(places);
        finish(&whole);
        finish(&gaps);
    }
}

static int by_x(const void *a, const void *b)
{
    const struct primitive_ref *p = a, *q = b;
    float x = p->min[0] + p->max[0], y = q->min[0] + q->max[0];
    return (x > y) - (x < y);
}

/* Computes the centroids' bounds of all refs below a node, which are contiguous (check_order). */
static void bound_below(const struct fixture *f, const struct split_tree *tree, uint32_t node,
                        struct box *ret_centroids)
{
    const struct split_node *n = &tree->nodes[node];
    struct box bounds, other;
    if (n->child == 0) {
        primitive_ref_bounds(f->scratch + n->first, n->count, &bounds, ret_centroids);
        return;
    }
    bound_below(f, tree, n->child, ret_centroids);
    bound_below(f, tree, n->child + 1, &other);
    box_grow(ret_centroids, &other);
}

/* For any order of the refs, a plane separates the two sides of each node. */
static void planes_separate_refs(void **state)
{
    (void)state;
    for (int sorted = 0; sorted < 2; sorted++) {
        struct fixture f;
        struct split_tree tree;
        start(&f, REFS_CLOUD, 40000, 1000);
        if (sorted)
            qsort(f.refs, f.request.count, sizeof *f.refs, by_x);
        assert_int_equal(scatter_refs(&f.request, &f.memory, &parallel_serial, &tree, NULL), BVHD_OK);
        check_tree(&f, &tree);
        assert_true(tree.piece_count > 20);
        for (uint32_t i = 0; i < tree.node_count; i++) {
            struct box left, right;
            if (tree.nodes[i].child == 0)
                continue;
            bound_below(&f, &tree, tree.nodes[i].child, &left);
            bound_below(&f, &tree, tree.nodes[i].child + 1, &right);
            assert_true(left.max[0] < right.min[0] || left.max[1] < right.min[1] || left.max[2] < right.min[2]);
        }
        memory_free(&f.memory, tree.nodes);
        finish(&f);
    }
}

/* With small pieces there are more planes than there is room for. */
static void threads_do_not_matter(void **state)
{
    (void)state;
    static const uint32_t sizes[] = {1000, 100};
    for (int i = 0; i < 2 * REFS_KINDS; i++) {
        const int kind = i / 2;
        const uint32_t size = sizes[i % 2];
        struct fixture first, other;
        struct split_tree tree, other_tree;
        start(&first, (enum test_refs_kind)kind, 50000, size);
        assert_int_equal(scatter_refs(&first.request, &first.memory, &parallel_serial, &tree, NULL), BVHD_OK);
        for (unsigned threads = 2; threads <= 8; threads *= 4) {
            struct workers *workers;
            assert_int_equal(workers_create(threads, &workers, NULL), BVHD_OK);
            start(&other, (enum test_refs_kind)kind, 50000, size);
            assert_int_equal(scatter_refs(&other.request, &other.memory, workers_parallel(workers), &other_tree, NULL),
                             BVHD_OK);
            assert_int_equal(other_tree.node_count, tree.node_count);
            assert_memory_equal(other_tree.nodes, tree.nodes, tree.node_count * sizeof *tree.nodes);
            assert_memory_equal(other.scratch, first.scratch, 50000 * sizeof *first.scratch);
            memory_free(&other.memory, other_tree.nodes);
            finish(&other);
            workers_destroy(workers);
        }
        memory_free(&first.memory, tree.nodes);
        finish(&first);
    }
}

/* For a cloud the planes of the sample are enough; when all refs are equal, everything goes through split_refs. */
static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    static const enum test_refs_kind kinds[] = {REFS_CLOUD, REFS_SAME};
    for (int kind = 0; kind < 2; kind++) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        for (int64_t n = 0; status == BVHD_NO_MEMORY; n++) {
            struct fixture f;
            struct split_tree tree;
            struct bvhd_error error;
            start(&f, kinds[kind], 20000, 4096);
            f.memory.fail_after = n;
            status = scatter_refs(&f.request, &f.memory, &parallel_serial, &tree, &error);
            if (status == BVHD_OK)
                memory_free(&f.memory, tree.nodes);
            else
                assert_int_equal(error.status, BVHD_NO_MEMORY);
            assert_true(n < 100);
            finish(&f);
        }
        assert_int_equal(status, BVHD_OK);
    }
}

static void cancelling_ends_it(void **state)
{
    (void)state;
    static const enum test_refs_kind kinds[] = {REFS_CLOUD, REFS_SAME};
    for (int kind = 0; kind < 2; kind++) {
        struct fixture f;
        struct split_tree tree;
        struct bvhd_error error;
        atomic_bool cancel = true;
        start(&f, kinds[kind], 20000, 100);
        f.request.cancel = &cancel;
        assert_int_equal(scatter_refs(&f.request, &f.memory, &parallel_serial, &tree, &error), BVHD_CANCELLED);
        assert_int_equal(error.status, BVHD_CANCELLED);
        finish(&f);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_is_cut_into_pieces),
        cmocka_unit_test(outsize_refs_are_set_apart),
        cmocka_unit_test(gaps_do_not_matter),
        cmocka_unit_test(planes_separate_refs),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(failing_allocations_leave_nothing),
        cmocka_unit_test(cancelling_ends_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
