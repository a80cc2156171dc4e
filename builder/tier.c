/* SPDX-License-Identifier: Apache-2.0 */
#include "tier.h"

#include <math.h>

/* More than in any scene that the model was fitted to is as much as in that. */
enum { CROSSINGS_MOST = 1024 };

/* Exponents of 2, linear in the terms: times in nanoseconds. As `bvhd-bench --calibrate` prints them. */
struct tier_model {
    double build[TIER_TERMS], ray[TIER_TERMS];
};

static const struct tier_model models[] = {
    [QUALITY_FAST] = {{6.3029, 0.0823, 0.0109, 0.0162, 0.0304}, {9.3037, -0.0137, -1.2448, 1.8499, -0.8192}},
    [QUALITY_BALANCED] = {{6.9318, 0.0555, 0.0683, -0.0296, 0.0301}, {9.1320, -0.0052, -1.3296, 1.9335, -0.8181}},
    [QUALITY_HIGH] = {{11.8387, -0.1192, 1.1364, -0.8450, -0.2779}, {9.5121, -0.0320, -1.1704, 1.7620, -0.8590}},
};

void tier_terms(const struct facts *facts, double ret_terms[TIER_TERMS])
{
    ret_terms[0] = 1;
    ret_terms[1] = facts_log2(fmax(facts->primitives, 1));
    double crossings = fmin(facts->crossings, CROSSINGS_MOST);
    ret_terms[2] = facts_log2(1 + crossings);
    ret_terms[3] = facts_log2(1 + crossings * facts->slant);
    ret_terms[4] = facts->spread;
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
