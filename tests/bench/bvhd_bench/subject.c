/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/subject.h"

#include <stdio.h>
#include <string.h>

#include "tests/bench/bvhd_bench/embree_tree.h"
#include "builder/format/lavapipe.h"
#include "tests/bench/ply_input.h"
#include "builder/input/prepare.h"
#include "builder/input/primitive.h"
#include "tests/bench/bvhd_bench/stopwatch.h"
#include "tests/bench/bvhd_bench/sweep.h"

bool bench_start(unsigned threads, struct bench *ret_bench)
{
    struct bvhd_error error;
    struct bench bench = {.threads = threads};
    if (workers_create(threads, &bench.workers, &error) != BVHD_OK) {
        fprintf(stderr, "bvhd-bench: %s\n", error.text);
        return false;
    }
    bench.parallel = workers_parallel(bench.workers);
    memory_init(&bench.memory, UINT64_MAX);
    *ret_bench = bench;
    return true;
}

void bench_stop(struct bench *bench)
{
    workers_destroy(bench->workers);
}

static struct build_context context_of(struct bench *bench)
{
    return (struct build_context){.memory = &bench->memory, .parallel = bench->parallel};
}

static bool refused(struct subject *subject, const char *what, const struct bvhd_error *error)
{
    snprintf(subject->failure, sizeof subject->failure, "%s: %s: %s", what, error->where, error->text);
    return false;
}

static bool open_blob(struct subject *subject, struct bvhd_error *error)
{
    const struct bytes bytes = {subject->blob, subject->bytes};
    enum bvhd_status status = subject->method->target == TARGET_LAVAPIPE
                                  ? lavapipe_open_any(bytes, subject->memory, &subject->lavapipe, error)
                                  : portable_open(bytes, subject->memory, &subject->portable, error);
    return status == BVHD_OK || refused(subject, "open", error);
}

static bool look_at_tree(const struct canonical *canonical, const struct build_options *options,
                         const struct build_context *context, struct subject *subject, struct bvhd_error *error)
{
    struct ir ir;
    struct build_stats stats;
    if (build_ir(canonical, options, context, &ir, &stats, error) != BVHD_OK)
        return refused(subject, "build_ir", error);
    subject->tree = tree_from_ir(&ir);
    ir_finish(&ir);
    return true;
}

/* Builds from the canonical copy. */
static bool build_own_from(struct bench *bench, const struct canonical *canonical, const struct build_options *options,
                           struct subject_wants wants, struct subject *subject)
{
    struct bvhd_error error;
    struct build_context context = context_of(bench);
    double begin = stopwatch_ms(bench->threads);
    if (build(canonical, options, &context, &subject->blob, &subject->stats, &error) != BVHD_OK)
        return refused(subject, "build", &error);
    subject->ms = stopwatch_ms(bench->threads) - begin;
    subject->bytes = subject->stats.sizes.total;
    subject->peak_bytes = bench->memory.peak;
    if (wants.tree && !look_at_tree(canonical, options, &context, subject, &error))
        return false;
    if (wants.tracer)
        return open_blob(subject, &error);
    memory_free(subject->memory, subject->blob);
    subject->blob = NULL;
    return true;
}

static bool build_own(struct bench *bench, const struct ply *mesh, struct subject_wants wants, struct subject *subject)
{
    struct bvhd_error error;
    struct geometry geometry;
    struct canonical canonical;
    struct limits limits = limits_default();
    struct build_context context = context_of(bench);
    struct build_input input = ply_input(mesh, subject->method->quality, &geometry);
    input.options.builder = subject->method->builder;
    input.options.target = subject->method->target;
    input.options.layout_flags = subject->method->layout_flags;
    input.options.rays_per_primitive = subject->method->rays_per_primitive;
    if (input.options.target == TARGET_LAVAPIPE)
        input.options.device.variant = 1;
    uint64_t live = bench->memory.live;
    bench->memory.peak = live;
    double begin = stopwatch_ms(bench->threads);
    if (prepare(&input, 0, &limits, &context, &canonical, &error) != BVHD_OK)
        return refused(subject, "prepare", &error);
    subject->prepare_ms = stopwatch_ms(bench->threads) - begin;
    bool is_built = build_own_from(bench, &canonical, &input.options, wants, subject);
    subject->peak_bytes -= is_built ? live : 0;
    /* Gathered after the build, so that auto pays for reading the primitives from cold caches itself. */
    facts_gather(&canonical, &subject->facts);
    prepare_finish(&canonical, &bench->memory);
    return is_built;
}

static bool build_scene(struct bench *bench, const struct ply *mesh, struct subject_wants wants,
                        struct subject *subject)
{
    subject->scene = embree_scene_build(subject->method, mesh, bench->threads);
    if (!subject->scene) {
        snprintf(subject->failure, sizeof subject->failure, "rtcCommitScene failed");
        return false;
    }
    subject->ms = embree_scene_ms(subject->scene);
    subject->bytes = embree_scene_bytes(subject->scene);
    if (subject->method->compact)
        subject->bytes += (uint64_t)12 * mesh->vertex_count + (uint64_t)12 * mesh->triangle_count;
    if (!wants.tracer) {
        embree_scene_destroy(subject->scene);
        subject->scene = NULL;
    }
    return true;
}

static bool build_bvh(struct bench *bench, const struct ply *mesh, const struct primitive_refs *refs,
                      struct subject_wants wants, struct subject *subject)
{
    struct embree_tree_result result;
    const struct embree_tree_request request = {
        .method = subject->method, .mesh = mesh, .refs = refs, .threads = bench->threads, .want_tree = wants.tree};
    const char *failure = embree_tree_build(&request, &result);
    if (failure) {
        snprintf(subject->failure, sizeof subject->failure, "rtcBuildBVH: %s", failure);
        return false;
    }
    subject->ms = bench->threads == 1 ? result.cpu_ms : result.ms;
    subject->bytes = result.bytes;
    subject->tree = result.tree;
    return true;
}

static void build_sweep(const struct bench *bench, const struct primitive_refs *refs, struct subject_wants wants,
                        struct subject *subject)
{
    double begin = stopwatch_ms(bench->threads);
    subject->tree = sweep_build(refs->refs, refs->count);
    subject->ms = stopwatch_ms(bench->threads) - begin;
    if (!wants.tree)
        tree_finish(&subject->tree);
}

/* Builds with Embree's builder or the sweep; both start from the same refs, made by the first stage of our builder. */
static bool build_tree(struct bench *bench, const struct ply *mesh, struct subject_wants wants, struct subject *subject)
{
    struct bvhd_error error;
    struct geometry geometry;
    struct canonical canonical;
    struct primitive_refs refs;
    bool is_built = true;
    struct limits limits = limits_default();
    struct build_context context = context_of(bench);
    struct build_input input = ply_input(mesh, QUALITY_BALANCED, &geometry);
    if (prepare(&input, 0, &limits, &context, &canonical, &error) != BVHD_OK)
        return refused(subject, "prepare", &error);
    if (primitive_collect_blocks(&canonical, NULL, &context, &refs, &error) != BVHD_OK ||
        !primitive_close_gaps(&refs, &context)) {
        prepare_finish(&canonical, &bench->memory);
        return refused(subject, "boxes", &error);
    }
    if (subject->method->kind == METHOD_BVH)
        is_built = build_bvh(bench, mesh, &refs, wants, subject);
    else
        build_sweep(bench, &refs, wants, subject);
    memory_free(&bench->memory, refs.refs);
    prepare_finish(&canonical, &bench->memory);
    return is_built;
}

bool subject_build(struct bench *bench, const struct method *method, const struct ply *mesh, struct subject_wants wants,
                   struct subject *ret_subject)
{
    *ret_subject = (struct subject){.method = method, .memory = &bench->memory};
    if (method->kind == METHOD_OWN)
        return build_own(bench, mesh, wants, ret_subject);
    if (method->kind == METHOD_SCENE)
        return build_scene(bench, mesh, wants, ret_subject);
    return build_tree(bench, mesh, wants, ret_subject);
}

void subject_finish(struct subject *subject)
{
    if (!subject)
        return;
    memory_free(subject->memory, subject->blob);
    embree_scene_destroy(subject->scene);
    tree_finish(&subject->tree);
    subject->blob = NULL;
    subject->scene = NULL;
}

bool subject_trace(const struct subject *subject, const struct ray *ray, struct ray_hit *ret_hit,
                   struct traverse_counters *counters)
{
    if (subject->scene)
        return embree_scene_trace(subject->scene, ray, ret_hit);
    if (subject->method->target == TARGET_LAVAPIPE) {
        const struct lavapipe_view *views[] = {&subject->lavapipe};
        const struct lavapipe_scene scene = {.bottoms = views, .bottom_count = 1};
        return lavapipe_traverse(&scene, ray, NULL, ret_hit, counters);
    }
    const struct portable_view *views[] = {&subject->portable};
    const struct scene scene = {.bottoms = views, .bottom_count = 1};
    return traverse(&scene, ray, NULL, ret_hit, counters);
}
