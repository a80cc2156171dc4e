/* SPDX-License-Identifier: Apache-2.0 */
/* options.h - parses and checks the command line of bvhctl, and prints the help texts. */
#ifndef BVHCTL_OPTIONS_H
#define BVHCTL_OPTIONS_H

#include <stdbool.h>

#include "client/bvhctl/base/options_view.h"
#include "proto/base/geometry.h"
#include "proto/base/status.h"

enum command {
    COMMAND_BUILD,
    COMMAND_UPDATE,
    COMMAND_CHECK,
    COMMAND_INSPECT,
    COMMAND_TRACE,
    COMMAND_COPY,
    COMMAND_QUERY,
    COMMAND_GET,
    COMMAND_STATS,
    COMMAND_CLIENTS,
    COMMAND_TOP,
    COMMAND_PING,
    COMMAND_STOP,
    COMMAND_CACHE,
    COMMAND_DEVICES,
    COMMAND_PROBE,
    COMMAND_COUNT,
    COMMAND_HELP,
    COMMAND_VERSION
};

/* What `bvhctl cache` does. */
enum cache_action { CACHE_SHOW, CACHE_TRIM, CACHE_CLEAR };

struct bvhd_format;

/*
 * The parsed command line. Most fields are named after their option, which docs/cli.md describes. Texts belong to argv.
 */
struct options {
    enum command command;
    enum command help_about; /* of COMMAND_HELP: the command, or COMMAND_COUNT for bvhctl as a whole */
    bool json;
    int volume; /* enum report_volume */
    bool local;
    const char *socket; /* NULL: not given */
    uint32_t connect_timeout_ms; /* not 0 */
    char **operands; /* the words after the command that are no options: scenes, files, a key */
    int operand_count;

    const char *output; /* of an update NULL: where it was built */
    const char *depfile;
    const char *probe; /* build, query: the file with the probe of the device that is meant; NULL: not given */
    struct build_options build; /* `target` is 0 when the probe decides it; `device` is unused, see `format` */
    /*
     * the format that the device loads; NULL for the portable target. Not parsed: `bvhctl build` sets it after it has
     * read the probe
     */
    const struct bvhd_format *format;
    uint32_t build_flags; /* BUILD_ */
    uint32_t geometry_flags; /* GEOMETRY_ */
    uint32_t threads; /* 0: one for each processor */
    uint64_t memory; /* budget in bytes */
    double rays; /* build: expected rays a primitive; check: number of rays to trace; 0: not given */
    double seconds; /* check: limit of time; 0: not given */
    uint32_t deadline_ms; /* build; 0: not given */

    bool compact; /* copy */
    bool all; /* clients: refuse rather than leave out what this user may not see */
    uint32_t count; /* top: how often to look; 0: until it is interrupted */
    double interval; /* top: seconds between two looks */

    const char *cache; /* the directory of the cache on disk; NULL: not given */
    bool no_cache;
    uint64_t disk_cache_size; /* bytes */
    enum cache_action cache_action;

    uint64_t seed;
    bool flip_order;
    bool has_moment; /* a scene is read at a moment of an animation: */
    double moment; /* in seconds */
    bool has_shutter; /* or over a shutter interval: */
    double shutter[2]; /* its beginning and its end, in seconds */
    bool has_frames; /* update: at several moments: */
    double frames[3]; /* the first, the last, and the seconds from one to the next */
    double most_decay; /* update; 0: not given */
    const char *animation; /* its name or number; NULL: not given */
    float point_radius, line_radius; /* build: of --points and --lines; 0: not given */
    const char *scene; /* name or number of a scene in its file, or name of one in the directory; NULL: not given */

    const char *device; /* "cpu", "auto", a number or a part of a name; NULL: not given */
    uint32_t width, height; /* of the picture, in pixels */
    const char *up; /* "auto", "x", "y", "z" */
    struct view_options view;
};

/*
 * Parses the command line. BVHD_INVALID with the option in `where`. *ret_options points into argv, whose words are
 * permuted, so that argv must outlive it.
 */
enum bvhd_status options_parse(int argc, char **argv, struct options *ret_options, struct bvhd_error *error);

/* Returns whether --json is among the words: errors of options_parse are printed as JSON then. */
bool options_want_json(int argc, char *const *argv);

/* Returns the name of a command. `command` is below COMMAND_COUNT. */
const char *options_command_name(enum command command);

/* Prints to stdout the help of one command, or, for COMMAND_COUNT, that of bvhctl as a whole. */
void options_print_help(enum command about);

#endif
