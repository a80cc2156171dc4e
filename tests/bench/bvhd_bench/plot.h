/* SPDX-License-Identifier: Apache-2.0 */
/* plot.h - gnuplot scripts: one a chart, run once for each kind of picture. */
#ifndef BVHD_BENCH_PLOT_H
#define BVHD_BENCH_PLOT_H

#include <stdbool.h>
#include <stdio.h>

struct plot {
    const char *directory, *name; /* DIRECTORY/NAME.gp, .svg, .png */
    unsigned width, height; /* pixels */
};

/*
 * Writes the script, by calling draw(context, script) once for each terminal, and runs gnuplot on it. Without gnuplot:
 * a line on stderr, true.
 */
bool plot_run(const struct plot *plot, void (*draw)(const void *context, FILE *script), const void *context);

/* In double quotes, with what gnuplot would take for more than a letter escaped. */
void plot_text(FILE *script, const char *text);

#endif
