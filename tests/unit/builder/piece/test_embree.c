/* SPDX-License-Identifier: Apache-2.0 */
/*
 * test_embree.c - tests that Embree's trees are sound and repeatable, on all input that its assertions or its recursion
 * would not survive by themselves. Where Embree cannot be loaded, the tests are skipped.
 */
#include "tests/support/unit.h"

#include "builder/piece/embree.h"
#include "builder/piece/embree_library.h"
#include "builder/piece/spatial.h"
#include "tests/support/builder/builders.h"
#include "tests/support/builder/spatial_triangles.h"

static const enum embree_quality qualities[] = {EMBREE_LOW, EMBREE_MEDIUM, EMBREE_HIGH};

static int start(void **state)
{
    (void)state;
    struct bvhd_error error;
    if (embree_open(&error) == BVHD_OK)
        return 0;
    assert_string_equal(error.where, "build.builder");
    skip();
    return 0;
}

static int end(void **state)
{
    (void)state;
    embree_close();
    return 0;
}

static struct embree_request request_for(struct triangles *f, enum embree_quality quality, uint32_t leaf_max)
{
    return (struct embree_request){.quality = quality,
                                   .canonical = &f->canonical,
                                   .refs = f->refs,
                                   .scratch = f->scratch,
                                   .count = f->count,
                                   .capacity = quality == EMBREE_HIGH ? f->capacity : f->count,
                                   .leaf_max = leaf_max};
}

static struct ir build_tree(struct triangles *f, enum embree_quality quality, uint32_t leaf_max)
{
    const struct embree_request request = request_for(f, quality, leaf_max);
    struct ir ir;
    assert_int_equal(embree_build(&request, &f->memory, &ir, NULL), BVHD_OK);
    return ir;
}

/* Every point of a triangle lies in the box of a leaf that names it. */
static void check_points(const struct triangles *f, const struct ir *ir)
{
    struct use *uses = calloc(ir->ref_count, sizeof *uses);
    assert_non_null(uses);
    for (uint32_t i = 0; i < ir->node_count; i++)
        for (uint32_t k = 0; k < ir->nodes[i].count; k++)
            uses[ir->nodes[i].first + k] = (struct use){ir->refs[ir->nodes[i].first + k], ir->boxes[0][i]};
    triangles_check(f, uses, ir->ref_count);
    free(uses);
}

static bool names_twice(const struct ir *ir, struct ir_node leaf)
{
    for (uint32_t i = leaf.first; i < leaf.first + leaf.count; i++)
        for (uint32_t k = leaf.first; k < i; k++)
            if (ir->refs[i] == ir->refs[k])
                return true;
    return false;
}

static void check_leaves(const struct ir *ir, uint32_t leaf_max)
{
    for (uint32_t i = 0; i < ir->node_count; i++) {
        assert_true(ir->nodes[i].count <= leaf_max);
        assert_false(names_twice(ir, ir->nodes[i]));
    }
}

static void every_kind_gives_a_sound_tree(void **state)
{
    (void)state;
    uint64_t refs = 0, triangles = 0;
    for (int kind = 0; kind < KINDS; kind++)
        for (uint32_t count = 1; count <= EMBREE_SPLIT_PIECE_MOST; count = count * 3 + (count < 9))
            for (int q = 0; q < 3; q++)
                for (uint32_t leaf_max = 1; leaf_max <= 3; leaf_max += 2) {
                    struct triangles f;
                    triangles_start(&f, (enum kind)kind, count, spatial_capacity(count) - count);
                    struct ir ir = build_tree(&f, qualities[q], leaf_max);
                    bool splits = qualities[q] == EMBREE_HIGH;
                    assert_int_equal(ir_check(&ir, count, f.boxes, splits, &f.memory, NULL), BVHD_OK);
                    check_leaves(&ir, leaf_max);
                    if (leaf_max == 1)
                        check_points(&f, &ir);
                    refs += splits ? ir.ref_count : 0;
                    triangles += splits ? count : 0;
                    ir_finish(&ir);
                    assert_int_equal(f.memory.live, 0);
                    triangles_finish(&f);
                }
    assert_true(refs > triangles + triangles / 100); /* some were cut */
}

static void assert_equal_trees(const struct ir *a, const struct ir *b)
{
    assert_int_equal(a->node_count, b->node_count);
    assert_int_equal(a->ref_count, b->ref_count);
    assert_memory_equal(a->nodes, b->nodes, a->node_count * sizeof *a->nodes);
    assert_memory_equal(a->boxes[0], b->boxes[0], a->node_count * sizeof *a->boxes[0]);
    assert_memory_equal(a->refs, b->refs, a->ref_count * sizeof *a->refs);
}

/* Trees depend neither on the instruction set that Embree is told to use, nor on its threads. */
static void every_configuration_gives_the_same_trees(void **state)
{
    (void)state;
    static const char *const configurations[] = {"threads=1,isa=sse2", "threads=1,isa=avx2", "threads=2"};
    for (int q = 0; q < 3; q++) {
        struct triangles f;
        triangles_start(&f, CLOUD, qualities[q] == EMBREE_HIGH ? EMBREE_SPLIT_PIECE_MOST : EMBREE_PIECE_MOST, 400);
        struct ir first = build_tree(&f, qualities[q], 3);
        for (int i = 0; i < 3; i++) {
            embree_close();
            embree_library_configure(configurations[i]);
            assert_int_equal(embree_open(NULL), BVHD_OK);
            struct ir ir = build_tree(&f, qualities[q], 3);
            assert_equal_trees(&ir, &first);
            ir_finish(&ir);
        }
        ir_finish(&first);
        triangles_finish(&f);
        embree_close();
        embree_library_configure(NULL);
        assert_int_equal(embree_open(NULL), BVHD_OK);
    }
}

/*
 * Points on a line at distances that grow by a constant factor: SAH splits one off after the other, so that the tree
 * would become deeper than the stack.
 */
static void chains_are_bounded(void **state)
{
    (void)state;
    enum { COUNT = EMBREE_PIECE_MOST };
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    struct primitive_ref *refs = calloc(COUNT, sizeof *refs), *scratch = memory_array(&memory, COUNT, sizeof *refs);
    assert_true(refs && scratch);
    for (uint32_t i = 0; i < COUNT; i++) {
        refs[i].min[0] = refs[i].max[0] = (float)ldexp(pow(1.033, (int)i - COUNT), 40);
        refs[i].id = i;
    }
    for (int q = 0; q < 3; q++)
        for (uint32_t leaf_max = 1; leaf_max <= 3; leaf_max += 2) {
            struct embree_request request = {.quality = qualities[q],
                                             .refs = refs,
                                             .scratch = scratch,
                                             .count = COUNT,
                                             .capacity = COUNT,
                                             .leaf_max = leaf_max};
            struct ir ir;
            assert_int_equal(embree_build(&request, &memory, &ir, NULL), BVHD_OK);
            assert_int_equal(ir_check(&ir, COUNT, NULL, false, &memory, NULL), BVHD_OK);
            assert_true(ir_depth(&ir, &memory) <= 80);
            check_leaves(&ir, leaf_max);
            ir_finish(&ir);
        }
    memory_free(&memory, scratch);
    assert_int_equal(memory.live, 0);
    free(refs);
}

/* A coordinate on a coarse grid, a few units of rounding beside it: planes of spatial splits go through such boxes. */
static float beside_the_grid(struct random *random)
{
    const double steps = random_between(random, -3, 3);
    return (float)(floor(random_between(random, 0, 17)) / 16 +
                   floor(steps) * ldexp(1, -(int)random_between(random, 10, 26)));
}

static void hardly_thick_boxes_are_safe(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed <= 300; seed++) {
        struct random random = {seed};
        struct triangles f;
        triangles_start(&f, CLOUD, 1 + (uint32_t)(seed * 7 % 200), 200);
        for (uint32_t i = 0; i < f.count; i++) {
            struct box box = box_empty();
            for (int k = 0; k < 9; k++)
                f.corners[i][k] = beside_the_grid(&random);
            for (int k = 0; k < 3; k++)
                box_add_point(&box, &f.corners[i][3 * k]);
            memcpy(f.refs[i].min, box.min, sizeof box.min);
            memcpy(f.refs[i].max, box.max, sizeof box.max);
            f.boxes[i] = box;
        }
        struct ir ir = build_tree(&f, EMBREE_HIGH, 1);
        assert_int_equal(ir_check(&ir, f.count, f.boxes, true, &f.memory, NULL), BVHD_OK);
        ir_finish(&ir);
        triangles_finish(&f);
    }
}

/* Memory that Embree allocates counts in the budget, and a refusal of it is an error like any other. */
static void memory_is_counted(void **state)
{
    (void)state;
    for (int q = 0; q < 3; q++) {
        struct triangles f;
        enum bvhd_status status = BVHD_NO_MEMORY;
        struct ir ir;
        int64_t n = 0;
        triangles_start(&f, CLOUD, 500, 100);
        const struct embree_request request = request_for(&f, qualities[q], 3);
        for (; status == BVHD_NO_MEMORY; n++) {
            f.memory.fail_after = n;
            status = embree_build(&request, &f.memory, &ir, NULL);
            assert_true(status == BVHD_OK || f.memory.live == 0);
        }
        assert_int_equal(status, BVHD_OK);
        assert_true(n > (qualities[q] == EMBREE_LOW ? 7 : 5)); /* LOW sorts codes, in two arrays of Embree's own */
        ir_finish(&ir);
        triangles_finish(&f);
    }
}

/* What Embree might answer: a node whose children are never set, and nodes with 1 or 3 of them or with their parent. */
enum { UNSET, ONE, THREE, ITS_PARENT, ANSWERS };
static int answer;

static void *build_wrongly(const struct RTCBuildArguments *arguments)
{
    void *user = arguments->userPtr, *root = arguments->createNode(NULL, 2, user);
    void *leaf = arguments->createLeaf(NULL, arguments->primitives, arguments->primitiveCount, user);
    void *children[3] = {leaf, answer == ITS_PARENT ? root : leaf, leaf};
    if (answer != UNSET)
        arguments->setNodeChildren(root, children, answer == ONE ? 1 : answer == THREE ? 3 : 2, user);
    return root;
}

static void impossible_trees_are_errors(void **state)
{
    (void)state;
    struct triangles f;
    struct bvhd_error error;
    struct ir ir;
    triangles_start(&f, CLOUD, 2, 0);
    const struct embree_request request = request_for(&f, EMBREE_MEDIUM, 3);
    embree_library_replace_build(build_wrongly);
    for (answer = UNSET; answer < ANSWERS; answer++) {
        assert_int_equal(embree_build(&request, &f.memory, &ir, &error), BVHD_INTERNAL);
        assert_int_equal(f.memory.live, 0);
    }
    embree_library_replace_build(NULL);
    ir = build_tree(&f, EMBREE_MEDIUM, 3);
    ir_finish(&ir);
    triangles_finish(&f);
}

static void the_identity_is_constant(void **state)
{
    (void)state;
    struct embree_identity a, b;
    assert_int_equal(embree_identify(&a, NULL), BVHD_OK);
    assert_int_equal(embree_identify(&b, NULL), BVHD_OK);
    assert_int_equal(a.version / 10000, RTC_VERSION_MAJOR);
    assert_int_equal(a.version, b.version);
    assert_int_equal(a.estimate, b.estimate);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(every_kind_gives_a_sound_tree, start, end),
        cmocka_unit_test_setup_teardown(every_configuration_gives_the_same_trees, start, end),
        cmocka_unit_test_setup_teardown(chains_are_bounded, start, end),
        cmocka_unit_test_setup_teardown(hardly_thick_boxes_are_safe, start, end),
        cmocka_unit_test_setup_teardown(memory_is_counted, start, end),
        cmocka_unit_test_setup_teardown(impossible_trees_are_errors, start, end),
        cmocka_unit_test_setup_teardown(the_identity_is_constant, start, end),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
