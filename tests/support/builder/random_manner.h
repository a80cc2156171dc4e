/* SPDX-License-Identifier: Apache-2.0 */
/* random_manner.h - random positions: scattered or in sheets, of any magnitude. For test programs only. */
#ifndef BVHD_RANDOM_MANNER_H
#define BVHD_RANDOM_MANNER_H

#include <stdbool.h>

#include "tests/support/random.h"

/* How the primitives of one geometry are distributed. */
struct random_manner {
    double scale, offset, size; /* of the whole, and of a primitive relative to it */
    double noise; /* share of components with unusual values */
    uint32_t width; /* width in vertices of a sheet; 0: the primitives are scattered */
    uint64_t seed;
};

/* With `wide_range`, some are far beyond 1 or below it. */
struct random_manner random_manner_make(struct random *random, bool wide_range);

/* Makes a position. Those of vertices 3i .. 3i+2 are near each other, unless the manner is that of a sheet. */
void random_manner_position(const struct random_manner *manner, uint32_t vertex, struct random *random,
                            double ret_position[3]);

#endif
