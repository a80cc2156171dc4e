/* SPDX-License-Identifier: Apache-2.0 */
/*
 * format.h - which target and which native format a program requests: converts bvhd.h's structs to a description's
 * options.
 */
#ifndef BVHD_FORMAT_H
#define BVHD_FORMAT_H

#include "bvhd/bvhd.h"
#include "proto/base/geometry.h"

/*
 * The sizes of struct bvhd_build before `format`, and before `rays_per_primitive` was added: programs that were
 * compiled then lack these fields.
 */
enum {
    FORMAT_BUILD_WITHOUT = offsetof(struct bvhd_build, format),
    FORMAT_BUILD_RAYLESS = offsetof(struct bvhd_build, rays_per_primitive)
};

/*
 * Converts the options. `build` has one of its valid sizes. BVHD_INVALID, with the place "build.reserved" or
 * "build.format": a native target without a format, or a format of another target or of unknown size. The builder
 * judges the contents of the format, and targets that this library does not know.
 */
enum bvhd_status format_options(const struct bvhd_build *build, struct build_options *ret_options,
                                struct bvhd_error *error);

#endif
