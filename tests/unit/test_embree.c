/* SPDX-License-Identifier: Apache-2.0 */
#include "unit.h"

#include <math.h>
#include <pthread.h>

#if defined(__has_include) && __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include "embree.h"
#include "test_refs.h"
#include "workers.h"

static struct embree *make(void)
{
    struct embree *embree;
    assert_int_equal(embree_create(&embree, NULL), BVHD_OK);
    return embree;
}

static enum bvhd_status run(struct embree *embree, struct primitive_ref *refs, uint32_t count, uint32_t leaf_max, struct memory *memory,
                            struct ir *ret_ir, struct bvhd_error *error)
{
    struct embree_request request = {.refs = refs, .count = count, .leaf_max = leaf_max};
    return embree_build(embree, &request, memory, ret_ir, error);
}

static void every_kind_gives_a_sound_tree(void **state)
{
    (void)state;
    struct embree *embree = make();
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    for (int kind = 0; kind < REFS_KINDS; kind++)
        for (uint32_t count = 1; count < 12000; count = count * 3 + (count < 6))
            for (uint32_t leaf = 1; leaf <= 3; leaf++) {
                struct primitive_ref *refs = test_refs_make((enum test_refs_kind)kind, count, count);
                struct box *boxes = test_refs_boxes(refs, count);
                struct ir ir;
                assert_int_equal(run(embree, refs, count, leaf, &memory, &ir, NULL), BVHD_OK);
                assert_int_equal(ir_check(&ir, count, boxes, false, &memory, NULL), BVHD_OK);
                for (uint32_t i = 0; i < ir.node_count; i++)
                    assert_true(ir.nodes[i].count <= leaf);
                ir_finish(&ir);
                free(refs);
                free(boxes);
            }
    embree_destroy(embree);
    assert_int_equal(memory.live, 0);
}

struct job {
    struct embree *embree;
    struct memory *memory;
    struct ir *irs;
};

static void run_job(void *context, size_t index)
{
    struct job *job = context;
    struct primitive_ref *refs = test_refs_make(REFS_CLOUD, 5000, index / 4);
    assert_int_equal(run(job->embree, refs, 5000, 3, job->memory, &job->irs[index], NULL), BVHD_OK);
    free(refs);
}

static void assert_equal_irs(const struct ir *a, const struct ir *b)
{
    assert_int_equal(a->node_count, b->node_count);
    assert_int_equal(a->ref_count, b->ref_count);
    assert_memory_equal(a->nodes, b->nodes, a->node_count * sizeof *a->nodes);
    assert_memory_equal(a->boxes[0], b->boxes[0], a->node_count * sizeof *a->boxes[0]);
    assert_memory_equal(a->refs, b->refs, a->ref_count * sizeof *a->refs);
}

static void builds_side_by_side_are_the_same(void **state)
{
    (void)state;
    enum { JOBS = 24 };
    struct memory memory;
    struct ir irs[2][JOBS];
    memory_init(&memory, UINT64_MAX);
    for (int i = 0; i < 2; i++) {
        struct workers *workers;
        struct job job = {make(), &memory, irs[i]};
        assert_int_equal(workers_create(i ? 4 : 1, &workers, NULL), BVHD_OK);
        parallel_for(workers_parallel(workers), JOBS, run_job, &job);
        workers_destroy(workers);
        embree_destroy(job.embree);
    }
    for (int i = 0; i < JOBS; i++) {
        assert_equal_irs(&irs[0][i], &irs[1][i]);
        ir_finish(&irs[0][i]);
        ir_finish(&irs[1][i]);
    }
    assert_int_equal(memory.live, 0);
}

/* A device with more threads takes over Embree's threads; then the order of callbacks is chance, and it must show. */
static void callbacks_from_elsewhere_are_refused(void **state)
{
    (void)state;
#ifdef __SANITIZE_THREAD__
    skip(); /* what orders those threads is not instrumented */
#endif
    enum { COUNT = 50000 };
    struct embree *embree = make();
    RTCDevice other = rtcNewDevice("threads=4");
    struct memory memory;
    struct ir ir;
    struct bvhd_error error;
    memory_init(&memory, UINT64_MAX);
    for (int round = 0; round < 5; round++) {
        struct primitive_ref *refs = test_refs_make(REFS_CLOUD, COUNT, 2);
        struct box *boxes = test_refs_boxes(refs, COUNT);
        enum bvhd_status status = run(embree, refs, COUNT, 3, &memory, &ir, &error);
        assert_true(status == BVHD_OK || status == BVHD_UNSUPPORTED);
        if (status == BVHD_OK) {
            assert_int_equal(ir_check(&ir, COUNT, boxes, false, &memory, NULL), BVHD_OK);
            ir_finish(&ir);
        }
        free(refs);
        free(boxes);
    }
    rtcReleaseDevice(other);
    struct primitive_ref *refs = test_refs_make(REFS_CLOUD, COUNT, 2);
    assert_int_equal(run(embree, refs, COUNT, 3, &memory, &ir, &error), BVHD_OK);
    ir_finish(&ir);
    free(refs);
    embree_destroy(embree);
    assert_int_equal(memory.live, 0);
}

static void failing_allocations_leave_nothing(void **state)
{
    (void)state;
    struct embree *embree = make();
    struct memory memory;
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = BVHD_NO_MEMORY;
    for (int64_t n = 0; status != BVHD_OK; n++) {
        struct primitive_ref *refs = test_refs_make(REFS_CLOUD, 100, 1);
        struct ir ir;
        memory.fail_after = n;
        status = run(embree, refs, 100, 3, &memory, &ir, NULL);
        assert_true(n < 3 ? status == BVHD_NO_MEMORY : status == BVHD_OK);
        if (status == BVHD_OK)
            ir_finish(&ir);
        assert_int_equal(memory.live, 0);
        free(refs);
    }
    embree_destroy(embree);
    embree_destroy(NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_gives_a_sound_tree),
        cmocka_unit_test(builds_side_by_side_are_the_same),
        cmocka_unit_test(callbacks_from_elsewhere_are_refused),
        cmocka_unit_test(failing_allocations_leave_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
