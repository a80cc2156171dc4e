/* SPDX-License-Identifier: Apache-2.0 */
/* test_flocks.h - triangles that move in several ways: alike, in two flocks, each by itself. For tests of splits. */
#ifndef BVHD_TEST_FLOCKS_H
#define BVHD_TEST_FLOCKS_H

#include <math.h>

#include "builder/format/canonical.h"
#include "tests/support/random.h"

enum { FLOCKS_COUNT = 20000 };

enum flocks_shape {
    FLOCKS_SMOOTH, /* neighbours move alike */
    FLOCKS_CROSS, /* two flocks that change places */
    FLOCKS_LANES, /* two that begin in one place */
    FLOCKS_RANDOM, /* each moves by itself */
    FLOCKS_HEAP, /* all are in one place, and stay there */
    FLOCKS_ROW, /* in distances that double, so that each division parts few from all others */
    FLOCKS_SHAPES
};

/* Triangles of one geometry. The flock of each is its number % 2. */
struct flocks {
    float start[FLOCKS_COUNT][3][3], end[FLOCKS_COUNT][3][3];
    struct canonical_geometry geometry;
    struct canonical canonical;
};

/* Chooses where a triangle is at the start, and how far it goes. */
static inline void flocks_place(enum flocks_shape shape, struct random *random, uint32_t index, double ret_at[3],
                                double ret_way[3])
{
    const bool is_odd = index % 2;
    random_point(random, ret_at);
    random_point(random, ret_way);
    for (int axis = 0; axis < 3; axis++) {
        ret_at[axis] *= shape == FLOCKS_HEAP || shape == FLOCKS_ROW ? 0 : 10;
        ret_way[axis] *= shape == FLOCKS_RANDOM ? 20 : 0;
    }
    for (int axis = 0; shape == FLOCKS_SMOOTH && axis < 3; axis++)
        ret_way[axis] = 2 * sin(0.3 * ret_at[(axis + 1) % 3]);
    if (shape == FLOCKS_CROSS)
        ret_at[0] += is_odd ? 15 : -15;
    if (shape == FLOCKS_CROSS || shape == FLOCKS_LANES)
        ret_way[0] = is_odd ? -30 : 30;
    if (shape == FLOCKS_ROW)
        ret_at[0] = ldexp(1, (int)(index % 38));
}

/* Makes `count` triangles, all of whose coordinates are multiplied by a scale. */
static inline void flocks_make(struct flocks *flocks, enum flocks_shape shape, uint32_t count, double scale)
{
    struct random random = {7};
    for (uint32_t i = 0; i < count; i++) {
        double at[3], way[3];
        flocks_place(shape, &random, i, at, way);
        for (int k = 0; k < 3; k++)
            for (int axis = 0; axis < 3; axis++) {
                const double corner = at[axis] + (axis == k ? 0.1 : 0);
                flocks->start[i][k][axis] = (float)(scale * corner);
                flocks->end[i][k][axis] = (float)(scale * (corner + way[axis]));
            }
    }
    flocks->geometry = (struct canonical_geometry){.type = GEOMETRY_MOVING_TRIANGLES,
                                                   .primitive_count = count,
                                                   .vertex_count = 3 * count,
                                                   .positions = flocks->start[0][0],
                                                   .end_positions = flocks->end[0][0]};
    flocks->canonical = (struct canonical){.type = STRUCTURE_BOTTOM,
                                           .flags = BUILD_MOTION,
                                           .geometry_count = 1,
                                           .primitive_count = count,
                                           .vertex_count = 3 * count,
                                           .geometries = &flocks->geometry};
}

#endif
