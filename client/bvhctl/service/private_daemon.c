/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/service/private_daemon.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <limits.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "client/address.h"
#include "proto/base/clock.h"
#include "client/bvhctl/service/connect.h"
#include "client/bvhctl/base/files.h"

enum { POLL_MS = 5 };

/* The time after which the daemon exits without work, as an argument for bvhd. */
static char idle_seconds[] = "60";

static enum bvhd_status no_memory(struct bvhd_error *error)
{
    return bvhd_error_no_memory(error, "daemon", "no memory to start it");
}

static void nap(void)
{
    nanosleep(&(struct timespec){.tv_nsec = POLL_MS * 1000000L}, NULL);
}

enum bvhd_status private_daemon_place(struct memory *memory, struct private_place *ret_place, struct bvhd_error *error)
{
    bool is_runtime;
    struct private_place place = {.directory = address_user_directory(memory, &is_runtime)};
    if (place.directory)
        place.socket = files_join(memory, place.directory, "bvhd.sock");
    if (!place.socket) {
        private_place_finish(&place, memory);
        return no_memory(error);
    }
    place.is_ours = !is_runtime;
    place.is_safe = is_runtime || address_is_own(place.directory);
    *ret_place = place;
    return BVHD_OK;
}

void private_place_finish(struct private_place *place, struct memory *memory)
{
    memory_free(memory, place->directory);
    memory_free(memory, place->socket);
    *place = (struct private_place){0};
}

static enum bvhd_status make_safe(struct private_place *place, struct bvhd_error *error)
{
    if (!place->is_safe && place->is_ours) {
        if (mkdir(place->directory, 0700) < 0 && errno != EEXIST)
            return bvhd_error_set(error, BVHD_UNAVAILABLE, place->directory, "no daemon, and no place for one: %s",
                                  strerror(errno));
        place->is_safe = address_is_own(place->directory);
    }
    if (!place->is_safe)
        return bvhd_error_set(
            error, BVHD_UNAVAILABLE, place->directory,
            "no daemon, and none is started here: you must own the directory, and nobody else may access it");
    return BVHD_OK;
}

/* Returns the path of the socket with a suffix. The caller frees it. */
static char *beside(const struct private_place *place, const char *suffix, struct memory *memory)
{
    uint64_t size = strlen(place->socket) + strlen(suffix) + 1;
    char *path = memory_alloc(memory, size);
    if (path)
        snprintf(path, size, "%s%s", place->socket, suffix);
    return path;
}

/* Waits until it has the lock file, or until a daemon answers; *ret_descriptor is -1 then. */
static enum bvhd_status take_lock(const struct private_place *place, const char *path, double deadline,
                                  int *ret_descriptor, struct bvhd_error *error)
{
    int descriptor = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
    if (descriptor < 0)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, path, "no daemon, and none can be started: %s", strerror(errno));
    bool answers = false, locked = false;
    while (!(answers = connect_answers(place->socket)) && !(locked = flock(descriptor, LOCK_EX | LOCK_NB) == 0) &&
           clock_ms() < deadline)
        nap();
    if (locked) {
        *ret_descriptor = descriptor;
        return BVHD_OK;
    }
    close(descriptor);
    *ret_descriptor = -1;
    return answers ? BVHD_OK
                   : bvhd_error_set(error, BVHD_UNAVAILABLE, place->socket,
                                    "no daemon answers; another bvhctl has been starting one");
}

static bool is_program(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0 && S_ISREG(status.st_mode) && access(path, X_OK) == 0;
}

/* Returns whether `name` is a program in the directory, whose path has `length` bytes. */
static bool find_in(const char *directory, size_t length, const char *name, char ret_path[PATH_MAX])
{
    char path[PATH_MAX];
    int size = snprintf(path, sizeof path, "%.*s/%s", (int)length, directory, name);
    return size > 0 && size < PATH_MAX && is_program(path) && realpath(path, ret_path);
}

static bool find_in_path(char ret_path[PATH_MAX])
{
    const char *at = getenv("PATH");
    while (at && *at) {
        size_t length = strcspn(at, ":");
        if (*at == '/' && find_in(at, length, "bvhd", ret_path))
            return true;
        at += length + (at[length] == ':');
    }
    return false;
}

/*
 * Finds bvhd in the build folder that contains this program. The folder must look like one, because elsewhere the same
 * relative path could lead to another user's file.
 */
static bool find_built(const char *directory, size_t length, char ret_path[PATH_MAX])
{
    static const char built[] = "/client/bvhctl";
    size_t tail = sizeof built - 1;
    return length > tail && !memcmp(directory + length - tail, built, tail) &&
           find_in(directory, length - tail, "daemon/bvhd", ret_path);
}

/*
 * Searches for bvhd beside this program, in its build folder, in the directory where both are installed, and in $PATH.
 */
static bool find_program(char ret_path[PATH_MAX])
{
    char self[PATH_MAX];
    ssize_t size = readlink("/proc/self/exe", self, sizeof self - 1);
    if (size > 0) {
        self[size] = '\0';
        size_t length = (size_t)(strrchr(self, '/') - self);
        if (find_in(self, length, "bvhd", ret_path) || find_built(self, length, ret_path))
            return true;
    }
    return find_in(BVHD_BINDIR, strlen(BVHD_BINDIR), "bvhd", ret_path) || find_in_path(ret_path);
}

/* Variables by which a service manager addresses this process are not passed on to the daemon. */
static bool is_passed_on(const char *variable)
{
    return strncmp(variable, "NOTIFY_SOCKET=", 14) && strncmp(variable, "WATCHDOG_", 9) &&
           strncmp(variable, "LISTEN_", 7);
}

static char **make_environment(struct memory *memory)
{
    uint64_t count = 0, kept = 0;
    while (environ[count])
        count++;
    char **environment = memory_array(memory, count + 1, sizeof *environment);
    for (uint64_t i = 0; environment && i < count; i++)
        if (is_passed_on(environ[i]))
            environment[kept++] = environ[i];
    if (environment)
        environment[kept] = NULL;
    return environment;
}

/* AFTER_CACHE: the words that follow --cache. */
enum { ARGUMENTS = 11, AFTER_CACHE = 7 };

/* The command line of a daemon, with the texts that it is made of. */
struct command_line {
    char *words[ARGUMENTS];
    char file[16], socket[16], idle[16], cache[16], size[32], bytes[32];
    char directory[PATH_MAX];
};

/* The daemon has another working directory. */
static bool make_absolute(const char *path, char ret_path[PATH_MAX])
{
    size_t length = 0;
    if (*path != '/') {
        if (!getcwd(ret_path, PATH_MAX - 1))
            return false;
        length = strlen(ret_path);
        ret_path[length++] = '/';
    }
    if (length + strlen(path) >= PATH_MAX)
        return false;
    strcpy(ret_path + length, path);
    return true;
}

/* Results are kept in memory only if the directory has no path that can be given. */
static void make_command_line(char *program, char *socket, const struct private_cache *cache,
                              struct command_line *ret_line)
{
    struct command_line *line = ret_line;
    bool has_cache = cache->directory && make_absolute(cache->directory, line->directory);
    strcpy(line->file, "--user-config");
    strcpy(line->socket, "--socket");
    strcpy(line->idle, "--idle-exit");
    strcpy(line->cache, has_cache ? "--cache" : "--no-cache");
    strcpy(line->size, "--disk-cache-size");
    snprintf(line->bytes, sizeof line->bytes, "%" PRIu64, cache->size);
    char *const words[ARGUMENTS] = {program,     line->socket,    socket,     line->idle,  idle_seconds, line->file,
                                    line->cache, line->directory, line->size, line->bytes, NULL};
    memcpy(line->words, words, sizeof words);
    if (!has_cache)
        line->words[AFTER_CACHE] = NULL;
}

/*
 * Starts the daemon in a session of its own, so that an interrupt at the terminal does not reach it, and with none of
 * this process's descriptors.
 */
static int spawn(char **arguments, const char *log, char **environment, pid_t *ret_child)
{
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    int number = posix_spawn_file_actions_init(&actions);
    if (number)
        return number;
    number = posix_spawnattr_init(&attributes);
    if (number) {
        posix_spawn_file_actions_destroy(&actions);
        return number;
    }
    if ((number = posix_spawnattr_setflags(&attributes,
                                           POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK)) == 0 &&
        (number = posix_spawnattr_setsigdefault(&attributes, &all)) == 0 &&
        (number = posix_spawnattr_setsigmask(&attributes, &none)) == 0 &&
        (number = posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0)) == 0 &&
        (number = posix_spawn_file_actions_addopen(&actions, 1, log, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW,
                                                   0600)) == 0 &&
        (number = posix_spawn_file_actions_adddup2(&actions, 1, 2)) == 0 &&
        (number = posix_spawn_file_actions_addclosefrom_np(&actions, 3)) == 0 &&
        (number = posix_spawn_file_actions_addchdir_np(&actions, "/")) == 0)
        number = posix_spawn(ret_child, arguments[0], &actions, &attributes, arguments, environment);
    posix_spawnattr_destroy(&attributes);
    posix_spawn_file_actions_destroy(&actions);
    return number;
}

/* Reads the last line of the daemon's messages, without the line break. */
static void read_last_line(const char *log, char *ret_line, size_t size)
{
    char text[4096];
    FILE *file = fopen(log, "re");
    size_t length = 0;
    *ret_line = '\0';
    if (!file)
        return;
    if (fseek(file, -(long)sizeof text, SEEK_END) < 0)
        rewind(file);
    length = fread(text, 1, sizeof text - 1, file);
    fclose(file);
    while (length && text[length - 1] == '\n')
        length--;
    text[length] = '\0';
    const char *newline = strrchr(text, '\n');
    snprintf(ret_line, size, "%.*s", (int)size - 1, newline ? newline + 1 : text);
}

static enum bvhd_status report_end(int status, const char *log, struct bvhd_error *error)
{
    char line[160], how[48];
    read_last_line(log, line, sizeof line);
    if (WIFEXITED(status))
        snprintf(how, sizeof how, "status %d", WEXITSTATUS(status));
    else
        snprintf(how, sizeof how, "signal %d", WTERMSIG(status));
    return bvhd_error_set(error, BVHD_UNAVAILABLE, log, "the daemon that was started ended with %s%s%s", how,
                          *line ? ": " : "", line);
}

static enum bvhd_status wait_for(pid_t child, const char *socket, const char *log, double deadline,
                                 struct bvhd_error *error)
{
    while (!connect_answers(socket)) {
        int status;
        pid_t ended = waitpid(child, &status, WNOHANG);
        if (ended == child)
            return report_end(status, log, error);
        if (clock_ms() >= deadline)
            return bvhd_error_set(error, BVHD_UNAVAILABLE, log, "the daemon that was started does not answer yet");
        nap();
    }
    return BVHD_OK;
}

static enum bvhd_status run_daemon(const struct private_place *place, const struct private_cache *cache,
                                   const char *log, double deadline, struct memory *memory, struct bvhd_error *error)
{
    char program[PATH_MAX];
    struct command_line line;
    if (!find_program(program))
        return bvhd_error_set(error, BVHD_UNAVAILABLE, place->socket, "no daemon, and no program bvhd to start one");
    char **environment = make_environment(memory);
    if (!environment)
        return no_memory(error);
    pid_t child;
    make_command_line(program, place->socket, cache, &line);
    int number = spawn(line.words, log, environment, &child);
    memory_free(memory, environment);
    if (number)
        return bvhd_error_set(error, BVHD_UNAVAILABLE, program, "cannot be started: %s", strerror(number));
    return wait_for(child, place->socket, log, deadline, error);
}

enum bvhd_status private_daemon_start(struct private_place *place, const struct private_cache *cache, double deadline,
                                      struct memory *memory, bool *ret_is_new, struct bvhd_error *error)
{
    enum bvhd_status status = make_safe(place, error);
    if (status != BVHD_OK)
        return status;
    char *lock = beside(place, ".lock", memory), *log = beside(place, ".log", memory);
    int descriptor = -1;
    status = lock && log ? take_lock(place, lock, deadline, &descriptor, error) : no_memory(error);
    bool is_new = status == BVHD_OK && descriptor >= 0 && !connect_answers(place->socket);
    if (is_new)
        status = run_daemon(place, cache, log, deadline, memory, error);
    if (descriptor >= 0)
        close(descriptor);
    memory_free(memory, log);
    memory_free(memory, lock);
    if (status == BVHD_OK)
        *ret_is_new = is_new;
    return status;
}
