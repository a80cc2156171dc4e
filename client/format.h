/* SPDX-License-Identifier: Apache-2.0 */
/*
 * format.h - which target a program asks for, and what the device loads that it is for: from bvhd.h's structs to a
 * description's options.
 */
#ifndef BVHD_FORMAT_H
#define BVHD_FORMAT_H

#include "bvhd/bvhd.h"
#include "proto/base/geometry.h"

/*
 * The sizes that struct bvhd_build had before it had a format, and before it said anything of rays: programs that were
 * compiled then have none.
 */
enum {
    FORMAT_BUILD_WITHOUT = offsetof(struct bvhd_build, format),
    FORMAT_BUILD_RAYLESS = offsetof(struct bvhd_build, rays_per_primitive)
};

/*
 * `build` has one of the sizes that it may have. BVHD_INVALID, with the place, "build.reserved" or "build.format": a
 * native target without a format, a format of another target or of no known size. What the format says is for the
 * builder to judge, and so is a target that this library does not know.
 */
enum bvhd_status format_options(const struct bvhd_build *build, struct build_options *ret_options,
                                struct bvhd_error *error);

#endif
