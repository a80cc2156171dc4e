/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/update/decay.h"

/*
 * The time of building a primitive, over that of a diffuse ray through the built tree: medians over the poses that
 * `bench_decay --quality NAME` measures (docs/journal/updates.md).
 */
static double build_in_rays(enum build_quality quality)
{
    if (quality == QUALITY_FAST)
        return 0.13;
    return quality == QUALITY_HIGH ? 1.9 : 0.3;
}

double decay_to_rebuild(enum build_quality quality, double rays_per_primitive)
{
    const double rays = rays_per_primitive > 0 ? rays_per_primitive : 1;
    const double slowdown = 1 + build_in_rays(quality) / rays;
    return slowdown * slowdown;
}
