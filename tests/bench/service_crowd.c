/* SPDX-License-Identifier: Apache-2.0 */
/* service_crowd.c - bench_service's section `crowd`: how many hits a second all clients get together. */
#include <dirent.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "tests/bench/service_bench.h"

enum { CLIENTS_MOST = 8, MEASURED_MS = 1000, THREADS_MOST = 256 };

/* Memory that the processes of all clients share. */
struct crowd {
    atomic_uint ready;
    atomic_bool go, stop;
    atomic_ullong hits;
};

static void sleep_ms(long ms)
{
    struct timespec wait = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&wait, NULL);
}

static void fetch(struct bvhd_client *client, const struct bvhd_key *key)
{
    struct bvhd_batch *batch;
    struct bvhd_error error;
    if (bvhd_batch_fetch(client, 1, key, &batch, &error) != BVHD_OK)
        bench_fail("%s", error.text);
    bench_finish(batch);
}

/* Is one of the clients, in a process of its own: fetches one result until it is stopped. */
static void be_client(const struct service_process *process, const struct bvhd_key *key, struct crowd *crowd)
{
    struct bvhd_client *client = bench_client(process);
    unsigned long long hits = 0;
    fetch(client, key);
    atomic_fetch_add(&crowd->ready, 1);
    while (!atomic_load(&crowd->go))
        sleep_ms(1);
    for (; !atomic_load(&crowd->stop); hits++)
        fetch(client, key);
    atomic_fetch_add(&crowd->hits, hits);
    bvhd_client_destroy(client);
    _exit(0);
}

/* What a thread of the daemon is called, and the clock ticks that it has run for. */
struct thread {
    long id, ticks;
    char name[32];
};

static int list_threads(pid_t pid, struct thread ret_threads[THREADS_MOST])
{
    char path[64];
    int count = 0;
    snprintf(path, sizeof path, "/proc/%d/task", (int)pid);
    DIR *directory = opendir(path);
    for (struct dirent *entry; directory && count < THREADS_MOST && (entry = readdir(directory));) {
        struct thread thread = {.id = atol(entry->d_name)};
        long user, system;
        snprintf(path, sizeof path, "/proc/%d/task/%ld/stat", (int)pid, thread.id);
        FILE *file = thread.id > 0 ? fopen(path, "r") : NULL;
        if (!file)
            continue;
        if (fscanf(file, "%*d (%31[^)]) %*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %ld %ld", thread.name, &user,
                   &system) == 3) {
            thread.ticks = user + system;
            ret_threads[count++] = thread;
        }
        fclose(file);
    }
    if (directory)
        closedir(directory);
    return count;
}

/* Returns the thread that ran longest since `before`, with the ticks since then. */
static struct thread busiest_since(const struct thread *before, int before_count, pid_t pid)
{
    static struct thread now[THREADS_MOST];
    struct thread busiest = {.ticks = -1};
    const int count = list_threads(pid, now);
    for (int i = 0; i < count; i++) {
        for (int k = 0; k < before_count; k++)
            now[i].ticks -= now[i].id == before[k].id ? before[k].ticks : 0;
        busiest = now[i].ticks > busiest.ticks ? now[i] : busiest;
    }
    return busiest;
}

static void hits_of(const struct service_process *process, const struct bvhd_key *key, unsigned clients, uint64_t size)
{
    static struct thread before[THREADS_MOST];
    int status;
    struct crowd *crowd = mmap(NULL, sizeof *crowd, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (crowd == MAP_FAILED)
        bench_fail("no memory");
    pid_t pids[CLIENTS_MOST];
    for (unsigned i = 0; i < clients; i++) {
        pids[i] = fork();
        if (pids[i] == 0)
            be_client(process, key, crowd);
        if (pids[i] < 0)
            bench_fail("cannot fork");
    }
    while (atomic_load(&crowd->ready) < clients)
        sleep_ms(1);
    const int before_count = list_threads(process->pid, before);
    const double begin = bench_now();
    atomic_store(&crowd->go, true);
    sleep_ms(MEASURED_MS);
    atomic_store(&crowd->stop, true);
    const double ms = bench_now() - begin;
    const struct thread busiest = busiest_since(before, before_count, process->pid);
    for (unsigned i = 0; i < clients; i++)
        if (waitpid(pids[i], &status, 0) != pids[i] || status != 0)
            bench_fail("a client has failed");
    char what[40];
    snprintf(what, sizeof what, "hits by key, %u client%s", clients, clients > 1 ? "s" : "");
    bench_line(what, "%.1f KiB: %.0f a second; the daemon's busiest thread, %s, runs for %.2f of the time",
               (double)size / 1024, (double)crowd->hits / ms * 1e3, busiest.name,
               (double)busiest.ticks / (double)sysconf(_SC_CLK_TCK) / ms * 1e3);
    munmap(crowd, sizeof *crowd);
}

void bench_crowd(const struct bench *bench)
{
    static const uint32_t triangles[] = {18, 36000};
    struct service_process process;
    bench_start(bench, 0, "1G", &process);
    for (size_t i = 0; i < sizeof triangles / sizeof *triangles; i++) {
        struct terrain terrain;
        uint64_t size;
        terrain_init(&terrain, triangles[i], 7);
        struct bvhd_client *client = bench_client(&process);
        const struct bvhd_key key = bench_key(client, &terrain, &size);
        bvhd_client_destroy(client);
        for (unsigned clients = 1; clients <= CLIENTS_MOST; clients *= 2)
            hits_of(&process, &key, clients, size);
        terrain_finish(&terrain);
    }
    bench_stop(&process);
}
