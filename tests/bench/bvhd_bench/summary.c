/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/summary.h"

#include <math.h>
#include <string.h>

const char *figure_name(enum figure figure)
{
    static const char *const names[FIGURES] = {
        "rate_all_threads", "rate_one_thread", "sah",   "work", "overlap", "refs", "bytes",
        "primary",          "diffuse",         "shadow"};
    return names[figure];
}

static const struct figures *sweep_of(const struct results *results, uint32_t scene)
{
    for (uint32_t i = 0; i < results->options->method_count; i++)
        if (results->options->methods[i]->kind == METHOD_SWEEP)
            return &results->scenes[scene].methods[i];
    return NULL;
}

static double work_of(const struct figures *figures)
{
    return figures->work.inner + figures->work.triangles;
}

/* The figure relative to the sweep's; 0 where either is missing. */
static double tree_figure(const struct figures *own, const struct figures *sweep, enum figure figure)
{
    double value = figure == FIGURE_SAH ? own->sah : figure == FIGURE_WORK ? work_of(own) : own->overlap;
    double base = !sweep                  ? 0
                  : figure == FIGURE_SAH  ? sweep->sah
                  : figure == FIGURE_WORK ? work_of(sweep)
                                          : sweep->overlap;
    return base > 0 ? value / base : 0;
}

static double plain_figure(const struct scene_figures *scene, const struct figures *own, enum figure figure)
{
    switch (figure) {
    case FIGURE_RATE_ALL:
        return measure_rate(scene, own, 0);
    case FIGURE_RATE_ONE:
        return measure_rate(scene, own, 1);
    case FIGURE_REFS:
        return own->refs;
    case FIGURE_BYTES:
        return (double)own->bytes / scene->triangles;
    default:
        return statistic_median(&own->mrays[figure - FIGURE_PRIMARY]);
    }
}

bool figure_of(const struct results *results, uint32_t scene, uint32_t method, enum figure figure, double *ret_value)
{
    const struct figures *own = &results->scenes[scene].methods[method];
    if (*own->failure)
        return false;
    bool is_relative = figure == FIGURE_SAH || figure == FIGURE_WORK || figure == FIGURE_OVERLAP;
    double value = is_relative ? tree_figure(own, sweep_of(results, scene), figure)
                               : plain_figure(&results->scenes[scene], own, figure);
    if (!(value > 0))
        return false;
    *ret_value = value;
    return true;
}

static bool find(const struct results *results, const char *name, uint32_t *ret_index)
{
    for (uint32_t i = 0; i < results->options->method_count; i++)
        if (strcmp(results->options->methods[i]->name, name) == 0) {
            *ret_index = i;
            return true;
        }
    return false;
}

struct mean mean_of(const struct results *results, const char *method, const char *peer, enum figure figure)
{
    struct mean mean = {.least = INFINITY};
    uint32_t own = 0, other = 0;
    double sum = 0;
    if (!find(results, method, &own) || (peer && !find(results, peer, &other)))
        return mean;
    for (uint32_t i = 0; i < results->scene_count; i++) {
        double value, base = 1;
        if (!figure_of(results, i, own, figure, &value) || (peer && !figure_of(results, i, other, figure, &base)))
            continue;
        value /= base;
        sum += log(value);
        mean.count++;
        if (value < mean.least) {
            mean.least = value;
            mean.least_scene = results->scenes[i].name;
        }
        if (value > mean.most) {
            mean.most = value;
            mean.most_scene = results->scenes[i].name;
        }
    }
    mean.value = mean.count ? exp(sum / mean.count) : 0;
    return mean;
}

static const struct floor floors[] = {
    {"balanced", "embree/bvh-medium-2", FIGURE_RATE_ALL, true, 1.5, 1.8},
    {"balanced", "embree/bvh-medium-2", FIGURE_SAH, false, 1, 0.94},
    {"balanced", "embree/bvh-medium-2", FIGURE_WORK, false, 1, 0.97},
    {"fast", "embree/bvh-low-8", FIGURE_RATE_ALL, true, 1, 2},
    {"fast", NULL, FIGURE_SAH, false, 1.25, 1.15},
    {"high", "embree/scene-high", FIGURE_RATE_ALL, true, 0.5, 1.08},
    {"high", NULL, FIGURE_WORK, false, 0.86, 0.82},
    {"high", NULL, FIGURE_REFS, false, 1.25, 1.2},
    {"balanced", "embree/scene-medium-robust", FIGURE_PRIMARY, true, 0.6, 1},
    {"balanced", "embree/scene-medium-robust", FIGURE_DIFFUSE, true, 0.6, 1},
    {"balanced", "embree/scene-medium-robust", FIGURE_SHADOW, true, 0.6, 1},
    {"balanced", NULL, FIGURE_BYTES, false, 36, 30},
    {"balanced/fast-triangles", NULL, FIGURE_BYTES, false, 58, 58},
};

const struct floor *floor_all(uint32_t *ret_count)
{
    *ret_count = sizeof floors / sizeof floors[0];
    return floors;
}

bool floor_is_met(const struct floor *floor, const struct mean *mean)
{
    return mean->count > 0 && (floor->at_least ? mean->value >= floor->floor : mean->value <= floor->floor);
}
