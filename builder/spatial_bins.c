/* SPDX-License-Identifier: Apache-2.0 */
#include "spatial_bins.h"

#include "parallel.h"

/* A ref that crosses all planes takes some microseconds. */
enum { LOOK_EVERY = 512 };

/* Parts in a bin, grown by boxes; how many refs begin and end in it. */
struct bins {
    struct vec4_box boxes[3][SPATIAL_BINS_MAX]; /* by axis */
    uint32_t begins[3][SPATIAL_BINS_MAX], ends[3][SPATIAL_BINS_MAX];
};

/* Cutting costs as much as all else together, and a ref is cut at every plane that it crosses: where there are few refs, few planes do. */
static uint32_t bins_for(uint32_t count)
{
    uint32_t bins = 4 + count / 8;
    return bins < SPATIAL_BINS_MAX ? bins : SPATIAL_BINS_MAX;
}

static bool lay_axis(struct spatial_grid *grid, unsigned axis, float low, float high)
{
    float *planes = grid->planes[axis], width = (high - low) / (float)grid->bins;
    planes[0] = low;
    for (uint32_t k = 1; k < grid->bins; k++) {
        planes[k] = low + width * (float)k;
        if (!(planes[k] > planes[k - 1]))
            return false;
    }
    return planes[grid->bins - 1] < high;
}

void spatial_grid_lay(const struct vec4_box *bounds, uint32_t count, struct spatial_grid *ret_grid)
{
    ret_grid->bins = bins_for(count);
    for (unsigned axis = 0; axis < 3; axis++) {
        float low = bounds->min[axis], high = bounds->max[axis], scale = (float)ret_grid->bins / (high - low);
        bool usable = scale <= FLT_MAX && lay_axis(ret_grid, axis, low, high);
        ret_grid->base[axis] = low;
        ret_grid->scale[axis] = usable ? scale : 0;
    }
}

/* The last bin that begins at `value` or below; planes decide, the quotient is where to look first. */
static inline uint32_t bin_at(const struct spatial_grid *grid, unsigned axis, float value)
{
    const float *planes = grid->planes[axis];
    float guess = (value - grid->base[axis]) * grid->scale[axis];
    uint32_t last = grid->bins - 1, bin = !(guess > 0) ? 0 : guess < (float)last ? (uint32_t)guess : last;
    while (bin > 0 && value < planes[bin])
        bin--;
    while (bin < last && value >= planes[bin + 1])
        bin++;
    return bin;
}

/* Bins that a ref is in: what ends in a plane is not beyond it, what is flat in a plane is above it. */
struct span {
    uint32_t first, last;
};

static inline struct span span_of(const struct spatial_grid *grid, unsigned axis, const struct vec4_box *box)
{
    struct span span = {bin_at(grid, axis, box->min[axis]), bin_at(grid, axis, box->max[axis])};
    if (span.last > span.first && box->max[axis] == grid->planes[axis][span.last])
        span.last--;
    return span;
}

static void bins_clear(struct bins *bins, uint32_t count)
{
    for (unsigned axis = 0; axis < 3; axis++)
        for (uint32_t k = 0; k < count; k++) {
            bins->boxes[axis][k] = vec4_box_empty();
            bins->begins[axis][k] = bins->ends[axis][k] = 0;
        }
}

static inline void grow(struct vec4_box *box, const struct vec4_box *by)
{
    vec4_box_grow(box, by->min, by->max);
}

/* Cuts a ref at each plane that it crosses. */
static void add_parts(struct vec4_box boxes[], const float planes[], const struct clip_triangle *triangle, struct vec4_box rest,
                      unsigned axis, struct span span)
{
    for (uint32_t k = span.first; k < span.last; k++) {
        struct vec4_box part, more;
        clip_cut(triangle, &rest, axis, planes[k + 1], &part, &more);
        grow(&boxes[k], &part);
        rest = more;
    }
    grow(&boxes[span.last], &rest);
}

static void bins_add(struct bins *bins, const struct canonical *canonical, const struct spatial_grid *grid,
                     const struct primitive_ref *ref)
{
    struct vec4_box box = vec4_box_load(ref);
    struct clip_triangle triangle;
    bool loaded = false;
    for (unsigned axis = 0; axis < 3; axis++) {
        if (grid->scale[axis] == 0)
            continue;
        struct span span = span_of(grid, axis, &box);
        bins->begins[axis][span.first]++;
        bins->ends[axis][span.last]++;
        if (span.first == span.last) {
            grow(&bins->boxes[axis][span.first], &box);
            continue;
        }
        if (!loaded)
            triangle = clip_load(canonical, ref->id);
        loaded = true;
        add_parts(bins->boxes[axis], grid->planes[axis], &triangle, box, axis, span);
    }
}

/* Everything right of each plane, summed up. */
struct suffix {
    struct vec4_box box;
    uint32_t count;
};

static void choose_on_axis(const struct bins *bins, uint32_t bin_count, unsigned axis, uint32_t most, struct spatial_plane *best)
{
    struct suffix rights[SPATIAL_BINS_MAX], right = {vec4_box_empty(), 0}, left = right;
    for (uint32_t k = bin_count - 1; k > 0; k--) {
        grow(&right.box, &bins->boxes[axis][k]);
        right.count += bins->ends[axis][k];
        rights[k] = right;
    }
    for (uint32_t k = 1; k < bin_count; k++) {
        grow(&left.box, &bins->boxes[axis][k - 1]);
        left.count += bins->begins[axis][k - 1];
        right = rights[k];
        if (left.count == 0 || right.count == 0 || left.count + right.count > most)
            continue;
        float cost = vec4_box_half_area(left.box) * (float)left.count + vec4_box_half_area(right.box) * (float)right.count;
        if (cost < best->cost)
            *best = (struct spatial_plane){axis, k, cost, left.count, right.count, left.box, right.box};
    }
}

bool spatial_choose(const struct canonical *canonical, const struct spatial_grid *grid, const struct primitive_ref *refs,
                    uint32_t count, uint32_t slack, const atomic_bool *cancel, struct spatial_plane *ret_plane)
{
    struct bins bins;
    struct spatial_plane best = {.cost = FLT_MAX};
    bins_clear(&bins, grid->bins);
    for (uint32_t i = 0; i < count; i++) {
        if (i % LOOK_EVERY == LOOK_EVERY - 1 && parallel_cancelled(cancel))
            return false;
        bins_add(&bins, canonical, grid, &refs[i]);
    }
    for (unsigned axis = 0; axis < 3; axis++)
        if (grid->scale[axis] != 0)
            choose_on_axis(&bins, grid->bins, axis, count + slack, &best);
    if (best.left_count == 0)
        return false;
    *ret_plane = best;
    return true;
}

/* Both sides as they fill up. */
struct filling {
    struct primitive_ref *left, *right; /* the next place, one above the next place */
    struct spatial_side sides[2];
    struct vec4_box boxes[2]; /* what is expected of the plane, grown by refs that are left whole */
    uint32_t counts[2];
};

static inline void put(struct filling *filling, int side, struct vec4_box box, const struct primitive_ref *ref)
{
    struct primitive_ref *to = side ? --filling->right : filling->left++;
    struct spatial_side *filled = &filling->sides[side];
    vec4 centroid = box.min + box.max;
    vec4_box_store(to, box);
    to->geometry = ref->geometry;
    to->id = ref->id;
    grow(&filled->bounds, &box);
    vec4_box_grow(&filled->centroids, centroid, centroid);
    filled->count++;
}

/* The side on which a ref costs less as a whole than cut on both, or -1. Neither side is left without refs. */
static int whole_side(const struct filling *filling, const struct vec4_box *box)
{
    float best = 0, counts[2] = {(float)filling->counts[0], (float)filling->counts[1]}, areas[2];
    int side = -1;
    for (int i = 0; i < 2; i++)
        areas[i] = vec4_box_half_area(filling->boxes[i]);
    for (int i = 0; i < 2; i++) {
        struct vec4_box grown = filling->boxes[i];
        grow(&grown, box);
        float more = (vec4_box_half_area(grown) - areas[i]) * counts[i] - areas[!i];
        if (filling->counts[!i] > 1 && more < best) {
            best = more;
            side = i;
        }
    }
    return side;
}

static void put_crossing(struct filling *filling, const struct canonical *canonical, const struct spatial_plane *plane, float position,
                         const struct primitive_ref *ref)
{
    struct vec4_box box = vec4_box_load(ref), parts[2];
    int side = whole_side(filling, &box);
    if (side >= 0) {
        grow(&filling->boxes[side], &box);
        filling->counts[!side]--;
        put(filling, side, box, ref);
        return;
    }
    struct clip_triangle triangle = clip_load(canonical, ref->id);
    clip_cut(&triangle, &box, plane->axis, position, &parts[0], &parts[1]);
    put(filling, 0, parts[0], ref);
    put(filling, 1, parts[1], ref);
}

void spatial_partition(const struct canonical *canonical, const struct spatial_grid *grid, const struct spatial_plane *plane,
                       const struct primitive_ref *refs, uint32_t count, struct primitive_ref *left, struct primitive_ref *right,
                       struct spatial_side ret_sides[2])
{
    const struct spatial_side none = {vec4_box_empty(), vec4_box_empty(), 0};
    struct filling filling = {.left = left,
                              .right = right,
                              .sides = {none, none},
                              .boxes = {plane->left, plane->right},
                              .counts = {plane->left_count, plane->right_count}};
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box box = vec4_box_load(&refs[i]);
        struct span span = span_of(grid, plane->axis, &box);
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
