/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/config.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "proto/base/number.h"

enum option_kind {
    KIND_FIRST = 256, /* greater than every character, since getopt_long returns characters and kinds */
    KIND_SOCKET,
    KIND_WORKERS,
    KIND_MEMORY,
    KIND_CACHE_SIZE,
    KIND_CACHE,
    KIND_DISK_CACHE_SIZE,
    KIND_CONNECTIONS,
    KIND_IDLE,
    KIND_DRAIN,
    KIND_METRICS,
    KIND_SLOW,
    KIND_LEVEL,
    KIND_CONFIG, /* this and the following are for the command line only */
    KIND_USER_CONFIG,
    KIND_NO_CACHE,
    KIND_VERSION,
};

struct config_option {
    const char *name, *argument;
    int kind;
    const char *help; /* one or more lines */
};

static const struct config_option option_rows[] = {
    {"socket", "PATH", KIND_SOCKET,
     "listen on this socket (default: $XDG_RUNTIME_DIR/bvhd.sock;\nfor root, and without that variable, "
     "/run/bvhd/bvhd.sock);\n"
     "a socket that a service manager hands over takes precedence"},
    {"workers", "N", KIND_WORKERS, "threads that build (default: one for each processor)"},
    {"memory", "BYTES", KIND_MEMORY,
     "memory for requests and builds, at least 16M; K, M or G may\nfollow the number (default: half of the machine's "
     "memory, or\nof the limit of the daemon's control group)"},
    {"cache-size", "BYTES", KIND_CACHE_SIZE,
     "results to keep in memory; 0 keeps none (default: 1G, or\na quarter of the machine's "
     "memory, or of the limit of the\ndaemon's control group, if that is less)"},
    {"cache", "DIR", KIND_CACHE,
     "keep results on disk, too, in this directory, which is made\nif it is missing (default: they are kept in memory "
     "only)"},
    {"disk-cache-size", "BYTES", KIND_DISK_CACHE_SIZE, "results to keep on disk, at least 1M (default: 10G)"},
    {"max-connections", "N", KIND_CONNECTIONS,
     "clients at once (default: 1024), of one user at most\nthree quarters of them"},
    {"idle-exit", "SECONDS", KIND_IDLE, "exit after that time without clients (default: 0, never)"},
    {"drain-timeout", "SECONDS", KIND_DRAIN, "time to finish what is under way after SIGTERM\n(default: 20)"},
    {"metrics", "PATH", KIND_METRICS,
     "also listen on this socket for monitoring: HTTP, GET /metrics,\nin the format of Prometheus (default: none)"},
    {"slow-build", "SECONDS", KIND_SLOW, "log structures that take as long, with the reason\n(default: 10; 0: none)"},
    {"log-level", "LEVEL", KIND_LEVEL, "error, warning, info (default) or debug"},
    {"config", "FILE", KIND_CONFIG,
     "read lines of the form \"name = value\", with the names above;\nlines that begin with # are comments; the "
     "command "
     "line wins"},
    {"user-config", NULL, KIND_USER_CONFIG,
     "without --config: read $XDG_CONFIG_HOME/bvhd/bvhd.conf, or\n~/.config/bvhd/bvhd.conf, if there is one"},
    {"no-cache", NULL, KIND_NO_CACHE, "keep nothing on disk, whatever the file says"},
    {"help", NULL, 'h', "print this help"},
    {"version", NULL, KIND_VERSION, "print the version"},
};
enum { OPTION_ROWS = sizeof option_rows / sizeof *option_rows };

static const char *const level_names[] = {
    [LOG_ERROR] = "error", [LOG_WARNING] = "warning", [LOG_INFO] = "info", [LOG_DEBUG] = "debug"};

static enum bvhd_status read_seconds(const char *where, const char *text, uint64_t *ret_ms, struct bvhd_error *error)
{
    char *end;
    double seconds = strtod(text, &end);
    if (!isdigit((unsigned char)*text) || text[strspn(text, "0123456789.")] || *end || seconds > 1e6)
        return bvhd_error_set(error, BVHD_INVALID, where, "not a number of seconds: '%s'", text);
    *ret_ms = seconds > 0 && seconds < 0.001 ? 1 : (uint64_t)(seconds * 1000); /* 0 has a meaning of its own */
    return BVHD_OK;
}

static enum bvhd_status read_path(const char *where, const char *text, char ret_path[CONFIG_PATH_SIZE],
                                  struct bvhd_error *error)
{
    size_t length = strlen(text);
    if (length == 0 || length >= CONFIG_PATH_SIZE)
        return bvhd_error_set(error, BVHD_INVALID, where, length ? "a path that is too long" : "an empty path");
    memcpy(ret_path, text, length + 1);
    return BVHD_OK;
}

static enum bvhd_status read_level(const char *where, const char *text, enum log_level *ret_level,
                                   struct bvhd_error *error)
{
    for (int i = LOG_ERROR; i <= LOG_DEBUG; i++)
        if (!strcmp(text, level_names[i])) {
            *ret_level = (enum log_level)i;
            return BVHD_OK;
        }
    return bvhd_error_set(error, BVHD_INVALID, where, "not error, warning, info or debug: '%s'", text);
}

static enum bvhd_status apply(int kind, const char *where, const char *text, struct config *config,
                              struct bvhd_error *error)
{
    switch (kind) {
    case KIND_SOCKET:
        config->socket_given = true;
        return read_path(where, text, config->socket, error);
    case KIND_WORKERS:
        return number_read32(where, text, (struct number_range){1, POOL_MAX_THREADS, false}, &config->service.workers,
                             error);
    case KIND_MEMORY:
        return number_read(where, text, (struct number_range){SERVICE_LEAST_MEMORY, UINT64_MAX, true},
                           &config->service.memory, error);
    case KIND_CACHE_SIZE:
        return number_read(where, text, (struct number_range){0, UINT64_MAX, true}, &config->service.cache, error);
    case KIND_CACHE:
        return read_path(where, text, config->cache, error);
    case KIND_DISK_CACHE_SIZE:
        return number_read(where, text, (struct number_range){CONFIG_LEAST_DISK, UINT64_MAX, true},
                           &config->service.disk_budget, error);
    case KIND_NO_CACHE:
        *config->cache = '\0';
        return BVHD_OK;
    case KIND_CONNECTIONS:
        return number_read32(where, text, (struct number_range){1, 1000000, false}, &config->max_connections, error);
    case KIND_IDLE:
        return read_seconds(where, text, &config->idle_exit_ms, error);
    case KIND_DRAIN:
        return read_seconds(where, text, &config->drain_ms, error);
    case KIND_METRICS:
        return read_path(where, text, config->metrics, error);
    case KIND_SLOW:
        return read_seconds(where, text, &config->service.slow_ms, error);
    case KIND_LEVEL:
        return read_level(where, text, &config->log_level, error);
    case KIND_USER_CONFIG:
        config->users_file = true;
        return BVHD_OK;
    case KIND_CONFIG:
        return read_path(where, text, config->file, error);
    default:
        config->action = kind == 'h' ? CONFIG_HELP : CONFIG_VERSION;
        return BVHD_OK;
    }
}

static void set_defaults(struct config *config)
{
    memset(config, 0, sizeof *config);
    config->log_level = LOG_INFO;
    config->drain_ms = 20000;
    config->max_connections = 1024;
    config->service = service_options_default();
    const char *runtime = geteuid() ? getenv("XDG_RUNTIME_DIR") : NULL;
    if (!runtime || *runtime != '/' ||
        snprintf(config->socket, sizeof config->socket, "%s/bvhd.sock", runtime) >= CONFIG_PATH_SIZE)
        strcpy(config->socket, "/run/bvhd/bvhd.sock");
}

static void fill_table(struct option table[OPTION_ROWS + 1])
{
    for (size_t i = 0; i < OPTION_ROWS; i++)
        table[i] = (struct option){option_rows[i].name, option_rows[i].argument ? required_argument : no_argument, NULL,
                                   option_rows[i].kind};
    table[OPTION_ROWS] = (struct option){NULL, 0, NULL, 0};
}

static enum bvhd_status apply_command_line(int argc, char **argv, struct config *config, struct bvhd_error *error)
{
    struct option table[OPTION_ROWS + 1];
    fill_table(table);
    opterr = 0;
    optind = 0; /* makes glibc start from the beginning, also in a second call */
    for (;;) {
        int before = optind ? optind : 1, index = -1, kind = getopt_long(argc, argv, "+:h", table, &index);
        if (kind == -1)
            break;
        if (kind == ':')
            return bvhd_error_set(error, BVHD_INVALID, argv[optind - 1], "needs a value");
        if (kind == '?')
            return bvhd_error_set(error, BVHD_INVALID, argv[optind > before ? optind - 1 : before],
                                  "not an option; see bvhd --help");
        char where[32];
        snprintf(where, sizeof where, "--%s", index >= 0 ? table[index].name : "help");
        enum bvhd_status status = apply(kind, where, optarg, config, error);
        if (status != BVHD_OK || config->action != CONFIG_RUN)
            return status;
    }
    if (optind < argc)
        return bvhd_error_set(error, BVHD_INVALID, argv[optind], "not an option; see bvhd --help");
    return BVHD_OK;
}

static char *trim(char *text)
{
    while (isspace((unsigned char)*text))
        text++;
    size_t length = strlen(text);
    while (length && isspace((unsigned char)text[length - 1]))
        length--;
    text[length] = 0;
    return text;
}

static enum bvhd_status apply_line(char *line, const char *where, struct config *config, struct bvhd_error *error)
{
    char *name = trim(line);
    if (!*name || *name == '#')
        return BVHD_OK;
    char *equals = strchr(name, '=');
    if (!equals)
        return bvhd_error_set(error, BVHD_INVALID, where, "not of the form name = value");
    *equals = 0;
    name = trim(name);
    for (size_t i = 0; i < OPTION_ROWS; i++)
        if (option_rows[i].kind > KIND_FIRST && option_rows[i].kind < KIND_CONFIG && !strcmp(option_rows[i].name, name))
            return apply(option_rows[i].kind, where, trim(equals + 1), config, error);
    return bvhd_error_set(error, BVHD_INVALID, where, "no such name: '%s'", name);
}

static enum bvhd_status apply_lines(FILE *file, const char *path, struct config *config, struct bvhd_error *error)
{
    char line[CONFIG_PATH_SIZE + 64], where[BVHD_WHERE_SIZE];
    enum bvhd_status status = BVHD_OK;
    for (unsigned number = 1; status == BVHD_OK && fgets(line, sizeof line, file); number++) {
        size_t length = strlen(path), most = sizeof where - 16; /* the end of a long path says more than its start */
        snprintf(where, sizeof where, "%s:%u", length > most ? path + length - most : path, number);
        if (!strchr(line, '\n') && !feof(file))
            return bvhd_error_set(error, BVHD_INVALID, where, "the line is too long, or has a NUL in it");
        status = apply_line(line, where, config, error);
    }
    if (status == BVHD_OK && ferror(file))
        return bvhd_error_set(error, BVHD_IO, path, "reading: %s", strerror(errno));
    return status;
}

static enum bvhd_status check_file(int descriptor, const char *path, struct bvhd_error *error)
{
    struct stat stat;
    if (fstat(descriptor, &stat) != 0)
        return bvhd_error_set(error, BVHD_IO, path, "opening: %s", strerror(errno));
    if (!S_ISREG(stat.st_mode))
        return bvhd_error_set(error, BVHD_IO, path, "not a regular file");
    if (stat.st_size > CONFIG_MOST_FILE)
        return bvhd_error_set(error, BVHD_IO, path, "%lld bytes, over %d", (long long)stat.st_size, CONFIG_MOST_FILE);
    return BVHD_OK;
}

/* O_NONBLOCK keeps a pipe without a writer from stopping the open. */
static enum bvhd_status open_file(const char *path, FILE **ret_file, struct bvhd_error *error)
{
    int descriptor = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (descriptor < 0)
        return bvhd_error_set(error, BVHD_IO, path, "opening: %s", strerror(errno));
    enum bvhd_status status = check_file(descriptor, path, error);
    if (status == BVHD_OK && !(*ret_file = fdopen(descriptor, "r")))
        status = bvhd_error_no_memory(error, path, "no memory to read it");
    if (status != BVHD_OK)
        close(descriptor);
    return status;
}

enum bvhd_status config_read_file(const char *path, struct config *config, struct bvhd_error *error)
{
    FILE *file = NULL;
    enum bvhd_status status = open_file(path, &file, error);
    if (status != BVHD_OK)
        return status;
    struct config changed = *config;
    status = apply_lines(file, path, &changed, error);
    fclose(file);
    if (status == BVHD_OK)
        *config = changed;
    return status;
}

/* A variable that names no absolute path is passed over, by the XDG base directory specification. */
static const char *absolute(const char *variable)
{
    const char *path = getenv(variable);
    return path && *path == '/' ? path : NULL;
}

/* Fills in the user's own file, if that is wanted and there is one. Returns whether there is a file to read. */
static bool find_file(struct config *config)
{
    config->users_file = config->users_file && !*config->file;
    if (!config->users_file)
        return *config->file;
    const char *configs = absolute("XDG_CONFIG_HOME"), *home = absolute("HOME");
    int length = snprintf(config->file, sizeof config->file, "%s%s/bvhd/bvhd.conf",
                          configs ? configs
                          : home  ? home
                                  : "",
                          configs ? "" : "/.config");
    bool found = (configs || home) && length < CONFIG_PATH_SIZE && access(config->file, F_OK) == 0;
    if (!found)
        *config->file = '\0';
    return found;
}

enum bvhd_status config_parse(int argc, char **argv, struct config *ret_config, struct bvhd_error *error)
{
    struct config config;
    set_defaults(&config);
    enum bvhd_status status = apply_command_line(argc, argv, &config, error);
    if (status == BVHD_OK && config.action == CONFIG_RUN && find_file(&config)) {
        const struct config first = config;
        set_defaults(&config);
        status = config_read_file(first.file, &config, error);
        if (status == BVHD_OK)
            status = apply_command_line(argc, argv, &config, error);
        strcpy(config.file, first.file);
    }
    config.argc = argc;
    config.argv = argv;
    if (status == BVHD_OK)
        *ret_config = config;
    return status;
}

enum bvhd_status config_reload(const struct config *old, struct config *ret_config, struct bvhd_error *error)
{
    return config_parse(old->argc, old->argv, ret_config, error);
}

const char *config_fixed_difference(const struct config *a, const struct config *b)
{
    const struct {
        const char *name;
        bool differs;
    } options[] = {
        {"socket", strcmp(a->socket, b->socket) != 0},
        {"workers", a->service.workers != b->service.workers},
        {"memory", a->service.memory != b->service.memory},
        {"cache", strcmp(a->cache, b->cache) != 0},
        {"disk-cache-size", a->service.disk_budget != b->service.disk_budget},
        {"metrics", strcmp(a->metrics, b->metrics) != 0},
    };
    for (size_t i = 0; i < sizeof options / sizeof *options; i++)
        if (options[i].differs)
            return options[i].name;
    return NULL;
}

static void print_option(const struct config_option *row)
{
    char name[64];
    snprintf(name, sizeof name, "%s--%s%s%s", row->kind == 'h' ? "-h, " : "    ", row->name, row->argument ? " " : "",
             row->argument ? row->argument : "");
    const char *text = row->help;
    for (const char *label = name; text; label = "") {
        size_t length = strcspn(text, "\n");
        printf("  %-28s  %.*s\n", label, (int)length, text);
        text = text[length] ? text + length + 1 : NULL;
    }
}

void config_print_help(void)
{
    printf("usage: bvhd [OPTION]...\n"
           "Builds acceleration structures for clients on a Unix socket, in the foreground.\n\n");
    for (size_t i = 0; i < OPTION_ROWS; i++)
        print_option(&option_rows[i]);
    printf("\nSIGTERM and SIGINT let the daemon finish what is under way; a second signal ends it at once.\n"
           "SIGHUP makes it read its file of options again.\n"
           "Exit status: 0 for an orderly end, 1 for a failure, 2 for wrong usage.\n");
}
