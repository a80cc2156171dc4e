/* SPDX-License-Identifier: Apache-2.0 */
/*
 * admission.h - how much memory the steps under way have been promised, so that steps side by side do not push each other over the budget.
 *
 * Prepares and builds ask with an estimate before they start. What runs alone may always try: whether it fits is then the budget's to say.
 *
 * * A prepare's promise lasts as long as its canonical copy does. All of them together stay under half of the budget.
 * * A build's promise covers what it takes beside that copy. Prepares and builds together stay under the budget less an eighth, which is for
 *   inline payloads and the requests themselves.
 *
 * No deadlock: copies wait for builds only, and a build starts when no other does. Loop thread only.
 */
#ifndef BVHD_ADMISSION_H
#define BVHD_ADMISSION_H

#include <stdbool.h>
#include <stdint.h>

struct admission_share {
    uint64_t bytes;
    uint32_t count;
};

struct admission {
    uint64_t limit; /* of the whole budget */
    struct admission_share prepares, builds;
    bool exclusive; /* a build runs that wants to be alone: no other starts */
};

static inline uint64_t admission_sum(uint64_t a, uint64_t b)
{
    return a + b < a ? UINT64_MAX : a + b;
}

static inline bool admission_fits(const struct admission *admission, uint64_t bytes)
{
    uint64_t sum = admission_sum(admission_sum(admission->prepares.bytes, admission->builds.bytes), bytes);
    return sum <= admission->limit - admission->limit / 8;
}

/* Promises are given only after asking. */
static inline bool admission_may_prepare(const struct admission *admission, uint64_t bytes)
{
    if (admission->prepares.count == 0)
        return true;
    return admission_sum(admission->prepares.bytes, bytes) <= admission->limit / 2 && admission_fits(admission, bytes);
}

static inline bool admission_may_build(const struct admission *admission, uint64_t bytes, bool exclusive)
{
    if (admission->builds.count == 0)
        return true;
    return !exclusive && !admission->exclusive && admission_fits(admission, bytes);
}

/* Gives or takes back a promise. Nothing over the budget is promised, and only one promise passes its share: no sum overflows. */
static inline void admission_give(struct admission_share *share, uint64_t bytes)
{
    share->bytes += bytes;
    share->count++;
}

static inline void admission_end(struct admission_share *share, uint64_t bytes)
{
    share->bytes -= bytes;
    share->count--;
}

#endif
