/* SPDX-License-Identifier: Apache-2.0 */
#include "scatter.h"

#include <math.h>
#include <string.h>

#include "bins.h"

/* The sample: every SAMPLE_STEP-th ref, or as many as are enough for the few planes. */
enum { SAMPLE_STEP = 8, SAMPLE_MAX = 16384 };

/* Refs of a task, and most pieces of a sample. */
enum { CHUNK = PRIMITIVE_BLOCK, PIECES_MAX = 256 };

/* Of the root's half area: who has as much is met by most rays that meet the root. */
static const float outsize_share = 0.5f;

/* Refs that are not below the threshold go to the second child. A leaf is its own child, and nothing is beyond its threshold. */
struct plane_node {
    float threshold;
    uint32_t axis, child;
    uint32_t piece; /* of a leaf */
};

struct scatter {
    const struct split_request *request;
    struct memory *memory;
    const struct parallel *parallel;
    struct plane_node nodes[2 * PIECES_MAX];
    uint32_t node_count, piece_count;
    uint32_t levels;
    float outsize; /* half area from which on refs go to the last piece; infinite when none do */
    uint16_t *pieces; /* of each place of a ref */
    uint32_t *places; /* of each chunk: how many refs of each piece, then where the next one goes */
    uint32_t chunk_count;
};

/* The places of a chunk that hold refs. */
static void chunk_range(const struct scatter *s, size_t chunk, size_t *ret_begin, size_t *ret_end)
{
    const struct split_request *request = s->request;
    *ret_begin = chunk * CHUNK;
    size_t rest = request->count - *ret_begin;
    *ret_end = *ret_begin + (request->blocks ? request->blocks[chunk] : rest < CHUNK ? rest : CHUNK);
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

/* A part of the sample on its way to being split. */
struct part {
    struct primitive_ref *refs;
    uint32_t node, count, level;
};

/* Moves refs below the threshold to the front, keeps no order. */
static uint32_t divide(struct primitive_ref *refs, uint32_t count, uint32_t axis, float threshold)
{
    uint32_t left = 0;
    for (uint32_t i = 0; i < count; i++) {
        struct primitive_ref ref = refs[i];
        refs[i] = refs[left];
        refs[left] = ref;
        left += centroid_of(&ref)[axis] < threshold;
    }
    return left;
}

/* False where there is no plane with refs on both sides. */
static bool split_part(struct scatter *s, const struct part *part, struct part ret_children[2])
{
    struct vec4_box bounds, centroids;
    struct bins_mapping mapping;
    struct bins_plane plane;
    bins_bound(part->refs, part->count, &bounds, &centroids);
    if (!bins_find(part->refs, part->count, &centroids, &mapping, &plane))
        return false;
    float threshold = mapping.base[plane.axis] + (float)plane.bin / mapping.scale[plane.axis];
    uint32_t left = divide(part->refs, part->count, plane.axis, threshold);
    if (left == 0 || left == part->count)
        return false;
    uint32_t child = s->node_count;
    s->node_count += 2;
    s->nodes[part->node] = (struct plane_node){threshold, plane.axis, child, 0};
    ret_children[0] = (struct part){part->refs, child, left, part->level + 1};
    ret_children[1] = (struct part){part->refs + left, child + 1, part->count - left, part->level + 1};
    return true;
}

/* Left children first, so that pieces are numbered as they will lie. */
static void plan(struct scatter *s, struct primitive_ref *sample, uint32_t count, uint32_t enough)
{
    struct part waiting[PIECES_MAX], part = {sample, 0, count, 0}, children[2];
    uint32_t waiting_count = 0;
    s->node_count = 1;
    for (;;) {
        bool room = s->node_count + 2 <= 2 * PIECES_MAX - 1;
        if (part.count > enough && room && split_part(s, &part, children)) {
            waiting[waiting_count++] = children[1];
            part = children[0];
            continue;
        }
        s->nodes[part.node] = (struct plane_node){INFINITY, 0, part.node, s->piece_count++};
        s->levels = part.level > s->levels ? part.level : s->levels;
        if (waiting_count == 0)
            return;
        part = waiting[--waiting_count];
    }
}

/* Every step-th ref of all, of those the ones that are not outsize. Returns how many were looked at. */
static uint32_t take_sample(const struct scatter *s, uint32_t step, float outsize, struct primitive_ref *ret_sample,
                            uint32_t *ret_count)
{
    uint32_t looked = 0, count = 0;
    size_t skip = 0, i, end;
    for (uint32_t chunk = 0; chunk < s->chunk_count; chunk++) {
        chunk_range(s, chunk, &i, &end);
        for (i += skip; i < end; i += step, looked++) {
            ret_sample[count] = s->request->refs[i];
            count += half_area_of(&ret_sample[count]) < outsize;
        }
        skip = i - end;
    }
    *ret_count = count;
    return looked;
}

/* Takes the sample without the outsize ones, if those are few, and finds the planes on it. */
static enum bvhd_status find_planes(struct scatter *s)
{
    const struct split_request *request = s->request;
    uint32_t step = SAMPLE_STEP;
    while (request->count / step > SAMPLE_MAX)
        step *= 2;
    uint32_t size = request->count / step, count = 0;
    if (size == 0) {
        s->outsize = INFINITY;
        plan(s, NULL, 0, 0);
        return BVHD_OK;
    }
    struct primitive_ref *sample = memory_array(s->memory, (uint64_t)size + 1, sizeof *sample);
    if (!sample)
        return BVHD_NO_MEMORY;
    size = take_sample(s, step, s->outsize, sample, &count);
    if (size - count > size / 8) {
        s->outsize = INFINITY;
        take_sample(s, step, INFINITY, sample, &count);
    }
    uint32_t enough = request->piece_size / step;
    plan(s, sample, count, enough > 16 ? enough : 16);
    memory_free(s->memory, sample);
    return BVHD_OK;
}

static uint32_t piece_of(const struct scatter *s, const struct primitive_ref *ref)
{
    float centroid[4];
    vec4 c = centroid_of(ref);
    memcpy(centroid, &c, sizeof centroid);
    uint32_t node = 0;
    for (uint32_t level = 0; level < s->levels; level++) {
        const struct plane_node *n = &s->nodes[node];
        node = n->child + (centroid[n->axis] >= n->threshold);
    }
    return half_area_of(ref) < s->outsize ? s->nodes[node].piece : s->piece_count;
}

static uint32_t *places_of(const struct scatter *s, size_t chunk)
{
    return s->places + chunk * (s->piece_count + 1);
}

static void assign_chunk(void *context, size_t index)
{
    const struct scatter *s = context;
    uint32_t *counts = places_of(s, index);
    size_t i, end;
    memset(counts, 0, (s->piece_count + 1) * sizeof *counts);
    for (chunk_range(s, index, &i, &end); i < end; i++) {
        uint32_t piece = piece_of(s, &s->request->refs[i]);
        s->pieces[i] = (uint16_t)piece;
        counts[piece]++;
    }
}

static void move_chunk(void *context, size_t index)
{
    const struct scatter *s = context;
    uint32_t *places = places_of(s, index);
    size_t i, end;
    for (chunk_range(s, index, &i, &end); i < end; i++)
        vec4_box_store(&s->request->scratch[places[s->pieces[i]]++], vec4_box_load(&s->request->refs[i]));
}

/* From counts to places; ret_firsts[piece_count + 2]. */
static void place_pieces(struct scatter *s, uint32_t *ret_firsts)
{
    uint32_t sum = 0;
    for (uint32_t piece = 0; piece <= s->piece_count; piece++) {
        ret_firsts[piece] = sum;
        for (uint32_t chunk = 0; chunk < s->chunk_count; chunk++) {
            uint32_t *place = &places_of(s, chunk)[piece], count = *place;
            *place = sum;
            sum += count;
        }
    }
    ret_firsts[s->piece_count + 1] = sum;
}

static enum bvhd_status move(struct scatter *s, uint32_t *ret_firsts)
{
    const struct split_request *request = s->request;
    if (!parallel_for_until(s->parallel, request->cancel, s->chunk_count, assign_chunk, s))
        return BVHD_CANCELLED;
    place_pieces(s, ret_firsts);
    return parallel_for_until(s->parallel, request->cancel, s->chunk_count, move_chunk, s) ? BVHD_OK : BVHD_CANCELLED;
}

/* The planes' nodes as those of a tree, from `at` on. */
static void fill_tree(const struct scatter *s, const uint32_t *firsts, uint32_t at, struct split_node *nodes)
{
    for (uint32_t i = 0; i < s->node_count; i++) {
        const struct plane_node *node = &s->nodes[i];
        bool leaf = node->child == i;
        nodes[at + i] = (struct split_node){.child = leaf ? 0 : at + node->child};
        if (leaf) {
            nodes[at + i].first = firsts[node->piece];
            nodes[at + i].count = firsts[node->piece + 1] - firsts[node->piece];
        }
    }
}

/* Where an outsize piece hangs beside all others there is one more level. Children's places follow from pairs: theirs are odd. */
static void make_tree(const struct scatter *s, const uint32_t *firsts, struct split_tree *tree)
{
    const struct split_request *request = s->request;
    uint32_t outsize = firsts[s->piece_count + 1] - firsts[s->piece_count];
    tree->piece_count = s->piece_count;
    tree->node_count = s->node_count;
    if (outsize == 0) {
        fill_tree(s, firsts, 0, tree->nodes);
    } else {
        fill_tree(s, firsts, 2, tree->nodes);
        tree->nodes[1] = tree->nodes[2];
        tree->nodes[2] = (struct split_node){.first = firsts[s->piece_count], .count = outsize};
        tree->nodes[0] = (struct split_node){.child = 1};
        tree->piece_count++;
        tree->node_count += 2;
    }
    tree->nodes[0].bounds = request->bounds;
    tree->nodes[0].first = 0;
    tree->nodes[0].count = request->count;
}

/* Sets the bounds of all refs. False when cancelled. */
static bool bound(struct split_request *request)
{
    request->bounds = request->centroids = box_empty();
    for (uint32_t first = 0, count; first < request->count; first += count) {
        struct box bounds, centroids;
        if (parallel_cancelled(request->cancel))
            return false;
        count = request->count - first < CHUNK ? request->count - first : CHUNK;
        primitive_bounds(request->refs + first, count, &bounds, &centroids);
        box_grow(&request->bounds, &bounds);
        box_grow(&request->centroids, &centroids);
    }
    return true;
}

/* Cuts the piece at a node by split_refs, and hangs the tree in its place. */
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
    uint32_t firsts[PIECES_MAX + 2];
    uint32_t count = s->request->count;
    s->outsize = outsize_share * (float)box_half_area(&s->request->bounds);
    s->outsize = s->outsize > 0 ? s->outsize : INFINITY;
    s->chunk_count = s->request->blocks ? s->request->block_count : (uint32_t)(((uint64_t)count + CHUNK - 1) / CHUNK);
    enum bvhd_status status = find_planes(s);
    if (status != BVHD_OK)
        return status;
    s->pieces = memory_array(s->memory, (uint64_t)s->chunk_count * CHUNK, sizeof *s->pieces);
    s->places = memory_array(s->memory, (uint64_t)s->chunk_count * (s->piece_count + 1), sizeof *s->places);
    tree->nodes = memory_array(s->memory, (uint64_t)s->node_count + 2, sizeof *tree->nodes);
    if (!s->pieces || !s->places || !tree->nodes)
        return BVHD_NO_MEMORY;
    status = move(s, firsts);
    if (status != BVHD_OK)
        return status;
    make_tree(s, firsts, tree);
    return cut_large_pieces(s, tree);
}

enum bvhd_status scatter_refs(const struct split_request *request, struct memory *memory, const struct parallel *parallel,
                              struct split_tree *ret_tree, struct bvhd_error *error)
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
