/* SPDX-License-Identifier: Apache-2.0 */
#include "client/format.h"

#include <string.h>

#include "builder/format/layout.h"
#include "client/argument.h"
#include "proto/base/place.h"

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

/* The name of a target, or its number. */
static struct place name_of(enum bvhd_target target)
{
    const char *name = bvhd_target_name(target);
    return name ? place("%s", name) : place("%u", (unsigned)target);
}

static enum bvhd_status check_format(const struct bvhd_format *format, enum bvhd_target target,
                                     struct bvhd_error *error)
{
    const struct layout *layout = layout_find((enum target)target);
    if (!format)
        return is_native((enum target)target) ? bvhd_error_set(error, BVHD_INVALID, "build.format",
                                                               "build.format is NULL, but target %s needs the device's "
                                                               "format",
                                                               name_of(target).text)
                                              : BVHD_OK;
    enum bvhd_status status =
        argument_check_size(format, sizeof *format, sizeof *format, "build.format", "bvhd_format", error);
    if (status != BVHD_OK)
        return status;
    if (format->target != target)
        return bvhd_error_set(error, BVHD_INVALID, "build.format", "the format is of target %s, the build's is %s",
                              name_of(format->target).text, name_of(target).text);
    if (layout && layout->variants == 0)
        return bvhd_error_set(error, BVHD_INVALID, "build.format",
                              "target %s is that of no device, and takes no format", layout->name);
    if (layout && (format->variant == 0 || format->variant > layout->variants))
        return bvhd_error_set(error, BVHD_INVALID, "build.format.variant", "%s has no variant %u", layout->name,
                              format->variant);
    return BVHD_OK;
}

static enum bvhd_builder builder_of(const struct bvhd_build *build)
{
    return build->struct_size > FORMAT_BUILD_BUILDERLESS ? build->builder : BVHD_BUILDER_OWN;
}

/* Refuses numbers that no version of this header has given a meaning. */
static enum bvhd_status check_numbers(const struct bvhd_build *build, enum bvhd_target target, struct bvhd_error *error)
{
    const struct layout *layout = layout_find((enum target)target);
    uint32_t unknown = layout ? build->layout_flags & ~layout->flags : 0;
    float rays = build->struct_size > FORMAT_BUILD_RAYLESS ? build->rays_per_primitive : 0;
    if ((unsigned)build->quality > BVHD_QUALITY_AUTO)
        return bvhd_error_set(error, BVHD_INVALID, "build.quality", "%u is no value of enum bvhd_quality",
                              (unsigned)build->quality);
    if (build->priority < BVHD_PRIORITY_LOW || build->priority > BVHD_PRIORITY_HIGH)
        return bvhd_error_set(error, BVHD_INVALID, "build.priority", "%d is no value of enum bvhd_priority",
                              (int)build->priority);
    if (unknown)
        return bvhd_error_set(error, BVHD_INVALID, "build.layout_flags", "target %s has no bits 0x%x", layout->name,
                              unknown);
    if (builder_of(build) > BVHD_BUILDER_EMBREE)
        return bvhd_error_set(error, BVHD_INVALID, "build.builder", "%u is no value of enum bvhd_builder",
                              (unsigned)builder_of(build));
    if (!__builtin_isfinite(rays) || rays < 0)
        return bvhd_error_set(error, BVHD_INVALID, "build.rays_per_primitive",
                              "it is %g, not a finite number that is at least 0", (double)rays);
    return BVHD_OK;
}

enum bvhd_status format_options(const struct bvhd_build *build, struct build_options *ret_options,
                                struct bvhd_error *error)
{
    const struct bvhd_format *format = format_of(build);
    enum bvhd_target target = build->target ? build->target : format ? format->target : BVHD_TARGET_PORTABLE;
    enum bvhd_status status = check_format(format, target, error);
    if (status == BVHD_OK)
        status = check_numbers(build, target, error);
    if (status != BVHD_OK)
        return status;
    if (build->struct_size > FORMAT_BUILD_BUILDERLESS && build->reserved != 0)
        return bvhd_error_set(error, BVHD_INVALID, "build.reserved", "%u instead of 0", build->reserved);
    struct build_options options = {.quality = (enum build_quality)build->quality,
                                    .target = (enum target)target,
                                    .layout_flags = build->layout_flags,
                                    .builder = (enum build_builder)builder_of(build)};
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

uint32_t format_deadline(const struct bvhd_build *build)
{
    return build->struct_size > FORMAT_BUILD_RAYLESS ? build->deadline_ms : 0;
}
