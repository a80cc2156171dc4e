/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/pool/turns.h"

#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>

enum { MOST_NICE = 19 };

/* The kernel's struct sched_attr in its first version; glibc has it from 2.41 on. */
struct attributes {
    uint32_t size, policy;
    uint64_t flags;
    int32_t nice;
    uint32_t priority;
    uint64_t runtime, deadline, period; /* with the policies by weight, `runtime` is the length of a turn; 0: default */
};

static bool apply(const struct turns *turns)
{
    const struct attributes attributes = {
        .size = sizeof attributes,
        .policy = turns->policy,
        .nice = turns->nice,
        .runtime = turns->are_short ? turns->short_ns : 0,
    };
    return syscall(SYS_sched_setattr, 0, &attributes, 0) == 0;
}

void turns_begin(struct turns *turns, uint64_t short_ns, int less_weight)
{
    struct attributes attributes = {.size = sizeof attributes};
    *turns = (struct turns){.short_ns = short_ns, .are_short = true};
    if (syscall(SYS_sched_getattr, 0, &attributes, sizeof attributes, 0) != 0 ||
        (attributes.policy != SCHED_OTHER && attributes.policy != SCHED_BATCH))
        return;
    int nice = attributes.nice + less_weight;
    turns->policy = attributes.policy;
    turns->nice = nice < MOST_NICE ? nice : MOST_NICE;
    turns->are_known = apply(turns);
}

void turns_set(struct turns *turns, bool are_short)
{
    if (!turns->are_known || turns->are_short == are_short)
        return;
    turns->are_short = are_short;
    apply(turns);
}
