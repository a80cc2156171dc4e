/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/store/store_internal.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

enum { FOLDER = O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC };

bool store_is_absent(int number)
{
    return number == ENOENT || number == ENOTDIR || number == ELOOP || number == ESTALE;
}

void store_close_quietly(int descriptor)
{
    int number = errno;
    close(descriptor);
    errno = number;
}

/* Opens a folder within a folder. If it is missing, it is made first, and so that it survives a loss of power. */
static int open_within(int parent, const char *name, bool create)
{
    int folder = openat(parent, name, FOLDER);
    if (folder >= 0 || errno != ENOENT || !create)
        return folder;
    if ((mkdirat(parent, name, S_IRWXU) != 0 && errno != EEXIST) || fsync(parent) != 0)
        return -1;
    return openat(parent, name, FOLDER);
}

/* The directory itself may be missing, when its owner has removed the cache by hand. */
static int open_directory(const struct store *store, bool create)
{
    int directory = open(store->directory, FOLDER);
    if (directory >= 0 || errno != ENOENT || !create)
        return directory;
    return mkdir(store->directory, S_IRWXU) == 0 || errno == EEXIST ? open(store->directory, FOLDER) : -1;
}

int store_folder_open(const struct store *store, const char *generation, const char *folder, bool create)
{
    int directory = open_directory(store, create), descriptor = -1;
    if (directory < 0)
        return -1;
    int middle = open_within(directory, generation, create);
    if (middle >= 0) {
        descriptor = open_within(middle, folder, create);
        store_close_quietly(middle);
    }
    store_close_quietly(directory);
    return descriptor;
}

int store_shard_open(const struct store *store, const struct key *key, bool create, char ret_name[KEY_TEXT_SIZE])
{
    key_to_text(key, ret_name);
    const char shard[3] = {ret_name[0], ret_name[1], '\0'};
    return store_folder_open(store, store->generation, shard, create);
}
