/* SPDX-License-Identifier: Apache-2.0 */
/*
 * endurance_memory.c - tests that a daemon's memory stays within its budget under a load that fills it, and does not
 * grow: its own memory as the kernel counts it, and all results that it or its clients hold.
 *
 *     endurance_memory BVHD [ROUNDS [PERCENT [MIB]]]
 *
 * MIB is the daemon's --memory; the load is in proportion to it. The budget is --memory, the cache, and the half of
 * --memory that clients may hold in results (SECURITY.md).
 *
 * The load comes in rounds of equal requests for ever different structures. Eight clients with the library begin with
 * large builds, so that these wait for each other's memory. They keep their results until the daemon starts nothing
 * more for them, and only then release some. As root there are four more users, whose connections read nothing, so that
 * their requests wait and then are refused, and which leave large frames unfinished. At the end of a round everything
 * is full; the daemon is stopped for a moment then, to count the results that lie in sockets.
 *
 * The first third of the rounds brings the daemon into its steady state. After each of the others the load rests until
 * the daemon has given back what it keeps for a while: then only the cache has results, and the daemon's own memory may
 * have grown by PERCENT of the budget in the last third. Means under load are printed only: they depend on how much
 * work there is between two times at which the daemon gives memory back, and so on what else the machine does.
 */
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include <bvhd/bvhd.h>

#include "tests/support/daemon/hostile.h"
#include "tests/support/daemon/process_view.h"
#include "tests/support/random.h"
#include "tests/support/scene/terrain.h"

enum { MIB = 1 << 20, CLIENTS = 8, REQUESTS = 10, MOST_HELD = CLIENTS * REQUESTS, SAMPLE_MS = 5, PATIENCE_MS = 100 };
enum { SIZES = 4, CACHE_DIVISOR = 8, RESULTS_DIVISOR = 2 };

/* In triangles for each MiB of --memory. The last is the largest: three such builds do not fit beside each other. */
static const uint32_t sizes[SIZES] = {2, 60, 300, 1600};
static const uint32_t weights[SIZES] = {8, 6, 6, 3};

static struct hostile hostile;
static uint32_t memory_mib = 64;
static pthread_barrier_t begins, full, ends;
static atomic_bool over;
static atomic_uint running;
static _Atomic uint64_t builds;

/* ---- clients with the library ---- */

/* One client, on a thread of its own. */
struct load {
    pthread_t thread;
    struct bvhd_client *client;
    struct terrain meshes[SIZES];
    struct random random;
    uint32_t number;
    float change; /* makes each mesh another one */
};

/* The results that all clients hold, the oldest first. */
static struct {
    pthread_mutex_t mutex;
    struct {
        struct bvhd_blob *blob;
        struct bvhd_client *client;
    } results[MOST_HELD];
    uint32_t count;
} held = {.mutex = PTHREAD_MUTEX_INITIALIZER};

static void hold(struct load *load, struct bvhd_blob *blob)
{
    if (!blob)
        return;
    pthread_mutex_lock(&held.mutex);
    held.results[held.count].blob = bvhd_blob_ref(blob);
    held.results[held.count++].client = load->client;
    pthread_mutex_unlock(&held.mutex);
}

/* Releases the oldest results, and lets their clients tell the daemon. */
static void release(uint32_t count)
{
    pthread_mutex_lock(&held.mutex);
    count = count < held.count ? count : held.count;
    for (uint32_t i = 0; i < count; i++) {
        bvhd_blob_unref(held.results[i].blob);
        bvhd_client_ping(held.results[i].client, -1, NULL, NULL);
    }
    held.count -= count;
    memmove(held.results, held.results + count, held.count * sizeof *held.results);
    pthread_mutex_unlock(&held.mutex);
}

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

static void build_one(struct load *load, uint32_t size)
{
    struct terrain *mesh = &load->meshes[size];
    struct bvhd_build build = {.struct_size = sizeof build,
                               .info_count = 1,
                               .infos = &mesh->info,
                               .ranges = &mesh->ranges,
                               .quality = (enum bvhd_quality)(BVHD_QUALITY_FAST + below(load, size < 2 ? 3 : 2))};
    struct bvhd_batch *batch = NULL;
    mesh->positions[2] = load->change += 1;
    if (bvhd_batch_submit(load->client, &build, &batch, NULL) != BVHD_OK)
        abort();
    bool cancels = below(load, 16) == 0;
    if (cancels)
        bvhd_batch_cancel(batch);
    while (bvhd_batch_wait(batch, PATIENCE_MS) == BVHD_PENDING)
        release(4);
    const struct bvhd_result *result = bvhd_batch_result(batch, 0);
    hostile_expect(cancels || result->error.status == BVHD_OK, "%s: %s", result->error.where, result->error.text);
    hold(load, result->blob);
    bvhd_batch_destroy(batch);
    atomic_fetch_add(&builds, 1);
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
            build_one(load, i == 0 ? SIZES - 1 : choose_size(load));
        atomic_fetch_sub(&running, 1);
        pthread_barrier_wait(&full);
        pthread_barrier_wait(&ends);
    }
}

static void start(struct load *load, uint32_t number)
{
    struct bvhd_client_options options = {
        .struct_size = sizeof options, .socket_path = hostile.service.socket, .local = BVHD_LOCAL_NEVER};
    *load = (struct load){.number = number + 1, .change = (float)(number << 18)};
    for (uint32_t i = 0; i < SIZES; i++)
        terrain_init(&load->meshes[i], sizes[i] * memory_mib, number + 1);
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

/* ---- users who read nothing ---- */

enum { FIRST_USER = 1001, USERS = 4, HOARDERS = 2 * USERS, HOARDED = 24, UNFINISHED = 8 };

static struct raw_client hoarders[HOARDERS], unfinished[UNFINISHED];

/*
 * Asks for more results than users may leave unread, then for others with large payloads. What waits has twice as many
 * bytes in frames as there may be (an eighth of --memory), so that some of it is refused.
 */
static void hoard(uint32_t round)
{
    uint32_t boxes = memory_mib * 200, count = HOARDED + memory_mib / 4 * MIB / FRAME_MAX_INLINE / HOARDERS;
    uint32_t seed = round * HOARDERS * count;
    for (uint32_t i = 0; i < HOARDERS; i++)
        hostile_connect_as(&hostile, &hoarders[i], FIRST_USER + i % USERS);
    for (uint32_t i = 0; i < HOARDERS; i++)
        for (uint32_t k = 0; k < count; k++)
            raw_build_boxes(&hoarders[i], boxes, ++seed, k < HOARDED ? RAW_BOXES_PAYLOAD : FRAME_MAX_INLINE);
}

static void leave_unfinished(void)
{
    static unsigned char frame[FRAME_HEADER_SIZE + FRAME_MAX_CONTROL];
    frame_header_write(&(struct frame_header){.type = FRAME_BUILD, .request = 7, .control_size = FRAME_MAX_CONTROL},
                       frame);
    for (uint32_t i = 0; i < UNFINISHED; i++) {
        ssize_t part = 1;
        hostile_connect_as(&hostile, &unfinished[i], FIRST_USER + i % USERS);
        for (size_t sent = 0; part > 0 && sent < sizeof frame - 1; sent += (size_t)part)
            part = send(unfinished[i].socket, frame + sent, sizeof frame - 1 - sent, MSG_DONTWAIT | MSG_NOSIGNAL);
    }
}

/* Descriptors that were read. */
struct unread {
    int descriptors[4096];
    uint32_t count;
};

/* Reads what lies in the socket of a daemon that is stopped. */
static void read_unread(struct raw_client *client, struct unread *unread)
{
    struct frame frame;
    while (raw_receive(client, 0, &frame, NULL))
        for (int i = 0; i < frame.header.descriptors; i++)
            unread->descriptors[unread->count++] = frame.descriptors[i];
}

static void leave(void)
{
    for (int i = 0; i < HOARDERS; i++)
        raw_close(&hoarders[i]);
    for (int i = 0; i < UNFINISHED; i++)
        raw_close(&unfinished[i]);
}

/* ---- what is in use ---- */

/* In MiB. */
struct sample {
    double own, results;
};

static struct sample take_sample(void)
{
    const pid_t pids[] = {hostile.service.pid, getpid()};
    return (struct sample){(double)process_private_bytes(pids[0]) / MIB, (double)process_result_bytes(pids, 2) / MIB};
}

/* The same, with the results that nobody has read. */
static struct sample take_whole_sample(void)
{
    static struct unread unread;
    kill(hostile.service.pid, SIGSTOP);
    for (int i = 0; raw_can_be_others() && i < HOARDERS; i++)
        read_unread(&hoarders[i], &unread);
    struct sample sample = take_sample();
    kill(hostile.service.pid, SIGCONT);
    while (unread.count > 0)
        close(unread.descriptors[--unread.count]);
    return sample;
}

/* Samples of one half of the rounds. */
struct half {
    double sum, most, most_own, most_results, full_sum;
    struct sample rest;
    uint32_t count, rounds;
    uint64_t refused;
};

static double add(struct half *half, struct sample sample)
{
    double whole = sample.own + sample.results;
    half->most = whole > half->most ? whole : half->most;
    half->most_own = sample.own > half->most_own ? sample.own : half->most_own;
    half->most_results = sample.results > half->most_results ? sample.results : half->most_results;
    return whole;
}

static void wait_until_idle(void)
{
    while (hostile_counter(&hostile, "jobs_running") + hostile_counter(&hostile, "queue_depth") > 0)
        nanosleep(&(struct timespec){.tv_nsec = SAMPLE_MS * 1000000}, NULL);
}

/*
 * Waits until the daemon's own memory is at most `enough` MiB, for a minute, and falls no more: no sample of 4 s is the
 * least so far. Returns the least one.
 */
static struct sample rest(double enough)
{
    enum { PATIENT_SAMPLES = 40, MOST_SAMPLES = 600 };
    struct sample least = take_sample();
    int since = 0;
    for (int i = 0; since < PATIENT_SAMPLES || (least.own > enough && i < MOST_SAMPLES); i++) {
        nanosleep(&(struct timespec){.tv_nsec = 100000000}, NULL);
        struct sample sample = take_sample();
        since = sample.own < least.own ? 0 : since + 1;
        least = sample.own < least.own ? sample : least;
    }
    return least;
}

static void run_round(struct half *half, uint32_t round)
{
    uint64_t refused = hostile_counter(&hostile, "refused");
    atomic_store(&running, CLIENTS);
    pthread_barrier_wait(&begins);
    if (raw_can_be_others()) {
        hoard(round);
        leave_unfinished();
    }
    while (atomic_load(&running) > 0) {
        half->sum += add(half, take_sample());
        half->count++;
        nanosleep(&(struct timespec){.tv_nsec = SAMPLE_MS * 1000000}, NULL);
    }
    pthread_barrier_wait(&full);
    half->full_sum += add(half, take_whole_sample());
    half->refused += hostile_counter(&hostile, "refused") - refused;
    release(MOST_HELD);
    if (raw_can_be_others())
        leave();
    pthread_barrier_wait(&ends);
    wait_until_idle();
    half->rounds++;
}

static double mean(const struct half *half)
{
    return half->sum / half->count;
}

static double budget(void)
{
    return memory_mib + memory_mib / CACHE_DIVISOR + memory_mib / RESULTS_DIVISOR;
}

static void judge(const struct half halves[2], double percent)
{
    double most = halves[0].most > halves[1].most ? halves[0].most : halves[1].most;
    double growth = 100 * (halves[1].rest.own - halves[0].rest.own) / budget();
    for (int i = 0; i < 2; i++) {
        const struct half *half = &halves[i];
        printf("half %d: %u samples, mean %.1f MiB, most %.1f (own %.1f, results %.1f), full %.1f, at rest %.2f "
               "(results %.2f); %llu refusals\n",
               i + 1, half->count, mean(half), half->most, half->most_own, half->most_results,
               half->full_sum / half->rounds, half->rest.own + half->rest.results, half->rest.results,
               (unsigned long long)half->refused);
        hostile_expect(half->rest.results <= 1.05 * memory_mib / CACHE_DIVISOR, "results of nobody are there");
        hostile_expect(half->refused > 0 || !raw_can_be_others(), "nothing was refused, so the load was too small");
    }
    printf("%llu structures: at most %.1f MiB of %.0f; own memory at rest has grown by %+.2f %%\n",
           (unsigned long long)atomic_load(&builds), most, budget(), growth);
    hostile_expect(most <= 1.05 * budget(), "more memory is in use than the budget and 5 %%");
    hostile_expect(growth <= percent, "the daemon grows by more than %.1f %%", percent);
}

int main(int argc, char **argv)
{
    static struct load loads[CLIENTS];
    uint32_t rounds = argc > 2 ? (uint32_t)atoi(argv[2]) : 60;
    double percent = argc > 3 ? atof(argv[3]) : 1;
    struct half warm = {0}, halves[2] = {{0}};
    char memory[16], cache[16];
    if (argc < 2)
        return 2;
    memory_mib = argc > 4 ? (uint32_t)atoi(argv[4]) : memory_mib;
    snprintf(memory, sizeof memory, "%uM", memory_mib);
    snprintf(cache, sizeof cache, "%uM", memory_mib / CACHE_DIVISOR);
    const char *const options[] = {"--workers", "4", "--memory", memory, "--cache-size", cache, NULL};
    signal(SIGPIPE, SIG_IGN);
    setvbuf(stdout, NULL, _IOLBF, 0);
    if (!raw_can_be_others())
        puts("users who read nothing are left out, since only root can connect as several users");
    hostile_begin(&hostile, argv[1], options);
    pthread_barrier_init(&begins, NULL, CLIENTS + 1);
    pthread_barrier_init(&full, NULL, CLIENTS + 1);
    pthread_barrier_init(&ends, NULL, CLIENTS + 1);
    for (uint32_t i = 0; i < CLIENTS; i++)
        start(&loads[i], i);
    for (uint32_t i = 0; i < rounds / 3; i++)
        run_round(&warm, i);
    for (int k = 0; k < 2; k++) {
        for (uint32_t i = 0; i < rounds / 3; i++)
            run_round(&halves[k], rounds * (uint32_t)(k + 1) + i);
        halves[k].rest = rest(k == 0 ? HUGE_VAL : halves[0].rest.own + percent / 100 * budget());
    }
    judge(halves, percent);
    atomic_store(&over, true);
    pthread_barrier_wait(&begins);
    for (uint32_t i = 0; i < CLIENTS; i++)
        finish(&loads[i]);
    return hostile_end(&hostile) ? 1 : 0;
}
