/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/choice.h"

#include <math.h>
#include <string.h>

double choice_rays(int hint)
{
    static const double rays[CHOICE_HINTS] = {0.1, 1, 10, 100};
    return rays[hint];
}

const char *choice_method(int hint)
{
    static const char *const names[CHOICE_HINTS] = {"auto-0.1", "auto-1", "auto-10", "auto-100"};
    return names[hint];
}

struct cost {
    double ms, spread;
    enum build_quality quality; /* the quality that was built */
};

static bool cost_of(const struct results *results, uint32_t scene, const char *name, double rays, struct cost *ret_cost)
{
    const struct scene_figures *figures = &results->scenes[scene];
    for (uint32_t i = 0; i < results->options->method_count; i++) {
        const struct statistic *build = &figures->methods[i].ms[1], *traced = &figures->methods[i].mrays[RAYS_DIFFUSE];
        double rate = statistic_median(traced) * 1e3; /* rays a millisecond */
        if (strcmp(results->options->methods[i]->name, name) != 0 || build->count == 0 || !(rate > 0))
            continue;
        double rays_ms = rays * figures->triangles / rate;
        *ret_cost =
            (struct cost){statistic_median(build) + rays_ms,
                          3 * (statistic_mad(build) + rays_ms * statistic_mad(traced) / statistic_median(traced)),
                          figures->methods[i].stats.quality};
        return true;
    }
    return false;
}

bool choice_of(const struct results *results, uint32_t scene, int hint, struct choice *ret_choice)
{
    static const char *const tiers[] = {"fast", "balanced", "high"};
    struct choice choice = {.best_ms = INFINITY};
    struct cost cost, automatic;
    if (!cost_of(results, scene, choice_method(hint), choice_rays(hint), &automatic))
        return false;
    for (size_t i = 0; i < sizeof tiers / sizeof tiers[0]; i++) {
        if (!cost_of(results, scene, tiers[i], choice_rays(hint), &cost))
            return false;
        if (cost.ms < choice.best_ms) {
            choice.best = tiers[i];
            choice.best_ms = cost.ms;
            choice.spread_ms = cost.spread + automatic.spread;
        }
    }
    choice.auto_ms = automatic.ms;
    choice.chosen = build_quality_name(automatic.quality);
    choice.is_good = choice.auto_ms - choice.best_ms <= fmax(0.1 * choice.best_ms, choice.spread_ms);
    *ret_choice = choice;
    return true;
}
