/* SPDX-License-Identifier: Apache-2.0 */
/*
 * turns.h - asks the system's scheduler to run short work soon, while long work has all processors.
 *
 * A thread that wakes up waits until the scheduler takes a processor from another thread, which can be for the whole of
 * that thread's turn: 3 to 4 ms. A thread with short turns takes the processor at once, and gives it up sooner. It gets
 * no more time than others. So the loop and threads that wait for work have short turns, and a thread has long turns
 * only while it works for a large job. The pool's threads also have less weight than the loop, so that the loop is not
 * kept waiting for the time that it has had just before.
 *
 * Linux has turns of a thread's own from version 6.12 on. Where the system refuses them, threads run as they did.
 */
#ifndef BVHD_TURNS_H
#define BVHD_TURNS_H

#include <stdbool.h>
#include <stdint.h>

enum { TURNS_LESS_WEIGHT = 3 /* added to the nice value of the pool's threads: half of the weight */ };

/* How the scheduler treats one thread; for that thread only. */
struct turns {
    uint32_t policy;
    int32_t nice;
    bool are_known; /* false: the system does not say, or the thread is not scheduled by weight; nothing is changed */
    bool are_short;
};

/* The calling thread has short turns from now on. `less_weight` is added to its nice value. */
void turns_begin(struct turns *turns, int less_weight);

/* Makes the turns of the calling thread short, or as long as the system's, if they are not. */
void turns_set(struct turns *turns, bool are_short);

#endif
