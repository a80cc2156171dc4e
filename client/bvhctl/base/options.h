/* SPDX-License-Identifier: Apache-2.0 */
/* options.h - the command line of bvhctl: what each command takes, parsed and checked. */
#ifndef BVHCTL_OPTIONS_H
#define BVHCTL_OPTIONS_H

#include <stdbool.h>

#include "proto/base/geometry.h"
#include "proto/base/status.h"

enum command {
    COMMAND_BUILD,
    COMMAND_CHECK,
    COMMAND_INSPECT,
    COMMAND_TRACE,
    COMMAND_GET,
    COMMAND_STATS,
    COMMAND_PING,
    COMMAND_DEVICES,
    COMMAND_PROBE,
    COMMAND_COUNT,
    COMMAND_HELP,
    COMMAND_VERSION
};

struct bvhd_format;

struct options {
    enum command command;
    enum command help_about; /* COMMAND_HELP: COMMAND_COUNT for bvhctl as a whole */
    bool json;
    bool local;
    const char *socket; /* NULL: not given */
    uint32_t connect_timeout_ms; /* not 0 */
    char **operands;
    int operand_count;

    const char *output;
    const char *depfile;
    const char *probe; /* build: a file that says what the device loads; NULL: not given */
    struct build_options build; /* the target is 0 when `probe` is to decide; the device is that of `format` */
    /* what the device loads: not parsed, but set once it is known; NULL for the portable target */
    const struct bvhd_format *format;
    uint32_t build_flags; /* BUILD_ */
    uint32_t geometry_flags; /* GEOMETRY_ */
    uint32_t threads; /* 0: one for each processor */
    uint64_t memory; /* bytes that may be in use at once */
    double rays; /* build: expected rays a primitive; check: how many to send; 0: not given */

    uint64_t seed;
    bool flip_order;
    const char *scene; /* which of a directory's scenes; NULL: the only or first one */

    const char *device;
    uint32_t width, height;
    const char *up; /* "auto", "x", "y", "z" */
};

/* BVHD_INVALID with the option in `where`. The words of argv are pointed to, and permuted. */
enum bvhd_status options_parse(int argc, char **argv, struct options *ret_options, struct bvhd_error *error);

/* Whether --json stands anywhere: needed when parsing fails. */
bool options_want_json(int argc, char *const *argv);

/* Prints the help of one command, or of bvhctl as a whole for COMMAND_COUNT, to stdout. */
void options_print_help(enum command about);

#endif
