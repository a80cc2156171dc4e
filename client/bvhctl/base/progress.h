/* SPDX-License-Identifier: Apache-2.0 */
/*
 * progress.h - one line on the terminal that says how far a long step is. Nothing is printed when stderr is not a
 * terminal.
 */
#ifndef BVHCTL_PROGRESS_H
#define BVHCTL_PROGRESS_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct progress {
    bool shown; /* stderr is a terminal */
    char label[64];
    _Atomic int64_t next; /* time in milliseconds before which the line is not drawn again */
};

/* Names the step that begins: "building" and "dragon" are printed as "building dragon". */
void progress_begin(struct progress *progress, const char *verb, const char *name);

/*
 * Draws the line, at most ten times a second. `context` is a struct progress. May be called from any thread, at any
 * rate.
 */
void progress_update(void *context, uint64_t done, uint64_t total);

/* Erases the line, so that the next output starts on an empty one. */
void progress_end(struct progress *progress);

#endif
