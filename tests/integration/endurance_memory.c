/* SPDX-License-Identifier: Apache-2.0 */
/*
 * endurance_memory.c - tests that a daemon's memory stays within its budget under load, and does not grow: its own
 * memory as the kernel counts it, and the results that it or its clients hold.
 *
 *     endurance_memory BVHD [ROUNDS [PERCENT]]
 *
 * The load comes in rounds of equal requests for ever different structures. The first rounds bring the daemon into its
 * steady state. In the others samples are taken all the time, and one when a round has ended and nothing is under way.
 * The mean of the second half may exceed that of the first by PERCENT. A few rounds differ by chance; hundreds do not.
 */
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include <bvhd/bvhd.h>

#include "tests/support/daemon/hostile.h"
#include "tests/support/daemon/process_view.h"
#include "tests/support/random.h"
#include "tests/support/scene/terrain.h"

enum { MIB = 1 << 20, CLIENTS = 8, REQUESTS = 10, HELD = 3, MEMORY_MIB = 256, CACHE_MIB = 32, SAMPLE_MS = 5 };
enum { SIZES = 4 };

static const uint32_t triangles[SIZES] = {100, 2000, 15000, 60000};
static const uint32_t weights[SIZES] = {12, 8, 6, 3};

static struct hostile hostile;
static pthread_barrier_t begins, ends;
static atomic_bool over;
static atomic_uint running;
static _Atomic uint64_t builds;

/* One client, on a thread of its own. */
struct load {
    pthread_t thread;
    struct bvhd_client *client;
    struct terrain meshes[SIZES];
    struct bvhd_blob *held[HELD];
    struct random random;
    uint32_t number;
    float change; /* makes each mesh another one */
};

static uint32_t below(struct load *load, uint32_t bound)
{
    return (uint32_t)(random_next(&load->random) % bound);
}

static uint32_t choose_size(struct load *load)
{
    uint32_t sum = 0, size = 0;
    for (uint32_t i = 0; i < SIZES; i++)
        sum += weights[i];
    for (uint32_t at = below(load, sum); at >= weights[size]; size++)
        at -= weights[size];
    return size;
}

static void build_one(struct load *load)
{
    struct terrain *mesh = &load->meshes[choose_size(load)];
    uint32_t slot = below(load, HELD);
    struct bvhd_build build = {.struct_size = sizeof build,
                               .info_count = 1,
                               .infos = &mesh->info,
                               .ranges = &mesh->ranges,
                               .quality = (enum bvhd_quality)(BVHD_QUALITY_FAST + below(load, 3))};
    struct bvhd_batch *batch = NULL;
    mesh->positions[2] = load->change += 1;
    if (bvhd_batch_submit(load->client, &build, &batch, NULL) != BVHD_OK)
        abort();
    bool cancels = below(load, 16) == 0;
    if (cancels)
        bvhd_batch_cancel(batch);
    bvhd_batch_wait(batch, -1);
    const struct bvhd_result *result = bvhd_batch_result(batch, 0);
    hostile_expect(cancels || result->error.status == BVHD_OK, "%s: %s", result->error.where, result->error.text);
    bvhd_blob_unref(load->held[slot]);
    load->held[slot] = bvhd_blob_ref(result->blob);
    bvhd_batch_destroy(batch);
    atomic_fetch_add(&builds, 1);
}

static void drop_held(struct load *load)
{
    for (uint32_t i = 0; i < HELD; i++) {
        bvhd_blob_unref(load->held[i]);
        load->held[i] = NULL;
    }
    bvhd_client_ping(load->client, -1, NULL, NULL); /* tells the daemon */
}

static void *run_rounds(void *argument)
{
    struct load *load = argument;
    for (;;) {
        pthread_barrier_wait(&begins);
        if (atomic_load(&over))
            return NULL;
        load->random.state = load->number; /* the same requests in each round */
        for (uint32_t i = 0; i < REQUESTS; i++)
            build_one(load);
        drop_held(load);
        atomic_fetch_sub(&running, 1);
        pthread_barrier_wait(&ends);
    }
}

static void start(struct load *load, uint32_t number)
{
    struct bvhd_client_options options = {
        .struct_size = sizeof options, .socket_path = hostile.service.socket, .local = BVHD_LOCAL_NEVER};
    *load = (struct load){.number = number + 1, .change = (float)(number << 18)};
    for (uint32_t i = 0; i < SIZES; i++)
        terrain_init(&load->meshes[i], triangles[i], number + 1);
    if (bvhd_client_create(&options, &load->client, NULL) != BVHD_OK ||
        pthread_create(&load->thread, NULL, run_rounds, load) != 0)
        exit(1);
}

static void finish(struct load *load)
{
    pthread_join(load->thread, NULL);
    bvhd_client_destroy(load->client);
    for (uint32_t i = 0; i < SIZES; i++)
        terrain_finish(&load->meshes[i]);
}

static double sample(double *ret_own)
{
    const pid_t pids[] = {hostile.service.pid, getpid()};
    *ret_own = (double)process_private_bytes(pids[0]) / MIB;
    return *ret_own + (double)process_result_bytes(pids, 2) / MIB;
}

/* Samples of one half of the rounds, in MiB. */
struct half {
    double sum, most, quiet_sum, quiet_most;
    uint32_t count, rounds;
};

static double mean(const struct half *half)
{
    return half->sum / half->count;
}

static void wait_until_idle(void)
{
    while (hostile_counter(&hostile, "jobs_running") + hostile_counter(&hostile, "queue_depth") > 0)
        nanosleep(&(struct timespec){.tv_nsec = SAMPLE_MS * 1000000}, NULL);
}

static void run_round(struct half *half)
{
    double own;
    atomic_store(&running, CLIENTS);
    pthread_barrier_wait(&begins);
    while (atomic_load(&running) > 0) {
        double value = sample(&own);
        half->sum += value;
        half->count++;
        half->most = value > half->most ? value : half->most;
        nanosleep(&(struct timespec){.tv_nsec = SAMPLE_MS * 1000000}, NULL);
    }
    pthread_barrier_wait(&ends);
    wait_until_idle();
    double quiet = sample(&own);
    half->quiet_sum += quiet;
    half->quiet_most = quiet > half->quiet_most ? quiet : half->quiet_most;
    half->rounds++;
}

int main(int argc, char **argv)
{
    static struct load loads[CLIENTS];
    static const char *const options[] = {"--workers", "4", "--memory", "256M", "--cache-size", "32M", NULL};
    uint32_t rounds = argc > 2 ? (uint32_t)atoi(argv[2]) : 60;
    double percent = argc > 3 ? atof(argv[3]) : 15;
    struct half warm = {0}, halves[2] = {{0}};
    if (argc < 2)
        return 2;
    signal(SIGPIPE, SIG_IGN);
    setvbuf(stdout, NULL, _IOLBF, 0);
    hostile_begin(&hostile, argv[1], options);
    pthread_barrier_init(&begins, NULL, CLIENTS + 1);
    pthread_barrier_init(&ends, NULL, CLIENTS + 1);
    for (uint32_t i = 0; i < CLIENTS; i++)
        start(&loads[i], i);
    for (uint32_t i = 0; i < rounds / 3; i++)
        run_round(&warm);
    for (uint32_t i = 0; i < 2 * (rounds / 3); i++)
        run_round(&halves[i >= rounds / 3]);
    for (int i = 0; i < 2; i++)
        printf("half %d: %u samples, mean %.1f MiB, most %.1f; after each round mean %.1f, most %.1f\n", i + 1,
               halves[i].count, mean(&halves[i]), halves[i].most, halves[i].quiet_sum / halves[i].rounds,
               halves[i].quiet_most);
    double most = halves[0].most > halves[1].most ? halves[0].most : halves[1].most, budget = MEMORY_MIB + CACHE_MIB;
    double growth = 100 * (mean(&halves[1]) / mean(&halves[0]) - 1);
    printf("%llu structures: at most %.1f MiB of %.0f; the second half has %+.2f %% of the first one's mean\n",
           (unsigned long long)atomic_load(&builds), most, budget, growth);
    hostile_expect(most <= 1.05 * budget, "more memory is in use than the budget and 5 %%");
    hostile_expect(growth <= percent, "the daemon grows by more than %.1f %%", percent);
    atomic_store(&over, true);
    pthread_barrier_wait(&begins);
    for (uint32_t i = 0; i < CLIENTS; i++)
        finish(&loads[i]);
    return hostile_end(&hostile) ? 1 : 0;
}
