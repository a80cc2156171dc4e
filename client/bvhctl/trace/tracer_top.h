/* SPDX-License-Identifier: Apache-2.0 */
/* tracer_top.h - a top level of one instance over a bottom level of a device: ray queries want one. */
#ifndef BVHCTL_TRACER_TOP_H
#define BVHCTL_TRACER_TOP_H

#include "client/bvhctl/gpu/gpu.h"

struct tracer_top {
    VkAccelerationStructureKHR handle;
    struct gpu_buffer storage;
};

/*
 * Built by the device over the bottom level at `address`: no transform, mask 0xff, no flags, index 0. Waits.
 * BVHD_NO_MEMORY; on failure nothing is held.
 */
enum bvhd_status tracer_top_build(struct gpu *gpu, uint64_t address, struct tracer_top *ret_top,
                                  struct bvhd_error *error);
/* NULL-safe, idempotent. */
void tracer_top_finish(struct gpu *gpu, struct tracer_top *top);

#endif
