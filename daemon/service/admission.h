/* SPDX-License-Identifier: Apache-2.0 */
/*
 * admission.h - admission control: how much memory has been promised to prepares and builds, so that steps that run
 * side by side do not exceed the budget together.
 *
 * A step claims an estimate of the bytes that it takes, and starts when they can be promised to it. A step that is the
 * only one of its kind and class may always start; whether it fits is then up to the budget.
 *
 * * A prepare's promise lasts as long as its canonical copy does. All promises of prepares together stay under half of
 *   the budget.
 * * A build's promise covers what it takes beside the canonical copy. Prepares and builds together stay under three
 *   quarters of the budget. Large steps also allocate from an account with that limit, so that they leave the last
 *   quarter free even if they need more than they estimated.
 * * Of the last quarter, one half is for inline payloads and for the requests themselves, and the other half is for
 *   small steps, prepares and builds alike. A small step thus never waits for memory that a large one has or wants:
 *   a request of a hundred bytes may stand for boxes that take the whole budget.
 *
 * There is no deadlock, because canonical copies wait only for builds, and a build starts if no other build of its
 * class runs. For the loop thread only.
 *
 * In one iteration of the loop at most ADMISSION_ITERATION_STARTS steps of each kind and class start. It takes
 * microseconds to start one, and memory for thousands of them may become free at once.
 */
#ifndef BVHD_ADMISSION_H
#define BVHD_ADMISSION_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/memory.h"

enum admission_step { ADMISSION_PREPARE, ADMISSION_BUILD };

/* The class of a prepare, and of the build that follows it. */
enum admission_class { ADMISSION_SMALL, ADMISSION_LARGE, ADMISSION_CLASSES };

/*
 * A small prepare claims at most ADMISSION_SMALL_MAX bytes, and at most the budget divided by ADMISSION_SMALL_DIVISOR.
 * Its build takes at most about ten times as much.
 */
enum { ADMISSION_SMALL_MAX = 1 << 20, ADMISSION_SMALL_DIVISOR = 1024 };

enum { ADMISSION_ITERATION_STARTS = 64 };

/* A step's demand for memory, which must be promised before the step starts. */
struct admission_claim {
    uint64_t bytes;
    enum admission_class class;
    bool exclusive; /* a large build that is to be the only large one */
};

/* The promises to steps of one kind and class. */
struct admission_share {
    uint64_t bytes;
    uint32_t count; /* of steps that hold a promise */
    uint32_t starts; /* in this iteration of the loop */
};

struct admission {
    uint64_t limit; /* bytes of the whole budget */
    struct memory *memory[ADMISSION_CLASSES]; /* what steps of each class allocate from */
    struct admission_share prepares[ADMISSION_CLASSES], builds[ADMISSION_CLASSES];
    bool exclusive; /* an exclusive build runs: no other large build starts */
};

/* The class of a step whose prepare claims that many bytes. */
static inline enum admission_class admission_class_of(const struct admission *admission, uint64_t prepare_bytes)
{
    bool small = prepare_bytes <= ADMISSION_SMALL_MAX && prepare_bytes <= admission->limit / ADMISSION_SMALL_DIVISOR;
    return small ? ADMISSION_SMALL : ADMISSION_LARGE;
}

static inline struct admission_share *admission_share_of(struct admission *admission, enum admission_step step,
                                                         enum admission_class class)
{
    return step == ADMISSION_PREPARE ? &admission->prepares[class] : &admission->builds[class];
}

static inline uint64_t admission_sum(uint64_t a, uint64_t b)
{
    return a + b < a ? UINT64_MAX : a + b;
}

static inline bool admission_fits_small(const struct admission *admission, const struct admission_share *share,
                                        uint64_t bytes)
{
    return admission_sum(share->bytes, bytes) <= admission->limit / 16;
}

static inline bool admission_fits_large(const struct admission *admission, uint64_t bytes)
{
    uint64_t others =
        admission_sum(admission->prepares[ADMISSION_LARGE].bytes, admission->builds[ADMISSION_LARGE].bytes);
    return admission_sum(others, bytes) <= admission->limit - admission->limit / 4;
}

static inline bool admission_has_starts_left(const struct admission_share *share)
{
    return share->starts < ADMISSION_ITERATION_STARTS;
}

/* Whether the claim can be promised now. */
static inline bool admission_may_start(const struct admission *admission, enum admission_step step,
                                       const struct admission_claim *claim)
{
    const struct admission_share *share =
        step == ADMISSION_PREPARE ? &admission->prepares[claim->class] : &admission->builds[claim->class];
    if (!admission_has_starts_left(share))
        return false;
    if (share->count == 0)
        return true;
    if (claim->class == ADMISSION_SMALL)
        return admission_fits_small(admission, share, claim->bytes);
    if (!admission_fits_large(admission, claim->bytes))
        return false;
    if (step == ADMISSION_PREPARE)
        return admission_sum(share->bytes, claim->bytes) <= admission->limit / 2;
    return !claim->exclusive && !admission->exclusive;
}

/* The bytes that are promised to all steps together. */
static inline uint64_t admission_promised(const struct admission *admission)
{
    return admission->prepares[ADMISSION_SMALL].bytes + admission->prepares[ADMISSION_LARGE].bytes +
           admission->builds[ADMISSION_SMALL].bytes + admission->builds[ADMISSION_LARGE].bytes;
}

/*
 * Gives a promise, after admission_may_start. No sum overflows: nothing over the budget is promised, and only one
 * promise at a time exceeds its share.
 */
static inline void admission_give(struct admission_share *share, uint64_t bytes)
{
    share->bytes += bytes;
    share->count++;
    share->starts++;
}

/* Reduces a promise by that many bytes. */
static inline void admission_shrink(struct admission_share *share, uint64_t bytes)
{
    share->bytes -= bytes;
}

/* Takes a promise back. */
static inline void admission_end(struct admission_share *share, uint64_t bytes)
{
    share->bytes -= bytes;
    share->count--;
}

/* Whether a step may have to wait only because too many others have started in this iteration of the loop. */
static inline bool admission_is_exhausted(const struct admission *admission)
{
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        if (!admission_has_starts_left(&admission->prepares[class]) ||
            !admission_has_starts_left(&admission->builds[class]))
            return true;
    return false;
}

static inline void admission_begin_iteration(struct admission *admission)
{
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        admission->prepares[class].starts = admission->builds[class].starts = 0;
}

#endif
