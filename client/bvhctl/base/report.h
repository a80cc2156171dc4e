/* SPDX-License-Identifier: Apache-2.0 */
/* report.h - how bvhctl speaks: exit codes, error lines on stderr, one JSON object on stdout. */
#ifndef BVHCTL_REPORT_H
#define BVHCTL_REPORT_H

#include "client/bvhctl/base/json.h"
#include "proto/base/status.h"

enum exit_code { EXIT_DONE = 0, EXIT_FAILED = 1, EXIT_USAGE = 2, EXIT_WRONG = 3, EXIT_NO_DAEMON = 4 };

/* One line on stderr: "bvhctl: WHAT: WHERE: VUID or reason". Control characters in names are shown as '?'. */
void report_line(const char *what, const struct bvhd_error *error);

/* A remark that is no error, one line on stderr: "bvhctl: WHAT: text". */
void report_note(const char *what, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* The members "status", "vuid", "where", "text", into an object that is open. */
void report_members(struct json *json, const struct bvhd_error *error);

/* Only the error object, on stdout. */
void report_failure_json(const struct bvhd_error *error);

/* The command is over: the line, with `as_json` also the error object on stdout. Returns the exit code that fits. */
enum exit_code report_failure(bool as_json, const char *what, const struct bvhd_error *error);

/*
 * Writes a finished JSON text to stdout. false, and said on stderr, when it is not complete or stdout does not take it.
 */
bool report_print(struct json *json);

/* stdout has taken everything that was printed; else said on stderr. */
bool report_flush(void);

#endif
