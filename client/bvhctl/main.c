/* SPDX-License-Identifier: Apache-2.0 */
/* bvhctl: builds acceleration structures from scene files, checks them, inspects them and renders pictures of them. */
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>

#include "client/bvhctl/base/interrupt.h"
#include "client/bvhctl/commands.h"

/*
 * Opens standard descriptors that the caller has closed. Otherwise the next file that is opened would get one of them,
 * and messages would be written into that file. Descriptors for output are opened read-only, so that writing to them
 * fails as it would if they were closed.
 */
static void fill_standard_descriptors(void)
{
    for (int i = 0; i <= 2; i++)
        if (fcntl(i, F_GETFD) < 0)
            open("/dev/null", i == 0 ? O_RDWR : O_RDONLY);
}

static enum exit_code run(const struct options *options)
{
    switch (options->command) {
    case COMMAND_BUILD:
        return command_build(options);
    case COMMAND_UPDATE:
        return command_update(options);
    case COMMAND_CHECK:
        return command_check(options);
    case COMMAND_INSPECT:
        return command_inspect(options);
    case COMMAND_TRACE:
        return command_trace(options);
    case COMMAND_COPY:
        return command_copy(options);
    case COMMAND_QUERY:
        return command_query(options);
    case COMMAND_GET:
        return command_get(options);
    case COMMAND_STATS:
        return command_stats(options);
    case COMMAND_CLIENTS:
        return command_clients(options);
    case COMMAND_TOP:
        return command_top(options);
    case COMMAND_PING:
        return command_ping(options);
    case COMMAND_STOP:
        return command_stop(options);
    case COMMAND_CACHE:
        return command_cache(options);
    case COMMAND_DEVICES:
        return command_devices(options);
    case COMMAND_PROBE:
        return command_probe(options);
    case COMMAND_VERSION:
        printf("bvhctl %s\n", BVHCTL_VERSION);
        return report_flush() ? EXIT_DONE : EXIT_FAILED;
    default:
        options_print_help(options->help_about);
        return report_flush() ? EXIT_DONE : EXIT_FAILED;
    }
}

int main(int argc, char **argv)
{
    struct options options;
    struct bvhd_error error;
    fill_standard_descriptors();
    signal(SIGPIPE, SIG_IGN); /* a closed pipe is reported as an error then, and does not end the process */
    if (argc > 1 && !strcmp(argv[1], "--complete"))
        return command_complete(argc - 2, argv + 2);
    if (options_parse(argc, argv, &options, &error) != BVHD_OK) {
        report_failure(options_want_json(argc, argv), "usage", &error);
        return EXIT_USAGE;
    }
    report_set_volume((enum report_volume)options.volume);
    if (options.command < COMMAND_COUNT)
        interrupt_watch(options_command_name(options.command), options.json);
    return run(&options);
}
