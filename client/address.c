/* SPDX-License-Identifier: Apache-2.0 */
#include "client/address.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "client/library.h"

/* Returns both parts as one text. */
static char *join(struct memory *memory, const char *first, const char *second)
{
    uint64_t size = strlen(first) + strlen(second) + 1;
    char *text = memory_alloc(memory, size);
    if (text)
        snprintf(text, size, "%s%s", first, second);
    return text;
}

/* Returns $XDG_RUNTIME_DIR if it is a directory of this user, else NULL. */
static const char *runtime_directory(void)
{
    const char *path = secure_getenv("XDG_RUNTIME_DIR");
    struct stat status;
    bool usable =
        path && *path == '/' && stat(path, &status) == 0 && S_ISDIR(status.st_mode) && status.st_uid == geteuid();
    return usable ? path : NULL;
}

char *address_user_directory(struct memory *memory, bool *ret_is_runtime)
{
    const char *runtime = runtime_directory();
    *ret_is_runtime = runtime != NULL;
    if (runtime)
        return join(memory, runtime, "");
    const char *temporary = secure_getenv("TMPDIR");
    char name[32];
    snprintf(name, sizeof name, "/bvhd-%u", (unsigned)geteuid());
    return join(memory, temporary && *temporary == '/' ? temporary : "/tmp", name);
}

bool address_is_own(const char *directory)
{
    struct stat status;
    return lstat(directory, &status) == 0 && S_ISDIR(status.st_mode) && status.st_uid == geteuid() &&
           !(status.st_mode & 077);
}

/* Adds a place that may lie in any directory. */
static bool add(struct address *address, const char *path)
{
    char *copy = join(&library_memory, path, "");
    if (copy)
        address->places[address->count++] = (struct address_place){copy, NULL};
    return copy != NULL;
}

static bool add_user(struct address *address)
{
    bool is_runtime;
    char *directory = address_user_directory(&library_memory, &is_runtime);
    char *path = directory ? join(&library_memory, directory, "/bvhd.sock") : NULL;
    if (path)
        address->places[address->count++] = (struct address_place){path, is_runtime ? NULL : directory};
    if (!path || is_runtime)
        memory_free(&library_memory, directory);
    return path != NULL;
}

static bool fill(struct address *address, const char *path)
{
    if (!path || !path[0])
        path = secure_getenv("BVHD_SOCKET");
    address->is_named = path && path[0];
    return address->is_named ? add(address, path) : add_user(address) && add(address, ADDRESS_SYSTEM_SOCKET);
}

bool address_init(struct address *address, const char *explicit_path)
{
    *address = (struct address){0};
    bool filled = fill(address, explicit_path);
    if (!filled)
        address_finish(address);
    return filled;
}

void address_finish(struct address *address)
{
    for (uint32_t i = 0; i < address->count; i++) {
        memory_free(&library_memory, address->places[i].path);
        memory_free(&library_memory, address->places[i].own_directory);
    }
    address->count = 0;
}
