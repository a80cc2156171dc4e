/* SPDX-License-Identifier: Apache-2.0 */
/*
 * admission.h - how much memory the steps under way have been promised, so that steps side by side do not push each
 * other over the budget.
 *
 * Prepares and builds ask with an estimate before they start. What runs alone may always try: whether it fits is then
 * the budget's to say.
 *
 * * A prepare's promise lasts as long as its canonical copy does. All of them together stay under half of the budget.
 * * A build's promise covers what it takes beside that copy. Prepares and builds together stay under the budget less a
 *   quarter; of that nothing large gets anything, whatever it finds that it needs.
 * * Half of the quarter is for inline payloads and the requests themselves, half for small steps: prepares and builds
 *   alike. So what is small never waits for memory that something large has, or wants to have for itself: a request of
 *   a hundred bytes may stand for boxes that take the whole budget.
 *
 * No deadlock: copies wait for builds only, and a build starts when no other of its class does. Loop thread only.
 *
 * In one turn of the loop only ADMISSION_TURN_STARTS of each kind may start: memory for thousands becomes free at once,
 * and to start one takes microseconds.
 */
#ifndef BVHD_ADMISSION_H
#define BVHD_ADMISSION_H

#include <stdbool.h>
#include <stdint.h>

/* Of a prepare, and of the build that comes of it. */
enum admission_class { ADMISSION_SMALL, ADMISSION_LARGE, ADMISSION_CLASSES };

/*
 * A small prepare asks for no more than this, and than this part of the budget. Its build takes at most some ten times
 * as much.
 */
enum { ADMISSION_SMALL_MOST = 1 << 20, ADMISSION_SMALL_PART = 1024 };

enum { ADMISSION_TURN_STARTS = 64 };

struct admission_share {
    uint64_t bytes;
    uint32_t count;
    uint32_t starts; /* in this turn */
};

struct admission {
    uint64_t limit; /* of the whole budget */
    struct admission_share prepares[ADMISSION_CLASSES], builds[ADMISSION_CLASSES];
    bool exclusive; /* a build runs that wants to be alone: no other large one starts */
};

static inline enum admission_class admission_class_of(const struct admission *admission, uint64_t prepare_bytes)
{
    bool small = prepare_bytes <= ADMISSION_SMALL_MOST && prepare_bytes <= admission->limit / ADMISSION_SMALL_PART;
    return small ? ADMISSION_SMALL : ADMISSION_LARGE;
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

static inline bool admission_has_turn(const struct admission_share *share)
{
    return share->starts < ADMISSION_TURN_STARTS;
}

/* Promises are given only after asking. */
static inline bool admission_may_prepare(const struct admission *admission, enum admission_class class, uint64_t bytes)
{
    const struct admission_share *share = &admission->prepares[class];
    if (!admission_has_turn(share))
        return false;
    if (share->count == 0)
        return true;
    if (class == ADMISSION_SMALL)
        return admission_fits_small(admission, share, bytes);
    return admission_sum(share->bytes, bytes) <= admission->limit / 2 && admission_fits_large(admission, bytes);
}

/* One that wants to be alone is large. */
static inline bool admission_may_build(const struct admission *admission, enum admission_class class, uint64_t bytes,
                                       bool exclusive)
{
    const struct admission_share *share = &admission->builds[class];
    if (!admission_has_turn(share))
        return false;
    if (share->count == 0)
        return true;
    if (class == ADMISSION_SMALL)
        return admission_fits_small(admission, share, bytes);
    return !exclusive && !admission->exclusive && admission_fits_large(admission, bytes);
}

static inline uint64_t admission_promised(const struct admission *admission)
{
    return admission->prepares[ADMISSION_SMALL].bytes + admission->prepares[ADMISSION_LARGE].bytes +
           admission->builds[ADMISSION_SMALL].bytes + admission->builds[ADMISSION_LARGE].bytes;
}

/*
 * Gives or takes back a promise. Nothing over the budget is promised, and only one promise passes its share: no sum
 * overflows.
 */
static inline void admission_give(struct admission_share *share, uint64_t bytes)
{
    share->bytes += bytes;
    share->count++;
    share->starts++;
}

static inline void admission_end(struct admission_share *share, uint64_t bytes)
{
    share->bytes -= bytes;
    share->count--;
}

/* Whether something may have to wait for the next turn. */
static inline bool admission_turn_is_over(const struct admission *admission)
{
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        if (!admission_has_turn(&admission->prepares[class]) || !admission_has_turn(&admission->builds[class]))
            return true;
    return false;
}

static inline void admission_begin_turn(struct admission *admission)
{
    for (int class = 0; class < ADMISSION_CLASSES; class ++)
        admission->prepares[class].starts = admission->builds[class].starts = 0;
}

#endif
