/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/calibrate.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "builder/build.h"
#include "tests/bench/bvhd_bench/choice.h"
#include "builder/tier.h"

enum { TIERS = 3, BASE = 1, KINDS = 2 };

/*
 * The weight, in scenes, of the prior that a term has no effect: for balanced, and for the quotient of another tier to
 * balanced. Quotients vary less, because what disturbs a scene's measurements disturbs both tiers.
 */
#define HELD 1
#define HELD_QUOTIENT 3

static const enum build_quality qualities[TIERS] = {QUALITY_FAST, [BASE] = QUALITY_BALANCED, QUALITY_HIGH};

struct model {
    double constants[TIERS][KINDS][TIER_TERMS]; /* of building, of tracing rays */
};

/*
 * Reads the repetition that was disturbed least: nanoseconds a primitive to build, nanoseconds a ray to trace. Returns
 * false when they were not measured.
 */
static bool measured(const struct results *results, uint32_t scene, int tier, struct tier_cost *ret_cost)
{
    const struct scene_figures *figures = &results->scenes[scene];
    for (uint32_t i = 0; i < results->options->method_count; i++) {
        const struct figures *own = &figures->methods[i];
        double ms = statistic_least(&own->ms[1]), rate = statistic_most(&own->mrays[RAYS_DIFFUSE]);
        if (strcmp(results->options->methods[i]->name, build_quality_name(qualities[tier])) != 0 || !(ms > 0) ||
            !(rate > 0))
            continue;
        *ret_cost = (struct tier_cost){ms * 1e6 / figures->triangles, 1e3 / rate};
        return true;
    }
    return false;
}

/* Gauss-Jordan elimination, with the largest pivot of each column. */
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

/* Whether two scenes are of one kind, that is, equal before the first @ of their names. */
static bool is_like(const char *name, const char *other)
{
    size_t length = strcspn(name, "@");
    return strcspn(other, "@") == length && strncmp(name, other, length) == 0;
}

/*
 * Fits the constants of balanced, or of the quotient of another tier to balanced, over the scenes that are not of the
 * kind of `left_out` (NULL: over all). Returns the number of scenes used.
 */
static uint32_t fit_one(const struct results *results, const char *left_out, int tier, int kind,
                        double ret_constants[TIER_TERMS])
{
    double rows[TIER_TERMS][TIER_TERMS + 1] = {{0}};
    uint32_t count = 0;
    for (uint32_t scene = 0; scene < results->scene_count; scene++) {
        double terms[TIER_TERMS + 1];
        struct tier_cost cost, base;
        if (left_out && is_like(results->scenes[scene].name, left_out))
            continue;
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

/* Returns false when a tier was not measured on any scene. */
static bool fit(const struct results *results, const char *left_out, struct model *ret_model)
{
    for (int tier = 0; tier < TIERS; tier++)
        for (int kind = 0; kind < KINDS; kind++)
            if (fit_one(results, left_out, tier, kind, ret_model->constants[tier][kind]) == 0)
                return false;
    for (int tier = 0; tier < TIERS; tier++)
        for (int k = 0; k < KINDS * TIER_TERMS && tier != BASE; k++)
            ret_model->constants[tier][k / TIER_TERMS][k % TIER_TERMS] +=
                ret_model->constants[BASE][k / TIER_TERMS][k % TIER_TERMS];
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

/* The losses of the choices of one model. */
struct tally {
    uint32_t choices, bad; /* bad: choices that cost over 10 % more than the best */
    double most, beyond; /* the worst loss, and the sum of what the losses exceed 5 % by */
};

static void add_loss(struct tally *tally, double loss)
{
    tally->choices++;
    tally->bad += loss > 0.1;
    tally->most = fmax(tally->most, loss);
    tally->beyond += fmax(loss - 0.05, 0);
}

static void print_tally(const char *title, const struct tally *tally)
{
    printf("%-46s %4u of %4u lose more than 10 %%, the worst %.0f %%; sum beyond 5 %% is %.2f\n", title, tally->bad,
           tally->choices, 100 * tally->most, tally->beyond);
}

enum { FITTED, LEFT_OUT, IN_USE, MODELS };

/*
 * Adds the losses of three models on one scene: one that was fitted to all scenes, one that was fitted without scenes
 * of this kind, and the one in tier.c.
 */
static void add_scene(const struct results *results, const struct model *fitted, uint32_t scene,
                      struct tally tallies[MODELS])
{
    const struct facts *facts = &results->scenes[scene].facts;
    struct tier_cost costs[TIERS];
    struct model left_out;
    bool has_others = fit(results, results->scenes[scene].name, &left_out);
    for (int tier = 0; tier < TIERS; tier++)
        if (!measured(results, scene, tier, &costs[tier]))
            return;
    printf("%-22s %8u %8.2f %7.4f %4.2f | %5.0f %5.0f %6.0f | %5.0f %5.0f %5.0f |", results->scenes[scene].name,
           facts->primitives, facts->crossings, facts->thickness, facts->unevenness, costs[0].build_ns,
           costs[1].build_ns, costs[2].build_ns, costs[0].ray_ns, costs[1].ray_ns, costs[2].ray_ns);
    for (int hint = 0; hint < CHOICE_HINTS; hint++) {
        double rays = choice_rays(hint), least = INFINITY, each[TIERS];
        int best = 0,
            chosen[MODELS] = {choose_by(fitted, facts, rays), has_others ? choose_by(&left_out, facts, rays) : 0,
                              (int)tier_choose(facts, (float)rays) - QUALITY_FAST};
        for (int tier = 0; tier < TIERS; tier++) {
            each[tier] = costs[tier].build_ns + rays * costs[tier].ray_ns;
            best = each[tier] < least ? tier : best;
            least = fmin(least, each[tier]);
        }
        printf("  %c", "fbh"[best]);
        for (int i = 0; i < MODELS; i++) {
            if (i == LEFT_OUT && !has_others)
                continue;
            printf(" %c%+.0f%%", "fbh"[chosen[i]], 100 * (each[chosen[i]] / least - 1));
            add_loss(&tallies[i], each[chosen[i]] / least - 1);
        }
    }
    printf("\n");
}

/* Prints the table in the syntax of tier.c. */
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
    struct tally tallies[MODELS] = {{0}};
    struct model model;
    if (!fit(results, NULL, &model)) {
        fprintf(stderr, "bvhd-bench: not every tier was measured\n");
        return false;
    }
    print_table(&model);
    printf(
        "scene, primitives, crossings, thickness, unevenness | build ns: fast, balanced, high | ray ns | for 0.1, 1, "
        "10, 100 rays: best; choice and loss of this table, of one fitted without scenes of this kind, of the one in "
        "use\n");
    for (uint32_t i = 0; i < results->scene_count; i++)
        add_scene(results, &model, i, tallies);
    print_tally("this table:", &tallies[FITTED]);
    print_tally("tables fitted without scenes of the same kind:", &tallies[LEFT_OUT]);
    print_tally("the table in use:", &tallies[IN_USE]);
    return true;
}
