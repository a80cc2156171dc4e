/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/round.h"

#include "builder/format/swept_shape.h"
#include "builder/input/vertex_format.h"
#include "proto/base/checksum.h"
#include "proto/base/place.h"

/*
 * The canonical form names both ends of a primitive by one number, so that the second end must follow the first one.
 * Successive indices say so themselves. The pairs of a list are left as they are if each is a vertex and the next one,
 * as in "0 1, 1 2, 2 3"; other lists are gathered: primitive i gets the vertices 2i and 2i + 1 of its own. Which of
 * both holds is known when all indices have been read; until then, they are kept beside the block.
 */

/* Vertices that are one task for a thread. */
enum { CHUNK = 4096 };

static const struct round_rules rules = {
    .indices_given = BVHD_VUID_11826,
    .indices = BVHD_VUID_11827,
    .vertices = BVHD_VUID_11828,
    .radii = BVHD_VUID_11829,
    .negative = BVHD_VUID_10426,
};

static const uint32_t both_caps = CANONICAL_CAP_FIRST | CANONICAL_CAP_SECOND;

static bool has_indices(const struct geometry *geometry)
{
    return geometry->swept_spheres.ends.index_type != INDEX_NONE;
}

static bool is_successive(const struct geometry *geometry)
{
    return has_indices(geometry) && geometry->swept_spheres.indexing_mode == SWEPT_SUCCESSIVE;
}

/* Returns how many indices, or else vertices, a primitive takes. */
static uint32_t per_primitive(const struct geometry *geometry)
{
    return is_successive(geometry) ? 1 : 2;
}

static enum bvhd_status check_memory(const struct validate_subject *subject)
{
    const struct geometry_swept_spheres *swept = &subject->geometry->swept_spheres;
    if (subject->geometry->range.primitive_count > 0 && swept->indexing_mode == SWEPT_SUCCESSIVE &&
        !swept->ends.indices.data)
        return bvhd_error_rule(subject->error, BVHD_VUID_10427,
                               VALIDATE_GEOMETRY_PLACE(subject, "linearSweptSpheres.indexData"),
                               "it is NULL, but indexingMode is SUCCESSIVE");
    return round_check_memory(subject, &rules, per_primitive(subject->geometry));
}

static void describe(const struct geometry *geometry, bool is_update, struct form_geometry *row)
{
    row->indexed = row->primitive_count > 0;
    round_describe(geometry, is_update, row);
    if (!is_update)
        return;
    row->swept_modes |= geometry->swept_spheres.indexing_mode == SWEPT_SUCCESSIVE ? FORM_SWEPT_SUCCESSIVE : 0;
    row->swept_modes |= geometry->swept_spheres.end_caps_mode == SWEPT_CAPS_CHAINED ? FORM_SWEPT_CHAINED : 0;
}

static bool update_is_sound(const struct form_geometry *row)
{
    const bool is_named = row->indexed && row->index_type != INDEX_NONE;
    return row->update == FORM_UPDATE_RECORDED && row->max_vertex == 0 &&
           row->swept_modes <= (FORM_SWEPT_SUCCESSIVE | FORM_SWEPT_CHAINED) &&
           !((row->swept_modes & FORM_SWEPT_SUCCESSIVE) && row->index_type == INDEX_NONE) &&
           (is_named || row->lowest_index == 0) && vertex_format_find(row->vertex_format) &&
           radius_format_find(row->radius_format);
}

static uint64_t scratch(const struct geometry *geometry)
{
    return has_indices(geometry) ? (uint64_t)per_primitive(geometry) * geometry->range.primitive_count : 0;
}

/* A list that is gathered is read as it is first, unless that is more than its pairs have. */
static uint64_t beside(const struct geometry *geometry)
{
    const uint64_t words = scratch(geometry), room = round_room(geometry);
    const bool may_gather = has_indices(geometry) && !is_successive(geometry) && !round_is_one_vertex(geometry);
    return sizeof(uint32_t) * words + (may_gather ? 4 * sizeof(float) * (room < words ? room : words) : 0);
}

static bool are_neighbours(const uint32_t *pairs, uint32_t count)
{
    bool all = true;
    for (uint32_t i = 0; i < count; i++)
        all &= pairs[2 * i + 1] - pairs[2 * i] == 1;
    return all;
}

static void fetch_indices(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    struct fetch_source *source = &fetch->sources[index];
    const uint32_t each = per_primitive(geometry);
    struct fetch_span span = {UINT32_MAX, 0};
    if (!has_indices(geometry))
        return;
    uint32_t *target = source->scratch + (size_t)each * first;
    round_read_indices(geometry, (uint64_t)each * first, (uint64_t)each * count, target);
    fetch_span_grow(target, (size_t)each * count, &span);
    fetch_span_note(&span, source);
    if (each == 1)
        return;
    if (!are_neighbours(target, count))
        atomic_store_explicit(&source->gathers, true, memory_order_relaxed);
    if (fetch_row(fetch, index)->update & FORM_UPDATE_RECORDED) {
        /* The sum does not depend on the order of its parts, and each part's checksum begins with its place. */
        const struct bytes part = {(const unsigned char *)target, (uint64_t)2 * count * sizeof *target};
        atomic_fetch_add_explicit(&source->index_sum, checksum(part, first), memory_order_relaxed);
    }
}

/* Decides whether pairs are gathered, and returns how many vertices the geometry gets. */
static uint64_t count_vertices(const struct geometry *geometry, struct fetch_source *source)
{
    const uint64_t pairs = (uint64_t)2 * geometry->range.primitive_count;
    const bool is_one_vertex = round_is_one_vertex(geometry);
    if (is_one_vertex || !has_indices(geometry)) {
        source->lowest = source->highest = 0;
        source->gathers = false;
        return is_one_vertex ? 2 : pairs;
    }
    const uint64_t span = (uint64_t)source->highest - source->lowest + (is_successive(geometry) ? 2 : 1);
    source->gathers = !is_successive(geometry) && (source->gathers || span > pairs);
    return source->gathers ? pairs : span;
}

static enum bvhd_status finish(struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    struct fetch_source *source = &fetch->sources[index];
    struct form_geometry *row = fetch_row(fetch, index);
    enum bvhd_status status = BVHD_OK;
    if (row->primitive_count == 0)
        return BVHD_OK;
    if (has_indices(geometry))
        status = round_check_named(fetch, index, &rules, source->scratch, scratch(geometry),
                                   is_successive(geometry) ? 2 : 1, error);
    if (status == BVHD_OK)
        status = round_count_vertices(fetch, index, count_vertices(geometry, source), (uint64_t)CANONICAL_END_MASK + 1,
                                      error);
    if (status == BVHD_OK && (row->update & FORM_UPDATE_RECORDED)) {
        const uint64_t sum = source->index_sum;
        row->lowest_index = source->gathers ? (uint32_t)(sum ^ sum >> 32) : source->lowest;
    }
    fetch->must_rebase = true;
    return status;
}

/* Returns the first end of a primitive as the canonical copy numbers it. */
static uint32_t first_end(const struct geometry *geometry, const struct fetch_source *source, uint32_t primitive)
{
    if (round_is_one_vertex(geometry))
        return 0;
    if (!has_indices(geometry) || source->gathers)
        return 2 * primitive;
    return source->scratch[(uint64_t)per_primitive(geometry) * primitive] - source->lowest;
}

/* The first primitive of a chain has both caps, those that continue it have the second one. */
static uint32_t caps_of(const struct geometry *geometry, const struct fetch_source *source, uint32_t primitive)
{
    if (geometry->swept_spheres.end_caps_mode == SWEPT_CAPS_NONE)
        return 0;
    const bool continues = is_successive(geometry) && primitive > 0 &&
                           source->scratch[primitive] == (uint64_t)source->scratch[primitive - 1] + 1;
    return continues ? CANONICAL_CAP_SECOND : both_caps;
}

static void write_indices(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const struct fetch_source *source = &fetch->sources[index];
    uint32_t *target = (uint32_t *)(void *)(fetch->block + fetch_row(fetch, index)->index_offset);
    for (uint32_t i = first; i < first + count; i++)
        target[i] = first_end(geometry, source, i) | caps_of(geometry, source, i);
}

static float *vertices_of(const struct fetch *fetch, uint32_t index)
{
    return (float *)(void *)(fetch->block + fetch_row(fetch, index)->data_offset);
}

static void fetch_vertices(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct fetch_source *source = &fetch->sources[index];
    if (!source->gathers)
        round_read_vertices(fetch, index, (uint64_t)source->lowest + first, count,
                            vertices_of(fetch, index) + (size_t)4 * first);
}

/* A list that is gathered, and its vertices from the lowest to the highest index if they are read together. */
struct gathering {
    struct fetch *fetch;
    uint32_t index;
    float *span;
    uint64_t span_count, count;
};

static void read_chunk(void *context, size_t chunk)
{
    const struct gathering *gathering = context;
    const struct fetch_source *source = &gathering->fetch->sources[gathering->index];
    size_t begin, end;
    parallel_chunk(chunk, CHUNK, gathering->span_count, &begin, &end);
    round_read_vertices(gathering->fetch, gathering->index, (uint64_t)source->lowest + begin, (uint32_t)(end - begin),
                        gathering->span + 4 * begin);
}

/* The indices of the list are the numbers of the vertices in their new order. */
static void copy_chunk(void *context, size_t chunk)
{
    const struct gathering *gathering = context;
    const struct fetch_source *source = &gathering->fetch->sources[gathering->index];
    float *target = vertices_of(gathering->fetch, gathering->index);
    size_t vertex, end;
    for (parallel_chunk(chunk, CHUNK, gathering->count, &vertex, &end); vertex < end; vertex++)
        memcpy(target + 4 * vertex, gathering->span + (size_t)4 * (source->scratch[vertex] - source->lowest),
               4 * sizeof *target);
}

/* Reads the vertices of the list one by one. */
static void pick_chunk(void *context, size_t chunk)
{
    const struct gathering *gathering = context;
    const struct fetch_source *source = &gathering->fetch->sources[gathering->index];
    float *target = vertices_of(gathering->fetch, gathering->index);
    size_t vertex, end;
    for (parallel_chunk(chunk, CHUNK, gathering->count, &vertex, &end); vertex < end; vertex++)
        round_read_vertices(gathering->fetch, gathering->index, source->scratch[vertex], 1, target + 4 * vertex);
}

static bool run(struct gathering *gathering, const struct build_context *context, uint64_t count, parallel_task task)
{
    return parallel_for_until(context->parallel, context->cancel, parallel_chunks(CHUNK, count), task, gathering);
}

static enum bvhd_status report_cancelled(const struct fetch *fetch, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CANCELLED, place("infos[%u]", fetch->index).text, "cancelled");
}

/*
 * To read a span is faster than to read its vertices one by one, some of them several times. But a few pairs may be far
 * apart in an array that many geometries share: time and memory must not grow with what lies between them.
 */
static enum bvhd_status gather(struct fetch *fetch, uint32_t index, const struct build_context *context,
                               struct bvhd_error *error)
{
    const struct fetch_source *source = &fetch->sources[index];
    if (!source->gathers)
        return BVHD_OK;
    struct gathering gathering = {.fetch = fetch,
                                  .index = index,
                                  .span_count = (uint64_t)source->highest - source->lowest + 1,
                                  .count = fetch->view.geometries[index].vertex_count};
    if (gathering.span_count > gathering.count)
        return run(&gathering, context, gathering.count, pick_chunk) ? BVHD_OK : report_cancelled(fetch, error);
    gathering.span = memory_array(context->memory, gathering.span_count, 4 * sizeof *gathering.span);
    if (!gathering.span)
        return bvhd_error_no_memory(error, place("infos[%u].geometries[%u]", fetch->index, index).text,
                                    "no memory for %llu vertices", (unsigned long long)gathering.span_count);
    const bool done = run(&gathering, context, gathering.span_count, read_chunk) &&
                      run(&gathering, context, gathering.count, copy_chunk);
    memory_free(context->memory, gathering.span);
    return done ? BVHD_OK : report_cancelled(fetch, error);
}

static const float *first_of(const struct canonical_geometry *geometry, uint32_t index)
{
    return geometry->positions + (uint64_t)4 * (geometry->indices[index] & CANONICAL_END_MASK);
}

static enum bvhd_status check_contents(const struct canonical_geometry *geometry, uint32_t first, uint32_t count,
                                       uint32_t info, uint32_t index, struct bvhd_error *error)
{
    for (uint32_t i = first; i < first + count; i++) {
        const float *ends = first_of(geometry, i);
        const int end = ends[3] < 0 ? 0 : 1;
        if (ends[4 * end + 3] < 0)
            return bvhd_error_rule(
                error, rules.negative,
                place("infos[%u].geometries[%u].linearSweptSpheres[%u].radii[%d]", info, index, i, end).text,
                "%g is negative", (double)ends[4 * end + 3]);
    }
    return BVHD_OK;
}

static bool has_one_vertex(const struct canonical_geometry *geometry)
{
    return geometry->vertex_count == 2 &&
           memcmp(geometry->positions, geometry->positions + 4, 4 * sizeof *geometry->positions) == 0;
}

/*
 * Returns whether the caps are what the modes give, or one of them where they are not recorded: none anywhere, both
 * everywhere, or those of chains. With strides of 0 both vertices are equal, and nobody knows any more which primitives
 * continued a chain; the first does not.
 */
static bool caps_are_sound(const struct canonical_geometry *geometry, const struct form_geometry *row)
{
    const uint32_t *indices = geometry->indices;
    const bool is_one_vertex = has_one_vertex(geometry);
    bool none = true, both = true, chains = true;
    for (uint32_t i = 0; i < geometry->primitive_count; i++) {
        const uint32_t caps = indices[i] & ~CANONICAL_END_MASK, end = indices[i] & CANONICAL_END_MASK;
        const bool continues = i > 0 && end == (indices[i - 1] & CANONICAL_END_MASK) + 1;
        none &= caps == 0;
        both &= caps == both_caps;
        chains &= caps == (continues ? CANONICAL_CAP_SECOND : both_caps) ||
                  (is_one_vertex && i > 0 && caps == CANONICAL_CAP_SECOND);
    }
    if (row->update == 0)
        return none || both || chains;
    return !(row->swept_modes & FORM_SWEPT_CHAINED) ? none : row->swept_modes & FORM_SWEPT_SUCCESSIVE ? chains : both;
}

/* Returns whether these can be the ends of a list, if they are recorded as such. */
static bool list_is_sound(const struct canonical_geometry *geometry, const struct form_geometry *row)
{
    const uint64_t pairs = (uint64_t)2 * geometry->primitive_count;
    if (row->update == 0 || (row->swept_modes & FORM_SWEPT_SUCCESSIVE))
        return true;
    bool in_order = geometry->vertex_count == pairs;
    for (uint32_t i = 0; row->index_type == INDEX_NONE && in_order && i < geometry->primitive_count; i++)
        in_order = (geometry->indices[i] & CANONICAL_END_MASK) == 2 * i;
    return row->index_type == INDEX_NONE ? in_order || has_one_vertex(geometry) : geometry->vertex_count <= pairs;
}

static enum bvhd_status check_foreign(const struct canonical *canonical, uint32_t index, struct bvhd_error *error)
{
    const struct canonical_geometry *geometry = &canonical->geometries[index];
    uint32_t highest = 0, lowest = UINT32_MAX;
    if (geometry->primitive_count == 0)
        return BVHD_OK;
    if (!geometry->indices)
        return form_corrupt_row(error, index, "indexed", "not 1");
    for (uint32_t i = 0; i < geometry->primitive_count; i++) {
        const uint32_t end = geometry->indices[i] & CANONICAL_END_MASK;
        highest = end > highest ? end : highest;
        lowest = end < lowest ? end : lowest;
    }
    if ((uint64_t)highest + 2 != geometry->vertex_count)
        return form_corrupt_row(error, index, "vertexCount", "not the highest index plus two");
    if (lowest != 0)
        return form_corrupt_row(error, index, "indices", "they do not start at 0");
    if (!list_is_sound(geometry, form_row(canonical, index)))
        return form_corrupt_row(error, index, "indices", "ends that no list has");
    return caps_are_sound(geometry, form_row(canonical, index))
               ? BVHD_OK
               : form_corrupt_row(error, index, "indices", "caps that no mode gives");
}

static struct classification look(const struct canonical *canonical, const struct canonical_geometry *geometry,
                                  uint32_t index)
{
    const float *first = first_of(geometry, index), *second = first + 4;
    const unsigned caps = geometry->indices[index] / CANONICAL_CAP_FIRST;
    struct classification finding = {.box = box_empty()};
    if (classification_has_nan(first, 8))
        return finding;
    const bool is_infinite = classification_has_infinity(first, 8);
    finding.active = true;
    finding.degenerate = !is_infinite && swept_shape_is_nothing(first, second, caps);
    finding.kept = (canonical->flags & BUILD_ALLOW_UPDATE) || !(is_infinite || finding.degenerate);
    finding.box = swept_shape_box(first, second, caps);
    return finding;
}

static uint32_t collect(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t first,
                        uint32_t end, struct classification_counts *counts, struct primitive_ref *refs)
{
    return classification_collect(look, canonical, geometry, first, end, counts, refs);
}

const struct input_kind input_swept_spheres = {
    .version = CANONICAL_VERSION_ROUND,
    .has_radii = true,
    .corners = 2,
    .check_memory = check_memory,
    .describe = describe,
    .update_is_sound = update_is_sound,
    .view = round_view,
    .scratch = scratch,
    .beside = beside,
    .fetch_primitives = fetch_indices,
    .finish = finish,
    .rebase = write_indices,
    .fetch_vertices = fetch_vertices,
    .gather = gather,
    .check_contents = check_contents,
    .check_foreign = check_foreign,
    .look = look,
    .collect = collect,
    .outline = round_outline,
};
