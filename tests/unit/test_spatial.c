/* SPDX-License-Identifier: Apache-2.0 */
#include "unit.h"

#include <math.h>

#include "binned.h"
#include "random.h"
#include "spatial.h"

enum kind {
    CLOUD, /* middle-sized, any direction */
    SLIVERS, /* long and thin, through everything */
    SAME, /* one triangle, over and over */
    THIN, /* an ulp thick */
    SIZES, /* over many orders of magnitude */
    FLAT, /* in one plane */
    FAR, /* small things far from the origin, where floats are coarse */
    FANS, /* one corner in common */
    KINDS
};

struct fixture {
    struct memory memory;
    struct canonical canonical;
    struct canonical_geometry geometry;
    float (*corners)[9];
    struct primitive_ref *refs;
    struct box *boxes, whole;
};

static void make_triangle(enum kind kind, struct random *random, float corners[9])
{
    double centre[3], size = kind == CLOUD ? 0.2 : kind == SIZES ? ldexp(1, (int)random_between(random, -30, 1)) : 1;
    random_point(random, centre);
    for (int i = 0; i < 3; i++)
        for (int axis = 0; axis < 3; axis++) {
            double at = random_between(random, -1, 1);
            if (kind == SLIVERS && i == 2)
                corners[6 + axis] = corners[3 + axis] + (float)(0.001 * at);
            else
                corners[3 * i + axis] = (float)(kind == SLIVERS ? at : centre[axis] + size * at);
            if (kind == FAR)
                corners[3 * i + axis] = (float)(30000 + centre[axis] + 0.05 * at);
            if (kind == SAME)
                corners[3 * i + axis] = (float)(i == axis) - 0.3f * (float)(i == 2);
            if (kind == FANS && i == 0)
                corners[axis] = 0.25f;
        }
    for (int i = 0; i < 3; i++) {
        if (kind == THIN)
            corners[3 * i + 2] = random_next(random) % 2 ? 1.0f : nextafterf(1, 2);
        if (kind == FLAT)
            corners[3 * i + 1] = 0.5f;
    }
}

static void start(struct fixture *f, enum kind kind, uint32_t count)
{
    struct random random = {count + 100 * (uint64_t)kind};
    memory_init(&f->memory, UINT64_MAX);
    f->corners = calloc(count, sizeof *f->corners);
    f->refs = calloc(count, sizeof *f->refs);
    f->boxes = calloc(count, sizeof *f->boxes);
    assert_true(f->corners && f->refs && f->boxes);
    f->whole = box_empty();
    for (uint32_t id = 0; id < count; id++) {
        struct box box = box_empty();
        make_triangle(kind, &random, f->corners[id]);
        for (int i = 0; i < 3; i++)
            box_add_point(&box, f->corners[id] + 3 * i);
        box_grow(&f->whole, &box);
        f->boxes[id] = box;
        f->refs[id] = (struct primitive_ref){{box.min[0], box.min[1], box.min[2]}, 0, {box.max[0], box.max[1], box.max[2]}, id};
    }
    f->geometry = (struct canonical_geometry){
        .type = GEOMETRY_TRIANGLES, .primitive_count = count, .vertex_count = 3 * count, .positions = f->corners[0]};
    f->canonical = (struct canonical){
        .type = STRUCTURE_BOTTOM, .geometry_count = 1, .primitive_count = count, .vertex_count = 3 * count, .geometries = &f->geometry};
}

static void finish(struct fixture *f)
{
    free(f->corners);
    free(f->refs);
    free(f->boxes);
    assert_int_equal(f->memory.live, 0);
}

static struct spatial_request request_of(const struct fixture *f, uint32_t leaf_max)
{
    return (struct spatial_request){.canonical = &f->canonical,
                                    .refs = f->refs,
                                    .count = f->canonical.primitive_count,
                                    .leaf_max = leaf_max,
                                    .whole = (float)box_half_area(&f->whole)};
}

static bool holds(const struct box *box, const long double point[3])
{
    for (int axis = 0; axis < 3; axis++)
        if (!(point[axis] >= box->min[axis] && point[axis] <= box->max[axis]))
            return false;
    return true;
}

/* Leaves by what they reference. */
struct use {
    uint32_t id, leaf;
};

static int by_id(const void *a, const void *b)
{
    uint32_t x = ((const struct use *)a)->id, y = ((const struct use *)b)->id;
    return (x > y) - (x < y);
}

static struct use *uses_of(const struct ir *ir)
{
    struct use *uses = calloc(ir->ref_count, sizeof *uses);
    assert_non_null(uses);
    for (uint32_t leaf = 0; leaf < ir->node_count; leaf++)
        for (uint32_t i = 0; i < ir->nodes[leaf].count; i++)
            uses[ir->nodes[leaf].first + i] = (struct use){ir->refs[ir->nodes[leaf].first + i], leaf};
    qsort(uses, ir->ref_count, sizeof *uses, by_id);
    return uses;
}

/* Corners, points of edges and of the inside: each lies in a leaf of the triangle. */
static void check_triangle(struct random *random, const struct ir *ir, const struct use *uses, uint32_t use_count,
                           const float corners[9], const struct box *box)
{
    for (int i = 0; i < 16; i++) {
        long double u = random_between(random, 0, 1), v = random_between(random, 0, 1), point[3];
        if (i < 3)
            u = i == 1, v = i == 2;
        else if (i < 9)
            v = i < 6 ? 0 : 1 - u;
        else if (u + v > 1)
            u = 1 - u, v = 1 - v;
        for (int k = 0; k < 3; k++)
            point[k] = corners[k] + u * ((long double)corners[3 + k] - corners[k]) + v * ((long double)corners[6 + k] - corners[k]);
        bool held = !holds(box, point); /* rounded out of the triangle */
        for (uint32_t k = 0; k < use_count; k++)
            held |= holds(&ir->boxes[0][uses[k].leaf], point);
        assert_true(held);
    }
}

static void check_points(const struct fixture *f, const struct ir *ir)
{
    struct random random = {ir->node_count};
    struct use *uses = uses_of(ir);
    for (uint32_t i = 0, end; i < ir->ref_count; i = end) {
        uint32_t id = uses[i].id;
        for (end = i; end < ir->ref_count && uses[end].id == id; end++)
            if (end > i)
                assert_int_not_equal(uses[end].leaf, uses[end - 1].leaf); /* a leaf names an id once */
        check_triangle(&random, ir, uses + i, end - i, f->corners[id], &f->boxes[id]);
    }
    free(uses);
}

static void every_kind_gives_a_sound_tree(void **state)
{
    (void)state;
    uint64_t refs = 0, triangles = 0;
    for (int kind = 0; kind < KINDS; kind++)
        for (uint32_t count = 1; count < 5000; count = count * 2 + (count < 9))
            for (uint32_t leaf = 1; leaf <= 4; leaf += 1 + (count > 1000)) {
                struct fixture f;
                struct ir ir;
                start(&f, (enum kind)kind, count);
                struct spatial_request request = request_of(&f, leaf);
                assert_int_equal(spatial_build(&request, &f.memory, &ir, NULL), BVHD_OK);
                assert_int_equal(ir_check(&ir, count, f.boxes, true, &f.memory, NULL), BVHD_OK);
                assert_true(ir.ref_count >= count && ir.ref_count <= spatial_capacity(count));
                for (uint32_t i = 0; i < ir.node_count; i++)
                    assert_true(ir.nodes[i].count <= leaf);
                check_points(&f, &ir);
                refs += ir.ref_count;
                triangles += count;
                ir_finish(&ir);
                finish(&f);
            }
    assert_true(refs > triangles + triangles / 20); /* it was about cuts */
}

static struct ir binned_tree(struct fixture *f, uint32_t leaf_max)
{
    uint32_t count = f->canonical.primitive_count;
    struct primitive_ref *refs = calloc(2 * (size_t)count, sizeof *refs);
    struct ir ir;
    assert_non_null(refs);
    memcpy(refs, f->refs, count * sizeof *refs);
    struct binned_request request = {.refs = refs, .scratch = refs + count, .count = count, .leaf_max = leaf_max};
    assert_int_equal(binned_build(&request, &f->memory, &ir, NULL), BVHD_OK);
    free(refs);
    return ir;
}

static void cuts_pay(void **state)
{
    (void)state;
    static const double gains[KINDS] = {[SLIVERS] = 0.98, [SIZES] = 0.75};
    for (int kind = 0; kind < KINDS; kind++) {
        struct fixture f;
        struct ir ir;
        if (gains[kind] == 0)
            continue;
        start(&f, (enum kind)kind, 3000);
        struct spatial_request request = request_of(&f, 3);
        struct ir whole = binned_tree(&f, 3);
        assert_int_equal(spatial_build(&request, &f.memory, &ir, NULL), BVHD_OK);
        printf("%d %g %g\n", kind, ir_sah(&ir) / ir_sah(&whole), ir.ref_count / 3000.);
        assert_true(ir_sah(&ir) < gains[kind] * ir_sah(&whole));
        ir_finish(&ir);
        ir_finish(&whole);
        finish(&f);
    }
}

/* Beside a large enough whole no overlap matters: the tree is that of binned.h. */
static void small_overlaps_are_left_alone(void **state)
{
    (void)state;
    struct fixture f;
    struct ir ir;
    start(&f, CLOUD, 2000);
    struct spatial_request request = request_of(&f, 3);
    struct ir whole = binned_tree(&f, 3);
    request.whole *= 1e9f;
    assert_int_equal(spatial_build(&request, &f.memory, &ir, NULL), BVHD_OK);
    assert_int_equal(ir.ref_count, 2000);
    assert_int_equal(ir.node_count, whole.node_count);
    assert_true(fabs(ir_sah(&ir) - ir_sah(&whole)) < 0.02 * ir_sah(&whole));
    ir_finish(&ir);
    ir_finish(&whole);
    finish(&f);
}

static void equal_input_gives_equal_trees(void **state)
{
    (void)state;
    for (int kind = 0; kind < KINDS; kind++) {
        struct fixture f;
        struct ir a, b;
        start(&f, (enum kind)kind, 1500);
        struct spatial_request request = request_of(&f, 3);
        assert_int_equal(spatial_build(&request, &f.memory, &a, NULL), BVHD_OK);
        assert_int_equal(spatial_build(&request, &f.memory, &b, NULL), BVHD_OK);
        assert_int_equal(a.node_count, b.node_count);
        assert_int_equal(a.ref_count, b.ref_count);
        assert_memory_equal(a.nodes, b.nodes, a.node_count * sizeof *a.nodes);
        assert_memory_equal(a.boxes[0], b.boxes[0], a.node_count * sizeof *a.boxes[0]);
        assert_memory_equal(a.refs, b.refs, a.ref_count * sizeof *a.refs);
        ir_finish(&a);
        ir_finish(&b);
        finish(&f);
    }
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t n = 0; status != BVHD_OK; n++) {
        struct fixture f;
        struct ir ir;
        struct bvhd_error error = {.status = BVHD_OK};
        start(&f, SLIVERS, 100);
        struct spatial_request request = request_of(&f, 2);
        f.memory.fail_after = n;
        status = spatial_build(&request, &f.memory, &ir, &error);
        assert_true(n < 4 ? status == BVHD_NO_MEMORY : status == BVHD_OK);
        assert_int_equal(error.status, status);
        if (status == BVHD_OK)
            ir_finish(&ir);
        finish(&f);
    }
}

static void cancelling_ends_it(void **state)
{
    (void)state;
    struct fixture f;
    struct ir ir;
    struct bvhd_error error;
    atomic_bool cancel = true;
    start(&f, CLOUD, 1000);
    struct spatial_request request = request_of(&f, 2);
    request.cancel = &cancel;
    assert_int_equal(spatial_build(&request, &f.memory, &ir, &error), BVHD_CANCELLED);
    assert_int_equal(error.status, BVHD_CANCELLED);
    finish(&f);
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
