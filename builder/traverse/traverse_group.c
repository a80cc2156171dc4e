/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/traverse/traverse_group.h"

/* Rays are of one kind if they have one octant, and all search any hit or all the closest. */
enum { LANES = 8, KINDS = 16, PACKET_MIN = 3 };

enum { GROUPS_TO_DECIDE = 4, GROUPS_ALONE = 32 };

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
    struct traverse_counters together = {0, 0, 0};
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
    uint32_t done = packet_avx2_trace(states, rays, (1u << count) - 1, scene, &together);
    stream->visits_together += together.nodes;
    if (stream->counters) {
        stream->counters->nodes += together.nodes;
        stream->counters->triangles += together.triangles;
        stream->counters->instances += together.instances;
    }
    for (unsigned lane = 0; lane < count; lane++) {
        unsigned index = indices[lane];
        if (!(done >> lane & 1)) {
            trace_alone(group, index);
            continue;
        }
        stream->visits_alone += states[lane].state.counters.nodes;
        group->is_hit |= (uint64_t)traverse_state_finish(&states[lane].state, &group->hits[index], stream->counters)
                         << index;
    }
}

static bool is_plain(const struct ray *ray)
{
    return !(ray->flags & ~(uint32_t)RAY_TERMINATE_ON_FIRST_HIT) && ray->tmin >= 0 && ray->tmin <= ray->tmax;
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
    const bool is_unpacked =
        scene->unpacked && (scene->top ? scene->unpacked_top != NULL : scene->bottom_count > 0 && scene->unpacked[0]);
    return is_unpacked &&
           (!options ||
            (!options->candidate && !options->flip_order && !options->baseline_only && !options->exact_only)) &&
           boxtest_has_avx2();
}

/*
 * After some groups, decides whether the next rays go alone. Packets pay if rays visit nearly all of their nodes in
 * them: a visit costs half as much there, but a ray that goes on alone pays for both preparations.
 */
static void decide(struct traverse_stream *stream)
{
    if (++stream->groups < GROUPS_TO_DECIDE)
        return;
    stream->alone = 2 * stream->visits_together < 7 * stream->visits_alone ? GROUPS_ALONE : 0;
    stream->groups = 0;
    stream->visits_together = stream->visits_alone = 0;
}

/* Traces the plain rays of each kind in packets. Returns the rays that are left. */
static uint64_t trace_packets(struct group *group, uint64_t plain)
{
    uint8_t members[KINDS][TRAVERSE_GROUP], counts[KINDS] = {0};
    uint64_t left = 0;
    for (; plain != 0; plain &= plain - 1) {
        const unsigned index = (unsigned)__builtin_ctzll(plain), kind = kind_of(&group->rays[index]);
        members[kind][counts[kind]++] = (uint8_t)index;
    }
    for (unsigned kind = 0; kind < KINDS; kind++) {
        unsigned at = 0;
        for (; at + PACKET_MIN <= counts[kind]; at += LANES)
            trace_packet(group, &members[kind][at], counts[kind] - at < LANES ? counts[kind] - at : LANES);
        for (; at < counts[kind]; at++)
            left |= UINT64_C(1) << members[kind][at];
    }
    decide(group->stream);
    return left;
}

/*
 * Returns whether rays that go alone are best traced in turns. In structures that the caches hold they lose a tenth by
 * that; in larger ones they gain up to a half.
 */
static bool turns_pay(const struct scene *scene)
{
    enum { NODES_MIN = 1 << 13 }; /* of a structure of some 6 MiB with its triangles */
    return !scene->top && scene->bottoms[0]->header->node_count >= NODES_MIN;
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
        plain |= (uint64_t)is_plain(&rays[i]) << i;
    left = all & ~plain;
    if (stream->alone == 0)
        plain = trace_packets(&group, plain);
    else
        stream->alone--;
    if (turns_pay(stream->scene))
        plain &= ~turns_avx2_trace(stream, rays, plain, ret_hits, &group.is_hit);
    trace_each(&group, left | plain);
    return group.is_hit;
}
