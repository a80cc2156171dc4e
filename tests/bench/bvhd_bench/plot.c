/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/plot.h"

#include <errno.h>
#include <spawn.h>
#include <string.h>
#include <sys/wait.h>

extern char **environ;

void plot_text(FILE *script, const char *text)
{
    fputc('"', script);
    for (; *text; text++) {
        if (strchr("\"\\", *text))
            fputc('\\', script);
        fputc(*text, script);
    }
    fputc('"', script);
}

static void write_output(FILE *script, const struct plot *plot, const char *terminal, const char *ending)
{
    char path[4200];
    snprintf(path, sizeof path, "%s/%s.%s", plot->directory, plot->name, ending);
    fprintf(
        script,
        "reset\nset terminal %s size %u,%u font \"DejaVu Sans,11\" background rgb \"white\" noenhanced\nset output ",
        terminal, plot->width, plot->height);
    plot_text(script, path);
    fputc('\n', script);
}

static bool run_gnuplot(char *path)
{
    char name[] = "gnuplot", *arguments[] = {name, path, NULL};
    pid_t child;
    int status;
    int failure = posix_spawnp(&child, name, NULL, NULL, arguments, environ);
    if (failure == ENOENT) {
        fprintf(stderr, "bvhd-bench: no gnuplot: %s has no picture\n", path);
        return true;
    }
    if (failure != 0 || waitpid(child, &status, 0) < 0 || status != 0) {
        fprintf(stderr, "bvhd-bench: gnuplot fails on %s\n", path);
        return false;
    }
    return true;
}

bool plot_run(const struct plot *plot, void (*draw)(const void *context, FILE *script), const void *context)
{
    char path[4200];
    snprintf(path, sizeof path, "%s/%s.gp", plot->directory, plot->name);
    FILE *script = fopen(path, "w");
    if (!script) {
        fprintf(stderr, "bvhd-bench: %s: %s\n", path, strerror(errno));
        return false;
    }
    write_output(script, plot, "svg", "svg");
    draw(context, script);
    write_output(script, plot, "pngcairo", "png");
    draw(context, script);
    fprintf(script, "unset output\n");
    return fclose(script) == 0 && run_gnuplot(path);
}
