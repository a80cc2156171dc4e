/* SPDX-License-Identifier: Apache-2.0 */
/*
 * options_table.h - the commands of bvhctl, their options, and the names that options take as values. Parser, help
 * texts and completion follow from these tables.
 */
#ifndef BVHCTL_OPTIONS_TABLE_H
#define BVHCTL_OPTIONS_TABLE_H

#include <stddef.h>

#include "client/bvhctl/base/options.h"

/* Sets of commands. */
enum {
    ON_BUILD = 1 << COMMAND_BUILD,
    ON_UPDATE = 1 << COMMAND_UPDATE,
    ON_CHECK = 1 << COMMAND_CHECK,
    ON_INSPECT = 1 << COMMAND_INSPECT,
    ON_TRACE = 1 << COMMAND_TRACE
};
enum { ON_COPY = 1 << COMMAND_COPY, ON_QUERY = 1 << COMMAND_QUERY };
enum { ON_GET = 1 << COMMAND_GET, ON_STATS = 1 << COMMAND_STATS, ON_PING = 1 << COMMAND_PING };
enum { ON_CLIENTS = 1 << COMMAND_CLIENTS, ON_TOP = 1 << COMMAND_TOP };
enum { ON_STOP = 1 << COMMAND_STOP, ON_DEVICES = 1 << COMMAND_DEVICES, ON_PROBE = 1 << COMMAND_PROBE };
enum { ON_CACHE = 1 << COMMAND_CACHE };
enum {
    ON_SCENES = ON_BUILD | ON_UPDATE | ON_CHECK | ON_INSPECT | ON_TRACE | ON_COPY | ON_QUERY,
    ON_QUERIES = ON_GET | ON_STATS | ON_CLIENTS | ON_TOP | ON_PING |
                 ON_STOP, /* commands that need a daemon, and never start one */
    ON_ALL = ON_SCENES | ON_QUERIES | ON_DEVICES | ON_PROBE | ON_CACHE,
    ON_SERVICE = ON_BUILD | ON_UPDATE | ON_QUERIES | ON_CACHE, /* commands that may connect to a daemon */
    ON_ALONE =
        ON_CHECK | ON_INSPECT | ON_TRACE | ON_COPY | ON_QUERY | ON_DEVICES | ON_PROBE, /* commands that never do */
    ON_OUTPUT = ON_BUILD | ON_TRACE | ON_GET | ON_PROBE,
    ON_MAIN = 1 << COMMAND_COUNT,
};

/* getopt's values of the options that have no letter. */
enum {
    OPTION_JSON = 256,
    OPTION_LOCAL,
    OPTION_SOCKET,
    OPTION_CONNECT_TIMEOUT,
    OPTION_COMPACT,
    OPTION_ALL,
    OPTION_COUNT,
    OPTION_INTERVAL,
    OPTION_DEPFILE,
    OPTION_TARGET,
    OPTION_PROBE,
    OPTION_QUALITY,
    OPTION_BUILDER,
    OPTION_FLAGS,
    OPTION_LAYOUT,
    OPTION_GEOMETRY_FLAGS,
    OPTION_RAYS,
    OPTION_DEADLINE,
    OPTION_THREADS,
    OPTION_MEMORY,
    OPTION_CACHE,
    OPTION_NO_CACHE,
    OPTION_DISK_CACHE_SIZE,
    OPTION_TIME,
    OPTION_SEED,
    OPTION_FLIP_ORDER,
    OPTION_SCENE,
    OPTION_AT,
    OPTION_ANIMATION,
    OPTION_SHUTTER,
    OPTION_POINTS,
    OPTION_LINES,
    OPTION_FRAMES,
    OPTION_DECAY,
    OPTION_DEVICE,
    OPTION_SIZE,
    OPTION_UP,
    OPTION_EYE,
    OPTION_LOOK_AT,
    OPTION_FOV,
    OPTION_TURN,
    OPTION_SAMPLES,
    OPTION_TIMES,
    OPTION_VERSION,
};

struct option_row {
    const char *name;
    int value;
    const char *argument; /* its name in the help; NULL: the option takes none */
    unsigned commands;
    const char *help; /* without line breaks */
};

enum { OPTION_ROWS_MOST = 72 };

/* An option whose meaning depends on the command has several rows. Ends with a row whose name is NULL. */
extern const struct option_row option_rows[];

struct command_row {
    const char *name;
    const char *arguments;
    const char *purpose;
    int fewest, most; /* numbers of operands that are allowed */
};

extern const struct command_row command_rows[COMMAND_COUNT];

struct name_value {
    const char *name;
    uint32_t value;
};

/* They end with a name that is NULL. */
extern const struct name_value build_flag_names[], geometry_flag_names[], layout_flag_names[], quality_names[],
    builder_names[], target_names[], axis_names[], cache_action_names[];

/* The names of --device besides those of devices. The first is for pictures only. */
extern const struct name_value device_names[];

#endif
