/* SPDX-License-Identifier: Apache-2.0 */
/* service_share.c - bench_service's sections `many`, `small`, `cancel` and `death`. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "tests/bench/service_bench.h"

static void sleep_us(long us)
{
    struct timespec wait = {us / 1000000, us % 1000000 * 1000};
    nanosleep(&wait, NULL);
}

enum { MESHES = 640, MESH_SIZE = 2000 };

static struct terrain meshes[MESHES];
static VkAccelerationStructureBuildGeometryInfoKHR infos[MESHES];
static const VkAccelerationStructureBuildRangeInfoKHR *ranges[MESHES];

/* Milliseconds of one batch. */
struct share_times {
    double wall; /* from submission to the last result */
    double active; /* from the start of the first job to the end of the last */
    double busy; /* sum over all workers */
    double copying, receiving; /* processor time of the client's thread until the batch is submitted, and after that */
    double loop; /* processor time of the daemon's loop */
};

/* Milliseconds for which the calling thread has run. */
static double own_time(void)
{
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec * 1e-6;
}

/* Milliseconds for which the daemon's first thread has run, which is its loop. */
static double loop_time(pid_t pid)
{
    char path[64];
    unsigned long long ns = 0;
    snprintf(path, sizeof path, "/proc/%d/task/%d/schedstat", (int)pid, (int)pid);
    FILE *file = fopen(path, "r");
    if (!file || fscanf(file, "%llu", &ns) != 1)
        bench_fail("cannot read %s", path);
    fclose(file);
    return (double)ns * 1e-6;
}

static struct share_times time_batch(struct bvhd_client *client, pid_t daemon, const struct bvhd_build *build)
{
    struct bvhd_error error;
    struct bvhd_batch *batch;
    struct share_times times;
    uint64_t busy = bench_counter(client, "busy_ns"), active = bench_counter(client, "active_ns");
    double loop = loop_time(daemon), own = own_time(), begin = bench_now();
    if (bvhd_batch_submit(client, build, &batch, &error) != BVHD_OK)
        bench_fail("%s: %s", error.where, error.text);
    double submitted = own_time();
    bvhd_batch_wait(batch, -1);
    times.wall = bench_now() - begin;
    times.copying = submitted - own;
    times.receiving = own_time() - submitted;
    times.loop = loop_time(daemon) - loop;
    bench_finish(batch);
    times.busy = (double)(bench_counter(client, "busy_ns") - busy) * 1e-6;
    times.active = (double)(bench_counter(client, "active_ns") - active) * 1e-6;
    return times;
}

/* A daemon with `workers` workers, and the times of as many processes that share nothing. */
struct crew {
    unsigned workers;
    struct service_process process;
    struct bvhd_client *client;
    struct share_times best; /* of the run whose jobs took the least time */
    double apart; /* milliseconds, the least of all runs */
};

static void crew_start(struct crew *crew, const struct bench *bench, unsigned workers)
{
    *crew = (struct crew){.workers = workers, .best = {.active = 1e30}, .apart = 1e30};
    bench_start(bench, workers, "0", &crew->process);
    crew->client = bench_client(&crew->process);
}

static void crew_build(struct crew *crew)
{
    enum { PAUSE_US = 30000 }; /* longer than the daemon counts as active after a job */
    struct bvhd_build build = {.struct_size = sizeof build,
                               .info_count = MESHES,
                               .infos = infos,
                               .ranges = ranges,
                               .quality = BVHD_QUALITY_BALANCED,
                               .target = BVHD_TARGET_PORTABLE};
    double apart = bench_apart(meshes, MESHES, crew->workers);
    crew->apart = apart < crew->apart ? apart : crew->apart;
    sleep_us(PAUSE_US);
    struct share_times times = time_batch(crew->client, crew->process.pid, &build);
    crew->best = times.active < crew->best.active ? times : crew->best;
}

static void crew_stop(struct crew *crew)
{
    const struct share_times *times = &crew->best;
    char what[40];
    snprintf(what, sizeof what, "640 meshes, %u workers", crew->workers);
    bench_line(
        what,
        "first job to last %.1f ms, workers busy %.3f of it, client waits %.1f ms; as many processes apart %.1f ms",
        times->active, times->busy / times->active / crew->workers, times->wall, crew->apart);
    bench_line("  processor time a mesh", "worker %.1f us, loop %.1f, client until submitted %.1f and after that %.1f",
               times->busy * 1e3 / MESHES, times->loop * 1e3 / MESHES, times->copying * 1e3 / MESHES,
               times->receiving * 1e3 / MESHES);
    bvhd_client_destroy(crew->client);
    bench_stop(&crew->process);
}

void bench_many(const struct bench *bench)
{
    enum { ROUNDS = 7 };
    struct crew one, all;
    for (int i = 0; i < MESHES; i++) {
        terrain_init(&meshes[i], MESH_SIZE, (uint32_t)i + 100);
        infos[i] = meshes[i].info;
        ranges[i] = meshes[i].ranges;
    }
    unsigned workers = bench->workers ? bench->workers : (unsigned)sysconf(_SC_NPROCESSORS_ONLN);
    crew_start(&one, bench, 1);
    crew_start(&all, bench, workers);
    /* The crews alternate, because the speed of a machine varies over time. */
    for (int i = 0; i < ROUNDS; i++) {
        crew_build(&one);
        crew_build(&all);
    }
    crew_stop(&one);
    crew_stop(&all);
    bench_line("640 meshes, rates",
               "%.3f times that of %u single workers (goal: 0.85), as clients see it %.3f; processes apart %.3f times "
               "that of as many single ones",
               one.best.active / all.best.active / workers, workers, one.best.wall / all.best.wall / workers,
               one.apart / all.apart / workers);
    for (int i = 0; i < MESHES; i++)
        terrain_finish(&meshes[i]);
}

/*
 * Fills ret_ms with the times of small builds, each of a different mesh. Stops early when `big` is done. Returns the
 * number of builds.
 */
static int time_small(struct bvhd_client *client, struct bvhd_batch *big, uint32_t seed, double *ret_ms, int count)
{
    int done = 0;
    for (; done < count && !(big && bvhd_batch_is_done(big)); done++) {
        struct terrain terrain;
        terrain_init(&terrain, MESH_SIZE, seed + (uint32_t)done);
        double begin = bench_now();
        bench_finish(bench_submit(client, &terrain));
        ret_ms[done] = bench_now() - begin;
        terrain_finish(&terrain);
        sleep_us(5000);
    }
    return done;
}

void bench_small(const struct bench *bench)
{
    enum { TIMES = 300 };
    static double quiet[TIMES], beside[TIMES];
    struct service_process process;
    struct terrain terrain;
    bench_start(bench, 0, "0", &process);
    struct bvhd_client *client = bench_client(&process), *other = bench_client(&process);
    int quiet_count = time_small(client, NULL, 1000, quiet, TIMES), beside_count = 0;
    terrain_init(&terrain, 4000000, 3);
    for (int i = 0; i < 5 && beside_count < TIMES; i++) {
        struct bvhd_batch *big = bench_submit(other, &terrain);
        bvhd_batch_wait_copied(big, -1);
        beside_count +=
            time_small(client, big, 2000 + (uint32_t)beside_count, beside + beside_count, TIMES - beside_count);
        bvhd_batch_destroy(big);
    }
    terrain_finish(&terrain);
    double q50 = bench_quantile(quiet, quiet_count, 0.5), b50 = bench_quantile(beside, beside_count, 0.5);
    double q99 = bench_quantile(quiet, quiet_count, 0.99), b99 = bench_quantile(beside, beside_count, 0.99);
    bench_line("small job",
               "quiet p50 %.2f ms, p99 %.2f; beside 4 M triangles p50 %.2f ms, p99 %.2f, of %d (goal: p50 %.2f ms)",
               q50, q99, b50, b99, beside_count, 2 * q50 > q50 + 5 ? 2 * q50 : q50 + 5);
    bvhd_client_destroy(client);
    bvhd_client_destroy(other);
    bench_stop(&process);
}

static void await_counter(struct bvhd_client *client, const char *name, uint64_t value, double limit_ms)
{
    double begin = bench_now();
    while (bench_counter(client, name) != value) {
        if (bench_now() - begin > limit_ms)
            bench_fail("%s is not %llu after %.0f ms", name, (unsigned long long)value, limit_ms);
        sleep_us(200);
    }
}

enum { CANCELS = 200 };

static void print_cancels(const char *what, double *ms, const char *goal)
{
    double p99 = bench_quantile(ms, CANCELS, 0.99), most = bench_quantile(ms, CANCELS, 1),
           p50 = bench_quantile(ms, CANCELS, 0.5);
    bench_line(what, "p50 %.3f ms, p99 %.3f ms, most %.3f ms of %d (goal: p99 %s)", p50, p99, most, CANCELS, goal);
}

/* Wraps the first `triangles` triangles of a terrain as a separate request. */
static void take_slice(const struct terrain *whole, uint32_t triangles, struct terrain *ret_slice)
{
    terrain_wrap(ret_slice, whole->positions, whole->vertex_count, whole->indices, triangles);
}

/* The victims are too large for a thread that is free beside the running jobs, so they wait in the queue. */
static void cancel_queued(struct bvhd_client *client, const struct terrain *big)
{
    enum { AHEAD = 6, EACH = 20 };
    static double ms[CANCELS];
    struct bvhd_batch *ahead[AHEAD];
    struct terrain slices[AHEAD], victim;
    for (int i = 0; i < CANCELS; i++) {
        for (int k = 0; k < AHEAD && i % EACH == 0; k++) {
            take_slice(big, big->triangle_count - (uint32_t)(i + k), &slices[k]);
            ahead[k] = bench_submit(client, &slices[k]);
            bvhd_batch_wait_copied(ahead[k], -1);
        }
        take_slice(big, big->triangle_count / 5 + (uint32_t)i, &victim);
        struct bvhd_batch *batch = bench_submit(client, &victim);
        bvhd_batch_wait(batch, 1);
        double begin = bench_now();
        bvhd_batch_cancel(batch);
        bvhd_batch_wait(batch, -1);
        ms[i] = bench_now() - begin;
        bvhd_batch_destroy(batch);
        for (int k = 0; k < AHEAD && i % EACH == EACH - 1; k++)
            bvhd_batch_destroy(ahead[k]);
    }
    print_cancels("cancel, queued", ms, "1 ms");
}

/* Measures from the call until no worker works on the build any more. */
static void cancel_running(struct bvhd_client *client, const struct terrain *big)
{
    static double answered[CANCELS], ended[CANCELS];
    for (int i = 0; i < CANCELS; i++) {
        struct bvhd_batch *batch = bench_submit(client, big);
        bvhd_batch_wait_copied(batch, -1);
        await_counter(client, "jobs_running", 1, 10000);
        sleep_us(1000L * (i % 50) * 8);
        double begin = bench_now();
        bvhd_batch_cancel(batch);
        bvhd_batch_wait(batch, -1);
        answered[i] = bench_now() - begin;
        await_counter(client, "jobs_running", 0, 10000);
        ended[i] = bench_now() - begin;
        bvhd_batch_destroy(batch);
    }
    print_cancels("cancel, running: answered", answered, "50 ms");
    print_cancels("cancel, running: workers free", ended, "50 ms");
}

void bench_cancels(const struct bench *bench)
{
    struct service_process process;
    struct terrain big;
    bench_start(bench, 0, "0", &process);
    struct bvhd_client *client = bench_client(&process);
    terrain_init(&big, 1500000, 4);
    cancel_queued(client, &big);
    await_counter(client, "jobs_running", 0, 10000);
    cancel_running(client, &big);
    terrain_finish(&big);
    bvhd_client_destroy(client);
    bench_stop(&process);
}

static pid_t start_victim(const struct service_process *process, const struct terrain *big)
{
    pid_t pid = fork();
    if (pid == 0) {
        struct bvhd_client *client = bench_client(process);
        bench_finish(bench_submit(client, big));
        _exit(0);
    }
    if (pid < 0)
        bench_fail("cannot fork");
    return pid;
}

void bench_deaths(const struct bench *bench)
{
    enum { TIMES = 30 };
    static double ms[TIMES];
    struct service_process process;
    struct terrain big;
    bench_start(bench, 0, "0", &process);
    struct bvhd_client *client = bench_client(&process);
    terrain_init(&big, 1500000, 5);
    uint64_t memory = bench_counter(client, "memory_live"), pools = bench_counter(client, "pool_bytes");
    for (int i = 0; i < TIMES; i++) {
        pid_t victim = start_victim(&process, &big);
        await_counter(client, "jobs_running", 1, 10000);
        sleep_us(15000L * i);
        double begin = bench_now();
        kill(victim, SIGKILL);
        await_counter(client, "connections", 1, 10000);
        await_counter(client, "jobs_running", 0, 10000);
        await_counter(client, "pool_bytes", pools, 10000);
        await_counter(client, "memory_live", memory, 10000);
        ms[i] = bench_now() - begin;
        waitpid(victim, NULL, 0);
    }
    double most = bench_quantile(ms, TIMES, 1), p50 = bench_quantile(ms, TIMES, 0.5);
    bench_line("client killed: all free", "p50 %.1f ms, most %.1f ms of %d (goal: 100 ms)", p50, most, TIMES);
    terrain_finish(&big);
    bvhd_client_destroy(client);
    bench_stop(&process);
}
