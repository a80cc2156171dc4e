/* SPDX-License-Identifier: Apache-2.0 */
/*
 * turns_avx2.c - traces single rays through unpacked triangles, some at a time in turns: while one waits for memory,
 * the others go on. Each of them gets the answer that it gets alone.
 */
#include "builder/traverse/avx2_walk.h"
#include "builder/traverse/traverse_group.h"

#ifdef BOXTEST_AVX2

enum { TURNS = 8 };

/* One of the rays that take turns. */
struct turn {
    struct traverse_walk walk;
    struct avx2_walk ray;
    struct avx2_cursor cursor;
    unsigned index; /* of the ray */
    bool is_any;
};

/* The rays of a call. */
struct turns {
    const struct traverse_stream *stream;
    const struct ray *rays;
    struct ray_hit *hits;
    uint64_t waiting, done, is_hit; /* rays, as bits */
    bool moves; /* the structure is one of motion triangles */
};

/* Goes on with a ray until it waits. Returns false when it is finished. */
static bool go_on(const struct turns *turns, struct turn *turn)
{
    if (turns->moves)
        return (turn->is_any ? moving_walk_on_any : moving_walk_on_closest)(&turn->ray, &turn->cursor);
    return (turn->is_any ? avx2_walk_on_any : avx2_walk_on_closest)(&turn->ray, &turn->cursor);
}

/* Begins the next ray that can take turns. Returns false if there is none. */
BOXTEST_AVX2 static bool begin_next(struct turns *turns, struct turn *turn)
{
    const struct scene *scene = turns->stream->scene;
    for (; turns->waiting != 0; turns->waiting &= turns->waiting - 1) {
        turn->index = (unsigned)__builtin_ctzll(turns->waiting);
        traverse_state_begin(&turn->walk.state, &turns->rays[turn->index], turns->stream->options);
        traverse_walk_begin(&turn->walk, scene);
        traverse_state_settle_plain(&turn->walk.state);
        const struct portable_view *view = scene->bottoms[0];
        struct traverse_state *state = &turn->walk.state;
        if (!(turns->moves ? moving_walk_init_world(&turn->ray, state, view, scene->unpacked[0])
                           : avx2_walk_init(&turn->ray, state, view, scene->unpacked[0])))
            continue;
        turn->is_any = turn->walk.state.ray->flags & RAY_TERMINATE_ON_FIRST_HIT;
        avx2_cursor_begin(&turn->cursor, turn->is_any);
        turns->waiting &= turns->waiting - 1;
        return true;
    }
    return false;
}

static void finish(struct turns *turns, const struct turn *turn)
{
    const bool is_hit = traverse_state_finish(&turn->walk.state, &turns->hits[turn->index], turns->stream->counters);
    turns->is_hit |= (uint64_t)is_hit << turn->index;
    turns->done |= UINT64_C(1) << turn->index;
}

uint64_t turns_avx2_trace(const struct traverse_stream *stream, const struct ray *rays, uint64_t which,
                          struct ray_hit *ret_hits, uint64_t *is_hit)
{
    struct turns turns = {
        stream, rays, ret_hits, which, 0, 0, stream->scene->bottoms[0]->header->content == PORTABLE_MOVING_TRIANGLES};
    struct turn slots[TURNS], *taking[TURNS];
    unsigned count = 0;
    while (count < TURNS && begin_next(&turns, &slots[count])) {
        taking[count] = &slots[count];
        count++;
    }
    while (count > 0)
        for (unsigned i = 0; i < count; i++) {
            if (go_on(&turns, taking[i]))
                continue;
            finish(&turns, taking[i]);
            if (!begin_next(&turns, taking[i]))
                taking[i--] = taking[--count];
        }
    *is_hit |= turns.is_hit;
    return turns.done;
}

#else

uint64_t turns_avx2_trace(const struct traverse_stream *stream, const struct ray *rays, uint64_t which,
                          struct ray_hit *ret_hits, uint64_t *is_hit)
{
    (void)stream;
    (void)rays;
    (void)which;
    (void)ret_hits;
    (void)is_hit;
    return 0;
}

#endif
