/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/probe.h"

#include <inttypes.h>
#include <math.h>

#include "builder/format/lavapipe.h"
#include "builder/format/lavapipe_topology.h"
#include "builder/format/lavapipe_write.h"
#include "builder/format/serialized.h"

/*
 * The progress of one attempt: the number of structures that a layout reproduces, and of equal bytes in the next one.
 */
struct attempt {
    enum lavapipe_variant variant;
    struct device_format format;
    int structure;
    uint64_t byte;
};

static const char *name_of(int structure)
{
    static const char *const names[] = {"PROBE_TRIANGLES", "PROBE_AABBS", "PROBE_INSTANCES"};
    return names[structure];
}

/* Replaces the rows that the writer stored, in handles and leaves, by the device's addresses. */
static void set_addresses(const struct probe *probe, const struct lavapipe_view *theirs, unsigned char *blob)
{
    unsigned char *leaves = blob + SERIALIZED_HANDLES + 8 * theirs->handle_count + theirs->leaf_offset;
    for (uint64_t i = 0; i < theirs->handle_count; i++) {
        unsigned char *handle = blob + SERIALIZED_HANDLES + 8 * i;
        uint64_t address = probe->handles[bytes_get64(handle) - 1];
        bytes_put64(handle, address);
        bytes_put64(leaves + i * sizeof(struct lavapipe_instance), address);
    }
}

/*
 * Every driver rounds the bounds of instances in its own way: some use fused multiply-add, some round outward.
 * Differences no larger than such roundings are taken over from the device's bytes.
 */
static void take_over_rounding(const unsigned char *theirs, unsigned char *ours, int count)
{
    for (int i = 0; i < count; i++) {
        float theirs_is = bytes_get_float(theirs + 4 * i), ours_is = bytes_get_float(ours + 4 * i);
        if (fabsf(theirs_is - ours_is) <= 0x1p-20f * (1 + fabsf(ours_is)))
            memcpy(ours + 4 * i, theirs + 4 * i, 4);
    }
}

static void take_over_bounds(const struct lavapipe_view *theirs, struct bytes blob, unsigned char *ours)
{
    uint64_t body = (uint64_t)(theirs->body - blob.data);
    take_over_rounding(theirs->body, ours + body, 6);
    for (uint64_t at = LAVAPIPE_HEADER; at < theirs->leaf_offset; at += sizeof(struct lavapipe_box))
        take_over_rounding(theirs->body + at, ours + body + at, 12);
}

/* Returns the first byte that differs, or the smaller size if none does. */
static uint64_t compare(struct bytes theirs, const unsigned char *ours, uint64_t our_size)
{
    uint64_t at = 0, common = our_size < theirs.size ? our_size : theirs.size;
    while (at < common && theirs.data[at] == ours[at])
        at++;
    return at;
}

/*
 * Writes the structure again with the device's topology. *ret_byte is the first difference, or UINT64_MAX if there is
 * none.
 */
static enum bvhd_status reproduce(const struct probe *probe, int structure, const struct lavapipe_view *view,
                                  struct memory *memory, uint64_t *ret_byte, struct bvhd_error *error)
{
    struct probe_request request;
    struct lavapipe_topology topology;
    struct layout_sizes sizes;
    unsigned char *ours;
    struct bytes theirs = probe->structures[structure];
    probe_request_init(&request, (enum probe_structure)structure);
    enum bvhd_status status = lavapipe_topology_read(view, &request.canonical, memory, &topology, error);
    if (status != BVHD_OK)
        return status;
    const struct layout_input input = {.canonical = &request.canonical,
                                       .ir = &topology.ir,
                                       .device = &view->device,
                                       .memory = memory,
                                       .parallel = &parallel_serial};
    status = lavapipe_write_at(&input, topology.places, &ours, &sizes, error);
    if (status == BVHD_OK) {
        /* If the sizes differ, the same offset means different things in the two blobs. */
        bool alike = sizes.total == theirs.size && bytes_get64(ours + 48) == view->handle_count &&
                     sizes.nodes == view->leaf_offset - LAVAPIPE_HEADER;
        if (alike && structure == PROBE_INSTANCES) {
            set_addresses(probe, view, ours);
            take_over_bounds(view, theirs, ours);
        }
        uint64_t equal = compare(theirs, ours, sizes.total);
        *ret_byte = equal == sizes.total && equal == theirs.size ? UINT64_MAX : equal;
        memory_free(memory, ours);
    }
    lavapipe_topology_finish(&topology);
    return status;
}

/* Tries one variant. It matches if ret_attempt->structure is PROBE_COUNT. Only a lack of memory is an error. */
static enum bvhd_status attempt(const struct probe *probe, enum lavapipe_variant variant, struct memory *memory,
                                struct attempt *ret_attempt, struct bvhd_error *error)
{
    struct attempt made = {.variant = variant};
    struct bvhd_error other; /* a structure of another layout is no error */
    for (; made.structure < PROBE_COUNT; made.structure++) {
        struct lavapipe_view view;
        enum bvhd_status status = lavapipe_open(probe->structures[made.structure], variant, memory, &view, &other);
        made.byte = 0;
        if (status == BVHD_OK && made.structure > 0 && memcmp(&made.format, &view.device, sizeof made.format) != 0)
            break;
        if (status == BVHD_OK)
            status = reproduce(probe, made.structure, &view, memory, &made.byte, &other);
        if (status == BVHD_NO_MEMORY)
            return bvhd_error_set(error, status, other.where, "%s", other.text);
        if (status != BVHD_OK || made.byte != UINT64_MAX)
            break;
        made.format = view.device;
    }
    *ret_attempt = made;
    return BVHD_OK;
}

static bool is_further(const struct attempt *a, const struct attempt *b)
{
    return a->structure != b->structure ? a->structure > b->structure : a->byte > b->byte;
}

enum bvhd_status probe_match(const struct probe *probe, struct memory *memory, enum target *ret_target,
                             struct device_format *ret_format, struct bvhd_error *error)
{
    struct attempt nearest = {0};
    for (int variant = 1; variant <= LAVAPIPE_VARIANTS; variant++) {
        struct attempt made;
        enum bvhd_status status = attempt(probe, (enum lavapipe_variant)variant, memory, &made, error);
        if (status != BVHD_OK)
            return status;
        if (variant == 1 || is_further(&made, &nearest))
            nearest = made;
    }
    if (nearest.structure < PROBE_COUNT)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, "probe",
                              "no native target reproduces what this device wrote: %s differs at byte %" PRIu64
                              " from the nearest one; the portable target is for such devices",
                              name_of(nearest.structure), nearest.byte);
    *ret_target = TARGET_LAVAPIPE;
    *ret_format = nearest.format;
    return BVHD_OK;
}
