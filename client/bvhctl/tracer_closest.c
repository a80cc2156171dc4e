/* SPDX-License-Identifier: Apache-2.0 */
#include "tracer_closest.h"

#include <stddef.h>

#include "portable.h"
#include "serialized.h"

#include "trace_closest.h"
#include "trace_closest_address.h"
#include "trace_closest_refill.h"
#include "trace_closest_refill_address.h"
#include "trace_left.h"
#include "trace_left_address.h"
#include "trace_settle.h"
#include "trace_settle_address.h"

/* Four words, then room for the number of each ray of a portion, then for what a quarter of them has in doubt; the others of more are left to the query. */
enum { BINDING_WORK = 3, BINDINGS, UNSETTLED_SIZE = 128, WORK_SIZE = 16 + TRACER_PORTION * 4 + TRACER_PORTION / 4 * UNSETTLED_SIZE };

/* More than any device holds at once of such a kernel; those that come late find no rays left. */
enum { REFILL_GROUPS = 2112 };

/* The kernels count the words of a scene in 31 bits. */
static const uint64_t most_bytes = UINT64_C(1) << 33;

/* How many rays next to each other are looked at, at how many places of a portion, and the cosine that their directions do not fall below when they go together. */
enum { NEIGHBOURS = 32, PLACES = 64 };
static const float together_cosine = 0.9f;

/* The blobs are sound: they have been loaded. */
static bool has_only_triangles(const struct structures *structures)
{
    for (uint32_t i = 0; i < structures->file_count; i++) {
        struct bytes blob = structures->blobs[i];
        if (!blob.data)
            continue;
        uint64_t handles = bytes_get64(blob.data + offsetof(struct serialized_header, handle_count));
        uint64_t body = bytes_align(SERIALIZED_HANDLES + 8 * handles, PORTABLE_BODY_ALIGNMENT);
        if (bytes_get32(blob.data + body + offsetof(struct portable_header, content)) == PORTABLE_AABBS)
            return false;
    }
    return true;
}

/* Lanes of a subgroup can count each other. */
static bool has_ballots(struct gpu *gpu)
{
    const VkSubgroupFeatureFlags needed = VK_SUBGROUP_FEATURE_BASIC_BIT | VK_SUBGROUP_FEATURE_BALLOT_BIT;
    VkPhysicalDeviceSubgroupProperties subgroups = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_SUBGROUP_PROPERTIES};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &subgroups};
    gpu_properties(gpu, &properties);
    return (subgroups.supportedOperations & needed) == needed && (subgroups.supportedStages & VK_SHADER_STAGE_COMPUTE_BIT);
}

static enum bvhd_status add_kernel(struct tracer_device *device, const uint32_t *code, size_t size, const uint32_t *constants,
                                   uint32_t most_groups, int *ret_choice, struct bvhd_error *error)
{
    const struct gpu_kernel_options options = {
        .code = code, .size = size, .bindings = BINDINGS, .constants = constants, .constant_count = 3};
    enum bvhd_status status = tracer_device_add(device, &options, most_groups, error);
    if (!status)
        *ret_choice = (int)device->choice_count - 1;
    return status;
}

static enum bvhd_status add_after(struct tracer_device *device, const uint32_t *code, size_t size, const uint32_t *constants,
                                  struct bvhd_error *error)
{
    const struct gpu_kernel_options options = {
        .code = code, .size = size, .bindings = BINDINGS, .constants = constants, .constant_count = 3};
    return tracer_device_add_after(device, &options, error);
}

/* What decides on doubts; and the query, for rays with more of them than there is room for. */
static enum bvhd_status add_afters(struct tracer_device *device, const uint32_t *constants, struct bvhd_error *error)
{
    const uint32_t of_query[] = {TRACER_GROUP, false, constants[2]};
    bool by_address = device->gpu->facts.has_buffer_address;
    enum bvhd_status status = by_address
                                  ? add_after(device, trace_settle_address_code, sizeof trace_settle_address_code, constants, error)
                                  : add_after(device, trace_settle_code, sizeof trace_settle_code, constants, error);
    if (status)
        return status;
    return by_address ? add_after(device, trace_left_address_code, sizeof trace_left_address_code, of_query, error)
                      : add_after(device, trace_left_code, sizeof trace_left_code, of_query, error);
}

static enum bvhd_status add_kernels(struct tracer_closest *closest, struct tracer_device *device, const uint32_t *constants,
                                    struct bvhd_error *error)
{
    bool by_address = device->gpu->facts.has_buffer_address;
    enum bvhd_status status =
        by_address
            ? add_kernel(device, trace_closest_address_code, sizeof trace_closest_address_code, constants, 0, &closest->together, error)
            : add_kernel(device, trace_closest_code, sizeof trace_closest_code, constants, 0, &closest->together, error);
    if (status || !has_ballots(device->gpu))
        return status;
    return by_address ? add_kernel(device, trace_closest_refill_address_code, sizeof trace_closest_refill_address_code, constants,
                                   REFILL_GROUPS, &closest->refill, error)
                      : add_kernel(device, trace_closest_refill_code, sizeof trace_closest_refill_code, constants, REFILL_GROUPS,
                                   &closest->refill, error);
}

enum bvhd_status tracer_closest_init(struct tracer_closest *closest, struct tracer_device *device, const struct structures *structures,
                                     bool has_fused_fma, struct bvhd_error *error)
{
    const uint32_t constants[] = {TRACER_GROUP, structures->has_top, has_fused_fma};
    *closest = (struct tracer_closest){.is_cpu = device->gpu->facts.type == VK_PHYSICAL_DEVICE_TYPE_CPU, .together = -1, .refill = -1};
    if (!has_only_triangles(structures) || device->buffers[0]->size > most_bytes)
        return BVHD_OK;
    enum bvhd_status status =
        gpu_buffer_create(device->gpu, WORK_SIZE, VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_DST_BIT, GPU_DEVICE,
                          &closest->work, error);
    if (status)
        return status;
    device->buffers[BINDING_WORK - 2] = device->work = &closest->work;
    status = add_afters(device, constants, error);
    return status ? status : add_kernels(closest, device, constants, error);
}

void tracer_closest_finish(struct tracer_closest *closest, struct gpu *gpu)
{
    if (closest)
        gpu_buffer_destroy(gpu, &closest->work);
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
    if (closest->refill < 0 || closest->way == TRACER_WAY_TOGETHER)
        return closest->together;
    if (closest->way == TRACER_WAY_REFILL)
        return closest->refill;
    return closest->is_cpu || go_together(rays, count) ? closest->together : closest->refill;
}
