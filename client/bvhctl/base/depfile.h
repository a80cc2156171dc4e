/* SPDX-License-Identifier: Apache-2.0 */
/* depfile.h - a rule in make's syntax that tells a build system which files a result depends on. */
#ifndef BVHCTL_DEPFILE_H
#define BVHCTL_DEPFILE_H

#include <stdbool.h>

#include "proto/base/memory.h"
#include "proto/base/status.h"

struct depfile {
    char *text; /* terminated */
    uint64_t size, capacity;
    bool failed; /* there was no memory; depfile_write reports it */
    struct memory *memory;
};

/* Begins a rule for `target`. End with depfile_finish. */
void depfile_init(struct depfile *depfile, struct memory *memory, const char *target);

/* Adds a file that the target depends on. Blanks, '#', '$' and '\' in front of them are quoted for make. */
void depfile_add(struct depfile *depfile, const char *path);

/* Writes the rule to the file `path`. A file that has it already keeps its modification time. */
enum bvhd_status depfile_write(struct depfile *depfile, const char *path, struct bvhd_error *error);

/* NULL-safe, idempotent. */
void depfile_finish(struct depfile *depfile);

#endif
