/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/top/scatter.h"

#include <math.h>
#include <string.h>

#include "builder/input/primitive.h"
#include "builder/top/scatter_plan.h"

/* The sample has every SAMPLE_STEP-th ref, or fewer where SAMPLE_MAX refs are enough for the few planes. */
enum { SAMPLE_STEP = 8, SAMPLE_MAX = 16384 };

/*
 * Share of the root's half area from which on a ref counts as outsize: such a ref is met by most rays that meet the
 * root.
 */
static const float outsize_share = 0.5f;

struct scatter {
    const struct split_request *request;
    struct memory *memory;
    const struct parallel *parallel;
    struct scatter_plan plan;
    float outsize; /* half area from which on refs go to the last piece; infinite when none do */
    uint16_t *pieces; /* the piece of each place */
    uint32_t *places; /* for each chunk and piece: first the number of refs, then where the next one goes */
    uint32_t chunk_count, chunk_size; /* a chunk has the refs of one task */
};

/* The range of a chunk's places that hold refs. */
static void chunk_range(const struct scatter *s, size_t chunk, size_t *ret_begin, size_t *ret_end)
{
    const struct split_request *request = s->request;
    if (request->blocks) {
        *ret_begin = chunk * s->chunk_size;
        *ret_end = *ret_begin + request->blocks[chunk];
    } else {
        parallel_chunk(chunk, s->chunk_size, request->count, ret_begin, ret_end);
    }
}

static inline vec4 centroid_of(const struct primitive_ref *ref)
{
    struct vec4_box box = vec4_box_load(ref);
    return vec4_xyz(box.min + box.max);
}

static inline float half_area_of(const struct primitive_ref *ref)
{
    return vec4_box_half_area(vec4_box_load(ref));
}

/* The refs of the sample that come from one chunk. */
struct sample_part {
    uint32_t skip; /* refs of the chunk before the first one that is examined */
    uint32_t at; /* number of refs that are examined in the chunks before; the part begins there in the sample */
    uint32_t count; /* refs that are taken */
};

/* Taking a sample: every step-th ref that is not outsize. */
struct sampling {
    const struct scatter *s;
    uint32_t step;
    float outsize;
    struct primitive_ref *sample, *spare; /* in one block; the spare room is twice as large */
    struct sample_part *parts; /* for each chunk */
};

/* Determines which refs of each chunk are examined. Returns how many those are. */
static uint32_t plan_sample(struct sampling *sampling)
{
    size_t skip = 0, begin, end;
    uint32_t at = 0;
    for (uint32_t chunk = 0; chunk < sampling->s->chunk_count; chunk++) {
        chunk_range(sampling->s, chunk, &begin, &end);
        size_t count = end - begin, examined = skip < count ? (count - skip - 1) / sampling->step + 1 : 0;
        sampling->parts[chunk] = (struct sample_part){.skip = (uint32_t)skip, .at = at};
        at += (uint32_t)examined;
        skip += examined * sampling->step - count;
    }
    return at;
}

static void take_part(void *context, size_t chunk)
{
    const struct sampling *sampling = context;
    struct sample_part *part = &sampling->parts[chunk];
    struct primitive_ref *to = sampling->sample + part->at;
    size_t i, end;
    uint32_t count = 0;
    chunk_range(sampling->s, chunk, &i, &end);
    for (i += part->skip; i < end; i += sampling->step) {
        to[count] = sampling->s->request->refs[i];
        count += half_area_of(&to[count]) < sampling->outsize;
    }
    part->count = count;
}

/* Takes the refs, and closes the gaps that outsize ones have left. Returns how many there are. */
static uint32_t take_sample(struct sampling *sampling)
{
    uint32_t count = 0;
    parallel_for(sampling->s->parallel, sampling->s->chunk_count, take_part, sampling);
    for (uint32_t chunk = 0; chunk < sampling->s->chunk_count; chunk++) {
        const struct sample_part *part = &sampling->parts[chunk];
        if (part->at != count)
            memmove(sampling->sample + count, sampling->sample + part->at, part->count * sizeof *sampling->sample);
        count += part->count;
    }
    return count;
}

/* Takes the sample, without outsize refs if those are few, and finds the planes. */
static void plan_by_sample(struct scatter *s, struct sampling *sampling)
{
    uint32_t size = plan_sample(sampling), count = take_sample(sampling);
    if (size - count > size / 8) {
        s->outsize = sampling->outsize = INFINITY;
        count = take_sample(sampling);
    }
    uint32_t enough = s->request->piece_size / sampling->step;
    scatter_plan_make(sampling->sample, sampling->spare, count, enough > 16 ? enough : 16, s->parallel, &s->plan);
}

static enum bvhd_status find_planes(struct scatter *s)
{
    const struct split_request *request = s->request;
    struct sampling sampling = {.s = s, .step = SAMPLE_STEP, .outsize = s->outsize};
    while (request->count / sampling.step > SAMPLE_MAX)
        sampling.step *= 2;
    uint32_t size = request->count / sampling.step;
    if (size == 0) {
        s->outsize = INFINITY;
        scatter_plan_make(NULL, NULL, 0, 0, s->parallel, &s->plan);
        return BVHD_OK;
    }
    sampling.sample = memory_array(s->memory, 3 * ((uint64_t)size + 1), sizeof *sampling.sample);
    sampling.parts = memory_array(s->memory, s->chunk_count, sizeof *sampling.parts);
    bool has_room = sampling.sample && sampling.parts;
    if (has_room) {
        sampling.spare = sampling.sample + size + 1;
        plan_by_sample(s, &sampling);
    }
    memory_free(s->memory, sampling.sample);
    memory_free(s->memory, sampling.parts);
    return has_room ? BVHD_OK : BVHD_NO_MEMORY;
}

/* Refs that go down the tree of planes together. */
enum { LANES = 8 };

static uint32_t piece_at(const struct scatter *s, vec4 at)
{
    float centroid[4];
    memcpy(centroid, &at, sizeof centroid);
    uint32_t node = 0;
    for (uint32_t level = 0; level < s->plan.levels; level++) {
        const struct scatter_node *n = &s->plan.nodes[node];
        node = n->child + (centroid[n->axis] >= n->threshold);
    }
    return s->plan.nodes[node].piece;
}

/*
 * Does what piece_at does, for LANES refs. Each step of a ref waits for the step before, but not for those of the other
 * refs, so that the processor works on all of them at once.
 */
static void pieces_at(const struct scatter *s, const struct primitive_ref *refs, uint32_t ret_pieces[LANES])
{
    const struct scatter_node *nodes = s->plan.nodes;
    float centroids[LANES][4];
    uint32_t at[LANES] = {0};
    for (uint32_t i = 0; i < LANES; i++) {
        const vec4 centroid = centroid_of(&refs[i]);
        memcpy(centroids[i], &centroid, sizeof centroids[i]);
    }
    for (uint32_t level = 0; level < s->plan.levels; level++)
        for (uint32_t i = 0; i < LANES; i++) {
            const struct scatter_node *n = &nodes[at[i]];
            at[i] = n->child + (centroids[i][n->axis] >= n->threshold);
        }
    for (uint32_t i = 0; i < LANES; i++)
        ret_pieces[i] = nodes[at[i]].piece;
}

static inline bool is_inside(const struct scatter_cell *cell, vec4 at)
{
    return vec4_bits((at >= cell->low) & (at < cell->high)) == 15;
}

static uint32_t *places_of(const struct scatter *s, size_t chunk)
{
    return s->places + chunk * (s->plan.piece_count + 1);
}

/*
 * STEP: refs of one loop. STEP_CHANGES: when fewer refs of a loop went to another piece than the ref before them, the
 * next loop expects neighbours to stay together.
 */
enum { STEP = 256, STEP_CHANGES = STEP / 16 };

/* The result of one loop: the piece of its last ref, and how many refs went to another piece than the ref before. */
struct scatter_carry {
    uint32_t piece, changes;
};

/* Notes the piece of the ref at place i, and counts the ref. */
static inline void assign(const struct scatter *s, size_t i, uint32_t piece, uint32_t *counts)
{
    const uint32_t to = half_area_of(&s->request->refs[i]) < s->outsize ? piece : s->plan.piece_count;
    s->pieces[i] = (uint16_t)to;
    counts[to]++;
}

/* Assigns pieces to places [i, end) where neighbours stay together: the piece of the ref before is tried first. */
static struct scatter_carry assign_together(const struct scatter *s, size_t i, size_t end, uint32_t piece,
                                            uint32_t *counts)
{
    const struct primitive_ref *refs = s->request->refs;
    struct scatter_cell cell = s->plan.cells[piece];
    uint32_t changes = 0;
    for (; i < end; i++) {
        const vec4 at = centroid_of(&refs[i]);
        if (!is_inside(&cell, at)) {
            piece = piece_at(s, at);
            cell = s->plan.cells[piece];
            changes++;
        }
        assign(s, i, piece, counts);
    }
    return (struct scatter_carry){piece, changes};
}

/*
 * Assigns pieces to places [i, end) where neighbours mostly go to different pieces. Trying the piece of the ref before
 * would be an unpredictable branch; going down the tree of planes takes the same number of steps for every ref.
 */
static struct scatter_carry assign_apart(const struct scatter *s, size_t i, size_t end, uint32_t piece,
                                         uint32_t *counts)
{
    uint32_t own[LANES], changes = 0;
    while (i < end) {
        const uint32_t count = end - i < LANES ? 1 : LANES;
        if (count == LANES)
            pieces_at(s, &s->request->refs[i], own);
        else
            own[0] = piece_at(s, centroid_of(&s->request->refs[i]));
        for (uint32_t k = 0; k < count; k++, i++) {
            changes += own[k] != piece;
            piece = own[k];
            assign(s, i, piece, counts);
        }
    }
    return (struct scatter_carry){piece, changes};
}

/*
 * Assigns a chunk, counting on the task's own stack: rows of `places` share cache lines, for which the processors would
 * compete.
 */
static void assign_chunk(void *context, size_t index)
{
    const struct scatter *s = context;
    uint32_t counts[SCATTER_PIECES_MAX + 1] = {0};
    struct scatter_carry step = {0, 0};
    size_t i, end, stop;
    for (chunk_range(s, index, &i, &end); i < end; i = stop) {
        stop = end - i < STEP ? end : i + STEP;
        if (step.changes < STEP_CHANGES)
            step = assign_together(s, i, stop, step.piece, counts);
        else
            step = assign_apart(s, i, stop, step.piece, counts);
    }
    memcpy(places_of(s, index), counts, (s->plan.piece_count + 1) * sizeof *counts);
}

static void move_chunk(void *context, size_t index)
{
    const struct scatter *s = context;
    uint32_t places[SCATTER_PIECES_MAX + 1];
    size_t i, end;
    memcpy(places, places_of(s, index), (s->plan.piece_count + 1) * sizeof *places);
    for (chunk_range(s, index, &i, &end); i < end; i++)
        vec4_box_store(&s->request->scratch[places[s->pieces[i]]++], vec4_box_load(&s->request->refs[i]));
}

/* Turns counts into places; ret_firsts has piece_count + 2 entries. */
static void place_pieces(struct scatter *s, uint32_t *ret_firsts)
{
    uint32_t sum = 0;
    for (uint32_t piece = 0; piece <= s->plan.piece_count; piece++) {
        ret_firsts[piece] = sum;
        for (uint32_t chunk = 0; chunk < s->chunk_count; chunk++) {
            uint32_t *place = &places_of(s, chunk)[piece], count = *place;
            *place = sum;
            sum += count;
        }
    }
    ret_firsts[s->plan.piece_count + 1] = sum;
}

static enum bvhd_status move(struct scatter *s, uint32_t *ret_firsts)
{
    const struct split_request *request = s->request;
    if (!parallel_for_until(s->parallel, request->cancel, s->chunk_count, assign_chunk, s))
        return BVHD_CANCELLED;
    place_pieces(s, ret_firsts);
    return parallel_for_until(s->parallel, request->cancel, s->chunk_count, move_chunk, s) ? BVHD_OK : BVHD_CANCELLED;
}

/* Writes the plan's nodes as nodes of a split tree, from index `at` on. */
static void fill_tree(const struct scatter *s, const uint32_t *firsts, uint32_t at, struct split_node *nodes)
{
    for (uint32_t i = 0; i < s->plan.node_count; i++) {
        const struct scatter_node *node = &s->plan.nodes[i];
        bool leaf = node->child == i;
        nodes[at + i] = (struct split_node){.child = leaf ? 0 : at + node->child};
        if (leaf) {
            nodes[at + i].first = firsts[node->piece];
            nodes[at + i].count = firsts[node->piece + 1] - firsts[node->piece];
        }
    }
}

/*
 * Makes the split tree. With an outsize piece there is one more level, at which it is the sibling of everything else.
 * Children stay in pairs that start at odd indices.
 */
static void make_tree(const struct scatter *s, const uint32_t *firsts, struct split_tree *tree)
{
    const struct split_request *request = s->request;
    uint32_t outsize = firsts[s->plan.piece_count + 1] - firsts[s->plan.piece_count];
    tree->piece_count = s->plan.piece_count;
    tree->node_count = s->plan.node_count;
    if (outsize == 0) {
        fill_tree(s, firsts, 0, tree->nodes);
    } else {
        fill_tree(s, firsts, 2, tree->nodes);
        tree->nodes[1] = tree->nodes[2];
        tree->nodes[2] = (struct split_node){.first = firsts[s->plan.piece_count], .count = outsize};
        tree->nodes[0] = (struct split_node){.child = 1};
        tree->piece_count++;
        tree->node_count += 2;
    }
    tree->nodes[0].bounds = request->bounds;
    tree->nodes[0].first = 0;
    tree->nodes[0].count = request->count;
}

/* Computes the bounds of all refs. Returns false when cancelled. */
static bool bound(struct split_request *request)
{
    enum { LOOK = 8192 }; /* refs between two looks at the cancel flag */
    request->bounds = request->centroids = box_empty();
    for (uint32_t first = 0, count; first < request->count; first += count) {
        struct box bounds, centroids;
        if (parallel_cancelled(request->cancel))
            return false;
        count = request->count - first < LOOK ? request->count - first : LOOK;
        primitive_ref_bounds(request->refs + first, count, &bounds, &centroids);
        box_grow(&request->bounds, &bounds);
        box_grow(&request->centroids, &centroids);
    }
    return true;
}

/* Divides the piece at a node by split_refs, and puts the resulting tree in its place. */
static enum bvhd_status cut_piece(const struct scatter *s, struct split_tree *tree, uint32_t node)
{
    const struct split_node piece = tree->nodes[node];
    struct split_request request = *s->request;
    struct split_tree cut;
    request.refs = s->request->scratch + piece.first;
    request.scratch = s->request->refs + piece.first;
    request.count = piece.count;
    if (!bound(&request))
        return BVHD_CANCELLED;
    enum bvhd_status status = split_refs(&request, s->memory, s->parallel, &cut, NULL);
    if (status != BVHD_OK)
        return status;
    uint64_t count = (uint64_t)tree->node_count + cut.node_count - 1;
    struct split_node *nodes = count > UINT32_MAX ? NULL : memory_resize(s->memory, tree->nodes, count * sizeof *nodes);
    if (nodes) {
        uint32_t shift = tree->node_count - 1;
        tree->nodes = nodes;
        for (uint32_t i = 0; i < cut.node_count; i++) {
            struct split_node *to = &nodes[i ? shift + i : node];
            *to = cut.nodes[i];
            to->first += piece.first;
            to->child += to->child ? shift : 0;
        }
        tree->node_count = (uint32_t)count;
        tree->piece_count += cut.piece_count - 1;
    }
    memory_free(s->memory, cut.nodes);
    return nodes ? BVHD_OK : BVHD_NO_MEMORY;
}

static enum bvhd_status cut_large_pieces(const struct scatter *s, struct split_tree *tree)
{
    enum bvhd_status status = BVHD_OK;
    uint32_t count = tree->node_count;
    for (uint32_t i = 0; i < count && status == BVHD_OK; i++)
        if (tree->nodes[i].child == 0 && tree->nodes[i].count / 2 > s->request->piece_size)
            status = cut_piece(s, tree, i);
    return status;
}

static enum bvhd_status scatter(struct scatter *s, struct split_tree *tree)
{
    uint32_t firsts[SCATTER_PIECES_MAX + 2];
    uint32_t count = s->request->count;
    s->outsize = outsize_share * (float)box_half_area(&s->request->bounds);
    s->outsize = s->outsize > 0 ? s->outsize : INFINITY;
    s->chunk_size = s->request->blocks ? s->request->block_size : primitive_block(count);
    s->chunk_count = s->request->blocks ? s->request->block_count : (uint32_t)parallel_chunks(s->chunk_size, count);
    enum bvhd_status status = find_planes(s);
    if (status != BVHD_OK)
        return status;
    s->pieces = memory_array(s->memory, (uint64_t)s->chunk_count * s->chunk_size, sizeof *s->pieces);
    s->places = memory_array(s->memory, (uint64_t)s->chunk_count * (s->plan.piece_count + 1), sizeof *s->places);
    tree->nodes = memory_array(s->memory, (uint64_t)s->plan.node_count + 2, sizeof *tree->nodes);
    if (!s->pieces || !s->places || !tree->nodes)
        return BVHD_NO_MEMORY;
    status = move(s, firsts);
    if (status != BVHD_OK)
        return status;
    make_tree(s, firsts, tree);
    return cut_large_pieces(s, tree);
}

enum bvhd_status scatter_refs(const struct split_request *request, struct memory *memory,
                              const struct parallel *parallel, struct split_tree *ret_tree, struct bvhd_error *error)
{
    struct scatter s = {.request = request, .memory = memory, .parallel = parallel};
    struct split_tree tree = {0};
    enum bvhd_status status = scatter(&s, &tree);
    memory_free(memory, s.pieces);
    memory_free(memory, s.places);
    if (status == BVHD_OK) {
        *ret_tree = tree;
        return BVHD_OK;
    }
    memory_free(memory, tree.nodes);
    if (status == BVHD_CANCELLED)
        return bvhd_error_set(error, status, "", "cancelled");
    return bvhd_error_set(error, status, "", "no memory to split %u primitives", request->count);
}
