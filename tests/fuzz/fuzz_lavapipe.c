/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fuzz_lavapipe.c - fuzzes the reader of native structures: a structure is refused, or rays through it terminate.
 *
 * The input is a byte, whose lowest bit is the variant and whose next bit says whether sizes are repaired, followed by
 * the structure.
 */
#include "tests/fuzz/fuzz.h"

#include <math.h>

#include "builder/traverse/lavapipe_traverse.h"
#include "builder/format/probe.h"
#include "tests/fuzz/repair.h"
#include "tests/support/builder/synthetic_probe.h"

static void shoot(const struct lavapipe_view *view)
{
    static const float directions[][3] = {{1, 0.25f, -0.5f}, {-1, 0, 0}, {0, -0.0f, 1}, {0.3f, -1, 1e-30f}};
    const struct lavapipe_view *bottoms[] = {view};
    bool is_top = view->handle_count > 0;
    const struct lavapipe_scene scene = {is_top ? view : NULL, bottoms, is_top ? 0 : 1, NULL};
    for (size_t i = 0; i < sizeof directions / sizeof directions[0]; i++) {
        struct ray ray = {
            .origin = {-directions[i][0] * 20, 0.5f, -directions[i][2] * 20}, .tmax = INFINITY, .cull_mask = 0xff};
        struct ray_hit hit;
        memcpy(ray.direction, directions[i], sizeof ray.direction);
        if (lavapipe_traverse(&scene, &ray, NULL, &hit, NULL))
            FUZZ_CHECK(hit.t >= 0 && hit.t <= ray.tmax);
    }
}

static void open_one(struct bytes blob, uint32_t variant)
{
    struct memory memory;
    struct lavapipe_view view;
    struct bvhd_error error = {0};
    memory_init(&memory, UINT64_MAX);
    enum bvhd_status status = lavapipe_open(blob, (enum lavapipe_variant)variant, &memory, &view, &error);
    if (status == BVHD_OK)
        shoot(&view);
    else
        FUZZ_CHECK(error.status == status && error.where[0] && error.text[0]);
    FUZZ_CHECK(memory.live == 0 && memory.peak <= blob.size + 4096);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size == 0)
        return 0;
    uint32_t variant = 1 + (data[0] & 1);
    uint8_t *copy = malloc(size);
    FUZZ_CHECK(copy);
    memcpy(copy, data + 1, size - 1);
    if (data[0] & 2)
        repair_structure(copy, size - 1, variant);
    open_one((struct bytes){copy, size - 1}, variant);
    free(copy);
    return 0;
}

/* Samples are the three structures of a probe in each variant, unrepaired and to be repaired. */
size_t fuzz_sample(uint32_t index, uint8_t *ret_bytes)
{
    struct memory memory;
    struct probe probe;
    unsigned char *data;
    uint64_t size;
    if (index >= 2 * PROBE_COUNT * LAVAPIPE_VARIANTS)
        return 0;
    memory_init(&memory, UINT64_MAX);
    uint8_t mode = (uint8_t)(index / PROBE_COUNT);
    synthetic_probe((enum lavapipe_variant)(1 + (mode & 1)), 1, &memory, &data, &size);
    FUZZ_CHECK(probe_unpack((struct bytes){data, size}, &probe, NULL) == BVHD_OK);
    const struct bytes *structure = &probe.structures[index % PROBE_COUNT];
    size = structure->size;
    FUZZ_CHECK(size < FUZZ_ROOM);
    ret_bytes[0] = mode;
    memcpy(ret_bytes + 1, structure->data, size);
    memory_free(&memory, data);
    return size + 1;
}
