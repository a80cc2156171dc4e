/* SPDX-License-Identifier: Apache-2.0 */
/*
 * admission.h - admission control: how much memory has been promised to prepares and builds, so that steps that run
 * side by side do not exceed the budget together.
 *
 * A step claims an estimate of the bytes that it takes, and starts when they can be promised to it. A step that is the
 * only one of its kind and class may always start; whether it fits is then up to the budget.
 *
 * * A prepare's promise lasts as long as its canonical copy does. All promises of prepares together stay under half of
 *   the budget. A large prepare also claims room for the build that follows it: it starts only if each of the builds to
 *   come, the largest of them, too, would fit beside all copies that exist then. So whatever was admitted can be built,
 *   one build after the other in the worst case, however many clients there are.
 * * A build's promise covers what it takes beside the canonical copy. Prepares and builds together stay under three
 *   quarters of the budget. Large steps also allocate from an account with that limit, so that they leave the last
 *   quarter free even if they need more than they estimated.
 * * A build that has run short of memory nevertheless is tried again when it is really alone: no other large build
 *   runs, and there are no copies but those of builds that wait for the same. Until then no large prepare starts, while
 *   builds go on, so that their copies vanish.
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

#include "daemon/service/largest.h"
#include "proto/base/memory.h"

enum admission_step { ADMISSION_PREPARE, ADMISSION_BUILD };

/* The class of a prepare, and of the build that follows it; ADMISSION_ALONE is for builds that are tried again. */
enum admission_class { ADMISSION_SMALL, ADMISSION_LARGE, ADMISSION_ALONE, ADMISSION_CLASSES };

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
    uint64_t build; /* of a prepare: bytes that the build after it will take */
};

/* The promises to steps of one kind and class. */
struct admission_share {
    uint64_t bytes;
    uint32_t count; /* of steps that hold a promise */
    uint32_t starts; /* in this iteration of the loop */
    uint64_t given; /* promises so far */
};

struct admission {
    uint64_t limit; /* bytes of the whole budget */
    struct memory *memory[ADMISSION_CLASSES]; /* what steps of each class allocate from */
    struct admission_share prepares[ADMISSION_CLASSES], builds[ADMISSION_CLASSES];
    struct largest to_come; /* what the builds of large copies, and of those being prepared, will take */
    uint32_t alone; /* builds that run alone, or wait to */
    uint32_t alone_copies; /* large copies that belong to them */
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

/* What large steps may take together. */
static inline uint64_t admission_large_limit(const struct admission *admission)
{
    return admission->limit - admission->limit / 4;
}

static inline bool admission_fits_large(const struct admission *admission, uint64_t bytes)
{
    uint64_t others =
        admission_sum(admission->prepares[ADMISSION_LARGE].bytes, admission->builds[ADMISSION_LARGE].bytes);
    return admission_sum(others, bytes) <= admission_large_limit(admission);
}

static inline bool admission_has_starts_left(const struct admission_share *share)
{
    return share->starts < ADMISSION_ITERATION_STARTS;
}

/* A large prepare beside others: whether its copy fits now, and every build to come beside all copies. */
static inline bool admission_may_prepare(const struct admission *admission, const struct admission_claim *claim)
{
    uint64_t copies = admission_sum(admission->prepares[ADMISSION_LARGE].bytes, claim->bytes);
    uint64_t others = largest_get(&admission->to_come), build = claim->build > others ? claim->build : others;
    return admission->alone == 0 && copies <= admission->limit / 2 && admission_fits_large(admission, claim->bytes) &&
           admission_sum(copies, build) <= admission_large_limit(admission);
}

/* A build that is to be alone: whether it is. */
static inline bool admission_may_build_alone(const struct admission *admission)
{
    return admission->builds[ADMISSION_LARGE].count == 0 && admission->builds[ADMISSION_ALONE].count == 0 &&
           admission->prepares[ADMISSION_LARGE].count <= admission->alone_copies;
}

static inline bool admission_may_build(const struct admission *admission, const struct admission_claim *claim)
{
    return admission->builds[ADMISSION_ALONE].count == 0 &&
           (admission->builds[ADMISSION_LARGE].count == 0 || admission_fits_large(admission, claim->bytes));
}

/* Whether the claim can be promised now. */
static inline bool admission_may_start(const struct admission *admission, enum admission_step step,
                                       const struct admission_claim *claim)
{
    const struct admission_share *share =
        step == ADMISSION_PREPARE ? &admission->prepares[claim->class] : &admission->builds[claim->class];
    if (!admission_has_starts_left(share))
        return false;
    if (claim->class == ADMISSION_SMALL)
        return share->count == 0 || admission_fits_small(admission, share, claim->bytes);
    if (step == ADMISSION_PREPARE)
        return share->count == 0 || admission_may_prepare(admission, claim);
    return claim->class == ADMISSION_ALONE ? admission_may_build_alone(admission)
                                           : admission_may_build(admission, claim);
}

/* The bytes that are promised to all steps together. */
static inline uint64_t admission_promised(const struct admission *admission)
{
    uint64_t sum = 0;
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        sum += admission->prepares[class].bytes + admission->builds[class].bytes;
    return sum;
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
    share->given++;
}

/* The promises so far that can take memory from a build: a build between two equal numbers had no company. */
static inline uint64_t admission_given(const struct admission *admission)
{
    uint64_t given = admission->prepares[ADMISSION_LARGE].given;
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        given += admission->builds[class].given;
    return given;
}

/* Whether a build, which holds a promise, runs beside other builds, or beside copies of others. */
static inline bool admission_has_company(const struct admission *admission, bool copy_is_large)
{
    uint32_t builds = 0;
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        builds += admission->builds[class].count;
    return builds > 1 || admission->prepares[ADMISSION_LARGE].count > (copy_is_large ? 1 : 0);
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

/* A large prepare has started, and a build that takes that many bytes will follow it; or that is over. */
static inline void admission_expect(struct admission *admission, enum admission_class class, uint64_t build)
{
    if (class == ADMISSION_LARGE)
        largest_add(&admission->to_come, build);
}

static inline void admission_expect_end(struct admission *admission, enum admission_class class, uint64_t build)
{
    if (class == ADMISSION_LARGE)
        largest_remove(&admission->to_come, build);
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
