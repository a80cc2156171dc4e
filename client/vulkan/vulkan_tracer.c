/* SPDX-License-Identifier: Apache-2.0 */
#include "client/vulkan/vulkan_tracer.h"

#include <inttypes.h>
#include <string.h>

#include "builder/format/record_kind.h"
#include "client/argument.h"
#include "client/library.h"
#include "client/vulkan/vulkan_blob.h"
#include "client/vulkan/vulkan_scene_load.h"

#include "client/shaders/trace_closest.h"
#include "client/shaders/trace_closest_address.h"
#include "client/shaders/trace_closest_batch.h"
#include "client/shaders/trace_closest_batch_address.h"
#include "client/shaders/trace_closest_batch_doubles.h"
#include "client/shaders/trace_closest_cooperative.h"
#include "client/shaders/trace_closest_doubles.h"
#include "client/shaders/trace_closest_refill.h"
#include "client/shaders/trace_closest_refill_address.h"
#include "client/shaders/trace_closest_refill_cooperative.h"
#include "client/shaders/trace_fallback.h"
#include "client/shaders/trace_fallback_address.h"
#include "client/shaders/trace_query.h"
#include "client/shaders/trace_query_address.h"
#include "client/shaders/trace_query_motion.h"
#include "client/shaders/trace_query_motion_address.h"
#include "client/shaders/trace_query_round.h"
#include "client/shaders/trace_query_round_address.h"
#include "client/shaders/trace_resolve.h"
#include "client/shaders/trace_resolve_address.h"
#include "client/shaders/trace_resolve_doubles.h"

/* Rays, hits, the scene, scratch memory. */
enum { BINDINGS = 4 };

/*
 * Persistent threads: workgroups of one subgroup, if it is no smaller; more of them than any device holds at once:
 * those that start late find no rays left.
 */
enum { REFILL_GROUP = 32, REFILL_GROUPS = 4224 };

/*
 * Where kernels resolve undecided triangles themselves, on NVIDIA devices: one workgroup for each multiprocessor, of so
 * many threads that there are no more than 80 registers, 64, or 72, for each of them. Compilers take 96 otherwise, for
 * code that few rays need, and a sixth fewer threads fit at once.
 */
enum { WHOLE_GROUP = 768, WHOLE_FINE_GROUP = 1024, WHOLE_REFILL_GROUP = 896 };

/* Rows of a scene are found by 32 bits of an offset. */
static const uint64_t max_closest_bytes = UINT64_C(1) << 32;

/* In a scene larger than this, triangles are so small that even coherent rays soon meet different ones. */
static const uint64_t fine_bytes = UINT64_C(1) << 24;

/* Specialisation constants of bvhd_trace_closest.comp. */
enum {
    CONSTANT_GROUP,
    CONSTANT_INSTANCES,
    CONSTANT_FMA,
    CONSTANT_PLAIN_BYTES,
    CONSTANT_CONTENT,
    CONSTANT_CPU,
    CONSTANTS
};

/*
 * Contents that the kernels for closest triangles do not know. Among them are those that only KERNEL_QUERY_MOTION
 * knows, and those that only it and KERNEL_QUERY_ROUND know.
 */
enum {
    MOVING_KINDS = 1 << PORTABLE_MOVING_TRIANGLES | 1 << PORTABLE_MOVING_INSTANCES,
    ROUND_KINDS = 1 << PORTABLE_SPHERES | 1 << PORTABLE_SWEPT_SPHERES,
    OTHER_KINDS = MOVING_KINDS | ROUND_KINDS | 1 << PORTABLE_AABBS,
};

static const uint32_t any_content = UINT32_MAX; /* bottom levels hold different kinds of triangles */

/* ---- kernels ---- */

/* They differ by what is traced: one structure, one of many small triangles, a top level, spheres, what moves. */
enum kernel {
    KERNEL_COHERENT,
    KERNEL_COHERENT_FINE,
    KERNEL_COHERENT_TOP,
    KERNEL_INCOHERENT,
    KERNEL_INCOHERENT_TOP,
    KERNEL_RESOLVE,
    KERNEL_FALLBACK,
    KERNEL_QUERY,
    KERNEL_QUERY_ROUND,
    KERNEL_QUERY_MOTION,
    KERNELS
};
/* Each is better than those before it, where a device has what it needs. */
enum variant { VARIANT_BINDING, VARIANT_ADDRESS, VARIANT_DOUBLES, VARIANTS };

#define CODE(name) name##_code, sizeof name##_code

static const struct code {
    const uint32_t *words;
    size_t size;
} codes[KERNELS][VARIANTS] = {
    [KERNEL_COHERENT] = {{CODE(trace_closest)}, {CODE(trace_closest_address)}, {CODE(trace_closest_doubles)}},
    [KERNEL_COHERENT_FINE] = {{CODE(trace_closest_batch)},
                              {CODE(trace_closest_batch_address)},
                              {CODE(trace_closest_cooperative)}},
    [KERNEL_COHERENT_TOP] = {{CODE(trace_closest_batch)},
                             {CODE(trace_closest_batch_address)},
                             {CODE(trace_closest_batch_doubles)}},
    [KERNEL_INCOHERENT] = {{CODE(trace_closest_refill)},
                           {CODE(trace_closest_refill_address)},
                           {CODE(trace_closest_refill_cooperative)}},
    [KERNEL_INCOHERENT_TOP] = {{CODE(trace_closest_refill)},
                               {CODE(trace_closest_refill_address)},
                               {CODE(trace_closest_refill_address)}},
    [KERNEL_RESOLVE] = {{CODE(trace_resolve)}, {CODE(trace_resolve_address)}, {CODE(trace_resolve_doubles)}},
    [KERNEL_FALLBACK] = {{CODE(trace_fallback)}, {CODE(trace_fallback_address)}, {CODE(trace_fallback_address)}},
    [KERNEL_QUERY] = {{CODE(trace_query)}, {CODE(trace_query_address)}, {CODE(trace_query_address)}},
    [KERNEL_QUERY_ROUND] = {{CODE(trace_query_round)},
                            {CODE(trace_query_round_address)},
                            {CODE(trace_query_round_address)}},
    [KERNEL_QUERY_MOTION] = {{CODE(trace_query_motion)},
                             {CODE(trace_query_motion_address)},
                             {CODE(trace_query_motion_address)}},
};

/* The arguments that all kernels of a tracer are compiled with. */
struct making {
    struct bvhd_tracer *tracer;
    const struct vulkan_trace_traits *traits;
    enum variant variant;
    bool is_fine;
    uint32_t constants[CONSTANTS];
    struct bvhd_error *error;
};

static enum bvhd_status make_pipeline(const struct making *making, enum kernel kernel, const uint32_t *constants,
                                      VkPipeline *ret_pipeline)
{
    const struct bvhd_tracer *tracer = making->tracer;
    const struct code *code = &codes[kernel][making->variant];
    const struct vulkan_code options = {
        .words = code->words, .size = code->size, .constants = constants, .constant_count = CONSTANTS};
    return vulkan_pipeline_create(tracer->device, &tracer->layout, tracer->cache, &options, ret_pipeline,
                                  making->error);
}

/* The constants of bvhd_trace_query.comp are others: the workgroup's size, plain bytes, fma. */
static enum bvhd_status make_query(const struct making *making, enum kernel kernel, VkPipeline *ret_pipeline)
{
    const uint32_t constants[CONSTANTS] = {VULKAN_TRACE_GROUP, false, making->traits->has_fused_fma};
    return make_pipeline(making, kernel, constants, ret_pipeline);
}

/* In workgroups of `group` threads, of which there are at most `max_groups` (0: a thread for each ray). */
static enum bvhd_status make_pass(const struct making *making, enum kernel kernel, uint32_t group, uint32_t max_groups,
                                  bool resolves, struct vulkan_trace_pass *ret_pass)
{
    uint32_t constants[CONSTANTS];
    memcpy(constants, making->constants, sizeof constants);
    constants[CONSTANT_GROUP] = group;
    ret_pass->max_groups = max_groups;
    ret_pass->resolves = resolves;
    return make_pipeline(making, kernel, constants, &ret_pass->pipeline);
}

/*
 * Persistent threads that resolve undecided triangles at their end. `group`: where it is known how many multiprocessors
 * there are.
 */
static enum bvhd_status make_whole(const struct making *making, enum kernel kernel, uint32_t group,
                                   struct vulkan_trace_pass *ret_pass)
{
    uint32_t multiprocessors = making->traits->multiprocessors;
    if (making->tracer->device->compute.max_group_size < group)
        multiprocessors = 0;
    return make_pass(making, kernel, multiprocessors ? group : VULKAN_TRACE_GROUP,
                     multiprocessors ? multiprocessors : REFILL_GROUPS, true, ret_pass);
}

static enum bvhd_status make_coherent(const struct making *making)
{
    bool has_top = making->tracer->scene.has_top, resolves = making->variant == VARIANT_DOUBLES;
    enum kernel kernel = has_top ? KERNEL_COHERENT_TOP : making->is_fine ? KERNEL_COHERENT_FINE : KERNEL_COHERENT;
    struct vulkan_trace_pass *pass = &making->tracer->coherent;
    if (resolves && !has_top)
        return make_whole(making, kernel, making->is_fine ? WHOLE_FINE_GROUP : WHOLE_GROUP, pass);
    return make_pass(making, kernel, VULKAN_TRACE_GROUP, 0, resolves, pass);
}

static enum bvhd_status make_incoherent(const struct making *making)
{
    bool has_top = making->tracer->scene.has_top;
    struct vulkan_trace_pass *pass = &making->tracer->incoherent;
    if (making->variant == VARIANT_DOUBLES && !has_top)
        return make_whole(making, KERNEL_INCOHERENT, WHOLE_REFILL_GROUP, pass);
    uint32_t lanes = making->traits->lanes, group = lanes > REFILL_GROUP ? lanes : REFILL_GROUP;
    return make_pass(making, has_top ? KERNEL_INCOHERENT_TOP : KERNEL_INCOHERENT, group, REFILL_GROUPS, false, pass);
}

/* The kind of records of all bottom levels, any_content where they differ. */
static uint32_t content_of(const struct vulkan_contents *contents)
{
    uint32_t triangles = contents->kinds & (1u << PORTABLE_INDEXED_TRIANGLES | 1u << PORTABLE_TRIANGLES);
    return triangles == 1u << PORTABLE_INDEXED_TRIANGLES ? PORTABLE_INDEXED_TRIANGLES
           : triangles == 1u << PORTABLE_TRIANGLES       ? PORTABLE_TRIANGLES
                                                         : any_content;
}

static enum kernel query_of(const struct vulkan_contents *contents)
{
    return contents->kinds & MOVING_KINDS  ? KERNEL_QUERY_MOTION
           : contents->kinds & ROUND_KINDS ? KERNEL_QUERY_ROUND
                                           : KERNEL_QUERY;
}

static enum variant variant_of(const struct vulkan_trace_scene *scene, const struct vulkan_trace_traits *traits)
{
    return !scene->base                                          ? VARIANT_BINDING
           : !traits->has_quick_doubles || !traits->has_shuffles ? VARIANT_ADDRESS
                                                                 : VARIANT_DOUBLES;
}

static enum bvhd_status make_kernels(struct bvhd_tracer *tracer, const struct vulkan_trace_traits *traits,
                                     struct bvhd_error *error)
{
    const struct vulkan_trace_scene *scene = &tracer->scene;
    const struct making making = {
        .tracer = tracer,
        .traits = traits,
        .variant = variant_of(scene, traits),
        .is_fine = scene->size > fine_bytes,
        .constants = {[CONSTANT_GROUP] = VULKAN_TRACE_GROUP,
                      [CONSTANT_INSTANCES] = scene->has_top,
                      [CONSTANT_FMA] = traits->has_fused_fma,
                      [CONSTANT_PLAIN_BYTES] = !traits->has_small_halves || scene->contents.has_large_steps,
                      [CONSTANT_CONTENT] = content_of(&scene->contents),
                      [CONSTANT_CPU] = traits->is_cpu},
        .error = error,
    };
    tracer->has_closest =
        !(scene->contents.kinds & OTHER_KINDS) && scene->size <= max_closest_bytes && traits->has_ballots;
    enum bvhd_status status = make_query(&making, query_of(&scene->contents), &tracer->query);
    if (status != BVHD_OK || !tracer->has_closest)
        return status;
    status = make_pipeline(&making, KERNEL_RESOLVE, making.constants, &tracer->resolve);
    if (status == BVHD_OK)
        status = make_query(&making, KERNEL_FALLBACK, &tracer->fallback);
    if (status == BVHD_OK)
        status = make_coherent(&making);
    return status == BVHD_OK ? make_incoherent(&making) : status;
}

/* ---- the tracer ---- */

enum bvhd_status vulkan_tracer_create(const struct bvhd_vulkan_device *device, const struct vulkan_trace_scene *scene,
                                      const struct vulkan_trace_traits *traits, VkPipelineCache cache,
                                      struct bvhd_tracer **ret_tracer, struct bvhd_error *error)
{
    struct bvhd_tracer *tracer = memory_alloc(&library_memory, sizeof *tracer);
    if (!tracer)
        return bvhd_error_no_memory(error, "tracer", "no memory for %zu bytes", sizeof *tracer);
    *tracer = (struct bvhd_tracer){.device = device, .cache = cache, .scene = *scene};
    enum bvhd_status status =
        vulkan_layout_create(device, BINDINGS, 0, sizeof(struct vulkan_trace_push), &tracer->layout, error);
    if (status == BVHD_OK)
        status = make_kernels(tracer, traits, error);
    if (status == BVHD_OK)
        *ret_tracer = tracer;
    else
        bvhd_tracer_destroy(tracer);
    return status;
}

void bvhd_tracer_destroy(struct bvhd_tracer *tracer)
{
    if (!tracer)
        return;
    const struct bvhd_vulkan_device *device = tracer->device;
    vulkan_pipeline_destroy(device, tracer->query);
    vulkan_pipeline_destroy(device, tracer->coherent.pipeline);
    vulkan_pipeline_destroy(device, tracer->incoherent.pipeline);
    vulkan_pipeline_destroy(device, tracer->resolve);
    vulkan_pipeline_destroy(device, tracer->fallback);
    vulkan_layout_destroy(device, &tracer->layout);
    memory_free(&library_memory, tracer);
}

/* ---- the scene ---- */

static enum bvhd_status no_root(uint32_t root, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_NOT_FOUND, "options.root", "there is no structure %" PRIu32, root);
}

static enum bvhd_status describe_scene(const struct bvhd_tracer_options *options, struct vulkan_trace_scene *ret_scene,
                                       struct bvhd_error *error)
{
    const struct bvhd_vulkan_scene *scene = options->scene;
    if (scene->target != BVHD_TARGET_PORTABLE)
        return bvhd_error_set(error, BVHD_INVALID, "options.scene", "native structures: the device traces them itself");
    if (options->root >= scene->row_count || !scene->rows[options->root].data)
        return no_root(options->root, error);
    const struct vulkan_scene_row *row = &scene->rows[scene->rows[options->root].leader];
    *ret_scene = (struct vulkan_trace_scene){
        .buffer = scene->pages[0].buffer,
        .size = scene->pages[0].size,
        .base = scene->flags & BVHD_VULKAN_SCENE_ADDRESSES ? scene->pages[0].address : 0,
        .root = row->location,
        .has_top = row->is_top,
        .contents = scene->contents,
    };
    return BVHD_OK;
}

static enum bvhd_status add_blob(const struct bvhd_tracer_options *options, uint32_t index,
                                 struct vulkan_trace_scene *scene, struct bvhd_error *error)
{
    struct vulkan_blob blob;
    const struct bytes bytes = {options->blobs[index].data, options->blobs[index].size};
    if (!bytes.data)
        return BVHD_OK;
    enum bvhd_status status = vulkan_blob_read(bytes, &blob, error);
    if (status != BVHD_OK)
        return status;
    if (blob.target != BVHD_TARGET_PORTABLE)
        return bvhd_error_set(error, BVHD_INVALID, "options.blobs", "native structures: the device traces them itself");
    uint32_t content = vulkan_contents_add(&scene->contents, bytes);
    if (index == options->root)
        scene->has_top = record_kind_is_top(content);
    return BVHD_OK;
}

static enum bvhd_status describe_buffer(const struct bvhd_vulkan_device *device,
                                        const struct bvhd_tracer_options *options, struct vulkan_trace_scene *ret_scene,
                                        struct bvhd_error *error)
{
    struct vulkan_trace_scene scene = {.buffer = options->buffer,
                                       .size = options->buffer_size,
                                       .base = options->buffer_address,
                                       .root = options->root_location};
    if (!scene.buffer || !scene.size || !options->blobs)
        return bvhd_error_set(error, BVHD_INVALID, "options", "neither a scene nor a buffer with its structures");
    if (scene.root < scene.base || scene.root - scene.base >= scene.size)
        return bvhd_error_set(error, BVHD_INVALID, "options.root_location", "it is not in the buffer");
    if (scene.base && !device->has_addresses)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "options.buffer_address", "the device has no buffer addresses");
    if (options->root >= options->blob_count || !options->blobs[options->root].data)
        return no_root(options->root, error);
    enum bvhd_status status = BVHD_OK;
    for (uint32_t i = 0; i < options->blob_count && status == BVHD_OK; i++)
        status = add_blob(options, i, &scene, error);
    if (status == BVHD_OK)
        *ret_scene = scene;
    return status;
}

enum bvhd_status bvhd_tracer_create(struct bvhd_vulkan_device *device, const struct bvhd_vulkan_queue *queue,
                                    const struct bvhd_tracer_options *options, struct bvhd_tracer **ret_tracer,
                                    struct bvhd_error *ret_error)
{
    struct vulkan_trace_scene scene = {.buffer = VK_NULL_HANDLE};
    enum bvhd_status status =
        ARGUMENTS_CHECK(ret_error, {device, "device"}, {options, "options"}, {ret_tracer, "ret_tracer"});
    if (status == BVHD_OK)
        status =
            argument_check_size(options, sizeof *options, sizeof *options, "options", "bvhd_tracer_options", ret_error);
    if (status != BVHD_OK)
        return status;
    if (device->compute.api_version < VK_API_VERSION_1_1)
        return bvhd_error_set(ret_error, BVHD_UNSUPPORTED, "device", "the kernels need Vulkan 1.1, and it has %u.%u",
                              VK_VERSION_MAJOR(device->compute.api_version),
                              VK_VERSION_MINOR(device->compute.api_version));
    status = options->scene ? describe_scene(options, &scene, ret_error)
                            : describe_buffer(device, options, &scene, ret_error);
    if (status != BVHD_OK)
        return status;
    if (!scene.base && scene.size > device->limits.storage_range)
        return bvhd_error_set(ret_error, BVHD_TOO_LARGE, "options.buffer_size",
                              "%" PRIu64 " bytes, a shader sees %" PRIu64 " of a buffer without its address",
                              scene.size, device->limits.storage_range);
    const struct vulkan_trace_traits traits = vulkan_trace_traits_of(device, queue, options->has_shader_float64);
    return vulkan_tracer_create(device, &scene, &traits, options->cache, ret_tracer, ret_error);
}
