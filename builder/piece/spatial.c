/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/piece/spatial.h"

#include "builder/kernel/bins.h"
#include "proto/base/parallel.h"
#include "builder/kernel/spatial_bins.h"

/*
 * A node that is still to be split. Its refs lie somewhere in its room in one of the two arrays; its children get their
 * rooms in the other.
 */
struct node_range {
    struct vec4_box bounds, centroids;
    const struct primitive_ref *refs;
    struct primitive_ref *room, *other; /* `capacity` each */
    uint32_t node, count, capacity;
};

uint32_t spatial_capacity(uint32_t count)
{
    uint64_t capacity = (uint64_t)count + (uint64_t)count * 2 / 5;
    return capacity <= UINT32_MAX / 2 ? (uint32_t)capacity : count;
}

/* How often cuts paid in nodes of one size; sizes are powers of two. */
struct experience {
    uint32_t tried, cut, passed_over;
};

struct builder {
    const struct spatial_request *request;
    struct experience experience[32];
};

/* The best way to divide whole refs. */
struct object_split {
    struct bins_mapping mapping;
    struct bins_plane plane;
    struct vec4_box centroids[2]; /* set when halved */
    bool halved;
};

static void share_room(const struct node_range *range, const struct spatial_side sides[2],
                       struct node_range ret_children[2])
{
    uint32_t left = spatial_share_room(range->capacity, sides);
    for (int i = 0; i < 2; i++)
        ret_children[i] = (struct node_range){
            .bounds = sides[i].bounds,
            .centroids = sides[i].centroids,
            .refs = i ? range->other + range->capacity - sides[1].count : range->other,
            .room = range->other + (i ? left : 0),
            .other = range->room + (i ? left : 0),
            .count = sides[i].count,
            .capacity = i ? range->capacity - left : left,
        };
}

/*
 * Returns false where, of many tries, fewer than one in RARELY led to a cut, except for one time in AGAIN: meshes
 * without overlaps should not pay for the tries.
 */
static bool is_promising(struct experience *experience)
{
    enum { ENOUGH = 16, RARELY = 16, AGAIN = 16 };
    bool rare = experience->tried >= ENOUGH && experience->cut < experience->tried / RARELY;
    return !rare || ++experience->passed_over % AGAIN == 0;
}

/*
 * Cuts the refs where that is cheaper than the best division of whole refs. When it returns false, the refs are
 * unchanged.
 */
static bool cut(struct builder *builder, const struct node_range *range, const struct bins_plane *division,
                struct spatial_side ret_sides[2])
{
    const struct spatial_request *request = builder->request;
    struct experience *experience = &builder->experience[31 - __builtin_clz(range->count)];
    struct spatial_grid grid;
    struct spatial_bins bins;
    struct spatial_plane plane;
    if (!spatial_worth_a_try(division, range->count, range->capacity - range->count, request->price) ||
        !is_promising(experience))
        return false;
    experience->tried++;
    spatial_grid_lay(&range->bounds, &grid);
    spatial_grid_narrow(&range->bounds, division->axis, &grid);
    spatial_bins_clear(&bins);
    if (!spatial_bins_add(&bins, request->canonical, &grid, range->refs, range->count, request->cancel) ||
        !spatial_bins_choose(&bins, &grid, range->capacity, &plane) ||
        !spatial_is_better(&plane, division, range->count, request->price))
        return false;
    experience->cut++;
    spatial_partition(request->canonical, &grid, &plane, range->refs, range->count, range->other,
                      range->other + range->capacity, ret_sides);
    return true;
}

static void carry_out(const struct node_range *range, const struct object_split *division,
                      struct spatial_side ret_sides[2])
{
    uint32_t left_count = division->plane.left_count, right_count = range->count - left_count;
    struct primitive_ref *right = range->other + range->capacity - right_count;
    struct vec4_box centroids[2] = {division->centroids[0], division->centroids[1]};
    if (division->halved) {
        memcpy(range->other, range->refs, left_count * sizeof *right);
        memcpy(right, range->refs + left_count, right_count * sizeof *right);
    } else {
        bins_partition(&division->mapping, &division->plane, range->refs, range->count, range->other, right, centroids);
    }
    ret_sides[0] = (struct spatial_side){division->plane.left, centroids[0], left_count};
    ret_sides[1] = (struct spatial_side){division->plane.right, centroids[1], right_count};
}

static void divide(struct builder *builder, const struct node_range *range, struct node_range ret_children[2])
{
    struct object_split division = {.halved = false};
    struct bins_plane *plane = &division.plane;
    struct spatial_side sides[2];
    division.halved = !bins_find(range->refs, range->count, &range->centroids, &division.mapping, plane);
    if (division.halved)
        bins_halve(range->refs, range->count, plane, division.centroids);
    if (division.halved || !cut(builder, range, plane, sides))
        carry_out(range, &division, sides);
    share_room(range, sides, ret_children);
}

static void make_leaf(struct ir *ir, const struct node_range *range)
{
    ir->nodes[range->node] = (struct ir_node){ir->ref_count, 1};
    ir->refs[ir->ref_count++] = range->refs->id;
}

/* A node that waits while its sibling is being split. */
struct waiting_node {
    struct node_range range;
    uint32_t both; /* capacity of both siblings together */
    uint32_t refs_before; /* refs of the tree before either sibling */
    bool is_right;
};

/* Gives the waiting node the room that its sibling has not used. */
static struct node_range resume(const struct waiting_node *waiting, uint32_t ref_count)
{
    struct node_range range = waiting->range;
    uint32_t capacity = waiting->both - (ref_count - waiting->refs_before), more = capacity - range.capacity;
    range.room -= waiting->is_right ? more : 0;
    range.other -= waiting->is_right ? more : 0;
    range.capacity = capacity;
    return range;
}

/* Only nodes with more refs check the cancel flag; below such a node there is about a millisecond of work. */
enum { LOOK_ABOVE = 512 };

/* Splits down to leaves. The child with more room waits while the other one is split, so at most 32 wait. */
static enum bvhd_status split_to_end(struct builder *builder, struct ir *ir, struct node_range range)
{
    struct waiting_node waiting[33];
    struct node_range children[2];
    uint32_t waiting_count = 0;
    for (;;) {
        ir->boxes[0][range.node] = vec4_box_get(range.bounds);
        if (range.count == 1) {
            make_leaf(ir, &range);
            if (waiting_count == 0)
                return BVHD_OK;
            range = resume(&waiting[--waiting_count], ir->ref_count);
            continue;
        }
        if (range.count > LOOK_ABOVE && parallel_cancelled(builder->request->cancel))
            return BVHD_CANCELLED;
        divide(builder, &range, children);
        ir->nodes[range.node] = (struct ir_node){.first = ir->node_count};
        children[0].node = ir->node_count;
        children[1].node = ir->node_count + 1;
        ir->node_count += 2;
        bool right_first = children[1].capacity < children[0].capacity;
        waiting[waiting_count++] =
            (struct waiting_node){children[!right_first], range.capacity, ir->ref_count, !right_first};
        range = children[right_first];
    }
}

enum bvhd_status spatial_build(const struct spatial_request *request, struct memory *memory, struct ir *ret_ir,
                               struct bvhd_error *error)
{
    struct ir ir;
    enum bvhd_status status = ir_init(&ir, memory, 2 * request->capacity - 1, request->capacity, error);
    if (status != BVHD_OK)
        return status;
    struct node_range root = {.refs = request->refs,
                              .room = request->refs,
                              .other = request->scratch,
                              .count = request->count,
                              .capacity = request->capacity};
    bins_bound(request->refs, request->count, &root.bounds, &root.centroids);
    ir.node_count = 1;
    struct builder builder = {.request = request};
    status = split_to_end(&builder, &ir, root);
    if (status == BVHD_OK) {
        *ret_ir = ir;
        return BVHD_OK;
    }
    ir_finish(&ir);
    return bvhd_error_set(error, status, "", "cancelled");
}
