/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/bench/bvhd_bench/cell.h"

#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "proto/base/clock.h"
#include "tests/bench/bvhd_bench/scene_source.h"

enum { TRACE_MS = 40 };

const char *cell_outcome_name(enum cell_outcome outcome)
{
    static const char *const names[] = {"done", "refused", "crashed", "hung"};
    return names[outcome];
}

/* Reads a field of /proc/self/status, in bytes; 0 where there is none. */
static uint64_t memory_field(const char *name)
{
    FILE *file = fopen("/proc/self/status", "r");
    char line[128];
    uint64_t kib = 0;
    while (file && fgets(line, sizeof line, file))
        if (strncmp(line, name, strlen(name)) == 0)
            kib = strtoull(line + strlen(name), NULL, 10);
    if (file)
        fclose(file);
    return kib * 1024;
}

/* Resets the peak of resident memory to what is resident now, and returns that. */
static uint64_t restart_peak(void)
{
    FILE *file = fopen("/proc/self/clear_refs", "w");
    if (file) {
        fputs("5", file);
        fclose(file);
    }
    return memory_field("VmRSS:");
}

static double seconds_of_thread(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static double trace_rate(const struct subject *subject, const struct trial *trial)
{
    double begin = seconds_of_thread(), spent;
    uint64_t count = 0;
    do {
        struct ray_hit hit;
        for (uint32_t i = 0; i < trial->count; i++)
            subject_trace(subject, &trial->rays[i], &hit, NULL);
        count += trial->count;
        spent = seconds_of_thread() - begin;
    } while (spent * 1e3 < TRACE_MS);
    return 1e-6 * (double)count / spent;
}

static void judge(struct bench *bench, const struct ply *mesh, const struct cell_request *request,
                  const struct subject *subject, struct cell_result *result)
{
    struct trial trial = trial_make(bench, mesh, request->seed, request->rays);
    result->verdicts = verdicts_of(&trial, subject);
    result->mrays_s = trace_rate(subject, &trial);
    trial_finish(&trial);
}

static void measure(struct bench *bench, const struct method *method, const struct ply *mesh,
                    const struct cell_request *request, struct cell_result *result)
{
    struct subject subject;
    bool traces = request->rays > 0 && method_traces(method);
    uint64_t before = restart_peak();
    struct subject_wants wants = {.tracer = true};
    if (!subject_build(bench, method, mesh, wants, &subject)) {
        result->outcome = CELL_REFUSED;
        memcpy(result->failure, subject.failure, sizeof result->failure);
    } else {
        uint64_t peak = memory_field("VmHWM:");
        result->peak_bytes = peak > before ? peak - before : 0;
        result->ms = subject.ms;
        result->sah = subject.stats.sah;
        if (traces)
            judge(bench, mesh, request, &subject, result);
    }
    subject_finish(&subject);
}

int cell_main(char **arguments, int descriptor)
{
    struct cell_request request = {.method = arguments[0],
                                   .scene = arguments[1],
                                   .size = (uint32_t)strtoul(arguments[2], NULL, 10),
                                   .seed = strtoull(arguments[3], NULL, 10),
                                   .rays = (uint32_t)strtoul(arguments[4], NULL, 10)};
    const struct method *method = method_find(request.method);
    struct ply *mesh = scene_source_open(request.scene, request.size, request.seed);
    struct cell_result result = {.outcome = CELL_DONE};
    struct bench bench;
    if (!method || !mesh || !bench_start(1, &bench))
        return 1;
    measure(&bench, method, mesh, &request, &result);
    bench_stop(&bench);
    ply_free(mesh);
    return write(descriptor, &result, sizeof result) == (ssize_t)sizeof result ? 0 : 1;
}

static void become(const struct cell_request *request, int descriptor)
{
    char size[16], seed[24], rays[16];
    struct rlimit none = {0, 0};
    snprintf(size, sizeof size, "%" PRIu32, request->size);
    snprintf(seed, sizeof seed, "%" PRIu64, request->seed);
    snprintf(rays, sizeof rays, "%" PRIu32, request->rays);
    setrlimit(RLIMIT_CORE, &none);
    if (dup2(descriptor, STDOUT_FILENO) >= 0 && freopen("/dev/null", "w", stderr))
        execl("/proc/self/exe", "bvhd-bench", "--cell", request->method, request->scene, size, seed, rays,
              (char *)NULL);
    _exit(127);
}

/*
 * Receives the result. Returns whether all of it came within the time limit; *ret_late says that the limit was
 * exceeded.
 */
static bool receive(int descriptor, double seconds, struct cell_result *ret_result, bool *ret_late)
{
    struct cell_result result;
    size_t have = 0;
    double end = clock_ms() + seconds * 1e3;
    *ret_late = false;
    while (have < sizeof result) {
        struct pollfd wait = {descriptor, POLLIN, 0};
        double left = end - clock_ms();
        *ret_late = left <= 0;
        if (*ret_late)
            return false;
        if (poll(&wait, 1, (int)left + 1) <= 0)
            continue;
        ssize_t got = read(descriptor, (char *)&result + have, sizeof result - have);
        if (got == 0 || (got < 0 && errno != EINTR))
            return false;
        have += got > 0 ? (size_t)got : 0;
    }
    *ret_result = result;
    return true;
}

bool cell_run(const struct cell_request *request, struct cell_result *ret_result)
{
    int ends[2], status = 0;
    bool is_late;
    fflush(NULL);
    pid_t child = pipe(ends) == 0 ? fork() : -1;
    if (child < 0) {
        fprintf(stderr, "bvhd-bench: no process: %s\n", strerror(errno));
        return false;
    }
    if (child == 0) {
        close(ends[0]);
        become(request, ends[1]);
    }
    close(ends[1]);
    *ret_result = (struct cell_result){.outcome = CELL_CRASHED};
    bool is_done = receive(ends[0], request->seconds, ret_result, &is_late);
    close(ends[0]);
    if (is_late)
        kill(child, SIGKILL);
    while (waitpid(child, &status, 0) < 0 && errno == EINTR)
        continue;
    if (is_late)
        ret_result->outcome = CELL_HUNG;
    else if (!is_done)
        ret_result->signal = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    return true;
}
