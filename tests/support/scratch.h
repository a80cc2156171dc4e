/* SPDX-License-Identifier: Apache-2.0 */
/* scratch.h - a scratch folder for a test program. Included after unit.h. */
#ifndef BVHD_SCRATCH_H
#define BVHD_SCRATCH_H

#include <unistd.h>

static char scratch_folder[64]; /* its path, between set-up and tear-down */

/* Group set-up: makes the folder. */
static inline int scratch_make(void **state)
{
    (void)state;
    strcpy(scratch_folder, "/tmp/bvhd-test-XXXXXX");
    return mkdtemp(scratch_folder) ? 0 : -1;
}

/* Set-up: makes the folder in memory, if this machine has /dev/shm, so that syncing files does not take long. */
static inline int scratch_make_in_memory(void **state)
{
    if (access("/dev/shm", W_OK) != 0)
        return scratch_make(state);
    strcpy(scratch_folder, "/dev/shm/bvhd-test-XXXXXX");
    return mkdtemp(scratch_folder) ? 0 : -1;
}

/* Group set-up: makes the folder and enters it. */
static inline int scratch_enter(void **state)
{
    return scratch_make(state) == 0 ? chdir(scratch_folder) : -1;
}

/* Group tear-down after either: leaves the folder and removes it with its files. */
static inline int scratch_remove(void **state)
{
    (void)state;
    char command[128];
    snprintf(command, sizeof command, "rm -rf '%s'", scratch_folder);
    return chdir("/") == 0 ? system(command) : -1;
}

#endif
