/* SPDX-License-Identifier: Apache-2.0 */
/* kind_baked_micromap.c - opacity micromaps that are made from the alpha of a texture. Vulkan has no rules for them. */
#include <inttypes.h>
#include <math.h>

#include "proto/base/kind_internal.h"
#include "proto/base/place.h"
#include "proto/base/validate_shape.h"

enum { MOST_TEXELS = 16384, MOST_LEVEL = 12, FORMATS = 2 };

/* A field that has a largest value, and a least one. */
struct bound {
    const char *name;
    uint32_t value, least, most;
};

static enum bvhd_status refuse(const struct validate_subject *subject, const char *field, const char *text)
{
    return bvhd_error_set(subject->error, BVHD_INVALID, VALIDATE_GEOMETRY_PLACE(subject, place("bake.%s", field).text),
                          "%s", text);
}

static enum bvhd_status check_bounds(const struct validate_subject *subject)
{
    const struct geometry_bake *bake = &subject->geometry->bake;
    const struct bound bounds[] = {
        {"width", bake->width, 1, MOST_TEXELS},
        {"height", bake->height, 1, MOST_TEXELS},
        {"wrapU", bake->wrap_u, BAKE_REPEAT, BAKE_CLAMP_TO_EDGE},
        {"wrapV", bake->wrap_v, BAKE_REPEAT, BAKE_CLAMP_TO_EDGE},
        {"isNearest", bake->is_nearest, 0, 1},
        {"mode", bake->mode, BAKE_MASK, BAKE_BLEND},
        {"format", bake->format, 1, FORMATS},
        {"level", bake->level == BAKE_LEVEL_AUTO ? 0 : bake->level, 0, MOST_LEVEL},
    };
    for (size_t i = 0; i < sizeof bounds / sizeof *bounds; i++)
        if (bounds[i].value < bounds[i].least || bounds[i].value > bounds[i].most)
            return bvhd_error_set(
                subject->error, BVHD_INVALID, VALIDATE_GEOMETRY_PLACE(subject, place("bake.%s", bounds[i].name).text),
                "%" PRIu32 " is not one of %" PRIu32 " to %" PRIu32, bounds[i].value, bounds[i].least, bounds[i].most);
    return BVHD_OK;
}

static enum bvhd_status check_shape(const struct validate_subject *subject)
{
    const struct geometry_bake *bake = &subject->geometry->bake;
    enum bvhd_status status = check_bounds(subject);
    if (status != BVHD_OK)
        return status;
    if (bake->mode == BAKE_MASK && !(bake->cutoff >= 0 && bake->cutoff <= 1))
        return refuse(subject, "cutoff", "it is not between 0 and 1");
    if (bake->index_type != INDEX_NONE && bake->index_type != INDEX_UINT16 && bake->index_type != INDEX_UINT32)
        return refuse(subject, "indexType", "it is none of UINT16, UINT32 and NONE");
    if (!subject->ignores_strides && (bake->row_stride > UINT32_MAX || bake->row_stride < bake->width))
        return refuse(subject, "rowStride", "it is less than a row of texels, or over 2^32 - 1");
    if (!subject->ignores_strides && (bake->coordinate_stride % 4 != 0 || bake->coordinate_stride > UINT32_MAX))
        return refuse(subject, "coordinateStride", "it is no multiple of 4, or over 2^32 - 1");
    return BVHD_OK;
}

/* A copy has the texels, and the coordinates that are in use. */
static uint64_t vertices(const struct geometry *geometry)
{
    const struct geometry_bake *bake = &geometry->bake;
    return (uint64_t)bake->width * bake->height + (uint64_t)8 * bake->vertex_count;
}

const struct kind kind_baked_micromap = {
    .type = GEOMETRY_BAKED_MICROMAP,
    .vulkan_type = GEOMETRY_MICROMAP,
    .number = KIND_BAKED_MICROMAP,
    .noun = "baked opacity micromaps",
    .member = "bake",
    .is_micromap = true,
    .too_many = BVHD_VUID_NONE,
    .primitive_bytes = 3 * sizeof(uint32_t),
    .vertex_bytes = 1,
    .check_shape = check_shape,
    .vertices = vertices,
};
