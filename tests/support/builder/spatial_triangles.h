/* SPDX-License-Identifier: Apache-2.0 */
/* spatial_triangles.h - triangles of all kinds with their refs, for tests of code that splits triangles. */
#ifndef BVHD_TEST_SPATIAL_TRIANGLES_H
#define BVHD_TEST_SPATIAL_TRIANGLES_H

#include <math.h>
#include <stdlib.h>

#include "builder/format/canonical.h"
#include "builder/input/primitive.h"
#include "tests/support/random.h"
#include "builder/kernel/spatial_bins.h"

enum kind {
    CLOUD, /* medium-sized, in any direction */
    SLIVERS, /* long and thin, through the whole cloud */
    SAME, /* the same triangle many times */
    THIN, /* one ulp thick */
    SIZES, /* over many orders of magnitude */
    FLAT, /* in one plane */
    FAR, /* small ones far from the origin, where floats are coarse */
    FANS, /* with one common corner */
    GROUND, /* small ones on two large ones that are as large as the whole */
    KINDS
};

struct triangles {
    struct memory memory;
    struct canonical canonical;
    struct canonical_geometry geometry;
    float (*corners)[9]; /* of each triangle: three corners, xyz */
    struct primitive_ref *refs, *scratch; /* arrays of `capacity` elements */
    uint32_t count, capacity;
    struct box *boxes, whole; /* of each triangle, and of all */
};

static inline void triangles_make_one(enum kind kind, uint32_t id, struct random *random, float corners[9])
{
    static const double ground[4][3] = {{-1000, 0, -1000}, {1000, 0, -1000}, {1000, 0, 1000}, {-1000, 0, 1000}};
    double centre[3], size = kind == CLOUD ? 0.2 : kind == SIZES ? ldexp(1, (int)random_between(random, -30, 1)) : 1;
    random_point(random, centre);
    for (int i = 0; i < 3; i++)
        for (int axis = 0; axis < 3; axis++) {
            double at = random_between(random, -1, 1);
            if (kind == SLIVERS && i == 2)
                corners[6 + axis] = corners[3 + axis] + (float)(0.001 * at);
            else
                corners[3 * i + axis] = (float)(kind == SLIVERS ? at : centre[axis] + size * at);
            if (kind == FAR)
                corners[3 * i + axis] = (float)(30000 + centre[axis] + 0.05 * at);
            if (kind == GROUND)
                corners[3 * i + axis] = (float)(id < 2 ? ground[(i + 2 * (int)id) % 4][axis] : centre[axis] + 0.1 * at);
            if (kind == SAME)
                corners[3 * i + axis] = (float)(i == axis) - 0.3f * (float)(i == 2);
            if (kind == FANS && i == 0)
                corners[axis] = 0.25f;
        }
    for (int i = 0; i < 3; i++) {
        if (kind == THIN)
            corners[3 * i + 2] = random_next(random) % 2 ? 1.0f : nextafterf(1, 2);
        if (kind == FLAT)
            corners[3 * i + 1] = 0.5f;
    }
}

/* Makes `count` triangles, with room for `more` additional refs. */
static inline void triangles_start(struct triangles *f, enum kind kind, uint32_t count, uint32_t more)
{
    struct random random = {count + 100 * (uint64_t)kind};
    memory_init(&f->memory, UINT64_MAX);
    f->count = count;
    f->capacity = count + more;
    f->corners = calloc(count, sizeof *f->corners);
    f->refs = calloc(f->capacity, sizeof *f->refs);
    f->scratch = aligned_alloc(64, (f->capacity * sizeof *f->scratch + 63) & ~(size_t)63);
    f->boxes = calloc(count, sizeof *f->boxes);
    assert_true(f->corners && f->refs && f->scratch && f->boxes);
    f->whole = box_empty();
    for (uint32_t id = 0; id < count; id++) {
        struct box box = box_empty();
        triangles_make_one(kind, id, &random, f->corners[id]);
        for (int i = 0; i < 3; i++)
            box_add_point(&box, f->corners[id] + 3 * i);
        box_grow(&f->whole, &box);
        f->boxes[id] = box;
        f->refs[id] =
            (struct primitive_ref){{box.min[0], box.min[1], box.min[2]}, 0, {box.max[0], box.max[1], box.max[2]}, id};
    }
    f->geometry = (struct canonical_geometry){
        .type = GEOMETRY_TRIANGLES, .primitive_count = count, .vertex_count = 3 * count, .positions = f->corners[0]};
    f->canonical = (struct canonical){.type = STRUCTURE_BOTTOM,
                                      .geometry_count = 1,
                                      .primitive_count = count,
                                      .vertex_count = 3 * count,
                                      .geometries = &f->geometry};
}

/* Returns the price that a spatial split has to save for each reference that it adds. */
static inline float triangles_price(const struct triangles *f)
{
    double areas = 0;
    for (uint32_t id = 0; id < f->count; id++)
        areas += box_half_area(&f->boxes[id]);
    return spatial_price(areas, (float)box_half_area(&f->whole), f->count);
}

static inline void triangles_finish(struct triangles *f)
{
    free(f->corners);
    free(f->refs);
    free(f->scratch);
    free(f->boxes);
    assert_int_equal(f->memory.live, 0);
}

/* A part of a triangle: its box, and the triangle's id. */
struct use {
    uint32_t id;
    struct box box;
};

static inline int use_by_id(const void *a, const void *b)
{
    uint32_t x = ((const struct use *)a)->id, y = ((const struct use *)b)->id;
    return (x > y) - (x < y);
}

static inline bool triangles_holds(const struct box *box, const long double point[3])
{
    for (int axis = 0; axis < 3; axis++)
        if (!(point[axis] >= box->min[axis] && point[axis] <= box->max[axis]))
            return false;
    return true;
}

/* Checks that corners, points of edges and points of the inside lie in a part of the triangle. */
static inline void triangles_check_one(const struct triangles *f, struct random *random, const struct use *uses,
                                       uint32_t use_count)
{
    const float *corners = f->corners[uses->id];
    for (int i = 0; i < 16; i++) {
        long double u = random_between(random, 0, 1), v = random_between(random, 0, 1), point[3];
        if (i < 3)
            u = i == 1, v = i == 2;
        else if (i < 9)
            v = i < 6 ? 0 : 1 - u;
        else if (u + v > 1)
            u = 1 - u, v = 1 - v;
        for (int k = 0; k < 3; k++)
            point[k] = corners[k] + u * ((long double)corners[3 + k] - corners[k]) +
                       v * ((long double)corners[6 + k] - corners[k]);
        bool held = !triangles_holds(&f->boxes[uses->id], point); /* the point was rounded out of the triangle */
        for (uint32_t k = 0; k < use_count; k++)
            held |= triangles_holds(&uses[k].box, point);
        assert_true(held);
    }
}

/* Checks that every triangle has refs, and that its parts cover all of it. Sorts the uses. */
static inline void triangles_check(const struct triangles *f, struct use *uses, uint32_t use_count)
{
    struct random random = {use_count};
    uint32_t seen = 0;
    qsort(uses, use_count, sizeof *uses, use_by_id);
    for (uint32_t i = 0, end; i < use_count; i = end, seen++) {
        for (end = i; end < use_count && uses[end].id == uses[i].id; end++)
            assert_true(box_contains(&f->boxes[uses[i].id], &uses[end].box));
        triangles_check_one(f, &random, uses + i, end - i);
    }
    assert_int_equal(seen, f->count);
}

#endif
