/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/store/walk.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

static bool is_digit(char c)
{
    return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
}

/* Returns whether a name consists of `count` hexadecimal digits in lower case. */
static bool is_hexadecimal(const char *name, size_t count)
{
    size_t digits = 0;
    while (is_digit(name[digits]))
        digits++;
    return digits == count && name[digits] == '\0';
}

bool walk_is_generation(const char *name)
{
    static const char *const beginnings[] = {"release-", "development-"};
    for (int i = 0; i < 2; i++) {
        size_t size = strlen(beginnings[i]);
        const char *rest = name + size;
        if (strncmp(name, beginnings[i], size) == 0)
            return *rest && strlen(name) < STORE_GENERATION_SIZE &&
                   rest[strspn(rest, "0123456789abcdefghijklmnopqrstuvwxyz")] == '\0';
    }
    return false;
}

static bool is_folder(const char *name)
{
    return is_hexadecimal(name, 2) || strcmp(name, STORE_DAMAGED) == 0;
}

static bool is_file(const char *name)
{
    return is_hexadecimal(name, KEY_TEXT_SIZE - 1) || strncmp(name, STORE_TEMPORARY, strlen(STORE_TEMPORARY)) == 0;
}

/* A folder that is read; the names of the folders above it. */
struct level {
    struct walk *walk;
    const struct store *store;
    const char *generation, *folder; /* NULL: it is above */
};

static enum bvhd_status read_folder(const struct level *level, int parent, const char *name, struct bvhd_error *error);

static bool is_cancelled(const struct store *store)
{
    return store->cancel && atomic_load_explicit(store->cancel, memory_order_relaxed);
}

/* A time that no clock had before 1970 or after 2096 counts as the nearest one that a clock may have. */
static int64_t used_ns(const struct stat *about)
{
    const int64_t last = INT64_C(4000000000);
    int64_t seconds = about->st_mtim.tv_sec;
    return (seconds < 0 ? 0 : seconds > last ? last : seconds) * 1000000000 + about->st_mtim.tv_nsec;
}

static enum bvhd_status visit_file(const struct level *level, int folder, const char *name, struct bvhd_error *error)
{
    struct stat about;
    if (is_cancelled(level->store))
        return bvhd_error_set(error, BVHD_CANCELLED, level->store->directory, "cancelled");
    if (fstatat(folder, name, &about, AT_SYMLINK_NOFOLLOW) != 0 || S_ISDIR(about.st_mode))
        return BVHD_OK;
    struct walk_file file = {.kind = strcmp(level->folder, STORE_DAMAGED) == 0 ? WALK_DAMAGED
                                     : name[0] == '.'                          ? WALK_TEMPORARY
                                                                               : WALK_ENTRY,
                             .generation = level->generation,
                             .folder = level->folder,
                             .name = name,
                             .descriptor = folder,
                             .bytes = store_bytes_of((uint64_t)about.st_size),
                             .used_ns = used_ns(&about)};
    return level->walk->visit(level->walk, &file, error);
}

/* Visits what is called `name` in a folder of that level, if it is the store's. */
static enum bvhd_status visit(const struct level *level, int folder, const char *name, struct bvhd_error *error)
{
    struct level below = *level;
    if (level->folder)
        return is_file(name) ? visit_file(level, folder, name, error) : BVHD_OK;
    if (level->generation ? !is_folder(name) : !walk_is_generation(name))
        return BVHD_OK;
    if (level->generation)
        below.folder = name;
    else
        below.generation = name;
    enum bvhd_status status = read_folder(&below, folder, name, error);
    if (status == BVHD_OK && (level->walk->all || strcmp(below.generation, level->store->generation) != 0))
        unlinkat(folder, name, AT_REMOVEDIR); /* it stays unless it is empty */
    return status;
}

static enum bvhd_status unreadable(const struct level *level, const char *name, struct bvhd_error *error)
{
    return store_is_absent(errno) ? BVHD_OK : store_failed(level->store, name, "reading the folder", error);
}

static enum bvhd_status read_folder(const struct level *level, int parent, const char *name, struct bvhd_error *error)
{
    int descriptor = openat(parent, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (descriptor < 0)
        return unreadable(level, name, error);
    DIR *folder = fdopendir(descriptor);
    if (!folder) {
        close(descriptor);
        return bvhd_error_no_memory(error, name, "no memory to read the folder");
    }
    enum bvhd_status status = BVHD_OK;
    const struct dirent *entry;
    while (status == BVHD_OK && (errno = 0, entry = readdir(folder)))
        status = visit(level, descriptor, entry->d_name, error);
    if (status == BVHD_OK && errno)
        status = unreadable(level, name, error);
    closedir(folder);
    return status;
}

enum bvhd_status walk_run(struct walk *walk, const struct store *store, struct bvhd_error *error)
{
    const struct level top = {.walk = walk, .store = store};
    return read_folder(&top, AT_FDCWD, store->directory, error);
}
