/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/top/moving_split.h"

#include <stddef.h>
#include <string.h>

#include "builder/input/primitive.h"
#include "builder/top/moving_bins.h"

/*
 * Parts of more than LARGE refs are divided in rounds, in which each part is a task; smaller ones are divided down to
 * pieces by one task. Below DEPTH_MOST divisions parts are halved, so that the depth is bounded.
 */
enum { LARGE = 8192, CHUNK = 4096, DEPTH_MOST = 96 };

/* A part of the refs, and how many divisions made it. */
struct part {
    uint32_t first, count, depth;
};

/*
 * The tree while it is made: at each place where two pieces meet, the number of the division that parted them, counted
 * from 1 along the way from the root. No two tasks write the same place.
 */
struct splitter {
    const struct split_request *request;
    const struct canonical *canonical;
    struct moving_ref *refs;
    uint8_t *cuts;
    struct part *parts, *next; /* of this round, and of the next one: two for each of these */
    uint32_t count;
    struct part *tasks; /* small parts */
    uint32_t task_count;
};

static bool is_cancelled(const struct splitter *s)
{
    return parallel_cancelled(s->request->cancel);
}

static void read_chunk(void *context, size_t index)
{
    const struct splitter *s = context;
    struct primitive_finder finder = {.canonical = s->canonical};
    size_t place, end;
    for (parallel_chunk(index, CHUNK, s->request->count, &place, &end); place < end; place++)
        moving_ref_read(&finder, s->request->refs[place].id, (uint32_t)place, &s->refs[place]);
}

/* Divides a part, and marks where. */
static void divide(struct splitter *s, const struct part *part, struct part ret_children[2])
{
    const uint32_t left =
        part->depth < DEPTH_MOST ? moving_bins_divide(s->refs + part->first, part->count) : part->count / 2;
    s->cuts[part->first + left] = (uint8_t)(part->depth + 1);
    ret_children[0] = (struct part){part->first, left, part->depth + 1};
    ret_children[1] = (struct part){part->first + left, part->count - left, part->depth + 1};
}

/* The larger child waits while the smaller one is divided, so at most 32 wait. */
static void run_task(void *context, size_t index)
{
    struct splitter *s = context;
    struct part waiting[33], part = s->tasks[index], children[2];
    uint32_t count = 0;
    while (!is_cancelled(s)) {
        if (part.count > s->request->piece_size) {
            divide(s, &part, children);
            const bool right_first = children[1].count < children[0].count;
            waiting[count++] = children[!right_first];
            part = children[right_first];
        } else if (count > 0) {
            part = waiting[--count];
        } else {
            return;
        }
    }
}

static void run_part(void *context, size_t index)
{
    struct splitter *s = context;
    if (!is_cancelled(s))
        divide(s, &s->parts[index], &s->next[2 * index]);
}

/* Puts a part into the next round, or makes it a task. */
static void assign(struct splitter *s, const struct part *part, struct part *rounds, uint32_t *count)
{
    if (part->count > LARGE && part->count > s->request->piece_size)
        rounds[(*count)++] = *part;
    else
        s->tasks[s->task_count++] = *part;
}

static enum bvhd_status run(struct splitter *s, const struct parallel *parallel)
{
    const struct part all = {0, s->request->count, 0};
    if (!parallel_for_until(parallel, s->request->cancel, parallel_chunks(CHUNK, all.count), read_chunk, s))
        return BVHD_CANCELLED;
    assign(s, &all, s->parts, &s->count);
    while (s->count > 0) {
        const uint32_t made = 2 * s->count;
        parallel_for(parallel, s->count, run_part, s);
        if (is_cancelled(s))
            return BVHD_CANCELLED;
        s->count = 0;
        for (uint32_t i = 0; i < made; i++)
            assign(s, &s->next[i], s->parts, &s->count);
    }
    parallel_for(parallel, s->task_count, run_task, s);
    return is_cancelled(s) ? BVHD_CANCELLED : BVHD_OK;
}

#define NO_CUT UINT32_MAX

/* A cut, and the cuts on both sides of it that are next below it. */
struct cut {
    uint32_t place, below[2];
};

/* Lists the cuts, and finds what is below each: those with greater numbers up to the next smaller one. */
static uint32_t link_cuts(const struct splitter *s, struct cut *cuts)
{
    uint32_t above[UINT8_MAX], depth = 0, count = 0; /* numbers grow along `above` */
    for (uint32_t place = 1; place < s->request->count; place++) {
        if (s->cuts[place] == 0)
            continue;
        uint32_t last = NO_CUT;
        while (depth > 0 && s->cuts[cuts[above[depth - 1]].place] > s->cuts[place])
            last = above[--depth];
        cuts[count] = (struct cut){place, {last, NO_CUT}};
        if (depth > 0)
            cuts[above[depth - 1]].below[1] = count;
        above[depth++] = count++;
    }
    return depth > 0 ? above[0] : NO_CUT;
}

/* A node that has a number, and the cut that divides it. */
struct numbered {
    uint32_t node, cut, first, end;
};

static void number_nodes(const struct splitter *s, const struct cut *cuts, uint32_t root, struct split_node *nodes)
{
    struct numbered waiting[DEPTH_MOST + 34];
    uint32_t count = 1, next = 1;
    waiting[0] = (struct numbered){0, root, 0, s->request->count};
    while (count > 0) {
        const struct numbered at = waiting[--count];
        const bool is_piece = at.cut == NO_CUT;
        nodes[at.node] = (struct split_node){box_empty(), at.first, at.end - at.first, is_piece ? 0 : next};
        if (is_piece)
            continue;
        const struct cut *cut = &cuts[at.cut];
        waiting[count++] = (struct numbered){next + 1, cut->below[1], cut->place, at.end};
        waiting[count++] = (struct numbered){next, cut->below[0], at.first, cut->place};
        next += 2;
    }
}

static enum bvhd_status make_tree(const struct splitter *s, struct memory *memory, struct split_tree *ret_tree)
{
    uint32_t count = 0;
    for (uint32_t place = 1; place < s->request->count; place++)
        count += s->cuts[place] != 0;
    struct cut *cuts = memory_array(memory, (uint64_t)count + 1, sizeof *cuts);
    struct split_tree tree = {memory_array(memory, 2 * (uint64_t)count + 1, sizeof *tree.nodes), 2 * count + 1,
                              count + 1};
    const bool has_room = cuts && tree.nodes;
    if (has_room) {
        number_nodes(s, cuts, link_cuts(s, cuts), tree.nodes);
        *ret_tree = tree;
    } else {
        memory_free(memory, tree.nodes);
    }
    memory_free(memory, cuts);
    return has_room ? BVHD_OK : BVHD_NO_MEMORY;
}

static void move_chunk(void *context, size_t index)
{
    const struct splitter *s = context;
    size_t at, end;
    for (parallel_chunk(index, CHUNK, s->request->count, &at, &end); at < end; at++)
        s->request->scratch[at] = s->request->refs[s->refs[at].place];
}

static bool allocate(struct splitter *s, struct memory *memory)
{
    const uint64_t count = s->request->count, large = count / LARGE + 1;
    s->refs = memory_array(memory, count, sizeof *s->refs);
    s->cuts = memory_array(memory, count + 1, sizeof *s->cuts);
    s->parts = memory_array(memory, large, sizeof *s->parts);
    s->next = memory_array(memory, 2 * large, sizeof *s->next);
    s->tasks = memory_array(memory, count + 1, sizeof *s->tasks);
    if (s->cuts)
        memset(s->cuts, 0, count + 1);
    return s->refs && s->cuts && s->parts && s->next && s->tasks;
}

enum bvhd_status moving_split(const struct split_request *request, const struct canonical *canonical,
                              struct memory *memory, const struct parallel *parallel, struct split_tree *ret_tree,
                              struct bvhd_error *error)
{
    struct splitter s = {.request = request, .canonical = canonical};
    enum bvhd_status status = allocate(&s, memory) ? run(&s, parallel) : BVHD_NO_MEMORY;
    if (status == BVHD_OK)
        status = make_tree(&s, memory, ret_tree);
    if (status == BVHD_OK)
        parallel_for(parallel, parallel_chunks(CHUNK, request->count), move_chunk, &s);
    memory_free(memory, s.tasks);
    memory_free(memory, s.next);
    memory_free(memory, s.parts);
    memory_free(memory, s.cuts);
    memory_free(memory, s.refs);
    if (status == BVHD_OK)
        return BVHD_OK;
    return bvhd_error_set(error, status, "",
                          status == BVHD_CANCELLED ? "cancelled" : "no memory to split %u primitives", request->count);
}
