/* SPDX-License-Identifier: Apache-2.0 */
#include "tier.h"

#include <math.h>

/* More crossings, or a thinner whole, than in any scene that the model was fitted to is as much as in that. */
#define CROSSINGS_MOST 4096.0
#define THICKNESS_LEAST (1.0 / 64)

/* Exponents of 2, linear in the terms: times in nanoseconds. As `bvhd-bench --calibrate` prints them. */
struct tier_model {
    double build[TIER_TERMS], ray[TIER_TERMS];
};

static const struct tier_model models[] = {
    [QUALITY_FAST] = {{6.8637, -0.1184, 0.0765, -0.0458}, {9.0903, -0.2099, 0.4287, -0.1990}},
    [QUALITY_BALANCED] = {{7.8388, -0.1118, 0.0662, -0.0238}, {8.8616, -0.2133, 0.4390, -0.1826}},
    [QUALITY_HIGH] = {{9.3137, 0.2865, -0.0321, -0.0386}, {8.7853, -0.1578, 0.3334, -0.1740}},
};

/* Squares are scaled to the size of the others: what holds constants towards nothing when they are fitted takes all terms as equals. */
void tier_terms(const struct facts *facts, double ret_terms[TIER_TERMS])
{
    double crossings = facts_log2(1 + fmin(facts->crossings, CROSSINGS_MOST)),
           thickness = facts_log2(fmax(facts->thickness, THICKNESS_LEAST));
    ret_terms[0] = 1;
    ret_terms[1] = crossings;
    ret_terms[2] = crossings * crossings / 8;
    ret_terms[3] = thickness * thickness / 6;
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
