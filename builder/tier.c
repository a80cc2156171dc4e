/* SPDX-License-Identifier: Apache-2.0 */
#include "tier.h"

#include <math.h>

/* More than in any scene that the model was fitted to is as much as in that, and so is less. */
#define CROSSINGS_LEAST 1.0
#define CROSSINGS_MOST 1024.0
#define SPREAD_MOST 8.0

/* Exponents of 2, linear in the terms: times in nanoseconds. As `bvhd-bench --calibrate` prints them. */
struct tier_model {
    double build[TIER_TERMS], ray[TIER_TERMS];
};

static const struct tier_model models[] = {
    [QUALITY_FAST] = {{5.4440, 0.0594, -0.0309, 0.0647, 0.7072, 0.0800}, {4.9869, 0.1207, 0.3064, 0.4581, 2.3197, -0.0182}},
    [QUALITY_BALANCED] = {{6.9724, -0.0040, 0.1093, 0.0158, 0.8008, -0.0109}, {4.5084, 0.1461, 0.2415, 0.4865, 2.2651, 0.0650}},
    [QUALITY_HIGH] = {{10.0037, -0.0309, 0.1519, 0.1228, 0.0993, 0.1499}, {4.9914, 0.1541, 0.1272, 0.4138, 1.6699, 0.0471}},
};

void tier_terms(const struct facts *facts, double ret_terms[TIER_TERMS])
{
    ret_terms[0] = 1;
    ret_terms[1] = facts_log2(fmax(facts->primitives, 1));
    double crossings = fmin(facts->crossings, CROSSINGS_MOST);
    ret_terms[2] = facts_log2(1 + crossings);
    ret_terms[3] = facts_log2(1 + crossings * facts->slant);
    ret_terms[4] = facts_log2(1 + 1 / fmax(crossings, CROSSINGS_LEAST)); /* how far a ray gets without meeting anything */
    ret_terms[5] = fmin(facts->spread, SPREAD_MOST);
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
