/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/daemon/service_process.h"

#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

enum { MAX_WORDS = 32, START_MS = 20000, STOP_MS = 10000 };

static void fail(const char *what)
{
    perror(what);
    exit(1);
}

static void sleep_ms(long ms)
{
    struct timespec wait = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&wait, NULL);
}

static bool answers(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    int descriptor = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (descriptor < 0)
        fail("socket");
    bool connected = connect(descriptor, (struct sockaddr *)&address, sizeof address) == 0;
    close(descriptor);
    return connected;
}

static void show_log(const struct service_process *service)
{
    char line[4096];
    FILE *file = fopen(service->log, "r");
    while (file && fgets(line, sizeof line, file))
        fputs(line, stderr);
    if (file)
        fclose(file);
}

static void become_daemon(const struct service_process *service, const char *program, const char *const *options)
{
    const char *words[MAX_WORDS] = {program, "--socket", service->socket, "--no-cache"};
    int count = 4;
    for (; options && *options && count < MAX_WORDS - 1; options++)
        words[count++] = *options;
    int log = open(service->log, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    dup2(log, STDERR_FILENO);
    execv(program, (char **)(uintptr_t)words);
    perror(program);
    _exit(127);
}

bool service_process_try_restart(struct service_process *service, const char *program, const char *const *options)
{
    service->pid = fork();
    if (service->pid < 0)
        fail("fork");
    if (service->pid == 0)
        become_daemon(service, program, options);
    for (int waited = 0; !answers(service->socket); waited += 5) {
        if (waited > START_MS || !service_process_runs(service)) {
            service_process_kill(service);
            return false;
        }
        sleep_ms(5);
    }
    return true;
}

void service_process_restart(struct service_process *service, const char *program, const char *const *options)
{
    if (service_process_try_restart(service, program, options))
        return;
    show_log(service);
    fprintf(stderr, "%s does not answer\n", program);
    exit(1);
}

void service_process_init(struct service_process *service)
{
    *service = (struct service_process){.directory = "/tmp/bvhd-test-XXXXXX"};
    if (!mkdtemp(service->directory))
        fail("mkdtemp");
    snprintf(service->socket, sizeof service->socket, "%s/socket", service->directory);
    snprintf(service->log, sizeof service->log, "%s/log", service->directory);
}

void service_process_start(struct service_process *service, const char *program, const char *const *options)
{
    service_process_init(service);
    service_process_restart(service, program, options);
}

bool service_process_runs(struct service_process *service)
{
    int status;
    if (service->pid <= 0)
        return false;
    if (waitpid(service->pid, &status, WNOHANG) == 0)
        return true;
    service->status = status;
    service->pid = 0;
    return false;
}

void service_process_kill(struct service_process *service)
{
    if (service->pid <= 0)
        return;
    kill(service->pid, SIGKILL);
    waitpid(service->pid, NULL, 0);
    service->pid = 0;
}

/* Waits for the process after SIGTERM. Returns whether it exited with status 0 in time. */
static bool left_well(struct service_process *service)
{
    for (int waited = 0; waited < STOP_MS; waited += 5) {
        int status;
        pid_t done = waitpid(service->pid, &status, WNOHANG);
        if (done == service->pid) {
            service->pid = 0;
            return WIFEXITED(status) && WEXITSTATUS(status) == 0;
        }
        sleep_ms(5);
    }
    return false;
}

bool service_process_end(struct service_process *service)
{
    bool well = true;
    if (service->pid > 0) {
        kill(service->pid, SIGTERM);
        well = left_well(service);
    }
    service_process_kill(service);
    if (!well)
        show_log(service);
    return well;
}

bool service_process_stop(struct service_process *service)
{
    bool well = service_process_end(service);
    unlink(service->log);
    unlink(service->socket);
    rmdir(service->directory);
    return well;
}

uint64_t service_process_resident(const struct service_process *service)
{
    char path[64];
    unsigned long long total = 0, resident = 0;
    snprintf(path, sizeof path, "/proc/%d/statm", (int)service->pid);
    FILE *file = fopen(path, "r");
    if (!file)
        return 0;
    if (fscanf(file, "%llu %llu", &total, &resident) != 2)
        resident = 0;
    fclose(file);
    return resident * (uint64_t)sysconf(_SC_PAGESIZE);
}

uint32_t service_process_descriptors(const struct service_process *service)
{
    char path[64];
    uint32_t count = 0;
    snprintf(path, sizeof path, "/proc/%d/fd", (int)service->pid);
    DIR *directory = opendir(path);
    while (directory && readdir(directory))
        count++;
    if (directory)
        closedir(directory);
    return count > 2 ? count - 2 : 0;
}
