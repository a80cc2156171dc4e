/* SPDX-License-Identifier: Apache-2.0 */
/* report.h - the output of bvhctl: exit codes, error lines on stderr, one JSON object on stdout. */
#ifndef BVHCTL_REPORT_H
#define BVHCTL_REPORT_H

#include "client/bvhctl/base/json.h"
#include "proto/base/status.h"

/* WRONG: `check` or `trace` found a wrong answer. USAGE: the command line is wrong. NO_DAEMON: no daemon answers. */
enum exit_code { EXIT_DONE = 0, EXIT_FAILED = 1, EXIT_USAGE = 2, EXIT_WRONG = 3, EXIT_NO_DAEMON = 4 };

/* How much is printed for people: with --quiet errors only, by default also results and remarks, with --verbose all. */
enum report_volume { REPORT_ERRORS, REPORT_RESULTS, REPORT_ALL };

/* The volume of this process, which is REPORT_RESULTS at first. Set it before other threads start. */
void report_set_volume(enum report_volume volume);
enum report_volume report_volume(void);

/* Prints an error to stderr: "bvhctl: WHAT: WHERE: VUID or reason". Control characters in names become '?'. */
void report_line(const char *what, const struct bvhd_error *error);

/*
 * Prints a line to stderr: "bvhctl: WHAT: text". report_note is for remarks and warnings, which --quiet hides;
 * report_finding for what a command was asked to find and for errors that are not a struct bvhd_error, which are always
 * printed; report_detail for what only --verbose prints.
 */
void report_note(const char *what, const char *format, ...) __attribute__((format(printf, 2, 3)));
void report_finding(const char *what, const char *format, ...) __attribute__((format(printf, 2, 3)));
void report_detail(const char *what, const char *format, ...) __attribute__((format(printf, 2, 3)));

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
