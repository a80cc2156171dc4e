/* SPDX-License-Identifier: Apache-2.0 */
#include "tests/support/daemon/process_view.h"

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static const char *const kind_names[PROCESS_KINDS] = {"sockets", "results", "memfds", "events", "pipes", "files"};

static enum process_kind kind_of(const char *target)
{
    static const struct {
        const char *beginning;
        enum process_kind kind;
    } kinds[] = {{"socket:", PROCESS_SOCKET},
                 {"/memfd:bvhd-blob", PROCESS_RESULT},
                 {"/memfd:", PROCESS_MEMFD},
                 {"anon_inode:", PROCESS_EVENT},
                 {"pipe:", PROCESS_PIPE}};
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
        if (!strncmp(target, kinds[i].beginning, strlen(kinds[i].beginning)))
            return kinds[i].kind;
    return PROCESS_FILE;
}

/* Calls `visit` with the path in /proc of each descriptor, and with what it leads to. */
static void for_descriptors(pid_t pid, void (*visit)(void *context, const char *path, const char *target),
                            void *context)
{
    char folder[64], path[512], target[256];
    snprintf(folder, sizeof folder, "/proc/%d/fd", (int)pid);
    DIR *directory = opendir(folder);
    for (const struct dirent *entry; directory && (entry = readdir(directory));) {
        snprintf(path, sizeof path, "%s/%s", folder, entry->d_name);
        ssize_t length = entry->d_name[0] == '.' ? -1 : readlink(path, target, sizeof target - 1);
        bool is_own = pid == getpid() && atoi(entry->d_name) == dirfd(directory);
        if (length < 0 || is_own)
            continue;
        target[length] = '\0';
        visit(context, path, target);
    }
    if (directory)
        closedir(directory);
}

static void count_one(void *context, const char *path, const char *target)
{
    (void)path;
    ((struct process_descriptors *)context)->count[kind_of(target)]++;
}

struct process_descriptors process_descriptors(pid_t pid)
{
    struct process_descriptors descriptors = {{0}};
    for_descriptors(pid, count_one, &descriptors);
    return descriptors;
}

void process_descriptors_text(const struct process_descriptors *descriptors, char ret_text[160])
{
    size_t at = 0;
    for (int kind = 0; kind < PROCESS_KINDS; kind++)
        at += (size_t)snprintf(ret_text + at, 160 - at, "%s%u %s", kind > 0 ? ", " : "", descriptors->count[kind],
                               kind_names[kind]);
}

uint64_t process_private_bytes(pid_t pid)
{
    char path[64], line[256];
    unsigned long long value, anonymous = 0, lazy = 0;
    snprintf(path, sizeof path, "/proc/%d/smaps_rollup", (int)pid);
    FILE *file = fopen(path, "re");
    while (file && fgets(line, sizeof line, file)) {
        if (sscanf(line, "Anonymous: %llu kB", &value) == 1)
            anonymous = value;
        if (sscanf(line, "LazyFree: %llu kB", &value) == 1)
            lazy = value;
    }
    if (file)
        fclose(file);
    return anonymous > lazy ? (anonymous - lazy) * 1024 : 0;
}

struct result_files {
    ino_t *seen;
    size_t count, capacity;
    uint64_t bytes;
};

static void add_result(void *context, const char *path, const char *target)
{
    struct result_files *files = context;
    struct stat about;
    if (kind_of(target) != PROCESS_RESULT || stat(path, &about) != 0)
        return;
    for (size_t i = 0; i < files->count; i++)
        if (files->seen[i] == about.st_ino)
            return;
    if (files->count == files->capacity) {
        files->capacity = 2 * files->capacity + 64;
        files->seen = realloc(files->seen, files->capacity * sizeof *files->seen);
        if (!files->seen)
            abort();
    }
    files->seen[files->count++] = about.st_ino;
    files->bytes += (uint64_t)about.st_blocks * 512;
}

uint64_t process_result_bytes(const pid_t *pids, uint32_t count)
{
    struct result_files files = {0};
    for (uint32_t i = 0; i < count; i++)
        for_descriptors(pids[i], add_result, &files);
    free(files.seen);
    return files.bytes;
}
