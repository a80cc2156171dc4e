/* SPDX-License-Identifier: Apache-2.0 */
/*
 * probe_source.h - what the device loads that structures are built for: from a probe's file, or from the devices of
 * this machine.
 */
#ifndef BVHCTL_PROBE_SOURCE_H
#define BVHCTL_PROBE_SOURCE_H

#include "bvhd/bvhd.h"
#include "proto/base/geometry.h"
#include "proto/base/memory.h"

struct gpu;

struct probe_source {
    const char *file; /* of `bvhctl probe`, hostile; NULL: the first device of this machine that loads `target` */
    enum target target; /* a native one, or, with a file, 0: whatever the device loads */
};

/*
 * BVHD_UNSUPPORTED with the option in `where` when the device, or every device of this machine, loads something else; a
 * file's errors name the file.
 */
enum bvhd_status probe_source_read(const struct probe_source *source, struct memory *memory,
                                   struct bvhd_format *ret_format, struct bvhd_error *error);

/*
 * What a device loads natively that is open already. BVHD_UNSUPPORTED: nothing that this version knows, or nothing at
 * all.
 */
enum bvhd_status probe_source_ask(struct gpu *gpu, struct bvhd_format *ret_format, struct bvhd_error *error);

#endif
