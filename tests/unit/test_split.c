/* SPDX-License-Identifier: Apache-2.0 */
#include "unit.h"

#include <math.h>

#include "bins.h"
#include "split.h"
#include "test_ir.h"
#include "test_refs.h"
#include "workers.h"

struct fixture {
    struct memory memory;
    struct primitive_ref *refs, *scratch;
    struct box *boxes;
    struct split_request request;
};

static void start(struct fixture *f, enum test_refs_kind kind, uint32_t count, uint32_t piece_size)
{
    memory_init(&f->memory, UINT64_MAX);
    f->refs = test_refs_make(kind, count, 1 + count);
    f->scratch = test_refs_make(REFS_SAME, count, 0);
    f->boxes = test_refs_boxes(f->refs, count);
    f->request = (struct split_request){.refs = f->refs, .scratch = f->scratch, .count = count, .piece_size = piece_size};
    primitive_bounds(f->refs, count, &f->request.bounds, &f->request.centroids);
}

static void finish(struct fixture *f)
{
    free(f->refs);
    free(f->scratch);
    free(f->boxes);
    assert_int_equal(f->memory.live, 0);
}

static struct box box_of(const struct primitive_ref *refs, uint32_t first, uint32_t count)
{
    struct box box = box_empty();
    for (uint32_t i = first; i < first + count; i++) {
        struct box own = primitive_ref_box(&refs[i]);
        box_grow(&box, &own);
    }
    return box;
}

static bool same_box(const struct box *a, const struct box *b)
{
    return box_contains(a, b) && box_contains(b, a);
}

/* Every promise of split.h; returns the levels. */
static uint32_t check_tree(const struct fixture *f, const struct split_tree *tree)
{
    uint32_t count = f->request.count, pieces = 0, depth = 0;
    unsigned char *seen = calloc(count, 1);
    uint32_t *levels = calloc(tree->node_count, sizeof *levels);
    assert_true(seen && levels);
    for (uint32_t i = 0; i < count; i++) {
        assert_true(f->refs[i].id < count && !seen[f->refs[i].id]);
        seen[f->refs[i].id] = 1;
        struct box own = primitive_ref_box(&f->refs[i]);
        assert_memory_equal(&own, &f->boxes[f->refs[i].id], sizeof own);
    }
    assert_int_equal(tree->nodes[0].first, 0);
    assert_int_equal(tree->nodes[0].count, count);
    for (uint32_t i = 0; i < tree->node_count; i++) {
        const struct split_node *node = &tree->nodes[i], *child = &tree->nodes[node->child];
        struct box box = box_of(f->refs, node->first, node->count);
        assert_true(node->count > 0 && same_box(&box, &node->bounds));
        depth = levels[i] > depth ? levels[i] : depth;
        if (!node->child) {
            assert_true(node->count <= f->request.piece_size);
            pieces++;
            continue;
        }
        assert_true(node->count > f->request.piece_size);
        assert_true(node->child > i && node->child + 1 < tree->node_count);
        assert_int_equal(child[0].first, node->first);
        assert_int_equal(child[1].first, node->first + child[0].count);
        assert_int_equal(child[0].count + child[1].count, node->count);
        levels[node->child] = levels[node->child + 1] = levels[i] + 1;
    }
    assert_int_equal(pieces, tree->piece_count);
    assert_int_equal(tree->node_count, 2 * pieces - 1);
    free(seen);
    free(levels);
    return depth + 1;
}

static void every_kind_is_cut_into_pieces(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 2, 3, 17, 1000, 8192, 8193, 30000}, sizes[] = {1, 3, 100, 5000, 50000};
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++)
            for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
                struct fixture f;
                struct split_tree tree;
                start(&f, (enum test_refs_kind)kind, counts[c], sizes[s]);
                assert_int_equal(split_refs(&f.request, &f.memory, &parallel_serial, &tree, NULL), BVHD_OK);
                uint32_t depth = check_tree(&f, &tree);
                if (kind == REFS_SAME) /* halved */
                    assert_true(depth <= 1 + ceil(log2((counts[c] + sizes[s] - 1.0) / sizes[s])));
                memory_free(&f.memory, tree.nodes);
                finish(&f);
            }
}

static void threads_do_not_matter(void **state)
{
    (void)state;
    for (int kind = 0; kind < REFS_KINDS; kind++) {
        struct fixture first, other;
        struct split_tree tree, other_tree;
        start(&first, (enum test_refs_kind)kind, 60000, 1000);
        assert_int_equal(split_refs(&first.request, &first.memory, &parallel_serial, &tree, NULL), BVHD_OK);
        for (unsigned threads = 2; threads <= 8; threads *= 4) {
            struct workers *workers;
            assert_int_equal(workers_create(threads, &workers, NULL), BVHD_OK);
            start(&other, (enum test_refs_kind)kind, 60000, 1000);
            assert_int_equal(split_refs(&other.request, &other.memory, workers_parallel(workers), &other_tree, NULL), BVHD_OK);
            assert_int_equal(other_tree.node_count, tree.node_count);
            assert_memory_equal(other_tree.nodes, tree.nodes, tree.node_count * sizeof *tree.nodes);
            assert_memory_equal(other.refs, first.refs, 60000 * sizeof *first.refs);
            memory_free(&other.memory, other_tree.nodes);
            finish(&other);
            workers_destroy(workers);
        }
        memory_free(&first.memory, tree.nodes);
        finish(&first);
    }
}

/* A large part is split as a small one would be: rounds and tasks are the same method. */
static void rounds_and_tasks_agree(void **state)
{
    (void)state;
    struct fixture f;
    struct split_tree tree;
    struct bins bins;
    struct bins_mapping mapping;
    struct bins_plane plane;
    start(&f, REFS_CLUSTERS, 20000, 19999);
    bins_map(&f.request.centroids, 20000, &mapping);
    bins_clear(&bins, &mapping);
    bins_add(&bins, &mapping, f.refs, 20000);
    assert_true(bins_choose(&bins, &mapping, 20000, &f.request.bounds, &plane));
    assert_int_equal(split_refs(&f.request, &f.memory, &parallel_serial, &tree, NULL), BVHD_OK);
    assert_int_equal(tree.node_count, 3);
    assert_int_equal(tree.nodes[1].count, plane.left_count);
    assert_memory_equal(&tree.nodes[1].bounds, &plane.left, sizeof plane.left);
    assert_memory_equal(&tree.nodes[2].bounds, &plane.right, sizeof plane.right);
    memory_free(&f.memory, tree.nodes);
    finish(&f);
}

static double area_of(const struct primitive_ref *refs, uint32_t count, const struct bins_mapping *mapping, int axis, uint32_t bin,
                      bool left, uint32_t *ret_count)
{
    struct box box = box_empty();
    *ret_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        float at = (refs[i].min[axis] + refs[i].max[axis] - mapping->base[axis]) * mapping->scale[axis];
        if ((at < (float)bin) != left)
            continue;
        struct box own = primitive_ref_box(&refs[i]);
        box_grow(&box, &own);
        ++*ret_count;
    }
    return box_half_area(&box);
}

/* Against every plane, evaluated in double from the refs. */
static void the_plane_is_the_best_of_all(void **state)
{
    (void)state;
    static const uint32_t counts[] = {2, 5, 63, 64, 500, 1100};
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++) {
            struct fixture f;
            struct bins bins;
            struct bins_mapping mapping;
            struct bins_plane plane;
            uint32_t count = counts[c], left, right;
            start(&f, (enum test_refs_kind)kind, count, 1);
            bins_map(&f.request.centroids, count, &mapping);
            bins_clear(&bins, &mapping);
            bins_add(&bins, &mapping, f.refs, count);
            bool found = bins_choose(&bins, &mapping, count, &f.request.bounds, &plane);
            double best = INFINITY, chosen = INFINITY;
            for (int axis = 0; axis < 3; axis++)
                for (uint32_t bin = 1; bin < mapping.bins && (mapping.axes >> axis & 1); bin++) {
                    double cost = area_of(f.refs, count, &mapping, axis, bin, true, &left) * left;
                    cost += area_of(f.refs, count, &mapping, axis, bin, false, &right) * right;
                    best = left && right && cost < best ? cost : best;
                    if (found && (int)plane.axis == axis && plane.bin == bin) {
                        chosen = cost;
                        assert_int_equal(plane.left_count, left);
                    }
                }
            assert_true(found == (best < INFINITY));
            assert_true(!found || chosen <= best * (1 + 1e-5) + 1e-30);
            finish(&f);
        }
}

/* Better than splits in the middle of the longest axis. */
static void quality_is_that_of_sah(void **state)
{
    (void)state;
    struct fixture f;
    struct ir ir, median;
    start(&f, REFS_CLUSTERS, 20000, 2);
    assert_int_equal(split_build(&f.request, &f.memory, &parallel_serial, &ir, NULL), BVHD_OK);
    assert_int_equal(ir_check(&ir, 20000, f.boxes, false, &f.memory, NULL), BVHD_OK);
    assert_int_equal(test_ir_make(f.boxes, 20000, 2, &f.memory, &median), BVHD_OK);
    assert_true(ir_sah(&ir) < 0.95 * ir_sah(&median));
    ir_finish(&median);
    ir_finish(&ir);
    finish(&f);
}

static void split_build_makes_sound_trees(void **state)
{
    (void)state;
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (uint32_t count = 1; count < 10000; count = count * 4 + 1)
            for (uint32_t leaf = 1; leaf <= 3; leaf++) {
                struct fixture f;
                struct ir ir;
                start(&f, (enum test_refs_kind)kind, count, leaf);
                assert_int_equal(split_build(&f.request, &f.memory, &parallel_serial, &ir, NULL), BVHD_OK);
                assert_int_equal(ir_check(&ir, count, f.boxes, false, &f.memory, NULL), BVHD_OK);
                for (uint32_t i = 0; i < ir.node_count; i++)
                    assert_true(ir.nodes[i].count <= leaf);
                ir_finish(&ir);
                finish(&f);
            }
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    for (uint32_t size = 2; size < 20000; size = size * 50) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        for (int64_t n = 0; status == BVHD_NO_MEMORY; n++) {
            struct fixture f;
            struct ir ir;
            start(&f, REFS_CLOUD, 20000, size);
            f.memory.fail_after = n;
            status = split_build(&f.request, &f.memory, &parallel_serial, &ir, NULL);
            if (status == BVHD_OK)
                ir_finish(&ir);
            assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
            assert_true(n < 2000);
            finish(&f);
        }
    }
}

static void cancelling_ends_it(void **state)
{
    (void)state;
    struct fixture f;
    struct split_tree tree;
    struct bvhd_error error;
    atomic_bool cancel = true;
    for (uint32_t count = 100; count <= 20000; count += 19900) {
        start(&f, REFS_CLOUD, count, 10);
        f.request.cancel = &cancel;
        assert_int_equal(split_refs(&f.request, &f.memory, &parallel_serial, &tree, &error), BVHD_CANCELLED);
        assert_int_equal(error.status, BVHD_CANCELLED);
        finish(&f);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_is_cut_into_pieces),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(rounds_and_tasks_agree),
        cmocka_unit_test(the_plane_is_the_best_of_all),
        cmocka_unit_test(quality_is_that_of_sah),
        cmocka_unit_test(split_build_makes_sound_trees),
        cmocka_unit_test(failing_allocations_leave_nothing),
        cmocka_unit_test(cancelling_ends_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
