/* SPDX-License-Identifier: Apache-2.0 */
/*
 * probe_source.h - finds the format that structures are built in: the one that a device loads, which is known from a
 * probe's file or by probing the devices of this machine.
 */
#ifndef BVHCTL_PROBE_SOURCE_H
#define BVHCTL_PROBE_SOURCE_H

#include "bvhd/bvhd.h"
#include "proto/base/geometry.h"
#include "proto/base/memory.h"

struct gpu;

struct probe_source {
    const char *file; /* as `bvhctl probe` writes it, hostile; NULL: the first device here that loads `target` */
    enum target target; /* a native one; with a file also 0, for whatever the device loads */
};

/*
 * Reads the file or probes the devices. BVHD_UNSUPPORTED, with the option in `where`, when the device of the file, or
 * every device of this machine, loads another format. Errors of a file have its name in `where`.
 */
enum bvhd_status probe_source_read(const struct probe_source *source, struct memory *memory,
                                   struct bvhd_format *ret_format, struct bvhd_error *error);

/*
 * Probes an open device for the format that it loads natively. BVHD_UNSUPPORTED: it loads none, or none that this
 * version of bvhctl knows.
 */
enum bvhd_status probe_source_ask(struct gpu *gpu, struct bvhd_format *ret_format, struct bvhd_error *error);

#endif
