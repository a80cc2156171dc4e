/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/update_rules.h"

#include <inttypes.h>

#include "builder/update/activity.h"
#include "builder/update/update_kind.h"
#include "proto/base/kind.h"

static const struct update_rule header_rules[] = {
    {BVHD_VUID_03760, offsetof(struct record_header, type), "type"},
    {BVHD_VUID_03759, offsetof(struct record_header, flags), "flags"},
    {BVHD_VUID_03758, offsetof(struct record_header, geometry_count), "geometryCount"},
    {BVHD_VUID_NONE, offsetof(struct record_header, target), "options.target"},
    {BVHD_VUID_NONE, offsetof(struct record_header, layout_flags), "options.layoutFlags"},
};

/* The rules of all geometries about fields. */
static const struct update_rule type_rule = {BVHD_VUID_03761, offsetof(struct record_geometry, type), "geometryType"},
                                geometry_rules[] = {
                                    {BVHD_VUID_03762, offsetof(struct record_geometry, flags), "flags"},
};

static uint32_t field_of(const void *record, const struct update_rule *rule)
{
    return bytes_get32((const unsigned char *)record + rule->offset);
}

static enum bvhd_status report(const struct update_comparison *comparison, const struct update_rule *rule,
                               const char *where, uint32_t before, uint32_t now)
{
    return bvhd_error_rule(comparison->error, rule->vuid, where,
                           "it is %" PRIu32 ", but %" PRIu32 " in the source of the update", now, before);
}

static enum bvhd_status check_header(const struct update_comparison *comparison)
{
    const struct record_header *before = comparison->source->header, *now = comparison->now->header;
    for (size_t i = 0; i < sizeof header_rules / sizeof *header_rules; i++) {
        const struct update_rule *rule = &header_rules[i];
        uint32_t a = field_of(before, rule), b = field_of(now, rule);
        if (a != b)
            return report(comparison, rule, place("infos[%u].%s", comparison->info, rule->name).text, a, b);
    }
    if (memcmp(&before->device, &now->device, sizeof now->device) != 0)
        return bvhd_error_set(comparison->error, BVHD_INVALID, place("infos[%u].options.device", comparison->info).text,
                              "it is another one than that of the source of the update");
    return BVHD_OK;
}

/* Compares the fields of a geometry that `rules` name. */
static enum bvhd_status check_fields(const struct update_comparison *comparison, uint32_t g,
                                     const struct update_rule *rules, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        uint32_t before = field_of(&comparison->source->geometries[g], &rules[i]),
                 now = field_of(&comparison->now->geometries[g], &rules[i]);
        if (before != now)
            return report(comparison, &rules[i], update_place(comparison, g, rules[i].name).text, before, now);
    }
    return BVHD_OK;
}

/* Compares Vulkan's types, which triangles and motion triangles have in common. */
static enum bvhd_status check_type(const struct update_comparison *comparison, uint32_t g)
{
    const uint32_t before = kind_find(comparison->source->geometries[g].type)->vulkan_type,
                   now = kind_find(comparison->now->geometries[g].type)->vulkan_type;
    if (before == now)
        return BVHD_OK;
    return report(comparison, &type_rule, update_place(comparison, g, type_rule.name).text, before, now);
}

static enum bvhd_status check_count(const struct update_comparison *comparison, uint32_t g)
{
    const struct record_geometry *before = &comparison->source->geometries[g], *now = &comparison->now->geometries[g];
    if (before->primitive_count == now->primitive_count)
        return BVHD_OK;
    return bvhd_error_rule(comparison->error, BVHD_VUID_03769,
                           place("ranges[%u][%u].primitiveCount", comparison->info, g).text,
                           "%" PRIu32 " primitives, but the source of the update has %" PRIu32, now->primitive_count,
                           before->primitive_count);
}

static struct record_micromap micromap_of(const struct record *record, uint32_t g)
{
    return record->micromaps ? record->micromaps[g] : (struct record_micromap){.attachment = RECORD_NO_MICROMAP};
}

/* Vulkan has these rules for both extensions, without numbers for host builds. */
static enum bvhd_status check_micromap(const struct update_comparison *comparison, uint32_t g)
{
    const struct record_micromap before = micromap_of(comparison->source, g), now = micromap_of(comparison->now, g);
    if (before.attachment != now.attachment)
        return bvhd_error_set(comparison->error, BVHD_INVALID, update_place(comparison, g, "triangles.micromap").text,
                              "the source of the update has %s",
                              before.attachment == RECORD_NO_MICROMAP ? "none"
                              : before.attachment == RECORD_MICROMAP  ? "a micromap"
                                                                      : "special indices without a micromap");
    if (!key_equal(&before.key, &now.key))
        return bvhd_error_set(comparison->error, BVHD_INVALID,
                              update_place(comparison, g, "triangles.micromap.micromap").text,
                              "not the micromap of the source of the update");
    if (before.index_sum != now.index_sum)
        return bvhd_error_set(comparison->error, BVHD_INVALID,
                              update_place(comparison, g, "triangles.micromap.indexBuffer").text,
                              "other special indices, or triangles of the micromap, than in the source of the update");
    return BVHD_OK;
}

static enum bvhd_status check_geometry(const struct update_comparison *comparison, uint32_t g)
{
    const struct update_kind *kind = update_kind_of(comparison->now->geometries[g].type);
    enum bvhd_status status = check_type(comparison, g);
    if (status == BVHD_OK)
        status = check_fields(comparison, g, geometry_rules, sizeof geometry_rules / sizeof *geometry_rules);
    if (status == BVHD_OK)
        status = check_fields(comparison, g, kind->rules, kind->rule_count);
    if (status == BVHD_OK)
        status = check_count(comparison, g);
    if (status == BVHD_OK)
        status = check_micromap(comparison, g);
    return status == BVHD_OK && kind->check ? kind->check(comparison, g) : status;
}

/*
 * Refuses to make a structure move that stood still, or the other way round, which takes other nodes. Vulkan has no
 * rule about that. Geometries may begin and cease to move where another one moves before and after.
 */
static enum bvhd_status check_motion(const struct update_comparison *comparison)
{
    const bool before = kind_find(record_type_of(comparison->source))->moves,
               now = kind_find(record_type_of(comparison->now))->moves;
    const struct record_geometry *rows = (now ? comparison->now : comparison->source)->geometries;
    uint32_t g = 0;
    if (before == now)
        return BVHD_OK;
    while (!kind_find(rows[g].type)->moves)
        g++;
    return bvhd_error_set(comparison->error, BVHD_UNSUPPORTED, update_place(comparison, g, "triangles.motion").text,
                          now ? "updates do not make a structure move that stood still"
                              : "updates do not make a structure stand still that moved");
}

static uint64_t active_word(const struct record *record, uint64_t word)
{
    const uint32_t primitives = record->header->primitive_count;
    if (record->active)
        return record->active[word];
    return word < primitives / 64 ? UINT64_MAX : (UINT64_C(1) << primitives % 64) - 1;
}

static enum bvhd_status report_activity(const struct update_comparison *comparison, uint32_t primitive)
{
    const struct record_geometry *rows = comparison->now->geometries;
    uint32_t g = 0, index = primitive;
    while (index >= rows[g].primitive_count)
        index -= rows[g++].primitive_count;
    const struct place where =
        place("infos[%u].geometries[%u].%s[%u]", comparison->info, g, kind_find(rows[g].type)->member, index);
    return record_is_active(comparison->now, primitive)
               ? bvhd_error_rule(comparison->error, BVHD_VUID_03663, where.text,
                                 "it is active, but inactive in the source of the update")
               : bvhd_error_rule(comparison->error, BVHD_VUID_03664, where.text,
                                 "it is inactive, but active in the source of the update");
}

static enum bvhd_status check_activity(const struct update_comparison *comparison)
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
    const struct update_comparison comparison = {source, now, index, error};
    enum bvhd_status status = check_header(&comparison);
    for (uint32_t g = 0; status == BVHD_OK && g < now->header->geometry_count; g++)
        status = check_geometry(&comparison, g);
    if (status == BVHD_OK)
        status = check_motion(&comparison);
    return status == BVHD_OK ? check_activity(&comparison) : status;
}

enum bvhd_status update_rules_not_updatable(uint32_t index, struct bvhd_error *error)
{
    return bvhd_error_rule(error, BVHD_VUID_03667, place("infos[%u].srcAccelerationStructure", index).text,
                           "the source of the update was built without ALLOW_UPDATE");
}
