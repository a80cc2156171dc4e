/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/interrupt.h"

#include <limits.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

static const char object[] = "{\"schema\":1,\"error\":{\"status\":\"CANCELLED\",\"vuid\":\"\",\"where\":\"signal\","
                             "\"text\":\"interrupted\"}}\n";

/* The state that the handler reads. All but the atomic members are written before it is installed. */
static struct {
    pthread_t main_thread;
    pid_t process;
    char message[64];
    bool json;
    atomic_bool has_output; /* stdout has, or gets, a result */
    atomic_bool has_file;
    char file[PATH_MAX]; /* valid while has_file is set */
} state;

static void put(int descriptor, const char *text, size_t size)
{
    if (write(descriptor, text, size) < 0)
        return; /* nobody can be told */
}

/*
 * Runs in the main thread only, which also creates and renames the file: so the file cannot appear after its removal.
 * It calls nothing but functions that are safe in handlers.
 */
static void end(int number)
{
    if (getpid() == state.process) {
        if (!pthread_equal(pthread_self(), state.main_thread)) {
            pthread_kill(state.main_thread, number);
            return;
        }
        if (atomic_load(&state.has_file))
            unlink(state.file);
        if (isatty(STDERR_FILENO))
            put(STDERR_FILENO, "\r\033[K", 4); /* there may be a progress line */
        put(STDERR_FILENO, state.message, strlen(state.message));
        if (state.json && !atomic_load(&state.has_output))
            put(STDOUT_FILENO, object, sizeof object - 1);
    }
    struct sigaction action = {.sa_handler = SIG_DFL};
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, number);
    sigaction(number, &action, NULL);
    raise(number);
    pthread_sigmask(SIG_UNBLOCK, &set, NULL); /* the signal, which is blocked in its own handler, comes here */
}

static void watch(int number)
{
    struct sigaction action;
    if (sigaction(number, NULL, &action) < 0 || action.sa_handler == SIG_IGN)
        return;
    action = (struct sigaction){.sa_handler = end, .sa_flags = SA_RESTART};
    sigemptyset(&action.sa_mask);
    sigaction(number, &action, NULL);
}

void interrupt_watch(const char *command, bool json)
{
    state.main_thread = pthread_self();
    state.process = getpid();
    state.json = json;
    snprintf(state.message, sizeof state.message, "bvhctl: %s: signal: interrupted\n", command);
    watch(SIGINT);
    watch(SIGTERM);
    watch(SIGHUP);
}

void interrupt_output_begins(void)
{
    atomic_store(&state.has_output, true);
}

void interrupt_removes(const char *path)
{
    atomic_store(&state.has_file, false);
    if (!path || strlen(path) >= sizeof state.file)
        return;
    memcpy(state.file, path, strlen(path) + 1);
    atomic_store(&state.has_file, true);
}
