/* SPDX-License-Identifier: Apache-2.0 */
#include "calibrate.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "build.h"
#include "choice.h"
#include "tier.h"

enum { TIERS = 3, BASE = 1, KINDS = 2 };

/* The weight, in scenes, of the belief that a term has no effect: on balanced, and on the quotient of another tier to it, which varies less than what disturbs both. */
#define HELD 0.3
#define HELD_QUOTIENT 0.5

static const enum build_quality qualities[TIERS] = {QUALITY_FAST, [BASE] = QUALITY_BALANCED, QUALITY_HIGH};

struct model {
    double constants[TIERS][KINDS][TIER_TERMS]; /* of building, of rays */
};

/* Of the run that was disturbed least: nanoseconds a primitive to build, a ray to trace. False when they were not measured. */
static bool measured(const struct results *results, uint32_t scene, int tier, struct tier_cost *ret_cost)
{
    const struct scene_figures *figures = &results->scenes[scene];
    for (uint32_t i = 0; i < results->options->method_count; i++) {
        const struct figures *own = &figures->methods[i];
        double ms = statistic_least(&own->ms[1]), rate = statistic_most(&own->mrays[RAYS_DIFFUSE]);
        if (strcmp(results->options->methods[i]->name, build_quality_name(qualities[tier])) != 0 || !(ms > 0) || !(rate > 0))
            continue;
        *ret_cost = (struct tier_cost){ms * 1e6 / figures->triangles, 1e3 / rate};
        return true;
    }
    return false;
}

/* Gauss, with the largest pivot of each column. */
static void solve(double rows[TIER_TERMS][TIER_TERMS + 1], double ret_solution[TIER_TERMS])
{
    for (int column = 0; column < TIER_TERMS; column++) {
        int pivot = column;
        for (int i = column + 1; i < TIER_TERMS; i++)
            pivot = fabs(rows[i][column]) > fabs(rows[pivot][column]) ? i : pivot;
        for (int k = 0; k <= TIER_TERMS; k++) {
            double swap = rows[column][k];
            rows[column][k] = rows[pivot][k];
            rows[pivot][k] = swap;
        }
        for (int i = 0; i < TIER_TERMS; i++) {
            double factor = i == column ? 0 : rows[i][column] / rows[column][column];
            for (int k = 0; k <= TIER_TERMS; k++)
                rows[i][k] -= factor * rows[column][k];
        }
    }
    for (int i = 0; i < TIER_TERMS; i++)
        ret_solution[i] = rows[i][TIER_TERMS] / rows[i][i];
}

static double exponent_of(const struct tier_cost *cost, int kind)
{
    return log2(kind ? cost->ray_ns : cost->build_ns);
}

/* Of balanced, or of another tier in relation to it. Of how many scenes it was. */
static uint32_t fit_one(const struct results *results, int tier, int kind, double ret_constants[TIER_TERMS])
{
    double rows[TIER_TERMS][TIER_TERMS + 1] = {{0}};
    uint32_t count = 0;
    for (uint32_t scene = 0; scene < results->scene_count; scene++) {
        double terms[TIER_TERMS + 1];
        struct tier_cost cost, base;
        if (!measured(results, scene, tier, &cost) || !measured(results, scene, BASE, &base))
            continue;
        tier_terms(&results->scenes[scene].facts, terms);
        terms[TIER_TERMS] = exponent_of(&cost, kind) - (tier == BASE ? 0 : exponent_of(&base, kind));
        for (int i = 0; i < TIER_TERMS; i++)
            for (int k = 0; k <= TIER_TERMS; k++)
                rows[i][k] += terms[i] * terms[k];
        count++;
    }
    for (int i = 1; i < TIER_TERMS; i++)
        rows[i][i] += tier == BASE ? HELD : HELD_QUOTIENT;
    if (count > 0)
        solve(rows, ret_constants);
    return count;
}

static bool fit(const struct results *results, struct model *ret_model)
{
    for (int tier = 0; tier < TIERS; tier++)
        for (int kind = 0; kind < KINDS; kind++)
            if (fit_one(results, tier, kind, ret_model->constants[tier][kind]) == 0) {
                fprintf(stderr, "bvhd-bench: %s was not measured\n", build_quality_name(qualities[tier]));
                return false;
            }
    for (int tier = 0; tier < TIERS; tier++)
        for (int k = 0; k < KINDS * TIER_TERMS && tier != BASE; k++)
            ret_model->constants[tier][k / TIER_TERMS][k % TIER_TERMS] += ret_model->constants[BASE][k / TIER_TERMS][k % TIER_TERMS];
    return true;
}

static double cost_by(const struct model *model, int tier, const struct facts *facts, double rays)
{
    double terms[TIER_TERMS], sums[KINDS] = {0, 0};
    tier_terms(facts, terms);
    for (int kind = 0; kind < KINDS; kind++)
        for (int i = 0; i < TIER_TERMS; i++)
            sums[kind] += model->constants[tier][kind][i] * terms[i];
    return facts_exp2(sums[0]) + rays * facts_exp2(sums[1]);
}

static int choose_by(const struct model *model, const struct facts *facts, double rays)
{
    int best = 0;
    for (int tier = 1; tier < TIERS; tier++)
        best = cost_by(model, tier, facts, rays) < cost_by(model, best, facts, rays) ? tier : best;
    return best;
}

static void print_scene(const struct results *results, const struct model *model, uint32_t scene)
{
    const struct facts *facts = &results->scenes[scene].facts;
    struct tier_cost costs[TIERS];
    for (int tier = 0; tier < TIERS; tier++)
        if (!measured(results, scene, tier, &costs[tier]))
            return;
    printf("%-22s %8u %8.1f %5.2f %5.2f | %5.0f %5.0f %6.0f | %5.0f %5.0f %5.0f |", results->scenes[scene].name, facts->primitives,
           facts->crossings, facts->slant, facts->spread, costs[0].build_ns, costs[1].build_ns, costs[2].build_ns, costs[0].ray_ns,
           costs[1].ray_ns, costs[2].ray_ns);
    for (int hint = 0; hint < CHOICE_HINTS; hint++) {
        double rays = choice_rays(hint), least = INFINITY, each[TIERS];
        int best = 0, fitted = choose_by(model, facts, rays), built_in = (int)tier_choose(facts, (float)rays) - QUALITY_FAST;
        for (int tier = 0; tier < TIERS; tier++) {
            each[tier] = costs[tier].build_ns + rays * costs[tier].ray_ns;
            best = each[tier] < least ? tier : best;
            least = fmin(least, each[tier]);
        }
        printf("  %c %c%+.0f%% %c%+.0f%%", "fbh"[best], "fbh"[fitted], 100 * (each[fitted] / least - 1), "fbh"[built_in],
               100 * (each[built_in] / least - 1));
    }
    printf("\n");
}

/* As it stands in tier.c. */
static void print_table(const struct model *model)
{
    static const char *const names[TIERS] = {"FAST", "BALANCED", "HIGH"};
    for (int tier = 0; tier < TIERS; tier++) {
        printf("    [QUALITY_%s] = {", names[tier]);
        for (int kind = 0; kind < KINDS; kind++) {
            printf("%s{", kind ? ", " : "");
            for (int i = 0; i < TIER_TERMS; i++)
                printf("%s%.4f", i ? ", " : "", model->constants[tier][kind][i]);
            printf("}");
        }
        printf("},\n");
    }
}

bool calibrate_print(const struct results *results)
{
    struct model model;
    if (!fit(results, &model))
        return false;
    print_table(&model);
    printf("scene, primitives, crossings, slant, spread | build ns: fast, balanced, high | ray ns |  for 0.1, 1, 10, 100 rays: "
           "best, "
           "chosen by this "
           "table and what it loses, by the one in use\n");
    for (uint32_t i = 0; i < results->scene_count; i++)
        print_scene(results, &model, i);
    return true;
}
