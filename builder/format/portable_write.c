/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/format/portable.h"

#include <inttypes.h>

#include "builder/format/portable_head.h"
#include "builder/format/portable_micromap.h"
#include "builder/format/portable_micromaps.h"
#include "builder/format/portable_quantise.h"
#include "builder/format/portable_records.h"
#include "proto/base/prefix.h"

/*
 * Work of some ten microseconds: much more than handing out a task, and little enough that all threads end at about
 * the same time in a structure of 0.1 M triangles.
 */
enum { NODE_CHUNK = 128, PREFETCH_AHEAD = 3, VERTEX_CHUNK = 8192, MARK_CHUNK = 4096 };

struct portable_writer {
    const struct layout_input *input;
    struct portable_header header;
    uint32_t handles;
    uint64_t body_offset;
    unsigned char *blob, *body;
    struct portable_records records;
    bool avx2; /* this machine has AVX2 */
    uint32_t *first_kept; /* for each chunk of vertices: how many are kept before it; at the end their sum */
    uint8_t *used; /* for each vertex: 1 if a record names it */
    uint32_t *remap; /* for each vertex: its new number; NULL if all vertices are kept */
};

static void fill_bounds(const struct ir *ir, float ret_bounds[6])
{
    struct box box = box_empty();
    for (uint32_t key = 0; ir->node_count > 0 && key < ir->key_count; key++)
        box_grow(&box, &ir->boxes[key][0]);
    memcpy(ret_bounds, box.min, sizeof box.min);
    memcpy(ret_bounds + 3, box.max, sizeof box.max);
}

/* Counts are below 2^32 and sizes are small, so that these sums do not overflow. */
static void place_sections(const struct record_kind *kind, struct portable_header *header)
{
    header->node_offset = sizeof *header;
    header->record_offset = header->node_offset + (uint64_t)header->node_count * kind->node_size;
    header->vertex_offset = bytes_align(header->record_offset + (uint64_t)header->record_count * kind->size, 16);
    header->geometry_offset =
        bytes_align(header->vertex_offset + (uint64_t)header->vertex_count * kind->vertex_size, 16);
    header->body_size = header->geometry_offset + (uint64_t)header->geometry_count * sizeof(struct portable_geometry);
    if (header->version == PORTABLE_MICROMAP_VERSION)
        portable_micromaps_place(header);
}

static enum bvhd_status plan(struct portable_writer *w, struct bvhd_error *error)
{
    const struct canonical *canonical = w->input->canonical;
    const struct wide *wide = w->input->wide;
    const enum portable_content content = record_content_of(canonical, w->input->layout_flags);
    const struct record_kind *kind = record_kind_of(content);
    if (canonical->primitive_count > PORTABLE_ID_MASK)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "primitives", "%" PRIu32 " do not fit into 29 bits",
                              canonical->primitive_count);
    if (wide->depth > PORTABLE_MAX_DEPTH)
        return bvhd_error_set(error, BVHD_TOO_LARGE, "depth", "%" PRIu32 " levels of nodes, at most %d", wide->depth,
                              PORTABLE_MAX_DEPTH);
    w->header = (struct portable_header){
        .magic = PORTABLE_MAGIC,
        .version = canonical_has_micromaps(canonical) ? PORTABLE_MICROMAP_VERSION : kind->version,
        .content = content,
        .build_flags = canonical->flags,
        .depth = wide->depth,
        .node_count = wide->node_count,
        .record_count = wide->leaf_refs,
        .vertex_count = kind->vertex_size > 0 ? canonical->vertex_count : 0,
        .geometry_count = record_kind_is_top(content) ? 0 : canonical->geometry_count,
        .primitive_count = canonical->primitive_count,
    };
    fill_bounds(w->input->ir, w->header.bounds);
    portable_micromaps_count(canonical, &w->header);
    place_sections(kind, &w->header);
    w->records = (struct portable_records){.kind = kind, .canonical = canonical};
    w->handles = portable_head_handles(&w->header, canonical);
    w->body_offset = portable_head_body(&w->header, w->handles);
    return BVHD_OK;
}

/* A node's refs in the order of its records. */
struct node_refs {
    uint32_t count;
    uint32_t refs[WIDE_ARITY * PORTABLE_LEAF_MAX + PORTABLE_LEAF_MAX - 1]; /* each step writes leaf_max entries */
};

/* The loop does not branch on the contents of a slot, which are unpredictable; a slot without refs adds none. */
static void gather_refs(const struct portable_writer *w, const struct wide_node *wide, struct node_refs *ret)
{
    uint32_t *next = ret->refs;
    for (unsigned slot = 0; slot < WIDE_ARITY; slot++) {
        const uint32_t *refs = w->input->ir->refs + wide->slots[slot].first_ref;
        uint32_t count = wide->slots[slot].ref_count;
        next[0] = refs[0];
        next[1] = refs[count > 1];
        next[2] = refs[(count > 2) * 2];
        next += count;
    }
    ret->count = (uint32_t)(next - ret->refs);
}

/* Returns all bits set, or none. */
static inline uint32_t mask_of(bool condition)
{
    return 0u - (uint32_t)condition;
}

/* Finds the boxes of a node's slots at one key; an empty slot has that of the ir's node `filler`. */
static inline void find_boxes(const struct box *boxes, const struct wide_node *wide, unsigned occupied, uint32_t filler,
                              const struct box *ret_boxes[WIDE_ARITY])
{
    for (unsigned slot = 0; slot < WIDE_ARITY; slot++) {
        uint32_t own = wide->slots[slot].node; /* 0 in an empty slot */
        ret_boxes[slot] = &boxes[own | (filler & mask_of(!(occupied >> slot & 1)))];
    }
}

/* Fills the boxes of a node. In a structure that moves, the boxes of a tree with one key stand still. */
static void write_boxes(const struct portable_writer *w, const struct wide_node *wide, unsigned occupied,
                        uint32_t filler, struct portable_node *node)
{
    const struct ir *ir = w->input->ir;
    const struct box *boxes[WIDE_ARITY], *end[WIDE_ARITY];
    find_boxes(ir->boxes[0], wide, occupied, filler, boxes);
    if (!record_kind_moves(w->records.kind)) {
        portable_quantise_boxes(boxes, occupied, w->avx2, node);
        return;
    }
    find_boxes(ir->boxes[ir->key_count - 1], wide, occupied, filler, end);
    portable_quantise_moving_boxes(boxes, end, occupied, w->avx2, (struct portable_moving_node *)(void *)node);
}

/*
 * The loops do not branch on the contents of a slot, which are unpredictable. An empty slot takes the box of another
 * one.
 */
static void write_node(const struct portable_writer *w, const struct wide_node *wide, struct portable_node *node)
{
    static const uint8_t unary[] = {0, 0x20, 0x60, 0xe0};
    unsigned occupied = 0, inner = 0, records = 0;
    uint32_t filler = 0;
    uint8_t meta[WIDE_ARITY];
    for (unsigned slot = 0; slot < WIDE_ARITY; slot++) {
        const struct wide_child *child = &wide->slots[slot];
        uint32_t is_leaf = mask_of(child->ref_count != 0), is_there = mask_of((child->ref_count | child->node) != 0);
        uint32_t is_inner = is_there & ~is_leaf;
        meta[slot] = (uint8_t)(unary[child->ref_count] | (records & is_leaf) | ((0x20 | (24 + slot)) & is_inner));
        inner |= (is_inner & 1) << slot;
        occupied |= (is_there & 1) << slot;
        records += child->ref_count;
        filler = (child->node & is_there) | (filler & ~is_there);
    }
    write_boxes(w, wide, occupied, filler, node);
    memcpy(node->meta, meta, sizeof meta);
    node->inner_mask = (uint8_t)inner;
    node->first_child = wide->first_child;
    node->first_record = wide->first_leaf;
}

/*
 * The data of a node are far apart in memory: boxes are in the order of the tree, primitives in the order of the
 * request.
 */
static void prefetch_node(const struct portable_writer *w, const struct wide_node *wide, struct node_refs *ret_refs)
{
    gather_refs(w, wide, ret_refs);
    portable_records_prefetch(&w->records, ret_refs->refs, ret_refs->count);
    for (uint32_t key = 0; key < w->input->ir->key_count; key++)
        for (unsigned slot = 0; slot < WIDE_ARITY; slot++)
            __builtin_prefetch(&w->input->ir->boxes[key][wide->slots[slot].node]);
}

static size_t node_chunks(const struct portable_writer *w)
{
    return parallel_chunks(NODE_CHUNK, w->input->wide->node_count);
}

static void write_nodes(const struct portable_writer *w, size_t index)
{
    const struct wide *wide = w->input->wide;
    size_t begin, end;
    struct node_refs ring[PREFETCH_AHEAD + 1];
    parallel_chunk(index, NODE_CHUNK, wide->node_count, &begin, &end);
    unsigned char *node = w->body + w->header.node_offset + (uint64_t)begin * w->records.kind->node_size;
    for (size_t ahead = begin; ahead < end + PREFETCH_AHEAD; ahead++) {
        if (ahead < end)
            prefetch_node(w, &wide->nodes[ahead], &ring[ahead % (PREFETCH_AHEAD + 1)]);
        if (ahead < begin + PREFETCH_AHEAD)
            continue;
        size_t i = ahead - PREFETCH_AHEAD;
        const struct node_refs *refs = &ring[i % (PREFETCH_AHEAD + 1)];
        portable_records_write(&w->records, wide->nodes[i].first_leaf, refs->refs, refs->count);
        write_node(w, &wide->nodes[i], (struct portable_node *)(void *)node);
        node += w->records.kind->node_size;
    }
}

static uint32_t vertex_chunks(const struct portable_writer *w)
{
    return (uint32_t)parallel_chunks(VERTEX_CHUNK, w->records.canonical->vertex_count);
}

/* Returns how many primitives are read to mark vertices. */
static uint32_t names_to_mark(const struct portable_writer *w)
{
    return w->input->complete ? w->input->canonical->primitive_count : w->input->ir->ref_count;
}

/*
 * Returns the chunk of a task, such that tasks that run at the same time are one thread's share apart. Neighbouring
 * chunks name the same vertices, and processors would contend for the cache lines of their marks.
 */
static size_t chunk_apart(size_t task, size_t chunks, size_t threads)
{
    size_t share = task % threads, longer = chunks % threads;
    return share * (chunks / threads) + (share < longer ? share : longer) + task / threads;
}

static void mark_used(void *context, size_t index)
{
    struct portable_writer *w = context;
    size_t begin, end, names = names_to_mark(w);
    size_t chunk = chunk_apart(index, parallel_chunks(MARK_CHUNK, names), w->input->parallel->threads);
    parallel_chunk(chunk, MARK_CHUNK, names, &begin, &end);
    if (w->input->complete)
        portable_records_mark_range(w->records.kind, w->input->canonical, (uint32_t)begin, (uint32_t)(end - begin),
                                    w->used);
    else
        w->records.kind->mark(w->input->canonical, w->input->ir->refs + begin, (uint32_t)(end - begin), w->used);
}

static void count_kept(void *context, size_t index)
{
    struct portable_writer *w = context;
    size_t begin, end;
    uint32_t kept = 0;
    parallel_chunk(index, VERTEX_CHUNK, w->records.canonical->vertex_count, &begin, &end);
    const uint8_t *used = w->used;
    for (size_t i = begin; i < end; i++)
        kept += used[i];
    w->first_kept[index] = kept;
}

static void sum_kept(struct portable_writer *w)
{
    uint32_t sum = 0, chunks = vertex_chunks(w);
    for (uint32_t i = 0; i < chunks; i++) {
        uint32_t kept = w->first_kept[i];
        w->first_kept[i] = sum;
        sum += kept;
    }
    w->first_kept[chunks] = sum;
}

static void remap_chunk(void *context, size_t index)
{
    struct portable_writer *w = context;
    size_t begin, end;
    parallel_chunk(index, VERTEX_CHUNK, w->records.canonical->vertex_count, &begin, &end);
    const uint8_t *used = w->used;
    uint32_t next = w->first_kept[index];
    for (size_t i = begin; i < end; i++) {
        w->remap[i] = next;
        next += used[i];
    }
}

/* Returns false if cancelled: the following steps then work on incomplete data, which is harmless. */
static bool run_all(struct portable_writer *w, size_t count, parallel_task task)
{
    return parallel_for_until(w->input->parallel, w->input->cancel, count, task, w);
}

static enum bvhd_status report_cancelled(struct bvhd_error *error)
{
    return bvhd_error_set(error, BVHD_CANCELLED, "blob", "cancelled");
}

/* Drops the vertices that no record names; the others keep their order. */
static enum bvhd_status drop_vertices(struct portable_writer *w, uint32_t kept, struct bvhd_error *error)
{
    uint32_t all = w->header.vertex_count;
    w->remap = memory_array(w->input->memory, all, sizeof *w->remap);
    if (!w->remap)
        return bvhd_error_no_memory(error, "vertices", "no memory for %" PRIu32 " new indices", all);
    run_all(w, vertex_chunks(w), remap_chunk);
    w->records.remap = w->remap;
    w->header.vertex_count = kept;
    place_sections(w->records.kind, &w->header);
    return BVHD_OK;
}

static enum bvhd_status plan_vertices(struct portable_writer *w, struct bvhd_error *error)
{
    uint32_t all = w->header.vertex_count, chunks = vertex_chunks(w);
    if (all == 0)
        return BVHD_OK;
    w->used = memory_alloc(w->input->memory, all);
    w->first_kept = memory_array(w->input->memory, (uint64_t)chunks + 1, sizeof *w->first_kept);
    if (!w->used || !w->first_kept)
        return bvhd_error_no_memory(error, "vertices", "no memory for a table of %" PRIu32, all);
    memset(w->used, 0, all);
    run_all(w, parallel_chunks(MARK_CHUNK, names_to_mark(w)), mark_used);
    if (!run_all(w, chunks, count_kept))
        return report_cancelled(error);
    sum_kept(w);
    uint32_t kept = w->first_kept[chunks];
    return kept < all ? drop_vertices(w, kept, error) : BVHD_OK;
}

static enum bvhd_status allocate(struct portable_writer *w, struct bvhd_error *error)
{
    w->blob = output_allocate(w->input->output, w->input->memory, w->body_offset + w->header.body_size, error);
    if (!w->blob)
        return BVHD_NO_MEMORY;
    w->body = w->blob + w->body_offset;
    w->records.records = w->body + w->header.record_offset;
    return BVHD_OK;
}

/* Copies the kept ones among vertices [begin, end) of one geometry to their places. */
static void copy_run(const struct portable_writer *w, const struct canonical_geometry *geometry, size_t begin,
                     size_t end)
{
    if (begin == end)
        return;
    const struct record_kind *kind = w->records.kind;
    unsigned char *to = w->body + w->header.vertex_offset + kind->vertex_size * (w->remap ? w->remap[begin] : begin);
    kind->copy_vertices(geometry, (uint32_t)begin - geometry->first_vertex, (uint32_t)(end - begin),
                        w->remap ? w->used + begin : NULL, (float *)(void *)to);
}

/* Returns the last geometry that starts at or before a vertex; it is never one without vertices. */
static uint32_t geometry_of_vertex(const struct canonical *canonical, size_t vertex)
{
    return prefix_find(&canonical->geometries[0].first_vertex, sizeof canonical->geometries[0],
                       canonical->geometry_count, vertex);
}

static void copy_vertices(const struct portable_writer *w, size_t index)
{
    const struct canonical *canonical = w->records.canonical;
    size_t begin, end;
    parallel_chunk(index, VERTEX_CHUNK, canonical->vertex_count, &begin, &end);
    const struct canonical_geometry *geometry = &canonical->geometries[geometry_of_vertex(canonical, begin)];
    while (begin < end) {
        size_t limit = (size_t)geometry->first_vertex + geometry->vertex_count;
        limit = limit < end ? limit : end;
        copy_run(w, geometry, begin, limit);
        begin = limit;
        geometry++;
    }
}

/* Nodes come first, because their tasks take longer: the threads then finish at about the same time. */
static void write_chunk(void *context, size_t index)
{
    const struct portable_writer *w = context;
    const size_t nodes = node_chunks(w);
    if (index < nodes)
        write_nodes(w, index);
    else
        copy_vertices(w, index - nodes);
}

static void write_tables(const struct portable_writer *w)
{
    const struct canonical *canonical = w->input->canonical;
    const struct portable_header *header = &w->header;
    uint64_t record_end = header->record_offset + (uint64_t)header->record_count * w->records.kind->size;
    uint64_t vertex_end = header->vertex_offset + (uint64_t)header->vertex_count * w->records.kind->vertex_size;
    memset(w->body + record_end, 0, header->vertex_offset - record_end);
    memset(w->body + vertex_end, 0, header->geometry_offset - vertex_end);
    for (uint32_t i = 0; i < header->geometry_count; i++) {
        const struct canonical_geometry *geometry = &canonical->geometries[i];
        struct portable_geometry row = {geometry->flags, geometry->first_primitive, geometry->primitive_count,
                                        portable_micromaps_of(geometry)};
        memcpy(w->body + header->geometry_offset + (uint64_t)i * sizeof row, &row, sizeof row);
    }
    memcpy(w->body, header, sizeof *header);
    portable_micromaps_write(canonical, header, w->body);
}

static enum bvhd_status fill(struct portable_writer *w, struct bvhd_error *error)
{
    size_t copies = w->header.vertex_count > 0 ? parallel_chunks(VERTEX_CHUNK, w->records.canonical->vertex_count) : 0;
    if (!run_all(w, node_chunks(w) + copies, write_chunk))
        return report_cancelled(error);
    write_tables(w);
    portable_head_write(w->blob, &w->header, w->handles);
    return BVHD_OK;
}

static enum bvhd_status portable_write(const struct layout_input *input, unsigned char **ret_blob,
                                       struct layout_sizes *ret_sizes, struct bvhd_error *error)
{
    struct portable_writer w = {.input = input, .avx2 = portable_has_avx2()};
    enum bvhd_status status = plan(&w, error);
    if (status != BVHD_OK)
        return status;
    status = plan_vertices(&w, error);
    if (status == BVHD_OK)
        status = allocate(&w, error);
    if (status == BVHD_OK)
        status = fill(&w, error);
    if (status == BVHD_OK) {
        *ret_blob = w.blob;
        *ret_sizes = portable_head_sizes(&w.header, w.handles);
    } else {
        output_discard(input->output, input->memory, w.blob);
    }
    memory_free(input->memory, w.remap);
    memory_free(input->memory, w.first_kept);
    memory_free(input->memory, w.used);
    return status;
}

static uint32_t portable_version(uint32_t geometry_type)
{
    if (geometry_type == GEOMETRY_BAKED_MICROMAP)
        return 0; /* bakes have no copies yet (input_kind.h) */
    if (geometry_type == GEOMETRY_MICROMAP)
        return PORTABLE_MICROMAP_VERSION;
    return record_kind_of(record_content_for(STRUCTURE_GENERIC, geometry_type, 0))->version;
}

/* The counts are below 2^32, except for vertices, which are below 2^31. */
static uint64_t portable_bound(const struct layout_counts *counts)
{
    const enum portable_content content =
        record_content_for(counts->structure_type, counts->geometry_type, counts->layout_flags);
    const struct record_kind *kind = record_kind_of(content);
    const uint64_t geometries = record_kind_is_top(content) ? 0 : counts->geometry_count;
    if (counts->structure_type == STRUCTURE_MICROMAP)
        return portable_micromap_bound(counts->primitives, counts->states, counts->micromaps);
    return sizeof(struct portable_header) + counts->wide_nodes * kind->node_size +
           bytes_align(counts->refs * kind->size, 16) + bytes_align(counts->vertices * kind->vertex_size, 16) +
           geometries * sizeof(struct portable_geometry) +
           (counts->has_micromaps ? portable_micromaps_bound(counts->micromaps, counts->primitives) : 0);
}

const struct layout layout_portable = {
    .target = TARGET_PORTABLE,
    .name = "portable",
    .version = portable_version,
    .micromap_version = PORTABLE_MICROMAP_VERSION,
    .arity = WIDE_ARITY,
    .leaf_max = PORTABLE_LEAF_MAX,
    .depth_limit = PORTABLE_MAX_DEPTH,
    .flags = PORTABLE_FAST_TRIANGLES,
    .bound = portable_bound,
    .write = portable_write,
    .write_micromap = portable_micromap_write,
};
