/* SPDX-License-Identifier: Apache-2.0 */
#include "client/format.h"

#include <string.h>

#include "builder/format/layout.h"

const char *bvhd_target_name(enum bvhd_target target)
{
    const struct layout *layout = layout_find((enum target)target);
    return layout ? layout->name : NULL;
}

static const struct bvhd_format *format_of(const struct bvhd_build *build)
{
    return build->struct_size > FORMAT_BUILD_WITHOUT ? build->format : NULL;
}

static bool is_native(enum target target)
{
    const struct layout *layout = layout_find(target);
    return layout && layout->variants > 0;
}

static const char *name_of(enum bvhd_target target)
{
    const char *name = bvhd_target_name(target);
    return name ? name : "one that is not known";
}

static enum bvhd_status check_format(const struct bvhd_format *format, enum bvhd_target target,
                                     struct bvhd_error *error)
{
    if (!format)
        return is_native((enum target)target) ? bvhd_error_set(error, BVHD_INVALID, "build.format",
                                                               "target %s needs the device's format", name_of(target))
                                              : BVHD_OK;
    if (format->struct_size < sizeof *format)
        return bvhd_error_set(error, BVHD_INVALID, "build.format",
                              "struct_size is %zu instead of sizeof(struct bvhd_format)", format->struct_size);
    if (format->target != target)
        return bvhd_error_set(error, BVHD_INVALID, "build.format", "is of target %s, the build's is %s",
                              name_of(format->target), name_of(target));
    return BVHD_OK;
}

enum bvhd_status format_options(const struct bvhd_build *build, struct build_options *ret_options,
                                struct bvhd_error *error)
{
    const struct bvhd_format *format = format_of(build);
    enum bvhd_target target = build->target ? build->target : format ? format->target : BVHD_TARGET_PORTABLE;
    enum bvhd_status status = check_format(format, target, error);
    if (status != BVHD_OK)
        return status;
    if (build->struct_size > FORMAT_BUILD_RAYLESS && build->reserved != 0)
        return bvhd_error_set(error, BVHD_INVALID, "build.reserved", "%u instead of 0", build->reserved);
    struct build_options options = {.quality = (enum build_quality)build->quality,
                                    .target = (enum target)target,
                                    .layout_flags = build->layout_flags};
    if (build->struct_size > FORMAT_BUILD_RAYLESS)
        options.rays_per_primitive = build->rays_per_primitive;
    if (format) {
        options.device.variant = format->variant;
        memcpy(options.device.driver_uuid, format->driver_uuid, sizeof options.device.driver_uuid);
        memcpy(options.device.compatibility_uuid, format->compatibility_uuid, sizeof options.device.compatibility_uuid);
    }
    *ret_options = options;
    return BVHD_OK;
}
