/* SPDX-License-Identifier: Apache-2.0 */
/* gpu_bed.h - for tests that need a Vulkan device: they are skipped, with a message, where there is none. */
#ifndef BVHD_TEST_GPU_BED_H
#define BVHD_TEST_GPU_BED_H

#include <stdio.h>

#include "client/bvhctl/gpu/gpu.h"

enum { GPU_BED_SKIPPED = 77 }; /* the exit status that meson treats as skipped */

/*
 * Returns true, with a line on stdout that says why, when there is no device with compute, or, with `wants_queries`,
 * when the device that "auto" opens has no ray queries.
 */
static inline bool gpu_bed_is_missing(bool wants_queries)
{
    struct memory memory;
    struct bvhd_error error = {0};
    struct gpu_properties *list = NULL;
    uint32_t count = 0;
    memory_init(&memory, UINT64_MAX);
    if (gpu_list(&memory, &list, &count, &error)) {
        printf("skipped: %s: %s\n", error.where, error.text);
        return true;
    }
    bool is_missing = wants_queries && !list[0].has_ray_query;
    if (is_missing)
        printf("skipped: %s has no ray queries\n", list[0].name);
    memory_free(&memory, list);
    return is_missing;
}

#endif
