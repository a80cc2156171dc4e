/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/synthetic_probe.h"

#include <stdio.h>
#include <stdlib.h>

#include "builder/build.h"
#include "builder/format/probe.h"
#include "builder/format/serialized.h"

static void end(const char *what, const struct bvhd_error *error)
{
    fprintf(stderr, "synthetic_probe: %s: %s: %s\n", what, error->where, error->text);
    exit(1);
}

struct device_format synthetic_format(enum lavapipe_variant variant, uint8_t seed)
{
    struct device_format format = {.variant = variant};
    for (uint8_t i = 0; i < 16; i++) {
        format.driver_uuid[i] = (uint8_t)(seed + i);
        format.compatibility_uuid[i] = (uint8_t)(seed + 16 + i);
    }
    return format;
}

/*
 * Replaces the rows that the layout wrote by addresses, as loading into a device does: in the handles, and in each
 * instance's node.
 */
static void name_addresses(unsigned char *blob, uint64_t size, enum lavapipe_variant variant, const uint64_t *addresses,
                           struct memory *memory)
{
    struct lavapipe_view view;
    struct bvhd_error error;
    if (lavapipe_open((struct bytes){blob, size}, variant, memory, &view, &error) != BVHD_OK)
        end("lavapipe_open", &error);
    unsigned char *leaves = blob + (view.body - blob) + view.leaf_offset;
    for (uint64_t i = 0; i < view.handle_count; i++) {
        unsigned char *handle = blob + SERIALIZED_HANDLES + 8 * i;
        uint64_t address = addresses[bytes_get64(handle) - 1];
        bytes_put64(handle, address);
        bytes_put64(leaves + i * sizeof(struct lavapipe_instance), address);
    }
}

static struct bytes build_structure(enum probe_structure which, const struct build_options *options,
                                    const uint64_t *addresses, struct memory *memory)
{
    struct probe_request request;
    struct build_context context = {.memory = memory, .parallel = &parallel_serial};
    struct build_stats stats;
    struct bvhd_error error;
    unsigned char *blob;
    probe_request_init(&request, which);
    if (build(&request.canonical, options, &context, &blob, &stats, &error) != BVHD_OK)
        end("build", &error);
    if (which == PROBE_INSTANCES)
        name_addresses(blob, stats.sizes.total, (enum lavapipe_variant)options->device.variant, addresses, memory);
    return (struct bytes){blob, stats.sizes.total};
}

void synthetic_probe(enum lavapipe_variant variant, uint8_t seed, struct memory *memory, unsigned char **ret_data,
                     uint64_t *ret_size)
{
    struct build_options options = {
        .quality = QUALITY_BALANCED, .target = TARGET_LAVAPIPE, .device = synthetic_format(variant, seed)};
    struct probe probe = {.device = "a device that is none", .driver = "a driver that is none"};
    struct bvhd_error error;
    for (int i = 0; i < PROBE_COUNT; i++)
        probe.handles[i] = UINT64_C(0x7f0000001000) + (uint64_t)i * 0x10000;
    for (int i = 0; i < PROBE_COUNT; i++)
        probe.structures[i] = build_structure((enum probe_structure)i, &options, probe.handles, memory);
    if (probe_pack(&probe, memory, ret_data, ret_size, &error) != BVHD_OK)
        end("probe_pack", &error);
    for (int i = 0; i < PROBE_COUNT; i++)
        memory_free(memory, (void *)(uintptr_t)probe.structures[i].data);
}
