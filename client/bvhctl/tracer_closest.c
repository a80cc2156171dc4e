/* SPDX-License-Identifier: Apache-2.0 */
#include "tracer_closest.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "portable.h"
#include "serialized.h"

#include "trace_closest.h"
#include "trace_closest_address.h"
#include "trace_closest_doubles.h"
#include "trace_closest_refill.h"
#include "trace_closest_refill_address.h"
#include "trace_closest_wait.h"
#include "trace_closest_wait_address.h"
#include "trace_closest_wait_doubles.h"
#include "trace_left.h"
#include "trace_left_address.h"
#include "trace_settle.h"
#include "trace_settle_address.h"
#include "trace_settle_doubles.h"

/* For each ray its number, and room for one doubt and a half; rays of which some find none are left to the query. */
enum { BINDING_WORK = 3, BINDINGS, DOUBT_SIZE = 16, WORK_EACH = 4 + DOUBT_SIZE * 3 / 2 };

/* Workgroups of one subgroup, if it is no smaller; more of them than any device holds at once: those that come late find no rays left. */
enum { REFILL_GROUP = 32, REFILL_GROUPS = 4224 };

/*
 * Where rays that go together are handed out, on NVIDIA's: one workgroup for each multiprocessor, of so many threads that there are no more than 80 registers, or 64, for
 * each of them. Compilers take 96 otherwise, for what few rays need, and a sixth less fits at once.
 */
enum { WHOLE_GROUP = 768, WHOLE_FINE_GROUP = 1024 };

/* Rows of a scene are found by 32 bits of an offset. */
static const uint64_t most_bytes = UINT64_C(1) << 32;

/* One structure of more: even rays that go together soon lose each other among triangles that small. */
static const uint64_t fine_bytes = UINT64_C(1) << 24;

/* Of trace_closest.comp. */
enum { CONSTANT_GROUP, CONSTANT_INSTANCES, CONSTANT_FMA, CONSTANT_PLAIN_BYTES, CONSTANT_CONTENT, CONSTANT_CPU, CONSTANTS };
static const uint32_t any_content = UINT32_MAX;

/* How many rays next to each other are looked at, at how many places of a portion, and the cosine that their directions do not fall below when they go together. */
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

/* Steps are no larger than the structure's coordinates, which the kernels bound (FARTHEST): so it is in what we write, though the format does not ask for it. */
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

/* Lanes of a subgroup can count each other. `ret_size`: how many these are. */
static bool has_ballots(struct gpu *gpu, uint32_t *ret_size)
{
    const VkSubgroupFeatureFlags needed = VK_SUBGROUP_FEATURE_BASIC_BIT | VK_SUBGROUP_FEATURE_BALLOT_BIT;
    VkPhysicalDeviceSubgroupProperties subgroups = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &subgroups};
    gpu_properties(gpu, &properties);
    *ret_size = subgroups.subgroupSize;
    return (subgroups.supportedOperations & needed) == needed && (subgroups.supportedStages & VK_SHADER_STAGE_COMPUTE_BIT);
}

enum kernel { KERNEL_TOGETHER, KERNEL_WAIT, KERNEL_REFILL, KERNEL_SETTLE, KERNEL_LEFT, KERNELS };
/* Each is better than those before it, where a device has what it needs. */
enum variant { VARIANT_BINDING, VARIANT_ADDRESS, VARIANT_DOUBLES, VARIANTS };

#define CODE(name) name##_code, sizeof name##_code

static const struct code {
    const uint32_t *words;
    size_t size;
} codes[KERNELS][VARIANTS] = {
    [KERNEL_TOGETHER] = {{CODE(trace_closest)}, {CODE(trace_closest_address)}, {CODE(trace_closest_doubles)}},
    [KERNEL_WAIT] = {{CODE(trace_closest_wait)}, {CODE(trace_closest_wait_address)}, {CODE(trace_closest_wait_doubles)}},
    [KERNEL_REFILL] = {{CODE(trace_closest_refill)}, {CODE(trace_closest_refill_address)}, {CODE(trace_closest_refill_address)}},
    [KERNEL_SETTLE] = {{CODE(trace_settle)}, {CODE(trace_settle_address)}, {CODE(trace_settle_doubles)}},
    [KERNEL_LEFT] = {{CODE(trace_left)}, {CODE(trace_left_address)}, {CODE(trace_left_address)}},
};

static enum variant variant_of(const struct gpu_facts *facts)
{
    return !facts->has_buffer_address ? VARIANT_BINDING : !facts->has_quick_doubles ? VARIANT_ADDRESS : VARIANT_DOUBLES;
}

static struct gpu_kernel_options options_of(const struct tracer_device *device, enum kernel kernel, const uint32_t *constants)
{
    const struct code *code = &codes[kernel][variant_of(&device->gpu->facts)];
    return (struct gpu_kernel_options){
        .code = code->words, .size = code->size, .bindings = BINDINGS, .constants = constants, .constant_count = CONSTANTS};
}

/* What decides on doubts; and the query, for what is left. */
static enum bvhd_status add_afters(struct tracer_device *device, const uint32_t *constants, struct bvhd_error *error)
{
    const uint32_t of_query[CONSTANTS] = {TRACER_GROUP, false, constants[CONSTANT_FMA]};
    const struct gpu_kernel_options after = options_of(device, KERNEL_SETTLE, constants),
                                    rest = options_of(device, KERNEL_LEFT, of_query);
    enum bvhd_status status = tracer_device_add_after(device, &after, error);
    return status ? status : tracer_device_add_rest(device, &rest, error);
}

/* In workgroups of so many threads, of which there are so many at most (0: a thread a ray). */
static enum bvhd_status add_kernel(struct tracer_device *device, enum kernel kernel, const uint32_t *constants, uint32_t group,
                                   uint32_t most_groups, int *ret_choice, struct bvhd_error *error)
{
    uint32_t with_group[CONSTANTS];
    memcpy(with_group, constants, sizeof with_group);
    with_group[CONSTANT_GROUP] = group;
    const struct gpu_kernel_options options = options_of(device, kernel, with_group);
    enum bvhd_status status = tracer_device_add(device, &options, most_groups, error);
    if (!status)
        *ret_choice = (int)device->choice_count - 1;
    return status;
}

/* Waiting for other lanes pays where there are instances, or many small triangles. Kernels that decide at their end hand rays out where there are no instances. */
static enum bvhd_status add_together(struct tracer_closest *closest, struct tracer_device *device, const uint32_t *constants,
                                     struct bvhd_error *error)
{
    bool has_top = constants[CONSTANT_INSTANCES], is_whole = variant_of(&device->gpu->facts) == VARIANT_DOUBLES;
    uint32_t group = TRACER_GROUP, most_groups = 0, multiprocessors = device->gpu->facts.multiprocessors;
    if (is_whole && !has_top) {
        group = !multiprocessors ? TRACER_GROUP : closest->is_fine ? WHOLE_FINE_GROUP : WHOLE_GROUP;
        most_groups = multiprocessors ? multiprocessors : REFILL_GROUPS;
    }
    enum bvhd_status status = add_kernel(device, has_top || closest->is_fine ? KERNEL_WAIT : KERNEL_TOGETHER, constants, group,
                                         most_groups, &closest->together, error);
    if (!status)
        device->choices[closest->together].is_whole = is_whole;
    return status;
}

enum bvhd_status tracer_closest_init(struct tracer_closest *closest, struct tracer_device *device, const struct structures *structures,
                                     bool has_fused_fma, struct bvhd_error *error)
{
    struct gpu *gpu = device->gpu;
    uint64_t size = device->buffers[0]->size;
    uint32_t content, lanes;
    bool is_cpu = gpu->facts.type == VK_PHYSICAL_DEVICE_TYPE_CPU;
    *closest =
        (struct tracer_closest){.is_cpu = is_cpu, .is_fine = !structures->has_top && size > fine_bytes, .together = -1, .refill = -1};
    if (!has_only_triangles(structures, &content) || size > most_bytes || !has_ballots(gpu, &lanes))
        return BVHD_OK;
    const uint32_t constants[CONSTANTS] = {
        [CONSTANT_GROUP] = TRACER_GROUP, [CONSTANT_INSTANCES] = structures->has_top,
        [CONSTANT_FMA] = has_fused_fma,  [CONSTANT_PLAIN_BYTES] = !gpu->has_small_halves || !all_steps_fit(structures),
        [CONSTANT_CONTENT] = content,    [CONSTANT_CPU] = is_cpu,
    };
    device->work_binding = BINDING_WORK;
    device->work_each = WORK_EACH;
    enum bvhd_status status = add_afters(device, constants, error);
    if (!status)
        status = add_together(closest, device, constants, error);
    return status ? status
                  : add_kernel(device, KERNEL_REFILL, constants, lanes > REFILL_GROUP ? lanes : REFILL_GROUP, REFILL_GROUPS,
                               &closest->refill, error);
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
    return cosine > 0 &&
           cosine * cosine >= together_cosine * together_cosine * dot(a->direction, a->direction) * dot(b->direction, b->direction);
}

/* At most places, neighbours have nearly one direction. */
static bool go_together(const struct ray *rays, uint64_t count)
{
    uint64_t step = count / PLACES < NEIGHBOURS ? NEIGHBOURS : count / PLACES / NEIGHBOURS * NEIGHBOURS, along = 0, all = 0;
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
    bool together = closest->is_cpu || go_together(rays, count);
    return together ? closest->together : closest->refill;
}
