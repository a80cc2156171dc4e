/* SPDX-License-Identifier: Apache-2.0 */
/*
 * progress.h - says on stderr how far a long step is: on a terminal as one line that is redrawn, elsewhere only with
 * --verbose, as a line now and then. With --quiet nothing is printed.
 *
 * A thread draws, so that time passes on the line even while nothing reports progress. There is one step at a time in
 * the process.
 */
#ifndef BVHCTL_PROGRESS_H
#define BVHCTL_PROGRESS_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct progress {
    bool shown; /* a step has begun, and something is printed about it */
    char label[128];
    double start; /* clock_ms */
    _Atomic uint64_t done, total; /* total 0: nobody knows */
};

/*
 * Names the step that begins: "building" and "dragon" are printed as "building dragon". Call it, and progress_end, from
 * the main thread. A step that has begun before must have ended.
 */
void progress_begin(struct progress *progress, const char *verb, const char *name);

/* Says how far the step is. `context` is a struct progress. May be called from any thread, at any rate. */
void progress_update(void *context, uint64_t done, uint64_t total);

/* Erases the line, so that the next output starts on an empty one. A step that has ended already is allowed. */
void progress_end(struct progress *progress);

/* Erases the line of the step under way, if there is one, so that a message can be printed; it is drawn again later. */
void progress_make_room(void);

#endif
