/* SPDX-License-Identifier: Apache-2.0 */
#include <inttypes.h>
#include <stdio.h>

#include "tests/bench/bvhd_bench/chart.h"
#include "tests/bench/bvhd_bench/plot.h"

enum { ROW_PIXELS = 26, COLUMN_PIXELS = 46, MARGIN_LEFT = 315, MARGIN_TOP = 150, MARGIN_BOTTOM = 60 };

struct look {
    char text[24], fill[16];
    const char *ink;
};

/*
 * Clean cells are white to blue by their speed; cells with wrong answers are orange; cells without an answer are dark.
 */
static struct look look_of(const struct stability *stability, uint32_t row, uint32_t column)
{
    const struct cell_result *cell = &stability->cells[row][column];
    struct look look = {.ink = "#ffffff"};
    uint64_t wrong = verdicts_wrong(&cell->verdicts);
    if (cell->outcome != CELL_DONE) {
        snprintf(look.text, sizeof look.text, "%s", cell_outcome_name(cell->outcome));
        snprintf(look.fill, sizeof look.fill, "#8b1a00");
    } else if (wrong) {
        look.ink = "#000000";
        snprintf(look.text, sizeof look.text, "%" PRIu64, wrong);
        snprintf(look.fill, sizeof look.fill, "#E69F00");
    } else {
        double speed = stability_speed(stability, row, column);
        look.ink = speed > 0.65 ? "#ffffff" : "#000000";
        snprintf(look.text, sizeof look.text, "%.2f", speed);
        snprintf(look.fill, sizeof look.fill, "#%02x%02x%02x", (int)(235 - 235 * speed), (int)(244 - 130 * speed),
                 (int)(250 - 72 * speed));
    }
    return look;
}

static void draw_cell(FILE *script, const struct stability *stability, uint32_t row, uint32_t column)
{
    struct look look = look_of(stability, row, column);
    double y = stability->row_count - 1 - row;
    fprintf(script, "set object rectangle from %u,%.0f to %u,%.0f fc rgb \"%s\" fs solid border lc rgb \"#ffffff\"\n",
            column, y, column + 1, y + 1, look.fill);
    fprintf(script, "set label \"%s\" at %.1f,%.1f center front font \",8\" textcolor rgb \"%s\"\n", look.text,
            column + 0.5, y + 0.5, look.ink);
}

static void draw_names(FILE *script, const struct stability *stability)
{
    fprintf(script, "set ytics (");
    for (uint32_t row = 0; row < stability->row_count; row++)
        fprintf(script, "%s\"%s\" %.1f", row ? ", " : "", stability->rows[row]->name, stability->row_count - 0.5 - row);
    fprintf(script, ") scale 0\nset x2tics (");
    for (uint32_t column = 0; column < stability->column_count; column++)
        fprintf(script, "%s\"%s\" %.1f", column ? ", " : "", stability->columns[column].name, column + 0.5);
    fprintf(script, ") rotate by 55 left scale 0\nunset xtics\n");
}

static void draw(const void *context, FILE *script)
{
    const struct stability *stability = context;
    unsigned width = MARGIN_LEFT + 40 + COLUMN_PIXELS * stability->column_count;
    unsigned height = MARGIN_TOP + MARGIN_BOTTOM + ROW_PIXELS * stability->row_count;
    fprintf(script,
            "set lmargin at screen %.4f\nset rmargin at screen %.4f\nset tmargin at screen %.4f\nset bmargin at screen "
            "%.4f\n",
            (double)MARGIN_LEFT / width, 1 - 40.0 / width, 1 - (double)MARGIN_TOP / height,
            (double)MARGIN_BOTTOM / height);
    fprintf(script, "set xrange [0:%u]\nset x2range [0:%u]\nset yrange [0:%u]\nunset border\nunset key\n",
            stability->column_count, stability->column_count, stability->row_count);
    fprintf(script,
            "set label \"Stability: methods (ours above, Embree below) on scenes at which methods fail\" at screen "
            "0.01,%.4f left font \",14\"\n",
            1 - 20.0 / height);
    fprintf(
        script,
        "set label \"blue: no wrong answer, rays a second as a share of the column's fastest;  orange: the number of "
        "wrong answers;  dark: no answer at all\" at screen 0.01,%.4f left font \",10\"\n",
        20.0 / height);
    draw_names(script, stability);
    for (uint32_t row = 0; row < stability->row_count; row++)
        for (uint32_t column = 0; column < stability->column_count; column++)
            draw_cell(script, stability, row, column);
    fprintf(script, "plot -1 notitle\n");
}

bool chart_stability(const struct stability *stability, const char *directory)
{
    const struct plot plot = {directory, "stability", MARGIN_LEFT + 40 + COLUMN_PIXELS * stability->column_count,
                              MARGIN_TOP + MARGIN_BOTTOM + ROW_PIXELS * stability->row_count};
    return plot_run(&plot, draw, stability);
}
