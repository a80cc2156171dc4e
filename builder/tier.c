/* SPDX-License-Identifier: Apache-2.0 */
#include "tier.h"

#include <math.h>

/* More than in any scene that the model was fitted to is as much as in that, and so is less. */
#define CROSSINGS_LEAST 0.03
#define CROSSINGS_MOST 1024.0
#define SPREAD_MOST 8.0

/* Exponents of 2, linear in the terms: times in nanoseconds. As `bvhd-bench --calibrate` prints them. */
struct tier_model {
    double build[TIER_TERMS], ray[TIER_TERMS];
};

static const struct tier_model models[] = {
    [QUALITY_FAST] = {{6.1427, 0.0310, 0.0707, -0.0312, 0.2619, -0.0453}, {6.0231, 0.1144, -0.4251, 0.9465, 0.9249, -0.0139}},
    [QUALITY_BALANCED] = {{7.5573, -0.0339, 0.2051, -0.0691, 0.3947, -0.1099}, {5.7848, 0.1190, -0.4376, 0.9538, 0.8999, 0.0258}},
    [QUALITY_HIGH] = {{10.8138, -0.1173, 0.3103, -0.0376, 0.1106, -0.1415}, {5.8938, 0.1207, -0.4347, 0.8861, 0.8198, 0.0040}},
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
