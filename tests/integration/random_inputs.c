/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_inputs.c - tests the whole pipeline with random requests.
 *
 *     random_inputs [--builder own|embree] [--quality fast|balanced|high] [COUNT [SEED]]
 *
 * Without --quality each request has a random one. Where there is no Embree, --builder embree does nothing.
 *
 * 200 rays through the result of each correct request are compared with brute force over the request, decoded by the
 * test's own code; each result passes the check of its layout and is no larger than the query of sizes says, and a part
 * is built in the native layout, too. As many requests again have something broken, and each of these must give a
 * status.
 *
 * It prints each failure with the arguments that repeat it. The exit status is 1 if there was any.
 */
#include <float.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <bvhd/bvhd_structure.h>

#include "builder/update/batch.h"
#include "builder/format/portable.h"
#include "builder/format/serialized.h"
#include "builder/piece/embree.h"
#include "builder/traverse/lavapipe_traverse.h"
#include "client/bvhctl/oracle/rays.h"
#include "tests/support/builder/box_judge.h"
#include "tests/support/builder/broken_input.h"
#include "tests/support/builder/random_input.h"
#include "tests/support/builder/random_top.h"
#include "tests/support/client/vulkan_request.h"

enum { RAYS = 200, FAILURES_SHOWN = 20 };

/* Most requests are small, because brute force takes time in proportion; one in eight is not. */
enum { MOST_PRIMITIVES = 5000, MOST_BELOW_TOP = 400, MOST_OF_SMALL = 200, LARGE_STEP = 32, LARGE_FROM = 28 };
enum { VARIANT_STEP = 4, NATIVE_STEP = 4 }; /* of rays and of requests: the share that is checked in more ways */

struct run {
    enum build_builder builder;
    enum build_quality quality; /* UNSPECIFIED: that of each request */
    struct memory memory;
    struct build_context context;
    struct limits limits;
    uint64_t seed; /* of the current case */
    uint64_t failures;
    uint64_t cases, rays, hits, uncertain, boxes, refused, natives;
    const struct lavapipe_scene *native; /* the scene that is traced, in the native layout; NULL: it was not built */
};

static void fail(struct run *run, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void fail(struct run *run, const char *format, ...)
{
    if (run->failures++ >= FAILURES_SHOWN)
        return;
    va_list arguments;
    va_start(arguments, format);
    fprintf(stderr, "random_inputs --builder %s%s%s 1 %llu: ", build_builder_name(run->builder),
            run->quality ? " --quality " : "", run->quality ? build_quality_name(run->quality) : "",
            (unsigned long long)run->seed);
    vfprintf(stderr, format, arguments);
    fprintf(stderr, "\n");
    va_end(arguments);
}

/* ---- rays ---- */

/* Aims exactly at a corner of a random triangle, where a traversal that is not watertight leaks. */
static void aim_at_corner(const struct oracle_mesh *meshes, uint32_t mesh_count, struct random *random, struct ray *ray)
{
    const struct oracle_mesh *mesh = &meshes[random_below(random, mesh_count)];
    if (!mesh->triangle_count || mesh->transform)
        return;
    const float *corner = mesh->positions + (uint64_t)3 * random_below(random, 3 * mesh->triangle_count);
    float direction[3];
    for (int axis = 0; axis < 3; axis++) {
        direction[axis] = corner[axis] - ray->origin[axis];
        if (!isfinite(direction[axis]))
            return;
    }
    memcpy(ray->direction, direction, sizeof direction);
}

static void align_with_axis(struct random *random, struct ray *ray)
{
    int axis = (int)random_below(random, 3);
    for (int i = 0; i < 3; i++)
        ray->direction[i] = i != axis ? 0 : random_chance(random, 0.5) ? 1 : -1.0f;
}

static void make_rays(const struct oracle_mesh *meshes, uint32_t mesh_count, struct random *random,
                      struct ray rays[RAYS])
{
    rays_make(meshes, mesh_count, random_next(random), RAYS, rays);
    static const uint32_t flags[] = {0, 0, 0, RAY_CULL_BACK_FACING, RAY_CULL_FRONT_FACING};
    uint32_t culling = flags[random_below(random, 5)],
             mask = random_chance(random, 0.5) ? 0xff : random_below(random, 256);
    for (uint32_t i = 0; i < RAYS; i++) {
        rays[i].flags = culling;
        rays[i].cull_mask = (uint8_t)mask;
        if (i % 4 == 1 && mesh_count)
            aim_at_corner(meshes, mesh_count, random, &rays[i]);
        if (i % 16 == 3)
            align_with_axis(random, &rays[i]);
        if (i % 16 == 7) {
            rays[i].tmin = (float)random_between(random, 0, 1);
            rays[i].tmax = rays[i].tmin + (float)random_between(random, 0, 2);
        }
    }
}

/* ---- triangles: closest hit, any hit, either order, positions ---- */

static bool hits_equal(const struct ray_hit *a, const struct ray_hit *b)
{
    return a->t == b->t && a->u == b->u && a->v == b->v && a->instance == b->instance && a->geometry == b->geometry &&
           a->primitive == b->primitive && a->front_face == b->front_face;
}

/* Checks variants of the traversal that must not change the answer. */
static void check_variants(struct run *run, const struct scene *scene, const struct ray *ray, bool is_hit,
                           const struct ray_hit *hit)
{
    const struct traverse_options variants[] = {{.flip_order = true}, {.baseline_only = true}, {.exact_only = true}};
    static const char *const names[] = {"flip_order", "baseline_only", "exact_only"};
    struct ray_hit other;
    for (int i = 0; i < 3; i++) {
        bool is_other = traverse(scene, ray, &variants[i], &other, NULL);
        if (is_other != is_hit || (is_hit && !hits_equal(hit, &other)))
            fail(run, "%s changes the answer", names[i]);
    }
    if (run->native) {
        bool is_other = lavapipe_traverse(run->native, ray, NULL, &other, NULL);
        if (is_other != is_hit || (is_hit && !hits_equal(hit, &other)))
            fail(run, "the native layout changes the answer");
    }
    struct ray any = *ray;
    any.flags |= RAY_TERMINATE_ON_FIRST_HIT;
    if (traverse(scene, &any, NULL, &other, NULL) != is_hit)
        fail(run, "any hit says %d, closest hit %d", !is_hit, is_hit);
}

static void judge_ray(struct run *run, const struct scene *scene, const struct ray *ray,
                      const struct oracle_answer *answer)
{
    static const char *const names[] = {"right", "undecided", "wrong miss", "wrong hit", "wrong primitive"};
    struct ray_hit hit = {0};
    bool is_hit = traverse(scene, ray, NULL, &hit, NULL);
    enum oracle_verdict verdict = oracle_judge(answer, is_hit ? &hit : NULL, NULL);
    run->rays++;
    run->hits += is_hit;
    run->uncertain += verdict == ORACLE_UNDECIDED;
    if (verdict > ORACLE_UNDECIDED && !box_judge_is_beyond_floats(ray, answer->t_end))
        fail(run,
             "%s: t %.9g instead of %.9g [%.9g, %.9g], primitive %u.%u.%u, ray (%a %a %a) + t (%a %a %a), %a .. %a, "
             "flags %x",
             names[verdict], (double)hit.t, answer->t, answer->t_low, answer->t_end, hit.instance, hit.geometry,
             hit.primitive, (double)ray->origin[0], (double)ray->origin[1], (double)ray->origin[2],
             (double)ray->direction[0], (double)ray->direction[1], (double)ray->direction[2], (double)ray->tmin,
             (double)ray->tmax, ray->flags);
    if (run->rays % VARIANT_STEP == 0)
        check_variants(run, scene, ray, is_hit, &hit);
}

static void judge_rays(struct run *run, const struct scene *scene, const struct oracle_mesh *meshes,
                       uint32_t mesh_count, struct ray rays[RAYS])
{
    struct oracle_answer answers[RAYS];
    for (uint32_t i = 0; i < RAYS; i++)
        rays[i].flags |= RAY_SKIP_AABBS;
    struct bvhd_error error;
    if (oracle_trace(meshes, mesh_count, rays, RAYS, &run->memory, &parallel_serial, NULL, NULL, answers, &error) !=
        BVHD_OK) {
        fail(run, "oracle: %s", error.text);
        return;
    }
    for (uint32_t i = 0; i < RAYS; i++)
        judge_ray(run, scene, &rays[i], &answers[i]);
    oracle_finish(answers, RAYS, &run->memory);
}

static bool same_position(float a, float b, bool moved)
{
    return a == b || (a != a && b != b) || (moved && (nextafterf(a, b) == b));
}

/* Checks that the stored corners of a hit primitive are those that the request means. */
static void check_positions(struct run *run, const struct scene *scene, const struct random_meaning *meanings,
                            const struct ray *ray)
{
    struct ray_hit hit;
    float corners[3][3];
    if (!traverse(scene, ray, NULL, &hit, NULL) || hit.is_aabb)
        return;
    traverse_positions(scene, &hit, corners);
    for (int i = 0; i < 9; i++)
        if (!same_position(corners[i / 3][i % 3], meanings[hit.geometry].corners[hit.primitive][i / 3][i % 3],
                           meanings[hit.geometry].moved)) {
            fail(run, "positions of primitive %u.%u differ", hit.geometry, hit.primitive);
            return;
        }
}

/* ---- boxes: each box that is certainly hit is a candidate, and no box that is clearly missed ---- */

struct found {
    uint8_t *seen; /* indexed by geometry and primitive, numbered through all geometries */
    const uint32_t *first;
    uint32_t instance;
};

static enum candidate_verdict note_candidate(void *context, const struct ray *ray, const struct candidate_space *space,
                                             struct ray_hit *hit)
{
    struct found *found = context;
    (void)ray;
    (void)space;
    if (hit->is_aabb && hit->instance == found->instance)
        found->seen[found->first[hit->geometry] + hit->primitive]++;
    return CANDIDATE_IGNORE;
}

static void check_box(struct run *run, const struct box_judge *judge, const char *what, const float box[6], bool seen)
{
    const struct long_ray *ray = &judge->local;
    const char *wrong = box_judge_find(judge, box, seen);
    run->boxes++;
    if (wrong)
        fail(run, "%s: box (%a %a %a .. %a %a %a) is %s, ray (%La %La %La) + t (%La %La %La), %La .. %La", what,
             (double)box[0], (double)box[1], (double)box[2], (double)box[3], (double)box[4], (double)box[5], wrong,
             ray->origin[0], ray->origin[1], ray->origin[2], ray->direction[0], ray->direction[1], ray->direction[2],
             ray->tmin, ray->tmax);
}

static void check_boxes(struct run *run, const struct scene *scene, const struct random_input *bottom,
                        const struct ray *ray, uint32_t instance, const float *matrix)
{
    uint32_t first[RANDOM_INPUT_GEOMETRIES + 1] = {0};
    for (uint32_t g = 0; g < bottom->input.geometry_count; g++)
        first[g + 1] = first[g] + bottom->meanings[g].count;
    struct found found = {calloc(first[bottom->input.geometry_count] + 1, 1), first, instance};
    struct traverse_options options = {.candidate = note_candidate, .context = &found};
    struct ray only_boxes = *ray;
    struct ray_hit hit;
    only_boxes.flags = RAY_SKIP_TRIANGLES;
    if (traverse(scene, &only_boxes, &options, &hit, NULL))
        fail(run, "a candidate that was ignored is a hit");
    struct box_judge judge;
    box_judge_init(&judge, ray, matrix);
    for (uint32_t g = 0; g < bottom->input.geometry_count; g++)
        for (uint32_t i = 0; i < bottom->meanings[g].count; i++)
            check_box(run, &judge, matrix ? "under a top level" : "bottom level", bottom->meanings[g].boxes[i],
                      found.seen[first[g] + i]);
    free(found.seen);
}

/* Makes something that rays can be aimed at: a triangle through opposite corners of each box. */
static struct oracle_mesh boxes_as_triangles(const struct random_meaning *meaning)
{
    float *corners = calloc((size_t)meaning->count + 1, 9 * sizeof *corners);
    for (uint32_t i = 0; i < meaning->count; i++) {
        const float *box = meaning->boxes[i];
        const float triangle[9] = {box[0], box[1], box[2], box[3], box[4], box[5], box[0], box[4], box[2]};
        memcpy(corners + 9 * (size_t)i, triangle, sizeof triangle);
    }
    return (struct oracle_mesh){corners, NULL, meaning->count, NULL, RAY_NO_INSTANCE, 0};
}

/* ---- one bottom level ---- */

static bool is_large(const struct run *run)
{
    return run->seed % LARGE_STEP >= LARGE_FROM;
}

/* Returns the request with what the command line says. */
static struct build_input as_told(const struct run *run, const struct build_input *input)
{
    struct build_input told = *input;
    told.options.builder = run->builder;
    if (run->quality)
        told.options.quality = run->quality;
    return told;
}

/* Asks for the sizes of the request by Vulkan's structs, and compares them with what was built. */
static void check_size(struct run *run, const struct build_input *input, const struct batch_item *item)
{
    struct vulkan_request request;
    struct bvhd_error error = {.status = BVHD_OK};
    VkAccelerationStructureBuildSizesInfoKHR sizes = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR};
    struct serialized_header header = {0};
    vulkan_request_make(input, &request);
    const struct bvhd_structure_sizes_query query = {.struct_size = sizeof query,
                                                     .target = (enum bvhd_target)input->options.target,
                                                     .info = &request.info,
                                                     .max_primitive_counts = request.counts,
                                                     .layout_flags = input->options.layout_flags,
                                                     .quality = (enum bvhd_quality)input->options.quality};
    if (serialized_read((struct bytes){item->blob, item->size}, &header, &error) != BVHD_OK ||
        bvhd_structure_sizes(&query, &sizes, &error) != BVHD_OK)
        fail(run, "no sizes: %s at %s: %s", bvhd_vuid_string(error.vuid), error.where, error.text);
    else if (sizes.accelerationStructureSize < header.deserialized_size)
        fail(run, "the query says %llu bytes, but %llu are needed", (unsigned long long)sizes.accelerationStructureSize,
             (unsigned long long)header.deserialized_size);
}

static bool build_one(struct run *run, const struct build_input *input, struct batch_item *ret_item)
{
    struct bvhd_error error;
    const struct build_input told = as_told(run, input);
    if (batch_build(&told, 1, &run->limits, &run->context, ret_item, &error) != BVHD_OK) {
        fail(run, "batch: %s: %s", error.where, error.text);
        return false;
    }
    if (ret_item->status != BVHD_OK)
        fail(run, "refused: %s at %s: %s", bvhd_vuid_string(ret_item->error.vuid), ret_item->error.where,
             ret_item->error.text);
    else
        check_size(run, &told, ret_item);
    return ret_item->status == BVHD_OK;
}

static bool open_one(struct run *run, const struct batch_item *item, struct portable_view *ret_view)
{
    struct bvhd_error error;
    if (portable_open((struct bytes){item->blob, item->size}, &run->memory, ret_view, &error) != BVHD_OK) {
        fail(run, "does not open: %s: %s", error.where, error.text);
        return false;
    }
    return true;
}

static void trace_bottom(struct run *run, const struct random_input *bottom, const struct scene *scene,
                         struct random *random)
{
    struct oracle_mesh meshes[RANDOM_INPUT_GEOMETRIES] = {0};
    struct ray rays[RAYS];
    uint32_t count = bottom->input.geometry_count;
    bool boxes = count && bottom->geometries[0].type == GEOMETRY_AABBS;
    for (uint32_t g = 0; g < count; g++)
        meshes[g] = boxes ? boxes_as_triangles(&bottom->meanings[g])
                          : (struct oracle_mesh){(const float *)bottom->meanings[g].corners,
                                                 NULL,
                                                 bottom->meanings[g].count,
                                                 NULL,
                                                 RAY_NO_INSTANCE,
                                                 g};
    make_rays(meshes, count, random, rays);
    if (!boxes)
        judge_rays(run, scene, meshes, count, rays);
    for (uint32_t i = 0; i < RAYS; i++) {
        if (boxes)
            check_boxes(run, scene, bottom, &rays[i], RAY_NO_INSTANCE, NULL);
        else
            check_positions(run, scene, bottom->meanings, &rays[i]);
    }
    for (uint32_t g = 0; boxes && g < count; g++)
        free((void *)(uintptr_t)meshes[g].positions);
}

/* Traces the scene in both layouts. */
static void trace_native(struct run *run, const struct random_input *bottom, const struct scene *scene,
                         struct random *random)
{
    struct batch_item item;
    struct lavapipe_view view;
    const struct lavapipe_view *bottoms[1] = {&view};
    const struct lavapipe_scene native = {.bottoms = bottoms, .bottom_count = 1};
    struct bvhd_error error;
    struct build_input input = bottom->input;
    input.options = (struct build_options){.quality = input.options.quality,
                                           .target = TARGET_LAVAPIPE,
                                           .device.variant = 1 + run->seed / NATIVE_STEP % LAVAPIPE_VARIANTS};
    if (!build_one(run, &input, &item))
        return;
    if (lavapipe_open_any((struct bytes){item.blob, item.size}, &run->memory, &view, &error) != BVHD_OK) {
        fail(run, "native: does not open: %s: %s", error.where, error.text);
    } else {
        run->native = &native;
        trace_bottom(run, bottom, scene, random);
        run->native = NULL;
        run->natives++;
    }
    batch_finish(&item, 1, &run->memory);
}

static void run_bottom(struct run *run, struct random *random)
{
    struct random_input bottom;
    struct batch_item item;
    struct portable_view view;
    const struct portable_view *bottoms[1] = {&view};
    struct scene scene = {.bottoms = bottoms, .bottom_count = 1};
    random_input_bottom(&bottom, random, is_large(run) ? MOST_PRIMITIVES : MOST_OF_SMALL);
    if (build_one(run, &bottom.input, &item)) {
        if (open_one(run, &item, &view))
            (run->seed % NATIVE_STEP == 1 ? trace_native : trace_bottom)(run, &bottom, &scene, random);
        batch_finish(&item, 1, &run->memory);
    }
    random_input_finish(&bottom);
}

/* ---- a top level over several bottom levels ---- */

static void trace_top(struct run *run, struct random_top *top, const struct scene *scene, struct random *random)
{
    struct ray rays[RAYS];
    random_top_mean(top, 0xff);
    make_rays(top->meshes, top->mesh_count, random, rays);
    if (top->culling_disabled)
        for (uint32_t i = 0; i < RAYS; i++)
            rays[i].flags = 0;
    uint32_t mask = rays[0].cull_mask;
    random_top_mean(top, mask);
    judge_rays(run, scene, top->meshes, top->mesh_count, rays);
    for (uint32_t i = 0; i < top->instance_count; i++) {
        const struct random_instance *instance = &top->instances[i];
        const struct random_input *bottom = instance->bottom < 0 ? NULL : &top->bottoms[instance->bottom];
        if (!bottom || !(instance->mask & mask) || !bottom->input.geometry_count ||
            bottom->geometries[0].type != GEOMETRY_AABBS)
            continue;
        for (uint32_t k = i % 8; k < RAYS; k += 8)
            check_boxes(run, scene, bottom, &rays[k], i, instance->transform);
    }
}

static bool build_bottoms(struct run *run, struct random_top *top, struct batch_item *items,
                          struct portable_view *views)
{
    for (uint32_t i = 0; i < top->bottom_count; i++) {
        if (!build_one(run, &top->bottoms[i].input, &items[i]))
            return false;
        top->built++;
        top->references[i].key = items[i].key;
        top->references[i].bounds = items[i].summary.bounds;
        top->references[i].slabs = items[i].summary.slabs;
        if (!open_one(run, &items[i], &views[i]))
            return false;
    }
    return true;
}

static void run_top(struct run *run, struct random *random)
{
    struct random_top top;
    struct batch_item items[RANDOM_TOP_BOTTOMS + 1];
    struct portable_view views[RANDOM_TOP_BOTTOMS + 1];
    const struct portable_view *bottoms[RANDOM_TOP_BOTTOMS];
    random_top_init(&top, random, is_large(run) ? MOST_BELOW_TOP : MOST_BELOW_TOP / 8);
    if (build_bottoms(run, &top, items, views) && build_one(run, &top.input, &items[top.bottom_count])) {
        top.built++;
        if (open_one(run, &items[top.bottom_count], &views[top.bottom_count])) {
            struct scene scene = {.top = &views[top.bottom_count],
                                  .bottoms = bottoms,
                                  .bottom_count = random_top_rows(&top, views, bottoms)};
            if (scene.bottom_count != views[top.bottom_count].handle_count)
                fail(run, "%llu handles for %u structures", (unsigned long long)views[top.bottom_count].handle_count,
                     scene.bottom_count);
            else
                trace_top(run, &top, &scene, random);
        }
    }
    batch_finish(items, top.built, &run->memory);
    random_top_finish(&top);
}

/* ---- broken requests ---- */

/* Rays through any structure that opens must terminate. */
static void poke(struct run *run, const struct batch_item *item, struct random *random)
{
    struct portable_view view;
    const struct portable_view *bottoms[1] = {&view};
    struct scene scene = {.bottoms = bottoms, .bottom_count = 1};
    struct ray_hit hit;
    if (!open_one(run, item, &view) || view.header->content == PORTABLE_INSTANCES)
        return;
    for (int i = 0; i < 4; i++) {
        struct ray ray = {.tmax = FLT_MAX, .cull_mask = 0xff};
        for (int axis = 0; axis < 3; axis++) {
            ray.origin[axis] = (float)random_between(random, -2, 2);
            ray.direction[axis] = (float)random_between(random, -1, 1);
        }
        traverse(&scene, &ray, NULL, &hit, NULL);
    }
}

static void check_status(struct run *run, const struct batch_item *item, const char *what, struct random *random)
{
    if (item->status == BVHD_OK) {
        poke(run, item, random);
        return;
    }
    run->refused++;
    if ((unsigned)item->status >= BVHD_STATUS_COUNT || item->status == BVHD_INTERNAL || item->status == BVHD_CORRUPT)
        fail(run, "%s: status %s", what, bvhd_status_name(item->status));
    if (item->error.status != item->status || !item->error.text[0] ||
        (!item->error.where[0] && item->status != BVHD_NO_MEMORY))
        fail(run, "%s: status %s with place \"%s\" and text \"%s\"", what, bvhd_status_name(item->status),
             item->error.where, item->error.text);
    if (item->blob)
        fail(run, "%s: a blob although it failed", what);
}

/* A broken entry between two correct ones must not disturb them. */
static void run_broken(struct run *run, struct random *random)
{
    struct random_input good;
    struct broken_input broken;
    struct batch_item items[3];
    struct bvhd_error error;
    random_input_bottom(&good, random, 50);
    broken_input_init(&broken, random);
    good.input.destination = 1;
    const struct build_input told = as_told(run, &good.input);
    struct build_input inputs[3] = {told, as_told(run, &broken.input), told};
    inputs[2].destination = 2;
    if (batch_build(inputs, 3, &run->limits, &run->context, items, &error) != BVHD_OK) {
        fail(run, "batch: %s: %s", error.where, error.text);
    } else {
        if (items[0].status != BVHD_OK || items[2].status != BVHD_OK || !items[2].coalesced ||
            !key_equal(&items[0].key, &items[2].key))
            fail(run, "%s disturbs its neighbours", broken.what);
        check_status(run, &items[1], broken.what, random);
        batch_finish(items, 3, &run->memory);
    }
    broken_input_finish(&broken);
    random_input_finish(&good);
}

/* ---- all cases ---- */

static void run_case(struct run *run, uint64_t seed, void (*test)(struct run *run, struct random *random))
{
    struct random random = {seed * UINT64_C(0x632be59bd9b4e019)};
    run->seed = seed;
    run->cases++;
    test(run, &random);
    if (run->memory.live) {
        fail(run, "%llu bytes are left", (unsigned long long)run->memory.live);
        run->memory.live = 0;
    }
}

static void run_init(struct run *run)
{
    *run = (struct run){.limits = limits_default()};
    run->limits.max_primitives = 100000;
    memory_init(&run->memory, UINT64_C(1) << 30);
    run->context = (struct build_context){.memory = &run->memory, .parallel = &parallel_serial};
}

static bool read_option(struct run *run, const char *name, const char *value)
{
    if (strcmp(name, "--builder") == 0)
        return build_builder_from_name(value, &run->builder);
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
        if (strcmp(name, "--quality") == 0 && strcmp(value, build_quality_name(quality)) == 0) {
            run->quality = quality;
            return true;
        }
    return false;
}

int main(int argc, char **argv)
{
    struct run run;
    struct embree_identity embree;
    run_init(&run);
    for (; argc > 2 && strncmp(argv[1], "--", 2) == 0; argc -= 2, argv += 2)
        if (!read_option(&run, argv[1], argv[2]))
            return 2;
    if (run.builder == BUILDER_EMBREE && embree_identify(&embree, NULL) != BVHD_OK) {
        printf("there is no Embree here\n");
        return 0;
    }
    uint64_t count = argc > 1 ? strtoull(argv[1], NULL, 10) : 400, seed = argc > 2 ? strtoull(argv[2], NULL, 10) : 1;
    for (uint64_t i = seed; i < seed + count; i++) {
        run_case(&run, i, i % 4 ? run_bottom : run_top);
        run_case(&run, i, run_broken);
    }
    printf("%llu cases, %llu rays: %llu hits, %llu uncertain; %llu boxes; %llu native; %llu refused; %llu wrong\n",
           (unsigned long long)run.cases, (unsigned long long)run.rays, (unsigned long long)run.hits,
           (unsigned long long)run.uncertain, (unsigned long long)run.boxes, (unsigned long long)run.natives,
           (unsigned long long)run.refused, (unsigned long long)run.failures);
    /* A run with too few hits or refusals shows nothing. */
    bool thin = count >= 100 && (run.hits < run.rays / 5 || run.uncertain > run.rays / 2 || run.refused < count / 4);
    if (thin)
        fprintf(stderr, "random_inputs: too few of these cases decide anything\n");
    return run.failures || thin;
}
