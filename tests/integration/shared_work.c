/* SPDX-License-Identifier: Apache-2.0 */
/*
 * shared_work.c - tests that the daemon does equal work only once for all clients: with many client processes at the
 * same time, and with clients that leave while others wait for the same result; and that clients are told how far it
 * is.
 *
 *     shared_work BVHD
 */
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <bvhd/bvhd.h>

#include "tests/support/daemon/service_process.h"
#include "tests/support/scene/terrain.h"

enum { PROCESSES = 8, BUILDS = 1000 };

static struct service_process service;
static int failures;

__attribute__((format(printf, 2, 3))) static void expect(bool good, const char *format, ...)
{
    va_list arguments;
    if (good)
        return;
    va_start(arguments, format);
    fputs("failed: ", stdout);
    vprintf(format, arguments);
    putchar('\n');
    va_end(arguments);
    failures++;
}

static struct bvhd_client *connect_client(void)
{
    struct bvhd_client_options options = {
        .struct_size = sizeof options, .socket_path = service.socket, .local = BVHD_LOCAL_NEVER};
    struct bvhd_client *client;
    struct bvhd_error error;
    if (bvhd_client_create(&options, &client, &error) != BVHD_OK || bvhd_client_connect(client, &error) != BVHD_OK) {
        fprintf(stderr, "%s: %s\n", error.where, error.text);
        exit(1);
    }
    return client;
}

static uint64_t counter(struct bvhd_client *client, const char *name)
{
    struct bvhd_counters *counters;
    struct bvhd_error error;
    uint64_t value = UINT64_MAX;
    if (bvhd_client_counters(client, 5000, &counters, &error) != BVHD_OK)
        return value;
    for (uint32_t i = 0; i < bvhd_counters_count(counters); i++)
        if (!strcmp(bvhd_counters_name(counters, i), name))
            value = bvhd_counters_value(counters, i);
    bvhd_counters_destroy(counters);
    return value;
}

/* Submits `copies` items with the same info in one batch. */
static struct bvhd_batch *submit(struct bvhd_client *client, const struct terrain *terrain, uint32_t copies)
{
    VkAccelerationStructureBuildGeometryInfoKHR *infos = calloc(copies, sizeof *infos);
    const VkAccelerationStructureBuildRangeInfoKHR **ranges = calloc(copies, sizeof *ranges);
    struct bvhd_batch *batch = NULL;
    struct bvhd_error error;
    for (uint32_t i = 0; i < copies; i++) {
        infos[i] = terrain->info;
        ranges[i] = terrain->ranges;
    }
    struct bvhd_build build = {.struct_size = sizeof build, .info_count = copies, .infos = infos, .ranges = ranges};
    if (bvhd_batch_submit(client, &build, &batch, &error) != BVHD_OK) {
        fprintf(stderr, "%s: %s\n", error.where, error.text);
        exit(1);
    }
    free(infos);
    free(ranges);
    return batch;
}

static uint64_t checksum(const void *data, uint64_t size)
{
    uint64_t sum = 14695981039346656037u;
    for (uint64_t i = 0; i < size; i++)
        sum = (sum ^ ((const unsigned char *)data)[i]) * 1099511628211u;
    return sum;
}

/*
 * Runs as a client process: builds its share and writes one checksum for all its results, or 0 when one failed or
 * differed.
 */
static void run_client(const struct terrain *terrain, int begin, int answer)
{
    char go;
    uint64_t sum = 0;
    struct bvhd_client *client = connect_client();
    if (read(begin, &go, 1) < 0)
        _exit(1);
    struct bvhd_batch *batch = submit(client, terrain, BUILDS / PROCESSES);
    bvhd_batch_wait(batch, -1);
    for (uint32_t i = 0; i < bvhd_batch_count(batch); i++) {
        const struct bvhd_result *result = bvhd_batch_result(batch, i);
        uint64_t own = result->error.status != BVHD_OK ? 0 : checksum(result->data, result->size);
        sum = i == 0 || own == sum ? own : 0;
        if (result->error.status != BVHD_OK)
            fprintf(stderr, "%s: %s\n", result->error.where, result->error.text);
    }
    bvhd_batch_destroy(batch);
    bvhd_client_destroy(client);
    if (write(answer, &sum, sizeof sum) != sizeof sum)
        _exit(1);
    _exit(0);
}

static void many_at_once(const struct terrain *terrain)
{
    int begin[2], answers[2];
    pid_t processes[PROCESSES];
    uint64_t first = 0;
    if (pipe(begin) || pipe(answers))
        exit(1);
    for (int i = 0; i < PROCESSES; i++) {
        processes[i] = fork();
        if (processes[i] == 0) {
            close(begin[1]);
            run_client(terrain, begin[0], answers[1]);
        }
    }
    close(begin[0]);
    close(begin[1]); /* closing the last writing end makes all clients start */
    for (int i = 0; i < PROCESSES; i++) {
        uint64_t sum = 0;
        expect(read(answers[0], &sum, sizeof sum) == sizeof sum && sum != 0, "a client failed");
        expect(i == 0 || sum == first, "clients got different bytes");
        first = sum;
    }
    for (int i = 0; i < PROCESSES; i++)
        waitpid(processes[i], NULL, 0);
    close(answers[0]);
    close(answers[1]);
    struct bvhd_client *client = connect_client();
    uint64_t started = counter(client, "builds_started"), shared = counter(client, "coalesced"),
             hits = counter(client, "hits_memory");
    printf("%d identical builds from %d processes: %llu started, %llu coalesced, %llu from memory\n", BUILDS, PROCESSES,
           (unsigned long long)started, (unsigned long long)shared, (unsigned long long)hits);
    expect(started == 1, "%llu builds were started", (unsigned long long)started);
    expect(shared + hits == BUILDS - 1, "the counters do not add up");
    bvhd_client_destroy(client);
}

static void sleep_ms(long ms)
{
    struct timespec wait = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&wait, NULL);
}

/* Waits until the build that both clients need has started, for 2 s at most. */
static void await_start(struct bvhd_client *client, uint64_t started)
{
    for (int i = 0; i < 2000 && counter(client, "builds_started") <= started; i++)
        sleep_ms(1);
}

enum way { DIES, CANCELS, DESTROYS };

/* One client submits first and leaves, at different moments; the other one must get its result. */
static void first_leaves(const struct terrain *terrain, enum way way, long after_ms)
{
    struct bvhd_client *stays = connect_client();
    uint64_t started = counter(stays, "builds_started");
    int ready[2];
    if (pipe(ready))
        exit(1);
    pid_t leaver = fork();
    if (leaver == 0) {
        struct bvhd_client *client = connect_client();
        struct bvhd_batch *batch = submit(client, terrain, 1);
        bvhd_batch_wait_copied(batch, -1);
        if (write(ready[1], "r", 1) != 1)
            _exit(1);
        sleep_ms(after_ms);
        if (way == CANCELS)
            bvhd_batch_cancel(batch);
        else if (way == DESTROYS)
            bvhd_batch_destroy(batch);
        else
            raise(SIGKILL);
        sleep_ms(20);
        _exit(0);
    }
    char byte;
    close(ready[1]);
    expect(read(ready[0], &byte, 1) == 1, "the first client did not get that far");
    close(ready[0]);
    struct bvhd_batch *batch = submit(stays, terrain, 1);
    await_start(stays, started);
    expect(bvhd_batch_wait(batch, 60000) == BVHD_OK, "the other one waits for ever");
    const struct bvhd_result *result = bvhd_batch_result(batch, 0);
    expect(result->error.status == BVHD_OK && result->size > 0, "way %d after %ld ms: the other one got: %s", way,
           after_ms, result->error.text);
    waitpid(leaver, NULL, 0);
    bvhd_batch_destroy(batch);
    bvhd_client_destroy(stays);
}

/* The size of a build that lasts long enough to leave meanwhile; $SIZE makes it smaller where everything is slow. */
static uint32_t long_build(void)
{
    const char *size = getenv("SIZE");
    return size ? 10 * (uint32_t)atoi(size) : 300000;
}

/* Returns whether a client that waits was told of a part of the build. What it is told never decreases. */
static bool is_told_of_parts(struct bvhd_client *client, const struct terrain *terrain)
{
    struct bvhd_batch *batch = submit(client, terrain, 1);
    float last = 0;
    bool is_part = false;
    while (bvhd_batch_wait(batch, 20) == BVHD_PENDING) {
        float progress = bvhd_batch_progress(batch, 0);
        expect(progress >= last && progress <= 1, "progress of %g after %g", (double)progress, (double)last);
        is_part = is_part || (progress > 0 && progress < 1);
        last = progress;
    }
    expect(bvhd_batch_progress(batch, 0) == 1, "a result whose progress is not 1");
    expect(bvhd_batch_result(batch, 0)->error.status == BVHD_OK, "no result");
    bvhd_batch_destroy(batch);
    return is_part;
}

/* A fast machine may be done before the daemon tells anything, so the builds become longer. */
static void progress_is_told(void)
{
    struct bvhd_client *client = connect_client();
    bool is_told = false;
    uint32_t seed = 900;
    for (uint32_t triangles = long_build(); !is_told && seed < 905; triangles *= 2) {
        struct terrain terrain;
        terrain_init(&terrain, triangles, ++seed);
        is_told = is_told_of_parts(client, &terrain);
        terrain_finish(&terrain);
    }
    expect(is_told, "no progress of a long build");
    bvhd_client_destroy(client);
}

int main(int argc, char **argv)
{
    struct terrain terrain;
    if (argc < 2)
        return 2;
    service_process_start(&service, argv[1], NULL);
    terrain_init(&terrain, 20000, 1);
    many_at_once(&terrain);
    terrain_finish(&terrain);
    static const long moments[] = {0, 2, 10, 40, 120};
    uint32_t seed = 10;
    for (int way = DIES; way <= DESTROYS; way++)
        for (size_t i = 0; i < sizeof moments / sizeof *moments; i++) {
            terrain_init(&terrain, long_build(), ++seed);
            first_leaves(&terrain, (enum way)way, moments[i]);
            terrain_finish(&terrain);
        }
    progress_is_told();
    expect(service_process_stop(&service), "the daemon did not exit cleanly");
    return failures ? 1 : 0;
}
