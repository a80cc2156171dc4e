/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_updates.c - tests updates of random structures, in every layout.
 *
 *     random_updates [--kinds flat|round|motion|all] [COUNT [SEED]]
 *
 * The structures are of triangles and boxes (flat, which they are without --kinds), of spheres and linear swept spheres
 * (round), of what moves (motion), or of all of them. Each structure is built, moved and updated a few times. Then rays
 * through it are compared with brute force over what the request means now, and with rays through a structure that is
 * built for it: both must give the same hits.
 *
 * It prints each failure with the arguments that repeat it. The exit status is 1 if there was any.
 */
#include <float.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "builder/update/batch.h"
#include "builder/traverse/lavapipe_traverse.h"
#include "client/bvhctl/oracle/rays.h"
#include "tests/support/builder/box_judge.h"
#include "tests/support/builder/random_kind.h"
#include "tests/support/builder/random_top.h"
#include "tests/support/builder/random_update.h"

enum { RAYS = 40, MOST_PRIMITIVES = 1500, MOST_BELOW_TOP = 100, MOST_UPDATES = 3, FAILURES_SHOWN = 20 };

struct run {
    struct memory memory;
    struct build_context context;
    struct limits limits;
    enum random_choice kinds;
    uint64_t seed, failures, cases, updates, changed, rays, hits, boxes;
};

static void fail(struct run *run, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void fail(struct run *run, const char *format, ...)
{
    if (run->failures++ >= FAILURES_SHOWN)
        return;
    va_list arguments;
    va_start(arguments, format);
    fprintf(stderr, "random_updates --kinds %s 1 %llu: ", random_choice_name(run->kinds),
            (unsigned long long)run->seed);
    vfprintf(stderr, format, arguments);
    fprintf(stderr, "\n");
    va_end(arguments);
}

/* One structure of either layout, opened; `views` is of the layout that it has. */
struct structure {
    struct batch_item item;
    bool is_native;
    struct portable_view view;
    struct lavapipe_view native;
};

static bool build_structure(struct run *run, const struct build_input *input, struct structure *ret)
{
    struct bvhd_error error;
    *ret = (struct structure){.is_native = input->options.target == TARGET_LAVAPIPE};
    if (batch_build(input, 1, &run->limits, &run->context, &ret->item, &error) != BVHD_OK)
        ret->item = (struct batch_item){.status = BVHD_NO_MEMORY, .error = error};
    if (ret->item.status != BVHD_OK)
        fail(run, "build: %s: %s", ret->item.error.where, ret->item.error.text);
    return ret->item.status == BVHD_OK;
}

static bool open_structure(struct run *run, struct structure *structure)
{
    const struct bytes blob = {structure->item.blob, structure->item.size};
    struct bvhd_error error;
    enum bvhd_status status = structure->is_native ? lavapipe_open_any(blob, &run->memory, &structure->native, &error)
                                                   : portable_open(blob, &run->memory, &structure->view, &error);
    if (status != BVHD_OK)
        fail(run, "it does not open: %s: %s", error.where, error.text);
    return status == BVHD_OK;
}

/* Returns false if the last move cannot be an update: it has changed which primitives are active. */
static bool update_structure(struct run *run, const struct build_input *input, void (*move)(void *, struct random *),
                             void *request, struct random *random, struct structure *structure)
{
    const struct random_update update = {input, move, request, MOST_UPDATES, &run->context};
    struct bvhd_error error;
    enum bvhd_status status = random_update_run(&update, random, &structure->item, &run->updates, &error);
    bool is_changed = status == BVHD_INVALID && (error.vuid == BVHD_VUID_03663 || error.vuid == BVHD_VUID_03664);
    if (status != BVHD_OK && !is_changed)
        fail(run, "update: %s %s at %s: %s", bvhd_status_name(status), bvhd_vuid_string(error.vuid), error.where,
             error.text);
    run->changed += is_changed;
    return status == BVHD_OK;
}

/* ---- rays ---- */

/* A scene of one bottom level, or of a top level over several, in either layout. */
struct traced {
    bool is_native;
    struct scene scene;
    struct lavapipe_scene native;
};

static bool trace(const struct traced *traced, const struct ray *ray, const struct traverse_options *options,
                  struct ray_hit *ret_hit)
{
    return traced->is_native ? lavapipe_traverse(&traced->native, ray, options, ret_hit, NULL)
                             : traverse(&traced->scene, ray, options, ret_hit, NULL);
}

static bool hits_equal(const struct ray_hit *a, const struct ray_hit *b)
{
    return a->t == b->t && a->u == b->u && a->v == b->v && a->instance == b->instance && a->geometry == b->geometry &&
           a->primitive == b->primitive && a->front_face == b->front_face;
}

static void judge_ray(struct run *run, const struct traced *updated, const struct traced *built, const struct ray *ray,
                      const struct oracle_answer *answer)
{
    struct ray_hit hit = {0}, other = {0};
    bool is_hit = trace(updated, ray, NULL, &hit), is_other = trace(built, ray, NULL, &other);
    enum oracle_verdict verdict = oracle_judge(answer, is_hit ? &hit : NULL, NULL);
    run->rays++;
    run->hits += is_hit;
    if (box_judge_is_beyond_floats(ray, answer->t_end))
        return;
    if (verdict > ORACLE_UNDECIDED)
        fail(run, "verdict %d: t %.9g instead of %.9g, primitive %u.%u.%u", (int)verdict, (double)hit.t, answer->t,
             hit.instance, hit.geometry, hit.primitive);
    if (is_hit != is_other || (is_hit && !hits_equal(&hit, &other)))
        fail(run, "hit %d at %.9g, but %d at %.9g in a build", is_hit, (double)hit.t, is_other, (double)other.t);
}

static void judge_rays(struct run *run, const struct traced *updated, const struct traced *built,
                       const struct oracle_mesh *meshes, uint32_t mesh_count, struct random *random, bool culls)
{
    struct ray rays[RAYS];
    struct oracle_answer answers[RAYS];
    struct bvhd_error error;
    rays_make(meshes, mesh_count, random_next(random), RAYS, rays);
    for (uint32_t i = 0; i < RAYS; i++) {
        rays[i].cull_mask = 0xff;
        rays[i].flags = RAY_SKIP_AABBS | (culls && i % 5 == 0 ? RAY_CULL_BACK_FACING : 0);
    }
    if (oracle_trace(meshes, mesh_count, rays, RAYS, &run->memory, &parallel_serial, NULL, NULL, answers, &error) !=
        BVHD_OK) {
        fail(run, "oracle: %s", error.text);
        return;
    }
    for (uint32_t i = 0; i < RAYS; i++)
        judge_ray(run, updated, built, &rays[i], &answers[i]);
    oracle_finish(answers, RAYS, &run->memory);
}

/* ---- boxes ---- */

struct found {
    uint8_t *seen; /* indexed by geometry and primitive, numbered through all geometries */
    const uint32_t *first;
};

static enum candidate_verdict note_candidate(void *context, const struct ray *ray, const struct candidate_space *space,
                                             struct ray_hit *hit)
{
    struct found *found = context;
    (void)ray;
    (void)space;
    found->seen[found->first[hit->geometry] + hit->primitive]++;
    return CANDIDATE_IGNORE;
}

/* Makes a ray near a box, or anywhere. */
static struct ray ray_at_boxes(const struct random_input *bottom, struct random *random)
{
    const struct random_meaning *meaning = &bottom->meanings[random_below(random, bottom->input.geometry_count)];
    struct ray ray = {.tmax = FLT_MAX, .cull_mask = 0xff, .flags = RAY_SKIP_TRIANGLES};
    for (int axis = 0; axis < 3; axis++) {
        ray.origin[axis] = (float)random_between(random, -3, 3);
        ray.direction[axis] = (float)random_between(random, -1, 1);
        const float *box = meaning->count > 0 ? meaning->boxes[random_below(random, meaning->count)] : NULL;
        if (box && isfinite(box[axis]) && fabsf(box[axis]) < 1e30f)
            ray.direction[axis] = box[axis] - ray.origin[axis];
    }
    return ray;
}

static void judge_boxes(struct run *run, const struct traced *updated, const struct random_input *bottom,
                        struct random *random)
{
    uint32_t first[RANDOM_INPUT_GEOMETRIES + 1] = {0};
    for (uint32_t g = 0; g < bottom->input.geometry_count; g++)
        first[g + 1] = first[g] + bottom->meanings[g].count;
    struct found found = {calloc(first[bottom->input.geometry_count] + 1, 1), first};
    for (uint32_t k = 0; k < RAYS; k++) {
        const struct traverse_options options = {.candidate = note_candidate, .context = &found};
        const struct ray ray = ray_at_boxes(bottom, random);
        struct ray_hit hit;
        struct box_judge judge;
        memset(found.seen, 0, first[bottom->input.geometry_count]);
        trace(updated, &ray, &options, &hit);
        box_judge_init(&judge, &ray, NULL);
        for (uint32_t g = 0; g < bottom->input.geometry_count; g++)
            for (uint32_t i = 0; i < bottom->meanings[g].count; i++, run->boxes++) {
                const char *wrong = box_judge_find(&judge, bottom->meanings[g].boxes[i], found.seen[first[g] + i]);
                if (wrong)
                    fail(run, "box %u.%u is %s", g, i, wrong);
            }
    }
    free(found.seen);
}

/* ---- cases ---- */

/* Chooses a layout. The native one has triangles and boxes only. */
static void set_target(struct build_input *input, bool can_be_native, struct random *random)
{
    input->flags |= BUILD_ALLOW_UPDATE;
    if (random_chance(random, 0.5) || !can_be_native)
        return;
    input->options.target = TARGET_LAVAPIPE;
    input->options.layout_flags = 0;
    input->options.device = (struct device_format){.variant = 1 + random_below(random, LAVAPIPE_VARIANTS)};
}

static void compare_bottoms(struct run *run, const struct random_input *bottom, const struct structure *updated,
                            const struct structure *built, struct random *random)
{
    const struct portable_view *views[2] = {&updated->view, &built->view};
    const struct lavapipe_view *natives[2] = {&updated->native, &built->native};
    struct traced traced[2];
    struct oracle_mesh meshes[RANDOM_INPUT_GEOMETRIES] = {0};
    const uint32_t count = bottom->input.geometry_count;
    for (int i = 0; i < 2; i++)
        traced[i] = (struct traced){.is_native = updated->is_native,
                                    .scene = {.bottoms = &views[i], .bottom_count = 1},
                                    .native = {.bottoms = &natives[i], .bottom_count = 1}};
    if (count > 0 && bottom->kind->are_candidates) {
        judge_boxes(run, &traced[0], bottom, random);
        return;
    }
    for (uint32_t g = 0; g < count; g++)
        meshes[g] = random_input_mesh(bottom, g);
    judge_rays(run, &traced[0], &traced[1], meshes, count, random, true);
}

static void run_bottom(struct run *run, struct random *random)
{
    struct random_input bottom;
    struct structure updated, built = {0};
    random_input_bottom_of(&bottom, random, MOST_PRIMITIVES, run->kinds);
    const bool is_flat = bottom.kind->shape == ORACLE_TRIANGLES && !random_input_moves(&bottom);
    set_target(&bottom.input, is_flat || !bottom.input.geometry_count, random);
    if (build_structure(run, &bottom.input, &updated) &&
        update_structure(run, &bottom.input, random_input_move, &bottom, random, &updated) &&
        build_structure(run, &bottom.input, &built) && open_structure(run, &updated) && open_structure(run, &built))
        compare_bottoms(run, &bottom, &updated, &built, random);
    batch_finish(&updated.item, 1, &run->memory);
    batch_finish(&built.item, 1, &run->memory);
    random_input_finish(&bottom);
}

/* A random top level, and what was built of it: twice at the end, updated and anew. */
struct world {
    struct random_top top;
    struct structure bottoms[RANDOM_TOP_BOTTOMS], tops[2];
};

static bool build_world(struct run *run, struct world *world, struct random *random)
{
    struct random_top *top = &world->top;
    for (uint32_t i = 0; i < top->bottom_count; i++) {
        struct structure *bottom = &world->bottoms[i];
        top->bottoms[i].input.flags |= BUILD_ALLOW_UPDATE;
        if (!build_structure(run, &top->bottoms[i].input, bottom) ||
            !update_structure(run, &top->bottoms[i].input, random_input_move, &top->bottoms[i], random, bottom) ||
            !open_structure(run, bottom))
            return false;
        top->references[i].key = bottom->item.key;
        top->references[i].bounds = bottom->item.summary.bounds;
        top->references[i].slabs = bottom->item.summary.slabs;
    }
    top->input.flags |= BUILD_ALLOW_UPDATE;
    return build_structure(run, &top->input, &world->tops[0]) &&
           update_structure(run, &top->input, random_top_move, top, random, &world->tops[0]) &&
           build_structure(run, &top->input, &world->tops[1]) && open_structure(run, &world->tops[0]) &&
           open_structure(run, &world->tops[1]);
}

static void compare_tops(struct run *run, struct world *world, struct random *random)
{
    struct portable_view views[RANDOM_TOP_BOTTOMS];
    const struct portable_view *bottoms[RANDOM_TOP_BOTTOMS];
    struct traced traced[2];
    for (uint32_t i = 0; i < world->top.bottom_count; i++)
        views[i] = world->bottoms[i].view;
    const uint32_t count = random_top_rows(&world->top, views, bottoms);
    for (int i = 0; i < 2; i++) {
        traced[i] = (struct traced){.scene = {.top = &world->tops[i].view, .bottoms = bottoms, .bottom_count = count}};
        if (world->tops[i].view.handle_count != count)
            fail(run, "%llu handles for %u structures", (unsigned long long)world->tops[i].view.handle_count, count);
    }
    random_top_mean(&world->top, 0xff);
    if (world->tops[0].view.handle_count == count)
        judge_rays(run, &traced[0], &traced[1], world->top.meshes, world->top.mesh_count, random,
                   !world->top.culling_disabled);
}

static void run_top(struct run *run, struct random *random)
{
    struct world *world = calloc(1, sizeof *world);
    random_top_init_of(&world->top, random, MOST_BELOW_TOP, run->kinds);
    if (build_world(run, world, random))
        compare_tops(run, world, random);
    for (int i = 0; i < RANDOM_TOP_BOTTOMS; i++)
        batch_finish(&world->bottoms[i].item, 1, &run->memory);
    for (int i = 0; i < 2; i++)
        batch_finish(&world->tops[i].item, 1, &run->memory);
    random_top_finish(&world->top);
    free(world);
}

int main(int argc, char **argv)
{
    struct run run = {.limits = limits_default()};
    if (argc > 2 && strcmp(argv[1], "--kinds") == 0) {
        if (!random_choice_from_name(argv[2], &run.kinds))
            return 2;
        argc -= 2;
        argv += 2;
    }
    const uint64_t count = argc > 1 ? strtoull(argv[1], NULL, 10) : 400,
                   seed = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
    memory_init(&run.memory, UINT64_C(1) << 30);
    run.context = (struct build_context){.memory = &run.memory, .parallel = &parallel_serial};
    for (run.seed = seed; run.seed < seed + count; run.seed++) {
        struct random random = {run.seed * UINT64_C(0x632be59bd9b4e019)};
        run.cases++;
        (run.seed % 4 ? run_bottom : run_top)(&run, &random);
        if (run.memory.live)
            fail(&run, "%llu bytes are left", (unsigned long long)run.memory.live);
    }
    printf("%llu cases, %llu updates, %llu moves that were none; %llu rays: %llu hits; %llu boxes; %llu wrong\n",
           (unsigned long long)run.cases, (unsigned long long)run.updates, (unsigned long long)run.changed,
           (unsigned long long)run.rays, (unsigned long long)run.hits, (unsigned long long)run.boxes,
           (unsigned long long)run.failures);
    /* A run with too few updates or hits shows nothing. */
    bool thin = count >= 100 && (run.updates < count / 2 || run.hits < run.rays / 5 ||
                                 (run.kinds == RANDOM_FLAT && run.boxes < 100 * count));
    if (thin)
        fprintf(stderr, "random_updates: too few of these cases decide anything\n");
    return run.failures || thin;
}
