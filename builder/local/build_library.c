/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/local/build_library.h"

#include "builder/content_key.h"
#include "builder/input/prepare.h"
#include "builder/tier.h"
#include "builder/workers.h"

static enum bvhd_status copy_make(const struct build_input *input, uint32_t index, const struct build_context *context,
                                  struct build_library_copy *ret_copy, struct bvhd_error *error)
{
    const struct limits limits = limits_default();
    struct build_library_copy copy = {.options = input->options};
    enum bvhd_status status = prepare(input, index, &limits, context, &copy.canonical, error);
    if (status != BVHD_OK)
        return status;
    copy.options.quality = tier_resolve(&copy.canonical, &input->options);
    status = content_key(&copy.canonical, &copy.options, context, &copy.key, error);
    if (status == BVHD_OK)
        *ret_copy = copy;
    else
        prepare_finish(&copy.canonical, context->memory);
    return status;
}

static void copy_finish(struct build_library_copy *copy, struct memory *memory)
{
    prepare_finish(&copy->canonical, memory);
}

static enum bvhd_status build_copy(const struct build_library_copy *copy, const struct build_context *context,
                                   struct build_stats *ret_stats, struct bvhd_error *error)
{
    unsigned char *blob;
    return build(&copy->canonical, &copy->options, context, &blob, ret_stats, error);
}

const struct build_library *bvhd_build_library(void)
{
    static const struct build_library library = {
        .version = BVHD_BUILD_LIBRARY_VERSION,
        .workers_create = workers_create,
        .workers_destroy = workers_destroy,
        .workers_parallel = workers_parallel,
        .copy_make = copy_make,
        .copy_finish = copy_finish,
        .build = build_copy,
    };
    return &library;
}
