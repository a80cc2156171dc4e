/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/top/split.h"

#include <stddef.h>

#include "builder/kernel/bins.h"

/*
 * Parts of more than LARGE refs are divided in rounds: all of one level at once, in chunks of CHUNK refs that are
 * binned and partitioned in parallel. Each smaller range is divided down to pieces by one task. Refs move between the
 * two arrays; each range lies in one of them.
 */
enum { LARGE = 32768, CHUNK = 4096 };

/* A node that is still to be divided. */
struct split_range {
    uint32_t node, first, count;
    bool in_scratch;
    struct vec4_box centroids;
};

/* Nodes as they are made. The root of a list is its node 0. */
struct node_list {
    struct split_node *nodes;
    uint32_t count, capacity;
    uint32_t pieces;
};

/* A chunk of a large range in one round. */
struct split_chunk {
    uint32_t range; /* number of the range in this round */
    uint32_t first, count;
    uint32_t left_at, right_at; /* where its left and right refs go */
    struct vec4_box centroids[2];
    struct bins bins;
};

/* The division of a large range in one round. */
struct split_plan {
    struct bins_mapping mapping;
    struct bins_plane plane;
    struct vec4_box centroids[2];
    bool halved; /* there is no plane; the refs stay where they are */
    uint32_t first_chunk, chunk_count;
};

struct small_task {
    struct split_range range;
    struct node_list list;
    enum bvhd_status status;
};

struct splitter {
    const struct split_request *request;
    struct memory *memory;
    const struct parallel *parallel;
    struct node_list list;
    struct split_range *ranges; /* large ranges of this round */
    struct split_plan *divisions;
    uint32_t range_count;
    struct split_range *next_ranges;
    uint32_t next_count;
    struct split_chunk *chunks;
    uint32_t chunk_count;
    struct small_task *tasks;
    uint32_t task_count, task_capacity;
};

static bool cancelled(const struct split_request *request)
{
    return parallel_cancelled(request->cancel);
}

static struct primitive_ref *array_of(const struct split_request *request, bool scratch)
{
    return scratch ? request->scratch : request->refs;
}

static bool node_list_grow(struct node_list *list, uint32_t more, struct memory *memory)
{
    if (list->capacity - list->count >= more)
        return true;
    uint64_t capacity = (uint64_t)list->capacity * 2 + more;
    struct split_node *nodes =
        capacity > UINT32_MAX ? NULL : memory_resize(memory, list->nodes, capacity * sizeof *nodes);
    if (!nodes)
        return false;
    list->nodes = nodes;
    list->capacity = (uint32_t)capacity;
    return true;
}

/* Makes the two children of a range; the list has room for them. */
static void add_children(struct node_list *list, const struct split_range *range, const struct bins_plane *plane,
                         bool halved, const struct vec4_box centroids[2], struct split_range ret_children[2])
{
    uint32_t child = list->count, counts[2] = {plane->left_count, range->count - plane->left_count};
    list->nodes[range->node].child = child;
    for (int side = 0; side < 2; side++) {
        uint32_t first = range->first + (side ? counts[0] : 0);
        list->nodes[child + side] =
            (struct split_node){vec4_box_get(side ? plane->right : plane->left), first, counts[side], 0};
        ret_children[side] =
            (struct split_range){child + side, first, counts[side], range->in_scratch != !halved, centroids[side]};
    }
    list->count += 2;
}

static void finish_piece(const struct split_request *request, const struct split_range *range, struct node_list *list)
{
    if (range->in_scratch)
        memcpy(request->refs + range->first, request->scratch + range->first, range->count * sizeof *request->refs);
    list->pieces++;
}

static void split_small(const struct split_request *request, struct node_list *list, const struct split_range *range,
                        struct split_range ret_children[2])
{
    const struct primitive_ref *from = array_of(request, range->in_scratch) + range->first;
    struct primitive_ref *to = array_of(request, !range->in_scratch) + range->first;
    struct bins_mapping mapping;
    struct bins_plane plane;
    struct vec4_box centroids[2];
    bool halved = !bins_find(from, range->count, &range->centroids, &mapping, &plane);
    if (halved)
        bins_halve(from, range->count, &plane, centroids);
    else
        bins_partition(&mapping, &plane, from, range->count, to, to + plane.left_count, centroids);
    add_children(list, range, &plane, halved, centroids, ret_children);
}

/*
 * Divides a range down to pieces on the calling thread. The larger child waits while the smaller one is divided, so at
 * most 32 wait.
 */
static enum bvhd_status split_to_end(const struct split_request *request, struct node_list *list,
                                     struct split_range range, struct memory *memory)
{
    struct split_range waiting[33], children[2];
    uint32_t waiting_count = 0;
    for (;;) {
        if (range.count <= request->piece_size) {
            finish_piece(request, &range, list);
            if (waiting_count == 0)
                return BVHD_OK;
            range = waiting[--waiting_count];
            continue;
        }
        if (cancelled(request))
            return BVHD_CANCELLED;
        if (!node_list_grow(list, 2, memory))
            return BVHD_NO_MEMORY;
        split_small(request, list, &range, children);
        bool right_first = children[1].count < children[0].count;
        waiting[waiting_count++] = children[!right_first];
        range = children[right_first];
    }
}

static void run_small_task(void *context, size_t index)
{
    struct splitter *splitter = context;
    struct small_task *task = &splitter->tasks[index];
    task->status = BVHD_NO_MEMORY;
    if (!node_list_grow(&task->list, 1, splitter->memory))
        return;
    struct split_range range = task->range;
    task->list.nodes[0] = splitter->list.nodes[range.node];
    task->list.count = 1;
    range.node = 0;
    task->status = split_to_end(splitter->request, &task->list, range, splitter->memory);
}

static void bin_chunk(void *context, size_t index)
{
    struct splitter *splitter = context;
    struct split_chunk *chunk = &splitter->chunks[index];
    const struct split_range *range = &splitter->ranges[chunk->range];
    const struct bins_mapping *mapping = &splitter->divisions[chunk->range].mapping;
    if (cancelled(splitter->request))
        return;
    bins_clear(&chunk->bins, mapping);
    bins_add(&chunk->bins, mapping, array_of(splitter->request, range->in_scratch) + chunk->first, chunk->count);
}

/* Does what bins_bound does, chunk by chunk; the result is incomplete when cancelled. */
static void bound(const struct split_request *request, const struct primitive_ref *refs, uint32_t count,
                  struct vec4_box *ret_bounds, struct vec4_box *ret_centroids)
{
    *ret_bounds = *ret_centroids = vec4_box_empty();
    for (size_t begin = 0, end; begin < count && !cancelled(request); begin = end) {
        struct vec4_box bounds, centroids;
        parallel_chunk(begin / CHUNK, CHUNK, count, &begin, &end);
        bins_bound(refs + begin, (uint32_t)(end - begin), &bounds, &centroids);
        vec4_box_grow(ret_bounds, bounds.min, bounds.max);
        vec4_box_grow(ret_centroids, centroids.min, centroids.max);
    }
}

/* Does what bins_halve does, for a large range. */
static void halve(const struct split_request *request, const struct split_range *range, struct split_plan *division)
{
    const struct primitive_ref *refs = array_of(request, range->in_scratch) + range->first;
    uint32_t left = range->count / 2;
    division->plane.left_count = left;
    bound(request, refs, left, &division->plane.left, &division->centroids[0]);
    bound(request, refs + left, range->count - left, &division->plane.right, &division->centroids[1]);
}

/* Finds a range's plane, and sets where the refs of its chunks go. */
static void divide(void *context, size_t index)
{
    struct splitter *splitter = context;
    const struct split_range *range = &splitter->ranges[index];
    struct split_plan *division = &splitter->divisions[index];
    struct split_chunk *chunks = splitter->chunks + division->first_chunk;
    struct bins sum;
    bins_clear(&sum, &division->mapping);
    for (uint32_t i = 0; i < division->chunk_count; i++)
        bins_merge(&sum, &division->mapping, &chunks[i].bins);
    division->halved = !bins_choose(&sum, &division->mapping, range->count, &division->plane);
    if (division->halved) {
        halve(splitter->request, range, division);
        return;
    }
    uint32_t left_at = range->first, right_at = range->first + division->plane.left_count;
    for (uint32_t i = 0; i < division->chunk_count; i++) {
        uint32_t left = bins_left_count(&chunks[i].bins, &division->plane);
        chunks[i].left_at = left_at;
        chunks[i].right_at = right_at;
        left_at += left;
        right_at += chunks[i].count - left;
    }
}

static void partition_chunk(void *context, size_t index)
{
    struct splitter *splitter = context;
    struct split_chunk *chunk = &splitter->chunks[index];
    const struct split_range *range = &splitter->ranges[chunk->range];
    const struct split_plan *division = &splitter->divisions[chunk->range];
    if (division->halved || cancelled(splitter->request))
        return;
    const struct primitive_ref *from = array_of(splitter->request, range->in_scratch) + chunk->first;
    struct primitive_ref *to = array_of(splitter->request, !range->in_scratch);
    bins_partition(&division->mapping, &division->plane, from, chunk->count, to + chunk->left_at, to + chunk->right_at,
                   chunk->centroids);
}

static void sum_centroids(struct splitter *splitter, struct split_plan *division)
{
    division->centroids[0] = division->centroids[1] = vec4_box_empty();
    for (uint32_t i = 0; i < division->chunk_count; i++) {
        const struct split_chunk *chunk = &splitter->chunks[division->first_chunk + i];
        for (int side = 0; side < 2; side++)
            vec4_box_grow(&division->centroids[side], chunk->centroids[side].min, chunk->centroids[side].max);
    }
}

/*
 * Puts a large range into the next round, and any other into a task. Pieces become tasks too, since they may have to be
 * copied back.
 */
static void assign(struct splitter *splitter, const struct split_range *range)
{
    if (range->count > LARGE && range->count > splitter->request->piece_size)
        splitter->next_ranges[splitter->next_count++] = *range;
    else
        splitter->tasks[splitter->task_count++] = (struct small_task){.range = *range};
}

static void cut_into_chunks(struct splitter *splitter)
{
    splitter->chunk_count = 0;
    for (uint32_t i = 0; i < splitter->range_count; i++) {
        const struct split_range *range = &splitter->ranges[i];
        struct split_plan *division = &splitter->divisions[i];
        bins_map(&range->centroids, range->count, &division->mapping);
        division->first_chunk = splitter->chunk_count;
        division->chunk_count = (uint32_t)parallel_chunks(CHUNK, range->count);
        for (uint32_t k = 0; k < division->chunk_count; k++) {
            struct split_chunk *chunk = &splitter->chunks[splitter->chunk_count++];
            size_t begin, end;
            parallel_chunk(k, CHUNK, range->count, &begin, &end);
            chunk->range = i;
            chunk->first = range->first + (uint32_t)begin;
            chunk->count = (uint32_t)(end - begin);
        }
    }
}

/* Makes room for the children: each range becomes two, and either may become a task. */
static bool make_room(struct splitter *splitter)
{
    uint64_t tasks = (uint64_t)splitter->task_count + 2 * (uint64_t)splitter->range_count;
    if (tasks > splitter->task_capacity) {
        uint64_t capacity = 2 * tasks;
        struct small_task *grown = memory_resize(splitter->memory, splitter->tasks, capacity * sizeof *grown);
        if (!grown)
            return false;
        splitter->tasks = grown;
        splitter->task_capacity = (uint32_t)capacity;
    }
    return node_list_grow(&splitter->list, 2 * splitter->range_count, splitter->memory);
}

static enum bvhd_status run_round(struct splitter *splitter)
{
    if (cancelled(splitter->request))
        return BVHD_CANCELLED;
    if (!make_room(splitter))
        return BVHD_NO_MEMORY;
    cut_into_chunks(splitter);
    /* Chunks that see the cancel flag leave their work undone. The flag is never cleared, so it is seen here too. */
    parallel_for(splitter->parallel, splitter->chunk_count, bin_chunk, splitter);
    if (cancelled(splitter->request))
        return BVHD_CANCELLED;
    parallel_for(splitter->parallel, splitter->range_count, divide, splitter);
    parallel_for(splitter->parallel, splitter->chunk_count, partition_chunk, splitter);
    if (cancelled(splitter->request))
        return BVHD_CANCELLED;
    splitter->next_count = 0;
    for (uint32_t i = 0; i < splitter->range_count; i++) {
        struct split_plan *division = &splitter->divisions[i];
        struct split_range children[2];
        if (!division->halved)
            sum_centroids(splitter, division);
        add_children(&splitter->list, &splitter->ranges[i], &division->plane, division->halved, division->centroids,
                     children);
        assign(splitter, &children[0]);
        assign(splitter, &children[1]);
    }
    struct split_range *swap = splitter->ranges;
    splitter->ranges = splitter->next_ranges;
    splitter->next_ranges = swap;
    splitter->range_count = splitter->next_count;
    return BVHD_OK;
}

/* Appends a task's nodes to the list; its root already has a place there. */
static void append(struct node_list *list, const struct small_task *task)
{
    const struct node_list *own = &task->list;
    uint32_t shift = list->count - 1;
    list->nodes[task->range.node] = own->nodes[0];
    memcpy(list->nodes + list->count, own->nodes + 1, (own->count - 1) * sizeof *own->nodes);
    for (uint32_t i = 0; i < own->count; i++) {
        struct split_node *node = i ? &list->nodes[i + shift] : &list->nodes[task->range.node];
        node->child += node->child ? shift : 0;
    }
    list->count += own->count - 1;
    list->pieces += own->pieces;
}

static enum bvhd_status run_tasks(struct splitter *splitter)
{
    parallel_for(splitter->parallel, splitter->task_count, run_small_task, splitter);
    uint64_t nodes = 0;
    for (uint32_t i = 0; i < splitter->task_count; i++) {
        if (splitter->tasks[i].status != BVHD_OK)
            return splitter->tasks[i].status;
        nodes += splitter->tasks[i].list.count - 1;
    }
    if (nodes > UINT32_MAX || !node_list_grow(&splitter->list, (uint32_t)nodes, splitter->memory))
        return BVHD_NO_MEMORY;
    for (uint32_t i = 0; i < splitter->task_count; i++)
        append(&splitter->list, &splitter->tasks[i]);
    return BVHD_OK;
}

/* Large ranges are disjoint and have more than LARGE refs each, which bounds their number and the number of chunks. */
static bool allocate(struct splitter *splitter)
{
    uint32_t count = splitter->request->count;
    uint64_t ranges = (uint64_t)count / LARGE + 1, chunks = (uint64_t)count / CHUNK + ranges + 1;
    splitter->ranges = memory_array(splitter->memory, ranges, sizeof *splitter->ranges);
    splitter->next_ranges = memory_array(splitter->memory, ranges, sizeof *splitter->next_ranges);
    splitter->divisions = memory_array(splitter->memory, ranges, sizeof *splitter->divisions);
    if (count > LARGE && count > splitter->request->piece_size)
        splitter->chunks = memory_array(splitter->memory, chunks, sizeof *splitter->chunks);
    splitter->tasks = memory_array(splitter->memory, 1, sizeof *splitter->tasks);
    splitter->task_capacity = 1;
    bool rounds = splitter->ranges && splitter->next_ranges && splitter->divisions;
    return rounds && splitter->tasks && node_list_grow(&splitter->list, 1, splitter->memory);
}

static void release(struct splitter *splitter)
{
    for (uint32_t i = 0; i < splitter->task_count; i++)
        memory_free(splitter->memory, splitter->tasks[i].list.nodes);
    memory_free(splitter->memory, splitter->tasks);
    memory_free(splitter->memory, splitter->ranges);
    memory_free(splitter->memory, splitter->next_ranges);
    memory_free(splitter->memory, splitter->divisions);
    memory_free(splitter->memory, splitter->chunks);
}

static enum bvhd_status split(struct splitter *splitter)
{
    const struct split_request *request = splitter->request;
    if (!allocate(splitter))
        return BVHD_NO_MEMORY;
    splitter->list.nodes[0] = (struct split_node){request->bounds, 0, request->count, 0};
    splitter->list.count = 1;
    assign(splitter, &(struct split_range){0, 0, request->count, false, vec4_box_from(&request->centroids)});
    struct split_range *swap = splitter->ranges;
    splitter->ranges = splitter->next_ranges;
    splitter->next_ranges = swap;
    splitter->range_count = splitter->next_count;
    enum bvhd_status status = splitter->range_count && !splitter->chunks ? BVHD_NO_MEMORY : BVHD_OK;
    while (status == BVHD_OK && splitter->range_count > 0)
        status = run_round(splitter);
    return status == BVHD_OK ? run_tasks(splitter) : status;
}

enum bvhd_status split_refs(const struct split_request *request, struct memory *memory, const struct parallel *parallel,
                            struct split_tree *ret_tree, struct bvhd_error *error)
{
    struct splitter splitter = {.request = request, .memory = memory, .parallel = parallel};
    enum bvhd_status status = split(&splitter);
    release(&splitter);
    if (status == BVHD_OK) {
        *ret_tree = (struct split_tree){splitter.list.nodes, splitter.list.count, splitter.list.pieces};
        return BVHD_OK;
    }
    memory_free(memory, splitter.list.nodes);
    if (status == BVHD_CANCELLED)
        return bvhd_error_set(error, status, "", "cancelled");
    return bvhd_error_set(error, status, "", "no memory to split %u primitives", request->count);
}
