/* SPDX-License-Identifier: Apache-2.0 */
/* level_choice.c - lists the steps of all triangles, and finds the worth down to which they are within the budget. */
#include "builder/micromap/level_choice.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "proto/base/bytes.h"
#include "proto/base/geometry.h"

struct step {
    double worth;
    uint32_t triangle;
    unsigned char from, to;
};

/* The bytes of a triangle: its states, and where they are. */
static uint64_t bytes_at(const struct level_limits *limits, unsigned level)
{
    return level == 0 ? 0 : micro_triangle_bytes(limits->format, level) + sizeof(struct micromap_triangle);
}

/* Computes the step of greatest worth from a level. Returns false if none is worth enough. */
static bool best_step(const struct level_facts *facts, const struct level_limits *limits, unsigned from,
                      struct step *ret_step)
{
    struct step best = {.worth = -1};
    for (unsigned to = from + 1; to <= limits->last; to++) {
        const double more = (double)(facts->decided[to] - facts->decided[from]) / MICRO_COUNT_MAX;
        const double worth = facts->weight * more / (double)(bytes_at(limits, to) - bytes_at(limits, from));
        if (more > 0 && worth >= best.worth)
            best = (struct step){.worth = worth, .from = (unsigned char)from, .to = (unsigned char)to};
    }
    if (!(best.worth >= limits->worth) || best.worth < 0)
        return false;
    *ret_step = best;
    return true;
}

/*
 * Lists the steps of all triangles to `steps`, unless that is NULL, and returns how many there are. Steps of a triangle
 * follow each other, and rounding does not make their worth rise. A cancelled list is short.
 */
static size_t list_steps(const struct level_facts *facts, size_t count, const struct level_limits *limits,
                         const struct build_context *context, struct step *steps)
{
    size_t listed = 0;
    for (size_t i = 0; i < count && !parallel_cancelled_at(context->cancel, i); i++) {
        struct step step = {0};
        double last = DBL_MAX;
        for (unsigned level = 0; best_step(&facts[i], limits, level, &step); level = step.to) {
            step.triangle = (uint32_t)i;
            step.worth = last = step.worth < last ? step.worth : last;
            if (steps)
                steps[listed] = step;
            listed++;
        }
    }
    return listed;
}

static uint64_t bytes_of(const struct level_limits *limits, const struct step *step)
{
    return bytes_at(limits, step->to) - bytes_at(limits, step->from);
}

/* Returns the bytes of all steps that are worth so much. */
static uint64_t bytes_worth(const struct step *steps, size_t count, const struct level_limits *limits, double worth)
{
    uint64_t bytes = 0;
    for (size_t i = 0; i < count; i++)
        bytes += steps[i].worth >= worth ? bytes_of(limits, &steps[i]) : 0;
    return bytes;
}

/*
 * Returns the least worth of which all steps are within the budget. Doubles that are not negative ascend as their bits
 * do, so bisecting the bits finds it: in 64 rounds, between which a cancellation is noticed, instead of by sorting.
 */
static double find_worth(const struct step *steps, size_t count, const struct level_limits *limits,
                         const struct build_context *context)
{
    const double all = 0, none = INFINITY;
    uint64_t low = bytes_get64(&all), high = bytes_get64(&none);
    if (bytes_worth(steps, count, limits, all) <= limits->budget)
        return all;
    while (high - low > 1 && !context_cancelled(context)) {
        const uint64_t middle = low + (high - low) / 2;
        double worth;
        memcpy(&worth, &middle, sizeof worth);
        if (bytes_worth(steps, count, limits, worth) <= limits->budget)
            high = middle;
        else
            low = middle;
    }
    double worth;
    memcpy(&worth, &high, sizeof worth);
    return worth;
}

/* Takes the steps of one range of worth in the order of triangles, as long as they are within the budget. */
static uint64_t take(const struct step *steps, size_t count, const struct level_limits *limits, double least,
                     double below, uint64_t bytes, unsigned char *levels)
{
    for (size_t i = 0; i < count; i++) {
        const uint64_t more = bytes_of(limits, &steps[i]);
        if (!(steps[i].worth >= least && steps[i].worth < below))
            continue;
        if (more > limits->budget - bytes)
            break;
        bytes += more;
        levels[steps[i].triangle] = steps[i].to;
    }
    return bytes;
}

/* Takes all steps that fit, and of those with the next lower worth, which do not fit together, the first ones. */
static void take_steps(const struct step *steps, size_t count, const struct level_limits *limits, double worth,
                       unsigned char *levels)
{
    double next = -1;
    for (size_t i = 0; i < count; i++)
        if (steps[i].worth < worth && steps[i].worth > next)
            next = steps[i].worth;
    const uint64_t bytes = take(steps, count, limits, worth, INFINITY, 0, levels);
    if (next >= 0)
        take(steps, count, limits, next, worth, bytes, levels);
}

enum bvhd_status level_choice_make(const struct level_facts *facts, size_t count, const struct level_limits *limits,
                                   const struct build_context *context, unsigned char *ret_levels,
                                   struct bvhd_error *error)
{
    const size_t step_count = list_steps(facts, count, limits, context, NULL);
    struct step *steps = memory_array(context->memory, step_count, sizeof *steps);
    if (!steps && step_count > 0)
        return bvhd_error_no_memory(error, "levels", "no memory for a list of %zu steps", step_count);
    /* The flag may have been set since the steps were counted, which makes the list shorter. */
    const size_t listed = list_steps(facts, count, limits, context, steps);
    memset(ret_levels, 0, count);
    take_steps(steps, listed, limits, find_worth(steps, listed, limits, context), ret_levels);
    memory_free(context->memory, steps);
    if (context_cancelled(context))
        return bvhd_error_set(error, BVHD_CANCELLED, "levels", "cancelled");
    return BVHD_OK;
}
