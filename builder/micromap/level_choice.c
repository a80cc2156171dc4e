/* SPDX-License-Identifier: Apache-2.0 */
/* level_choice.c - sorts the steps of all triangles by their worth. */
#include "builder/micromap/level_choice.h"

#include <stdlib.h>

struct step {
    double worth;
    uint32_t triangle;
    unsigned char from, to;
};

static uint64_t bytes_at(const struct level_limits *limits, unsigned level)
{
    return level == 0 ? 0 : micro_triangle_bytes(limits->format, level);
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

static int compare(const void *left, const void *right)
{
    const struct step *a = left, *b = right;
    if (a->worth != b->worth)
        return a->worth > b->worth ? -1 : 1;
    if (a->triangle != b->triangle)
        return a->triangle < b->triangle ? -1 : 1;
    return a->from < b->from ? -1 : a->from > b->from;
}

/* Lists the steps of all triangles to `steps`, unless that is NULL, and returns how many there are. */
static size_t list_steps(const struct level_facts *facts, size_t count, const struct level_limits *limits,
                         struct step *steps)
{
    size_t listed = 0;
    for (size_t i = 0; i < count; i++) {
        struct step step = {0};
        for (unsigned level = 0; best_step(&facts[i], limits, level, &step); level = step.to) {
            step.triangle = (uint32_t)i;
            if (steps)
                steps[listed] = step;
            listed++;
        }
    }
    return listed;
}

enum bvhd_status level_choice_make(const struct level_facts *facts, size_t count, const struct level_limits *limits,
                                   const struct build_context *context, unsigned char *ret_levels,
                                   struct bvhd_error *error)
{
    const size_t step_count = list_steps(facts, count, limits, NULL);
    struct step *steps = memory_array(context->memory, step_count, sizeof *steps);
    if (!steps && step_count > 0)
        return bvhd_error_no_memory(error, "levels", "no memory for a list of %zu steps", step_count);
    list_steps(facts, count, limits, steps);
    if (step_count > 0 && !context_cancelled(context))
        qsort(steps, step_count, sizeof *steps, compare);
    for (size_t i = 0; i < count; i++)
        ret_levels[i] = 0;
    uint64_t bytes = 0;
    for (size_t i = 0; i < step_count; i++) {
        const struct step *step = &steps[i];
        const uint64_t more = bytes_at(limits, step->to) - bytes_at(limits, step->from);
        if (more > limits->budget - bytes)
            break;
        bytes += more;
        ret_levels[step->triangle] = step->to;
    }
    memory_free(context->memory, steps);
    if (context_cancelled(context))
        return bvhd_error_set(error, BVHD_CANCELLED, "levels", "cancelled");
    return BVHD_OK;
}
