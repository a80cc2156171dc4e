/* SPDX-License-Identifier: Apache-2.0 */
/* import_names.h - the names of nodes of an import: one text after the other in one block, also for a million nodes. */
#ifndef BVHCTL_IMPORT_NAMES_H
#define BVHCTL_IMPORT_NAMES_H

#include <stdbool.h>
#include <stdint.h>

#include "proto/base/memory.h"

struct import_names {
    char *texts; /* each with its zero byte; the first one is "". NULL: there are no names, and all are "" */
    uint64_t size, capacity;
};

/* Adds a name and returns its offset, which is 0 for NULL and "". False when there is no memory. */
bool import_names_add(struct import_names *names, const char *name, struct memory *memory, uint32_t *ret_offset);

/* Returns the name at an offset that import_names_add gave. */
const char *import_names_get(const struct import_names *names, uint32_t offset);

#endif
