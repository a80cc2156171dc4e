/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/fetch.h"

#include <math.h>

#include "builder/input/canonical_form.h"
#include "proto/base/place.h"
#include "proto/base/prefix.h"
#include "builder/input/transform.h"
#include "builder/input/validate.h"
#include "builder/input/vertex_format.h"

/*
 * Numbers of items: a chunk is one task for a thread; a block within it is small enough to stay in the first-level
 * cache between two passes over it.
 */
enum {
    PRIMITIVE_CHUNK = 4096,
    VERTEX_CHUNK = 4096,
    INDEX_BLOCK = 4096,
    VERTEX_BLOCK = 2048,
    BOX_BLOCK = 1024,
    RECORD_BLOCK = 256
};

struct fetch_source {
    _Atomic uint32_t lowest, highest; /* indices in use, as in the request */
    bool transformed; /* by a matrix other than the identity */
    float matrix[12];
};

static struct form_geometry *row_of(const struct fetch *fetch, uint32_t geometry)
{
    return (struct form_geometry *)(void *)(fetch->block + sizeof(struct form_header)) + geometry;
}

/*
 * Fills the sources and prefix sums. With millions of rows this takes a while, because the system clears their memory
 * on first use, so it checks the flag. Returns false when cancelled.
 */
static bool list_geometries(struct fetch *fetch, const atomic_bool *cancel)
{
    const struct geometry *geometries = fetch->input->geometries;
    uint32_t primitives = 0;
    for (uint32_t i = 0; i < fetch->view.geometry_count; i++) {
        if (parallel_cancelled_at(cancel, i))
            return false;
        atomic_init(&fetch->sources[i].lowest, UINT32_MAX);
        atomic_init(&fetch->sources[i].highest, 0);
        fetch->sources[i].transformed = false;
        fetch->view.geometries[i] = (struct canonical_geometry){
            .primitive_count = geometries[i].range.primitive_count,
            .first_primitive = primitives,
        };
        primitives += geometries[i].range.primitive_count;
    }
    fetch->view.primitive_count = primitives;
    return true;
}

enum bvhd_status fetch_init(struct fetch *fetch, const struct build_input *input, uint32_t index,
                            const struct build_context *context, struct bvhd_error *error)
{
    uint32_t count = input->geometry_count;
    struct memory *memory = context->memory;
    *fetch = (struct fetch){.input = input, .index = index, .view = {.geometry_count = count}};
    atomic_init(&fetch->first_unknown, UINT32_MAX);
    atomic_init(&fetch->suspect, false);
    if (input->type == STRUCTURE_TOP) {
        enum bvhd_status status = reference_lookup_init(input, index, context, &fetch->lookup, error);
        if (status != BVHD_OK)
            return status;
    }
    fetch->sources = memory_array(memory, count, sizeof *fetch->sources);
    fetch->view.geometries = memory_array(memory, count, sizeof *fetch->view.geometries);
    bool allocated = count == 0 || (fetch->sources && fetch->view.geometries);
    if (allocated && list_geometries(fetch, context->cancel))
        return BVHD_OK;
    memory_free(memory, fetch->view.geometries);
    fetch_finish(fetch, memory);
    if (allocated)
        return bvhd_error_set(error, BVHD_CANCELLED, place("infos[%u]", index).text, "cancelled");
    return bvhd_error_no_memory(error, place("infos[%u].pGeometries", index).text, "no memory for %u geometries",
                                count);
}

void fetch_finish(struct fetch *fetch, struct memory *memory)
{
    memory_free(memory, fetch->sources);
    reference_lookup_finish(&fetch->lookup, memory);
    fetch->sources = NULL;
}

/* Processes a run of items of one geometry. */
typedef void (*run_function)(struct fetch *fetch, uint32_t geometry, uint32_t first, uint32_t count);

static uint32_t first_of(const struct canonical_geometry *geometry, enum form_section section)
{
    return section == FORM_PRIMITIVES ? geometry->first_primitive : geometry->first_vertex;
}

static uint32_t count_of(const struct canonical_geometry *geometry, enum form_section section)
{
    return section == FORM_PRIMITIVES ? geometry->primitive_count : geometry->vertex_count;
}

/* Returns the last geometry whose items start at or before `item`. */
static uint32_t geometry_of(const struct canonical *view, enum form_section section, uint32_t item)
{
    const struct canonical_geometry *geometries = view->geometries;
    const uint32_t *firsts = section == FORM_PRIMITIVES ? &geometries[0].first_primitive : &geometries[0].first_vertex;
    return prefix_find(firsts, sizeof geometries[0], view->geometry_count, item);
}

/*
 * Calls `run` for items [begin, end), which are numbered through over all geometries, cut at the borders of geometries.
 */
static void for_runs(struct fetch *fetch, enum form_section section, size_t begin, size_t end, run_function run)
{
    for (uint32_t i = geometry_of(&fetch->view, section, (uint32_t)begin); begin < end; i++) {
        const struct canonical_geometry *geometry = &fetch->view.geometries[i];
        size_t first = begin - first_of(geometry, section), left = count_of(geometry, section) - first;
        size_t count = left < end - begin ? left : end - begin;
        if (count > 0)
            run(fetch, i, (uint32_t)first, (uint32_t)count);
        begin += count;
    }
}

/*
 * Keeps the compiler from reading the caller's memory again instead of what was stored: the bytes that are checked must
 * be the stored ones.
 */
static void settle(void)
{
    atomic_signal_fence(memory_order_seq_cst);
}

struct index_range {
    uint32_t lowest, highest;
};

static void grow_span(const uint32_t *indices, size_t count, struct index_range *span)
{
    uint32_t lowest = span->lowest, highest = span->highest;
    for (size_t i = 0; i < count; i++) {
        lowest = indices[i] < lowest ? indices[i] : lowest;
        highest = indices[i] > highest ? indices[i] : highest;
    }
    *span = (struct index_range){lowest, highest};
}

static void to_u32(const unsigned char *source, size_t count, uint32_t *ret_indices)
{
    for (size_t i = 0; i < count; i++)
        ret_indices[i] = bytes_get16(source + 2 * i);
}

static void copy_indices(const unsigned char *source, uint32_t type, size_t count, uint32_t *ret_indices,
                         struct index_range *span)
{
    if (type == INDEX_UINT16)
        to_u32(source, count, ret_indices);
    else
        memcpy(ret_indices, source, count * sizeof *ret_indices);
    settle();
    grow_span(ret_indices, count, span);
}

static void raise_to(_Atomic uint32_t *highest, uint32_t value)
{
    uint32_t old = atomic_load_explicit(highest, memory_order_relaxed);
    while (old < value &&
           !atomic_compare_exchange_weak_explicit(highest, &old, value, memory_order_relaxed, memory_order_relaxed))
        ;
}

static void lower_to(_Atomic uint32_t *lowest, uint32_t value)
{
    uint32_t old = atomic_load_explicit(lowest, memory_order_relaxed);
    while (old > value &&
           !atomic_compare_exchange_weak_explicit(lowest, &old, value, memory_order_relaxed, memory_order_relaxed))
        ;
}

static void fetch_indices(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const struct geometry_triangles *triangles = &geometry->triangles;
    const struct form_geometry *row = row_of(fetch, index);
    if (!row->indexed)
        return;
    uint32_t *target = (uint32_t *)(void *)(fetch->block + row->index_offset) + (size_t)3 * first;
    size_t total = (size_t)3 * count;
    if (triangles->index_type == INDEX_NONE) { /* indexed without indices: a stride of 0 */
        memset(target, 0, total * sizeof *target);
        return;
    }
    size_t size = triangles->index_type == INDEX_UINT16 ? 2 : 4;
    const unsigned char *source = triangles->indices.data + geometry->range.primitive_offset + (size_t)3 * first * size;
    struct index_range span = {UINT32_MAX, 0};
    for (size_t at = 0; at < total; at += INDEX_BLOCK) {
        size_t some = total - at < INDEX_BLOCK ? total - at : INDEX_BLOCK;
        copy_indices(source + at * size, triangles->index_type, some, target + at, &span);
    }
    lower_to(&fetch->sources[index].lowest, span.lowest);
    raise_to(&fetch->sources[index].highest, span.highest);
}

static void copy_strided(const unsigned char *source, uint64_t stride, size_t count, float *ret_boxes)
{
    if (stride == 6 * sizeof(float)) {
        memcpy(ret_boxes, source, count * stride);
        return;
    }
    for (size_t i = 0; i < count; i++)
        memcpy(ret_boxes + 6 * i, source + i * stride, 6 * sizeof(float));
}

/* A box with a NaN anywhere is inactive; the copy says so by a NaN minimum x. */
static void mark_inactive(float *boxes, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        float *box = boxes + 6 * i;
        bool all_numbers = !isnan(box[1]) & !isnan(box[2]) & !isnan(box[3]) & !isnan(box[4]) & !isnan(box[5]);
        if (!all_numbers && !isnan(box[0]))
            box[0] = transform_nan();
    }
}

/*
 * True when minimum <= maximum on each axis of every box, so that there is no NaN. Nearly all boxes are so, and need no
 * further check.
 */
static bool are_ordinary(const float *boxes, size_t count)
{
    bool ordinary = true;
    for (size_t i = 0; i < count; i++, boxes += 6)
        ordinary &= (boxes[0] <= boxes[3]) & (boxes[1] <= boxes[4]) & (boxes[2] <= boxes[5]);
    return ordinary;
}

static void fetch_boxes(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    uint64_t stride = geometry->aabbs.stride;
    const unsigned char *source = geometry->aabbs.boxes.data + geometry->range.primitive_offset + first * stride;
    float *target = (float *)(void *)(fetch->block + row_of(fetch, index)->data_offset) + (size_t)6 * first;
    for (uint32_t at = 0; at < count; at += BOX_BLOCK) {
        uint32_t some = count - at < BOX_BLOCK ? count - at : BOX_BLOCK;
        float *boxes = target + (size_t)6 * at;
        copy_strided(source + at * stride, stride, some, boxes);
        settle();
        if (are_ordinary(boxes, some))
            continue;
        mark_inactive(boxes, some);
        if (!validate_boxes(boxes, some))
            atomic_store_explicit(&fetch->suspect, true, memory_order_relaxed);
    }
}

/*
 * Replaces handles by positions in the caller's table. Stops at the first unknown handle, because then the request
 * fails.
 */
static void look_up(struct fetch *fetch, unsigned char *records, uint32_t first, uint32_t count)
{
    uint64_t last_handle = 0, last_reference = 0;
    for (uint32_t i = 0; i < count; i++) {
        unsigned char *field = records + (size_t)FORM_RECORD_SIZE * i + FORM_RECORD_REFERENCE;
        uint64_t handle = bytes_get64(field);
        if (handle != last_handle) {
            last_handle = handle;
            last_reference = handle ? reference_lookup_find(&fetch->lookup, handle) : 0;
        }
        if (handle && !last_reference) {
            lower_to(&fetch->first_unknown, first + i);
            return;
        }
        bytes_put64(field, last_reference);
    }
}

static void fetch_records(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    size_t begin = (size_t)FORM_RECORD_SIZE * first;
    const unsigned char *source = geometry->instances.records.data + geometry->range.primitive_offset + begin;
    unsigned char *target = fetch->block + row_of(fetch, index)->data_offset + begin;
    for (uint32_t at = 0; at < count; at += RECORD_BLOCK) {
        uint32_t some = count - at < RECORD_BLOCK ? count - at : RECORD_BLOCK;
        unsigned char *records = target + (size_t)FORM_RECORD_SIZE * at;
        memcpy(records, source + (size_t)FORM_RECORD_SIZE * at, (size_t)FORM_RECORD_SIZE * some);
        settle();
        look_up(fetch, records, first + at, some);
        if (!validate_instances(records, some))
            atomic_store_explicit(&fetch->suspect, true, memory_order_relaxed);
    }
}

static void fetch_primitive_run(struct fetch *fetch, uint32_t geometry, uint32_t first, uint32_t count)
{
    switch (fetch->input->geometries[geometry].type) {
    case GEOMETRY_TRIANGLES:
        fetch_indices(fetch, geometry, first, count);
        break;
    case GEOMETRY_AABBS:
        fetch_boxes(fetch, geometry, first, count);
        break;
    default:
        fetch_records(fetch, geometry, first, count);
    }
}

static void primitive_task(void *context, size_t chunk)
{
    struct fetch *fetch = context;
    size_t begin, end;
    parallel_chunk(chunk, PRIMITIVE_CHUNK, fetch->view.primitive_count, &begin, &end);
    for_runs(fetch, FORM_PRIMITIVES, begin, end, fetch_primitive_run);
}

static enum bvhd_status report_index(const struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const uint32_t *indices = (const void *)(fetch->block + row_of(fetch, index)->index_offset);
    uint64_t k = 0;
    while ((uint64_t)geometry->range.first_vertex + indices[k] <= geometry->triangles.max_vertex)
        k++;
    return bvhd_error_rule(
        error, BVHD_VUID_10774,
        place("infos[%u].geometries[%u].triangles.indices[%llu]", fetch->index, index, (unsigned long long)k).text,
        "firstVertex %u + index %u is over maxVertex %u", geometry->range.first_vertex, indices[k],
        geometry->triangles.max_vertex);
}

/*
 * Checks the geometry's indices after all have been read: against maxVertex, and whether the vertices that they name
 * are there.
 */
static enum bvhd_status check_indices(const struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const struct geometry_triangles *triangles = &geometry->triangles;
    if (triangles->index_type == INDEX_NONE)
        /* validate_input has checked these vertices. */
        return BVHD_OK;
    uint64_t last = (uint64_t)geometry->range.first_vertex + fetch->sources[index].highest;
    if (last > triangles->max_vertex)
        return report_index(fetch, index, error);
    if (!bytes_reach(triangles->vertices.size, 0, triangles->vertex_stride, last,
                     vertex_format_find(triangles->vertex_format)->size))
        return bvhd_error_rule(error, BVHD_VUID_03771,
                               place("infos[%u].geometries[%u].triangles.vertexData", fetch->index, index).text,
                               "%llu bytes do not hold vertex %llu", (unsigned long long)triangles->vertices.size,
                               (unsigned long long)last);
    return BVHD_OK;
}

static enum bvhd_status read_transform(struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    struct fetch_source *source = &fetch->sources[index];
    if (!geometry->triangles.transform.data)
        return BVHD_OK;
    memcpy(source->matrix, geometry->triangles.transform.data + geometry->range.transform_offset,
           sizeof source->matrix);
    settle();
    source->transformed = !transform_is_identity(source->matrix);
    if (validate_invertible(source->matrix))
        return BVHD_OK;
    return bvhd_error_rule(error, BVHD_VUID_03799,
                           place("infos[%u].geometries[%u].triangles.transformData", fetch->index, index).text,
                           "the 3x3 part is not invertible");
}

static enum bvhd_status finish_triangles(struct fetch *fetch, uint32_t index, struct bvhd_error *error)
{
    struct canonical_geometry *geometry = &fetch->view.geometries[index];
    struct fetch_source *source = &fetch->sources[index];
    const struct form_geometry *row = row_of(fetch, index);
    if (row->primitive_count == 0)
        return BVHD_OK;
    enum bvhd_status status = check_indices(fetch, index, error);
    if (status == BVHD_OK)
        status = read_transform(fetch, index, error);
    if (status != BVHD_OK)
        return status;
    if (fetch->input->geometries[index].triangles.vertex_stride == 0)
        source->lowest = source->highest = 0;
    if (!row->indexed) {
        source->lowest = 0;
        geometry->vertex_count = 3 * row->primitive_count;
        return BVHD_OK;
    }
    if (source->highest - source->lowest == UINT32_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, place("infos[%u].geometries[%u]", fetch->index, index).text,
                              "2^32 vertices");
    geometry->vertex_count = source->highest - source->lowest + 1;
    return BVHD_OK;
}

static enum bvhd_status finish_primitives(struct fetch *fetch, struct bvhd_error *error)
{
    enum bvhd_status status = BVHD_OK;
    uint64_t vertices = 0;
    if (fetch->first_unknown != UINT32_MAX)
        return bvhd_error_rule(error, BVHD_VUID_03779,
                               place("infos[%u].geometries[0].instances[%u].accelerationStructureReference",
                                     fetch->index, fetch->first_unknown)
                                   .text,
                               "names no known structure");
    for (uint32_t i = 0; status == BVHD_OK && i < fetch->view.geometry_count; i++) {
        fetch->view.geometries[i].first_vertex = (uint32_t)vertices;
        if (fetch->input->geometries[i].type == GEOMETRY_TRIANGLES)
            status = finish_triangles(fetch, i, error);
        vertices += fetch->view.geometries[i].vertex_count;
    }
    if (status == BVHD_OK && vertices > UINT32_MAX)
        return bvhd_error_set(error, BVHD_TOO_LARGE, place("infos[%u]", fetch->index).text, "over 2^32 - 1 vertices");
    fetch->view.vertex_count = (uint32_t)vertices;
    return status;
}

/*
 * Makes indices count from the lowest one in use, because only the span of vertices that a geometry uses is kept: many
 * geometries may share one large array. With a stride of 0 all indices name one vertex.
 */
static void rebase_run(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct form_geometry *row = row_of(fetch, index);
    if (!row->indexed)
        return;
    uint32_t *indices = (uint32_t *)(void *)(fetch->block + row->index_offset) + (size_t)3 * first;
    uint32_t lowest = fetch->sources[index].lowest;
    if (fetch->input->geometries[index].triangles.vertex_stride == 0)
        memset(indices, 0, (size_t)3 * count * sizeof *indices);
    else
        for (size_t i = 0; lowest > 0 && i < (size_t)3 * count; i++)
            indices[i] -= lowest;
}

static void rebase_task(void *context, size_t chunk)
{
    struct fetch *fetch = context;
    size_t begin, end;
    parallel_chunk(chunk, PRIMITIVE_CHUNK, fetch->view.primitive_count, &begin, &end);
    for_runs(fetch, FORM_PRIMITIVES, begin, end, rebase_run);
}

/*
 * Records the lowest index in the rows of updatable geometries. Returns true when some index has to change: where the
 * lowest is not 0, or the stride is.
 */
static bool needs_rebase(struct fetch *fetch)
{
    bool needs = false;
    for (uint32_t i = 0; i < fetch->view.geometry_count; i++) {
        struct form_geometry *row = row_of(fetch, i);
        if (!row->indexed)
            continue;
        uint32_t lowest = fetch->sources[i].lowest;
        if (row->update & FORM_UPDATE_RECORDED)
            row->lowest_index = lowest;
        needs |= lowest > 0 || fetch->input->geometries[i].triangles.vertex_stride == 0;
    }
    return needs;
}

static enum bvhd_status cancelled(const struct fetch *fetch, struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CANCELLED, place("infos[%u]", fetch->index).text, "cancelled");
}

enum bvhd_status fetch_primitives(struct fetch *fetch, unsigned char *block, const struct build_context *context,
                                  struct bvhd_error *error)
{
    size_t count = parallel_chunks(PRIMITIVE_CHUNK, fetch->view.primitive_count);
    fetch->block = block;
    if (!parallel_for_until(context->parallel, context->cancel, count, primitive_task, fetch))
        return cancelled(fetch, error);
    enum bvhd_status status = finish_primitives(fetch, error);
    if (status != BVHD_OK || !needs_rebase(fetch))
        return status;
    return parallel_for_until(context->parallel, context->cancel, count, rebase_task, fetch) ? BVHD_OK
                                                                                             : cancelled(fetch, error);
}

static void fetch_vertex_run(struct fetch *fetch, uint32_t index, uint32_t first, uint32_t count)
{
    const struct geometry *geometry = &fetch->input->geometries[index];
    const struct geometry_triangles *triangles = &geometry->triangles;
    const struct vertex_format *format = vertex_format_find(triangles->vertex_format);
    const struct fetch_source *source = &fetch->sources[index];
    uint64_t stride = triangles->vertex_stride,
             offset = triangles->index_type == INDEX_NONE ? geometry->range.primitive_offset : 0;
    uint64_t vertex = (uint64_t)geometry->range.first_vertex + source->lowest + first;
    const unsigned char *vertices = triangles->vertices.data + offset + stride * vertex;
    float *positions = (float *)(void *)(fetch->block + row_of(fetch, index)->data_offset) + (size_t)3 * first;
    for (uint32_t at = 0; at < count; at += VERTEX_BLOCK) {
        uint32_t some = count - at < VERTEX_BLOCK ? count - at : VERTEX_BLOCK;
        float *target = positions + (size_t)3 * at;
        format->decode(vertices + at * stride, stride, some, target);
        if (source->transformed)
            transform_points(source->matrix, target, some);
    }
}

static void vertex_task(void *context, size_t chunk)
{
    struct fetch *fetch = context;
    size_t begin, end;
    parallel_chunk(chunk, VERTEX_CHUNK, fetch->view.vertex_count, &begin, &end);
    for_runs(fetch, FORM_POSITIONS, begin, end, fetch_vertex_run);
}

enum bvhd_status fetch_positions(struct fetch *fetch, unsigned char *block, const struct build_context *context,
                                 struct bvhd_error *error)
{
    size_t count = parallel_chunks(VERTEX_CHUNK, fetch->view.vertex_count);
    fetch->block = block;
    return parallel_for_until(context->parallel, context->cancel, count, vertex_task, fetch) ? BVHD_OK
                                                                                             : cancelled(fetch, error);
}
