/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/local/build_library.h"

#include "builder/workers.h"

static enum bvhd_status entry_prepare(const struct build_input *input, uint32_t index,
                                      const struct build_entry_source *source, const struct build_context *context,
                                      struct build_entry *ret_entry, struct bvhd_error *error)
{
    const struct limits limits = limits_default();
    return build_entry_prepare(input, index, &limits, source, context, ret_entry, error);
}

const struct build_library *bvhd_build_library(void)
{
    static const struct build_library library = {
        .version = BVHD_BUILD_LIBRARY_VERSION,
        .workers_create = workers_create,
        .workers_destroy = workers_destroy,
        .workers_parallel = workers_parallel,
        .entry_prepare = entry_prepare,
        .entry_finish = build_entry_finish,
        .entry_make = build_entry_make,
    };
    return &library;
}
