/* SPDX-License-Identifier: Apache-2.0 */
/* test_spatial.c - tests that trees with spatial splits are sound, repeatable, and cut only where it pays. */
#include "tests/support/unit.h"

#include "builder/piece/spatial.h"
#include "tests/support/builder/spatial_triangles.h"

static struct ir build(struct triangles *f)
{
    struct spatial_request request = {.canonical = &f->canonical,
                                      .refs = f->refs,
                                      .scratch = f->scratch,
                                      .count = f->count,
                                      .capacity = f->capacity,
                                      .price = triangles_price(f)};
    struct ir ir;
    assert_int_equal(spatial_build(&request, &f->memory, &ir, NULL), BVHD_OK);
    return ir;
}

static void check_points(const struct triangles *f, const struct ir *ir)
{
    struct use *uses = calloc(ir->ref_count, sizeof *uses);
    assert_non_null(uses);
    for (uint32_t i = 0; i < ir->node_count; i++) {
        assert_true(ir->nodes[i].count <= 1);
        if (ir->nodes[i].count == 1)
            uses[ir->nodes[i].first] = (struct use){ir->refs[ir->nodes[i].first], ir->boxes[0][i]};
    }
    triangles_check(f, uses, ir->ref_count);
    free(uses);
}

static void every_kind_gives_a_sound_tree(void **state)
{
    (void)state;
    uint64_t refs = 0, triangles = 0;
    for (int kind = 0; kind < KINDS; kind++)
        for (uint32_t count = 1; count < 5000; count = count * 2 + (count < 9))
            for (uint32_t share = 0; share < 3; share++) {
                struct triangles f;
                triangles_start(&f, (enum kind)kind, count,
                                share == 0   ? 0
                                : share == 1 ? spatial_capacity(count) - count
                                             : count);
                struct ir ir = build(&f);
                assert_int_equal(ir_check(&ir, count, f.boxes, true, &f.memory, NULL), BVHD_OK);
                assert_true(ir.ref_count >= count && ir.ref_count <= f.capacity);
                check_points(&f, &ir);
                refs += ir.ref_count;
                triangles += count;
                ir_finish(&ir);
                triangles_finish(&f);
            }
    assert_true(refs > triangles + triangles / 20); /* some were cut */
}

static void cuts_pay(void **state)
{
    (void)state;
    static const double gains[KINDS] = {[SLIVERS] = 0.98, [SIZES] = 0.75};
    for (int kind = 0; kind < KINDS; kind++) {
        struct triangles f, g;
        if (gains[kind] == 0)
            continue;
        triangles_start(&f, (enum kind)kind, 3000, 900);
        triangles_start(&g, (enum kind)kind, 3000, 0);
        struct ir ir = build(&f), whole = build(&g);
        assert_true(ir_sah(&ir) < gains[kind] * ir_sah(&whole));
        ir_finish(&ir);
        ir_finish(&whole);
        triangles_finish(&f);
        triangles_finish(&g);
    }
}

/* Beside a very large whole no overlap matters. Without room for cuts the triangles are not read. */
static void small_overlaps_are_left_alone(void **state)
{
    (void)state;
    struct triangles f, g;
    triangles_start(&f, SIZES, 2000, 400);
    triangles_start(&g, SIZES, 2000, 0);
    f.whole.max[0] = 1e9f;
    g.canonical.geometries = NULL;
    struct ir ir = build(&f), whole = build(&g);
    assert_int_equal(ir.ref_count, 2000);
    assert_int_equal(ir.node_count, whole.node_count);
    assert_true(fabs(ir_sah(&ir) - ir_sah(&whole)) < 1e-4 * ir_sah(&whole));
    ir_finish(&ir);
    ir_finish(&whole);
    triangles_finish(&f);
    triangles_finish(&g);
}

static void equal_input_gives_equal_trees(void **state)
{
    (void)state;
    for (int kind = 0; kind < KINDS; kind++) {
        struct triangles f, g;
        triangles_start(&f, (enum kind)kind, 1500, 300);
        triangles_start(&g, (enum kind)kind, 1500, 300);
        struct ir a = build(&f), b = build(&g);
        assert_int_equal(a.node_count, b.node_count);
        assert_int_equal(a.ref_count, b.ref_count);
        assert_memory_equal(a.nodes, b.nodes, a.node_count * sizeof *a.nodes);
        assert_memory_equal(a.boxes[0], b.boxes[0], a.node_count * sizeof *a.boxes[0]);
        assert_memory_equal(a.refs, b.refs, a.ref_count * sizeof *a.refs);
        ir_finish(&a);
        ir_finish(&b);
        triangles_finish(&f);
        triangles_finish(&g);
    }
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t n = 0; status != BVHD_OK; n++) {
        struct triangles f;
        struct ir ir;
        struct bvhd_error error = {.status = BVHD_OK};
        triangles_start(&f, SLIVERS, 1000, 200);
        struct spatial_request request = {&f.canonical, f.refs, f.scratch,          f.count,
                                          f.capacity,   NULL,   triangles_price(&f)};
        f.memory.fail_after = n;
        status = spatial_build(&request, &f.memory, &ir, &error);
        assert_true(n < 3 ? status == BVHD_NO_MEMORY : status == BVHD_OK);
        assert_int_equal(error.status, status);
        if (status == BVHD_OK)
            ir_finish(&ir);
        triangles_finish(&f);
    }
}

static void cancelling_ends_it(void **state)
{
    (void)state;
    struct triangles f;
    struct ir ir;
    struct bvhd_error error;
    atomic_bool cancel = true;
    triangles_start(&f, CLOUD, 1000, 0);
    struct spatial_request request = {&f.canonical, f.refs, f.scratch, f.count, f.capacity, &cancel, 1};
    assert_int_equal(spatial_build(&request, &f.memory, &ir, &error), BVHD_CANCELLED);
    assert_int_equal(error.status, BVHD_CANCELLED);
    triangles_finish(&f);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_gives_a_sound_tree),     cmocka_unit_test(cuts_pay),
        cmocka_unit_test(small_overlaps_are_left_alone),     cmocka_unit_test(equal_input_gives_equal_trees),
        cmocka_unit_test(failing_allocations_leave_nothing), cmocka_unit_test(cancelling_ends_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
