/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bvhd-bench - measures every tier and target beside Embree's builders in one run, and maps which of them survive which
 * scenes. README.md says more.
 *
 *     bvhd-bench SCENE... -o DIR
 *     bvhd-bench --stability [NAME...] -o DIR
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/bench/bvhd_bench/calibrate.h"
#include "tests/bench/bvhd_bench/chart.h"
#include "tests/bench/bvhd_bench/choice.h"
#include "client/bvhctl/base/files.h"
#include "proto/base/memory.h"
#include "tests/bench/bvhd_bench/report.h"

enum { EXIT_FAILED = 1, EXIT_USAGE = 2, EXIT_WRONG = 3 };

struct options {
    const char *directory;
    bool stability;
    char **names; /* names of scenes */
    int name_count;
    struct measure_options measure;
    struct stability_options cells;
};

static void print_usage(FILE *file)
{
    fprintf(
        file,
        "usage: bvhd-bench SCENE... -o DIR [OPTION...]\n"
        "       bvhd-bench --stability [NAME...] -o DIR [OPTION...]\n"
        "       bvhd-bench --calibrate SCENE... [OPTION...]\n"
        "SCENE: a binary little-endian PLY file, or the name of a generated scene, also NAME@SEED and NAME@SEED@SIZE\n"
        "  --runs N         repetitions of each measurement, interleaved (7)\n"
        "  --patience S     once builds or rays of a method and scene have taken S seconds, 3 runs are enough (3)\n"
        "  --threads N      threads of the first crew; the second is one thread (all processors)\n"
        "  --picture N      a picture has N x N primary rays (256)\n"
        "  --rays N         rays compared with brute force: of a scene (2000), of a cell of the map (1000)\n"
        "  --calibrate      measure times only, and print what the constants of builder/tier.c should be\n"
        "  --seed N         seed of those rays and of generated scenes (1)\n"
        "  --methods A,B    measure only these methods\n"
        "  --size N         triangles of a generated scene (100000), or of a scene of the map (5000)\n"
        "  --time-limit S   seconds that a cell of the map may take (30)\n");
}

/* Parses a list of method names, separated by commas. Returns false when one of them is unknown. */
static bool choose_methods(struct measure_options *options, char *list)
{
    options->method_count = 0;
    for (char *rest = list, *name; (name = strtok_r(rest, ",", &rest)) != NULL;) {
        const struct method *method = method_find(name);
        if (!method || options->method_count == MEASURE_METHODS)
            return false;
        options->methods[options->method_count++] = method;
    }
    return options->method_count > 0;
}

static bool take_number(struct options *options, const char *name, const char *value)
{
    char *rest;
    double number = strtod(value, &rest);
    if (*rest || rest == value || !(number >= 0 && number < 1e9))
        return false;
    if (strcmp(name, "--runs") == 0)
        options->measure.runs = (int)number;
    else if (strcmp(name, "--patience") == 0)
        options->measure.patience = number;
    else if (strcmp(name, "--threads") == 0)
        options->measure.threads = (unsigned)number;
    else if (strcmp(name, "--picture") == 0)
        options->measure.picture = (uint32_t)number / 8 * 8;
    else if (strcmp(name, "--rays") == 0)
        options->measure.check_rays = options->cells.rays = (uint32_t)number;
    else if (strcmp(name, "--seed") == 0)
        options->measure.seed = options->cells.seed = (uint64_t)number;
    else if (strcmp(name, "--size") == 0)
        options->measure.size = options->cells.size = (uint32_t)number;
    else if (strcmp(name, "--time-limit") == 0)
        options->cells.seconds = number;
    else
        return false;
    return true;
}

static bool take_option(struct options *options, const char *name, char *value)
{
    if (strcmp(name, "-o") == 0)
        options->directory = value;
    else if (strcmp(name, "--methods") == 0)
        return choose_methods(&options->measure, value);
    else
        return take_number(options, name, value);
    return true;
}

static bool parse(int argc, char **argv, struct options *options)
{
    options->names = argv;
    for (int i = 1; i < argc; i++)
        if (strcmp(argv[i], "--stability") == 0)
            options->stability = true;
        else if (strcmp(argv[i], "--calibrate") == 0)
            options->measure.calibrates = choose_methods(&options->measure, (char[]){"fast,balanced,high"});
        else if (argv[i][0] != '-')
            argv[options->name_count++] = argv[i];
        else if (i + 1 >= argc || !take_option(options, argv[i], argv[i + 1]))
            return false;
        else
            i++;
    const struct measure_options *measure = &options->measure;
    bool writes = !measure->calibrates;
    return (options->directory || !writes) && (options->stability || options->name_count > 0) && measure->runs > 0 &&
           measure->threads > 0 && measure->picture >= 8 && measure->check_rays > 0 && options->cells.size > 0;
}

static struct options defaults(void)
{
    uint32_t count;
    const struct method *methods = method_all(&count);
    long processors = sysconf(_SC_NPROCESSORS_ONLN);
    struct options options = {
        .measure = {.runs = 7, .patience = 3, .picture = 256, .size = 100000, .check_rays = 2000, .seed = 1},
        .cells = {.size = 5000, .rays = 1000, .seed = 1, .seconds = 30}};
    options.measure.threads = processors > 0 ? (unsigned)processors : 1;
    for (uint32_t i = 0; i < count && i < MEASURE_METHODS; i++)
        options.measure.methods[options.measure.method_count++] = &methods[i];
    return options;
}

static void print_floors(const struct results *results)
{
    uint32_t count;
    const struct floor *floors = floor_all(&count);
    for (uint32_t i = 0; i < count; i++) {
        struct mean mean = mean_of(results, floors[i].method, floors[i].peer, floors[i].figure);
        if (mean.count > 0)
            printf("%-24s %-17s %s%-26s %7.3f  %s %.2f: %s (aim %.2f), worst %.3f (%s)\n", floors[i].method,
                   figure_name(floors[i].figure), floors[i].peer ? "/ " : "  ", floors[i].peer ? floors[i].peer : "",
                   mean.value, floors[i].at_least ? ">=" : "<=", floors[i].floor,
                   floor_is_met(&floors[i], &mean) ? "met" : "NOT met", floors[i].aim,
                   floors[i].at_least ? mean.least : mean.most,
                   floors[i].at_least ? mean.least_scene : mean.most_scene);
    }
}

static void print_choices(const struct results *results)
{
    for (int hint = 0; hint < CHOICE_HINTS; hint++) {
        uint32_t good = 0, count = 0;
        for (uint32_t i = 0; i < results->scene_count; i++) {
            struct choice choice;
            if (!choice_of(results, i, hint, &choice))
                continue;
            count++;
            good += choice.is_good;
            if (!choice.is_good)
                printf("auto, %g rays a primitive, %s: %.2f ms, %s would take %.2f\n", choice_rays(hint),
                       results->scenes[i].name, choice.auto_ms, choice.best, choice.best_ms);
        }
        printf("auto, %g rays a primitive: as good as the best tier on %u of %u scenes\n", choice_rays(hint), good,
               count);
    }
}

static int measure_all(const struct options *options)
{
    struct results results = {.options = &options->measure};
    bool good = true;
    results.scenes = tree_need((size_t)options->name_count, sizeof *results.scenes);
    for (int i = 0; i < options->name_count && good; i++) {
        good = measure_scene(options->names[i], &options->measure, &results.scenes[i]);
        results.scene_count += good;
    }
    if (options->measure.calibrates)
        good = good && calibrate_print(&results);
    else
        good = good && report_results(&results, options->directory) && chart_results(&results, options->directory);
    if (good && !options->measure.calibrates) {
        print_floors(&results);
        print_choices(&results);
    }
    free(results.scenes);
    return good ? 0 : EXIT_FAILED;
}

static int map_stability(struct options *options)
{
    struct stability *stability = tree_need(1, sizeof *stability);
    options->cells.scenes = options->names;
    options->cells.scene_count = options->name_count;
    bool good = stability_run(&options->cells, stability) &&
                report_stability(stability, &options->cells, options->directory) &&
                chart_stability(stability, options->directory);
    uint32_t failures = stability_own_failures(stability);
    if (good)
        printf("%u methods, %u scenes; %u cells of our own are not clean\n", stability->row_count,
               stability->column_count, failures);
    free(stability);
    return !good ? EXIT_FAILED : failures > 0 ? EXIT_WRONG : 0;
}

int main(int argc, char **argv)
{
    struct options options = defaults();
    struct bvhd_error error;
    if (argc == 7 && strcmp(argv[1], "--cell") == 0)
        return cell_main(argv + 2, STDOUT_FILENO);
    if (argc == 2 && strcmp(argv[1], "--help") == 0) {
        print_usage(stdout);
        return 0;
    }
    if (!parse(argc, argv, &options)) {
        print_usage(stderr);
        return EXIT_USAGE;
    }
    if (options.directory && files_make_directory(options.directory, &error) != BVHD_OK) {
        fprintf(stderr, "bvhd-bench: %s: %s\n", options.directory, error.text);
        return EXIT_FAILED;
    }
    if (options.stability)
        return map_stability(&options);
    memory_keep(); /* The daemon calls this, too. */
    return measure_all(&options);
}
