/* SPDX-License-Identifier: Apache-2.0 */
/* test_config.c - tests the options of the daemon: command line, file, defaults, errors. */
#include <sys/stat.h>
#include <unistd.h>

#include "tests/support/unit.h"

#include "daemon/config.h"

enum { MAX_WORDS = 32 };

static char directory[] = "/tmp/bvhd-config-XXXXXX";
static char path[64];

static int make_directory(void **state)
{
    (void)state;
    if (!mkdtemp(directory))
        return -1;
    snprintf(path, sizeof path, "%s/bvhd.conf", directory);
    return 0;
}

static int remove_directory(void **state)
{
    (void)state;
    unlink(path);
    return rmdir(directory);
}

static void write_file(const char *text)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
}

/* Parses a command line, whose words end with NULL. */
static enum bvhd_status parse(struct config *config, struct bvhd_error *error, ...)
{
    char *words[MAX_WORDS] = {"bvhd"}, *word;
    int count = 1;
    va_list arguments;
    va_start(arguments, error);
    while ((word = va_arg(arguments, char *)))
        words[count++] = word;
    va_end(arguments);
    return config_parse(count, words, config, error);
}

#define REFUSED(status, place, ...)                                                                                    \
    do {                                                                                                               \
        struct config kept = {.max_connections = 4711};                                                                \
        struct bvhd_error told;                                                                                        \
        assert_int_equal(parse(&kept, &told, __VA_ARGS__, NULL), status);                                              \
        assert_string_equal(told.where, place);                                                                        \
        assert_true(*told.text);                                                                                       \
        assert_int_equal(kept.max_connections, 4711);                                                                  \
    } while (0)

static void test_defaults(void **state)
{
    struct config config;
    struct bvhd_error error;
    (void)state;
    setenv("XDG_RUNTIME_DIR", "/somewhere", 1);
    assert_int_equal(parse(&config, &error, NULL), BVHD_OK);
    assert_string_equal(config.socket, geteuid() ? "/somewhere/bvhd.sock" : "/run/bvhd/bvhd.sock");
    unsetenv("XDG_RUNTIME_DIR");
    assert_int_equal(parse(&config, &error, NULL), BVHD_OK);
    assert_string_equal(config.socket, "/run/bvhd/bvhd.sock");
    assert_false(config.socket_given);
    assert_int_equal(config.action, CONFIG_RUN);
    assert_int_equal(config.log_level, LOG_INFO);
    assert_int_equal(config.idle_exit_ms, 0);
    assert_int_equal(config.drain_ms, 20000);
    assert_int_equal(config.service.slow_ms, 10000);
    assert_int_equal(config.max_connections, 1024);
    assert_int_equal(config.service.cache, service_options_default().cache);
}

static void test_command_line(void **state)
{
    struct config config;
    struct bvhd_error error;
    (void)state;
    assert_int_equal(parse(&config, &error, "--socket", "/tmp/s", "--workers=3", "--memory", "2G", "--cache-size",
                           "64M", "--idle-exit", "1.5", "--drain-timeout", "0", "--max-connections", "7", "--log-level",
                           "debug", "--slow-build", "0.25", NULL),
                     BVHD_OK);
    assert_string_equal(config.socket, "/tmp/s");
    assert_true(config.socket_given);
    assert_int_equal(config.service.workers, 3);
    assert_int_equal(config.service.memory, UINT64_C(2) << 30);
    assert_int_equal(config.service.cache, 64 << 20);
    assert_int_equal(config.idle_exit_ms, 1500);
    assert_int_equal(config.drain_ms, 0);
    assert_int_equal(config.max_connections, 7);
    assert_int_equal(config.log_level, LOG_DEBUG);
    assert_int_equal(config.service.slow_ms, 250);
    assert_int_equal(parse(&config, &error, "--slow-build", "0", NULL), BVHD_OK);
    assert_int_equal(config.service.slow_ms, 0);
    assert_int_equal(parse(&config, &error, "--cache-size", "0", NULL), BVHD_OK);
    assert_int_equal(config.service.cache, 0);
    assert_string_equal(config.cache, "");
    assert_int_equal(parse(&config, &error, "--cache", "/var/cache/bvhd", NULL), BVHD_OK);
    assert_string_equal(config.cache, "/var/cache/bvhd");
    assert_int_equal(config.service.disk_budget, UINT64_C(10) << 30);
    assert_int_equal(parse(&config, &error, "--cache", "/var/cache/bvhd", "--no-cache", NULL), BVHD_OK);
    assert_string_equal(config.cache, "");
    assert_int_equal(parse(&config, &error, "--disk-cache-size", "1M", NULL), BVHD_OK);
    assert_int_equal(config.service.disk_budget, 1 << 20);
    assert_int_equal(parse(&config, &error, "--help", NULL), BVHD_OK);
    assert_int_equal(config.action, CONFIG_HELP);
    assert_int_equal(parse(&config, &error, "-h", NULL), BVHD_OK);
    assert_int_equal(config.action, CONFIG_HELP);
    assert_int_equal(parse(&config, &error, "--version", "--workers", "x", NULL), BVHD_OK);
    assert_int_equal(config.action, CONFIG_VERSION);
}

static void test_usage(void **state)
{
    (void)state;
    REFUSED(BVHD_INVALID, "--fly", "--fly");
    REFUSED(BVHD_INVALID, "-x", "-x");
    REFUSED(BVHD_INVALID, "word", "word");
    REFUSED(BVHD_INVALID, "--workers", "--workers");
    REFUSED(BVHD_INVALID, "--help=1", "--help=1");
    REFUSED(BVHD_INVALID, "--workers", "--workers", "0");
    REFUSED(BVHD_INVALID, "--workers", "--workers", "1025");
    REFUSED(BVHD_INVALID, "--workers", "--workers", "-1");
    REFUSED(BVHD_INVALID, "--workers", "--workers", "2K");
    REFUSED(BVHD_INVALID, "--workers", "--workers", "");
    REFUSED(BVHD_INVALID, "--workers", "--workers", "99999999999999999999999");
    REFUSED(BVHD_INVALID, "--memory", "--memory", "5T");
    REFUSED(BVHD_INVALID, "--memory", "--memory", "5KK");
    REFUSED(BVHD_INVALID, "--memory", "--memory", " 5M");
    REFUSED(BVHD_INVALID, "--memory", "--memory", "17179869184G");
    REFUSED(BVHD_INVALID, "--memory", "--memory", "1000");
    REFUSED(BVHD_INVALID, "--cache-size", "--cache-size", "M");
    REFUSED(BVHD_INVALID, "--idle-exit", "--idle-exit", "-1");
    REFUSED(BVHD_INVALID, "--idle-exit", "--idle-exit", "soon");
    REFUSED(BVHD_INVALID, "--idle-exit", "--idle-exit", "1e9");
    REFUSED(BVHD_INVALID, "--drain-timeout", "--drain-timeout", "2000000");
    REFUSED(BVHD_INVALID, "--drain-timeout", "--drain-timeout", "1.2.3");
    REFUSED(BVHD_INVALID, "--slow-build", "--slow-build", "never");
    REFUSED(BVHD_INVALID, "--max-connections", "--max-connections", "0");
    REFUSED(BVHD_INVALID, "--log-level", "--log-level", "loud");
    REFUSED(BVHD_INVALID, "--socket", "--socket", "");
    REFUSED(BVHD_INVALID, "--cache", "--cache", "");
    REFUSED(BVHD_INVALID, "--disk-cache-size", "--disk-cache-size", "1048575");
    REFUSED(BVHD_INVALID, "--disk-cache-size", "--disk-cache-size", "0");
    REFUSED(BVHD_INVALID, "--no-cache=1", "--no-cache=1");
    REFUSED(BVHD_INVALID, "--memory", "--memory", "15M");
}

static void test_file(void **state)
{
    struct config config;
    struct bvhd_error error;
    (void)state;
    write_file(
        "# a comment\n\n  workers = 2  \nmemory=1G\n\tsocket = /run/some where/s\nlog-level = error\r\nidle-exit = 60");
    assert_int_equal(parse(&config, &error, "--workers", "5", "--config", path, NULL), BVHD_OK);
    assert_int_equal(config.service.workers, 5);
    assert_int_equal(config.service.memory, 1 << 30);
    assert_string_equal(config.socket, "/run/some where/s");
    assert_true(config.socket_given);
    assert_int_equal(config.log_level, LOG_ERROR);
    assert_int_equal(config.idle_exit_ms, 60000);
    assert_string_equal(config.file, path);
    write_file("cache = /var/cache/bvhd\ndisk-cache-size = 3G\n");
    assert_int_equal(parse(&config, &error, "--config", path, NULL), BVHD_OK);
    assert_string_equal(config.cache, "/var/cache/bvhd");
    assert_int_equal(config.service.disk_budget, UINT64_C(3) << 30);
    assert_int_equal(parse(&config, &error, "--config", path, "--no-cache", NULL), BVHD_OK);
    assert_string_equal(config.cache, "");
    write_file("");
    assert_int_equal(parse(&config, &error, "--config", path, NULL), BVHD_OK);
}

static void file_refused(const char *text, enum bvhd_status status, unsigned line)
{
    char place[128];
    write_file(text);
    snprintf(place, sizeof place, "%s:%u", path, line);
    REFUSED(status, place, "--config", path);
}

static void test_broken_files(void **state)
{
    char much[CONFIG_PATH_SIZE + 200], far[4000];
    struct config config;
    struct bvhd_error error;
    (void)state;
    file_refused("workers 2\n", BVHD_INVALID, 1);
    file_refused("workers = 1\nfly = yes\n", BVHD_INVALID, 2);
    file_refused("\n\nworkers = many\n", BVHD_INVALID, 3);
    file_refused("= 3\n", BVHD_INVALID, 1);
    file_refused("config = other.conf\n", BVHD_INVALID, 1);
    file_refused("help = yes\n", BVHD_INVALID, 1);
    file_refused("version =\n", BVHD_INVALID, 1);
    file_refused("socket =\n", BVHD_INVALID, 1);
    file_refused("cache =\n", BVHD_INVALID, 1);
    file_refused("no-cache = yes\n", BVHD_INVALID, 1);
    memset(much, 'x', sizeof much - 1);
    much[sizeof much - 1] = 0;
    file_refused(much, BVHD_INVALID, 1);
    unlink(path);
    REFUSED(BVHD_IO, path, "--config", path);
    REFUSED(BVHD_IO, directory, "--config", directory);
    memset(far, 'y', sizeof far - 1);
    far[sizeof far - 1] = 0;
    assert_int_equal(parse(&config, &error, "--config", far, NULL), BVHD_IO);
}

/* The user's own file is read if it is there and no other is named. */
static void test_users_file(void **state)
{
    static struct config config;
    struct bvhd_error error;
    char folder[96], file[112], *home = getenv("HOME");
    (void)state;
    snprintf(folder, sizeof folder, "%s/bvhd", directory);
    snprintf(file, sizeof file, "%s/bvhd.conf", folder);
    setenv("XDG_CONFIG_HOME", directory, 1);
    assert_int_equal(parse(&config, &error, "--user-config", NULL), BVHD_OK);
    assert_string_equal(config.file, "");
    write_file("max-connections = 5\n");
    assert_int_equal(mkdir(folder, 0700), 0);
    assert_int_equal(rename(path, file), 0);
    assert_int_equal(parse(&config, &error, "--user-config", NULL), BVHD_OK);
    assert_string_equal(config.file, file);
    assert_int_equal(config.max_connections, 5);
    assert_int_equal(parse(&config, &error, "--user-config", "--max-connections", "6", NULL), BVHD_OK);
    assert_int_equal(config.max_connections, 6);
    assert_int_equal(parse(&config, &error, NULL), BVHD_OK);
    assert_int_equal(config.max_connections, 1024);
    write_file("max-connections = 7\n");
    assert_int_equal(parse(&config, &error, "--user-config", "--config", path, NULL), BVHD_OK);
    assert_int_equal(config.max_connections, 7);
    setenv("XDG_CONFIG_HOME", "relative", 1);
    unsetenv("HOME");
    assert_int_equal(parse(&config, &error, "--user-config", NULL), BVHD_OK);
    assert_string_equal(config.file, "");
    if (home)
        setenv("HOME", home, 1);
    unsetenv("XDG_CONFIG_HOME");
    unlink(path);
    unlink(file);
    rmdir(folder);
}

/* Users other than root have the socket in their own folder, if that has a path and the path has room. */
static void test_runtime_folder(void **state)
{
    struct config config;
    struct bvhd_error error;
    char long_path[CONFIG_PATH_SIZE + 10];
    (void)state;
    if (geteuid() == 0 && seteuid(54321) != 0)
        skip();
    setenv("XDG_RUNTIME_DIR", "/somewhere", 1);
    assert_int_equal(parse(&config, &error, NULL), BVHD_OK);
    assert_string_equal(config.socket, "/somewhere/bvhd.sock");
    setenv("XDG_RUNTIME_DIR", "somewhere", 1);
    assert_int_equal(parse(&config, &error, NULL), BVHD_OK);
    assert_string_equal(config.socket, "/run/bvhd/bvhd.sock");
    memset(long_path, '/', sizeof long_path);
    long_path[sizeof long_path - 1] = '\0';
    setenv("XDG_RUNTIME_DIR", long_path, 1);
    assert_int_equal(parse(&config, &error, NULL), BVHD_OK);
    assert_string_equal(config.socket, "/run/bvhd/bvhd.sock");
    unsetenv("XDG_RUNTIME_DIR");
    if (getuid() == 0)
        assert_int_equal(seteuid(0), 0);
}

/* A file with a path longer than errors have room for is named by the end of the path. */
static void test_long_name(void **state)
{
    struct config config;
    struct bvhd_error error;
    char folder[BVHD_WHERE_SIZE + 40], file[BVHD_WHERE_SIZE + 80];
    (void)state;
    assert_int_equal(parse(&config, &error, NULL), BVHD_OK);
    int used = snprintf(folder, sizeof folder, "%s/", directory);
    memset(folder + used, 'x', BVHD_WHERE_SIZE);
    folder[used + BVHD_WHERE_SIZE] = '\0';
    assert_int_equal(mkdir(folder, 0700), 0);
    snprintf(file, sizeof file, "%s/f.conf", folder);
    FILE *stream = fopen(file, "w");
    assert_non_null(stream);
    fputs("nonsense = 1\n", stream);
    fclose(stream);
    assert_int_equal(config_read_file(file, &config, &error), BVHD_INVALID);
    assert_non_null(strstr(error.where, "xxx/f.conf:1"));
    unlink(file);
    rmdir(folder);
}

/* A file that never ends, or for whose writer the reader would wait, is refused at once. */
static void test_other_files(void **state)
{
    (void)state;
    REFUSED(BVHD_IO, "/dev/zero", "--config", "/dev/zero");
    unlink(path);
    assert_int_equal(mkfifo(path, 0600), 0);
    REFUSED(BVHD_IO, path, "--config", path);
    unlink(path);
    write_file("");
    assert_int_equal(truncate(path, CONFIG_MOST_FILE + 1), 0);
    REFUSED(BVHD_IO, path, "--config", path);
    unlink(path);
}

/* The call of opening a file that fails. */
static enum { NO_CALL, CALL_FSTAT, CALL_FDOPEN, CALL_READ } failing;

int __wrap_fstat64(int descriptor, struct stat64 *ret_status);
int __real_fstat64(int descriptor, struct stat64 *ret_status);
FILE *__wrap_fdopen(int descriptor, const char *mode);
FILE *__real_fdopen(int descriptor, const char *mode);

int __wrap_fstat64(int descriptor, struct stat64 *ret_status)
{
    return failing == CALL_FSTAT ? -1 : __real_fstat64(descriptor, ret_status);
}

static ssize_t read_nothing(void *cookie, char *buffer, size_t size)
{
    (void)cookie, (void)buffer, (void)size;
    return -1;
}

FILE *__wrap_fdopen(int descriptor, const char *mode)
{
    if (failing == CALL_FDOPEN)
        return NULL;
    if (failing != CALL_READ)
        return __real_fdopen(descriptor, mode);
    close(descriptor);
    return fopencookie(NULL, mode, (cookie_io_functions_t){.read = read_nothing});
}

static void test_calls_that_fail(void **state)
{
    (void)state;
    write_file("max-connections = 7\n");
    failing = CALL_FSTAT;
    REFUSED(BVHD_IO, path, "--config", path);
    failing = CALL_FDOPEN;
    REFUSED(BVHD_NO_MEMORY, path, "--config", path);
    failing = CALL_READ;
    REFUSED(BVHD_IO, path, "--config", path);
    failing = NO_CALL;
    unlink(path);
}

static void test_corners_of_values(void **state)
{
    struct config config, other;
    struct bvhd_error error;
    char long_path[CONFIG_PATH_SIZE + 1];
    (void)state;
    memset(long_path, 'x', sizeof long_path);
    long_path[sizeof long_path - 1] = '\0';
    REFUSED(BVHD_INVALID, "--socket", "--socket", long_path);
    REFUSED(BVHD_INVALID, "--socket", "--socket", "");
    assert_int_equal(parse(&config, &error, "--drain-timeout", "0.0001", NULL), BVHD_OK);
    assert_int_equal(config.drain_ms, 1);
    assert_int_equal(parse(&other, &error, "--drain-timeout", "0", NULL), BVHD_OK);
    assert_int_equal(other.drain_ms, 0);
    assert_null(config_fixed_difference(&config, &other));
}

/* A user's folder whose path is too long, and a home without the file, have no file. */
static void test_users_folders(void **state)
{
    static struct config config;
    struct bvhd_error error;
    char long_path[CONFIG_PATH_SIZE + 10], *home = getenv("HOME") ? strdup(getenv("HOME")) : NULL;
    (void)state;
    memset(long_path, '/', sizeof long_path);
    long_path[sizeof long_path - 1] = '\0';
    setenv("XDG_CONFIG_HOME", long_path, 1);
    assert_int_equal(parse(&config, &error, "--user-config", NULL), BVHD_OK);
    assert_string_equal(config.file, "");
    unsetenv("XDG_CONFIG_HOME");
    setenv("HOME", directory, 1);
    assert_int_equal(parse(&config, &error, "--user-config", NULL), BVHD_OK);
    assert_string_equal(config.file, "");
    if (home)
        setenv("HOME", home, 1);
    free(home);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_defaults),      cmocka_unit_test(test_command_line),
        cmocka_unit_test(test_usage),         cmocka_unit_test(test_file),
        cmocka_unit_test(test_broken_files),  cmocka_unit_test(test_users_file),
        cmocka_unit_test(test_other_files),   cmocka_unit_test(test_runtime_folder),
        cmocka_unit_test(test_long_name),     cmocka_unit_test(test_corners_of_values),
        cmocka_unit_test(test_users_folders), cmocka_unit_test(test_calls_that_fail),

    };
    return cmocka_run_group_tests(tests, make_directory, remove_directory);
}
