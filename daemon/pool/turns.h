/* SPDX-License-Identifier: Apache-2.0 */
/*
 * turns.h - asks the system's scheduler to run short work soon, while long work has all processors.
 *
 * A thread that wakes up waits until the scheduler takes a processor from another thread, which can be for the whole of
 * that thread's turn: 3 to 4 ms. A thread with short turns takes the processor at once, and gives it up sooner. It gets
 * no more time than others. So the loop has the shortest turns and the pool's threads short ones; a thread has long
 * turns only while it runs a large job, and those that help it stay short. The pool's threads also have less weight
 * than the loop, so that the loop is not kept waiting for the time that it has had just before.
 *
 * Linux has turns of a thread's own from version 6.12 on. Where the system refuses them, threads run as they did.
 */
#ifndef BVHD_TURNS_H
#define BVHD_TURNS_H

#include <stdbool.h>
#include <stdint.h>

enum {
    TURNS_LESS_WEIGHT = 3, /* added to the nice value of the pool's threads: half of the weight */
    TURNS_LOOP_NS = 100 * 1000, /* the least that Linux allows */
    TURNS_SHORT_NS = 200 * 1000, /* of the pool's threads */
};

/* How the scheduler treats one thread; for that thread only. */
struct turns {
    uint32_t policy;
    int32_t nice;
    uint64_t short_ns;
    bool are_known; /* false: the system does not say, or the thread is not scheduled by weight; nothing is changed */
    bool are_short;
};

/* The calling thread has short turns of that length from now on. `less_weight` is added to its nice value. */
void turns_begin(struct turns *turns, uint64_t short_ns, int less_weight);

/* Makes the turns of the calling thread short, or as long as the system's, if they are not. */
void turns_set(struct turns *turns, bool are_short);

#endif
