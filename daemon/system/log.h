/* SPDX-License-Identifier: Apache-2.0 */
/*
 * log.h - the daemon's log: one line on stderr for each event, for people and for programs, such as
 * "level=info event=build_done key=ab12... ms=12.3". Each line begins with the time in UTC, or with the journal's
 * priority when stderr is connected to a journal. log_event can be called from any thread; it writes a line with one
 * write().
 */
#ifndef BVHD_LOG_H
#define BVHD_LOG_H

#include <stdbool.h>
#include <stdint.h>

enum log_level { LOG_ERROR, LOG_WARNING, LOG_INFO, LOG_DEBUG };

/* Sets the most detailed level that is written. It is LOG_INFO at the start. */
void log_set_level(enum log_level level);

/* Returns whether events of this level are written, for callers whose events take time to describe. */
bool log_writes(enum log_level level);

/*
 * Writes one event. `pairs` is a printf format that gives "name=value name=value", or NULL. Control characters become
 * '?', and a line is cut after 1,000 bytes. Text from outside the daemon has to go through log_quote.
 */
void log_event(enum log_level level, const char *event, const char *pairs, ...) __attribute__((format(printf, 3, 4)));

struct log_quoted {
    char text[256];
};

/*
 * Makes foreign text safe as a value: it is put in quotation marks, cut to fit, its quotation marks and backslashes
 * become "'" and its control characters '?'. Example: log_event(..., "why=%s", log_quote(text).text).
 */
struct log_quoted log_quote(const char *text);

/*
 * Limits an event that clients can cause at will to one line a second. Zeroed at the start. Each log_limit is used by
 * one thread.
 */
struct log_limit {
    uint64_t next_ms; /* CLOCK_MONOTONIC: when the next line is allowed */
    uint32_t suppressed; /* events since the last line */
};

/*
 * Returns whether the event is to be written now. If so, *ret_suppressed is how many events were not written since the
 * last line.
 */
bool log_limit_pass(struct log_limit *limit, uint32_t *ret_suppressed);

#endif
