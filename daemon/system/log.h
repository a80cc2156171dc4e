/* SPDX-License-Identifier: Apache-2.0 */
/*
 * log.h - one line an event on stderr, for people and for programs: "level=info event=build_done key=ab12... ms=12.3".
 * Under a journal lines begin with its priority instead of the time. From any thread; a line is one write.
 */
#ifndef BVHD_LOG_H
#define BVHD_LOG_H

#include <stdbool.h>
#include <stdint.h>

enum log_level { LOG_ERROR, LOG_WARNING, LOG_INFO, LOG_DEBUG };

/* Lines above this level are not written; LOG_INFO at the start. */
void log_set_level(enum log_level level);

/*
 * `pairs` is printf style and gives "name=value name=value"; may be NULL. Control characters become '?', and a line
 * ends after 1,000 bytes. Text from outside goes through log_quote.
 */
void log_event(enum log_level level, const char *event, const char *pairs, ...) __attribute__((format(printf, 3, 4)));

struct log_quoted {
    char text[256];
};

/*
 * In quotation marks, cut to fit, with quotes and control characters made harmless: log_event(..., "why=%s",
 * log_quote(text).text).
 */
struct log_quoted log_quote(const char *text);

/* For events that clients can cause at will: at most one line a second. Zeroed at the start; one thread's. */
struct log_limit {
    uint64_t next_ms;
    uint32_t suppressed;
};

/* Whether to write the event now; *ret_suppressed: how many were not written since the last one. */
bool log_limit_pass(struct log_limit *limit, uint32_t *ret_suppressed);

#endif
