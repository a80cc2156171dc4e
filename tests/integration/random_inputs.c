/* SPDX-License-Identifier: Apache-2.0 */
/*
 * random_inputs.c - tests the whole pipeline with random requests.
 *
 *     random_inputs [--builder own|embree] [--quality fast|balanced|high] [--kinds KINDS] [COUNT [SEED]]
 *
 * Requests are of triangles and boxes (KINDS is flat, as without --kinds), of spheres and linear swept spheres (round),
 * of motion triangles, and of motion instances over all kinds (motion), or of all of them (all). Without --quality each
 * has a random one. Where there is no Embree, --builder embree does nothing.
 *
 * 200 rays through the result of each correct request are compared with brute force over the request, decoded by the
 * test's own code; each result passes the check of its layout and is no larger than the query of sizes says, and a part
 * is built in the native layout, too. As many requests again have something broken, and each of these must give a
 * status.
 *
 * It prints each failure with the arguments that repeat it. The exit status is 1 if there was any.
 */
#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <bvhd/bvhd_structure.h>

#include "builder/update/batch.h"
#include "builder/format/portable.h"
#include "builder/format/serialized.h"
#include "builder/piece/embree.h"
#include "builder/traverse/lavapipe_traverse.h"
#include "tests/support/builder/broken_input.h"
#include "tests/support/builder/random_judge.h"
#include "tests/support/builder/random_kind.h"
#include "tests/support/client/vulkan_request.h"

/* Most requests are small, because brute force takes time in proportion; one in eight is not. */
enum { MOST_PRIMITIVES = 5000, MOST_BELOW_TOP = 400, MOST_OF_SMALL = 200, LARGE_STEP = 32, LARGE_FROM = 28 };
enum { NATIVE_STEP = 4 }; /* of requests: the share that is built and traced in the native layout, too */

/* ---- one bottom level ---- */

static bool is_large(const struct random_run *run)
{
    return run->seed % LARGE_STEP >= LARGE_FROM;
}

/* Returns the request with what the command line says. */
static struct build_input as_told(const struct random_run *run, const struct build_input *input)
{
    struct build_input told = *input;
    told.options.builder = run->builder;
    if (run->quality)
        told.options.quality = run->quality;
    return told;
}

/* Asks for the sizes of the request by Vulkan's structs, and compares them with what was built. */
static void check_size(struct random_run *run, const struct build_input *input, const struct batch_item *item)
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
        random_run_fail(run, "no sizes: %s at %s: %s", bvhd_vuid_string(error.vuid), error.where, error.text);
    else if (sizes.accelerationStructureSize < header.deserialized_size)
        random_run_fail(run, "the query says %llu bytes, but %llu are needed",
                        (unsigned long long)sizes.accelerationStructureSize,
                        (unsigned long long)header.deserialized_size);
}

static bool build_one(struct random_run *run, const struct build_input *input, struct batch_item *ret_item)
{
    struct bvhd_error error;
    const struct build_input told = as_told(run, input);
    if (batch_build(&told, 1, &run->limits, &run->context, ret_item, &error) != BVHD_OK) {
        random_run_fail(run, "batch: %s: %s", error.where, error.text);
        return false;
    }
    if (ret_item->status != BVHD_OK)
        random_run_fail(run, "refused: %s at %s: %s", bvhd_vuid_string(ret_item->error.vuid), ret_item->error.where,
                        ret_item->error.text);
    else
        check_size(run, &told, ret_item);
    return ret_item->status == BVHD_OK;
}

static bool open_one(struct random_run *run, const struct batch_item *item, struct portable_view *ret_view)
{
    struct bvhd_error error;
    if (portable_open((struct bytes){item->blob, item->size}, &run->memory, ret_view, &error) != BVHD_OK) {
        random_run_fail(run, "does not open: %s: %s", error.where, error.text);
        return false;
    }
    return true;
}

/* The driver has neither spheres nor motion, so that a request for its layout is refused by name. */
static void check_native_refusal(struct random_run *run, const struct build_input *input)
{
    struct batch_item item;
    struct bvhd_error error;
    const struct build_input told = as_told(run, input);
    if (batch_build(&told, 1, &run->limits, &run->context, &item, &error) != BVHD_OK) {
        random_run_fail(run, "batch: %s: %s", error.where, error.text);
        return;
    }
    if (input->geometry_count > 0 && item.status != BVHD_UNSUPPORTED)
        random_run_fail(run, "the native layout: %s", bvhd_status_name(item.status));
    batch_finish(&item, 1, &run->memory);
}

/* Traces the scene in both layouts. */
static void trace_native(struct random_run *run, const struct random_input *bottom, const struct scene *scene,
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
    if (bottom->kind->shape != ORACLE_TRIANGLES || random_input_moves(bottom)) {
        check_native_refusal(run, &input);
        random_judge_bottom(run, bottom, scene, random);
        return;
    }
    if (!build_one(run, &input, &item))
        return;
    if (lavapipe_open_any((struct bytes){item.blob, item.size}, &run->memory, &view, &error) != BVHD_OK) {
        random_run_fail(run, "native: does not open: %s: %s", error.where, error.text);
    } else {
        run->native = &native;
        random_judge_bottom(run, bottom, scene, random);
        run->native = NULL;
        run->natives++;
    }
    batch_finish(&item, 1, &run->memory);
}

static void run_bottom(struct random_run *run, struct random *random)
{
    struct random_input bottom;
    struct batch_item item;
    struct portable_view view;
    const struct portable_view *bottoms[1] = {&view};
    struct scene scene = {.bottoms = bottoms, .bottom_count = 1};
    random_input_bottom_of(&bottom, random, is_large(run) ? MOST_PRIMITIVES : MOST_OF_SMALL, run->kinds);
    if (build_one(run, &bottom.input, &item)) {
        if (open_one(run, &item, &view))
            (run->seed % NATIVE_STEP == 1 ? trace_native : random_judge_bottom)(run, &bottom, &scene, random);
        batch_finish(&item, 1, &run->memory);
    }
    random_input_finish(&bottom);
}

/* ---- a top level over several bottom levels ---- */

static bool build_bottoms(struct random_run *run, struct random_top *top, struct batch_item *items,
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

static void run_top(struct random_run *run, struct random *random)
{
    struct random_top top;
    struct batch_item items[RANDOM_TOP_BOTTOMS + 1];
    struct portable_view views[RANDOM_TOP_BOTTOMS + 1];
    const struct portable_view *bottoms[RANDOM_TOP_BOTTOMS];
    random_top_init_of(&top, random, is_large(run) ? MOST_BELOW_TOP : MOST_BELOW_TOP / 8, run->kinds);
    if (build_bottoms(run, &top, items, views) && build_one(run, &top.input, &items[top.bottom_count])) {
        top.built++;
        if (open_one(run, &items[top.bottom_count], &views[top.bottom_count])) {
            struct scene scene = {.top = &views[top.bottom_count],
                                  .bottoms = bottoms,
                                  .bottom_count = random_top_rows(&top, views, bottoms)};
            if (scene.bottom_count != views[top.bottom_count].handle_count)
                random_run_fail(run, "%llu handles for %u structures",
                                (unsigned long long)views[top.bottom_count].handle_count, scene.bottom_count);
            else
                random_judge_top(run, &top, &scene, random);
        }
    }
    batch_finish(items, top.built, &run->memory);
    random_top_finish(&top);
}

/* ---- broken requests ---- */

/* Rays through any structure that opens must terminate. */
static void poke(struct random_run *run, const struct batch_item *item, struct random *random)
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

static void check_status(struct random_run *run, const struct batch_item *item, const char *what, struct random *random)
{
    if (item->status == BVHD_OK) {
        poke(run, item, random);
        return;
    }
    run->refused++;
    if ((unsigned)item->status >= BVHD_STATUS_COUNT || item->status == BVHD_INTERNAL || item->status == BVHD_CORRUPT)
        random_run_fail(run, "%s: status %s", what, bvhd_status_name(item->status));
    if (item->error.status != item->status || !item->error.text[0] ||
        (!item->error.where[0] && item->status != BVHD_NO_MEMORY))
        random_run_fail(run, "%s: status %s with place \"%s\" and text \"%s\"", what, bvhd_status_name(item->status),
                        item->error.where, item->error.text);
    if (item->blob)
        random_run_fail(run, "%s: a blob although it failed", what);
}

/* A broken entry between two correct ones must not disturb them. */
static void run_broken(struct random_run *run, struct random *random)
{
    struct random_input good;
    struct broken_input broken;
    struct batch_item items[3];
    struct bvhd_error error;
    random_input_bottom_of(&good, random, 50, run->kinds);
    broken_input_init(&broken, random, run->kinds);
    good.input.destination = 1;
    const struct build_input told = as_told(run, &good.input);
    struct build_input inputs[3] = {told, as_told(run, &broken.input), told};
    inputs[2].destination = 2;
    if (batch_build(inputs, 3, &run->limits, &run->context, items, &error) != BVHD_OK) {
        random_run_fail(run, "batch: %s: %s", error.where, error.text);
    } else {
        if (items[0].status != BVHD_OK || items[2].status != BVHD_OK || !items[2].coalesced ||
            !key_equal(&items[0].key, &items[2].key))
            random_run_fail(run, "%s disturbs its neighbours", broken.what);
        check_status(run, &items[1], broken.what, random);
        batch_finish(items, 3, &run->memory);
    }
    broken_input_finish(&broken);
    random_input_finish(&good);
}

/* ---- all cases ---- */

static void run_case(struct random_run *run, uint64_t seed, void (*test)(struct random_run *run, struct random *random))
{
    struct random random = {seed * UINT64_C(0x632be59bd9b4e019)};
    run->seed = seed;
    run->cases++;
    test(run, &random);
    if (run->memory.live) {
        random_run_fail(run, "%llu bytes are left", (unsigned long long)run->memory.live);
        run->memory.live = 0;
    }
}

static void run_init(struct random_run *run)
{
    *run = (struct random_run){.limits = limits_default()};
    run->limits.max_primitives = 100000;
    memory_init(&run->memory, UINT64_C(1) << 30);
    run->context = (struct build_context){.memory = &run->memory, .parallel = &parallel_serial};
}

static bool read_option(struct random_run *run, const char *name, const char *value)
{
    if (strcmp(name, "--builder") == 0)
        return build_builder_from_name(value, &run->builder);
    if (strcmp(name, "--kinds") == 0)
        return random_choice_from_name(value, &run->kinds);
    for (enum build_quality quality = QUALITY_FAST; quality <= QUALITY_HIGH; quality++)
        if (strcmp(name, "--quality") == 0 && strcmp(value, build_quality_name(quality)) == 0) {
            run->quality = quality;
            return true;
        }
    return false;
}

int main(int argc, char **argv)
{
    struct random_run run;
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
