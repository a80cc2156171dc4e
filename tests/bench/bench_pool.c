/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bench_pool - measures how well the daemon's pool keeps its threads busy, and how long a small job waits.
 *
 *     bench_pool [THREADS]
 *
 * THREADS defaults to the number of processors. The ratios are meant for a quiet machine; a run takes about 15 seconds.
 *
 *   scaling   640 jobs of about 1 ms in one flow: the rate with THREADS, divided by THREADS times the rate with 1
 *             thread; the median of several runs. Beside it stand the same ratio for plain threads that share a
 *             counter, which shows what the machine can give, and the fraction of the time that the pool's threads
 *             spend in jobs, which a busy machine does not change.
 *   beside    a 1 ms job of another flow while tasks of 25 ms fill all workers: time from submission to done, compared
 *             with a quiet pool
 *   start     time from submission to the start of a job on an idle pool
 *   share     fraction of all time that a client with one large job gets beside a client with a flood of small ones
 */
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

#include "daemon/pool/pool.h"
#include "proto/base/processor.h"

enum { JOBS = 640, RUNS = 5, SMALL_SAMPLES = 100, START_SAMPLES = 1000, LARGE = 4000000, SMALL = 2000 };

struct work {
    struct pool_job job;
    double milliseconds;
    unsigned tasks; /* 0: run() does the work itself */
    bool is_done;
};

struct bench {
    struct pool *pool;
    struct pool_flow *flow, *other_flow;
    int woken; /* an eventfd */
};

static double rounds_a_millisecond;

static uint64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

static void compute(double rounds)
{
    volatile uint32_t sink;
    uint32_t value = 1;
    for (uint64_t i = 0; i < (uint64_t)rounds; i++)
        value = value * 1664525u + 1013904223u;
    sink = value;
    (void)sink;
}

static void calibrate(void)
{
    double best = 0;
    for (int i = 0; i < 20; i++) {
        uint64_t begin = now_ns();
        compute(1e6);
        double rate = 1e6 / ((double)(now_ns() - begin) * 1e-6);
        best = rate > best ? rate : best;
    }
    rounds_a_millisecond = best;
}

static void fail(const char *what)
{
    fprintf(stderr, "bench_pool: %s\n", what);
    exit(1);
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double quantile(double *values, int count, double part)
{
    qsort(values, (size_t)count, sizeof *values, by_value);
    return values[(int)((count - 1) * part)];
}

static void pass_on(void *context)
{
    uint64_t one = 1;
    if (write(*(int *)context, &one, sizeof one) != sizeof one)
        fail("eventfd");
}

static void start(struct bench *bench, unsigned threads)
{
    struct bvhd_error error;
    bench->woken = eventfd(0, EFD_CLOEXEC);
    if (pool_create(threads, pass_on, &bench->woken, &bench->pool, &error) != BVHD_OK)
        fail(error.text);
    bench->flow = pool_flow_create(bench->pool, NULL);
    bench->other_flow = pool_flow_create(bench->pool, NULL);
    if (!bench->flow || !bench->other_flow)
        fail("no memory");
}

static void stop(struct bench *bench)
{
    pool_flow_end(bench->pool, bench->flow);
    pool_flow_end(bench->pool, bench->other_flow);
    pool_destroy(bench->pool);
    close(bench->woken);
}

static void run_task(void *context, size_t index)
{
    struct work *work = context;
    (void)index;
    if (!atomic_load_explicit(&work->job.cancel, memory_order_relaxed))
        compute(work->milliseconds * rounds_a_millisecond);
}

static void run_work(struct pool_job *job, const struct parallel *parallel)
{
    struct work *work = (struct work *)job;
    if (work->tasks)
        parallel_for(parallel, work->tasks, run_task, work);
    else
        compute(work->milliseconds * rounds_a_millisecond);
}

static void note_done(struct pool_job *job)
{
    ((struct work *)job)->is_done = true;
}

static void submit(struct bench *bench, struct work *work, struct pool_flow *flow, uint64_t size)
{
    work->job.run = run_work;
    work->job.done = note_done;
    work->job.flow = flow;
    work->job.size = size;
    pool_submit(bench->pool, &work->job);
}

static void collect_until_done(struct bench *bench, const struct work *work)
{
    uint64_t count;
    while (!work->is_done) {
        if (read(bench->woken, &count, sizeof count) != sizeof count)
            fail("eventfd");
        pool_collect(bench->pool);
    }
}

/* Milliseconds from the first start to the last end; *ret_busy is the fraction of it that the threads spent in jobs. */
static double pool_span(unsigned threads, double *ret_busy)
{
    struct bench bench;
    uint64_t first = UINT64_MAX, last = 0, inside = 0;
    struct work *works = calloc(JOBS, sizeof *works);
    if (!works)
        fail("no memory");
    start(&bench, threads);
    for (int i = 0; i < JOBS; i++) {
        works[i].milliseconds = 1;
        submit(&bench, &works[i], bench.flow, SMALL);
    }
    for (int i = 0; i < JOBS; i++) {
        collect_until_done(&bench, &works[i]);
        first = works[i].job.started_ns < first ? works[i].job.started_ns : first;
        last = works[i].job.ended_ns > last ? works[i].job.ended_ns : last;
        inside += works[i].job.ended_ns - works[i].job.started_ns;
    }
    stop(&bench);
    free(works);
    *ret_busy = (double)inside / ((double)(last - first) * threads);
    return (double)(last - first) * 1e-6;
}

static void *share_counter(void *context)
{
    while (atomic_fetch_add((atomic_int *)context, 1) < JOBS)
        compute(rounds_a_millisecond);
    return NULL;
}

static double plain_span(unsigned threads)
{
    pthread_t others[POOL_MAX_THREADS];
    atomic_int next = 0;
    uint64_t begin = now_ns();
    for (unsigned i = 1; i < threads; i++)
        if (pthread_create(&others[i], NULL, share_counter, &next))
            fail("no thread");
    share_counter(&next);
    for (unsigned i = 1; i < threads; i++)
        pthread_join(others[i], NULL);
    return (double)(now_ns() - begin) * 1e-6;
}

static void bench_scaling(unsigned threads)
{
    double pool[RUNS], plain[RUNS], busy[RUNS];
    for (int i = 0; i < RUNS; i++) {
        double one = pool_span(1, &busy[i]);
        pool[i] = one / pool_span(threads, &busy[i]) / threads;
        plain[i] = plain_span(1) / plain_span(threads) / threads;
    }
    double usual = quantile(pool, RUNS, 0.5), plain_usual = quantile(plain, RUNS, 0.5);
    printf("scaling: %.3f with %u threads (least %.3f), which are in jobs for %.4f of the time; plain threads %.3f\n",
           usual, threads, pool[0], quantile(busy, RUNS, 0.5), plain_usual);
}

static double small_job(struct bench *bench)
{
    struct work small = {.milliseconds = 1};
    uint64_t begin = now_ns();
    submit(bench, &small, bench->other_flow, SMALL);
    collect_until_done(bench, &small);
    return (double)(now_ns() - begin) * 1e-6;
}

static void pause_for(double milliseconds)
{
    poll(NULL, 0, (int)milliseconds);
}

static void sample_small_jobs(struct bench *bench, double samples[SMALL_SAMPLES])
{
    for (int i = 0; i < SMALL_SAMPLES; i++) {
        pause_for(3 + i % 17);
        samples[i] = small_job(bench);
    }
}

static void bench_beside(unsigned threads)
{
    struct bench bench;
    double quiet[SMALL_SAMPLES], beside[SMALL_SAMPLES];
    start(&bench, threads);
    sample_small_jobs(&bench, quiet);
    struct work large = {.milliseconds = 25, .tasks = 10000000};
    submit(&bench, &large, bench.flow, LARGE);
    pause_for(100);
    sample_small_jobs(&bench, beside);
    pool_cancel(bench.pool, &large.job);
    collect_until_done(&bench, &large);
    stop(&bench);
    double usual = quantile(quiet, SMALL_SAMPLES, 0.5), limit = 2 * usual > usual + 5 ? 2 * usual : usual + 5;
    double median = quantile(beside, SMALL_SAMPLES, 0.5), late = quantile(beside, SMALL_SAMPLES, 0.9);
    printf("beside: quiet %.2f ms, beside 25 ms tasks median %.2f p90 %.2f most %.2f ms; median / max(2 x quiet, quiet "
           "+ 5 ms) %.3f\n",
           usual, median, late, beside[SMALL_SAMPLES - 1], median / limit);
}

static void bench_start(unsigned threads)
{
    struct bench bench;
    double waits[START_SAMPLES], replies[START_SAMPLES];
    start(&bench, threads);
    for (int i = 0; i < START_SAMPLES; i++) {
        struct work work = {0};
        pause_for(1);
        uint64_t begin = now_ns();
        submit(&bench, &work, bench.flow, SMALL);
        collect_until_done(&bench, &work);
        replies[i] = (double)(now_ns() - begin) * 1e-3;
        waits[i] = (double)(work.job.started_ns - work.job.submitted_ns) * 1e-3;
    }
    stop(&bench);
    double wait = quantile(waits, START_SAMPLES, 0.5), reply = quantile(replies, START_SAMPLES, 0.5);
    printf("start: median %.1f us p99 %.1f us after submission; done() median %.1f us p99 %.1f us\n", wait,
           quantile(waits, START_SAMPLES, 0.99), reply, quantile(replies, START_SAMPLES, 0.99));
}

/*
 * Two flows compete: one with a large job of many tasks, one with many small jobs. The measurement ends when all small
 * jobs have ended.
 */
static void bench_share(unsigned threads)
{
    struct bench bench;
    struct work *works = calloc(JOBS, sizeof *works);
    struct work large = {.milliseconds = 2, .tasks = 10000000};
    if (!works)
        fail("no memory");
    start(&bench, threads);
    submit(&bench, &large, bench.flow, LARGE);
    pause_for(20);
    uint64_t begin = now_ns(), busy = pool_load(bench.pool).busy_ns;
    double small = 0;
    for (int i = 0; i < JOBS; i++) {
        works[i].milliseconds = 1;
        submit(&bench, &works[i], bench.other_flow, SMALL);
    }
    for (int i = 0; i < JOBS; i++) {
        collect_until_done(&bench, &works[i]);
        small += (double)(works[i].job.ended_ns - works[i].job.started_ns) * 1e-6;
    }
    double wall = (double)(now_ns() - begin) * 1e-6, all = (double)(pool_load(bench.pool).busy_ns - busy) * 1e-6;
    pool_cancel(bench.pool, &large.job);
    collect_until_done(&bench, &large);
    stop(&bench);
    free(works);
    printf("share: one large job has %.3f of the time beside a flood of small ones (%.0f ms, %.2f threads busy)\n",
           1 - small / all, wall, all / wall);
}

int main(int argc, char **argv)
{
    long threads = argc > 1 ? atol(argv[1]) : (long)processor_count();
    if (argc > 2 || threads < 1 || threads > POOL_MAX_THREADS) {
        fprintf(stderr, "usage: bench_pool [THREADS]\n");
        return 2;
    }
    calibrate();
    bench_scaling((unsigned)threads);
    bench_beside((unsigned)threads);
    bench_start((unsigned)threads);
    bench_share((unsigned)threads);
    return 0;
}
