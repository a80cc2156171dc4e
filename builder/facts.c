/* SPDX-License-Identifier: Apache-2.0 */
#include "facts.h"

#include <math.h>

#include "primitive.h"

double facts_log2(double value)
{
    int exponent;
    double rest = 2 * frexp(value, &exponent) - 1; /* 0 .. 1 */
    return exponent - 1 + rest * (1.3465 - 0.3465 * rest);
}

double facts_exp2(double value)
{
    double whole = floor(value), rest = value - whole;
    return ldexp(1 + rest * (0.6562 + 0.3438 * rest), (int)fmin(fmax(whole, -1000), 1000));
}

/* Sums over the sample. */
struct sums {
    struct box bounds;
    double half_areas, slanted; /* of boxes; of these what two triangles do not fill */
    double octaves, squares; /* of sizes */
};

static double triangle_area(const struct canonical_geometry *geometry, uint32_t index)
{
    float corners[3][3];
    double a[3], b[3], square = 0;
    canonical_triangle(geometry, index, corners);
    for (int axis = 0; axis < 3; axis++) {
        a[axis] = (double)corners[1][axis] - corners[0][axis];
        b[axis] = (double)corners[2][axis] - corners[0][axis];
    }
    for (int axis = 0; axis < 3; axis++) {
        int next = (axis + 1) % 3, last = (axis + 2) % 3;
        double part = a[next] * b[last] - a[last] * b[next];
        square += part * part;
    }
    return 0.5 * sqrt(square);
}

static double size_of(const struct box *box)
{
    double size = 0;
    for (int axis = 0; axis < 3; axis++)
        size += (double)box->max[axis] - box->min[axis];
    return size;
}

/* False when no ray meets it. */
static bool add_primitive(const struct canonical *canonical, const struct canonical_geometry *geometry, uint32_t index,
                          struct sums *sums)
{
    struct box box = primitive_box(canonical, geometry, index);
    if (box_is_empty(&box))
        return false;
    double half_area = box_half_area(&box), size = size_of(&box);
    double octave = size > 0 ? facts_log2(size) : 0;
    box_grow(&sums->bounds, &box);
    sums->half_areas += half_area;
    if (geometry->type == GEOMETRY_TRIANGLES)
        sums->slanted += fmax(half_area - 2 * triangle_area(geometry, index), 0);
    sums->octaves += octave;
    sums->squares += octave * octave;
    return true;
}

/* One of the i-th part of all, not always at the same place in it: meshes repeat themselves. */
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

static void add_sample(const struct canonical *canonical, struct facts *facts, struct sums *sums)
{
    const struct canonical_geometry *geometry = canonical->geometries;
    for (uint32_t i = 0; i < facts->sampled; i++) {
        uint32_t id = sampled_id(canonical->primitive_count, facts->sampled, i);
        while (id - geometry->first_primitive >= geometry->primitive_count)
            geometry++;
        facts->met += add_primitive(canonical, geometry, id - geometry->first_primitive, sums);
    }
}

void facts_gather(const struct canonical *canonical, struct facts *ret_facts)
{
    uint32_t count = canonical->primitive_count;
    struct facts facts = {.primitives = count, .sampled = sample_size(count)};
    struct sums sums = {.bounds = box_empty()};
    bool triangles = canonical->geometry_count > 0 && canonical->geometries[0].type == GEOMETRY_TRIANGLES;
    facts.can_split = triangles && !(canonical->flags & (BUILD_LOW_MEMORY | BUILD_ALLOW_UPDATE));
    add_sample(canonical, &facts, &sums);
    if (facts.met > 0) {
        double whole = box_half_area(&sums.bounds), mean = sums.octaves / facts.met;
        double each = (double)count / facts.sampled;
        facts.crossings = whole > 0 ? sums.half_areas / whole * each : 0;
        facts.slant = sums.half_areas > 0 ? sums.slanted / sums.half_areas : 0;
        facts.spread = sqrt(fmax(sums.squares / facts.met - mean * mean, 0));
    }
    *ret_facts = facts;
}
