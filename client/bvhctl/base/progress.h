/* SPDX-License-Identifier: Apache-2.0 */
/* progress.h - one line on the terminal that says how far a long step is. Silent when stderr is no terminal. */
#ifndef BVHCTL_PROGRESS_H
#define BVHCTL_PROGRESS_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

struct progress {
    bool shown; /* stderr is a terminal */
    char label[64];
    _Atomic int64_t next; /* milliseconds: not drawn again before */
};

/* The step that follows: "building dragon". */
void progress_begin(struct progress *progress, const char *verb, const char *name);

/* `context` is a struct progress. From any thread, as often as one likes: it draws ten times a second at most. */
void progress_update(void *context, uint64_t done, uint64_t total);

/* Wipes the line, so that the next output starts on a clean one. */
void progress_end(struct progress *progress);

#endif
