/* SPDX-License-Identifier: Apache-2.0 */
#include <math.h>

#include "builder/update/decay.h"
#include "tests/bench/bench_decay.h"
#include "tests/bench/bvhd_bench/plot.h"

enum { WIDTH = 1300, HEIGHT = 900, PANELS = 4 };

/* Colours of Okabe and Ito, each with a shape of its own, for the scenes. */
static const struct {
    const char *colour;
    int shape;
} looks[DECAY_SCENES] = {
    {"#0072B2", 7},  {"#D55E00", 5},  {"#009E73", 9}, {"#CC79A7", 11},
    {"#E69F00", 13}, {"#56B4E9", 15}, {"#000000", 4}, {"#808080", 6},
};

struct panel {
    const char *title, *x_label;
    int x, y; /* columns of the data */
    const char *settings;
};

/*
 * Columns: 1 angle, 2 decay, 3 and 4 primary and diffuse rates over a build's, 5 rays a primitive at which a build
 * pays.
 */
static const struct panel panels[PANELS] = {
    {"Decay that updates report", "twist, degrees", 1, 2,
     "set xrange [-10:1460]\nset xtics 180\nset logscale y\nset yrange [0.6:12]\nset ytics (0.7,1,1.5,2,3,5,10)"},
    {"Diffuse rays a second, over a fresh build's", "twist, degrees", 1, 4,
     "set xrange [-10:1460]\nset xtics 180\nset yrange [0:1.15]"},
    {"Primary rays a second, over a fresh build's", "twist, degrees", 1, 3,
     "set xrange [-10:1460]\nset xtics 180\nset yrange [0:1.15]"},
    {"Rays a primitive from which on a build pays (grey: the rule)", "decay", 2, 5,
     "set logscale xy\nset xrange [0.65:12]\nset yrange [0.1:100]\nset xtics (0.7,1,1.5,2,3,5,10)"},
};

static void draw_data(const struct decay_results *results, FILE *script)
{
    for (int i = 0; i < results->scene_count; i++) {
        fprintf(script, "$s%d << EOD\n", i);
        for (int k = 0; k < DECAY_ANGLES; k++) {
            const struct decay_row *row = &results->scenes[i].rows[k];
            fprintf(script, "%g %.4g %.4g %.4g ", row->angle, row->decay, row->rate[0] / row->fresh_rate[0],
                    row->rate[1] / row->fresh_rate[1]);
            const double rays = decay_break_even(&results->scenes[i], row);
            fprintf(script, isfinite(rays) && rays < 1e6 ? "%.4g\n" : "NaN\n", rays);
        }
        fprintf(script, "EOD\n");
    }
    fprintf(script, "$rule << EOD\n");
    for (double rays = 0.1; rays < 100; rays *= 1.2)
        fprintf(script, "%.4g %.4g\n", decay_to_rebuild(results->quality, rays), rays);
    fprintf(script, "EOD\n");
}

static void draw_panel(const struct decay_results *results, int index, FILE *script)
{
    const struct panel *panel = &panels[index];
    fprintf(script,
            "unset logscale\nset autoscale\nset xtics auto\nset ytics auto\nset title \"%s\"\nset xlabel \"%s\"\n%s\n",
            panel->title, panel->x_label, panel->settings);
    fprintf(script, "set key %s\nplot ", index == 0 ? "bottom right" : "off");
    for (int i = 0; i < results->scene_count; i++) {
        fprintf(script, "%s$s%d using %d:%d with linespoints pt %d ps 1 lw 1.5 lc rgb \"%s\" title ", i ? ", " : "", i,
                panel->x, panel->y, looks[i].shape, looks[i].colour);
        plot_text(script, results->scenes[i].name);
    }
    fprintf(script, index == PANELS - 1 ? ", $rule with lines lw 4 lc rgb \"#a0a0a0\" notitle\n" : "\n");
}

static void draw(const void *context, FILE *script)
{
    const struct decay_results *results = context;
    draw_data(results, script);
    fprintf(script,
            "set multiplot layout 2,2 title \"Meshes twisted after a build at %g degrees: updates beside fresh "
            "builds\" font \",13\"\nset border 3 lc rgb \"#606060\"\nset grid lc rgb \"#e0e0e0\"\nset tics nomirror\n",
            results->from);
    for (int i = 0; i < PANELS; i++)
        draw_panel(results, i, script);
    fprintf(script, "unset multiplot\n");
}

bool decay_chart(const struct decay_results *results, const char *directory)
{
    const struct plot plot = {directory, "decay", WIDTH, HEIGHT};
    return plot_run(&plot, draw, results);
}
