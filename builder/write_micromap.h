/* SPDX-License-Identifier: Apache-2.0 */
/* write_micromap.h - the build of an opacity micromap, which has no tree. */
#ifndef BVHD_WRITE_MICROMAP_H
#define BVHD_WRITE_MICROMAP_H

#include "builder/build.h"

/* Writes a micromap from its copy, and fills its statistics except for the times. Errors are those of build(). */
enum bvhd_status write_micromap(const struct canonical *canonical, const struct layout *layout,
                                const struct build_context *context, unsigned char **ret_blob,
                                struct build_stats *stats, struct bvhd_error *error);

#endif
