/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_manner.h"

#include <float.h>
#include <math.h>

#include "tests/support/builder/random_input.h"

struct random_manner random_manner_make(struct random *random, bool wide_range)
{
    static const double scales[] = {1, 1, 1, 1, 1, 50, 1e-3, 1e-20, 1e19, 1e37, 1e-41, 3e38};
    struct random_manner manner = {.scale = 1, .seed = random_next(random)};
    if (wide_range)
        manner.scale = scales[random_below(random, sizeof scales / sizeof scales[0])];
    manner.offset = wide_range && random_chance(random, 0.1) ? 1000 * manner.scale : 0;
    manner.offset = fabs(manner.offset) < 1e38 ? manner.offset : 0;
    manner.size = pow(10, random_between(random, -3, 0));
    manner.noise = random_chance(random, 0.3) ? 0.01 : 0;
    manner.width = random_chance(random, 0.5) ? 2 + random_below(random, 40) : 0;
    return manner;
}

static double odd_value(struct random *random)
{
    static const double values[] = {NAN,          NAN,    INFINITY, -INFINITY, 0, -0.0,
                                    FLT_TRUE_MIN, -1e-40, 1e30,     -FLT_MAX,  1, 0.5};
    return values[random_below(random, sizeof values / sizeof values[0])];
}

void random_manner_position(const struct random_manner *manner, uint32_t vertex, struct random *random,
                            double ret_position[3])
{
    struct random centre = {manner->seed + vertex / 3};
    for (int axis = 0; axis < 3; axis++) {
        double at = random_between(&centre, -1, 1) + manner->size * random_between(random, -1, 1);
        if (manner->width && axis < 2)
            at = 2.0 * (axis ? vertex / manner->width % manner->width : vertex % manner->width) / manner->width - 1;
        ret_position[axis] = manner->offset + manner->scale * fmin(fmax(at, -1), 1);
        if (random_chance(random, manner->noise))
            ret_position[axis] = odd_value(random);
    }
}
