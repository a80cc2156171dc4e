/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/trace/tracer_closest.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "builder/format/portable.h"
#include "builder/format/serialized.h"

#include "client/bvhctl/kernels/trace_closest.h"
#include "client/bvhctl/kernels/trace_closest_address.h"
#include "client/bvhctl/kernels/trace_closest_doubles.h"
#include "client/bvhctl/kernels/trace_closest_refill.h"
#include "client/bvhctl/kernels/trace_closest_refill_address.h"
#include "client/bvhctl/kernels/trace_closest_refill_teams.h"
#include "client/bvhctl/kernels/trace_closest_teams.h"
#include "client/bvhctl/kernels/trace_closest_wait.h"
#include "client/bvhctl/kernels/trace_closest_wait_address.h"
#include "client/bvhctl/kernels/trace_closest_wait_doubles.h"
#include "client/bvhctl/kernels/trace_left.h"
#include "client/bvhctl/kernels/trace_left_address.h"
#include "client/bvhctl/kernels/trace_settle.h"
#include "client/bvhctl/kernels/trace_settle_address.h"
#include "client/bvhctl/kernels/trace_settle_doubles.h"

/* For each ray its number, and room for one doubt and a half; rays of which some find none are left to the query. */
enum { BINDING_WORK = 3, BINDINGS, DOUBT_SIZE = 16, WORK_EACH = 4 + DOUBT_SIZE * 3 / 2 };

/*
 * Workgroups of one subgroup, if it is no smaller; more of them than any device holds at once: those that come late
 * find no rays left.
 */
enum { REFILL_GROUP = 32, REFILL_GROUPS = 4224 };

/*
 * Where kernels decide on doubts themselves, on NVIDIA's: one workgroup for each multiprocessor, of so many threads
 * that there are no more than 80 registers, 64, or 72, for each of them. Compilers take 96 otherwise, for what few rays
 * need, and a sixth less fits at once.
 */
enum { WHOLE_GROUP = 768, WHOLE_FINE_GROUP = 1024, WHOLE_REFILL_GROUP = 896 };

/* Rows of a scene are found by 32 bits of an offset. */
static const uint64_t most_bytes = UINT64_C(1) << 32;

/* One structure of more: even rays that go together soon lose each other among triangles that small. */
static const uint64_t fine_bytes = UINT64_C(1) << 24;

/* Of trace_closest.comp. */
enum {
    CONSTANT_GROUP,
    CONSTANT_INSTANCES,
    CONSTANT_FMA,
    CONSTANT_PLAIN_BYTES,
    CONSTANT_CONTENT,
    CONSTANT_CPU,
    CONSTANTS
};
static const uint32_t any_content = UINT32_MAX;

/*
 * How many rays next to each other are looked at, at how many places of a portion, and the cosine that their directions
 * do not fall below when they go together.
 */
enum { NEIGHBOURS = 32, PLACES = 64 };
static const float together_cosine = 0.9f;

/* The blobs are sound: they have been loaded. */
static const unsigned char *body_of(struct bytes blob)
{
    uint64_t handles = bytes_get64(blob.data + offsetof(struct serialized_header, handle_count));
    return blob.data + bytes_align(SERIALIZED_HANDLES + 8 * handles, PORTABLE_BODY_ALIGNMENT);
}

static uint32_t content_of(struct bytes blob)
{
    return bytes_get32(body_of(blob) + offsetof(struct portable_header, content));
}

/*
 * Steps are no larger than the structure's coordinates, which the kernels bound (FARTHEST): so it is in what we write,
 * though the format does not ask for it.
 */
static bool has_fitting_steps(struct bytes blob)
{
    const unsigned char *body = body_of(blob);
    struct portable_header header;
    double largest = 0x1p-126;
    memcpy(&header, body, sizeof header);
    for (int i = 0; i < 6; i++)
        largest = fmax(largest, fabs((double)header.bounds[i]));
    for (uint32_t i = 0; i < header.node_count; i++) {
        const uint8_t *exponents =
            body + header.node_offset + i * sizeof(struct portable_node) + offsetof(struct portable_node, exponent);
        for (int axis = 0; axis < 3; axis++)
            if (ldexp(1, exponents[axis] - 127) > largest)
                return false;
    }
    return true;
}

static bool all_steps_fit(const struct structures *structures)
{
    for (uint32_t i = 0; i < structures->file_count; i++)
        if (structures->blobs[i].data && !has_fitting_steps(structures->blobs[i]))
            return false;
    return true;
}

/* What all bottom levels have, any_content where they differ. False: some have AABBs. */
static bool has_only_triangles(const struct structures *structures, uint32_t *ret_content)
{
    bool is_first = true;
    *ret_content = any_content;
    for (uint32_t i = 0; i < structures->file_count; i++) {
        uint32_t content = structures->blobs[i].data ? content_of(structures->blobs[i]) : PORTABLE_INSTANCES;
        if (content == PORTABLE_AABBS)
            return false;
        if (content == PORTABLE_INSTANCES)
            continue;
        *ret_content = is_first || content == *ret_content ? content : any_content;
        is_first = false;
    }
    return true;
}

/* What lanes of a subgroup can do for each other. */
struct subgroups {
    uint32_t lanes;
    bool have_ballots, have_shuffles; /* shuffles: and votes; no lane is missing, and 32 bits have one for each */
};

static struct subgroups subgroups_of(struct gpu *gpu)
{
    const VkSubgroupFeatureFlags ballots = VK_SUBGROUP_FEATURE_BASIC_BIT | VK_SUBGROUP_FEATURE_BALLOT_BIT,
                                 shuffles = ballots | VK_SUBGROUP_FEATURE_SHUFFLE_BIT | VK_SUBGROUP_FEATURE_VOTE_BIT;
    VkPhysicalDeviceSubgroupProperties found = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &found};
    gpu_properties(gpu, &properties);
    VkSubgroupFeatureFlags has = found.supportedStages & VK_SHADER_STAGE_COMPUTE_BIT ? found.supportedOperations : 0;
    return (struct subgroups){.lanes = found.subgroupSize,
                              .have_ballots = (has & ballots) == ballots,
                              .have_shuffles = (has & shuffles) == shuffles && found.subgroupSize <= 32 &&
                                               TRACER_GROUP % found.subgroupSize == 0};
}

/* By what is traced: one structure, one of many small triangles, a top level. */
enum kernel {
    KERNEL_TOGETHER,
    KERNEL_TOGETHER_FINE,
    KERNEL_TOGETHER_TOP,
    KERNEL_REFILL,
    KERNEL_REFILL_TOP,
    KERNEL_SETTLE,
    KERNEL_LEFT,
    KERNELS
};
/* Each is better than those before it, where a device has what it needs. */
enum variant { VARIANT_BINDING, VARIANT_ADDRESS, VARIANT_DOUBLES, VARIANTS };

#define CODE(name) name##_code, sizeof name##_code

static const struct code {
    const uint32_t *words;
    size_t size;
} codes[KERNELS][VARIANTS] = {
    [KERNEL_TOGETHER] = {{CODE(trace_closest)}, {CODE(trace_closest_address)}, {CODE(trace_closest_doubles)}},
    [KERNEL_TOGETHER_FINE] = {{CODE(trace_closest_wait)},
                              {CODE(trace_closest_wait_address)},
                              {CODE(trace_closest_teams)}},
    [KERNEL_TOGETHER_TOP] = {{CODE(trace_closest_wait)},
                             {CODE(trace_closest_wait_address)},
                             {CODE(trace_closest_wait_doubles)}},
    [KERNEL_REFILL] = {{CODE(trace_closest_refill)},
                       {CODE(trace_closest_refill_address)},
                       {CODE(trace_closest_refill_teams)}},
    [KERNEL_REFILL_TOP] = {{CODE(trace_closest_refill)},
                           {CODE(trace_closest_refill_address)},
                           {CODE(trace_closest_refill_address)}},
    [KERNEL_SETTLE] = {{CODE(trace_settle)}, {CODE(trace_settle_address)}, {CODE(trace_settle_doubles)}},
    [KERNEL_LEFT] = {{CODE(trace_left)}, {CODE(trace_left_address)}, {CODE(trace_left_address)}},
};

static enum variant variant_of(const struct gpu_properties *properties, struct subgroups subgroups)
{
    return !properties->has_buffer_address                              ? VARIANT_BINDING
           : !properties->has_quick_doubles || !subgroups.have_shuffles ? VARIANT_ADDRESS
                                                                        : VARIANT_DOUBLES;
}

/* What all kernels of a tracer are made for. */
struct making {
    struct tracer_device *device;
    enum variant variant;
    bool has_top, is_fine;
    uint32_t constants[CONSTANTS], lanes;
};

static struct gpu_kernel_options options_of(const struct making *making, enum kernel kernel, const uint32_t *constants)
{
    const struct code *code = &codes[kernel][making->variant];
    return (struct gpu_kernel_options){.code = code->words,
                                       .size = code->size,
                                       .bindings = BINDINGS,
                                       .constants = constants,
                                       .constant_count = CONSTANTS};
}

/* What decides on doubts; and the query, for what is left. */
static enum bvhd_status add_afters(const struct making *making, struct bvhd_error *error)
{
    const uint32_t of_query[CONSTANTS] = {TRACER_GROUP, false, making->constants[CONSTANT_FMA]};
    const struct gpu_kernel_options after = options_of(making, KERNEL_SETTLE, making->constants),
                                    rest = options_of(making, KERNEL_LEFT, of_query);
    enum bvhd_status status = tracer_device_add_after(making->device, &after, error);
    return status ? status : tracer_device_add_rest(making->device, &rest, error);
}

/*
 * In workgroups of so many threads, of which there are so many at most (0: a thread a ray). `is_whole`: it decides on
 * doubts itself.
 */
static enum bvhd_status add_kernel(const struct making *making, enum kernel kernel, uint32_t group,
                                   uint32_t most_groups, bool is_whole, int *ret_choice, struct bvhd_error *error)
{
    struct tracer_device *device = making->device;
    uint32_t constants[CONSTANTS];
    memcpy(constants, making->constants, sizeof constants);
    constants[CONSTANT_GROUP] = group;
    const struct gpu_kernel_options options = options_of(making, kernel, constants);
    enum bvhd_status status = tracer_device_add(device, &options, most_groups, error);
    if (status)
        return status;
    *ret_choice = (int)device->choice_count - 1;
    device->choices[*ret_choice].is_whole = is_whole;
    return BVHD_OK;
}

/* Kernels that hand rays out and decide at their end. `group`: where it is known how many multiprocessors there are. */
static enum bvhd_status add_whole(const struct making *making, enum kernel kernel, uint32_t group, int *ret_choice,
                                  struct bvhd_error *error)
{
    uint32_t multiprocessors = making->device->gpu->properties.multiprocessors;
    return add_kernel(making, kernel, multiprocessors ? group : TRACER_GROUP,
                      multiprocessors ? multiprocessors : REFILL_GROUPS, true, ret_choice, error);
}

static enum bvhd_status add_together(const struct making *making, int *ret_choice, struct bvhd_error *error)
{
    enum kernel kernel = making->has_top   ? KERNEL_TOGETHER_TOP
                         : making->is_fine ? KERNEL_TOGETHER_FINE
                                           : KERNEL_TOGETHER;
    bool is_whole = making->variant == VARIANT_DOUBLES;
    if (is_whole && !making->has_top)
        return add_whole(making, kernel, making->is_fine ? WHOLE_FINE_GROUP : WHOLE_GROUP, ret_choice, error);
    return add_kernel(making, kernel, TRACER_GROUP, 0, is_whole, ret_choice, error);
}

static enum bvhd_status add_refill(const struct making *making, int *ret_choice, struct bvhd_error *error)
{
    if (making->variant == VARIANT_DOUBLES && !making->has_top)
        return add_whole(making, KERNEL_REFILL, WHOLE_REFILL_GROUP, ret_choice, error);
    uint32_t group = making->lanes > REFILL_GROUP ? making->lanes : REFILL_GROUP;
    return add_kernel(making, making->has_top ? KERNEL_REFILL_TOP : KERNEL_REFILL, group, REFILL_GROUPS, false,
                      ret_choice, error);
}

enum bvhd_status tracer_closest_init(struct tracer_closest *closest, struct tracer_device *device,
                                     const struct structures *structures, bool has_fused_fma, struct bvhd_error *error)
{
    struct gpu *gpu = device->gpu;
    const struct subgroups subgroups = subgroups_of(gpu);
    uint64_t size = device->buffers[0]->size;
    uint32_t content;
    *closest = (struct tracer_closest){.together = -1, .refill = -1};
    if (!has_only_triangles(structures, &content) || size > most_bytes || !subgroups.have_ballots)
        return BVHD_OK;
    const struct making making = {
        .device = device,
        .variant = variant_of(&gpu->properties, subgroups),
        .has_top = structures->has_top,
        .is_fine = size > fine_bytes,
        .constants = {[CONSTANT_GROUP] = TRACER_GROUP,
                      [CONSTANT_INSTANCES] = structures->has_top,
                      [CONSTANT_FMA] = has_fused_fma,
                      [CONSTANT_PLAIN_BYTES] = !gpu->has_small_halves || !all_steps_fit(structures),
                      [CONSTANT_CONTENT] = content,
                      [CONSTANT_CPU] = gpu->properties.type == VK_PHYSICAL_DEVICE_TYPE_CPU},
        .lanes = subgroups.lanes,
    };
    device->work_binding = BINDING_WORK;
    device->work_each = WORK_EACH;
    enum bvhd_status status = add_afters(&making, error);
    if (!status)
        status = add_together(&making, &closest->together, error);
    return status ? status : add_refill(&making, &closest->refill, error);
}

static bool has_flags(const struct ray *rays, uint64_t count)
{
    for (uint64_t i = 0; i < count; i++)
        if (rays[i].flags || !(rays[i].tmin >= 0))
            return true;
    return false;
}

static float dot(const float *a, const float *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static bool is_along(const struct ray *a, const struct ray *b)
{
    float cosine = dot(a->direction, b->direction);
    return cosine > 0 && cosine * cosine >= together_cosine * together_cosine * dot(a->direction, a->direction) *
                                                dot(b->direction, b->direction);
}

/* At most places, neighbours have nearly one direction. */
static bool go_together(const struct ray *rays, uint64_t count)
{
    uint64_t step = count / PLACES < NEIGHBOURS ? NEIGHBOURS : count / PLACES / NEIGHBOURS * NEIGHBOURS, along = 0,
             all = 0;
    for (uint64_t at = 0; at < count; at += step)
        for (uint64_t i = at + 1; i < count && i < at + NEIGHBOURS; i++, all++)
            along += is_along(&rays[at], &rays[i]);
    return along >= all - all / 4;
}

int tracer_closest_choose(const struct tracer_closest *closest, const struct ray *rays, uint64_t count)
{
    if (closest->together < 0 || closest->way == TRACER_WAY_QUERY || has_flags(rays, count))
        return -1;
    if (closest->way != TRACER_WAY_AUTO)
        return closest->way == TRACER_WAY_TOGETHER ? closest->together : closest->refill;
    return go_together(rays, count) ? closest->together : closest->refill;
}
