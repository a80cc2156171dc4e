/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/top/spatial_split.h"

#include <string.h>

#include "builder/kernel/bins.h"
#include "builder/kernel/spatial_bins.h"

/* Refs of one task. */
enum { CHUNK = 4096 };

/*
 * Share of the root's half area from which on a ref counts as outsize: such a ref is met by most rays that meet the
 * root. Outsize refs are set apart only when they are at most one in OUTSIZE_RARE.
 */
static const float outsize_share = 0.5f;
enum { OUTSIZE_RARE = 8 };

/*
 * A node that is still to be divided. Its refs lie somewhere in its room in one of the two arrays; its children get
 * their rooms in the other.
 */
struct spatial_range {
    struct vec4_box bounds, centroids;
    uint32_t node, first, count, room, capacity;
    bool in_scratch;
};

/* A chunk of the range that is being divided. */
struct spatial_chunk {
    struct bins bins;
    struct spatial_bins spatial;
    uint32_t counts[2], places[2]; /* for each side: how many refs go there, and where */
    double areas[2]; /* at the root, for each side: sum of its refs' half areas */
    struct spatial_side sides[2];
};

struct spatial_splitter {
    const struct spatial_split_request *request;
    struct memory *memory;
    const struct parallel *parallel;
    struct split_tree tree;
    uint32_t node_capacity;
    float whole; /* half area of the root, without the outsize refs */
    float price; /* spatial_price */
    struct spatial_range range; /* the node that is being divided */
    struct spatial_chunk *chunks;
    uint8_t *sides; /* side of each ref of the range, by spatial_assign, or 0 and 1 */
    struct bins_mapping mapping;
    struct bins_plane plane;
    struct spatial_grid grid;
    struct spatial_plane cut;
};

static struct primitive_ref *array_of(const struct spatial_splitter *s, bool scratch)
{
    return scratch ? s->request->scratch : s->request->refs;
}

static const struct primitive_ref *range_refs(const struct spatial_splitter *s)
{
    return array_of(s, s->range.in_scratch) + s->range.first;
}

static struct primitive_ref *target(const struct spatial_splitter *s)
{
    return array_of(s, !s->range.in_scratch) + s->range.room;
}

static uint32_t chunk_count(const struct spatial_splitter *s)
{
    return (uint32_t)parallel_chunks(CHUNK, s->range.count);
}

static bool each_chunk(struct spatial_splitter *s, parallel_task task)
{
    return parallel_for_until(s->parallel, s->request->cancel, chunk_count(s), task, s);
}

static void bin_chunk(void *context, size_t index)
{
    struct spatial_splitter *s = context;
    struct spatial_chunk *chunk = &s->chunks[index];
    size_t begin, end;
    parallel_chunk(index, CHUNK, s->range.count, &begin, &end);
    bins_clear(&chunk->bins, &s->mapping);
    bins_add(&chunk->bins, &s->mapping, range_refs(s) + begin, (uint32_t)(end - begin));
}

static void bin_chunk_spatially(void *context, size_t index)
{
    struct spatial_splitter *s = context;
    struct spatial_chunk *chunk = &s->chunks[index];
    size_t begin, end;
    parallel_chunk(index, CHUNK, s->range.count, &begin, &end);
    spatial_bins_clear(&chunk->spatial);
    spatial_bins_add(&chunk->spatial, s->request->canonical, &s->grid, range_refs(s) + begin, (uint32_t)(end - begin),
                     s->request->cancel);
}

static void partition_chunk(void *context, size_t index)
{
    struct spatial_splitter *s = context;
    struct spatial_chunk *chunk = &s->chunks[index];
    struct primitive_ref *to = target(s);
    struct vec4_box centroids[2];
    size_t begin, end;
    parallel_chunk(index, CHUNK, s->range.count, &begin, &end);
    bins_partition(&s->mapping, &s->plane, range_refs(s) + begin, (uint32_t)(end - begin), to + chunk->places[0],
                   to + chunk->places[1], centroids);
    for (int side = 0; side < 2; side++)
        chunk->sides[side] =
            (struct spatial_side){side ? s->plane.right : s->plane.left, centroids[side], chunk->counts[side]};
}

static void assign_chunk(void *context, size_t index)
{
    struct spatial_splitter *s = context;
    struct spatial_chunk *chunk = &s->chunks[index];
    size_t begin, end;
    parallel_chunk(index, CHUNK, s->range.count, &begin, &end);
    spatial_assign(&s->grid, &s->cut, range_refs(s) + begin, (uint32_t)(end - begin), s->sides + begin, chunk->counts);
}

static void cut_chunk(void *context, size_t index)
{
    struct spatial_splitter *s = context;
    struct spatial_chunk *chunk = &s->chunks[index];
    struct primitive_ref *to = target(s);
    size_t begin, end;
    parallel_chunk(index, CHUNK, s->range.count, &begin, &end);
    spatial_send(s->request->canonical, &s->grid, &s->cut, range_refs(s) + begin, s->sides + begin,
                 (uint32_t)(end - begin), to + chunk->places[0], to + chunk->places[1], chunk->sides);
}

/* Places left refs from the start of the room on, and right ones up to its end. */
static void place_chunks(struct spatial_splitter *s)
{
    uint32_t left = 0, right = s->range.capacity;
    for (uint32_t i = 0; i < chunk_count(s); i++)
        right -= s->chunks[i].counts[1];
    for (uint32_t i = 0; i < chunk_count(s); i++) {
        struct spatial_chunk *chunk = &s->chunks[i];
        chunk->places[0] = left;
        chunk->places[1] = right;
        left += chunk->counts[0];
        right += chunk->counts[1];
    }
}

static void sum_sides(const struct spatial_splitter *s, struct spatial_side ret_sides[2])
{
    for (int side = 0; side < 2; side++) {
        ret_sides[side] = (struct spatial_side){vec4_box_empty(), vec4_box_empty(), 0};
        for (uint32_t i = 0; i < chunk_count(s); i++) {
            const struct spatial_side *from = &s->chunks[i].sides[side];
            vec4_box_grow(&ret_sides[side].bounds, from->bounds.min, from->bounds.max);
            vec4_box_grow(&ret_sides[side].centroids, from->centroids.min, from->centroids.max);
            ret_sides[side].count += from->count;
        }
    }
}

static void assign_halves(void *context, size_t index)
{
    struct spatial_splitter *s = context;
    struct spatial_chunk *chunk = &s->chunks[index];
    const uint32_t left = s->range.count / 2;
    size_t i, end;
    parallel_chunk(index, CHUNK, s->range.count, &i, &end);
    chunk->counts[0] = chunk->counts[1] = 0;
    for (; i < end; i++) {
        s->sides[i] = i >= left;
        chunk->counts[s->sides[i]]++;
    }
}

/* Moves the refs as they were assigned: to the left, to the right, or cut to both. Returns false when cancelled. */
static bool move_refs(struct spatial_splitter *s, struct spatial_side ret_sides[2])
{
    place_chunks(s);
    if (!each_chunk(s, cut_chunk))
        return false;
    sum_sides(s, ret_sides);
    return true;
}

/* Divides refs that nothing separates in the middle of their order. Returns false when cancelled. */
static bool halve(struct spatial_splitter *s, struct spatial_side ret_sides[2])
{
    return each_chunk(s, assign_halves) && move_refs(s, ret_sides);
}

static bool carry_out(struct spatial_splitter *s, struct spatial_side ret_sides[2])
{
    for (uint32_t i = 0; i < chunk_count(s); i++) {
        struct spatial_chunk *chunk = &s->chunks[i];
        size_t begin, end;
        parallel_chunk(i, CHUNK, s->range.count, &begin, &end);
        chunk->counts[0] = bins_left_count(&chunk->bins, &s->plane);
        chunk->counts[1] = (uint32_t)(end - begin) - chunk->counts[0];
    }
    place_chunks(s);
    if (!each_chunk(s, partition_chunk))
        return false;
    sum_sides(s, ret_sides);
    return true;
}

/*
 * Sets *ret_better when there is a plane that cuts triangles and costs less than the best division of whole refs.
 * Returns false when cancelled.
 */
static bool look_for_cut(struct spatial_splitter *s, bool *ret_better)
{
    const struct spatial_range *range = &s->range;
    *ret_better = false;
    if (!spatial_worth_a_try(&s->plane, range->count, range->capacity - range->count, s->price))
        return true;
    spatial_grid_lay(&range->bounds, &s->grid);
    if (!each_chunk(s, bin_chunk_spatially))
        return false;
    for (uint32_t i = 1; i < chunk_count(s); i++)
        spatial_bins_merge(&s->chunks[0].spatial, &s->chunks[i].spatial);
    *ret_better = spatial_bins_choose(&s->chunks[0].spatial, &s->grid, range->capacity, &s->cut) &&
                  spatial_is_better(&s->cut, &s->plane, range->count, s->price);
    return true;
}

/*
 * Cuts the refs. Neither side may stay empty: when all refs that cross the plane would be cheaper whole on one side,
 * they are cut nevertheless.
 */
static bool carry_out_cut(struct spatial_splitter *s, struct spatial_side ret_sides[2])
{
    if (!each_chunk(s, assign_chunk))
        return false;
    uint64_t counts[2] = {0, 0};
    for (uint32_t i = 0; i < chunk_count(s); i++)
        for (int side = 0; side < 2; side++)
            counts[side] += s->chunks[i].counts[side];
    if (counts[0] == 0 || counts[1] == 0) {
        s->cut.cut_all = true;
        if (!each_chunk(s, assign_chunk))
            return false;
    }
    return move_refs(s, ret_sides);
}

/* Divides the range, by a cut or without. Returns false when cancelled. */
static bool divide(struct spatial_splitter *s, struct spatial_side ret_sides[2])
{
    bins_map(&s->range.centroids, s->range.count, &s->mapping);
    if (!each_chunk(s, bin_chunk))
        return false;
    struct bins sum;
    bool better;
    bins_clear(&sum, &s->mapping);
    for (uint32_t i = 0; i < chunk_count(s); i++)
        bins_merge(&sum, &s->mapping, &s->chunks[i].bins);
    bool halved = !bins_choose(&sum, &s->mapping, s->range.count, &s->plane);
    if (halved)
        return halve(s, ret_sides);
    if (!look_for_cut(s, &better))
        return false;
    return better ? carry_out_cut(s, ret_sides) : carry_out(s, ret_sides);
}

static bool add_children(struct spatial_splitter *s, const struct spatial_side sides[2], uint32_t left,
                         struct spatial_range ret_children[2])
{
    struct split_tree *tree = &s->tree;
    const struct spatial_range range = s->range;
    if (s->node_capacity - tree->node_count < 2) {
        uint32_t capacity = s->node_capacity * 2;
        struct split_node *nodes = memory_resize(s->memory, tree->nodes, (uint64_t)capacity * sizeof *nodes);
        if (!nodes)
            return false;
        tree->nodes = nodes;
        s->node_capacity = capacity;
    }
    for (uint32_t side = 0; side < 2; side++)
        ret_children[side] = (struct spatial_range){
            .bounds = sides[side].bounds,
            .centroids = sides[side].centroids,
            .node = tree->node_count + side,
            .first = side ? range.room + range.capacity - sides[1].count : range.room,
            .count = sides[side].count,
            .room = range.room + (side ? left : 0),
            .capacity = side ? range.capacity - left : left,
            .in_scratch = !range.in_scratch,
        };
    tree->nodes[range.node] = (struct split_node){.child = tree->node_count};
    tree->node_count += 2;
    return true;
}

static void finish_piece(struct spatial_splitter *s)
{
    const struct spatial_range *range = &s->range;
    s->tree.nodes[range->node] = (struct split_node){.first = range->room, .count = range->count};
    s->tree.piece_count++;
    struct primitive_ref *to = s->request->refs + range->room;
    if (range->in_scratch || range->first != range->room)
        memmove(to, range_refs(s), range->count * sizeof *to);
}

static void assign_outsize(void *context, size_t index)
{
    struct spatial_splitter *s = context;
    struct spatial_chunk *chunk = &s->chunks[index];
    size_t i, end;
    parallel_chunk(index, CHUNK, s->range.count, &i, &end);
    chunk->counts[0] = chunk->counts[1] = 0;
    chunk->areas[0] = chunk->areas[1] = 0;
    for (; i < end; i++) {
        float area = vec4_box_half_area(vec4_box_load(&range_refs(s)[i]));
        s->sides[i] = area >= outsize_share * s->whole;
        chunk->counts[s->sides[i]]++;
        chunk->areas[s->sides[i]] += area;
    }
}

/*
 * Refs about as large as the whole scene would enlarge every box on their way down. If they are few, they form a piece
 * of their own below the root, without room for more refs. Sets *ret_apart, and the price. Returns false when
 * cancelled.
 */
static bool set_apart(struct spatial_splitter *s, struct spatial_side ret_sides[2], bool *ret_apart)
{
    *ret_apart = false;
    if (!each_chunk(s, assign_outsize))
        return false;
    double areas[2] = {0, 0};
    uint32_t outsize = 0;
    for (uint32_t i = 0; i < chunk_count(s); i++) {
        outsize += s->chunks[i].counts[1];
        for (int side = 0; side < 2; side++)
            areas[side] += s->chunks[i].areas[side];
    }
    if (outsize == 0 || outsize > s->range.count / OUTSIZE_RARE) {
        s->price = spatial_price(areas[0] + areas[1], s->whole, s->range.count);
        return true;
    }
    if (!move_refs(s, ret_sides))
        return false;
    s->whole = vec4_box_half_area(ret_sides[0].bounds);
    s->price = spatial_price(areas[0], s->whole, s->range.count - outsize);
    *ret_apart = true;
    return true;
}

/* Makes the range's children; *ret_split is false when the range is a piece. */
static enum bvhd_status split_range(struct spatial_splitter *s, struct spatial_range ret_children[2], bool *ret_split)
{
    struct spatial_side sides[2];
    bool apart = false;
    if (s->range.node == 0 && !set_apart(s, sides, &apart))
        return BVHD_CANCELLED;
    *ret_split = apart || s->range.count > s->request->piece_size;
    if (!*ret_split)
        return BVHD_OK;
    if (!apart && !divide(s, sides))
        return BVHD_CANCELLED;
    uint32_t left = apart ? s->range.capacity - sides[1].count : spatial_share_room(s->range.capacity, sides);
    return add_children(s, sides, left, ret_children) ? BVHD_OK : BVHD_NO_MEMORY;
}

/* Divides down to pieces. The child with more room waits while the other one is divided, so at most 32 wait. */
static enum bvhd_status split_to_end(struct spatial_splitter *s)
{
    struct spatial_range waiting[34], children[2];
    uint32_t waiting_count = 0;
    bool split;
    for (;;) {
        enum bvhd_status status = split_range(s, children, &split);
        if (status != BVHD_OK)
            return status;
        if (!split) {
            finish_piece(s);
            if (waiting_count == 0)
                return BVHD_OK;
            s->range = waiting[--waiting_count];
            continue;
        }
        bool right_first = children[1].capacity < children[0].capacity;
        waiting[waiting_count++] = children[!right_first];
        s->range = children[right_first];
    }
}

static enum bvhd_status split(struct spatial_splitter *s)
{
    const struct spatial_split_request *request = s->request;
    s->node_capacity = 64;
    s->tree.nodes = memory_array(s->memory, s->node_capacity, sizeof *s->tree.nodes);
    s->chunks = memory_array(s->memory, parallel_chunks(CHUNK, request->capacity), sizeof *s->chunks);
    s->sides = memory_array(s->memory, request->capacity, sizeof *s->sides);
    if (!s->tree.nodes || !s->chunks || !s->sides)
        return BVHD_NO_MEMORY;
    s->tree.node_count = 1;
    s->whole = (float)box_half_area(&request->bounds);
    s->range = (struct spatial_range){.bounds = vec4_box_from(&request->bounds),
                                      .centroids = vec4_box_from(&request->centroids),
                                      .count = request->count,
                                      .capacity = request->capacity};
    enum bvhd_status status = split_to_end(s);
    uint32_t count = 0;
    for (uint32_t i = 0; i < s->tree.node_count && status == BVHD_OK; i++)
        count += s->tree.nodes[i].count;
    s->tree.nodes[0].count = count;
    return status;
}

enum bvhd_status spatial_split(const struct spatial_split_request *request, struct memory *memory,
                               const struct parallel *parallel, struct split_tree *ret_tree, float *ret_price,
                               struct bvhd_error *error)
{
    struct spatial_splitter s = {.request = request, .memory = memory, .parallel = parallel};
    enum bvhd_status status = split(&s);
    memory_free(memory, s.chunks);
    memory_free(memory, s.sides);
    if (status == BVHD_OK) {
        *ret_tree = s.tree;
        *ret_price = s.price;
        return BVHD_OK;
    }
    memory_free(memory, s.tree.nodes);
    if (status == BVHD_CANCELLED)
        return bvhd_error_set(error, status, "", "cancelled");
    return bvhd_error_set(error, status, "", "no memory to split %u triangles", request->count);
}
