/* SPDX-License-Identifier: Apache-2.0 */
/* random.h - random numbers for generated scenes: splitmix64, which is the same on every machine. */
#ifndef BVHD_RANDOM_H
#define BVHD_RANDOM_H

#include <stdint.h>

struct random {
    uint64_t state; /* any value is a seed */
};

static inline uint64_t random_next(struct random *random)
{
    uint64_t z = random->state += UINT64_C(0x9e3779b97f4a7c15);
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
    return z ^ (z >> 31);
}

/* Uniform in [low, high). */
static inline double random_between(struct random *random, double low, double high)
{
    return low + (high - low) * ((double)(random_next(random) >> 11) * 0x1p-53);
}

/* Uniform in the cube [-1, 1)^3. */
static inline void random_point(struct random *random, double ret_point[3])
{
    for (int axis = 0; axis < 3; axis++)
        ret_point[axis] = random_between(random, -1, 1);
}

#endif
