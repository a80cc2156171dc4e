/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/oracle/oracle_timed.h"

#include <math.h>

#include "proto/base/clock.h"

enum { FEWEST_RAYS = 16 }; /* of a thread: below, fetching the primitives costs more than the tests */
static const double tests_a_second = 1.7e8; /* of a thread */
static const double first_seconds = 1; /* what the first portion takes at most, whose rate decides the others */

uint64_t oracle_work_tests(const struct oracle_work *work, uint32_t ray_count)
{
    uint64_t primitives = 0;
    for (uint32_t i = 0; i < work->mesh_count; i++)
        primitives += work->meshes[i].primitive_count;
    return primitives * ray_count;
}

double oracle_work_seconds(const struct oracle_work *work, uint32_t ray_count)
{
    return (double)oracle_work_tests(work, ray_count) / (tests_a_second * work->parallel->threads);
}

/* Adds up the progress of portions. */
struct portion {
    const struct oracle_work *work;
    uint64_t before, total; /* tests */
};

static void report(void *context, uint64_t done, uint64_t total)
{
    const struct portion *portion = context;
    (void)total;
    portion->work->progress(portion->work->progress_context, portion->before + done, portion->total);
}

/* Returns how many rays come next, with `left` seconds to go. */
static uint32_t portion_size(const struct oracle_work *work, uint32_t rest, double rays_a_second, double left)
{
    uint32_t fewest = FEWEST_RAYS * work->parallel->threads;
    double affordable = rays_a_second * left;
    if (affordable < rest)
        affordable /= 2; /* the rate is a guess: what is left over is for the next portions */
    return affordable >= rest ? rest : affordable > fewest ? (uint32_t)affordable : rest < fewest ? rest : fewest;
}

enum bvhd_status oracle_trace_timed(const struct oracle_work *work, const struct ray *rays, uint32_t ray_count,
                                    double seconds, struct oracle_answer *ret_answers, uint32_t *ret_count,
                                    struct bvhd_error *error)
{
    struct portion portion = {.work = work, .total = oracle_work_tests(work, ray_count)};
    double start = clock_ms(), rate = ray_count / fmax(oracle_work_seconds(work, ray_count), 1e-9);
    double left = fmin(seconds, isinf(seconds) ? seconds : first_seconds);
    uint32_t done = 0;
    for (uint32_t i = 0; i < ray_count; i++)
        ret_answers[i] = (struct oracle_answer){.outcome = ORACLE_MISS};
    while (done < ray_count && (left > 0 || done == 0)) {
        uint32_t count = portion_size(work, ray_count - done, rate, left);
        portion.before = oracle_work_tests(work, done);
        enum bvhd_status status =
            oracle_trace(work->meshes, work->mesh_count, rays + done, count, work->memory, work->parallel,
                         work->progress ? report : NULL, &portion, ret_answers + done, error);
        if (status != BVHD_OK) {
            oracle_finish(ret_answers, done, work->memory);
            return status;
        }
        done += count;
        double elapsed = (clock_ms() - start) / 1000;
        left = seconds - elapsed;
        rate = done / fmax(elapsed, 1e-6);
    }
    *ret_count = done;
    return BVHD_OK;
}
