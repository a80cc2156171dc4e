/* SPDX-License-Identifier: Apache-2.0 */
/* test_scatter_plan.c - tests that planes and cells agree, that pieces are bounded, and that threads do not matter. */
#include "tests/support/unit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "builder/top/scatter_plan.h"
#include "tests/support/builder/test_refs.h"
#include "builder/workers.h"

static bool is_in(const struct scatter_cell *cell, const float centroid[3])
{
    for (int axis = 0; axis < 3; axis++)
        if (!(centroid[axis] >= cell->low[axis] && centroid[axis] < cell->high[axis]))
            return false;
    return true;
}

static uint32_t piece_by_planes(const struct scatter_plan *plan, const float centroid[3])
{
    uint32_t node = 0, steps = 0;
    while (plan->nodes[node].child != node) {
        node = plan->nodes[node].child + (centroid[plan->nodes[node].axis] >= plan->nodes[node].threshold);
        steps++;
    }
    assert_true(steps <= plan->levels);
    return plan->nodes[node].piece;
}

/* Checks every promise of scatter_plan.h. */
static void check_plan(const struct scatter_plan *plan, const struct primitive_ref *refs, uint32_t count,
                       uint32_t enough)
{
    uint32_t in_piece[SCATTER_PIECES_MAX] = {0}, pieces = 0;
    assert_int_equal(plan->node_count, 2 * plan->piece_count - 1);
    for (uint32_t i = 0; i < plan->node_count; i++) {
        const struct scatter_node *node = &plan->nodes[i];
        if (node->child == i) {
            assert_true(isinf(node->threshold) && node->axis == 0 && node->piece < plan->piece_count);
            pieces++;
        } else {
            assert_true(node->child > i && node->child % 2 == 1 && node->child + 1 < plan->node_count &&
                        node->axis < 3);
        }
    }
    assert_int_equal(pieces, plan->piece_count);
    for (uint32_t i = 0; i < count; i++) {
        float centroid[3];
        for (int axis = 0; axis < 3; axis++)
            centroid[axis] = refs[i].min[axis] + refs[i].max[axis];
        uint32_t own = piece_by_planes(plan, centroid);
        in_piece[own]++;
        for (uint32_t piece = 0; piece < plan->piece_count; piece++)
            assert_int_equal(is_in(&plan->cells[piece], centroid), piece == own);
    }
    for (uint32_t piece = 0; piece < plan->piece_count && plan->piece_count > 1; piece++)
        assert_true(in_piece[piece] > 0);
    if (plan->piece_count < SCATTER_PIECES_MAX)
        for (uint32_t piece = 0; piece < plan->piece_count; piece++)
            assert_true(in_piece[piece] <= enough || plan->piece_count == 1);
}

static void cells_hold_what_planes_send_there(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 2, 100, 3000};
    for (size_t c = 0; c < sizeof counts / sizeof *counts; c++) {
        struct scatter_plan plan;
        struct primitive_ref *refs = test_refs_make(REFS_CLOUD, counts[c], 7);
        scatter_plan_make(refs, NULL, counts[c], 50, &parallel_serial, &plan);
        check_plan(&plan, refs, counts[c], 50);
        assert_int_equal(plan.piece_count > 1, counts[c] > 50);
        free(refs);
    }
}

static void there_are_no_more_pieces_than_fit(void **state)
{
    (void)state;
    struct scatter_plan plan;
    struct primitive_ref *refs = test_refs_make(REFS_CLOUD, 6000, 7);
    scatter_plan_make(refs, NULL, 6000, 4, &parallel_serial, &plan);
    assert_int_equal(plan.piece_count, SCATTER_PIECES_MAX);
    check_plan(&plan, refs, 6000, 4);
    free(refs);
}

static void no_refs_are_one_piece(void **state)
{
    (void)state;
    struct scatter_plan plan;
    const float anywhere[3] = {1, -2, 3e30f};
    scatter_plan_make(NULL, NULL, 0, 0, &parallel_serial, &plan);
    assert_int_equal(plan.node_count, 1);
    assert_int_equal(plan.piece_count, 1);
    assert_int_equal(plan.levels, 0);
    assert_true(is_in(&plan.cells[0], anywhere));
}

static bool is_same(const struct scatter_plan *a, const struct scatter_plan *b)
{
    return a->node_count == b->node_count && a->piece_count == b->piece_count && a->levels == b->levels &&
           memcmp(a->nodes, b->nodes, a->node_count * sizeof *a->nodes) == 0 &&
           memcmp(a->cells, b->cells, a->piece_count * sizeof *a->cells) == 0;
}

static void threads_do_not_matter(void **state)
{
    (void)state;
    static const uint32_t enough[] = {1000, 100, 8};
    struct workers *workers;
    assert_int_equal(workers_create(4, &workers, NULL), BVHD_OK);
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (size_t e = 0; e < sizeof enough / sizeof *enough; e++)
            for (int run = 0; run < 5; run++) {
                struct scatter_plan one, many;
                struct primitive_ref *refs = test_refs_make((enum test_refs_kind)kind, 10000, 3);
                struct primitive_ref *others = test_refs_make((enum test_refs_kind)kind, 10000, 3);
                struct primitive_ref *spare = run % 2 ? malloc(20000 * sizeof *spare) : NULL;
                scatter_plan_make(refs, NULL, 10000, enough[e], &parallel_serial, &one);
                scatter_plan_make(others, spare, 10000, enough[e], workers_parallel(workers), &many);
                assert_true(is_same(&one, &many));
                free(refs);
                free(others);
                free(spare);
            }
    workers_destroy(workers);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cells_hold_what_planes_send_there),
        cmocka_unit_test(there_are_no_more_pieces_than_fit),
        cmocka_unit_test(no_refs_are_one_piece),
        cmocka_unit_test(threads_do_not_matter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
