/* SPDX-License-Identifier: Apache-2.0 */
/*
 * config.h - the daemon's options: from the command line, from a file of "name = value" lines with the same names, or
 * by default.
 */
#ifndef BVHD_CONFIG_H
#define BVHD_CONFIG_H

#include "daemon/system/log.h"
#include "daemon/service/service.h"

/* CONFIG_LEAST_DISK: the fewest bytes of a cache on disk. CONFIG_MOST_FILE: the most bytes of a file of options. */
enum { CONFIG_PATH_SIZE = 4096, CONFIG_LEAST_DISK = 1 << 20, CONFIG_MOST_FILE = 1 << 20 };

/* The purpose of the command line: to run the daemon, or only to print its help or version. */
enum config_action { CONFIG_RUN, CONFIG_HELP, CONFIG_VERSION };

struct config {
    int argc; /* these two are the command line, which must outlive the struct */
    char **argv;
    enum config_action action;
    char socket[CONFIG_PATH_SIZE];
    bool socket_given; /* false: `socket` is the default */
    char file[CONFIG_PATH_SIZE]; /* the file that --config names, or the user's; "": none */
    bool users_file; /* `file` is the user's own, by --user-config, and may be missing */
    char cache[CONFIG_PATH_SIZE]; /* the directory of the cache on disk; "": none */
    char metrics[CONFIG_PATH_SIZE]; /* the socket for monitoring; "": none */
    enum log_level log_level;
    uint64_t idle_exit_ms; /* time without connections and work after which the daemon exits; 0: it never does */
    uint64_t drain_ms; /* how long work under way may still take after SIGTERM or SIGINT */
    uint32_t max_connections; /* at least 1; further clients are refused */
    struct service_options service; /* its disk_directory is NULL; `cache` has it */
};

/*
 * Reads the command line, and the file that it names. The command line wins over the file. BVHD_INVALID names the
 * option ("--workers") or the line ("bvhd.conf:3"); BVHD_IO names a file that cannot be read. *ret_config is set only
 * on success.
 */
enum bvhd_status config_parse(int argc, char **argv, struct config *ret_config, struct bvhd_error *error);

/*
 * Reads the command line of `old` again, and the file as it is now. The errors are those of config_parse. For any
 * thread, but for one at a time.
 */
enum bvhd_status config_reload(const struct config *old, struct config *ret_config, struct bvhd_error *error);

/*
 * Returns the name of the first option that differs between the two but has its effect only at the start of a daemon,
 * or NULL if there is none.
 */
const char *config_fixed_difference(const struct config *a, const struct config *b);

/*
 * Applies the lines of one file to `config`, which stays unchanged on failure. The errors are those of config_parse.
 * The file has to be a regular one: others may never end, or keep the reader waiting.
 */
enum bvhd_status config_read_file(const char *path, struct config *config, struct bvhd_error *error);

/* Prints the options on stdout. */
void config_print_help(void);

#endif
