/* SPDX-License-Identifier: Apache-2.0 */
/*
 * format.h - converts what a program requests in bvhd.h's structs (quality, target, native format) to the options of a
 * description.
 */
#ifndef BVHD_FORMAT_H
#define BVHD_FORMAT_H

#include "bvhd/bvhd.h"
#include "proto/base/geometry.h"

/*
 * The sizes that struct bvhd_build had in earlier versions: before `format`, before `rays_per_primitive`, and before
 * `builder` was added. Programs that were compiled with such a version lack these fields.
 */
enum {
    FORMAT_BUILD_WITHOUT = offsetof(struct bvhd_build, format),
    FORMAT_BUILD_RAYLESS = offsetof(struct bvhd_build, rays_per_primitive),
    FORMAT_BUILD_BUILDERLESS = offsetof(struct bvhd_build, builder)
};

/*
 * Converts the options. `build` has one of its valid sizes. BVHD_INVALID, with the place of the field, such as
 * "build.builder" or "build.format": a native target without a format, or a format of another target or of unknown
 * size. The builder judges the contents of the format, and targets that this library does not know.
 */
enum bvhd_status format_options(const struct bvhd_build *build, struct build_options *ret_options,
                                struct bvhd_error *error);

/* Returns the deadline of a build, in milliseconds; 0: none. */
uint32_t format_deadline(const struct bvhd_build *build);

#endif
