/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/builder/random_run.h"

#include <stdarg.h>
#include <stdio.h>

#include "builder/build.h"

enum { FAILURES_SHOWN = 20 };

void random_run_fail(struct random_run *run, const char *format, ...)
{
    if (run->failures++ >= FAILURES_SHOWN)
        return;
    va_list arguments;
    va_start(arguments, format);
    fprintf(stderr, "random_inputs --builder %s --kinds %s%s%s 1 %llu: ", build_builder_name(run->builder),
            random_choice_name(run->kinds), run->quality ? " --quality " : "",
            run->quality ? build_quality_name(run->quality) : "", (unsigned long long)run->seed);
    vfprintf(stderr, format, arguments);
    fprintf(stderr, "\n");
    va_end(arguments);
}
