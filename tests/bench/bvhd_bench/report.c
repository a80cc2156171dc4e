/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/report.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "tests/bench/bvhd_bench/choice.h"
#include "tests/bench/bvhd_bench/embree_api.h"
#include "client/bvhctl/base/json.h"

enum { SCHEMA = 1 };

static const char *const crew_names[MEASURE_CREWS] = {"all_threads", "one_thread"};

static void write_statistic(struct json *json, const char *key, const struct statistic *statistic)
{
    if (statistic->count == 0) {
        json_null(json, key);
        return;
    }
    json_object(json, key);
    json_number(json, "median", statistic_median(statistic));
    json_number(json, "mad", statistic_mad(statistic));
    json_integer(json, "runs", (uint64_t)statistic->count);
    json_object_end(json);
}

static void write_builds(struct json *json, const struct scene_figures *scene, const struct figures *figures)
{
    json_object(json, "build");
    for (int crew = 0; crew < MEASURE_CREWS; crew++) {
        json_object(json, crew_names[crew]);
        write_statistic(json, "ms", &figures->ms[crew]);
        json_number(json, "mprim_s", measure_rate(scene, figures, crew));
        if (figures->method->kind == METHOD_OWN) {
            json_object(json, "stages_ms");
            for (int stage = 0; stage < MEASURE_STAGES; stage++)
                write_statistic(json, measure_stage_name(stage), &figures->stages[crew][stage]);
            json_object_end(json);
        }
        json_object_end(json);
    }
    json_object_end(json);
}

static void write_tree(struct json *json, const struct figures *figures)
{
    if (!method_has_tree(figures->method)) {
        json_null(json, "tree");
        return;
    }
    json_object(json, "tree");
    json_integer(json, "arity", figures->method->arity ? figures->method->arity : 2);
    json_number(json, "sah", figures->sah);
    json_number(json, "overlap", figures->overlap);
    json_number(json, "inner_steps_per_diffuse_ray", figures->work.inner);
    json_number(json, "triangle_tests_per_diffuse_ray", figures->work.triangles);
    json_number(json, "refs_per_triangle", figures->refs);
    json_integer(json, "depth", figures->depth);
    json_object_end(json);
}

static void write_sizes(struct json *json, const struct scene_figures *scene, const struct figures *figures)
{
    const struct layout_sizes *sizes = &figures->stats.sizes;
    json_object(json, "bytes");
    json_integer(json, "total", figures->bytes);
    json_number(json, "per_triangle", (double)figures->bytes / scene->triangles);
    if (figures->method->kind == METHOD_OWN) {
        json_integer(json, "header", sizes->header);
        json_integer(json, "nodes", sizes->nodes);
        json_integer(json, "records", sizes->records);
        json_integer(json, "vertices", sizes->vertices);
        json_integer(json, "geometries", sizes->geometries);
    }
    json_object_end(json);
    json_integer(json, "peak_resident_bytes", figures->peak_resident);
    if (figures->method->kind == METHOD_OWN)
        json_integer(json, "peak_allocated_bytes", figures->peak_bytes);
}

static void write_verdicts(struct json *json, const struct verdicts *verdicts)
{
    json_object(json, "check");
    json_integer(json, "rays", verdicts->rays);
    json_integer(json, "hits", verdicts->hits);
    json_integer(json, "uncertain", verdicts->uncertain);
    json_integer(json, "wrong", verdicts_wrong(verdicts));
    json_integer(json, "wrong_miss", verdicts->wrong_miss);
    json_integer(json, "wrong_hit", verdicts->wrong_hit);
    json_integer(json, "wrong_primitive", verdicts->wrong_primitive);
    json_integer(json, "inexact_t", verdicts->inexact);
    json_number(json, "t_rel_err_max", verdicts->t_rel_err_max);
    json_object_end(json);
}

static void write_traces(struct json *json, const struct scene_figures *scene, const struct figures *figures)
{
    if (!method_traces(figures->method)) {
        json_null(json, "mrays_s");
        json_null(json, "check");
        return;
    }
    json_object(json, "mrays_s");
    for (enum ray_kind kind = 0; kind < RAY_KINDS; kind++)
        write_statistic(json, ray_kind_name(kind), &figures->mrays[kind]);
    json_object_end(json);
    if (figures->method->kind == METHOD_OWN && scene->ray_counts[RAYS_DIFFUSE]) {
        double rays = scene->ray_counts[RAYS_DIFFUSE];
        json_number(json, "nodes_per_diffuse_ray", (double)figures->counters.nodes / rays);
        json_number(json, "triangles_per_diffuse_ray", (double)figures->counters.triangles / rays);
    }
    write_verdicts(json, &figures->verdicts);
}

static void write_method(struct json *json, const struct scene_figures *scene, const struct figures *figures)
{
    json_object(json, NULL);
    json_text(json, "method", figures->method->name);
    if (*figures->failure) {
        json_text(json, "failure", figures->failure);
        json_object_end(json);
        return;
    }
    json_null(json, "failure");
    if (figures->method->kind == METHOD_OWN) {
        json_text(json, "builder", figures->stats.method);
        json_text(json, "quality", build_quality_name(figures->stats.quality));
    }
    write_builds(json, scene, figures);
    write_tree(json, figures);
    write_sizes(json, scene, figures);
    write_traces(json, scene, figures);
    json_object_end(json);
}

static void write_mean(struct json *json, const char *key, const struct mean *mean)
{
    if (mean->count == 0) {
        json_null(json, key);
        return;
    }
    json_object(json, key);
    json_number(json, "geometric_mean", mean->value);
    json_number(json, "least", mean->least);
    json_text(json, "least_scene", mean->least_scene);
    json_number(json, "most", mean->most);
    json_text(json, "most_scene", mean->most_scene);
    json_integer(json, "scenes", mean->count);
    json_object_end(json);
}

static void write_summary(struct json *json, const struct results *results)
{
    json_array(json, "summary");
    for (uint32_t i = 0; i < results->options->method_count; i++) {
        const char *method = results->options->methods[i]->name;
        json_object(json, NULL);
        json_text(json, "method", method);
        for (enum figure figure = 0; figure < FIGURES; figure++) {
            struct mean mean = mean_of(results, method, NULL, figure);
            write_mean(json, figure_name(figure), &mean);
        }
        json_object_end(json);
    }
    json_array_end(json);
}

static void write_floors(struct json *json, const struct results *results)
{
    uint32_t count;
    const struct floor *floors = floor_all(&count);
    json_array(json, "floors");
    for (uint32_t i = 0; i < count; i++) {
        struct mean mean = mean_of(results, floors[i].method, floors[i].peer, floors[i].figure);
        json_object(json, NULL);
        json_text(json, "method", floors[i].method);
        json_text(json, "figure", figure_name(floors[i].figure));
        if (floors[i].peer)
            json_text(json, "relative_to", floors[i].peer);
        else
            json_null(json, "relative_to");
        json_text(json, "has_to_be", floors[i].at_least ? "at least" : "at most");
        json_number(json, "floor", floors[i].floor);
        json_number(json, "aim", floors[i].aim);
        write_mean(json, "is", &mean);
        if (mean.count > 0)
            json_bool(json, "met", floor_is_met(&floors[i], &mean));
        else
            json_null(json, "met");
        json_object_end(json);
    }
    json_array_end(json);
}

static void write_settings(struct json *json, const struct measure_options *options)
{
    json_object(json, "settings");
    json_integer(json, "runs", (uint64_t)options->runs);
    json_number(json, "patience_s", options->patience);
    json_integer(json, "threads", options->threads);
    json_integer(json, "picture", options->picture);
    json_integer(json, "check_rays", options->check_rays);
    json_integer(json, "seed", options->seed);
    json_integer(json, "embree", RTC_VERSION);
    json_object_end(json);
}

static void write_choices(struct json *json, const struct results *results, uint32_t scene)
{
    json_array(json, "auto");
    for (int hint = 0; hint < CHOICE_HINTS; hint++) {
        struct choice choice;
        if (!choice_of(results, scene, hint, &choice))
            continue;
        json_object(json, NULL);
        json_number(json, "rays_per_primitive", choice_rays(hint));
        json_text(json, "chosen", choice.chosen);
        json_text(json, "best", choice.best);
        json_number(json, "best_ms", choice.best_ms);
        json_number(json, "auto_ms", choice.auto_ms);
        json_number(json, "spread_ms", choice.spread_ms);
        json_bool(json, "good", choice.is_good);
        json_object_end(json);
    }
    json_array_end(json);
}

static void write_facts(struct json *json, const struct facts *facts)
{
    json_object(json, "facts");
    json_integer(json, "primitives", facts->primitives);
    json_integer(json, "sampled", facts->sampled);
    json_number(json, "crossings", facts->crossings);
    json_number(json, "thickness", facts->thickness);
    json_number(json, "unevenness", facts->unevenness);
    json_object_end(json);
}

static void write_scene(struct json *json, const struct results *results, uint32_t index)
{
    const struct scene_figures *scene = &results->scenes[index];
    json_object(json, NULL);
    json_text(json, "scene", scene->name);
    json_integer(json, "triangles", scene->triangles);
    json_integer(json, "vertices", scene->vertices);
    json_object(json, "rays");
    for (enum ray_kind kind = 0; kind < RAY_KINDS; kind++)
        json_integer(json, ray_kind_name(kind), scene->ray_counts[kind]);
    json_object_end(json);
    write_facts(json, &scene->facts);
    write_choices(json, results, index);
    json_array(json, "methods");
    for (uint32_t i = 0; i < results->options->method_count; i++)
        write_method(json, scene, &scene->methods[i]);
    json_array_end(json);
    json_object_end(json);
}

/* Ends the object, and writes the text to the file. */
static bool save(struct json *json, const char *directory, const char *name)
{
    char path[4096];
    json_object_end(json);
    json_newline(json);
    snprintf(path, sizeof path, "%s/%s", directory, name);
    FILE *file = json->failed ? NULL : fopen(path, "w");
    bool good = file && fwrite(json->data, 1, json->size, file) == json->size;
    good = file && fclose(file) == 0 && good;
    if (!good)
        fprintf(stderr, "bvhd-bench: %s: %s\n", path, strerror(errno));
    json_finish(json);
    return good;
}

static void begin(struct json *json, struct memory *memory)
{
    memory_init(memory, UINT64_MAX);
    json_init(json, memory, true);
    json_object(json, NULL);
    json_integer(json, "schema", SCHEMA);
}

bool report_results(const struct results *results, const char *directory)
{
    struct memory memory;
    struct json json;
    begin(&json, &memory);
    write_settings(&json, results->options);
    write_floors(&json, results);
    write_summary(&json, results);
    json_array(&json, "scenes");
    for (uint32_t i = 0; i < results->scene_count; i++)
        write_scene(&json, results, i);
    json_array_end(&json);
    return save(&json, directory, "report.json");
}

static void write_cell(struct json *json, const struct stability *stability, uint32_t row, uint32_t column)
{
    const struct cell_result *cell = &stability->cells[row][column];
    json_object(json, NULL);
    json_text(json, "scene", stability->columns[column].name);
    json_text(json, "outcome", cell_outcome_name(cell->outcome));
    if (cell->outcome == CELL_CRASHED)
        json_integer(json, "signal", (uint64_t)cell->signal);
    if (cell->outcome == CELL_REFUSED)
        json_text(json, "failure", cell->failure);
    if (cell->outcome == CELL_DONE) {
        json_number(json, "relative_speed", stability_speed(stability, row, column));
        json_number(json, "mrays_s", cell->mrays_s);
        json_number(json, "build_ms", cell->ms);
        json_number(json, "sah", cell->sah);
        json_integer(json, "peak_resident_bytes", cell->peak_bytes);
        write_verdicts(json, &cell->verdicts);
    }
    json_object_end(json);
}

static bool write_table(const struct stability *stability, const char *directory)
{
    char path[4096];
    snprintf(path, sizeof path, "%s/stability.md", directory);
    FILE *file = fopen(path, "w");
    if (!file) {
        fprintf(stderr, "bvhd-bench: %s: %s\n", path, strerror(errno));
        return false;
    }
    fprintf(file, "| scene | what is hard |");
    for (uint32_t row = 0; row < stability->row_count; row++)
        fprintf(file, " %s |", stability->rows[row]->name);
    fprintf(file, "\n|---|---|");
    for (uint32_t row = 0; row < stability->row_count; row++)
        fprintf(file, "---|");
    for (uint32_t column = 0; column < stability->column_count; column++) {
        fprintf(file, "\n| %s | %s |", stability->columns[column].name, stability->columns[column].shows);
        for (uint32_t row = 0; row < stability->row_count; row++) {
            const struct cell_result *cell = &stability->cells[row][column];
            if (cell->outcome != CELL_DONE)
                fprintf(file, " **%s** |", cell_outcome_name(cell->outcome));
            else if (verdicts_wrong(&cell->verdicts))
                fprintf(file, " **%" PRIu64 " wrong** |", verdicts_wrong(&cell->verdicts));
            else
                fprintf(file, " %.2f |", stability_speed(stability, row, column));
        }
    }
    fprintf(file, "\n");
    return fclose(file) == 0;
}

bool report_stability(const struct stability *stability, const struct stability_options *options, const char *directory)
{
    struct memory memory;
    struct json json;
    begin(&json, &memory);
    json_integer(&json, "size", options->size);
    json_integer(&json, "rays", options->rays);
    json_integer(&json, "seed", options->seed);
    json_integer(&json, "own_failures", stability_own_failures(stability));
    json_array(&json, "methods");
    for (uint32_t row = 0; row < stability->row_count; row++) {
        json_object(&json, NULL);
        json_text(&json, "method", stability->rows[row]->name);
        json_bool(&json, "own", stability->rows[row]->kind == METHOD_OWN);
        json_array(&json, "cells");
        for (uint32_t column = 0; column < stability->column_count; column++)
            write_cell(&json, stability, row, column);
        json_array_end(&json);
        json_object_end(&json);
    }
    json_array_end(&json);
    return save(&json, directory, "stability.json") && write_table(stability, directory);
}
