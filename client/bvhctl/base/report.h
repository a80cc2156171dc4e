/* SPDX-License-Identifier: Apache-2.0 */
/* report.h - the output of bvhctl: exit codes, error lines on stderr, one JSON object on stdout. */
#ifndef BVHCTL_REPORT_H
#define BVHCTL_REPORT_H

#include "client/bvhctl/base/json.h"
#include "proto/base/status.h"

/* WRONG: `check` or `trace` found a wrong answer. USAGE: the command line is wrong. NO_DAEMON: no daemon answers. */
enum exit_code { EXIT_DONE = 0, EXIT_FAILED = 1, EXIT_USAGE = 2, EXIT_WRONG = 3, EXIT_NO_DAEMON = 4 };

/* Prints an error to stderr: "bvhctl: WHAT: WHERE: VUID or reason". Control characters in names become '?'. */
void report_line(const char *what, const struct bvhd_error *error);

/* Prints a remark that is not an error to stderr, in one line: "bvhctl: WHAT: text". */
void report_note(const char *what, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Writes an error's members "status", "vuid", "where" and "text" into the JSON object that is open. */
void report_members(struct json *json, const struct bvhd_error *error);

/* Prints an error to stdout, as a JSON object. */
void report_failure_json(const struct bvhd_error *error);

/*
 * Reports the error that ends a command: by report_line and, with `as_json`, report_failure_json. Returns the exit
 * code.
 */
enum exit_code report_failure(bool as_json, const char *what, const struct bvhd_error *error);

/*
 * Writes a finished JSON text to stdout. Returns false, after a message on stderr, when the text is not complete or
 * stdout cannot be written.
 */
bool report_print(struct json *json);

/* Returns whether everything that was printed has reached stdout; if not, a message goes to stderr. */
bool report_flush(void);

#endif
