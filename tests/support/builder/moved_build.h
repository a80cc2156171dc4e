/* SPDX-License-Identifier: Apache-2.0 */
/* moved_build.h - a structure that is updated to its geometry instead of built over it. For test programs only. */
#ifndef BVHD_TEST_MOVED_BUILD_H
#define BVHD_TEST_MOVED_BUILD_H

#include "builder/build.h"

/*
 * Does what build() does, in two steps: builds over other geometry with ALLOW_UPDATE, which is the given one with its
 * axes exchanged and stretched, and updates the result to the given geometry. Primitives stay active or inactive.
 */
enum bvhd_status moved_build(const struct canonical *canonical, const struct build_options *options,
                             const struct build_context *context, unsigned char **ret_blob,
                             struct build_stats *ret_stats, struct bvhd_error *error);

#endif
