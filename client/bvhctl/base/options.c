/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/options.h"

#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "proto/base/number.h"

enum {
    ON_BUILD = 1 << COMMAND_BUILD,
    ON_CHECK = 1 << COMMAND_CHECK,
    ON_INSPECT = 1 << COMMAND_INSPECT,
    ON_TRACE = 1 << COMMAND_TRACE
};
enum { ON_GET = 1 << COMMAND_GET, ON_STATS = 1 << COMMAND_STATS, ON_PING = 1 << COMMAND_PING };
enum { ON_DEVICES = 1 << COMMAND_DEVICES, ON_PROBE = 1 << COMMAND_PROBE };
enum {
    ON_SCENES = ON_BUILD | ON_CHECK | ON_INSPECT | ON_TRACE,
    ON_ALL = ON_SCENES | ON_GET | ON_STATS | ON_PING | ON_DEVICES | ON_PROBE,
    ON_SERVICE = ON_BUILD | ON_GET | ON_STATS | ON_PING, /* commands that may connect to a daemon */
    ON_ALONE = ON_CHECK | ON_INSPECT | ON_TRACE | ON_DEVICES | ON_PROBE, /* commands that never do */
    ON_OUTPUT = ON_BUILD | ON_TRACE | ON_GET | ON_PROBE,
    ON_MAIN = 1 << COMMAND_COUNT,
};

/* getopt's values of the options that have no letter. */
enum {
    OPTION_JSON = 256,
    OPTION_LOCAL,
    OPTION_SOCKET,
    OPTION_CONNECT_TIMEOUT,
    OPTION_DEPFILE,
    OPTION_TARGET,
    OPTION_PROBE,
    OPTION_QUALITY,
    OPTION_FLAGS,
    OPTION_LAYOUT,
    OPTION_GEOMETRY_FLAGS,
    OPTION_RAYS,
    OPTION_THREADS,
    OPTION_MEMORY,
    OPTION_SEED,
    OPTION_FLIP_ORDER,
    OPTION_SCENE,
    OPTION_DEVICE,
    OPTION_SIZE,
    OPTION_UP,
    OPTION_VERSION,
};

struct option_row {
    const char *name;
    int value;
    const char *argument; /* its name in the help; NULL: the option takes none */
    unsigned commands;
    const char *help;
};

static const struct option_row option_rows[] = {
    {"output", 'o', "PATH", ON_BUILD, "the directory for manifest.json and one .as file for each structure"},
    {"output", 'o', "PNG", ON_TRACE, "the picture to write"},
    {"output", 'o', "FILE", ON_GET, "the file to write"},
    {"output", 'o', "FILE", ON_PROBE, "the file to write, for 'bvhctl build --probe'"},
    {"depfile", OPTION_DEPFILE, "FILE", ON_BUILD,
     "also write a make rule for manifest.json, with the files that the scenes were\nread from"},
    {"target", OPTION_TARGET, "NAME", ON_BUILD,
     "portable (default): for shaders on any device; lavapipe: for ray queries of that\ndriver, in the version of this "
     "machine or in that of --probe"},
    {"probe", OPTION_PROBE, "FILE", ON_BUILD,
     "a file of 'bvhctl probe': build for the device that it describes; without\n--target, for the target that this "
     "device loads"},
    {"quality", OPTION_QUALITY, "NAME", ON_BUILD, "fast, balanced, high or auto (default: by --flags, else auto)"},
    {"flags", OPTION_FLAGS, "LIST", ON_BUILD,
     "allow-update, allow-compaction, prefer-fast-trace, prefer-fast-build,\nlow-memory, allow-data-access; separated "
     "by commas"},
    {"layout", OPTION_LAYOUT, "LIST", ON_BUILD,
     "fast-triangles: three float4 for each triangle, larger but faster to trace"},
    {"geometry-flags", OPTION_GEOMETRY_FLAGS, "LIST", ON_BUILD, "opaque (default), no-duplicate-any-hit, none"},
    {"rays", OPTION_RAYS, "N", ON_BUILD,
     "expected rays for each primitive, by which the quality auto chooses; without it,\nauto is balanced"},
    {"rays", OPTION_RAYS, "N", ON_CHECK, "number of rays to trace (default 4000)"},
    {"seed", OPTION_SEED, "S", ON_CHECK, "seed of the random rays (default 1)"},
    {"flip-order", OPTION_FLIP_ORDER, NULL, ON_CHECK,
     "visit children in the opposite order; the answers must be the same"},
    {"scene", OPTION_SCENE, "NAME|NUMBER", ON_BUILD,
     "build one scene of glTF files, by its name or its number from 0 (default: all\nscenes, as one)"},
    {"scene", OPTION_SCENE, "NAME|NUMBER", ON_CHECK | ON_TRACE,
     "scene in the directory, by its name or by what build --scene chose (default:\n"
     "check: that of the file; trace: the first)"},
    {"device", OPTION_DEVICE, "NAME", ON_TRACE,
     "cpu, a Vulkan device's number or a part of its name, or auto: a GPU that loads\nthe structures, else cpu"},
    {"device", OPTION_DEVICE, "NAME", ON_PROBE,
     "its number or a part of its name, as 'bvhctl devices' prints them, or auto\n(default): the first of them"},
    {"size", OPTION_SIZE, "WxH", ON_TRACE, "width and height of the picture (default 1280x720)"},
    {"up", OPTION_UP, "AXIS", ON_TRACE, "the axis that points up: x, y, z or auto (default)"},
    {"threads", OPTION_THREADS, "N", ON_BUILD | ON_CHECK | ON_TRACE,
     "number of threads of this process (default: one for each processor); a daemon\nhas its own"},
    {"memory", OPTION_MEMORY, "BYTES", ON_SCENES,
     "limit for geometry and results, beyond which the command fails; K, M, G may\nfollow the number"},
    {"json", OPTION_JSON, NULL, ON_ALL | ON_MAIN, "print the result as one JSON object"},
    {"local", OPTION_LOCAL, NULL, ON_BUILD | ON_MAIN, "build in this process, without a daemon"},
    {"socket", OPTION_SOCKET, "PATH", ON_SERVICE | ON_MAIN,
     "the daemon's socket (default: $BVHD_SOCKET; without it that of a running daemon;\nif there is none, a private "
     "daemon is started)"},
    {"local", OPTION_LOCAL, NULL, ON_ALONE, "has no effect: this command never uses a daemon"},
    {"socket", OPTION_SOCKET, "PATH", ON_ALONE, "has no effect: this command never uses a daemon"},
    {"connect-timeout", OPTION_CONNECT_TIMEOUT, "SEC", ON_SERVICE | ON_MAIN,
     "seconds to wait for a daemon (default 5)"},
    {"help", 'h', NULL, ON_ALL | ON_MAIN, "print this help"},
    {"version", OPTION_VERSION, NULL, ON_MAIN, "print the version"},
};
enum { OPTION_ROWS = sizeof option_rows / sizeof *option_rows };

struct command_row {
    const char *name;
    const char *arguments;
    const char *purpose;
    int fewest, most; /* numbers of operands that are allowed */
};

static const struct command_row command_rows[COMMAND_COUNT] = {
    [COMMAND_BUILD] = {"build", "SCENE... -o DIR", "build acceleration structures from scene files", 1, 1 << 20},
    [COMMAND_CHECK] = {"check", "DIR SCENE", "check built files against brute force over their scene", 2, 2},
    [COMMAND_INSPECT] = {"inspect", "PATH", "describe a built file or a probe, or all files of a directory", 1, 1},
    [COMMAND_TRACE] = {"trace", "DIR --device NAME -o PNG", "render a picture of built structures", 1, 1},
    [COMMAND_GET] = {"get", "KEY -o FILE", "fetch a structure from the daemon, by its key", 1, 1},
    [COMMAND_STATS] = {"stats", "", "print the daemon's counters", 0, 0},
    [COMMAND_PING] = {"ping", "", "ask whether a daemon answers", 0, 0},
    [COMMAND_DEVICES] = {"devices", "", "list the Vulkan devices of this machine, and what they load", 0, 0},
    [COMMAND_PROBE] = {"probe", "--device NAME -o FILE",
                       "find out what a device loads, for builds on machines without it", 0, 0},
};

struct name_value {
    const char *name;
    uint32_t value;
};

static const struct name_value build_flag_names[] = {
    {"allow-update", BUILD_ALLOW_UPDATE},
    {"allow-compaction", BUILD_ALLOW_COMPACTION},
    {"prefer-fast-trace", BUILD_PREFER_FAST_TRACE},
    {"prefer-fast-build", BUILD_PREFER_FAST_BUILD},
    {"low-memory", BUILD_LOW_MEMORY},
    {"allow-data-access", BUILD_ALLOW_DATA_ACCESS},
    {NULL, 0},
};

static const struct name_value geometry_flag_names[] = {
    {"opaque", GEOMETRY_OPAQUE},
    {"no-duplicate-any-hit", GEOMETRY_NO_DUPLICATE_ANY_HIT},
    {"none", 0},
    {NULL, 0},
};

static const struct name_value layout_flag_names[] = {
    {"fast-triangles", PORTABLE_FAST_TRIANGLES},
    {NULL, 0},
};

static const struct name_value quality_names[] = {
    {"fast", QUALITY_FAST}, {"balanced", QUALITY_BALANCED}, {"high", QUALITY_HIGH}, {"auto", QUALITY_AUTO}, {NULL, 0},
};

static const struct name_value target_names[] = {
    {"portable", TARGET_PORTABLE},
    {"lavapipe", TARGET_LAVAPIPE},
    {NULL, 0},
};

bool options_want_json(int argc, char *const *argv)
{
    for (int i = 1; i < argc && strcmp(argv[i], "--"); i++)
        if (!strcmp(argv[i], "--json"))
            return true;
    return false;
}

static enum bvhd_status usage(struct bvhd_error *error, const char *where, const char *text, const char *subject)
{
    return bvhd_error_set(error, BVHD_INVALID, where, text, subject);
}

static const struct name_value *find_name(const struct name_value *names, const char *text, size_t length)
{
    for (; names->name; names++)
        if (strlen(names->name) == length && !memcmp(names->name, text, length))
            return names;
    return NULL;
}

/* The error lists all names that are allowed. */
static enum bvhd_status no_such_name(struct bvhd_error *error, const char *where, const struct name_value *names,
                                     const char *text, size_t length)
{
    char choices[128] = "";
    for (size_t used = 0; names->name && used < sizeof choices; names++)
        used += (size_t)snprintf(choices + used, sizeof choices - used, "%s%s", used ? ", " : "", names->name);
    return bvhd_error_set(error, BVHD_INVALID, where, "'%.*s' is none of: %s", length < 32 ? (int)length : 32, text,
                          choices);
}

static enum bvhd_status parse_name(const char *where, const struct name_value *names, const char *text,
                                   uint32_t *ret_value, struct bvhd_error *error)
{
    const struct name_value *found = find_name(names, text, strlen(text));
    if (!found)
        return no_such_name(error, where, names, text, strlen(text));
    *ret_value = found->value;
    return BVHD_OK;
}

static enum bvhd_status parse_list(const char *where, const struct name_value *names, const char *text,
                                   uint32_t *ret_value, struct bvhd_error *error)
{
    uint32_t value = 0;
    for (const char *at = text; *at;) {
        size_t length = strcspn(at, ",");
        const struct name_value *found = find_name(names, at, length);
        if (!found)
            return no_such_name(error, where, names, at, length);
        value |= found->value;
        at += length + (at[length] == ',');
    }
    *ret_value = value;
    return BVHD_OK;
}

static enum bvhd_status parse_rays(const struct options *options, const char *text, double *ret_rays,
                                   struct bvhd_error *error)
{
    if (options->command == COMMAND_CHECK) {
        uint64_t count;
        enum bvhd_status status =
            number_read("--rays", text, (struct number_range){1, 100000000, false}, &count, error);
        if (!status)
            *ret_rays = (double)count;
        return status;
    }
    char *end;
    double rays = strtod(text, &end);
    if (end == text || *end || !isfinite((float)rays) || (float)rays <= 0)
        return usage(error, "--rays", "not a positive number: '%s'", text);
    *ret_rays = rays;
    return BVHD_OK;
}

enum { MOST_SECONDS = 86400 };

static enum bvhd_status parse_timeout(const char *text, uint32_t *ret_ms, struct bvhd_error *error)
{
    char *end;
    double seconds = strtod(text, &end);
    if (end == text || *end || !(seconds >= 0 && seconds <= MOST_SECONDS))
        return bvhd_error_set(error, BVHD_INVALID, "--connect-timeout", "not 0 to %d seconds: '%s'", MOST_SECONDS,
                              text);
    uint32_t ms = (uint32_t)(seconds * 1000);
    *ret_ms = ms ? ms : 1;
    return BVHD_OK;
}

enum { LARGEST_SIDE = 16384 };

static enum bvhd_status parse_size(const char *text, struct options *options, struct bvhd_error *error)
{
    unsigned width, height;
    int end = 0;
    if (sscanf(text, "%5ux%5u%n", &width, &height, &end) != 2 || text[end] || text[0] == '-')
        return usage(error, "--size", "not of the form WxH: '%s'", text);
    if (width < 1 || height < 1 || width > LARGEST_SIDE || height > LARGEST_SIDE)
        return bvhd_error_set(error, BVHD_INVALID, "--size", "sides are 1 to %d pixels: '%s'", LARGEST_SIDE, text);
    options->width = width;
    options->height = height;
    return BVHD_OK;
}

static enum bvhd_status parse_up(const char *text, const char **ret_up, struct bvhd_error *error)
{
    if (strcmp(text, "x") && strcmp(text, "y") && strcmp(text, "z") && strcmp(text, "auto"))
        return usage(error, "--up", "not an axis: '%s'", text);
    *ret_up = text;
    return BVHD_OK;
}

static enum bvhd_status parse_build_choice(int value, const char *text, struct options *options,
                                           struct bvhd_error *error)
{
    uint32_t number = 0;
    enum bvhd_status status;
    if (value == OPTION_TARGET) {
        status = parse_name("--target", target_names, text, &number, error);
        options->build.target = status ? options->build.target : (enum target)number;
    } else {
        status = parse_name("--quality", quality_names, text, &number, error);
        options->build.quality = status ? options->build.quality : (enum build_quality)number;
    }
    return status;
}

static enum bvhd_status apply_text(int value, const char *text, struct options *options)
{
    switch (value) {
    case 'o':
        options->output = text;
        break;
    case OPTION_DEPFILE:
        options->depfile = text;
        break;
    case OPTION_PROBE:
        options->probe = text;
        break;
    case OPTION_SOCKET:
        options->socket = text;
        break;
    case OPTION_SCENE:
        options->scene = text;
        break;
    case OPTION_DEVICE:
        options->device = text;
        break;
    case OPTION_JSON:
        options->json = true;
        break;
    case OPTION_LOCAL:
        options->local = true;
        break;
    case OPTION_FLIP_ORDER:
        options->flip_order = true;
        break;
    default:
        return BVHD_UNSUPPORTED;
    }
    return BVHD_OK;
}

static enum bvhd_status apply(int value, const char *text, struct options *options, struct bvhd_error *error)
{
    switch (value) {
    case OPTION_TARGET:
    case OPTION_QUALITY:
        return parse_build_choice(value, text, options, error);
    case OPTION_FLAGS:
        return parse_list("--flags", build_flag_names, text, &options->build_flags, error);
    case OPTION_LAYOUT:
        return parse_list("--layout", layout_flag_names, text, &options->build.layout_flags, error);
    case OPTION_GEOMETRY_FLAGS:
        return parse_list("--geometry-flags", geometry_flag_names, text, &options->geometry_flags, error);
    case OPTION_RAYS:
        return parse_rays(options, text, &options->rays, error);
    case OPTION_THREADS:
        return number_read32("--threads", text, (struct number_range){1, 1024, false}, &options->threads, error);
    case OPTION_MEMORY:
        return number_read("--memory", text, (struct number_range){1, UINT64_MAX, true}, &options->memory, error);
    case OPTION_SEED:
        return number_read("--seed", text, (struct number_range){0, UINT64_MAX, false}, &options->seed, error);
    case OPTION_CONNECT_TIMEOUT:
        return parse_timeout(text, &options->connect_timeout_ms, error);
    case OPTION_SIZE:
        return parse_size(text, options, error);
    case OPTION_UP:
        return parse_up(text, &options->up, error);
    default:
        return apply_text(value, text, options);
    }
}

/* Fills getopt's table with the options of `commands`. */
static void fill_tables(unsigned commands, struct option table[OPTION_ROWS + 1])
{
    size_t count = 0;
    for (size_t i = 0; i < OPTION_ROWS; i++) {
        const struct option_row *row = &option_rows[i];
        if (row->commands & commands)
            table[count++] =
                (struct option){row->name, row->argument ? required_argument : no_argument, NULL, row->value};
    }
    table[count] = (struct option){NULL, 0, NULL, 0};
}

static enum bvhd_status parse_options(int argc, char **argv, unsigned commands, struct options *options,
                                      struct bvhd_error *error)
{
    struct option table[OPTION_ROWS + 1];
    fill_tables(commands, table);
    const char *letters = commands == ON_MAIN ? "+:h" : commands & ON_OUTPUT ? ":ho:" : ":h";
    opterr = 0;
    for (;;) {
        int before = optind, value = getopt_long(argc, argv, letters, table, NULL);
        const char *word = before < argc ? argv[before] : "";
        if (value == -1)
            return BVHD_OK;
        if (value == ':')
            return usage(error, argv[optind - 1], "needs a value", "");
        if (value == '?')
            return usage(error, optind > before ? argv[optind - 1] : word,
                         "not an option of this command, or an ambiguous abbreviation", "");
        if (value == 'h' || value == OPTION_VERSION) {
            options->help_about = options->command;
            options->command = value == 'h' ? COMMAND_HELP : COMMAND_VERSION;
            return BVHD_OK;
        }
        enum bvhd_status status = apply(value, optarg, options, error);
        if (status)
            return status;
    }
}

static enum bvhd_status find_command(const char *word, enum command *ret_command, struct bvhd_error *error)
{
    for (int i = 0; i < COMMAND_COUNT; i++)
        if (!strcmp(word, command_rows[i].name)) {
            *ret_command = (enum command)i;
            return BVHD_OK;
        }
    return usage(error, word, "not a command; see bvhctl --help", "");
}

/* Checks the options about the target. Without --target it stays 0 if a probe decides it, and is portable otherwise. */
static enum bvhd_status complete_target(struct options *options, struct bvhd_error *error)
{
    bool is_portable = options->build.target == TARGET_PORTABLE;
    if (options->probe && !*options->probe)
        return usage(error, "--probe", "an empty name", "");
    if (options->probe && is_portable)
        return usage(error, "--probe", "makes no sense together with --target portable", "");
    if (!options->probe && !options->build.target)
        options->build.target = TARGET_PORTABLE;
    if (options->build.layout_flags && options->build.target != TARGET_PORTABLE)
        return usage(error, "--layout", "only the portable target has this option", "");
    return BVHD_OK;
}

static enum bvhd_status check_complete(const struct options *options, struct bvhd_error *error)
{
    const struct command_row *row = &command_rows[options->command];
    unsigned command = 1u << options->command;
    bool needs_output = command & ON_OUTPUT;
    if (options->local && options->socket)
        return usage(error, "--socket", "makes no sense together with --local", "");
    if (options->socket && !*options->socket)
        return usage(error, "--socket", "an empty name", "");
    if (options->local && (command & ON_SERVICE) && !(command & ON_BUILD))
        return usage(error, "--local", "%s needs a daemon", row->name);
    if (options->operand_count < row->fewest)
        return usage(error, row->name, "wants: %s", row->arguments);
    if (options->operand_count > row->most)
        return usage(error, options->operands[row->most],
                     *row->arguments ? "one word too many; expected: %s" : "one word too many", row->arguments);
    if (needs_output && !options->output)
        return usage(error, row->name, "wants -o: %s", row->arguments);
    if (needs_output && !*options->output)
        return usage(error, "-o", "an empty name", "");
    if (options->command == COMMAND_TRACE && !options->device)
        return usage(error, row->name, "wants --device: %s", "a device's name, cpu or auto");
    if (options->device && !*options->device)
        return usage(error, "--device", "an empty name", "");
    return BVHD_OK;
}

enum bvhd_status options_parse(int argc, char **argv, struct options *ret_options, struct bvhd_error *error)
{
    struct options options = {
        .command = COMMAND_COUNT,
        .build = {.quality = QUALITY_UNSPECIFIED},
        .geometry_flags = GEOMETRY_OPAQUE,
        .memory = UINT64_MAX,
        .connect_timeout_ms = 5000,
        .seed = 1,
        .width = 1280,
        .height = 720,
        .up = "auto",
    };
    optind = 0; /* makes glibc's getopt start again, even in a second call of this function */
    enum bvhd_status status = parse_options(argc, argv, ON_MAIN, &options, error);
    if (!status && options.command == COMMAND_COUNT) {
        if (optind >= argc)
            return usage(error, "bvhctl", "no command; see bvhctl --help", "");
        int first = optind;
        status = find_command(argv[first], &options.command, error);
        if (status)
            return status;
        optind = 0;
        status = parse_options(argc - first, argv + first, 1u << options.command, &options, error);
        options.operands = argv + first + optind;
        options.operand_count = argc - first - optind;
        if (!status && options.command < COMMAND_COUNT)
            status = check_complete(&options, error);
        if (!status && options.command < COMMAND_COUNT)
            status = complete_target(&options, error);
    }
    if (!status)
        *ret_options = options;
    return status;
}

static void print_option(const struct option_row *row)
{
    char name[64];
    snprintf(name, sizeof name, "%s--%s%s%s",
             row->value == 'o'   ? "-o, "
             : row->value == 'h' ? "-h, "
                                 : "    ",
             row->name, row->argument ? " " : "", row->argument ? row->argument : "");
    const char *text = row->help;
    for (const char *label = name; text; label = "") {
        size_t length = strcspn(text, "\n");
        printf("  %-26s  %.*s\n", label, (int)length, text);
        text = text[length] ? text + length + 1 : NULL;
    }
}

static void print_options(unsigned commands)
{
    printf("\nOptions:\n");
    for (size_t i = 0; i < OPTION_ROWS; i++)
        if (option_rows[i].commands & commands)
            print_option(&option_rows[i]);
}

void options_print_help(enum command about)
{
    if (about < COMMAND_COUNT) {
        const struct command_row *row = &command_rows[about];
        printf("Usage: bvhctl [--socket PATH%s] %s%s%s [OPTION...]\n\nWhat it does: %s.\n",
               1u << about & ON_SCENES ? " | --local" : "", row->name, *row->arguments ? " " : "", row->arguments,
               row->purpose);
        print_options(1u << about);
        return;
    }
    printf("Usage: bvhctl [--socket PATH | --local] COMMAND ...\n\n"
           "Builds Vulkan acceleration structures on the CPU, and inspects the results.\n\nCommands:\n");
    for (int i = 0; i < COMMAND_COUNT; i++)
        printf("  %-8s %-23s  %s\n", command_rows[i].name, command_rows[i].arguments, command_rows[i].purpose);
    print_options(ON_MAIN);
    printf("\nbvhctl COMMAND --help says more about a command.\n"
           "Exit status: 0 done, 1 failed, 2 wrong usage, 3 something wrong was found, 4 no daemon.\n");
}
