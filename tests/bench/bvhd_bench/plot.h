/* SPDX-License-Identifier: Apache-2.0 */
/* plot.h - writes gnuplot scripts, one for each chart, and runs each of them for all kinds of pictures. */
#ifndef BVHD_BENCH_PLOT_H
#define BVHD_BENCH_PLOT_H

#include <stdbool.h>
#include <stdio.h>

struct plot {
    const char *directory, *name; /* DIRECTORY/NAME.gp, .svg, .png */
    unsigned width, height; /* pixels */
};

/*
 * Writes the script, by calling draw(context, script) once for each terminal, and runs gnuplot on it. Without gnuplot
 * it writes a line to stderr and returns true.
 */
bool plot_run(const struct plot *plot, void (*draw)(const void *context, FILE *script), const void *context);

/* Writes the text in double quotes and escapes the characters that are special to gnuplot. */
void plot_text(FILE *script, const char *text);

#endif
