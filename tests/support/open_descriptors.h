/* SPDX-License-Identifier: Apache-2.0 */
/*
 * open_descriptors.h - how many descriptors this process has open, for tests that nothing is left over. The number
 * includes the one that counting takes, and so is good for comparisons only.
 */
#ifndef BVHD_OPEN_DESCRIPTORS_H
#define BVHD_OPEN_DESCRIPTORS_H

#include <dirent.h>

#include "tests/support/unit.h"

static inline int open_descriptors(void)
{
    DIR *folder = opendir("/proc/self/fd");
    int count = 0;
    assert_non_null(folder);
    while (readdir(folder))
        count++;
    closedir(folder);
    return count;
}

#endif
