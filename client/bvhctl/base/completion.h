/* SPDX-License-Identifier: Apache-2.0 */
/*
 * completion.h - what may follow on a command line, for the completions of shells. The shells' scripts run `bvhctl
 * --complete WORD...` and print what it prints, so that they never differ from what bvhctl accepts.
 */
#ifndef BVHCTL_COMPLETION_H
#define BVHCTL_COMPLETION_H

#include <stdbool.h>

#include "client/bvhctl/base/options_table.h"

/* The kinds of values and operands. */
enum completion_kind {
    COMPLETION_TEXT, /* free text, such as a number: nothing can be offered */
    COMPLETION_NAME, /* one of some names */
    COMPLETION_LIST, /* names, separated by commas */
    COMPLETION_FILE, /* a file with one of some endings, or a directory */
    COMPLETION_DEVICE /* a device, which only the caller can list */
};

struct completion_row {
    enum completion_kind kind;
    const struct name_value *names; /* COMPLETION_NAME, COMPLETION_LIST */
    const char *endings; /* COMPLETION_FILE: such as "*.as *.probe"; "" for any file. COMPLETION_DEVICE: other names */
};

/*
 * Prints the candidates for the last of `count` words, one a line, "candidate TAB description"; for files a line
 * ":files ENDINGS". The words are those of the command line without the program's name. Returns true if devices are to
 * be offered besides, by completion_offer.
 */
bool completion_print(int count, char *const *words);

/* Prints a candidate, if the last word may become it. */
void completion_offer(int count, char *const *words, const char *candidate, const char *description);

/* Returns what the value of an option is, or NULL if nobody has said so, which a test refuses. */
const struct completion_row *completion_of(const struct option_row *option);

#endif
