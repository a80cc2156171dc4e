/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/options.h"

#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/bvhctl/base/options_table.h"
#include "client/bvhctl/base/report.h"
#include "proto/base/number.h"

bool options_want_json(int argc, char *const *argv)
{
    for (int i = 1; i < argc && strcmp(argv[i], "--"); i++)
        if (!strcmp(argv[i], "--json"))
            return true;
    return false;
}

const char *options_command_name(enum command command)
{
    return command_rows[command].name;
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

static enum bvhd_status parse_radius(const char *option, const char *text, float *ret_radius, struct bvhd_error *error)
{
    char *end;
    float radius = strtof(text, &end);
    if (end == text || *end || !isfinite(radius) || !(radius > 0))
        return usage(error, option, "not a positive number: '%s'", text);
    *ret_radius = radius;
    return BVHD_OK;
}

enum { MOST_SECONDS = 86400 };

static enum bvhd_status parse_seconds(const char *option, const char *text, double *ret_seconds,
                                      struct bvhd_error *error)
{
    char *end;
    double seconds = strtod(text, &end);
    if (end == text || *end || !(seconds >= 0 && seconds <= MOST_SECONDS))
        return bvhd_error_set(error, BVHD_INVALID, option, "not 0 to %d seconds: '%s'", MOST_SECONDS, text);
    *ret_seconds = seconds;
    return BVHD_OK;
}

static enum bvhd_status parse_timeout(const char *text, uint32_t *ret_ms, struct bvhd_error *error)
{
    double seconds = 0;
    enum bvhd_status status = parse_seconds("--connect-timeout", text, &seconds, error);
    if (status != BVHD_OK)
        return status;
    uint32_t ms = (uint32_t)(seconds * 1000);
    *ret_ms = ms ? ms : 1;
    return BVHD_OK;
}

static enum bvhd_status parse_time(const char *text, double *ret_seconds, struct bvhd_error *error)
{
    double seconds = 0;
    enum bvhd_status status = parse_seconds("--time", text, &seconds, error);
    if (status == BVHD_OK && seconds == 0)
        status = usage(error, "--time", "nothing can be judged in no time", "");
    if (status == BVHD_OK)
        *ret_seconds = seconds;
    return status;
}

enum { MOST_FRAMES = 1000000 };

static enum bvhd_status parse_moment(const char *text, struct options *options, struct bvhd_error *error)
{
    char *end;
    double moment = strtod(text, &end);
    if (end == text || *end || !isfinite(moment))
        return usage(error, "--at", "not a number of seconds: '%s'", text);
    options->moment = moment;
    options->has_moment = true;
    return BVHD_OK;
}

static enum bvhd_status parse_shutter(const char *text, struct options *options, struct bvhd_error *error)
{
    double *times = options->shutter;
    int end = 0;
    if (sscanf(text, "%lf:%lf%n", &times[0], &times[1], &end) != 2 || text[end])
        return usage(error, "--shutter", "not of the form T0:T1: '%s'", text);
    if (!isfinite(times[0]) || !isfinite(times[1] - times[0]) || !(times[1] > times[0]))
        return usage(error, "--shutter", "T1 is after T0: '%s'", text);
    options->has_shutter = true;
    return BVHD_OK;
}

static enum bvhd_status parse_frames(const char *text, struct options *options, struct bvhd_error *error)
{
    double *frames = options->frames;
    int end = 0;
    if (sscanf(text, "%lf:%lf:%lf%n", &frames[0], &frames[1], &frames[2], &end) != 3 || text[end])
        return usage(error, "--frames", "not of the form A:B:STEP: '%s'", text);
    if (!isfinite(frames[0]) || !(frames[1] >= frames[0]) || !(frames[2] > 0) ||
        !((frames[1] - frames[0]) / frames[2] < MOST_FRAMES))
        return usage(error, "--frames", "B is not before A, STEP is positive, and there are at most a million: '%s'",
                     text);
    options->has_frames = true;
    return BVHD_OK;
}

static enum bvhd_status parse_decay(const char *text, double *ret_decay, struct bvhd_error *error)
{
    char *end;
    double decay = strtod(text, &end);
    if (end == text || *end || !(decay > 0))
        return usage(error, "--decay", "not a positive number: '%s'", text);
    *ret_decay = decay;
    return BVHD_OK;
}

/* A daemon that is asked all the time would have little else to do. */
static const double least_interval = 0.05;

static enum bvhd_status parse_interval(const char *text, double *ret_seconds, struct bvhd_error *error)
{
    double seconds = 0;
    enum bvhd_status status = parse_seconds("--interval", text, &seconds, error);
    if (status == BVHD_OK && seconds < least_interval)
        status = bvhd_error_set(error, BVHD_INVALID, "--interval", "at least %g seconds: '%s'", least_interval, text);
    if (status == BVHD_OK)
        *ret_seconds = seconds;
    return status;
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
    uint32_t ignored;
    enum bvhd_status status = parse_name("--up", axis_names, text, &ignored, error);
    if (status != BVHD_OK)
        return status;
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
    } else if (value == OPTION_BUILDER) {
        status = parse_name("--builder", builder_names, text, &number, error);
        options->build.builder = (enum build_builder)number; /* own, if the name is unknown */
    } else {
        status = parse_name("--quality", quality_names, text, &number, error);
        options->build.quality = status ? options->build.quality : (enum build_quality)number;
    }
    return status;
}

static enum bvhd_status apply_view(int value, const char *text, struct view_options *view, struct bvhd_error *error)
{
    switch (value) {
    case OPTION_EYE:
        return options_view_eye(text, view, error);
    case OPTION_LOOK_AT:
        return options_view_look_at(text, view, error);
    case OPTION_FOV:
        return options_view_fov(text, view, error);
    case OPTION_SAMPLES:
        return options_view_samples(text, view, error);
    case OPTION_TIMES:
        return options_view_times(text, view, error);
    default:
        return options_view_turn(text, view, error);
    }
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
    case OPTION_ANIMATION:
        options->animation = text;
        break;
    case OPTION_DEVICE:
        options->device = text;
        break;
    case OPTION_CACHE:
        options->cache = text;
        break;
    case OPTION_NO_CACHE:
        options->no_cache = true;
        break;
    case 'q':
        options->volume = REPORT_ERRORS;
        break;
    case 'v':
        options->volume = REPORT_ALL;
        break;
    case OPTION_JSON:
        options->json = true;
        break;
    case OPTION_LOCAL:
        options->local = true;
        break;
    case OPTION_ALL:
        options->all = true;
        break;
    case OPTION_COMPACT:
        options->compact = true;
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
    case OPTION_BUILDER:
        return parse_build_choice(value, text, options, error);
    case OPTION_FLAGS:
        return parse_list("--flags", build_flag_names, text, &options->build_flags, error);
    case OPTION_LAYOUT:
        return parse_list("--layout", layout_flag_names, text, &options->build.layout_flags, error);
    case OPTION_GEOMETRY_FLAGS:
        return parse_list("--geometry-flags", geometry_flag_names, text, &options->geometry_flags, error);
    case OPTION_RAYS:
        return parse_rays(options, text, &options->rays, error);
    case OPTION_DEADLINE:
        return number_read32("--deadline", text, (struct number_range){1, UINT32_MAX, false}, &options->deadline_ms,
                             error);
    case OPTION_THREADS:
        return number_read32("--threads", text, (struct number_range){1, 1024, false}, &options->threads, error);
    case OPTION_MEMORY:
        return number_read("--memory", text, (struct number_range){1, UINT64_MAX, true}, &options->memory, error);
    case OPTION_DISK_CACHE_SIZE:
        return number_read("--disk-cache-size", text, (struct number_range){0, UINT64_MAX, true},
                           &options->disk_cache_size, error);
    case OPTION_TIME:
        return parse_time(text, &options->seconds, error);
    case OPTION_AT:
        return parse_moment(text, options, error);
    case OPTION_SHUTTER:
        return parse_shutter(text, options, error);
    case OPTION_FRAMES:
        return parse_frames(text, options, error);
    case OPTION_POINTS:
        return parse_radius("--points", text, &options->point_radius, error);
    case OPTION_LINES:
        return parse_radius("--lines", text, &options->line_radius, error);
    case OPTION_DECAY:
        return parse_decay(text, &options->most_decay, error);
    case OPTION_COUNT:
        return number_read32("--count", text, (struct number_range){1, UINT32_MAX, false}, &options->count, error);
    case OPTION_INTERVAL:
        return parse_interval(text, &options->interval, error);
    case OPTION_SEED:
        return number_read("--seed", text, (struct number_range){0, UINT64_MAX, false}, &options->seed, error);
    case OPTION_CONNECT_TIMEOUT:
        return parse_timeout(text, &options->connect_timeout_ms, error);
    case OPTION_SIZE:
        return parse_size(text, options, error);
    case OPTION_UP:
        return parse_up(text, &options->up, error);
    case OPTION_EYE:
    case OPTION_LOOK_AT:
    case OPTION_FOV:
    case OPTION_TURN:
    case OPTION_SAMPLES:
    case OPTION_TIMES:
        return apply_view(value, text, &options->view, error);
    default:
        return apply_text(value, text, options);
    }
}

/* Fills getopt's table with the options of `commands`. */
static void fill_tables(unsigned commands, struct option table[OPTION_ROWS_MOST])
{
    size_t count = 0;
    for (const struct option_row *row = option_rows; row->name; row++)
        if (row->commands & commands)
            table[count++] =
                (struct option){row->name, row->argument ? required_argument : no_argument, NULL, row->value};
    table[count] = (struct option){NULL, 0, NULL, 0};
}

static enum bvhd_status parse_options(int argc, char **argv, unsigned commands, struct options *options,
                                      struct bvhd_error *error)
{
    struct option table[OPTION_ROWS_MOST];
    fill_tables(commands, table);
    const char *letters = commands == ON_MAIN ? "+:hqv" : commands & (ON_OUTPUT | ON_UPDATE) ? ":hqvo:" : ":hqv";
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

/* Checks the options about the cache on disk, and reads what `bvhctl cache` is to do. */
static enum bvhd_status complete_cache(struct options *options, struct bvhd_error *error)
{
    uint32_t action = 0;
    if (options->cache && !*options->cache)
        return usage(error, "--cache", "an empty name", "");
    if (options->cache && options->no_cache)
        return usage(error, "--cache", "makes no sense together with --no-cache", "");
    if (options->cache && options->command == COMMAND_CACHE && options->socket)
        return usage(error, "--cache", "makes no sense together with --socket", "");
    if (options->command != COMMAND_CACHE)
        return BVHD_OK;
    enum bvhd_status status = parse_name("cache", cache_action_names, options->operands[0], &action, error);
    options->cache_action = (enum cache_action)action;
    return status;
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
    if (options->local && (command & ON_QUERIES))
        return usage(error, "--local", "%s needs a daemon", row->name);
    if (options->operand_count < row->fewest)
        return usage(error, row->name, "wants: %s", row->arguments);
    if (options->operand_count > row->most)
        return usage(error, options->operands[row->most],
                     *row->arguments ? "one word too many; expected: %s" : "one word too many", row->arguments);
    if (needs_output && !options->output)
        return usage(error, row->name, "wants -o: %s", row->arguments);
    if (options->output && !*options->output)
        return usage(error, "-o", "an empty name", "");
    if (options->has_frames && options->has_moment)
        return usage(error, "--frames", "makes no sense together with --at", "");
    if (options->has_shutter && (options->has_moment || options->has_frames))
        return usage(error, "--shutter", "makes no sense together with --%s", options->has_moment ? "at" : "frames");
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
        .disk_cache_size = UINT64_C(10) << 30,
        .volume = REPORT_RESULTS,
        .interval = 2,
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
        if (!status && options.command < COMMAND_COUNT)
            status = complete_cache(&options, error);
    }
    if (!status)
        *ret_options = options;
    return status;
}
