/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/validate_shape.h"

#include <inttypes.h>

#include "proto/base/kind.h"
#include "proto/base/place.h"
#include "proto/base/vulkan_name.h"

/* Build flags that Vulkan defines and bvhd does not implement. */
static const struct {
    uint32_t bit;
    const char *name;
} foreign_flags[] = {
    {0x40, "ALLOW_OPACITY_MICROMAP_UPDATE"},
    {0x80, "ALLOW_DISABLE_OPACITY_MICROMAPS"},
    {0x100, "ALLOW_OPACITY_MICROMAP_DATA_UPDATE"},
    {0x200, "ALLOW_DISPLACEMENT_MICROMAP_UPDATE"},
    {0x400, "MICROMAP_LOSSY"},
    {0x1000, "ALLOW_CLUSTER_OPACITY_MICROMAPS"},
};

enum {
    OWN_FLAGS = BUILD_ALLOW_UPDATE | BUILD_ALLOW_COMPACTION | BUILD_PREFER_FAST_TRACE | BUILD_PREFER_FAST_BUILD |
                BUILD_LOW_MEMORY | BUILD_MOTION | BUILD_ALLOW_DATA_ACCESS,
    FOREIGN_FLAGS = 0x17c0,
    MICROMAP_FLAGS = BUILD_ALLOW_COMPACTION | BUILD_PREFER_FAST_TRACE | BUILD_PREFER_FAST_BUILD | BUILD_MICROMAP_LOSSY,
    TRIANGLE_MICROMAP_FLAGS =
        BUILD_ALLOW_MICROMAP_UPDATE | BUILD_ALLOW_DISABLE_MICROMAPS | BUILD_ALLOW_MICROMAP_DATA_UPDATE,
};

bool validate_micromaps;

/* Structure and geometry types that Vulkan defines and bvhd does not implement. */
enum { GEOMETRY_DENSE_TRIANGLES = 1000478000 };

/* A type that no build may have breaks one rule more together with motion; that rule is the one that is reported. */
static enum bvhd_status refuse_generic(uint32_t flags, uint32_t index, struct bvhd_error *error)
{
    if (flags & BUILD_MOTION)
        return bvhd_error_rule(error, BVHD_VUID_04929, place("infos[%u].flags", index).text,
                               "the flag MOTION excludes the type GENERIC");
    return bvhd_error_rule(error, BVHD_VUID_03654, place("infos[%u].type", index).text,
                           "GENERIC is the type of a structure to create, not to build: it is a top or a bottom level");
}

static enum bvhd_status check_type(uint32_t type, uint32_t flags, uint32_t index, struct bvhd_error *error)
{
    struct place where = place("infos[%u].type", index);
    switch (type) {
    case STRUCTURE_TOP:
    case STRUCTURE_BOTTOM:
        return BVHD_OK;
    case STRUCTURE_GENERIC:
        return refuse_generic(flags, index, error);
    case STRUCTURE_MICROMAP:
        if (validate_micromaps)
            return BVHD_OK;
        return bvhd_error_set(error, BVHD_UNSUPPORTED, where.text, "opacity micromaps are not built");
    default:
        return bvhd_error_rule(error, BVHD_VUID_BuildGeometryInfo_type_parameter, where.text,
                               "type is %u, which is no VkAccelerationStructureTypeKHR", type);
    }
}

/* Checks the flags that are about micromaps, and those that micromaps may have. */
static enum bvhd_status check_micromap_flags(uint32_t type, uint32_t flags, struct place where,
                                             struct bvhd_error *error)
{
    const uint32_t both = BUILD_ALLOW_MICROMAP_UPDATE | BUILD_ALLOW_MICROMAP_DATA_UPDATE;
    if (type == STRUCTURE_MICROMAP && (flags & ~(uint32_t)MICROMAP_FLAGS))
        return bvhd_error_rule(error, BVHD_VUID_11562, where.text, "an opacity micromap has no flags 0x%x",
                               flags & ~(uint32_t)MICROMAP_FLAGS);
    if (type != STRUCTURE_MICROMAP && (flags & BUILD_MICROMAP_LOSSY))
        return bvhd_error_rule(error, BVHD_VUID_11563, where.text, "only opacity micromaps have the flag LOSSY");
    if ((flags & both) == both)
        return bvhd_error_rule(error, BVHD_VUID_11558, where.text,
                               "ALLOW_OPACITY_MICROMAP_UPDATE and ALLOW_OPACITY_MICROMAP_DATA_UPDATE exclude each "
                               "other");
    return BVHD_OK;
}

static enum bvhd_status check_flags(uint32_t type, uint32_t flags, uint32_t index, struct bvhd_error *error)
{
    struct place where = place("infos[%u].flags", index);
    const uint32_t known = validate_micromaps ? TRIANGLE_MICROMAP_FLAGS | BUILD_MICROMAP_LOSSY : 0;
    uint32_t unknown = flags & ~(uint32_t)(OWN_FLAGS | FOREIGN_FLAGS);
    if (unknown)
        return bvhd_error_rule(error, BVHD_VUID_BuildGeometryInfo_flags_parameter, where.text, "unknown bits 0x%x",
                               unknown);
    if (flags & BUILD_PREFER_FAST_TRACE && flags & BUILD_PREFER_FAST_BUILD)
        return bvhd_error_rule(error, BVHD_VUID_03796, where.text,
                               "PREFER_FAST_TRACE and PREFER_FAST_BUILD exclude each other");
    for (size_t i = 0; i < sizeof foreign_flags / sizeof foreign_flags[0]; i++)
        if (flags & foreign_flags[i].bit & ~known)
            return bvhd_error_set(error, BVHD_UNSUPPORTED, where.text, "flag %s is not supported",
                                  foreign_flags[i].name);
    return check_micromap_flags(type, flags, where, error);
}

enum bvhd_status validate_type(uint32_t type, uint32_t flags, uint32_t index, struct bvhd_error *error)
{
    enum bvhd_status status = check_type(type, flags, index, error);
    return status == BVHD_OK ? check_flags(type, flags, index, error) : status;
}

enum bvhd_status validate_geometry_count(uint32_t type, uint32_t count, uint32_t index, const struct limits *limits,
                                         struct bvhd_error *error)
{
    struct place where = place("infos[%u].geometryCount", index);
    uint64_t most = limits->max_geometries < LIMIT_MAX_GEOMETRIES ? limits->max_geometries : LIMIT_MAX_GEOMETRIES;
    if (type == STRUCTURE_TOP && count != 1)
        return bvhd_error_rule(error, BVHD_VUID_03790, where.text, "a top level has one geometry, not %u", count);
    if (type == STRUCTURE_MICROMAP && count != 1)
        return bvhd_error_rule(error, BVHD_VUID_11560, where.text, "an opacity micromap has one geometry, not %u",
                               count);
    if (count > most)
        return bvhd_error_rule(error, BVHD_VUID_03793, where.text, "%u geometries, at most %" PRIu64, count, most);
    return BVHD_OK;
}

static enum bvhd_status check_foreign_geometry(const struct validate_subject *subject)
{
    switch (subject->geometry->type) {
    case GEOMETRY_DENSE_TRIANGLES:
        return bvhd_error_set(subject->error, BVHD_UNSUPPORTED, VALIDATE_GEOMETRY_PLACE(subject, "geometryType"),
                              "%s is not supported", vulkan_name(VULKAN_GEOMETRY_TYPE, subject->geometry->type).text);
    default:
        return bvhd_error_rule(subject->error, BVHD_VUID_Geometry_geometryType_parameter,
                               VALIDATE_GEOMETRY_PLACE(subject, "geometryType"),
                               "geometryType is %u, which is no VkGeometryTypeKHR", subject->geometry->type);
    }
}

static enum bvhd_status check_geometry_type(const struct validate_subject *subject, const struct build_input *input)
{
    const struct kind *kind = kind_find(subject->geometry->type), *first = kind_find(input->geometries[0].type);
    if (!kind)
        return check_foreign_geometry(subject);
    if (kind->is_micromap && !validate_micromaps)
        return bvhd_error_set(subject->error, BVHD_UNSUPPORTED, VALIDATE_GEOMETRY_PLACE(subject, "geometryType"),
                              "%s are not built", kind->noun);
    if (kind->is_micromap != (input->type == STRUCTURE_MICROMAP))
        return bvhd_error_rule(subject->error, kind->is_micromap ? BVHD_VUID_11707 : BVHD_VUID_11561,
                               VALIDATE_GEOMETRY_PLACE(subject, "geometryType"),
                               kind->is_micromap ? "%s in a structure that is none" : "%s in an opacity micromap",
                               kind->noun);
    if (input->type == STRUCTURE_TOP && !kind->is_top)
        return bvhd_error_rule(subject->error, BVHD_VUID_03789, VALIDATE_GEOMETRY_PLACE(subject, "geometryType"),
                               "%s in a top level, which is made of instances", kind->noun);
    if (input->type == STRUCTURE_BOTTOM && kind->is_top)
        return bvhd_error_rule(subject->error, BVHD_VUID_03791, VALIDATE_GEOMETRY_PLACE(subject, "geometryType"),
                               "%s in a bottom level; only top levels are made of them", kind->noun);
    if (kind->vulkan_type != first->vulkan_type)
        return bvhd_error_rule(subject->error, BVHD_VUID_03792, VALIDATE_GEOMETRY_PLACE(subject, "geometryType"),
                               "%s after %s: a bottom level has one type of geometry", kind->noun, first->noun);
    return BVHD_OK;
}

/* A bottom level with the flag MOTION may also have geometry that stands still; a top level has motion instances. */
static enum bvhd_status check_motion(const struct validate_subject *subject, uint32_t flags)
{
    const struct kind *kind = kind_find(subject->geometry->type);
    const bool has_flag = flags & BUILD_MOTION;
    if (kind->moves == has_flag || (has_flag && !kind->is_top))
        return BVHD_OK;
    struct place where = place("infos[%u].flags", subject->info);
    if (!kind->is_top)
        return bvhd_error_rule(subject->error, BVHD_VUID_04955, where.text,
                               "geometries[%u] has %s, which need the flag MOTION", subject->index, kind->noun);
    return bvhd_error_set(subject->error, BVHD_INVALID, where.text,
                          "a top level has motion instances exactly if it "
                          "has the flag MOTION, and this one has %s",
                          kind->noun);
}

static enum bvhd_status check_geometry_flags(const struct validate_subject *subject)
{
    uint32_t unknown = subject->geometry->flags & ~(uint32_t)(GEOMETRY_OPAQUE | GEOMETRY_NO_DUPLICATE_ANY_HIT);
    if (!unknown && subject->geometry->flags != 0 && kind_find(subject->geometry->type)->is_micromap)
        return bvhd_error_set(subject->error, BVHD_INVALID, VALIDATE_GEOMETRY_PLACE(subject, "flags"),
                              "the geometry of an opacity micromap has no flags, and these are 0x%x",
                              subject->geometry->flags);
    if (unknown)
        return bvhd_error_rule(subject->error, BVHD_VUID_Geometry_flags_parameter,
                               VALIDATE_GEOMETRY_PLACE(subject, "flags"), "unknown bits 0x%x", unknown);
    return BVHD_OK;
}

/* Checks the limit, and adds the geometry's primitives to *total. */
static enum bvhd_status check_primitive_count(const struct validate_subject *subject, const struct limits *limits,
                                              uint64_t *total)
{
    const struct kind *kind = kind_find(subject->geometry->type);
    uint64_t asked = kind->is_top ? limits->max_instances : limits->max_primitives;
    uint64_t format_most = kind->is_top ? LIMIT_MAX_INSTANCES : LIMIT_MAX_PRIMITIVES;
    uint64_t most = asked < format_most ? asked : format_most;
    /* This cannot overflow: there are at most 2^24 geometries of less than 2^32 primitives. */
    *total += subject->geometry->range.primitive_count;
    if (*total <= most)
        return BVHD_OK;
    if (kind->too_many == BVHD_VUID_NONE)
        return bvhd_error_set(subject->error, BVHD_TOO_LARGE, VALIDATE_RANGE_PLACE(subject, "primitiveCount"),
                              "%" PRIu64 " %s up to here, at most %" PRIu64, *total, kind->noun, most);
    return bvhd_error_rule(subject->error, kind->too_many, VALIDATE_RANGE_PLACE(subject, "primitiveCount"),
                           "%" PRIu64 " primitives up to here, at most %" PRIu64, *total, most);
}

enum bvhd_status validate_geometry(const struct validate_subject *subject, const struct build_input *input,
                                   const struct limits *limits, uint64_t *total)
{
    enum bvhd_status status = check_geometry_type(subject, input);
    if (status == BVHD_OK)
        status = check_motion(subject, input->flags);
    if (status == BVHD_OK)
        status = check_geometry_flags(subject);
    return status == BVHD_OK ? check_primitive_count(subject, limits, total) : status;
}
