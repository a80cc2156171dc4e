/* SPDX-License-Identifier: Apache-2.0 */
/* bvhd - the program: reads its options, then serves until it is told to end. */
#include <fcntl.h>
#include <stdio.h>
#include <unistd.h>

#include "proto/base/memory.h"
#include "daemon/server.h"

enum { EXIT_DONE = 0, EXIT_FAILED = 1, EXIT_USAGE = 2 };

/* If a standard descriptor were closed, the next socket would get its number, and a client would read the log. */
static void fill_standard_descriptors(void)
{
    for (int i = 0; i <= 2; i++)
        if (fcntl(i, F_GETFD) < 0)
            open("/dev/null", O_RDWR);
}

static int complain(const struct bvhd_error *error, int code)
{
    fprintf(stderr, "bvhd: %s: %s\n", *error->where ? error->where : "start", error->text);
    return code;
}

static int flush_output(void)
{
    return fflush(stdout) || ferror(stdout) ? EXIT_FAILED : EXIT_DONE;
}

int main(int argc, char **argv)
{
    static struct config config;
    struct bvhd_error error;
    fill_standard_descriptors();
    memory_keep();
    enum bvhd_status status = config_parse(argc, argv, &config, &error);
    if (status != BVHD_OK)
        return complain(&error, status == BVHD_INVALID ? EXIT_USAGE : EXIT_FAILED);
    if (config.action == CONFIG_HELP) {
        config_print_help();
        return flush_output();
    }
    if (config.action == CONFIG_VERSION) {
        printf("bvhd %s\n", BVHD_DAEMON_VERSION);
        return flush_output();
    }
    log_set_level(config.log_level);
    return server_run(&config, &error) != BVHD_OK ? complain(&error, EXIT_FAILED) : EXIT_DONE;
}
