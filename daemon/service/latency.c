/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/latency.h"

#include <stdbool.h>

enum { STEP_BITS = 3 };

_Static_assert(LATENCY_STEPS == 1 << STEP_BITS, "steps are the bits below the highest one");

static unsigned power_of(uint64_t us)
{
    return us > 0 ? 63 - (unsigned)__builtin_clzll(us) : 0;
}

static uint64_t least(uint64_t a, uint64_t b)
{
    return a < b ? a : b;
}

/* Times below LATENCY_STEPS have buckets of their own; a longer one is found by its highest bits. */
static unsigned bucket_of(uint64_t us)
{
    if (us < LATENCY_STEPS)
        return (unsigned)us;
    unsigned power = power_of(us);
    return (power - STEP_BITS + 1) * LATENCY_STEPS + (unsigned)(us >> (power - STEP_BITS) & (LATENCY_STEPS - 1));
}

/* Returns the longest time that is counted in a bucket. */
static uint64_t end_of(unsigned bucket)
{
    if (bucket < LATENCY_STEPS)
        return bucket;
    unsigned shift = bucket / LATENCY_STEPS - 1, step = bucket % LATENCY_STEPS;
    return ((uint64_t)(LATENCY_STEPS + step + 1) << shift) - 1;
}

void latency_add(struct latency *latency, uint64_t now_ns, uint64_t ns)
{
    uint64_t us = least(ns / 1000, (UINT64_C(1) << LATENCY_POWERS) - 1), period = now_ns / LATENCY_PERIOD_NS;
    struct latency_window *window = &latency->windows[period % 2];
    if (window->period != period)
        *window = (struct latency_window){.period = period};
    window->count++;
    window->buckets[bucket_of(us)]++;
    window->most_us = us > window->most_us ? us : window->most_us;
    latency->count++;
    latency->sum_us += us;
    latency->powers[power_of(us)]++;
}

/* The windows that are recent enough. */
struct view {
    const struct latency_window *windows[2];
    unsigned windows_count;
    uint64_t count;
};

static struct view view_of(const struct latency *latency, uint64_t now_ns)
{
    struct view view = {.windows_count = 0};
    for (int i = 0; i < 2; i++) {
        const struct latency_window *window = &latency->windows[i];
        bool is_recent = window->period + 1 >= now_ns / LATENCY_PERIOD_NS;
        if (!is_recent)
            continue;
        view.windows[view.windows_count++] = window;
        view.count += window->count;
    }
    return view;
}

/* Returns a time that `percent` percent of the times do not exceed. There is at least one. */
static uint64_t percentile(const struct view *view, unsigned percent)
{
    uint64_t wanted = (view->count * percent + 99) / 100, seen = 0;
    unsigned bucket = 0;
    for (;; bucket++) {
        for (unsigned w = 0; w < view->windows_count; w++)
            seen += view->windows[w]->buckets[bucket];
        if (seen >= wanted)
            return end_of(bucket);
    }
}

struct latency_summary latency_summary(const struct latency *latency, uint64_t now_ns)
{
    struct view view = view_of(latency, now_ns);
    struct latency_summary summary = {.count = view.count};
    if (view.count == 0)
        return summary;
    for (unsigned w = 0; w < view.windows_count; w++)
        if (view.windows[w]->most_us > summary.most_us)
            summary.most_us = view.windows[w]->most_us;
    summary.p50_us = least(percentile(&view, 50), summary.most_us);
    summary.p90_us = least(percentile(&view, 90), summary.most_us);
    summary.p99_us = least(percentile(&view, 99), summary.most_us);
    return summary;
}
