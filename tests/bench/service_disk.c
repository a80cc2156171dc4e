/* SPDX-License-Identifier: Apache-2.0 */
/*
 * service_disk.c - the cache on disk: how soon a daemon with a full one answers, what a hit costs, and what a miss
 * costs beside a daemon without one.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "builder/store/generation.h"
#include "builder/store/store.h"
#include "builder/summary.h"
#include "tests/bench/service_bench.h"

/* How soon a client asks for the next result. */
struct pace {
    const char *name;
    long pause_us;
};

enum { STARTS = 9, HITS = 400, MISSES = 500 };

static char directory[] = "/tmp/bvhd-bench-XXXXXX";

/* The entries of this program need not outlive a crash of the machine, so the store's calls end up here. */
int fsync(int descriptor)
{
    (void)descriptor;
    return 0;
}

int fdatasync(int descriptor)
{
    (void)descriptor;
    return 0;
}

/* The daemon does not read the bytes of results, so any will do. */
static struct key key_of(uint32_t number)
{
    struct key key;
    for (int i = 0; i < 4; i++)
        bytes_put64(key.bytes + 8 * i, (number + 1) * UINT64_C(0x9e3779b97f4a7c15) >> i);
    return key;
}

static void put(struct store *store, uint32_t number, const void *payload, uint64_t size)
{
    unsigned char about[SUMMARY_SIZE];
    struct bvhd_error error;
    summary_write(&(struct summary){.target = TARGET_PORTABLE, .method = "ploc", .quality = QUALITY_BALANCED}, about);
    const struct store_entry entry = {.key = key_of(number), .summary = {about, sizeof about}, .size = size};
    if (store_put(store, &entry, payload, &error) != BVHD_OK)
        bench_fail("%s: %s", error.where, error.text);
}

static struct store *open_store(struct memory *memory)
{
    const struct store_options options = {
        .directory = directory, .generation = store_generation(), .budget = STORE_BUDGET_DEFAULT};
    struct store *store;
    struct bvhd_error error;
    memory_init(memory, UINT64_MAX);
    if (!mkdtemp(directory) || store_open(&options, memory, &store, &error) != BVHD_OK)
        bench_fail("%s: the cache cannot be made", directory);
    return store;
}

static void remove_store(void)
{
    char command[128];
    snprintf(command, sizeof command, "rm -rf '%s'", directory);
    if (system(command) != 0)
        bench_fail("%s cannot be removed", directory);
}

/* Fetches a result and returns how many milliseconds that took. */
static double fetch(struct bvhd_client *client, const struct key *key)
{
    struct bvhd_key wanted;
    struct bvhd_batch *batch;
    struct bvhd_error error;
    double begin = bench_now();
    memcpy(wanted.bytes, key->bytes, sizeof wanted.bytes);
    if (bvhd_batch_fetch(client, 1, &wanted, &batch, &error) != BVHD_OK)
        bench_fail("%s", error.text);
    bench_finish(batch);
    return bench_now() - begin;
}

static void start(const struct bench *bench, bool has_disk, const char *cache, struct service_process *ret_service)
{
    char count[16];
    snprintf(count, sizeof count, "%u", bench->workers ? bench->workers : 2);
    const char *const all[] = {"--cache-size", cache, "--workers", count, "--cache", directory, NULL};
    const char *const some[] = {"--cache-size", cache, "--workers", count, NULL};
    service_process_start(ret_service, bench->program, has_disk ? all : some);
}

/* Time from the start of the process to a result that the client has read. */
static void first_hits(const struct bench *bench)
{
    double ms[STARTS];
    for (uint32_t i = 0; i < STARTS; i++) {
        const struct key key = key_of(bench->entries / STARTS * i);
        struct service_process process;
        double begin = bench_now();
        start(bench, true, "1G", &process);
        struct bvhd_client *client = bench_client(&process);
        fetch(client, &key);
        ms[i] = bench_now() - begin;
        bvhd_client_destroy(client);
        bench_stop(&process);
    }
    double worst = bench_quantile(ms, STARTS, 1), median = bench_quantile(ms, STARTS, 0.5);
    bench_line("start to first hit", "%u entries: median %.0f ms, worst of %d %.0f ms (goal: 200 ms)", bench->entries,
               median, STARTS, worst);
}

/* Waits until the daemon has read the whole directory, which takes a processor for a while after its start. */
static void await_count(struct bvhd_client *client)
{
    const struct timespec pause = {.tv_nsec = 10 * 1000 * 1000};
    for (uint32_t counted = 0; !counted; nanosleep(&pause, NULL)) {
        struct bvhd_cache_state *state;
        struct bvhd_error error;
        if (bvhd_client_cache(client, BVHD_CACHE_SHOW, 0, -1, &state, &error) != BVHD_OK)
            bench_fail("%s", error.text);
        counted = state->counted;
        bvhd_cache_state_destroy(state);
    }
}

/*
 * Each of some entries, from `first` on, is fetched from disk, and the last one again and again from memory. The cache
 * in memory is small, because pages that a virtual machine has never used before cost several times as much as others.
 */
static void hits(const struct bench *bench, uint32_t first, uint64_t size, const struct pace *pace, const char *goal)
{
    static double us[2][HITS];
    const struct timespec pause = {.tv_nsec = pace->pause_us * 1000};
    struct service_process process;
    start(bench, true, "8M", &process);
    struct bvhd_client *client = bench_client(&process);
    await_count(client);
    for (int again = 0; again < 2; again++)
        for (uint32_t i = 0; i < HITS; i++) {
            const struct key key = key_of(first + (again ? HITS - 1 : i));
            us[again][i] = fetch(client, &key) * 1e3;
            if (pace->pause_us)
                nanosleep(&pause, NULL);
        }
    if (bench_counter(client, "hits_disk") != HITS || bench_counter(client, "hits_memory") != HITS)
        bench_fail("hits came from elsewhere");
    double p99 = bench_quantile(us[0], HITS, 0.99), p50 = bench_quantile(us[0], HITS, 0.5);
    bench_line(pace->name, "%.0f KiB: p50 %.0f us, p99 %.0f us (goal: p50 %s); again, from memory: p50 %.0f us",
               (double)size / 1024, p50, p99, goal, bench_quantile(us[1], HITS, 0.5));
    bvhd_client_destroy(client);
    bench_stop(&process);
}

/* Without a pause, the daemon also frees evicted results and prepares for others meanwhile. */
static void hits_at_each_pace(const struct bench *bench, uint32_t first, uint64_t size, const char *goal)
{
    static const struct pace paces[] = {{"hit from disk, without a pause", 0}, {"hit from disk, 2 ms apart", 2000}};
    for (size_t i = 0; i < sizeof paces / sizeof paces[0]; i++)
        hits(bench, first, size, &paces[i], goal);
}

/* Builds a mesh that no daemon has seen, and returns how many microseconds that took. */
static double build_new(struct bvhd_client *client, uint32_t seed)
{
    struct terrain terrain;
    terrain_init(&terrain, 18, seed);
    double begin = bench_now();
    bench_finish(bench_submit(client, &terrain));
    double us = (bench_now() - begin) * 1e3;
    terrain_finish(&terrain);
    return us;
}

/* Small builds by two daemons in turn. */
static void misses(const struct bench *bench)
{
    static double us[2][MISSES];
    struct service_process processes[2];
    struct bvhd_client *clients[2];
    for (int i = 0; i < 2; i++) {
        start(bench, i == 1, "0", &processes[i]);
        clients[i] = bench_client(&processes[i]);
    }
    for (int k = 0; k < MISSES; k++)
        for (int i = 0; i < 2; i++)
            us[i][k] = build_new(clients[i], 1000 + (uint32_t)k);
    for (int i = 0; i < 2; i++) {
        bvhd_client_destroy(clients[i]);
        bench_stop(&processes[i]);
    }
    double without = bench_quantile(us[0], MISSES, 0.5), with = bench_quantile(us[1], MISSES, 0.5);
    bench_line("miss, 18 triangles built", "p50 without a disk %.0f us, with one %.0f us: + %.0f us", without, with,
               with - without);
}

void bench_disk(const struct bench *bench)
{
    enum { SMALL = 1024, LARGE = 1 << 20 };
    static unsigned char payload[LARGE];
    struct memory memory;
    struct store *store = open_store(&memory);
    double begin = bench_now();
    for (uint32_t i = 0; i < bench->entries; i++)
        put(store, i, payload, SMALL);
    for (uint32_t i = 0; i < HITS; i++)
        put(store, bench->entries + i, payload, LARGE);
    store_close(store);
    bench_line("entries written", "unsynced, in %.1f s", (bench_now() - begin) / 1e3);
    first_hits(bench);
    hits_at_each_pace(bench, 0, SMALL, "none");
    hits_at_each_pace(bench, bench->entries, LARGE, "400 us");
    misses(bench);
    remove_store();
}
