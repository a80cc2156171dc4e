/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/validate.h"

#include <inttypes.h>
#include <math.h>

#include "builder/format/layout.h"
#include "builder/input/input_kind.h"
#include "proto/base/kind.h"
#include "proto/base/parallel.h"
#include "proto/base/place.h"
#include "proto/base/validate_shape.h"

static enum bvhd_status check_mode(const struct build_input *input, uint32_t index, struct bvhd_error *error)
{
    struct place where = place("infos[%u].mode", index);
    if (input->mode == MODE_BUILD)
        return BVHD_OK;
    if (input->mode != MODE_UPDATE)
        return bvhd_error_rule(error, BVHD_VUID_04628, where.text, "mode is %u, neither BUILD nor UPDATE", input->mode);
    if (input->type == STRUCTURE_MICROMAP)
        return bvhd_error_set(error, BVHD_INVALID, where.text, "an opacity micromap is built, and never updated");
    if (!input->source)
        return bvhd_error_rule(error, BVHD_VUID_04630, place("infos[%u].srcAccelerationStructure", index).text,
                               "srcAccelerationStructure is NULL, but the mode is UPDATE");
    if (key_is_zero(&input->source_key))
        return bvhd_error_rule(error, BVHD_VUID_04629, place("infos[%u].srcAccelerationStructure", index).text,
                               "srcAccelerationStructure names no structure whose key is known");
    return BVHD_OK;
}

/*
 * Refuses a device where it has no effect, because bytes that decide nothing would give equal structures different
 * keys.
 */
static enum bvhd_status check_device(const struct layout *layout, const struct device_format *device, const char *where,
                                     struct bvhd_error *error)
{
    static const struct device_format none;
    if (layout->variants == 0 && memcmp(device, &none, sizeof none) != 0)
        return bvhd_error_set(error, BVHD_INVALID, where, "target %s is that of no device, and takes no format",
                              layout->name);
    if (layout->variants > 0 && device->variant == 0)
        return bvhd_error_set(error, BVHD_INVALID, where, "target %s needs the device's format", layout->name);
    if (device->variant > layout->variants)
        return bvhd_error_set(error, BVHD_INVALID, where, "%s has no variant %u", layout->name, device->variant);
    return BVHD_OK;
}

static enum bvhd_status check_options(const struct build_options *options, uint32_t index, struct bvhd_error *error)
{
    if ((uint32_t)options->quality > QUALITY_AUTO)
        return bvhd_error_set(error, BVHD_INVALID, place("infos[%u].options.quality", index).text,
                              "quality is %u, which is none of this version", (unsigned)options->quality);
    if (!isfinite(options->rays_per_primitive) || options->rays_per_primitive < 0)
        return bvhd_error_set(error, BVHD_INVALID, place("infos[%u].options.raysPerPrimitive", index).text,
                              "it is %g, not a finite number that is at least 0", (double)options->rays_per_primitive);
    const struct layout *layout = layout_find(options->target);
    if (!layout)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, place("infos[%u].options.target", index).text,
                              "target %u is not known", (unsigned)options->target);
    uint32_t unknown = options->layout_flags & ~layout->flags;
    if (unknown)
        return bvhd_error_set(error, BVHD_INVALID, place("infos[%u].options.layoutFlags", index).text,
                              "target %s has no bits 0x%x", layout->name, unknown);
    return check_device(layout, &options->device, place("infos[%u].options.device", index).text, error);
}

enum bvhd_status validate_refuse_memory(const struct validate_subject *subject, enum bvhd_vuid vuid, const char *field,
                                        const struct bytes *memory, const char *contents)
{
    uint32_t count = subject->geometry->range.primitive_count;
    if (!memory->data)
        return bvhd_error_rule(subject->error, vuid, VALIDATE_GEOMETRY_PLACE(subject, field),
                               "%s is NULL, but primitiveCount is %u", field, count);
    return bvhd_error_rule(subject->error, vuid, VALIDATE_GEOMETRY_PLACE(subject, field),
                           "%" PRIu64 " bytes do not hold the %s of %u primitives", memory->size, contents, count);
}

static enum bvhd_status check_data(const struct validate_subject *subject)
{
    const struct input_kind *kind = input_kind_of(subject->geometry->type);
    enum bvhd_status status = kind_find(subject->geometry->type)->check_shape(subject);
    if (status == BVHD_OK && !kind)
        return bvhd_error_set(subject->error, BVHD_UNSUPPORTED, VALIDATE_GEOMETRY_PLACE(subject, "geometryType"),
                              "%s are not built", kind_find(subject->geometry->type)->noun);
    return status == BVHD_OK ? kind->check_memory(subject) : status;
}

static enum bvhd_status look_at_cancel(const struct validate_subject *subject, const atomic_bool *cancel)
{
    if (!parallel_cancelled_at(cancel, subject->index))
        return BVHD_OK;
    return bvhd_error_set(subject->error, BVHD_CANCELLED, place("infos[%u]", subject->info).text, "cancelled");
}

/* Checks all shapes before any data, so that the data of a request that exceeds a limit is not examined. */
static enum bvhd_status check_geometries(const struct build_input *input, uint32_t index, const struct limits *limits,
                                         const atomic_bool *cancel, struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    uint64_t total = 0;
    for (uint32_t i = 0; status == BVHD_OK && i < input->geometry_count; i++) {
        struct validate_subject subject = {&input->geometries[i], index, i, error, false};
        status = look_at_cancel(&subject, cancel);
        if (status == BVHD_OK)
            status = validate_geometry(&subject, input, limits, &total);
        if (status == BVHD_OK)
            status = layout_check_kind(layout_find(input->options.target), &subject);
    }
    for (uint32_t i = 0; status == BVHD_OK && i < input->geometry_count; i++) {
        struct validate_subject subject = {&input->geometries[i], index, i, error, false};
        status = look_at_cancel(&subject, cancel);
        if (status == BVHD_OK)
            status = check_data(&subject);
    }
    return status;
}

enum bvhd_status validate_input_until(const struct build_input *input, uint32_t index, const struct limits *limits,
                                      const atomic_bool *cancel, struct bvhd_error *error)
{
    enum bvhd_status status = validate_type(input->type, input->flags, index, error);
    if (status == BVHD_OK)
        status = check_mode(input, index, error);
    if (status == BVHD_OK)
        status = check_options(&input->options, index, error);
    if (status == BVHD_OK)
        status = validate_geometry_count(input->type, input->geometry_count, index, limits, error);
    if (status == BVHD_OK && input->geometry_count > 0 && !input->geometries)
        status = bvhd_error_rule(error, BVHD_VUID_BuildGeometryInfo_pGeometries_parameter,
                                 place("infos[%u].pGeometries", index).text,
                                 "pGeometries is NULL, but geometryCount is %u", input->geometry_count);
    if (status == BVHD_OK)
        status = check_geometries(input, index, limits, cancel, error);
    return status;
}

enum bvhd_status validate_input(const struct build_input *input, uint32_t index, const struct limits *limits,
                                struct bvhd_error *error)
{
    return validate_input_until(input, index, limits, NULL, error);
}
