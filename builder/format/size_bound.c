/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/size_bound.h"

#include <stdbool.h>

#include "builder/format/layout.h"
#include "builder/format/micro_triangle.h"
#include "builder/format/record_kind.h"
#include "proto/base/kind.h"

/*
 * Spatial splits add at most two refs to five (spatial_capacity). Below ONE_PIECE refs quality fast makes one piece,
 * all of whose wide nodes except a root over a single leaf have two children or more (method_piece_size).
 */
enum { ADDED_REFS = 2, TO_REFS = 5, ONE_PIECE = 4096 };

static uint64_t max_of(uint64_t a, uint64_t b)
{
    return a > b ? a : b;
}

/*
 * Spatial splits are made by quality high alone, of primitives whose duplicates do no harm (clip_allowed). A build may
 * leave later geometries out, so that the first one decides.
 */
static bool may_split(const struct build_input *input)
{
    const struct geometry *first = input->geometries;
    if (input->geometry_count == 0 || !kind_find(first->type)->can_be_cut)
        return false;
    bool once = (first->flags & GEOMETRY_NO_DUPLICATE_ANY_HIT) && !(first->flags & GEOMETRY_OPAQUE);
    return !once && !(input->flags & (BUILD_LOW_MEMORY | BUILD_ALLOW_UPDATE));
}

static bool may_be(const struct build_input *input, enum build_quality quality)
{
    enum build_quality named = input->options.quality;
    if (named == QUALITY_UNSPECIFIED && (input->flags & BUILD_PREFER_FAST_BUILD))
        named = QUALITY_FAST;
    else if (named == QUALITY_UNSPECIFIED && (input->flags & BUILD_PREFER_FAST_TRACE))
        named = QUALITY_HIGH;
    return named == quality || named == QUALITY_UNSPECIFIED || named == QUALITY_AUTO;
}

/* Returns the type of geometry that decides what the records are: one that moves, if there is such. */
static uint32_t type_of(const struct build_input *input)
{
    uint32_t type = 0;
    for (uint32_t i = 0; i < input->geometry_count; i++)
        if (i == 0 || kind_find(input->geometries[i].type)->moves)
            type = input->geometries[i].type;
    return type;
}

static bool has_micromap(const struct geometry *geometry)
{
    return kind_find(geometry->type)->vulkan_type == GEOMETRY_TRIANGLES && geometry->triangles.micromap.is_given;
}

/* Returns the bytes of the states of triangles with this usage, which may be invalid: its values are bounded. */
static uint64_t states_of(const struct micromap_usage *usage)
{
    const unsigned level = usage->level < MICRO_LEVEL_MAX ? usage->level : MICRO_LEVEL_MAX;
    const enum micro_format format = usage->format == MICRO_2_STATE ? MICRO_2_STATE : MICRO_4_STATE;
    return (uint64_t)usage->count * micro_triangle_bytes(format, level);
}

/* Adds the states of a micromap, none of which may be shared. Those of a bake have the highest level. */
static void count_states(const struct geometry *geometry, struct layout_counts *counts)
{
    const uint32_t triangles = geometry->range.primitive_count;
    if (geometry->type == GEOMETRY_BAKED_MICROMAP) {
        const struct micromap_usage usage = {triangles, geometry->bake.level, geometry->bake.format};
        counts->states += states_of(&usage);
        counts->micromaps = triangles;
        return;
    }
    const struct bytes *usages = &geometry->micromap.usages;
    for (uint64_t at = 0; at + sizeof(struct micromap_usage) <= usages->size; at += sizeof(struct micromap_usage)) {
        struct micromap_usage usage;
        memcpy(&usage, usages->data + at, sizeof usage);
        counts->states += states_of(&usage);
    }
}

static struct layout_counts count(const struct build_input *input)
{
    struct layout_counts counts = {.structure_type = input->type,
                                   .geometry_type = type_of(input),
                                   .geometry_count = input->geometry_count,
                                   .layout_flags = input->options.layout_flags};
    const struct record_kind *kind =
        record_kind_of(record_content_for(counts.structure_type, counts.geometry_type, counts.layout_flags));
    for (uint32_t i = 0; i < input->geometry_count; i++) {
        const struct geometry *geometry = &input->geometries[i];
        counts.primitives += geometry->range.primitive_count;
        if (input->type == STRUCTURE_MICROMAP) {
            count_states(geometry, &counts);
            continue;
        }
        counts.vertices += kind->vertices_most ? kind->vertices_most(geometry) : 0;
        if (has_micromap(geometry)) {
            counts.has_micromaps = true;
            counts.micromaps += geometry->triangles.micromap.micromap != 0;
        }
    }
    return counts;
}

/*
 * A tree over n leaves whose nodes have two children or more has fewer than n nodes. Pieces of quality fast have a wide
 * root each, which may have a single leaf: that makes n more at the most.
 */
uint64_t size_bound(const struct build_input *input)
{
    const struct layout *layout = layout_find(input->options.target);
    struct layout_counts counts = count(input);
    const uint64_t primitives = counts.primitives;
    counts.refs = counts.wide_nodes = primitives;
    uint64_t bound = layout->bound(&counts);
    if (may_be(input, QUALITY_FAST) && primitives > ONE_PIECE) {
        counts.wide_nodes = 2 * primitives;
        bound = max_of(bound, layout->bound(&counts));
    }
    if (may_be(input, QUALITY_HIGH) && may_split(input)) {
        counts.refs = counts.wide_nodes = primitives + primitives * ADDED_REFS / TO_REFS;
        bound = max_of(bound, layout->bound(&counts));
    }
    return bound;
}
