/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/top/crossing.h"

#include <stddef.h>

#include "builder/top/moving_bins.h"

/*
 * The sample has one ref of every SAMPLE_SHARE. A place is where PLACE_REFS of it are, or so many that they stand for
 * PLACE_LEAST refs. Of the refs that are there up to twice NEIGHBOURS are taken, and divided into parts of up to PART.
 */
enum {
    SAMPLE_SHARE = 128,
    SAMPLE_LEAST = 256,
    SAMPLE_MOST = 4096,
    PLACES = 2,
    PLACE_REFS = 8,
    PLACE_LEAST = 128,
    NEIGHBOURS_LEAST = 32,
    NEIGHBOURS = 96,
    PART = 16
};

/* It crosses if the nodes cost less than this share. Where neighbours move alike, the share is 0.86 to 1.1. */
static const double worth = 0.8;

/* Refs that lie one after the other. */
struct span {
    const struct primitive_ref *refs;
    uint32_t count;
};

static uint32_t span_count(const struct primitive_refs *refs)
{
    return refs->blocks ? refs->block_count : 1;
}

static struct span span_at(const struct primitive_refs *refs, uint32_t index)
{
    if (!refs->blocks)
        return (struct span){refs->refs, refs->count};
    return (struct span){refs->refs + (size_t)index * refs->block_size, refs->blocks[index]};
}

/* Makes a ref that is at both ends where the other one is at any time. */
static struct moving_ref at_all_times(const struct primitive_ref *ref)
{
    const struct box box = primitive_ref_box(ref), keys[2] = {box, box};
    return moving_ref_of(keys, 0);
}

/* Returns of how many refs the sample has one. */
static uint32_t sample_step(const struct primitive_refs *refs)
{
    const uint32_t share = refs->count / SAMPLE_SHARE, size = share < SAMPLE_LEAST  ? SAMPLE_LEAST
                                                              : share > SAMPLE_MOST ? SAMPLE_MOST
                                                                                    : share;
    return refs->count < size ? 1 : (refs->count + size - 1) / size;
}

/* Takes one ref of every `step`, and returns how many these are. */
static uint32_t take_sample(const struct primitive_refs *refs, uint32_t step, struct moving_ref *ret_sample)
{
    uint32_t count = 0, at = 0;
    for (uint32_t i = 0; i < span_count(refs); i++) {
        const struct span span = span_at(refs, i);
        for (; at < span.count; at += step)
            ret_sample[count++] = at_all_times(&span.refs[at]);
        at -= span.count;
    }
    return count;
}

/* Divides a part of the sample until few refs are left, of the larger side each time, and returns where those are. */
static struct box find_place(struct moving_ref *sample, uint32_t count, uint32_t step)
{
    struct box box = box_empty();
    while (count > PLACE_REFS && count * step > PLACE_LEAST) {
        const uint32_t left = moving_bins_divide(sample, count);
        sample += left < count - left ? left : 0;
        count = left < count - left ? count - left : left;
    }
    for (uint32_t i = 0; i < count; i++) {
        float centre[3];
        for (int axis = 0; axis < 3; axis++)
            centre[axis] = sample[i].keys[0].min[axis] - sample[i].keys[0].negated_max[axis];
        box_add_point(&box, centre);
    }
    return box;
}

/* Refs at a place: of those that are there each `step`-th one, in their order. */
struct neighbours {
    struct vec4_box place;
    const struct primitive_ref *refs[2 * NEIGHBOURS];
    uint32_t count, seen, step;
};

/* Adds a ref. When there is no more room, every second one is dropped. */
static void add_neighbour(struct neighbours *neighbours, const struct primitive_ref *ref)
{
    if (neighbours->seen++ % neighbours->step != 0)
        return;
    neighbours->refs[neighbours->count++] = ref;
    if (neighbours->count < 2 * NEIGHBOURS)
        return;
    for (uint32_t i = 0; i < NEIGHBOURS; i++)
        neighbours->refs[i] = neighbours->refs[2 * i];
    neighbours->count = NEIGHBOURS;
    neighbours->step *= 2;
}

/* Finds the refs at all places. */
static void find_neighbours(const struct primitive_refs *refs, struct neighbours neighbours[PLACES])
{
    for (uint32_t i = 0; i < span_count(refs); i++) {
        const struct span span = span_at(refs, i);
        for (uint32_t at = 0; at < span.count; at++) {
            const struct vec4_box box = vec4_box_load(&span.refs[at]);
            const vec4 centre = box.min + box.max;
            for (int k = 0; k < PLACES; k++) {
                const struct vec4_box *place = &neighbours[k].place;
                if ((vec4_bits((centre >= place->min) & (centre <= place->max)) & 7) == 7)
                    add_neighbour(&neighbours[k], &span.refs[at]);
            }
        }
    }
}

/* A part that is still to be divided. */
struct part {
    uint32_t first, count;
};

/* Divides refs, and returns the sum of the areas at both ends of all nodes. `boxes` are those by number. */
static double cost_of(struct moving_ref *refs, uint32_t count, const struct moving_ref *boxes)
{
    struct part waiting[33] = {{0, count}};
    uint32_t waits = 1;
    double cost = 0;
    while (waits > 0) {
        const struct part part = waiting[--waits];
        struct moving_ref sum = boxes[refs[part.first].place];
        for (uint32_t i = 1; i < part.count; i++)
            moving_ref_grow(&sum, &boxes[refs[part.first + i].place]);
        cost += moving_ref_area(&sum);
        if (part.count <= PART)
            continue;
        const uint32_t left = moving_bins_divide(refs + part.first, part.count);
        const struct part children[2] = {{part.first, left}, {part.first + left, part.count - left}};
        const bool right_first = children[1].count < children[0].count;
        waiting[waits++] = children[!right_first];
        waiting[waits++] = children[right_first];
    }
    return cost;
}

static bool crosses_at(const struct canonical *canonical, const struct neighbours *neighbours)
{
    struct moving_ref boxes[2 * NEIGHBOURS], divided[2 * NEIGHBOURS];
    struct primitive_finder finder = {.canonical = canonical};
    const uint32_t count = neighbours->count;
    double costs[2];
    if (count < NEIGHBOURS_LEAST)
        return false;
    for (uint32_t i = 0; i < count; i++)
        moving_ref_read(&finder, neighbours->refs[i]->id, i, &boxes[i]);
    for (int by_ends = 0; by_ends < 2; by_ends++) {
        for (uint32_t i = 0; i < count; i++) {
            divided[i] = boxes[i];
            if (!by_ends)
                moving_ref_unite(&divided[i]);
        }
        costs[by_ends] = cost_of(divided, count, boxes);
    }
    return costs[1] < worth * costs[0];
}

enum bvhd_status crossing_find(const struct canonical *canonical, const struct primitive_refs *refs,
                               struct memory *memory, bool *ret_crosses)
{
    *ret_crosses = false;
    if (!canonical_moves(canonical) || refs->count < NEIGHBOURS_LEAST)
        return BVHD_OK;
    const uint32_t step = sample_step(refs);
    struct moving_ref *sample = memory_array(memory, refs->count / step + 1, sizeof *sample);
    if (!sample)
        return BVHD_NO_MEMORY;
    const uint32_t count = take_sample(refs, step, sample), left = moving_bins_divide(sample, count);
    const struct box places[PLACES] = {find_place(sample, left, step), find_place(sample + left, count - left, step)};
    struct neighbours neighbours[PLACES];
    for (int i = 0; i < PLACES; i++)
        neighbours[i] = (struct neighbours){.place = vec4_box_from(&places[i]), .step = 1};
    find_neighbours(refs, neighbours);
    for (int i = 0; i < PLACES; i++)
        *ret_crosses = *ret_crosses || crosses_at(canonical, &neighbours[i]);
    memory_free(memory, sample);
    return BVHD_OK;
}
