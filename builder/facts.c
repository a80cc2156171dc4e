/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/facts.h"

#include <float.h>
#include <math.h>

#include "builder/input/primitive.h"
#include "proto/base/kind.h"

double facts_log2(double value)
{
    int exponent;
    double rest = 2 * frexp(value, &exponent) - 1; /* in [0, 1) */
    return exponent - 1 + rest * (1.3465 - 0.3465 * rest);
}

double facts_exp2(double value)
{
    double whole = floor(value), rest = value - whole;
    return ldexp(1 + rest * (0.6562 + 0.3438 * rest), (int)fmin(fmax(whole, -1000), 1000));
}

enum { LANES = 4 };

/* The sampled primitives that a ray can hit. Entries after `count`, up to a multiple of LANES, are zero. */
struct sample {
    uint32_t count;
    struct box bounds;
    double total; /* sum of half_areas */
    double half_areas[FACTS_MOST];
    float min[3][FACTS_MOST], max[3][FACTS_MOST];
};

/*
 * Picks one primitive of the i-th of `sampled` equal ranges. Its place within the range varies, because meshes are
 * often periodic.
 */
static uint32_t sampled_id(uint32_t count, uint32_t sampled, uint32_t i)
{
    uint32_t begin = (uint32_t)((uint64_t)i * count / sampled), end = (uint32_t)(((uint64_t)i + 1) * count / sampled);
    return begin + (i * UINT32_C(2654435761) >> 16) % (end - begin);
}

static uint32_t sample_size(uint32_t count)
{
    uint32_t size = count / FACTS_SHARE;
    size = size < FACTS_LEAST ? FACTS_LEAST : size > FACTS_MOST ? FACTS_MOST : size;
    return count < size ? count : size;
}

static void add_member(struct sample *sample, const struct box *box)
{
    if (box_is_empty(box))
        return;
    double half_area = box_half_area(box);
    for (int axis = 0; axis < 3; axis++) {
        sample->min[axis][sample->count] = box->min[axis];
        sample->max[axis][sample->count] = box->max[axis];
    }
    sample->half_areas[sample->count++] = half_area;
    sample->total += half_area;
    box_grow(&sample->bounds, box);
}

static void fill_lanes(struct sample *sample)
{
    for (uint32_t i = sample->count; i % LANES; i++) {
        sample->half_areas[i] = 0;
        for (int axis = 0; axis < 3; axis++)
            sample->min[axis][i] = sample->max[axis][i] = 0;
    }
}

static void draw(const struct canonical *canonical, uint32_t size, struct sample *sample)
{
    const struct canonical_geometry *geometry = canonical->geometries;
    for (uint32_t i = 0; i < size; i++) {
        uint32_t id = sampled_id(canonical->primitive_count, size, i);
        while (id - geometry->first_primitive >= geometry->primitive_count)
            geometry++;
        struct box box = primitive_box(canonical, geometry, id - geometry->first_primitive);
        add_member(sample, &box);
    }
    fill_lanes(sample);
}

/* Distance from `at` to [min, max] along one axis; 0 inside. */
static inline double distance(double at, float min, float max)
{
    double below = min - at, above = at - max, beyond = below > above ? below : above;
    return beyond > 0 ? beyond : 0;
}

/*
 * Expected number of the other members' boxes that a ray meets from the centre of member `from` in a random direction.
 */
static double crossings_from(const struct sample *sample, uint32_t from)
{
    const double sphere = 25.132741228718345; /* 8 pi */
    double at[3], sums[LANES] = {0};
    for (int axis = 0; axis < 3; axis++)
        at[axis] = 0.5 * ((double)sample->min[axis][from] + sample->max[axis][from]);
    for (uint32_t i = 0; i < sample->count; i += LANES)
        for (uint32_t lane = 0; lane < LANES; lane++) {
            double x = distance(at[0], sample->min[0][i + lane], sample->max[0][i + lane]);
            double y = distance(at[1], sample->min[1][i + lane], sample->max[1][i + lane]);
            double z = distance(at[2], sample->min[2][i + lane], sample->max[2][i + lane]);
            double half_area = sample->half_areas[i + lane];
            /* DBL_MIN makes 0 / 0, at distance 0 from a box without area, count as 0. */
            sums[lane] += half_area / (half_area + sphere * (x * x + y * y + z * z) + DBL_MIN);
        }
    double own = sample->half_areas[from];
    return sums[0] + sums[1] + sums[2] + sums[3] - own / (own + DBL_MIN);
}

static double mean_crossings(const struct sample *sample)
{
    double sum = 0, passed = sample->half_areas[0];
    uint32_t by_area = 0;
    for (uint32_t i = 0; i < FACTS_VIEWS / 2; i++) {
        uint32_t by_id = (2 * i + 1) * sample->count / FACTS_VIEWS;
        while (passed < (2 * i + 1) * sample->total / FACTS_VIEWS && by_area + 1 < sample->count)
            passed += sample->half_areas[++by_area];
        sum += crossings_from(sample, by_id) + crossings_from(sample, by_area);
    }
    return fmax(sum / FACTS_VIEWS, 0);
}

/* Share of the total area that lies above the mean. */
static double unevenness_of(const struct sample *sample)
{
    double mean = sample->total / sample->count, beyond = 0;
    for (uint32_t i = 0; i < sample->count; i++)
        beyond += fmax(sample->half_areas[i] - mean, 0);
    return sample->total > 0 ? beyond / sample->total : 0;
}

static double thickness_of(const struct box *bounds)
{
    double least = INFINITY, most = 0;
    for (int axis = 0; axis < 3; axis++) {
        double side = (double)bounds->max[axis] - bounds->min[axis];
        least = fmin(least, side);
        most = fmax(most, side);
    }
    return most > 0 ? least / most : 0;
}

void facts_gather(const struct canonical *canonical, struct facts *ret_facts)
{
    uint32_t count = canonical->primitive_count;
    struct facts facts = {.primitives = count, .sampled = sample_size(count)};
    struct sample sample;
    sample.count = 0;
    sample.total = 0;
    sample.bounds = box_empty();
    bool can_be_cut = canonical->geometry_count > 0 && kind_find(canonical_kind(canonical))->can_be_cut;
    facts.can_split = can_be_cut && !(canonical->flags & (BUILD_LOW_MEMORY | BUILD_ALLOW_UPDATE));
    draw(canonical, facts.sampled, &sample);
    facts.met = sample.count;
    if (facts.met > 0) {
        facts.crossings = mean_crossings(&sample) * ((double)count / facts.sampled);
        facts.thickness = thickness_of(&sample.bounds);
        facts.unevenness = unevenness_of(&sample);
    }
    *ret_facts = facts;
}
