/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/update_rules.h"

#include <inttypes.h>

#include "builder/update/activity.h"
#include "proto/base/place.h"

/* A field that an update must not change. */
struct rule {
    enum bvhd_vuid vuid; /* or BVHD_VUID_NONE: Vulkan has no rule */
    size_t offset; /* of a uint32_t in the header or in the row of a geometry */
    const char *name; /* of the field in places */
};

static const struct rule header_rules[] = {
    {BVHD_VUID_03760, offsetof(struct record_header, type), "type"},
    {BVHD_VUID_03759, offsetof(struct record_header, flags), "flags"},
    {BVHD_VUID_03758, offsetof(struct record_header, geometry_count), "geometryCount"},
    {BVHD_VUID_NONE, offsetof(struct record_header, target), "options.target"},
    {BVHD_VUID_NONE, offsetof(struct record_header, layout_flags), "options.layoutFlags"},
};

/* The rules of all geometries come before those of triangles, whose fields are 0 for other types. */
static const struct rule geometry_rules[] = {
    {BVHD_VUID_03761, offsetof(struct record_geometry, type), "geometryType"},
    {BVHD_VUID_03762, offsetof(struct record_geometry, flags), "flags"},
    {BVHD_VUID_03763, offsetof(struct record_geometry, vertex_format), "triangles.vertexFormat"},
    {BVHD_VUID_03764, offsetof(struct record_geometry, max_vertex), "triangles.maxVertex"},
    {BVHD_VUID_03765, offsetof(struct record_geometry, index_type), "triangles.indexType"},
};

struct comparison {
    const struct record *source, *now;
    uint32_t info;
    struct bvhd_error *error;
};

static uint32_t field_of(const void *record, const struct rule *rule)
{
    return bytes_get32((const unsigned char *)record + rule->offset);
}

static enum bvhd_status report(const struct comparison *comparison, const struct rule *rule, const char *where,
                               uint32_t before, uint32_t now)
{
    return bvhd_error_rule(comparison->error, rule->vuid, where,
                           "it is %" PRIu32 ", but %" PRIu32 " in the source of the update", now, before);
}

static enum bvhd_status check_header(const struct comparison *comparison)
{
    const struct record_header *before = comparison->source->header, *now = comparison->now->header;
    for (size_t i = 0; i < sizeof header_rules / sizeof *header_rules; i++) {
        const struct rule *rule = &header_rules[i];
        uint32_t a = field_of(before, rule), b = field_of(now, rule);
        if (a != b)
            return report(comparison, rule, place("infos[%u].%s", comparison->info, rule->name).text, a, b);
    }
    if (memcmp(&before->device, &now->device, sizeof now->device) != 0)
        return bvhd_error_set(comparison->error, BVHD_INVALID, place("infos[%u].options.device", comparison->info).text,
                              "it is another one than that of the source of the update");
    return BVHD_OK;
}

static struct place place_of(const struct comparison *comparison, uint32_t geometry, const char *field)
{
    return place("infos[%u].geometries[%u].%s", comparison->info, geometry, field);
}

static enum bvhd_status check_transform(const struct comparison *comparison, uint32_t g, uint32_t before, uint32_t now)
{
    const struct place where = place_of(comparison, g, "triangles.transformData");
    if (before == now)
        return BVHD_OK;
    return now ? bvhd_error_rule(comparison->error, BVHD_VUID_03766, where.text,
                                 "a transform, but the source of the update has none")
               : bvhd_error_rule(comparison->error, BVHD_VUID_03767, where.text,
                                 "no transform, but the source of the update has one");
}

/* Returns whether all corners are vertex 0, as they are with a vertex stride of 0, whatever the indices are. */
static bool is_one_vertex(const struct record_geometry *row)
{
    return row->indexed && row->vertex_count == 1 && row->lowest_index == 0;
}

static enum bvhd_status check_indices(const struct comparison *comparison, uint32_t g,
                                      const struct record_geometry *before, const struct record_geometry *now)
{
    if (is_one_vertex(before) != is_one_vertex(now))
        return bvhd_error_set(comparison->error, BVHD_UNSUPPORTED,
                              place_of(comparison, g, "triangles.vertexStride").text,
                              "updates do not change a stride to or from 0");
    if (before->lowest_index == now->lowest_index && before->index_sum == now->index_sum &&
        before->vertex_count == now->vertex_count && before->indexed == now->indexed)
        return BVHD_OK;
    return bvhd_error_rule(comparison->error, BVHD_VUID_03768, place_of(comparison, g, "triangles.indexData").text,
                           "the indices are not those of the source of the update");
}

static enum bvhd_status check_geometry(const struct comparison *comparison, uint32_t g)
{
    const struct record_geometry *before = &comparison->source->geometries[g], *now = &comparison->now->geometries[g];
    for (size_t i = 0; i < sizeof geometry_rules / sizeof *geometry_rules; i++) {
        const struct rule *rule = &geometry_rules[i];
        uint32_t a = field_of(before, rule), b = field_of(now, rule);
        if (a != b)
            return report(comparison, rule, place_of(comparison, g, rule->name).text, a, b);
    }
    if (before->primitive_count != now->primitive_count)
        return bvhd_error_rule(comparison->error, BVHD_VUID_03769,
                               place("ranges[%u][%u].primitiveCount", comparison->info, g).text,
                               "%" PRIu32 " primitives, but the source of the update has %" PRIu32,
                               now->primitive_count, before->primitive_count);
    enum bvhd_status status = check_transform(comparison, g, before->has_transform, now->has_transform);
    return status == BVHD_OK ? check_indices(comparison, g, before, now) : status;
}

static uint64_t active_word(const struct record *record, uint64_t word)
{
    const uint32_t primitives = record->header->primitive_count;
    if (record->active)
        return record->active[word];
    return word < primitives / 64 ? UINT64_MAX : (UINT64_C(1) << primitives % 64) - 1;
}

static enum bvhd_status report_activity(const struct comparison *comparison, uint32_t primitive)
{
    static const char *const names[] = {"triangles", "aabbs", "instances"};
    const struct record_geometry *rows = comparison->now->geometries;
    uint32_t g = 0, index = primitive;
    while (index >= rows[g].primitive_count)
        index -= rows[g++].primitive_count;
    const struct place where =
        place("infos[%u].geometries[%u].%s[%u]", comparison->info, g, names[rows[g].type], index);
    return record_is_active(comparison->now, primitive)
               ? bvhd_error_rule(comparison->error, BVHD_VUID_03663, where.text,
                                 "it is active, but inactive in the source of the update")
               : bvhd_error_rule(comparison->error, BVHD_VUID_03664, where.text,
                                 "it is inactive, but active in the source of the update");
}

static enum bvhd_status check_activity(const struct comparison *comparison)
{
    const struct record *source = comparison->source, *now = comparison->now;
    if (!source->active && !now->active)
        return BVHD_OK;
    for (uint64_t word = 0; word < activity_words(now->header->primitive_count); word++) {
        uint64_t changed = active_word(source, word) ^ active_word(now, word);
        if (changed != 0)
            return report_activity(comparison, (uint32_t)(64 * word) + (uint32_t)__builtin_ctzll(changed));
    }
    return BVHD_OK;
}

enum bvhd_status update_rules_check(const struct record *source, const struct record *now, uint32_t index,
                                    struct bvhd_error *error)
{
    const struct comparison comparison = {source, now, index, error};
    enum bvhd_status status = check_header(&comparison);
    for (uint32_t g = 0; status == BVHD_OK && g < now->header->geometry_count; g++)
        status = check_geometry(&comparison, g);
    return status == BVHD_OK ? check_activity(&comparison) : status;
}

enum bvhd_status update_rules_not_updatable(uint32_t index, struct bvhd_error *error)
{
    return bvhd_error_rule(error, BVHD_VUID_03667, place("infos[%u].srcAccelerationStructure", index).text,
                           "the source of the update was built without ALLOW_UPDATE");
}
