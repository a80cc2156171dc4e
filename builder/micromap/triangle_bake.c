/* SPDX-License-Identifier: Apache-2.0 */
/* triangle_bake.c - follows the curve through a triangle, as far down as something is undecided. */
#include "builder/micromap/triangle_bake.h"

#include <string.h>

#include "proto/base/parallel.h"

/* The flag of a cancellation is read after so many tests, which take about a tenth of a millisecond. */
enum { TESTS_A_LOOK = 1024 };

struct walk {
    const struct triangle_baker *baker;
    const struct texture_triangle *triangle;
    enum micro_format format;
    unsigned last; /* level */
    unsigned char *states;
    uint32_t *counts;
    uint32_t tests;
    bool is_cancelled;
};

/*
 * A corner of a micro-triangle: its u and v, in parts of the edges at its level, in the upper and lower half of a
 * number, so that one sum adds both.
 */
typedef uint32_t grid_point;

static inline uint32_t u_of(grid_point point)
{
    return point >> 16;
}

static inline uint32_t v_of(grid_point point)
{
    return point & 0xffff;
}

/* A micro-triangle: its corners in the curve's order. */
struct micro {
    grid_point a, b, c;
};

/* Returns a child; the numbers of parts double from one level to the next, so that middles are sums. */
static inline struct micro child_of(const struct micro *micro, unsigned child)
{
    const grid_point p = micro->a + micro->b, q = micro->b + micro->c, r = micro->c + micro->a;
    switch (child) {
    case 0:
        return (struct micro){2 * micro->a, p, r};
    case 1:
        return (struct micro){r, q, p};
    case 2:
        return (struct micro){p, 2 * micro->b, q};
    default:
        return (struct micro){q, r, 2 * micro->c};
    }
}

/* Where a micro-triangle is. */
struct spot {
    double anchor[2];
    bool is_upright;
};

/* The corners (i, j), (i + 1, j), (i, j + 1) have u that add up to 3 i + 1, those of a turned one to 3 i + 2. */
static inline struct spot spot_of(const struct walk *walk, unsigned level, const struct micro *micro)
{
    const grid_point sum = micro->a + micro->b + micro->c;
    const uint32_t i = u_of(sum) / 3, j = v_of(sum) / 3;
    struct spot spot = {.is_upright = u_of(sum) - 3 * i == 1};
    const uint32_t turned = spot.is_upright ? 0 : 1;
    texture_triangle_anchor(walk->triangle, level, i + turned, j + turned, spot.anchor);
    return spot;
}

/* Returns whether the middle passes the test. */
static bool middle_passes(const struct walk *walk, unsigned level, const struct spot *spot)
{
    const struct micro_grid *grid = &walk->triangle->grids[level];
    double at[2];
    for (int axis = 0; axis < 2; axis++) {
        const double across = (grid->step_u[axis] + grid->step_v[axis]) / 3;
        at[axis] = spot->is_upright ? spot->anchor[axis] + across : spot->anchor[axis] - across;
    }
    return alpha_cells_pass(walk->baker->cells, at[0], at[1]);
}

static inline bool is_decided(unsigned seen)
{
    return seen == ALPHA_PASSES || seen == ALPHA_FAILS;
}

static inline enum micro_state state_of(unsigned seen)
{
    return seen == ALPHA_PASSES ? MICRO_OPAQUE : MICRO_TRANSPARENT;
}

/* Counts a test, and looks now and then whether the bake was cancelled. */
static inline void count_test(struct walk *walk)
{
    if (++walk->tests % TESTS_A_LOOK == 0 && parallel_cancelled(walk->baker->cancel))
        walk->is_cancelled = true;
}

/* Returns what a quick look decides. */
static inline unsigned look(struct walk *walk, unsigned level, const struct spot *spot)
{
    count_test(walk);
    return micro_scan(walk->baker->cells, walk->triangle, level, spot->is_upright, spot->anchor,
                      walk->triangle->grids[level].order);
}

/*
 * Returns the state of a micro-triangle. Where alpha is filtered, points that differ are looked for first: half of the
 * micro-triangles along an outline have some. Bounds are computed last.
 */
static enum micro_state look_closely(struct walk *walk, unsigned level, const struct spot *spot)
{
    const struct alpha_cells *cells = walk->baker->cells;
    const struct micro_grid *grid = &walk->triangle->grids[level];
    count_test(walk);
    const bool passes = middle_passes(walk, level, spot);
    const enum micro_state unknown = passes ? MICRO_UNKNOWN_OPAQUE : MICRO_UNKNOWN_TRANSPARENT;
    if (cells->is_mask && micro_scan_corners(cells, walk->triangle, level, spot->is_upright, spot->anchor) !=
                              (passes ? ALPHA_PASSES : ALPHA_FAILS))
        return unknown;
    unsigned seen = micro_scan(cells, walk->triangle, level, spot->is_upright, spot->anchor, grid->order_last);
    if (!is_decided(seen) && grid->may_bound)
        seen = micro_scan_bounds(cells, walk->triangle, level, spot->is_upright, spot->anchor);
    return is_decided(seen) ? state_of(seen) : unknown;
}

/* Returns the state of a micro-triangle of the last level. */
static inline enum micro_state last_state(struct walk *walk, const struct micro *micro)
{
    const struct spot spot = spot_of(walk, walk->last, micro);
    if (walk->format == MICRO_2_STATE)
        return middle_passes(walk, walk->last, &spot) ? MICRO_OPAQUE : MICRO_TRANSPARENT;
    return look_closely(walk, walk->last, &spot);
}

/* Sets `count` states from the first one on: four, or a multiple of eight. */
static void set_states(struct walk *walk, uint32_t first, uint32_t count, enum micro_state state)
{
    static const unsigned char pattern[] = {0x00, 0x55, 0xaa, 0xff};
    const unsigned bits = (unsigned)walk->format, byte = walk->format == MICRO_4_STATE ? pattern[state]
                                                         : state == MICRO_OPAQUE       ? 0xff
                                                                                       : 0;
    walk->counts[state] += count;
    if (count * bits < 8)
        walk->states[first * bits / 8] |= (unsigned char)((byte & 0x0f) << first * bits % 8);
    else
        memset(walk->states + first * bits / 8, (int)byte, count * bits / 8);
}

/* Writes the states of the four children of a micro-triangle, which are of the last level. */
static void write_children(struct walk *walk, uint32_t index, const struct micro *micro)
{
    const unsigned bits = (unsigned)walk->format;
    unsigned byte = 0;
    for (unsigned child = 0; child < 4; child++) {
        const struct micro below = child_of(micro, child);
        const enum micro_state state = last_state(walk, &below);
        walk->counts[state]++;
        byte |= (unsigned)state << child * bits;
    }
    walk->states[index * 4 * bits / 8] |= (unsigned char)(byte << index * 4 * bits % 8);
}

static void write_below(struct walk *walk, unsigned level, uint32_t index, const struct micro *micro)
{
    const struct spot spot = spot_of(walk, level, micro);
    const unsigned seen = look(walk, level, &spot), below = walk->last - level;
    if (is_decided(seen)) {
        set_states(walk, index << 2 * below, micro_triangle_count(below), state_of(seen));
    } else if (below == 1) {
        write_children(walk, index, micro);
    } else {
        for (unsigned child = 0; child < 4 && !walk->is_cancelled; child++) {
            const struct micro next = child_of(micro, child);
            write_below(walk, level + 1, 4 * index + child, &next);
        }
    }
}

/* Returns how many parts of MICRO_COUNT_MAX are decided below a micro-triangle at the last level. */
static uint32_t count_below(struct walk *walk, unsigned level, const struct micro *micro)
{
    const struct spot spot = spot_of(walk, level, micro);
    const bool is_last = level == walk->last;
    if (is_last ? look_closely(walk, level, &spot) <= MICRO_OPAQUE : is_decided(look(walk, level, &spot)))
        return micro_triangle_count(MICRO_LEVEL_MAX - level);
    uint32_t decided = 0;
    for (unsigned child = 0; child < 4 && !is_last && !walk->is_cancelled; child++) {
        const struct micro next = child_of(micro, child);
        decided += count_below(walk, level + 1, &next);
    }
    return decided;
}

static void prefetch(const struct walk *walk)
{
    const struct texture_triangle *triangle = walk->triangle;
    double low[2], high[2];
    for (int axis = 0; axis < 2; axis++) {
        const double u = triangle->edge_u[axis], v = triangle->edge_v[axis];
        low[axis] = triangle->corner[axis] + (u < v ? u < 0 ? u : 0 : v < 0 ? v : 0);
        high[axis] = triangle->corner[axis] + (u > v ? u > 0 ? u : 0 : v > 0 ? v : 0);
    }
    alpha_cells_prefetch(walk->baker->cells, low, high);
}

static const struct micro whole = {0, 1 << 16, 1};

unsigned triangle_bake_whole(const struct triangle_baker *baker, const struct texture_triangle *triangle)
{
    const struct alpha_cells *cells = baker->cells;
    if (triangle->is_everywhere)
        return alpha_cells_run(&cells->orders[cells->order_count - 1], 0, 0, 0);
    struct walk walk = {.baker = baker, .triangle = triangle};
    const struct spot spot = spot_of(&walk, 0, &whole);
    const enum micro_state state = look_closely(&walk, 0, &spot);
    return state == MICRO_OPAQUE ? ALPHA_PASSES : state == MICRO_TRANSPARENT ? ALPHA_FAILS : ALPHA_MIXED;
}

bool triangle_bake_states(const struct triangle_baker *baker, const struct texture_triangle *triangle,
                          enum micro_format format, unsigned level, unsigned char *states,
                          uint32_t counts[MICRO_STATES])
{
    struct walk walk = {
        .baker = baker, .triangle = triangle, .format = format, .last = level, .states = states, .counts = counts};
    const uint32_t bytes = micro_triangle_bytes(format, level);
    if (triangle->is_everywhere) {
        const unsigned seen = triangle_bake_whole(baker, triangle);
        const enum micro_state state = is_decided(seen)          ? state_of(seen)
                                       : format == MICRO_2_STATE ? MICRO_OPAQUE
                                                                 : MICRO_UNKNOWN_OPAQUE;
        memset(states, 0, bytes);
        if (level == 0) {
            counts[state]++;
            states[0] = (unsigned char)state;
        } else {
            set_states(&walk, 0, micro_triangle_count(level), state);
        }
        return true;
    }
    if (level == 0) {
        const enum micro_state state = last_state(&walk, &whole);
        counts[state]++;
        states[0] = (unsigned char)state;
        return !walk.is_cancelled;
    }
    memset(states, 0, bytes);
    prefetch(&walk);
    write_below(&walk, 0, 0, &whole);
    return !walk.is_cancelled;
}

/*
 * Returns whether a level after `level` may decide enough: at best the next one decides all that is left, and others
 * take more bytes for that.
 */
static bool is_worth_it(enum micro_format format, unsigned level, uint32_t decided, double worth)
{
    const double bytes = (double)micro_triangle_bytes(format, level + 1) -
                         (double)(level == 0 ? 0 : micro_triangle_bytes(format, level));
    return decided < MICRO_COUNT_MAX && (double)(MICRO_COUNT_MAX - decided) >= worth * bytes;
}

bool triangle_bake_explore(const struct triangle_baker *baker, const struct texture_triangle *triangle,
                           enum micro_format format, unsigned last, double worth,
                           uint32_t ret_decided[MICRO_LEVEL_MAX + 1])
{
    struct walk walk = {.baker = baker, .triangle = triangle, .format = format};
    uint32_t decided = 0;
    bool goes_on = !triangle->is_everywhere;
    if (triangle->is_everywhere && is_decided(triangle_bake_whole(baker, triangle)))
        decided = MICRO_COUNT_MAX;
    else if (goes_on)
        prefetch(&walk);
    for (walk.last = 0; walk.last <= MICRO_LEVEL_MAX; walk.last++) {
        goes_on = goes_on && walk.last <= last && !walk.is_cancelled;
        if (goes_on) {
            const uint32_t now = count_below(&walk, 0, &whole);
            decided = now > decided ? now : decided; /* blocks of texels can make it less */
            goes_on = walk.last < MICRO_LEVEL_MAX && is_worth_it(format, walk.last, decided, worth);
        }
        ret_decided[walk.last] = decided;
    }
    return !walk.is_cancelled;
}
