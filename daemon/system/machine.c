/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/system/machine.h"

#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define GROUPS "/sys/fs/cgroup"

/* Finds the path of the process's control group (version 2). It is "" if there is none, or if it is the root. */
static void find_group(char ret_path[PATH_MAX])
{
    char line[PATH_MAX];
    FILE *file = fopen("/proc/self/cgroup", "re");
    ret_path[0] = '\0';
    while (file && fgets(line, sizeof line, file)) {
        if (strncmp(line, "0::/", 4) != 0)
            continue;
        line[strcspn(line, "\n")] = '\0';
        snprintf(ret_path, PATH_MAX, "%s", line + 3);
    }
    if (file)
        fclose(file);
    if (strcmp(ret_path, "/") == 0)
        ret_path[0] = '\0';
}

/* Returns UINT64_MAX for "max", which means that the group has no limit, and for a file that cannot be read. */
static uint64_t read_limit(const char *group)
{
    char path[2 * PATH_MAX];
    uint64_t limit = UINT64_MAX;
    snprintf(path, sizeof path, GROUPS "%s/memory.max", group);
    FILE *file = fopen(path, "re");
    if (!file)
        return limit;
    if (fscanf(file, "%" SCNu64, &limit) != 1)
        limit = UINT64_MAX;
    fclose(file);
    return limit;
}

/* Returns the least limit of the group and its ancestors, since each of them applies. */
static uint64_t group_limit(void)
{
    char group[PATH_MAX];
    uint64_t least = UINT64_MAX;
    find_group(group);
    for (;;) {
        uint64_t limit = read_limit(group);
        least = limit < least ? limit : least;
        char *slash = strrchr(group, '/');
        if (!slash)
            return least;
        *slash = '\0';
    }
}

uint64_t machine_memory(void)
{
    long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);
    uint64_t all = pages > 0 && size > 0 ? (uint64_t)pages * (uint64_t)size : UINT64_C(1) << 30;
    uint64_t group = group_limit();
    return group < all ? group : all;
}
