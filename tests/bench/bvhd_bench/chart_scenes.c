/* SPDX-License-Identifier: Apache-2.0 */
#include <stdio.h>
#include <string.h>

#include "tests/bench/bvhd_bench/chart.h"
#include "tests/bench/bvhd_bench/choice.h"
#include "tests/bench/bvhd_bench/plot.h"

enum { TIERS = 3, PANELS = 2, ROW_PIXELS = 34, ABOVE_PIXELS = 90, BELOW_PIXELS = 80 };

static const struct {
    const char *method, *colour;
    int shape;
} tiers[TIERS] = {{"fast", "#E69F00", 9}, {"balanced", "#0072B2", 7}, {"high", "#CC79A7", 13}};

/* The figures of the panels, relative to the method that a user of Embree would take. */
static const struct {
    enum figure figure;
    const char *peer, *title;
} panels[PANELS] = {
    {FIGURE_RATE_ALL, "embree/bvh-medium-2", "build, all threads: rate over rtcBuildBVH MEDIUM's"},
    {FIGURE_DIFFUSE, "embree/scene-medium-robust", "diffuse rays, one thread: rate over rtcIntersect1's, robust"},
};

static unsigned height_for(const struct results *results)
{
    return ABOVE_PIXELS + BELOW_PIXELS + ROW_PIXELS * results->scene_count;
}

/* The ratio on one scene alone. */
static bool ratio_of(const struct results *results, uint32_t scene, const char *method, int panel, double *ret_ratio)
{
    const struct results one = {results->options, results->scenes + scene, 1};
    struct mean mean = mean_of(&one, method, panels[panel].peer, panels[panel].figure);
    if (mean.count > 0)
        *ret_ratio = mean.value;
    return mean.count > 0;
}

/* Whether a panel has points; a run with few methods may have none. */
static bool has_points(const struct results *results, int panel)
{
    bool some = false;
    double ratio;
    for (int tier = 0; tier < TIERS; tier++)
        for (uint32_t i = 0; i < results->scene_count; i++)
            some |= ratio_of(results, i, tiers[tier].method, panel, &ratio);
    return some;
}

static void draw_data(const struct results *results, FILE *script)
{
    for (int panel = 0; panel < PANELS; panel++)
        for (int tier = 0; tier < TIERS; tier++) {
            /* The extra point is outside of the picture; gnuplot rejects an empty data block. */
            fprintf(script, "$p%dt%d << EOD\n%s", panel, tier, has_points(results, panel) ? "" : "1 -9\n");
            for (uint32_t i = 0; i < results->scene_count; i++) {
                double ratio;
                if (ratio_of(results, i, tiers[tier].method, panel, &ratio))
                    fprintf(script, "%.5g %u\n", ratio, results->scene_count - i);
            }
            fprintf(script, "EOD\n");
        }
}

static void draw_panel(const struct results *results, int panel, FILE *script)
{
    fprintf(script, "set title ");
    plot_text(script, panels[panel].title);
    fprintf(script, " font \",10\"\nset ytics (");
    for (uint32_t i = 0; i < results->scene_count; i++) {
        fprintf(script, "%s", i ? ", " : "");
        if (panel == 0)
            plot_text(script, results->scenes[i].name);
        else
            fprintf(script, "\"\"");
        fprintf(script, " %u", results->scene_count - i);
    }
    fprintf(script, ")\nset %s\n", has_points(results, panel) ? "autoscale x" : "xrange [0.5:2]");
    fprintf(script, "set arrow 1 from 1,graph 0 to 1,graph 1 nohead lw 1.5 lc rgb \"#808080\"\nplot ");
    for (int tier = 0; tier < TIERS; tier++)
        fprintf(script, "%s$p%dt%d with points pt %d ps 1.5 lw 2 lc rgb \"%s\" title \"%s\"", tier ? ", " : "", panel,
                tier, tiers[tier].shape, tiers[tier].colour, tiers[tier].method);
    fprintf(script, "\n");
}

/* Writes where auto takes that tier; for `tier` TIERS, how much more auto costs where its choice is not good. */
static void draw_choice_data(const struct results *results, int tier, FILE *script)
{
    /* The extra point is outside of the picture; gnuplot rejects an empty data block. */
    fprintf(script, "$c%d << EOD\n-9 0 \"\"\n", tier);
    for (uint32_t i = 0; i < results->scene_count; i++)
        for (int hint = 0; hint < CHOICE_HINTS; hint++) {
            struct choice choice;
            if (!choice_of(results, i, hint, &choice))
                continue;
            double more = choice.auto_ms / choice.best_ms - 1;
            if (tier == TIERS && !choice.is_good)
                fprintf(script, "%d %u \"+%.0f %%\"\n", hint, results->scene_count - i, 100 * more);
            else if (tier < TIERS && strcmp(choice.chosen, tiers[tier].method) == 0)
                fprintf(script, "%d %u\n", hint, results->scene_count - i);
        }
    fprintf(script, "EOD\n");
}

static void draw_choices(FILE *script)
{
    fprintf(script,
            "set title \"auto, by rays a triangle (red: its loss)\" font \",10\"\nunset arrow 1\nunset logscale x\nset "
            "xrange [-0.6:%d.8]\n"
            "set offsets 0, 0, 0, 0\nset xtics (",
            CHOICE_HINTS - 1);
    for (int hint = 0; hint < CHOICE_HINTS; hint++)
        fprintf(script, "%s\"%g\" %d", hint ? ", " : "", choice_rays(hint), hint);
    fprintf(script, ")\nplot ");
    for (int tier = 0; tier < TIERS; tier++)
        fprintf(script, "$c%d with points pt %d ps 1.5 lw 2 lc rgb \"%s\" notitle, ", tier, tiers[tier].shape,
                tiers[tier].colour);
    fprintf(script, "$c%d using 1:2:3 with labels offset 3.4,0 font \",8\" tc rgb \"#c00000\" notitle\n", TIERS);
}

static void draw(const void *context, FILE *script)
{
    const struct results *results = context;
    const double height = height_for(results);
    draw_data(results, script);
    for (int tier = 0; tier <= TIERS; tier++)
        draw_choice_data(results, tier, script);
    fprintf(script,
            "set multiplot layout 1,3 title \"Tiers by scene: right is better, 1 is Embree\" font \",13\" margins "
            "0.12,0.98,%.4f,%.4f spacing 0.03\n",
            BELOW_PIXELS / height, 1 - ABOVE_PIXELS / height);
    fprintf(script, "set border 1 lc rgb \"#606060\"\nset grid lc rgb \"#e0e0e0\"\nset tics nomirror\nset logscale "
                    "x\nset autoscale x\n"
                    "set offsets graph 0.05, graph 0.05, 0, 0\nset xtics (0.02,0.05,0.1,0.2,0.5,1,2,5,10,20)\n");
    fprintf(script, "set yrange [0.4:%u.6]\nset key at screen 0.5,%.4f center horizontal samplen 1 maxrows 1\n",
            results->scene_count, 20 / height);
    for (int panel = 0; panel < PANELS; panel++)
        draw_panel(results, panel, script);
    draw_choices(script);
    fprintf(script, "unset multiplot\n");
}

bool chart_scenes(const struct results *results, const char *directory)
{
    const struct plot plot = {directory, "scenes", 1300, height_for(results)};
    return plot_run(&plot, draw, results);
}
