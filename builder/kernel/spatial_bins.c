/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/kernel/spatial_bins.h"

#include <math.h>

#include "proto/base/parallel.h"

/*
 * A cut is tried where it may save at least this share of the division's cost, and made where it costs less than this
 * share of it.
 */
static const float SAVING_LEAST = 0.02f, COST_MOST = 0.99f;

/*
 * A ref costs the tree's cost / count on average. That cost is not known yet; it grows about as the square root of the
 * sum of the leaves' areas, which stands in for it. A larger factor makes fewer refs; this one is the point from which
 * on that loses on most scenes.
 */
static const double PRICE = 4;

/* Refs between two checks of the cancel flag; one that crosses all planes takes some microseconds. */
enum { LOOK_EVERY = 512 };

static bool lay_axis(struct spatial_grid *grid, unsigned axis, float low, float high)
{
    float *planes = grid->planes[axis], width = (high - low) / (float)SPATIAL_BINS;
    planes[0] = low;
    for (uint32_t k = 1; k < SPATIAL_BINS; k++) {
        planes[k] = low + width * (float)k;
        if (!(planes[k] > planes[k - 1]))
            return false;
    }
    return planes[SPATIAL_BINS - 1] < high;
}

void spatial_grid_lay(const struct vec4_box *bounds, struct spatial_grid *ret_grid)
{
    for (unsigned axis = 0; axis < 3; axis++) {
        float low = bounds->min[axis], high = bounds->max[axis], scale = (float)SPATIAL_BINS / (high - low);
        bool usable = scale <= FLT_MAX && lay_axis(ret_grid, axis, low, high);
        ret_grid->base[axis] = low;
        ret_grid->scale[axis] = usable ? scale : 0;
    }
}

void spatial_grid_narrow(const struct vec4_box *bounds, unsigned axis, struct spatial_grid *grid)
{
    vec4 extents = bounds->max - bounds->min;
    unsigned longest = extents[1] > extents[0];
    if (extents[2] > extents[longest])
        longest = 2;
    for (unsigned i = 0; i < 3; i++)
        if (i != axis && i != longest)
            grid->scale[i] = 0;
}

/*
 * Returns the last bin that starts at `value` or below it. The quotient is a first guess; comparisons with the planes
 * decide.
 */
static inline uint32_t bin_at(const struct spatial_grid *grid, unsigned axis, float value)
{
    const float *planes = grid->planes[axis];
    float guess = (value - grid->base[axis]) * grid->scale[axis];
    uint32_t last = SPATIAL_BINS - 1, bin = !(guess > 0) ? 0 : guess < (float)last ? (uint32_t)guess : last;
    while (bin > 0 && value < planes[bin])
        bin--;
    while (bin < last && value >= planes[bin + 1])
        bin++;
    return bin;
}

/*
 * The bins that a ref lies in. A ref that ends in a plane does not reach beyond it; a flat ref in a plane lies above
 * it.
 */
struct bin_range {
    uint32_t first, last;
};

static inline struct bin_range span_of(const struct spatial_grid *grid, unsigned axis, const struct vec4_box *box)
{
    struct bin_range span = {bin_at(grid, axis, box->min[axis]), bin_at(grid, axis, box->max[axis])};
    if (span.last > span.first && box->max[axis] == grid->planes[axis][span.last])
        span.last--;
    return span;
}

void spatial_bins_clear(struct spatial_bins *bins)
{
    for (unsigned axis = 0; axis < 3; axis++)
        for (uint32_t k = 0; k < SPATIAL_BINS; k++) {
            bins->boxes[axis][k] = vec4_box_empty();
            bins->begins[axis][k] = bins->ends[axis][k] = 0;
        }
}

static inline void grow(struct vec4_box *box, const struct vec4_box *by)
{
    vec4_box_grow(box, by->min, by->max);
}

/* Cuts a ref at each plane that it crosses, and adds the parts to their bins. */
static void add_parts(struct vec4_box boxes[], const float planes[], const struct clip_shape *shape,
                      struct vec4_box rest, unsigned axis, struct bin_range span)
{
    for (uint32_t k = span.first; k < span.last; k++) {
        struct vec4_box part, more;
        clip_cut(shape, &rest, axis, planes[k + 1], &part, &more);
        grow(&boxes[k], &part);
        rest = more;
    }
    grow(&boxes[span.last], &rest);
}

static void add_ref(struct spatial_bins *bins, const struct canonical *canonical, const struct spatial_grid *grid,
                    const struct primitive_ref *ref)
{
    struct vec4_box box = vec4_box_load(ref);
    struct clip_shape shape;
    bool loaded = false;
    for (unsigned axis = 0; axis < 3; axis++) {
        if (grid->scale[axis] == 0)
            continue;
        struct bin_range span = span_of(grid, axis, &box);
        bins->begins[axis][span.first]++;
        bins->ends[axis][span.last]++;
        if (span.first == span.last) {
            grow(&bins->boxes[axis][span.first], &box);
            continue;
        }
        if (!loaded)
            shape = clip_load(canonical, ref->id);
        loaded = true;
        add_parts(bins->boxes[axis], grid->planes[axis], &shape, box, axis, span);
    }
}

/* The sum of everything right of a plane. */
struct suffix {
    struct vec4_box box;
    uint32_t count;
};

static void choose_on_axis(const struct spatial_bins *bins, unsigned axis, uint32_t most, struct spatial_plane *best)
{
    struct suffix rights[SPATIAL_BINS], right = {vec4_box_empty(), 0}, left = right;
    for (uint32_t k = SPATIAL_BINS - 1; k > 0; k--) {
        grow(&right.box, &bins->boxes[axis][k]);
        right.count += bins->ends[axis][k];
        rights[k] = right;
    }
    for (uint32_t k = 1; k < SPATIAL_BINS; k++) {
        grow(&left.box, &bins->boxes[axis][k - 1]);
        left.count += bins->begins[axis][k - 1];
        right = rights[k];
        if (left.count == 0 || right.count == 0 || left.count + right.count > most)
            continue;
        float cost =
            vec4_box_half_area(left.box) * (float)left.count + vec4_box_half_area(right.box) * (float)right.count;
        if (cost < best->cost)
            *best = (struct spatial_plane){axis, k, cost, left.count, right.count, left.box, right.box, false};
    }
}

bool spatial_bins_add(struct spatial_bins *bins, const struct canonical *canonical, const struct spatial_grid *grid,
                      const struct primitive_ref *refs, uint32_t count, const atomic_bool *cancel)
{
    for (uint32_t i = 0; i < count; i++) {
        if (i % LOOK_EVERY == LOOK_EVERY - 1 && parallel_cancelled(cancel))
            return false;
        add_ref(bins, canonical, grid, &refs[i]);
    }
    return true;
}

void spatial_bins_merge(struct spatial_bins *bins, const struct spatial_bins *other)
{
    for (unsigned axis = 0; axis < 3; axis++)
        for (uint32_t k = 0; k < SPATIAL_BINS; k++) {
            grow(&bins->boxes[axis][k], &other->boxes[axis][k]);
            bins->begins[axis][k] += other->begins[axis][k];
            bins->ends[axis][k] += other->ends[axis][k];
        }
}

bool spatial_bins_choose(const struct spatial_bins *bins, const struct spatial_grid *grid, uint32_t most,
                         struct spatial_plane *ret_plane)
{
    struct spatial_plane best = {.cost = FLT_MAX};
    for (unsigned axis = 0; axis < 3; axis++)
        if (grid->scale[axis] != 0)
            choose_on_axis(bins, axis, most, &best);
    if (best.left_count == 0)
        return false;
    *ret_plane = best;
    return true;
}

/* Returns half the area of what both sides have in common. */
static float overlap_of(const struct bins_plane *plane)
{
    struct vec4_box common = {vec4_max(plane->left.min, plane->right.min), vec4_min(plane->left.max, plane->right.max)};
    unsigned apart = vec4_bits(common.min > common.max) & 7;
    return apart ? 0 : vec4_box_half_area(common);
}

static float cost_of(const struct vec4_box *left, uint32_t left_count, const struct vec4_box *right,
                     uint32_t right_count)
{
    return vec4_box_half_area(*left) * (float)left_count + vec4_box_half_area(*right) * (float)right_count;
}

/*
 * Returns what would be saved if both sides ended in the middle of their overlap and no ref were on both: an upper
 * bound of what a cut there can save.
 */
static float saving_of(const struct bins_plane *plane, uint32_t count)
{
    struct vec4_box left = plane->left, right = plane->right;
    uint32_t right_count = count - plane->left_count;
    float cost = cost_of(&left, plane->left_count, &right, right_count);
    float middle = 0.5f * (right.min[plane->axis] + left.max[plane->axis]);
    left.max[plane->axis] = right.min[plane->axis] = middle;
    return cost - cost_of(&left, plane->left_count, &right, right_count);
}

float spatial_price(double areas, float whole, uint32_t count)
{
    return (float)(PRICE * sqrt(areas * whole) / count);
}

bool spatial_worth_a_try(const struct bins_plane *plane, uint32_t count, uint32_t slack, float price)
{
    if (slack == 0 || !(overlap_of(plane) > 0))
        return false;
    float cost = cost_of(&plane->left, plane->left_count, &plane->right, count - plane->left_count);
    float saving = saving_of(plane, count);
    return saving > SAVING_LEAST * cost && saving > price;
}

bool spatial_is_better(const struct spatial_plane *cut, const struct bins_plane *plane, uint32_t count, float price)
{
    float cost = cost_of(&plane->left, plane->left_count, &plane->right, count - plane->left_count);
    uint32_t more = cut->left_count + cut->right_count - count;
    return cut->cost < COST_MOST * cost && cost - cut->cost > price * (float)more;
}

uint32_t spatial_share_room(uint32_t capacity, const struct spatial_side sides[2])
{
    uint32_t slack = capacity - sides[0].count - sides[1].count;
    double weights[2];
    for (int i = 0; i < 2; i++)
        weights[i] = (double)vec4_box_half_area(sides[i].bounds) * sides[i].count;
    double sum = weights[0] + weights[1];
    return sides[0].count + (sum > 0 ? (uint32_t)(slack * (weights[0] / sum)) : slack / 2);
}

/* Both sides while they are being filled. */
struct filling {
    struct primitive_ref *left, *right; /* left: the next place; right: one above the next place */
    struct spatial_side sides[2];
    struct vec4_box boxes[2]; /* boxes that the plane expects, grown by refs that stay whole */
    uint32_t counts[2];
};

static inline void put(struct filling *filling, int side, struct vec4_box box, const struct primitive_ref *ref)
{
    struct primitive_ref *to = side ? --filling->right : filling->left++;
    struct spatial_side *filled = &filling->sides[side];
    vec4 centroid = box.min + box.max;
    vec4_box_store(to, box);
    to->link = ref->link;
    to->id = ref->id;
    grow(&filled->bounds, &box);
    vec4_box_grow(&filled->centroids, centroid, centroid);
    filled->count++;
}

/* Returns the side on which a ref costs less as a whole than cut on both, or -1. */
static int cheaper_side(const struct vec4_box boxes[2], const uint32_t counts[2], const struct vec4_box *box)
{
    float best = 0, areas[2];
    int side = -1;
    for (int i = 0; i < 2; i++)
        areas[i] = vec4_box_half_area(boxes[i]);
    for (int i = 0; i < 2; i++) {
        struct vec4_box grown = boxes[i];
        grow(&grown, box);
        float more = (vec4_box_half_area(grown) - areas[i]) * (float)counts[i] - areas[!i];
        if (counts[!i] > 1 && more < best) {
            best = more;
            side = i;
        }
    }
    return side;
}

static void put_crossing(struct filling *filling, const struct canonical *canonical, const struct spatial_plane *plane,
                         float position, const struct primitive_ref *ref)
{
    struct vec4_box box = vec4_box_load(ref), parts[2];
    int side = cheaper_side(filling->boxes, filling->counts, &box);
    if (side >= 0) {
        grow(&filling->boxes[side], &box);
        filling->counts[!side]--;
        put(filling, side, box, ref);
        return;
    }
    const struct clip_shape shape = clip_load(canonical, ref->id);
    clip_cut(&shape, &box, plane->axis, position, &parts[0], &parts[1]);
    put(filling, 0, parts[0], ref);
    put(filling, 1, parts[1], ref);
}

void spatial_partition(const struct canonical *canonical, const struct spatial_grid *grid,
                       const struct spatial_plane *plane, const struct primitive_ref *refs, uint32_t count,
                       struct primitive_ref *left, struct primitive_ref *right, struct spatial_side ret_sides[2])
{
    const struct spatial_side none = {vec4_box_empty(), vec4_box_empty(), 0};
    struct filling filling = {.left = left,
                              .right = right,
                              .sides = {none, none},
                              .boxes = {plane->left, plane->right},
                              .counts = {plane->left_count, plane->right_count}};
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box box = vec4_box_load(&refs[i]);
        struct bin_range span = span_of(grid, plane->axis, &box);
        if (span.last < plane->bin)
            put(&filling, 0, box, &refs[i]);
        else if (span.first >= plane->bin)
            put(&filling, 1, box, &refs[i]);
        else
            put_crossing(&filling, canonical, plane, grid->planes[plane->axis][plane->bin], &refs[i]);
    }
    ret_sides[0] = filling.sides[0];
    ret_sides[1] = filling.sides[1];
}

static inline uint8_t side_of(const struct spatial_grid *grid, const struct spatial_plane *plane,
                              const struct primitive_ref *ref)
{
    struct vec4_box box = vec4_box_load(ref), boxes[2] = {plane->left, plane->right};
    struct bin_range span = span_of(grid, plane->axis, &box);
    if (span.last < plane->bin)
        return 0;
    if (span.first >= plane->bin)
        return 1;
    int side =
        plane->cut_all ? -1 : cheaper_side(boxes, (const uint32_t[2]){plane->left_count, plane->right_count}, &box);
    return side < 0 ? SPATIAL_BOTH : (uint8_t)side;
}

void spatial_assign(const struct spatial_grid *grid, const struct spatial_plane *plane,
                    const struct primitive_ref *refs, uint32_t count, uint8_t *ret_sides, uint32_t ret_counts[2])
{
    uint32_t counts[3] = {0, 0, 0};
    for (uint32_t i = 0; i < count; i++) {
        ret_sides[i] = side_of(grid, plane, &refs[i]);
        counts[ret_sides[i]]++;
    }
    ret_counts[0] = counts[0] + counts[SPATIAL_BOTH];
    ret_counts[1] = counts[1] + counts[SPATIAL_BOTH];
}

static inline void append(struct spatial_side *side, struct primitive_ref *to, struct vec4_box box,
                          const struct primitive_ref *ref)
{
    vec4 centroid = box.min + box.max;
    to += side->count++;
    vec4_box_store(to, box);
    to->link = ref->link;
    to->id = ref->id;
    grow(&side->bounds, &box);
    vec4_box_grow(&side->centroids, centroid, centroid);
}

void spatial_send(const struct canonical *canonical, const struct spatial_grid *grid, const struct spatial_plane *plane,
                  const struct primitive_ref *refs, const uint8_t *sides, uint32_t count, struct primitive_ref *left,
                  struct primitive_ref *right, struct spatial_side ret_sides[2])
{
    const struct spatial_side none = {vec4_box_empty(), vec4_box_empty(), 0};
    struct spatial_side filled[2] = {none, none};
    struct primitive_ref *to[2] = {left, right};
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box box = vec4_box_load(&refs[i]), parts[2] = {box, box};
        if (sides[i] == SPATIAL_BOTH) {
            const struct clip_shape shape = clip_load(canonical, refs[i].id);
            clip_cut(&shape, &box, plane->axis, grid->planes[plane->axis][plane->bin], &parts[0], &parts[1]);
        }
        for (int side = 0; side < 2; side++)
            if (sides[i] == side || sides[i] == SPATIAL_BOTH)
                append(&filled[side], to[side], parts[side], &refs[i]);
    }
    ret_sides[0] = filled[0];
    ret_sides[1] = filled[1];
}
