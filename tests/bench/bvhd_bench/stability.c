/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/stability.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

static void choose_rows(struct stability *stability)
{
    uint32_t count;
    const struct method *methods = method_all(&count);
    for (uint32_t i = 0; i < count && stability->row_count < STABILITY_ROWS; i++)
        if (method_traces(&methods[i]))
            stability->rows[stability->row_count++] = &methods[i];
}

static bool is_wanted(const struct stability_options *options, const struct scene_source *source)
{
    bool is_named = options->scene_count == 0 && source->is_hard;
    for (int i = 0; i < options->scene_count; i++)
        is_named |= strcmp(options->scenes[i], source->name) == 0;
    return is_named;
}

static void choose_columns(const struct stability_options *options, struct stability *stability)
{
    uint32_t count;
    const struct scene_source *sources = scene_source_all(&count);
    for (uint32_t i = 0; i < count && stability->column_count < STABILITY_COLUMNS; i++)
        if (is_wanted(options, &sources[i]))
            stability->columns[stability->column_count++] = sources[i];
}

bool stability_run(const struct stability_options *options, struct stability *ret_stability)
{
    *ret_stability = (struct stability){.row_count = 0};
    choose_rows(ret_stability);
    choose_columns(options, ret_stability);
    for (uint32_t column = 0; column < ret_stability->column_count; column++) {
        for (uint32_t row = 0; row < ret_stability->row_count; row++) {
            const struct cell_request request = {ret_stability->rows[row]->name,
                                                 ret_stability->columns[column].name,
                                                 options->size,
                                                 options->rays,
                                                 options->seed,
                                                 options->seconds};
            if (!cell_run(&request, &ret_stability->cells[row][column]))
                return false;
        }
        fprintf(stderr, "bvhd-bench: %s\n", ret_stability->columns[column].name);
    }
    return true;
}

bool stability_is_clean(const struct cell_result *cell)
{
    return cell->outcome == CELL_DONE && verdicts_wrong(&cell->verdicts) == 0;
}

double stability_speed(const struct stability *stability, uint32_t row, uint32_t column)
{
    double best = 0;
    for (uint32_t i = 0; i < stability->row_count; i++)
        if (stability_is_clean(&stability->cells[i][column]))
            best = fmax(best, stability->cells[i][column].mrays_s);
    return best > 0 ? stability->cells[row][column].mrays_s / best : 0;
}

uint32_t stability_own_failures(const struct stability *stability)
{
    uint32_t count = 0;
    for (uint32_t row = 0; row < stability->row_count; row++)
        for (uint32_t column = 0; column < stability->column_count; column++)
            count += stability->rows[row]->kind == METHOD_OWN && !stability_is_clean(&stability->cells[row][column]);
    return count;
}
