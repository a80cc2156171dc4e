/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/tier.h"

#include <math.h>

/* Limits of the scenes that the model was fitted to: beyond them it must not extrapolate. */
#define CROSSINGS_MOST 4096.0
#define THICKNESS_LEAST (1.0 / 64)

/*
 * Times in nanoseconds, as exponents of 2 that are linear in the terms. `bvhd-bench --calibrate` prints these
 * constants.
 */
struct tier_model {
    double build[TIER_TERMS], ray[TIER_TERMS];
};

static const struct tier_model models[] = {
    [QUALITY_FAST] = {{6.8779, -0.1087, 0.0594, -0.0633, 0.0256}, {9.1409, -0.2468, 0.5693, -0.1874, -0.3266}},
    [QUALITY_BALANCED] = {{7.8482, -0.1072, 0.0588, -0.0374, 0.0016}, {8.9425, -0.2502, 0.5521, -0.1681, -0.2569}},
    [QUALITY_HIGH] = {{9.3127, 0.2906, -0.0179, -0.0483, -0.0460}, {8.8689, -0.2132, 0.5242, -0.1551, -0.4194}},
};

/*
 * Squares are scaled to the magnitude of the other terms, because the fit's regularisation, which pulls constants
 * towards 0, weighs all terms alike.
 */
void tier_terms(const struct facts *facts, double ret_terms[TIER_TERMS])
{
    double crossings = facts_log2(1 + fmin(facts->crossings, CROSSINGS_MOST)),
           thickness = facts_log2(fmax(facts->thickness, THICKNESS_LEAST));
    ret_terms[0] = 1;
    ret_terms[1] = crossings;
    ret_terms[2] = crossings * crossings / 8;
    ret_terms[3] = thickness * thickness / 6;
    ret_terms[4] = facts->unevenness * crossings * crossings / 16;
}

static double power_of(const double constants[TIER_TERMS], const double terms[TIER_TERMS])
{
    double sum = 0;
    for (int i = 0; i < TIER_TERMS; i++)
        sum += constants[i] * terms[i];
    return facts_exp2(sum);
}

struct tier_cost tier_cost(enum build_quality quality, const struct facts *facts)
{
    double terms[TIER_TERMS];
    tier_terms(facts, terms);
    return (struct tier_cost){power_of(models[quality].build, terms), power_of(models[quality].ray, terms)};
}

enum build_quality tier_choose(const struct facts *facts, float rays_per_primitive)
{
    enum build_quality best = QUALITY_FAST, most = facts->can_split ? QUALITY_HIGH : QUALITY_BALANCED;
    double least = INFINITY;
    for (enum build_quality quality = QUALITY_FAST; quality <= most; quality++) {
        struct tier_cost cost = tier_cost(quality, facts);
        double each = cost.build_ns + rays_per_primitive * cost.ray_ns;
        if (each < least) {
            best = quality;
            least = each;
        }
    }
    return best;
}

static bool is_named(enum build_quality quality)
{
    return quality == QUALITY_FAST || quality == QUALITY_BALANCED || quality == QUALITY_HIGH;
}

enum build_quality tier_resolve(const struct canonical *canonical, const struct build_options *options)
{
    struct facts facts;
    if (canonical->type == STRUCTURE_MICROMAP)
        return QUALITY_FAST; /* it has no tree that could be better */
    if (is_named(options->quality))
        return options->quality;
    if (options->quality == QUALITY_UNSPECIFIED && (canonical->flags & BUILD_PREFER_FAST_BUILD))
        return QUALITY_FAST;
    if (options->quality == QUALITY_UNSPECIFIED && (canonical->flags & BUILD_PREFER_FAST_TRACE))
        return QUALITY_HIGH;
    if (!(options->rays_per_primitive > 0))
        return QUALITY_BALANCED;
    facts_gather(canonical, &facts);
    return tier_choose(&facts, options->rays_per_primitive);
}
