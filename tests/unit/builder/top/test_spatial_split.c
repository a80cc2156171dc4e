/* SPDX-License-Identifier: Apache-2.0 */
/* test_spatial_split.c - tests that triangles are split spatially into sound pieces, with outsize refs apart. */
#include "tests/support/unit.h"

#include "builder/top/spatial_split.h"
#include "tests/support/builder/spatial_triangles.h"
#include "builder/workers.h"

static struct spatial_split_request request_of(const struct triangles *f, uint32_t piece_size)
{
    struct spatial_split_request request = {.canonical = &f->canonical,
                                            .refs = f->refs,
                                            .scratch = f->scratch,
                                            .count = f->count,
                                            .capacity = f->capacity,
                                            .piece_size = piece_size};
    primitive_ref_bounds(f->refs, f->count, &request.bounds, &request.centroids);
    return request;
}

static int by_first(const void *a, const void *b)
{
    uint32_t x = ((const struct split_node *)a)->first, y = ((const struct split_node *)b)->first;
    return (x > y) - (x < y);
}

/* Checks every promise of spatial_split.h; returns the number of refs. */
static uint32_t check_tree(const struct triangles *f, const struct split_tree *tree, uint32_t piece_size, bool apart)
{
    struct split_node *pieces = calloc(tree->piece_count, sizeof *pieces);
    struct use *uses = calloc(f->capacity, sizeof *uses);
    uint32_t piece_count = 0, refs = 0;
    assert_true(pieces && uses);
    assert_int_equal(tree->node_count, 2 * tree->piece_count - 1);
    for (uint32_t i = 0; i < tree->node_count; i++) {
        const struct split_node *node = &tree->nodes[i];
        if (node->child)
            assert_true(node->child > i && node->child % 2 == 1 && node->child + 1 < tree->node_count);
        else
            pieces[piece_count++] = *node;
    }
    assert_int_equal(piece_count, tree->piece_count);
    qsort(pieces, piece_count, sizeof *pieces, by_first);
    assert_int_equal(pieces[0].first, 0);
    for (uint32_t i = 0; i < piece_count; i++) {
        uint32_t end = i + 1 < piece_count ? pieces[i + 1].first : f->capacity;
        assert_true(pieces[i].count > 0 && pieces[i].count <= end - pieces[i].first);
        assert_true(pieces[i].count <= piece_size || apart);
        for (uint32_t k = pieces[i].first; k < pieces[i].first + pieces[i].count; k++)
            uses[refs++] = (struct use){f->refs[k].id, primitive_ref_box(&f->refs[k])};
    }
    assert_int_equal(tree->nodes[0].count, refs);
    triangles_check(f, uses, refs);
    free(pieces);
    free(uses);
    return refs;
}

static void every_kind_is_cut_into_pieces(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 2, 7, 100, 9000}, sizes[] = {1, 60, 4096};
    uint64_t triangles = 0, all = 0;
    for (int kind = 0; kind < KINDS; kind++)
        for (size_t c = 0; c < sizeof counts / sizeof *counts; c++)
            for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++) {
                struct triangles f;
                struct split_tree tree;
                float price;
                if (counts[c] > 1000 && sizes[s] == 1)
                    continue;
                triangles_start(&f, (enum kind)kind, counts[c], counts[c] / 5);
                struct spatial_split_request request = request_of(&f, sizes[s]);
                assert_int_equal(spatial_split(&request, &f.memory, &parallel_serial, &tree, &price, NULL), BVHD_OK);
                all += check_tree(&f, &tree, sizes[s], false);
                triangles += counts[c];
                assert_true(price >= 0 && price <= triangles_price(&f) * 1.0001f);
                memory_free(&f.memory, tree.nodes);
                triangles_finish(&f);
            }
    assert_true(all > triangles + triangles / 50); /* some were cut */
}

/* Without room for more refs nothing is cut, and the triangles are not read. */
static void without_room_refs_stay_whole(void **state)
{
    (void)state;
    for (int kind = 0; kind < KINDS; kind++) {
        struct triangles f;
        struct split_tree tree;
        float price;
        triangles_start(&f, (enum kind)kind, 5000, 0);
        struct spatial_split_request request = request_of(&f, 100);
        request.canonical = NULL;
        assert_int_equal(spatial_split(&request, &f.memory, &parallel_serial, &tree, &price, NULL), BVHD_OK);
        assert_int_equal(check_tree(&f, &tree, 100, false), 5000);
        memory_free(&f.memory, tree.nodes);
        triangles_finish(&f);
    }
}

static void outsize_refs_are_set_apart(void **state)
{
    (void)state;
    for (uint32_t size = 1000; size <= 20000; size += 19000) {
        struct triangles f;
        struct split_tree tree;
        float price;
        triangles_start(&f, GROUND, 10000, 2000);
        struct spatial_split_request request = request_of(&f, size);
        assert_int_equal(spatial_split(&request, &f.memory, &parallel_serial, &tree, &price, NULL), BVHD_OK);
        check_tree(&f, &tree, size, false);
        assert_int_equal(tree.nodes[0].child, 1);
        assert_int_equal(tree.nodes[2].child, 0);
        assert_int_equal(tree.nodes[2].count, 2);
        assert_int_equal(tree.nodes[2].first, 11998); /* the outsize piece has no room for more */
        assert_int_equal(f.refs[11998].id + f.refs[11999].id, 1);
        double areas = 0;
        struct box others = box_empty();
        for (uint32_t id = 2; id < f.count; id++) {
            areas += box_half_area(&f.boxes[id]);
            box_grow(&others, &f.boxes[id]);
        }
        assert_true(fabs(price / spatial_price(areas, (float)box_half_area(&others), 9998) - 1) < 1e-4);
        memory_free(&f.memory, tree.nodes);
        triangles_finish(&f);
    }
}

static void threads_do_not_matter(void **state)
{
    (void)state;
    for (int kind = 0; kind < KINDS; kind++) {
        struct triangles first, other;
        struct split_tree tree, other_tree;
        float price, other_price;
        triangles_start(&first, (enum kind)kind, 9000, 1800);
        struct spatial_split_request request = request_of(&first, 500);
        assert_int_equal(spatial_split(&request, &first.memory, &parallel_serial, &tree, &price, NULL), BVHD_OK);
        for (unsigned threads = 2; threads <= 8; threads *= 4) {
            struct workers *workers;
            assert_int_equal(workers_create(threads, &workers, NULL), BVHD_OK);
            triangles_start(&other, (enum kind)kind, 9000, 1800);
            request = request_of(&other, 500);
            assert_int_equal(
                spatial_split(&request, &other.memory, workers_parallel(workers), &other_tree, &other_price, NULL),
                BVHD_OK);
            assert_int_equal(other_tree.node_count, tree.node_count);
            assert_memory_equal(&other_price, &price, sizeof price);
            for (uint32_t i = 0; i < tree.node_count; i++) {
                const struct split_node *a = &tree.nodes[i], *b = &other_tree.nodes[i];
                assert_true(a->child == b->child && a->first == b->first && a->count == b->count);
                if (a->child == 0)
                    assert_memory_equal(&first.refs[a->first], &other.refs[b->first], a->count * sizeof *first.refs);
            }
            memory_free(&other.memory, other_tree.nodes);
            triangles_finish(&other);
            workers_destroy(workers);
        }
        memory_free(&first.memory, tree.nodes);
        triangles_finish(&first);
    }
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    enum bvhd_status status = BVHD_NO_MEMORY;
    int64_t n = 0;
    for (; status != BVHD_OK; n++) {
        struct triangles f;
        struct split_tree tree = {.nodes = NULL};
        struct bvhd_error error = {.status = BVHD_OK};
        float price;
        triangles_start(&f, SLIVERS, 1000, 200);
        struct spatial_split_request request = request_of(&f, 10);
        f.memory.fail_after = n;
        status = spatial_split(&request, &f.memory, &parallel_serial, &tree, &price, &error);
        assert_true(status == BVHD_OK || status == BVHD_NO_MEMORY);
        assert_int_equal(error.status, status);
        memory_free(&f.memory, tree.nodes);
        triangles_finish(&f);
    }
    assert_true(n > 4); /* the array of nodes had to grow */
}

static void cancelling_ends_it(void **state)
{
    (void)state;
    struct triangles f;
    struct split_tree tree;
    struct bvhd_error error;
    atomic_bool cancel = true;
    float price;
    triangles_start(&f, CLOUD, 10000, 100);
    struct spatial_split_request request = request_of(&f, 100);
    request.cancel = &cancel;
    assert_int_equal(spatial_split(&request, &f.memory, &parallel_serial, &tree, &price, &error), BVHD_CANCELLED);
    assert_int_equal(error.status, BVHD_CANCELLED);
    triangles_finish(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_is_cut_into_pieces),     cmocka_unit_test(without_room_refs_stay_whole),
        cmocka_unit_test(outsize_refs_are_set_apart),        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(failing_allocations_leave_nothing), cmocka_unit_test(cancelling_ends_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
