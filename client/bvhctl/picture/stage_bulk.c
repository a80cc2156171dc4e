/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/picture/stage_bulk.h"

#include <stdlib.h>

enum { MANY_INSTANCES = 16 };

static const double clear_of_box = 1.6, /* the factor by which everything may be larger before some of it is left out */
    endless = 3, /* a ground or a spike is that many times as large as everything else */
    flat = 0.02, /* the thickness of a ground, in its width */
    thin = 0.15, /* the area of a spike, in that of the square of its length */
    worth = 25; /* the logarithm of the factor by which the bulk may grow to include everything instead of nothing */

/* An axis-aligned box in world space. */
struct extents {
    double low[3], high[3];
};

static const struct extents no_extents = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static void add_point(struct extents *box, struct vector point)
{
    for (int axis = 0; axis < 3; axis++) {
        double at = vector_component(point, axis);
        box->low[axis] = fmin(box->low[axis], at);
        box->high[axis] = fmax(box->high[axis], at);
    }
}

static void add_corners(struct extents *box, const struct stage_sample *sample)
{
    for (int i = 0; i < 3; i++)
        add_point(box, sample->corners[i]);
}

static double extent(const struct extents *box, int axis)
{
    return fmax(box->high[axis] - box->low[axis], 0);
}

static double diagonal(const struct extents *box)
{
    return vector_length(vector_make(extent(box, 0), extent(box, 1), extent(box, 2)));
}

static bool is_within(const struct extents *box, struct vector point)
{
    for (int axis = 0; axis < 3; axis++) {
        double at = vector_component(point, axis);
        if (at < box->low[axis] || at > box->high[axis])
            return false;
    }
    return true;
}

/* A sample in an order. */
struct ranked {
    double rank;
    uint32_t sample;
};

static int compare_ranks(const void *a, const void *b)
{
    const struct ranked *x = a, *y = b;
    return x->rank != y->rank ? (x->rank > y->rank) - (x->rank < y->rank)
                              : (x->sample > y->sample) - (x->sample < y->sample);
}

static bool is_spike(const struct stage_sample *sample)
{
    struct vector a = vector_scale(vector_sub(sample->corners[1], sample->corners[0]), 1 / sample->reach);
    struct vector b = vector_scale(vector_sub(sample->corners[2], sample->corners[0]), 1 / sample->reach);
    return vector_length(vector_cross(a, b)) < thin;
}

/* Returns whether the triangles from `first` on, those of spikes not counted, are in one plane along two axes. */
static bool is_ground(const struct stage *stage, const struct ranked *order, uint32_t first, uint32_t count)
{
    struct extents box = no_extents;
    for (uint32_t i = first; i < count; i++)
        if (!is_spike(&stage->samples[order[i].sample]))
            add_corners(&box, &stage->samples[order[i].sample]);
    double least = fmin(extent(&box, 0), fmin(extent(&box, 1), extent(&box, 2)));
    return least <= flat * diagonal(&box);
}

/*
 * Leaves triangles out that are much larger than all smaller ones together, if they are a ground or spikes. `order` has
 * room for all samples.
 */
static void leave_out_endless(struct stage *stage, struct ranked *order)
{
    uint32_t count = stage->even_count, best = count;
    for (uint32_t i = 0; i < count; i++)
        order[i] = (struct ranked){stage->samples[i].reach, i};
    qsort(order, count, sizeof *order, compare_ranks);
    struct extents box = no_extents;
    double best_ratio = endless;
    for (uint32_t i = 0; i + 1 < count; i++) {
        add_corners(&box, &stage->samples[order[i].sample]);
        double ratio = order[i + 1].rank / fmax(diagonal(&box), 1e-44);
        if (ratio > best_ratio && 50 * (i + 1) >= count && is_ground(stage, order, i + 1, count)) {
            best_ratio = ratio;
            best = i + 1;
        }
    }
    double limit = best < count ? order[best].rank : INFINITY;
    for (uint32_t i = 0; i < stage->sample_count; i++)
        stage->samples[i].is_subject = stage->samples[i].reach < limit;
}

static double median(const struct stage *stage, int axis, struct ranked *order)
{
    uint32_t count = 0;
    for (uint32_t i = 0; i < stage->sample_count; i++)
        if (stage->samples[i].is_subject)
            order[count++] = (struct ranked){vector_component(stage->samples[i].at, axis), i};
    qsort(order, count, sizeof *order, compare_ranks);
    return count ? order[count / 2].rank : 0;
}

/* Orders the samples of the subject by their distance from the median, and returns how many there are. */
static uint32_t order_by_distance(const struct stage *stage, struct ranked *order)
{
    double middle[3];
    uint32_t count = 0;
    for (int axis = 0; axis < 3; axis++)
        middle[axis] = median(stage, axis, order);
    for (uint32_t i = 0; i < stage->sample_count; i++) {
        if (!stage->samples[i].is_subject)
            continue;
        struct vector away = vector_sub(stage->samples[i].at, vector_make(middle[0], middle[1], middle[2]));
        order[count++] = (struct ranked){fmax(fabs(away.x), fmax(fabs(away.y), fabs(away.z))), i};
    }
    qsort(order, count, sizeof *order, compare_ranks);
    return count;
}

/*
 * Leaves far samples out where the box of the others is so much smaller that they are worth it. Samples by number and
 * by area have the same weight together, so that neither one finely divided object nor one large wall is everything.
 */
static void leave_out_far(struct stage *stage, struct ranked *order)
{
    uint32_t count = order_by_distance(stage, order), best = count, even = 0;
    for (uint32_t i = 0; i < count; i++)
        even += order[i].sample < stage->even_count;
    struct extents box = no_extents;
    double weight = 0, best_cost = INFINITY;
    for (uint32_t i = 0; i < count; i++) {
        add_corners(&box, &stage->samples[order[i].sample]);
        weight += 0.5 / (order[i].sample < stage->even_count ? even : count - even);
        double cost = log(fmax(diagonal(&box), 1e-44)) - (even < count ? 1 : 2) * worth * weight;
        if (cost <= best_cost) {
            best_cost = cost;
            best = i + 1;
        }
    }
    for (uint32_t i = best; i < count; i++)
        stage->samples[order[i].sample].is_subject = false;
}

/* Returns the box of the subject; on axes where everything is not much larger, that of everything. */
static struct extents find_box(const struct stage *stage)
{
    const struct structure *top = structures_top(stage->structures);
    float bounds[6];
    structure_bounds(top ? top : &stage->structures->files[0].structure, bounds);
    struct extents box = no_extents;
    for (uint32_t i = 0; i < stage->sample_count; i++)
        if (stage->samples[i].is_subject)
            add_corners(&box, &stage->samples[i]);
    double width = diagonal(&box);
    for (int axis = 0; axis < 3; axis++) {
        double least = (double)bounds[axis], most = (double)bounds[3 + axis];
        if (most - least <= clear_of_box * extent(&box, axis) || most - least <= 0.02 * width) {
            box.low[axis] = least;
            box.high[axis] = most;
        }
    }
    return box;
}

/* ---- which direction is up ---- */

/* Returns the extent of the positions of the instances, in the middle of the times. */
static struct extents spread_of_instances(const struct stage *stage)
{
    struct extents box = no_extents;
    for (uint32_t i = 0; i < stage->instance_count; i++) {
        float m[12];
        structure_instance_matrix(&stage->instances[i], stage_time(stage, 0.5), m);
        add_point(&box, vector_make((double)m[3], (double)m[7], (double)m[11]));
    }
    return box;
}

/* The evidence that an axis points up: fractions of the surface, by samples. */
struct evidence {
    double level; /* surfaces that are perpendicular to it: floors and roofs */
    double base, lid; /* of those, the ones at the lower and at the upper end */
};

static struct evidence weigh(const struct stage *stage, const struct extents *box, int axis)
{
    struct evidence found = {0, 0, 0};
    uint32_t count = 0;
    double skin = 0.03 * extent(box, axis);
    for (uint32_t i = stage->even_count; i < stage->sample_count; i++) {
        const struct stage_sample *sample = &stage->samples[i];
        if (!sample->is_subject)
            continue;
        count++;
        if (fabs(vector_component(vector_normal(sample->corners), axis)) < 0.99)
            continue;
        double at = vector_component(sample->at, axis);
        found.level++;
        found.base += at < box->low[axis] + skin;
        found.lid += at > box->high[axis] - skin;
    }
    double share = 1.0 / (count ? count : 1);
    return (struct evidence){found.level * share, found.base * share, found.lid * share};
}

/* Returns how flat a box is along an axis: the logarithm of its lesser width over twice its height, from 0 to 2. */
static double flatness(const struct extents *box, int axis)
{
    double width = fmin(extent(box, (axis + 1) % 3), extent(box, (axis + 2) % 3));
    return fmax(fmin(log(fmax(width, 1e-44) / fmax(2 * extent(box, axis), 1e-44)), 2), 0);
}

/* Returns whether what was left out as endless is a ground that is perpendicular to an axis. */
static bool has_ground(const struct stage *stage, int axis)
{
    uint32_t level = 0, count = 0;
    for (uint32_t i = stage->even_count; i < stage->sample_count; i++) {
        const struct stage_sample *sample = &stage->samples[i];
        if (sample->is_subject || sample->reach < endless * stage->size)
            continue;
        count++;
        level += fabs(vector_component(vector_normal(sample->corners), axis)) > 0.99;
    }
    return count > 64 && level > count / 2;
}

static double speaks_for(const struct stage *stage, const struct extents *box, int axis)
{
    struct evidence found = weigh(stage, box, axis);
    struct extents spread = spread_of_instances(stage);
    bool is_spread = stage->instance_count >= MANY_INSTANCES;
    double base = found.base - found.lid;
    return flatness(is_spread ? &spread : box, axis) + found.level + 4 * base + (has_ground(stage, axis) ? 4 : 0);
}

/* Guesses the axis that points up, y or z. Most models that were made for pictures have y up, which counts for it. */
static char guess_up(const struct stage *stage, const struct extents *box)
{
    static const double usual = 0.5;
    return speaks_for(stage, box, 2) > speaks_for(stage, box, 1) + usual ? 'z' : 'y';
}

static void orient(struct stage *stage, char up, const struct extents *box)
{
    static const struct vector units[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    int axis = up == 'x' ? 0 : up == 'y' ? 1 : 2, east = (axis + 1) % 3, north = (axis + 2) % 3;
    stage->east = units[east];
    stage->north = units[north];
    stage->up = units[axis];
    stage->front = up == 'z' ? vector_make(0, -1, 0) : units[up == 'y' ? 2 : 1];
    stage->low = vector_make(box->low[east], box->low[north], box->low[axis]);
    stage->high = vector_make(box->high[east], box->high[north], box->high[axis]);
    stage->floor = stage->low.z - 1e-4 * stage->size;
}

bool stage_bulk_find(struct stage *stage, char up)
{
    struct ranked *order = memory_array(stage->memory, STAGE_SAMPLES, sizeof *order);
    if (!order)
        return false;
    leave_out_endless(stage, order);
    leave_out_far(stage, order);
    memory_free(stage->memory, order);
    struct extents box = find_box(stage);
    stage->size = fmax(diagonal(&box), 1e-44);
    for (uint32_t i = 0; i < stage->sample_count; i++)
        stage->samples[i].is_subject =
            stage->samples[i].is_subject ||
            (stage->samples[i].reach < endless * stage->size && is_within(&box, stage->samples[i].at));
    orient(stage, up == 'a' ? guess_up(stage, &box) : up, &box);
    return true;
}
