/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_moving_split.c - tests that what crosses is divided into pieces that stay together, and that every ref is in one
 * of them.
 */
#include "tests/support/unit.h"

#include "builder/top/moving_split.h"
#include "builder/workers.h"
#include "tests/support/builder/test_flocks.h"

enum { COUNT = FLOCKS_COUNT, PIECE = 64, DEPTH_LIMIT = 128 };

struct bed {
    struct flocks flocks;
    struct primitive_ref refs[COUNT], scratch[COUNT];
    struct memory memory;
    struct split_request request;
};

static struct bed bed;

static void make(enum flocks_shape shape)
{
    flocks_make(&bed.flocks, shape, COUNT, 1);
    if (bed.memory.live == 0)
        memory_init(&bed.memory, UINT64_MAX);
    for (uint32_t i = 0; i < COUNT; i++)
        bed.refs[i] = (struct primitive_ref){.id = i};
    bed.request = (struct split_request){.refs = bed.refs, .scratch = bed.scratch, .count = COUNT, .piece_size = PIECE};
}

static enum bvhd_status split(const struct parallel *parallel, struct split_tree *ret_tree)
{
    struct bvhd_error error;
    return moving_split(&bed.request, &bed.flocks.canonical, &bed.memory, parallel, ret_tree, &error);
}

/* Checks the part of a node, and counts its pieces. Returns how many levels it has. */
static uint32_t check_node(const struct split_tree *tree, uint32_t index, uint32_t *pieces)
{
    const struct split_node *node = &tree->nodes[index];
    assert_true(node->count >= 1);
    if (node->child == 0) {
        assert_true(node->count <= PIECE);
        ++*pieces;
        return 1;
    }
    const struct split_node *children = &tree->nodes[node->child];
    assert_true(node->child > index && node->child + 1 < tree->node_count && node->count > PIECE);
    assert_int_equal(children[0].first, node->first);
    assert_int_equal(children[1].first, node->first + children[0].count);
    assert_int_equal(children[0].count + children[1].count, node->count);
    const uint32_t left = check_node(tree, node->child, pieces), right = check_node(tree, node->child + 1, pieces);
    return 1 + (left > right ? left : right);
}

static void every_ref_is_in_one_piece(void **state)
{
    (void)state;
    for (enum flocks_shape shape = FLOCKS_SMOOTH; shape < FLOCKS_SHAPES; shape++) {
        struct split_tree tree;
        uint32_t pieces = 0;
        make(shape);
        assert_int_equal(split(&parallel_serial, &tree), BVHD_OK);
        assert_true(tree.nodes[0].first == 0 && tree.nodes[0].count == COUNT);
        assert_true(check_node(&tree, 0, &pieces) <= DEPTH_LIMIT);
        assert_int_equal(pieces, tree.piece_count);
        assert_int_equal(tree.node_count, 2 * pieces - 1);
        static uint8_t seen[COUNT];
        memset(seen, 0, sizeof seen);
        for (uint32_t i = 0; i < COUNT; i++)
            assert_int_equal(seen[bed.scratch[i].id]++, 0);
        memory_free(&bed.memory, tree.nodes);
        assert_int_equal(bed.memory.live, 0);
    }
}

/* Returns in how many pieces there are triangles of both flocks. */
static uint32_t mixed_pieces(const struct split_tree *tree)
{
    uint32_t mixed = 0;
    for (uint32_t i = 0; i < tree->node_count; i++) {
        const struct split_node *node = &tree->nodes[i];
        uint32_t odd = 0;
        for (uint32_t k = 0; k < node->count; k++)
            odd += bed.scratch[node->first + k].id % 2;
        mixed += node->child == 0 && odd != 0 && odd != node->count;
    }
    return mixed;
}

static void what_crosses_is_parted(void **state)
{
    (void)state;
    static const enum flocks_shape shapes[] = {FLOCKS_CROSS, FLOCKS_LANES};
    for (int i = 0; i < 2; i++) {
        struct split_tree tree;
        make(shapes[i]);
        assert_int_equal(split(&parallel_serial, &tree), BVHD_OK);
        assert_int_equal(mixed_pieces(&tree), 0);
        memory_free(&bed.memory, tree.nodes);
    }
}

static void threads_do_not_matter(void **state)
{
    (void)state;
    static const unsigned threads[] = {1, 2, 8};
    static struct primitive_ref expected[COUNT];
    struct split_tree trees[3];
    for (int i = 0; i < 3; i++) {
        struct workers *workers;
        make(FLOCKS_RANDOM);
        assert_int_equal(workers_create(threads[i], &workers, NULL), BVHD_OK);
        assert_int_equal(split(workers_parallel(workers), &trees[i]), BVHD_OK);
        workers_destroy(workers);
        if (i == 0)
            memcpy(expected, bed.scratch, sizeof expected);
        assert_memory_equal(bed.scratch, expected, sizeof expected);
        assert_int_equal(trees[i].node_count, trees[0].node_count);
        assert_memory_equal(trees[i].nodes, trees[0].nodes, trees[0].node_count * sizeof *trees[0].nodes);
    }
    for (int i = 0; i < 3; i++)
        memory_free(&bed.memory, trees[i].nodes);
}

static void failures_leave_nothing(void **state)
{
    (void)state;
    enum bvhd_status status = BVHD_NO_MEMORY;
    struct split_tree tree;
    atomic_bool cancel = true;
    int64_t n = 0;
    make(FLOCKS_LANES);
    for (; status == BVHD_NO_MEMORY; n++) {
        bed.memory.fail_after = n;
        status = split(&parallel_serial, &tree);
        if (status == BVHD_OK)
            memory_free(&bed.memory, tree.nodes);
        assert_int_equal(bed.memory.live, 0);
    }
    assert_int_equal(status, BVHD_OK);
    assert_true(n > 6);
    bed.memory.fail_after = -1;
    bed.request.cancel = &cancel;
    assert_int_equal(split(&parallel_serial, &tree), BVHD_CANCELLED);
    assert_int_equal(bed.memory.live, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_ref_is_in_one_piece),
        cmocka_unit_test(what_crosses_is_parted),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(failures_leave_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
