/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_probe.c - fuzzes the reader of probes: what it says about a device is either an error with a place, or a valid
 * format for builds.
 *
 * The input is a byte, which is 0 or the variant for which the structures' sizes are repaired, followed by the probe.
 */
#include "tests/fuzz/fuzz.h"

#include "builder/format/layout.h"
#include "builder/format/probe.h"
#include "tests/fuzz/repair.h"
#include "tests/support/builder/synthetic_probe.h"

static void check_format(const struct probe *probe, enum target target, const struct device_format *format)
{
    const struct layout *layout = layout_find(target);
    FUZZ_CHECK(layout && format->variant >= 1 && format->variant <= layout->variants);
    for (int i = 0; i < PROBE_COUNT; i++) {
        struct serialized_header header;
        FUZZ_CHECK(serialized_read(probe->structures[i], &header, NULL) == BVHD_OK);
        FUZZ_CHECK(memcmp(header.driver_uuid, format->driver_uuid, sizeof header.driver_uuid) == 0);
        FUZZ_CHECK(memcmp(header.compatibility_uuid, format->compatibility_uuid, sizeof header.compatibility_uuid) ==
                   0);
    }
}

static void go(uint8_t *data, size_t size, uint8_t variant)
{
    struct memory memory;
    struct probe probe;
    enum target target;
    struct device_format format;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = probe_unpack((struct bytes){data, size}, &probe, &error);
    for (int i = 0; status == BVHD_OK && variant && i < PROBE_COUNT; i++)
        repair_structure(data + (probe.structures[i].data - data), probe.structures[i].size, variant);
    if (status == BVHD_OK)
        status = probe_match(&probe, &memory, &target, &format, &error);
    if (status == BVHD_OK)
        check_format(&probe, target, &format);
    else
        FUZZ_CHECK(error.status == status && error.where[0] && error.text[0]);
    FUZZ_CHECK(memory.live == 0 && memory.peak <= 16 * size + 65536);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0)
        return 0;
    uint8_t *copy = malloc(size);
    FUZZ_CHECK(copy);
    memcpy(copy, data + 1, size - 1);
    go(copy, size - 1, data[0] % (LAVAPIPE_VARIANTS + 1));
    free(copy);
    return 0;
}

/* Samples are a device of each variant, unrepaired and to be repaired. */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    struct memory memory;
    unsigned char *data;
    uint64_t size;
    if (index >= 2 * LAVAPIPE_VARIANTS)
        return 0;
    memory_init(&memory, UINT64_MAX);
    uint8_t variant = (uint8_t)(1 + index % LAVAPIPE_VARIANTS);
    synthetic_probe((enum lavapipe_variant)variant, (uint8_t)(40 * index), &memory, &data, &size);
    FUZZ_CHECK(size < FUZZ_ROOM);
    ret_bytes[0] = index < LAVAPIPE_VARIANTS ? 0 : variant;
    memcpy(ret_bytes + 1, data, size);
    memory_free(&memory, data);
    return size + 1;
}
