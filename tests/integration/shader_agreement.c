/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shader_agreement.c - tests ray queries of the shaders over random structures and instances.
 *
 *     shader_agreement [--device NAME] [--kinds flat|round|motion|all] [COUNT [SEED]]
 *
 * It covers every combination of ray flags, masks, opacities and facings; AABBs; candidates that are accepted, ignored,
 * accepted in part, or that end the query; through a storage buffer and through addresses. Each ray is compared with
 * the CPU traversal, and where they differ, with references. Structures are of triangles and AABBs (flat), of spheres
 * and linear swept spheres (round), or of all of them; without --kinds they are flat, and the shader is the one that
 * knows no others. That shader must find nothing in structures of round kinds, nor in those that move. With `motion`
 * some structures are of motion triangles and most top levels of motion instances, and rays have times.
 *
 * The exit status is 1 when something is wrong, and 77 without a device.
 */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/update/batch.h"
#include "tests/support/builder/builders.h"
#include "tests/support/builder/random_top.h"
#include "client/bvhctl/oracle/rays.h"
#include "tests/support/shader/shader_candidates.h"

enum { RAYS = 256, CASES = 4, MOST_PRIMITIVES = 2000, MOST_BELOW_TOP = 300 };

struct run {
    struct memory memory;
    struct shader_bed *beds[2];
    struct shader_bed *flat; /* knows neither round kinds nor motion; NULL where the others do not either */
    struct shader_bed *motion; /* knows motion, but no round kinds; NULL where nothing moves */
    struct shader_full_answer *answers;
    uint64_t seed, scenes, defects;
    enum random_choice kinds;
    struct shader_tally tally;
    struct shader_candidate_tally candidates;
};

/* ---- rays ---- */

/*
 * A random combination of flags that Vulkan allows: at most one of the four about opacity, and at most one of culling
 * back faces, culling front faces and skipping triangles.
 */
static struct shader_case random_case(struct random *random)
{
    static const uint32_t opacities[] = {0, 0, RAY_OPAQUE, RAY_NO_OPAQUE, RAY_CULL_OPAQUE, RAY_CULL_NO_OPAQUE};
    static const uint32_t triangles[] = {0, 0, 0, RAY_CULL_BACK_FACING, RAY_CULL_FRONT_FACING, RAY_SKIP_TRIANGLES};
    static const enum shader_policy policies[] = {SHADER_ACCEPT, SHADER_SOME, SHADER_IGNORE, SHADER_IGNORE, SHADER_END};
    struct shader_case shared = {.cull_mask = random_chance(random, 0.6) ? 0xff : (uint8_t)random_below(random, 256),
                                 .policy = policies[random_below(random, 5)]};
    shared.flags = opacities[random_below(random, 6)] | triangles[random_below(random, 6)];
    shared.flags |= random_chance(random, 0.1) ? RAY_TERMINATE_ON_FIRST_HIT : 0;
    shared.flags |= random_chance(random, 0.1) && !(shared.flags & RAY_SKIP_TRIANGLES) ? RAY_SKIP_AABBS : 0;
    /* Candidates can be compared one by one only where nothing is committed. */
    if (shared.policy == SHADER_IGNORE && !(shared.flags & (RAY_NO_OPAQUE | RAY_CULL_OPAQUE)))
        shared.flags = (shared.flags & ~(uint32_t)(RAY_OPAQUE | RAY_CULL_NO_OPAQUE)) | RAY_NO_OPAQUE;
    return shared;
}

/*
 * Aims exactly at a corner of a random triangle, where a traversal that is not watertight leaks; at a centre, or at a
 * point that lies on the outline of the sphere around it along an axis.
 */
static void aim_at_corner(const struct shader_meshes *meshes, struct random *random, struct ray *ray)
{
    const struct oracle_mesh *mesh = &meshes->meshes[random_below(random, meshes->count)];
    if (!mesh->primitive_count || mesh->transform)
        return;
    const uint32_t vertex = random_below(random, shader_meshes_vertices(mesh->shape) * mesh->primitive_count);
    float corner[3];
    memcpy(corner, mesh->positions + (uint64_t)3 * vertex, sizeof corner);
    if (mesh->shape != ORACLE_TRIANGLES && random_chance(random, 0.7))
        corner[random_below(random, 3)] += random_chance(random, 0.5) ? mesh->radii[vertex] : -mesh->radii[vertex];
    for (int axis = 0; axis < 3; axis++)
        if (!isfinite(corner[axis] - ray->origin[axis]))
            return;
    for (int axis = 0; axis < 3; axis++)
        ray->direction[axis] = corner[axis] - ray->origin[axis];
}

static void align_with_axis(struct random *random, struct ray *ray)
{
    int axis = (int)random_below(random, 3);
    for (int i = 0; i < 3; i++)
        ray->direction[i] = i != axis ? 0 : random_chance(random, 0.5) ? 1 : -1.0f;
}

/* Both ends, the middle, where quaternions may be 0, and others. */
static float random_time(struct random *random)
{
    static const float times[] = {0, 1, 0.5F, 0.25F};
    return random_chance(random, 0.4) ? times[random_below(random, 4)] : (float)random_between(random, 0, 1);
}

static void make_rays(const struct shader_meshes *aims, const struct shader_case *shared, float time,
                      struct random *random, struct ray *rays)
{
    rays_make(aims->meshes, aims->count, random_next(random), RAYS, rays);
    for (uint32_t i = 0; i < RAYS; i++) {
        rays[i].flags = shared->flags;
        rays[i].cull_mask = shared->cull_mask;
        rays[i].time = time;
        if (i % 4 == 1 && aims->count)
            aim_at_corner(aims, random, &rays[i]);
        if (i % 16 == 3)
            align_with_axis(random, &rays[i]);
        if (i % 16 == 7) {
            rays[i].tmin = (float)random_between(random, 0, 1);
            rays[i].tmax = rays[i].tmin + (float)random_between(random, 0, 2);
        }
        if (i % 64 == 11)
            rays[i].tmax = INFINITY;
        if (i % 64 == 43)
            memset(rays[i].direction, 0, sizeof rays[i].direction);
    }
}

/* ---- scenes ---- */

static bool is_in_range(const float *values, int count)
{
    float largest = 0;
    for (int i = 0; i < count; i++) {
        if (fabsf(values[i]) > 0x1p60f)
            return false;
        largest = fmaxf(largest, fabsf(values[i]));
    }
    return largest == 0 || largest >= 0x1p-60f;
}

/*
 * Shaders guarantee nothing about other magnitudes, nor about a small primitive in a large structure. NaNs, which
 * belong to inactive primitives, are ignored.
 */
static bool is_promised(const struct scene *scene, const struct shader_meshes *aims)
{
    for (uint32_t i = 0; i < scene->bottom_count; i++)
        if (scene->bottoms[i]->header->node_count && !is_in_range(scene->bottoms[i]->header->bounds, 6))
            return false;
    for (uint32_t i = 0; i < aims->count; i++) {
        const uint32_t vertices = shader_meshes_vertices(aims->meshes[i].shape);
        for (uint64_t k = 0; k < aims->meshes[i].primitive_count; k++)
            if (!is_in_range(aims->meshes[i].positions + 3 * vertices * k, 3 * (int)vertices) ||
                !is_in_range(aims->meshes[i].radii + vertices * k, (int)vertices))
                return false;
    }
    return !scene->top || !scene->top->header->node_count || is_in_range(scene->top->header->bounds, 6);
}

static void trace_case(struct run *run, struct shader_bed *bed, const struct scene *scene,
                       const struct shader_case *shared, const struct ray *rays)
{
    char what[100];
    struct shader_answer answers[RAYS];
    snprintf(what, sizeof what, "shader_agreement --kinds %s 1 %llu (flags %x, policy %d)",
             random_choice_name(run->kinds), (unsigned long long)run->seed, shared->flags, shared->policy);
    shader_bed_trace(bed, rays, RAYS, shared->policy, answers);
    shader_judge(what, scene, shared, rays, RAYS, answers, &parallel_serial, &run->memory, &run->tally);
    shader_bed_trace_fully(bed, rays, RAYS, shared->policy, run->answers);
    if (shared->policy == SHADER_IGNORE)
        shader_candidates_judge(what, scene, rays, RAYS, run->answers, &run->memory, &run->candidates);
    if (shared->policy == SHADER_ACCEPT)
        run->defects += shader_details_judge(what, scene, rays, RAYS, run->answers);
}

/* Counts all that a shader finds there as defects. */
static void expect_nothing(struct run *run, struct shader_bed *bed, const struct ray *rays)
{
    struct shader_answer answers[RAYS];
    shader_bed_trace(bed, rays, RAYS, SHADER_ACCEPT, answers);
    for (uint32_t i = 0; i < RAYS; i++)
        run->defects += answers[i].type != 0 || answers[i].candidate_count != 0;
}

static bool has_content(const struct scene *scene, uint32_t first, uint32_t last)
{
    for (uint32_t i = 0; i < scene->bottom_count; i++)
        if (scene->bottoms[i] && scene->bottoms[i]->header->content >= first &&
            scene->bottoms[i]->header->content <= last)
            return true;
    return false;
}

static bool has_moving_top(const struct scene *scene)
{
    return scene->top && scene->top->header->content == PORTABLE_MOVING_INSTANCES;
}

/* The shader that knows neither round kinds nor motion must find nothing, if the scene has nothing else. */
static void trace_flat(struct run *run, const struct scene *scene, const struct ray *rays)
{
    if (has_content(scene, PORTABLE_INDEXED_TRIANGLES, PORTABLE_INSTANCES) && !has_moving_top(scene))
        return;
    shader_bed_load(run->flat, scene);
    expect_nothing(run, run->flat, rays);
}

/* What moves is nowhere at times that are not between 0 and 1. */
static void trace_beyond(struct run *run, struct shader_bed *bed, const struct scene *scene, struct ray *rays)
{
    static const float times[] = {-0x1p-20F, 1.0F + 0x1p-20F, NAN, INFINITY};
    if (has_content(scene, PORTABLE_INDEXED_TRIANGLES, PORTABLE_SWEPT_SPHERES) && !has_moving_top(scene))
        return;
    for (uint32_t i = 0; i < RAYS; i++)
        rays[i].time = times[i % 4];
    expect_nothing(run, bed, rays);
}

static struct shader_bed *choose_bed(const struct run *run, const struct scene *scene)
{
    if (run->motion && run->seed % 4 < 2 && !has_content(scene, PORTABLE_SPHERES, PORTABLE_SWEPT_SPHERES))
        return run->motion;
    return run->beds[run->seed % 2 && run->beds[1] ? 1 : 0];
}

/* Traces a case at one time. Returns false when shaders guarantee nothing about the scene; rays are not made then. */
static bool trace_moment(struct run *run, struct shader_bed *bed, const struct scene *scene, float time,
                         struct random *random, struct ray *rays)
{
    struct shader_still still;
    struct shader_meshes aims;
    shader_still_make(scene, time, &still);
    shader_meshes_make(&still.scene, NULL, &aims);
    bool is_asked = is_promised(&still.scene, &aims);
    if (is_asked) {
        struct shader_case shared = random_case(random);
        make_rays(&aims, &shared, time, random, rays);
        trace_case(run, bed, scene, &shared, rays);
    }
    shader_meshes_finish(&aims);
    shader_still_finish(&still);
    return is_asked;
}

static void trace_scene(struct run *run, const struct scene *scene, struct random *random)
{
    struct ray rays[RAYS];
    struct shader_bed *bed = choose_bed(run, scene);
    bool moves = shader_still_moves(scene), is_asked = true;
    shader_bed_load(bed, scene);
    for (int i = 0; i < CASES && is_asked; i++)
        is_asked = trace_moment(run, bed, scene, moves ? random_time(random) : 0, random, rays);
    run->scenes += is_asked;
    if (is_asked && run->flat)
        trace_flat(run, scene, rays);
    if (is_asked && moves)
        trace_beyond(run, bed, scene, rays);
}

static void build_one(struct run *run, const struct build_input *input, struct batch_item *ret_item,
                      struct portable_view *ret_view)
{
    struct bvhd_error error = {0};
    struct limits limits = limits_default();
    struct build_context context = {.memory = &run->memory, .parallel = &parallel_serial};
    struct build_input told = *input;
    told.options.builder = builders_turn(run->seed / 2);
    if (batch_build(&told, 1, &limits, &context, ret_item, &error) != BVHD_OK || ret_item->status != BVHD_OK ||
        portable_open((struct bytes){ret_item->blob, ret_item->size}, &run->memory, ret_view, &error) != BVHD_OK) {
        fprintf(stderr, "shader_agreement --kinds %s 1 %llu: does not build: %s\n", random_choice_name(run->kinds),
                (unsigned long long)run->seed, ret_item->error.text[0] ? ret_item->error.text : error.text);
        exit(1);
    }
}

static void run_bottom(struct run *run, struct random *random)
{
    struct random_input bottom;
    struct batch_item item;
    struct portable_view view;
    const struct portable_view *bottoms[1] = {&view};
    struct scene scene = {.bottoms = bottoms, .bottom_count = 1};
    random_input_bottom_of(&bottom, random, MOST_PRIMITIVES, run->kinds);
    build_one(run, &bottom.input, &item, &view);
    trace_scene(run, &scene, random);
    batch_finish(&item, 1, &run->memory);
    random_input_finish(&bottom);
}

static void run_top(struct run *run, struct random *random)
{
    struct random_top top;
    struct batch_item items[RANDOM_TOP_BOTTOMS + 1];
    struct portable_view views[RANDOM_TOP_BOTTOMS + 1];
    const struct portable_view *bottoms[RANDOM_TOP_BOTTOMS];
    random_top_init_of(&top, random, MOST_BELOW_TOP, run->kinds);
    for (uint32_t i = 0; i < top.bottom_count; i++) {
        build_one(run, &top.bottoms[i].input, &items[i], &views[i]);
        top.references[i].key = items[i].key;
        top.references[i].bounds = items[i].summary.bounds;
        top.references[i].slabs = items[i].summary.slabs;
    }
    build_one(run, &top.input, &items[top.bottom_count], &views[top.bottom_count]);
    struct scene scene = {
        .top = &views[top.bottom_count], .bottoms = bottoms, .bottom_count = random_top_rows(&top, views, bottoms)};
    trace_scene(run, &scene, random);
    batch_finish(items, top.bottom_count + 1, &run->memory);
    random_top_finish(&top);
}

/* ---- the test ---- */

static bool open_beds(struct run *run, const char *device)
{
    struct bvhd_error error;
    struct shader_bed_options options = {.device = device,
                                         .is_round = run->kinds != RANDOM_FLAT,
                                         .moves = run->kinds == RANDOM_MOTION || run->kinds == RANDOM_ALL};
    if (shader_bed_create(&options, &run->memory, &run->beds[0], &error) != BVHD_OK) {
        fprintf(stderr, "shader_agreement: skipped: %s\n", error.text);
        return false;
    }
    options.by_address = options.plain_bytes = true;
    if (shader_bed_create(&options, &run->memory, &run->beds[1], &error) != BVHD_OK)
        fprintf(stderr, "shader_agreement: without addresses: %s\n", error.text);
    options.is_round = options.by_address = false;
    if (options.moves && shader_bed_create(&options, &run->memory, &run->motion, &error) != BVHD_OK)
        return false;
    options.moves = false;
    return run->kinds == RANDOM_FLAT || shader_bed_create(&options, &run->memory, &run->flat, &error) == BVHD_OK;
}

static void print_tally(const struct run *run)
{
    const struct shader_tally *tally = &run->tally;
    const struct shader_candidate_tally *candidates = &run->candidates;
    printf("%s: %llu scenes, %llu rays: %llu hits, %llu with other bits of t; %llu differ: %llu ties, %llu uncertain, "
           "%llu about boxes, %llu wrong\n",
           shader_bed_device(run->beds[0]), (unsigned long long)run->scenes, (unsigned long long)tally->rays,
           (unsigned long long)tally->hits, (unsigned long long)tally->other_bits, (unsigned long long)tally->differing,
           (unsigned long long)tally->right, (unsigned long long)tally->uncertain, (unsigned long long)tally->boxes,
           (unsigned long long)tally->certain);
    printf("candidates of %llu rays: %llu, %llu differ, %llu wrong; %llu wrong details\n",
           (unsigned long long)candidates->rays, (unsigned long long)candidates->candidates,
           (unsigned long long)candidates->differing, (unsigned long long)candidates->defects,
           (unsigned long long)run->defects);
}

static bool parse_option(struct run *run, const char *name, const char *value, const char **ret_device)
{
    if (strcmp(name, "--kinds") == 0)
        return random_choice_from_name(value, &run->kinds);
    *ret_device = value;
    return strcmp(name, "--device") == 0;
}

int main(int argc, char **argv)
{
    struct run run = {.seed = 0};
    const char *device = "auto";
    int next = 1;
    for (; next + 1 < argc && argv[next][0] == '-'; next += 2)
        if (!parse_option(&run, argv[next], argv[next + 1], &device)) {
            fprintf(stderr, "usage: shader_agreement [--device NAME] [--kinds flat|round|motion|all] [COUNT [SEED]]\n");
            return 2;
        }
    uint64_t count = argc > next ? strtoull(argv[next], NULL, 10) : 60,
             seed = argc > next + 1 ? strtoull(argv[next + 1], NULL, 10) : 1;
    memory_init(&run.memory, UINT64_C(1) << 32);
    run.answers = calloc(RAYS, sizeof *run.answers);
    if (!run.answers)
        return 1;
    if (!open_beds(&run, device)) {
        free(run.answers);
        return 77;
    }
    for (run.seed = seed; run.seed < seed + count; run.seed++) {
        struct random random = {run.seed * UINT64_C(0x632be59bd9b4e019)};
        (run.seed % 3 ? run_top : run_bottom)(&run, &random);
    }
    print_tally(&run);
    /* A run with too few hits or candidates shows nothing. */
    bool thin =
        count >= 30 && (run.tally.hits < run.tally.rays / 10 || run.candidates.candidates < run.candidates.rays / 10);
    bool is_wrong =
        run.tally.certain || run.candidates.defects || run.defects || run.tally.boxes * 200 > run.tally.rays;
    shader_bed_destroy(run.beds[0]);
    shader_bed_destroy(run.beds[1]);
    shader_bed_destroy(run.flat);
    shader_bed_destroy(run.motion);
    free(run.answers);
    if (thin)
        fprintf(stderr, "shader_agreement: too few of these rays decide anything\n");
    return is_wrong || thin || gpu_messages();
}
