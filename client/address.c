/* SPDX-License-Identifier: Apache-2.0 */
#include "client/address.h"

#include <stdlib.h>
#include <string.h>

#include "client/library.h"

static const char system_socket[] = "/run/bvhd/bvhd.sock";

/* Adds a path that is given in two parts. */
static bool add(struct address *address, const char *folder, const char *name)
{
    size_t folder_length = strlen(folder), name_size = strlen(name) + 1;
    char *path = memory_alloc(&library_memory, folder_length + name_size);
    if (!path)
        return false;
    memcpy(path, folder, folder_length);
    memcpy(path + folder_length, name, name_size);
    address->paths[address->count++] = path;
    return true;
}

static bool fill(struct address *address, const char *path)
{
    if (!path || !path[0])
        path = secure_getenv("BVHD_SOCKET");
    if (path && path[0])
        return add(address, path, "");
    const char *runtime = secure_getenv("XDG_RUNTIME_DIR");
    return (!runtime || !runtime[0] || add(address, runtime, "/bvhd.sock")) && add(address, system_socket, "");
}

bool address_init(struct address *address, const char *explicit_path)
{
    *address = (struct address){{NULL, NULL}, 0};
    bool filled = fill(address, explicit_path);
    if (!filled)
        address_finish(address);
    return filled;
}

void address_finish(struct address *address)
{
    for (uint32_t i = 0; i < address->count; i++)
        memory_free(&library_memory, address->paths[i]);
    address->count = 0;
}
