/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/validate.h"

#include <inttypes.h>
#include <math.h>

#include "builder/format/layout.h"
#include "proto/base/parallel.h"
#include "proto/base/place.h"
#include "proto/base/vulkan_name.h"
#include "builder/input/vertex_format.h"

/* The geometry that is being checked. */
struct subject {
    const struct geometry *geometry;
    uint32_t info, index;
    struct bvhd_error *error;
};

#define GEOMETRY_PLACE(subject, field)                                                                                 \
    place("infos[%u].geometries[%u].%s", (subject)->info, (subject)->index, field).text
#define RANGE_PLACE(subject, field) place("ranges[%u][%u].%s", (subject)->info, (subject)->index, field).text

enum { BUILD_MOTION = 0x20 };

/* Build flags that Vulkan defines and bvhd does not implement. */
static const struct {
    uint32_t bit;
    const char *name;
} foreign_flags[] = {
    {BUILD_MOTION, "MOTION"},
    {0x40, "ALLOW_OPACITY_MICROMAP_UPDATE"},
    {0x80, "ALLOW_DISABLE_OPACITY_MICROMAPS"},
    {0x100, "ALLOW_OPACITY_MICROMAP_DATA_UPDATE"},
    {0x200, "ALLOW_DISPLACEMENT_MICROMAP_UPDATE"},
    {0x400, "MICROMAP_LOSSY"},
    {0x1000, "ALLOW_CLUSTER_OPACITY_MICROMAPS"},
};

enum {
    OWN_FLAGS = BUILD_ALLOW_UPDATE | BUILD_ALLOW_COMPACTION | BUILD_PREFER_FAST_TRACE | BUILD_PREFER_FAST_BUILD |
                BUILD_LOW_MEMORY | BUILD_ALLOW_DATA_ACCESS,
    FOREIGN_FLAGS = 0x17e0,
};

/* Values of VkFormat that decide which rule a wrong one breaks, and an index type that triangles may not have. */
enum { FORMAT_LAST_OF_CORE = 184, FORMAT_FIRST_OF_EXTENSIONS = 1000000000, INDEX_UINT8 = 1000265000 };

/* Structure and geometry types that Vulkan defines and bvhd does not implement. */
enum {
    STRUCTURE_OPACITY_MICROMAP = 1000623000,
    GEOMETRY_SPHERES = 1000429004,
    GEOMETRY_LINEAR_SWEPT_SPHERES = 1000429005,
    GEOMETRY_DENSE_TRIANGLES = 1000478000,
    GEOMETRY_MICROMAP = 1000623000,
};

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
    case STRUCTURE_OPACITY_MICROMAP:
        return bvhd_error_set(error, BVHD_UNSUPPORTED, where.text, "opacity micromaps are not built");
    default:
        return bvhd_error_rule(error, BVHD_VUID_BuildGeometryInfo_type_parameter, where.text,
                               "type is %u, which is no VkAccelerationStructureTypeKHR", type);
    }
}

static enum bvhd_status check_flags(uint32_t flags, uint32_t index, struct bvhd_error *error)
{
    struct place where = place("infos[%u].flags", index);
    uint32_t unknown = flags & ~(uint32_t)(OWN_FLAGS | FOREIGN_FLAGS);
    if (unknown)
        return bvhd_error_rule(error, BVHD_VUID_BuildGeometryInfo_flags_parameter, where.text, "unknown bits 0x%x",
                               unknown);
    if (flags & BUILD_PREFER_FAST_TRACE && flags & BUILD_PREFER_FAST_BUILD)
        return bvhd_error_rule(error, BVHD_VUID_03796, where.text,
                               "PREFER_FAST_TRACE and PREFER_FAST_BUILD exclude each other");
    for (size_t i = 0; i < sizeof foreign_flags / sizeof foreign_flags[0]; i++)
        if (flags & foreign_flags[i].bit)
            return bvhd_error_set(error, BVHD_UNSUPPORTED, where.text, "flag %s is not supported",
                                  foreign_flags[i].name);
    return BVHD_OK;
}

static enum bvhd_status check_mode(const struct build_input *input, uint32_t index, struct bvhd_error *error)
{
    struct place where = place("infos[%u].mode", index);
    if (input->mode == MODE_BUILD)
        return BVHD_OK;
    if (input->mode != MODE_UPDATE)
        return bvhd_error_rule(error, BVHD_VUID_04628, where.text, "mode is %u, neither BUILD nor UPDATE", input->mode);
    if (!input->source)
        return bvhd_error_rule(error, BVHD_VUID_04630, place("infos[%u].srcAccelerationStructure", index).text,
                               "srcAccelerationStructure is NULL, but the mode is UPDATE");
    return bvhd_error_set(error, BVHD_UNSUPPORTED, where.text, "this version does not update structures");
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

static enum bvhd_status check_geometry_count(const struct build_input *input, uint32_t index,
                                             const struct limits *limits, struct bvhd_error *error)
{
    struct place where = place("infos[%u].geometryCount", index);
    uint64_t most = limits->max_geometries < LIMIT_MAX_GEOMETRIES ? limits->max_geometries : LIMIT_MAX_GEOMETRIES;
    if (input->type == STRUCTURE_TOP && input->geometry_count != 1)
        return bvhd_error_rule(error, BVHD_VUID_03790, where.text, "a top level has one geometry, not %u",
                               input->geometry_count);
    if (input->geometry_count > most)
        return bvhd_error_rule(error, BVHD_VUID_03793, where.text, "%u geometries, at most %" PRIu64,
                               input->geometry_count, most);
    if (input->geometry_count > 0 && !input->geometries)
        return bvhd_error_rule(error, BVHD_VUID_BuildGeometryInfo_pGeometries_parameter,
                               place("infos[%u].pGeometries", index).text,
                               "pGeometries is NULL, but geometryCount is %u", input->geometry_count);
    return BVHD_OK;
}

static enum bvhd_status check_foreign_geometry(const struct subject *subject)
{
    switch (subject->geometry->type) {
    case GEOMETRY_SPHERES:
    case GEOMETRY_LINEAR_SWEPT_SPHERES:
    case GEOMETRY_DENSE_TRIANGLES:
    case GEOMETRY_MICROMAP:
        return bvhd_error_set(subject->error, BVHD_UNSUPPORTED, GEOMETRY_PLACE(subject, "geometryType"),
                              "%s is not supported", vulkan_name(VULKAN_GEOMETRY_TYPE, subject->geometry->type).text);
    default:
        return bvhd_error_rule(subject->error, BVHD_VUID_Geometry_geometryType_parameter,
                               GEOMETRY_PLACE(subject, "geometryType"),
                               "geometryType is %u, which is no VkGeometryTypeKHR", subject->geometry->type);
    }
}

static enum bvhd_status check_geometry_type(const struct subject *subject, const struct build_input *input)
{
    uint32_t type = subject->geometry->type;
    if (type > GEOMETRY_INSTANCES)
        return check_foreign_geometry(subject);
    if (input->type == STRUCTURE_TOP && type != GEOMETRY_INSTANCES)
        return bvhd_error_rule(subject->error, BVHD_VUID_03789, GEOMETRY_PLACE(subject, "geometryType"),
                               "%s in a top level, which is made of instances", vulkan_geometry_noun(type).text);
    if (input->type == STRUCTURE_BOTTOM && type == GEOMETRY_INSTANCES)
        return bvhd_error_rule(subject->error, BVHD_VUID_03791, GEOMETRY_PLACE(subject, "geometryType"),
                               "instances in a bottom level, which is made of triangles or AABBs");
    if (type != input->geometries[0].type)
        return bvhd_error_rule(subject->error, BVHD_VUID_03792, GEOMETRY_PLACE(subject, "geometryType"),
                               "%s after %s: a bottom level has one type of geometry", vulkan_geometry_noun(type).text,
                               vulkan_geometry_noun(input->geometries[0].type).text);
    return BVHD_OK;
}

static enum bvhd_status check_geometry_flags(const struct subject *subject)
{
    uint32_t unknown = subject->geometry->flags & ~(uint32_t)(GEOMETRY_OPAQUE | GEOMETRY_NO_DUPLICATE_ANY_HIT);
    if (unknown)
        return bvhd_error_rule(subject->error, BVHD_VUID_Geometry_flags_parameter, GEOMETRY_PLACE(subject, "flags"),
                               "unknown bits 0x%x", unknown);
    return BVHD_OK;
}

/* Numbers of extensions may be formats that are newer than this program, those below them are known. */
static enum bvhd_status refuse_format(const struct subject *subject)
{
    uint32_t format = subject->geometry->triangles.vertex_format;
    bool is_format = format <= FORMAT_LAST_OF_CORE || format >= FORMAT_FIRST_OF_EXTENSIONS;
    return bvhd_error_rule(subject->error, is_format ? BVHD_VUID_03797 : BVHD_VUID_TrianglesData_vertexFormat_parameter,
                           GEOMETRY_PLACE(subject, "triangles.vertexFormat"), "vertexFormat is %s, which is no %s",
                           vulkan_name(VULKAN_FORMAT, format).text, is_format ? "format of vertices" : "VkFormat");
}

static enum bvhd_status check_index_type(const struct subject *subject)
{
    uint32_t type = subject->geometry->triangles.index_type;
    if (type == INDEX_NONE || type == INDEX_UINT16 || type == INDEX_UINT32)
        return BVHD_OK;
    return bvhd_error_rule(
        subject->error, type == INDEX_UINT8 ? BVHD_VUID_03798 : BVHD_VUID_TrianglesData_indexType_parameter,
        GEOMETRY_PLACE(subject, "triangles.indexType"), "indexType is %s, none of UINT16, UINT32 and NONE",
        vulkan_name(VULKAN_INDEX_TYPE, type).text);
}

static enum bvhd_status check_triangle_fields(const struct subject *subject, const struct vertex_format *format)
{
    const struct geometry_triangles *triangles = &subject->geometry->triangles;
    if (!format)
        return refuse_format(subject);
    if (triangles->vertex_stride % format->alignment != 0)
        return bvhd_error_rule(subject->error, BVHD_VUID_03735, GEOMETRY_PLACE(subject, "triangles.vertexStride"),
                               "%" PRIu64 " is no multiple of %u, as %s needs", triangles->vertex_stride,
                               format->alignment, format->name);
    if (triangles->vertex_stride > UINT32_MAX)
        return bvhd_error_rule(subject->error, BVHD_VUID_03819, GEOMETRY_PLACE(subject, "triangles.vertexStride"),
                               "%" PRIu64 " is over 2^32 - 1", triangles->vertex_stride);
    return check_index_type(subject);
}

static enum bvhd_status check_triangle_range(const struct subject *subject, const struct vertex_format *format)
{
    const struct geometry_triangles *triangles = &subject->geometry->triangles;
    const struct geometry_range *range = &subject->geometry->range;
    bool indexed = triangles->index_type != INDEX_NONE;
    uint32_t alignment = !indexed ? format->alignment : triangles->index_type == INDEX_UINT16 ? 2 : 4;
    if (range->primitive_offset % alignment != 0)
        return bvhd_error_rule(subject->error, indexed ? BVHD_VUID_03656 : BVHD_VUID_03657,
                               RANGE_PLACE(subject, "primitiveOffset"), "%u is no multiple of %u",
                               range->primitive_offset, alignment);
    if (triangles->transform.data && range->transform_offset % 16 != 0)
        return bvhd_error_rule(subject->error, BVHD_VUID_03658, RANGE_PLACE(subject, "transformOffset"),
                               "%u is no multiple of 16", range->transform_offset);
    uint64_t vertices = (uint64_t)range->first_vertex + (uint64_t)3 * range->primitive_count;
    if (!indexed && range->primitive_count > 0 && vertices - 1 > triangles->max_vertex)
        return bvhd_error_rule(subject->error, BVHD_VUID_10775, RANGE_PLACE(subject, "primitiveCount"),
                               "%u triangles from vertex %u on reach past maxVertex %u", range->primitive_count,
                               range->first_vertex, triangles->max_vertex);
    return BVHD_OK;
}

/* Refuses memory that is not given, or does not hold what the range says. */
static enum bvhd_status refuse_memory(const struct subject *subject, enum bvhd_vuid vuid, const char *field,
                                      const struct bytes *memory, const char *contents)
{
    uint32_t count = subject->geometry->range.primitive_count;
    if (!memory->data)
        return bvhd_error_rule(subject->error, vuid, GEOMETRY_PLACE(subject, field),
                               "%s is NULL, but primitiveCount is %u", field, count);
    return bvhd_error_rule(subject->error, vuid, GEOMETRY_PLACE(subject, field),
                           "%" PRIu64 " bytes do not hold the %s of %u primitives", memory->size, contents, count);
}

/*
 * Checks that the memory of a geometry is there. Vertices that are named by indices are checked once the indices are
 * known.
 */
static enum bvhd_status check_triangle_memory(const struct subject *subject, const struct vertex_format *format)
{
    const struct geometry_triangles *triangles = &subject->geometry->triangles;
    const struct geometry_range *range = &subject->geometry->range;
    bool indexed = triangles->index_type != INDEX_NONE;
    uint64_t last = (uint64_t)range->first_vertex + (uint64_t)3 * range->primitive_count - 1;
    uint64_t index_size = triangles->index_type == INDEX_UINT16 ? 2 : 4;
    if (!triangles->vertices.data || (!indexed && !bytes_reach(triangles->vertices.size, range->primitive_offset,
                                                               triangles->vertex_stride, last, format->size)))
        return refuse_memory(subject, BVHD_VUID_03771, "triangles.vertexData", &triangles->vertices, "vertices");
    if (indexed &&
        (!triangles->indices.data || !bytes_reach(triangles->indices.size, range->primitive_offset, 3 * index_size,
                                                  range->primitive_count - 1, 3 * index_size)))
        return refuse_memory(subject, BVHD_VUID_03772, "triangles.indexData", &triangles->indices, "indices");
    if (triangles->transform.data &&
        !bytes_reach(triangles->transform.size, range->transform_offset, 0, 0, 12 * sizeof(float)))
        return refuse_memory(subject, BVHD_VUID_03773, "triangles.transformData", &triangles->transform, "matrix");
    return BVHD_OK;
}

static enum bvhd_status check_triangles(const struct subject *subject)
{
    const struct vertex_format *format = vertex_format_find(subject->geometry->triangles.vertex_format);
    enum bvhd_status status = check_triangle_fields(subject, format);
    if (status == BVHD_OK)
        status = check_triangle_range(subject, format);
    if (status == BVHD_OK && subject->geometry->range.primitive_count > 0)
        status = check_triangle_memory(subject, format);
    return status;
}

static enum bvhd_status check_aabbs(const struct subject *subject)
{
    const struct geometry_aabbs *aabbs = &subject->geometry->aabbs;
    const struct geometry_range *range = &subject->geometry->range;
    if (aabbs->stride % 8 != 0)
        return bvhd_error_rule(subject->error, BVHD_VUID_03545, GEOMETRY_PLACE(subject, "aabbs.stride"),
                               "%" PRIu64 " is no multiple of 8", aabbs->stride);
    if (aabbs->stride > UINT32_MAX)
        return bvhd_error_rule(subject->error, BVHD_VUID_03820, GEOMETRY_PLACE(subject, "aabbs.stride"),
                               "%" PRIu64 " is over 2^32 - 1", aabbs->stride);
    if (range->primitive_offset % 8 != 0)
        return bvhd_error_rule(subject->error, BVHD_VUID_03659, RANGE_PLACE(subject, "primitiveOffset"),
                               "%u is no multiple of 8", range->primitive_offset);
    if (range->primitive_count > 0 &&
        (!aabbs->boxes.data || !bytes_reach(aabbs->boxes.size, range->primitive_offset, aabbs->stride,
                                            range->primitive_count - 1, 6 * sizeof(float))))
        return refuse_memory(subject, BVHD_VUID_03774, "aabbs.data", &aabbs->boxes, "boxes");
    return BVHD_OK;
}

static enum bvhd_status check_instances(const struct subject *subject)
{
    const struct bytes *records = &subject->geometry->instances.records;
    const struct geometry_range *range = &subject->geometry->range;
    if (range->primitive_offset % 16 != 0)
        return bvhd_error_rule(subject->error, BVHD_VUID_03660, RANGE_PLACE(subject, "primitiveOffset"),
                               "%u is no multiple of 16", range->primitive_offset);
    if (range->primitive_count > 0 &&
        (!records->data || !bytes_reach(records->size, range->primitive_offset, 64, range->primitive_count - 1, 64)))
        return refuse_memory(subject, BVHD_VUID_03778, "instances.data", records, "instances");
    return BVHD_OK;
}

/* Checks the limit, and adds the geometry's primitives to *total. */
static enum bvhd_status check_primitive_count(const struct subject *subject, const struct limits *limits,
                                              uint64_t *total)
{
    bool instances = subject->geometry->type == GEOMETRY_INSTANCES,
         triangles = subject->geometry->type == GEOMETRY_TRIANGLES;
    uint64_t asked = instances ? limits->max_instances : limits->max_primitives;
    uint64_t format_most = instances ? LIMIT_MAX_INSTANCES : LIMIT_MAX_PRIMITIVES;
    uint64_t most = asked < format_most ? asked : format_most;
    /* This cannot overflow: there are at most 2^24 geometries of less than 2^32 primitives. */
    *total += subject->geometry->range.primitive_count;
    if (*total <= most)
        return BVHD_OK;
    enum bvhd_vuid vuid = instances ? BVHD_VUID_03801 : triangles ? BVHD_VUID_03795 : BVHD_VUID_03794;
    return bvhd_error_rule(subject->error, vuid, RANGE_PLACE(subject, "primitiveCount"),
                           "%" PRIu64 " primitives up to here, at most %" PRIu64, *total, most);
}

/* Checks what a geometry is, and how much of it there is. */
static enum bvhd_status check_shape(const struct subject *subject, const struct build_input *input,
                                    const struct limits *limits, uint64_t *total)
{
    enum bvhd_status status = check_geometry_type(subject, input);
    if (status == BVHD_OK)
        status = check_geometry_flags(subject);
    return status == BVHD_OK ? check_primitive_count(subject, limits, total) : status;
}

static enum bvhd_status check_data(const struct subject *subject)
{
    switch (subject->geometry->type) {
    case GEOMETRY_TRIANGLES:
        return check_triangles(subject);
    case GEOMETRY_AABBS:
        return check_aabbs(subject);
    default:
        return check_instances(subject);
    }
}

static enum bvhd_status look_at_cancel(const struct subject *subject, const atomic_bool *cancel)
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
        struct subject subject = {&input->geometries[i], index, i, error};
        status = look_at_cancel(&subject, cancel);
        if (status == BVHD_OK)
            status = check_shape(&subject, input, limits, &total);
    }
    for (uint32_t i = 0; status == BVHD_OK && i < input->geometry_count; i++) {
        struct subject subject = {&input->geometries[i], index, i, error};
        status = look_at_cancel(&subject, cancel);
        if (status == BVHD_OK)
            status = check_data(&subject);
    }
    return status;
}

enum bvhd_status validate_input_until(const struct build_input *input, uint32_t index, const struct limits *limits,
                                      const atomic_bool *cancel, struct bvhd_error *error)
{
    enum bvhd_status status = check_type(input->type, input->flags, index, error);
    if (status == BVHD_OK)
        status = check_flags(input->flags, index, error);
    if (status == BVHD_OK)
        status = check_mode(input, index, error);
    if (status == BVHD_OK)
        status = check_options(&input->options, index, error);
    if (status == BVHD_OK)
        status = check_geometry_count(input, index, limits, error);
    if (status == BVHD_OK)
        status = check_geometries(input, index, limits, cancel, error);
    return status;
}

enum bvhd_status validate_input(const struct build_input *input, uint32_t index, const struct limits *limits,
                                struct bvhd_error *error)
{
    return validate_input_until(input, index, limits, NULL, error);
}
