/* SPDX-License-Identifier: Apache-2.0 */
/* test_split.c - tests that refs are divided into bounded pieces, the same for any number of threads. */
#include "tests/support/unit.h"

#include <math.h>

#include "builder/kernel/bins.h"
#include "builder/top/split.h"
#include "tests/support/builder/test_refs.h"
#include "builder/workers.h"

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
    f->request =
        (struct split_request){.refs = f->refs, .scratch = f->scratch, .count = count, .piece_size = piece_size};
    primitive_ref_bounds(f->refs, count, &f->request.bounds, &f->request.centroids);
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

/* Checks every promise of split.h; returns the number of levels. */
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
    static const uint32_t counts[] = {1, 2, 3, 17, 1000, 32768, 32769, 50000}, sizes[] = {1, 3, 100, 5000, 80000};
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++)
            for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
                struct fixture f;
                struct split_tree tree;
                if (counts[c] > 2000 && sizes[s] < 5000 && (kind != REFS_CLUSTERS || sizes[s] != 100))
                    continue;
                start(&f, (enum test_refs_kind)kind, counts[c], sizes[s]);
                assert_int_equal(split_refs(&f.request, &f.memory, &parallel_serial, &tree, NULL), BVHD_OK);
                uint32_t depth = check_tree(&f, &tree);
                if (kind == REFS_SAME) /* equal refs are halved */
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
        start(&first, (enum test_refs_kind)kind, 50000, 1000);
        assert_int_equal(split_refs(&first.request, &first.memory, &parallel_serial, &tree, NULL), BVHD_OK);
        for (unsigned threads = 2; threads <= 8; threads *= 4) {
            struct workers *workers;
            assert_int_equal(workers_create(threads, &workers, NULL), BVHD_OK);
            start(&other, (enum test_refs_kind)kind, 50000, 1000);
            assert_int_equal(split_refs(&other.request, &other.memory, workers_parallel(workers), &other_tree, NULL),
                             BVHD_OK);
            assert_int_equal(other_tree.node_count, tree.node_count);
            assert_memory_equal(other_tree.nodes, tree.nodes, tree.node_count * sizeof *tree.nodes);
            assert_memory_equal(other.refs, first.refs, 50000 * sizeof *first.refs);
            memory_free(&other.memory, other_tree.nodes);
            finish(&other);
            workers_destroy(workers);
        }
        memory_free(&first.memory, tree.nodes);
        finish(&first);
    }
}

/* Rounds use the same method as tasks: a large part is divided as a small one would be. */
static void rounds_and_tasks_agree(void **state)
{
    (void)state;
    struct fixture f;
    struct split_tree tree;
    struct bins bins;
    struct bins_mapping mapping;
    struct bins_plane plane;
    struct vec4_box centroids;
    start(&f, REFS_CLUSTERS, 40000, 39999);
    centroids = vec4_box_from(&f.request.centroids);
    bins_map(&centroids, 40000, &mapping);
    bins_clear(&bins, &mapping);
    bins_add(&bins, &mapping, f.refs, 40000);
    assert_true(bins_choose(&bins, &mapping, 40000, &plane));
    assert_int_equal(split_refs(&f.request, &f.memory, &parallel_serial, &tree, NULL), BVHD_OK);
    assert_int_equal(tree.node_count, 3);
    assert_int_equal(tree.nodes[1].count, plane.left_count);
    struct box left = vec4_box_get(plane.left), right = vec4_box_get(plane.right);
    assert_memory_equal(&tree.nodes[1].bounds, &left, sizeof left);
    assert_memory_equal(&tree.nodes[2].bounds, &right, sizeof right);
    memory_free(&f.memory, tree.nodes);
    finish(&f);
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    for (uint32_t size = 20; size < 20000; size = size * 50) {
        enum bvhd_status status = BVHD_NO_MEMORY;
        for (int64_t n = 0; status == BVHD_NO_MEMORY; n++) {
            struct fixture f;
            struct split_tree tree;
            start(&f, REFS_CLOUD, 40000, size);
            f.memory.fail_after = n;
            status = split_refs(&f.request, &f.memory, &parallel_serial, &tree, NULL);
            if (status == BVHD_OK)
                memory_free(&f.memory, tree.nodes);
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
    for (uint32_t count = 100; count <= 40000; count += 39900) {
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
        cmocka_unit_test(failing_allocations_leave_nothing),
        cmocka_unit_test(cancelling_ends_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
