/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/traverse_group.h"

#include <math.h>

#include "builder/traverse/leaf_kind.h"

/* Rays are of one kind if they have one octant, and all search any hit or all the closest. */
enum { LANES = 8, KINDS = 16, PACKET_MIN = 3 };

enum { TILE_ROW = 8 }; /* rays of a row of a tile of pixels */

/*
 * A decision is made after GROUPS_FIRST groups in packets, and after GROUPS_AGAIN when packets are tried again. Up to
 * ALONE_MAX rays go alone after it, ALONE_FIRST at first.
 */
enum { GROUPS_FIRST = 4, GROUPS_AGAIN = 2, ALONE_FIRST = 2048, ALONE_MAX = 8192 };

/* The rays of a call. */
struct group {
    struct traverse_stream *stream;
    const struct ray *rays;
    struct ray_hit *hits;
    uint64_t is_hit;
};

static void trace_alone(struct group *group, unsigned index)
{
    const struct traverse_stream *stream = group->stream;
    bool is_hit = traverse(stream->scene, &group->rays[index], stream->options, &group->hits[index], stream->counters);
    group->is_hit |= (uint64_t)is_hit << index;
}

/* Traces each of the rays alone. */
static void trace_each(struct group *group, uint64_t which)
{
    for (; which != 0; which &= which - 1)
        trace_alone(group, (unsigned)__builtin_ctzll(which));
}

static void trace_packet(struct group *group, const uint8_t *indices, unsigned count)
{
    struct traverse_stream *stream = group->stream;
    const struct scene *scene = stream->scene;
    struct traverse_walk states[LANES];
    const struct ray *rays[LANES];
    struct packet_work work = {.cost = 0};
    for (unsigned lane = 0; lane < LANES; lane++) {
        rays[lane] = &group->rays[indices[lane < count ? lane : 0]];
        if (lane >= count)
            continue;
        struct traverse_walk *walk = &states[lane];
        traverse_state_begin(&walk->state, rays[lane], stream->options);
        traverse_walk_begin(walk, scene);
        walk->avx2 = true;
        traverse_state_settle_plain(&walk->state);
    }
    uint32_t done = packet_avx2_trace(states, rays, (1u << count) - 1, scene, &work);
    stream->visits_together += work.counters.nodes;
    stream->cost += work.cost;
    if (stream->counters) {
        stream->counters->nodes += work.counters.nodes;
        stream->counters->triangles += work.counters.triangles;
        stream->counters->instances += work.counters.instances;
    }
    for (unsigned lane = 0; lane < count; lane++) {
        unsigned index = indices[lane];
        stream->cost += states[lane].state.counters.nodes / 2; /* turns would have made these cheaper */
        if (!(done >> lane & 1)) {
            trace_alone(group, index);
            continue;
        }
        group->is_hit |= (uint64_t)traverse_state_finish(&states[lane].state, &group->hits[index], stream->counters)
                         << index;
    }
}

/* Returns the kind of a plain ray: the signs of its direction, and whether it searches any hit. */
static unsigned kind_of(const struct ray *ray)
{
    uint32_t direction[3];
    memcpy(direction, ray->direction, sizeof direction);
    return direction[0] >> 31 | direction[1] >> 31 << 1 | direction[2] >> 31 << 2 |
           (ray->flags & RAY_TERMINATE_ON_FIRST_HIT ? 8 : 0);
}

bool traverse_groups_pay(const struct traverse_stream *stream)
{
    const struct scene *scene = stream->scene;
    const struct traverse_options *options = stream->options;
    const bool is_unpacked = scene->unpacked && (scene->top ? scene->unpacked_top != NULL
                                                            : scene->bottom_count > 0 && scene->unpacked[0] &&
                                                                  leaf_kind_of(scene->bottoms[0])->has_packets);
    return is_unpacked &&
           (!options ||
            (!options->candidate && !options->flip_order && !options->baseline_only && !options->exact_only)) &&
           boxtest_has_avx2();
}

/*
 * After some groups, decides whether the next rays go alone: they do if their visits in packets cost clearly more than
 * the same visits by single rays. A small loss is better borne, since the next rays may cohere again. The longer
 * packets have not paid, the later they are tried again.
 */
static void decide(struct traverse_stream *stream)
{
    if (++stream->groups < (stream->pause == 0 ? GROUPS_FIRST : GROUPS_AGAIN))
        return;
    if (8 * stream->visits_together >= 7 * stream->cost)
        stream->pause = 0;
    else if (stream->pause < ALONE_MAX)
        stream->pause = stream->pause ? 2 * stream->pause : ALONE_FIRST;
    stream->alone = stream->pause;
    stream->groups = 0;
    stream->visits_together = stream->cost = 0;
}

/* Returns how far apart the rays of a group begin that are `step` places apart, and in *ret_turned their directions. */
static float spread_of(const struct ray *rays, unsigned step, float *ret_turned)
{
    float moved = 0, turned = 0;
    for (unsigned i = 0; i < TRAVERSE_GROUP; i += TRAVERSE_GROUP / 4)
        for (int axis = 0; axis < 3; axis++) {
            moved += fabsf(rays[i + step].origin[axis] - rays[i].origin[axis]);
            turned += fabsf(rays[i + step].direction[axis] - rays[i].direction[axis]);
        }
    *ret_turned = turned;
    return moved;
}

/*
 * Returns whether a group looks like a tile of pixels, of 8 in a row: then the ray 8 places on, which is that of the
 * pixel below, is nearer than the ray 4 places on. Rays that begin at one point are compared by their directions.
 */
static bool is_tile(const struct ray *rays, uint32_t count)
{
    float row_turned, half_turned;
    if (count < TRAVERSE_GROUP)
        return false;
    const float row_moved = spread_of(rays, TILE_ROW, &row_turned),
                half_moved = spread_of(rays, TILE_ROW / 2, &half_turned);
    return row_moved < half_moved || (row_moved == half_moved && row_turned < half_turned);
}

/*
 * Traces the plain rays of each kind in packets. Returns the rays that are left. A packet of a tile is 4 pixels wide
 * and 2 high, since it meets fewer boxes than a row of 8.
 */
static uint64_t trace_packets(struct group *group, uint32_t count, uint64_t plain)
{
    enum { HALF = TILE_ROW / 2 };
    const struct scene *scene = group->stream->scene;
    const bool packs_any = scene->top || leaf_kind_of(scene->bottoms[0])->packs_any;
    const unsigned packed = packs_any ? KINDS : KINDS / 2;
    const bool is_in_tile = is_tile(group->rays, count);
    uint8_t members[KINDS][TRAVERSE_GROUP], counts[KINDS] = {0};
    uint64_t left = 0;
    for (unsigned i = 0; i < count; i++) {
        const unsigned swapped = (i & ~(unsigned)(HALF | TILE_ROW)) | (i & HALF) << 1 | (i & TILE_ROW) >> 1;
        const unsigned index = is_in_tile ? swapped : i;
        if (!(plain >> index & 1))
            continue;
        const unsigned kind = kind_of(&group->rays[index]);
        members[kind][counts[kind]++] = (uint8_t)index;
    }
    for (unsigned kind = 0; kind < KINDS; kind++) {
        unsigned at = 0;
        for (; kind < packed && at + PACKET_MIN <= counts[kind]; at += LANES)
            trace_packet(group, &members[kind][at], counts[kind] - at < LANES ? counts[kind] - at : LANES);
        for (; at < counts[kind]; at++)
            left |= UINT64_C(1) << members[kind][at];
        /* These count as a loss, so that the next ones are not gathered in vain. */
        group->stream->cost += kind < packed ? 0 : counts[kind];
    }
    decide(group->stream);
    return left;
}

/*
 * Returns whether rays that go alone are best traced in turns. They lose a tenth by that in structures that the caches
 * of a core hold; in larger ones they gain up to a half. A ray that searches any hit waits twice for a node, for its
 * leaves and for its inner children, and finds what it needs early: it gains only where nodes come from memory.
 */
static bool turns_pay(const struct scene *scene, bool is_any)
{
    enum { MIB = 1 << 20, CORE_CACHES = 6 * MIB, ALL_CACHES = 24 * MIB };
    if (scene->top || !leaf_kind_of(scene->bottoms[0])->is_triangles)
        return false;
    const struct portable_header *header = scene->bottoms[0]->header;
    const uint64_t still = (uint64_t)header->node_count * sizeof(struct unpacked_node) +
                           (uint64_t)header->record_count * sizeof(struct portable_triangle);
    const uint64_t size = header->content == PORTABLE_MOVING_TRIANGLES ? unpacked_moving_size(header) : still;
    return size >= (is_any ? ALL_CACHES : CORE_CACHES);
}

/* Returns those of the rays that are best traced in turns. */
static uint64_t choose_turns(const struct group *group, uint64_t plain)
{
    uint64_t closest = 0;
    if (!turns_pay(group->stream->scene, false))
        return 0;
    if (turns_pay(group->stream->scene, true))
        return plain;
    for (uint64_t rest = plain; rest != 0; rest &= rest - 1) {
        const unsigned index = (unsigned)__builtin_ctzll(rest);
        closest |= (uint64_t) !(group->rays[index].flags & RAY_TERMINATE_ON_FIRST_HIT) << index;
    }
    return closest;
}

uint64_t traverse_next_alone(struct traverse_stream *stream, uint64_t most)
{
    if (stream->alone == 0 || turns_pay(stream->scene, false))
        return 0;
    const uint32_t count = most < stream->alone ? (uint32_t)most : stream->alone;
    stream->alone -= count;
    return count;
}

uint64_t traverse_group(struct traverse_stream *stream, const struct ray *rays, uint32_t count,
                        struct ray_hit *ret_hits)
{
    struct group group = {stream, rays, ret_hits, 0};
    const uint64_t all = ~UINT64_C(0) >> (TRAVERSE_GROUP - count);
    uint64_t plain = 0, left;
    if (!traverse_groups_pay(stream)) {
        trace_each(&group, all);
        return group.is_hit;
    }
    for (uint32_t i = 0; i < count; i++)
        plain |= (uint64_t)ray_is_plain(&rays[i]) << i;
    left = all & ~plain;
    if (stream->alone == 0)
        plain = trace_packets(&group, count, plain);
    else
        stream->alone -= count < stream->alone ? count : stream->alone;
    const uint64_t turns = choose_turns(&group, plain);
    if (turns != 0)
        plain &= ~turns_avx2_trace(stream, rays, turns, ret_hits, &group.is_hit);
    trace_each(&group, left | plain);
    return group.is_hit;
}
