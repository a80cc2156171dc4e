/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/base/files.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include "client/bvhctl/base/interrupt.h"

enum { TAIL = 6, ATTEMPTS = 100 };

static enum bvhd_status system_error(struct bvhd_error *error, const char *path, int number)
{
    enum bvhd_status status = number == ENOENT ? BVHD_NOT_FOUND : number == ENOMEM ? BVHD_NO_MEMORY : BVHD_IO;
    return bvhd_error_set(error, status, path, "%s", strerror(number));
}

/* Opens a file without blocking, and refuses pipes and devices, so that bvhctl never waits for their data. */
static enum bvhd_status open_regular(const char *path, int *ret_descriptor, uint64_t *ret_size,
                                     struct bvhd_error *error)
{
    int descriptor = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (descriptor < 0)
        return system_error(error, path, errno);
    struct stat status;
    if (fstat(descriptor, &status) < 0 || !S_ISREG(status.st_mode)) {
        close(descriptor);
        return bvhd_error_set(error, BVHD_IO, path, "not a regular file");
    }
    *ret_descriptor = descriptor;
    *ret_size = (uint64_t)status.st_size;
    return BVHD_OK;
}

static bool read_all(int descriptor, unsigned char *data, uint64_t size)
{
    for (uint64_t done = 0; done < size;) {
        ssize_t got = read(descriptor, data + done, size - done);
        if (got < 0 && errno == EINTR)
            continue;
        if (got == 0)
            errno = EIO; /* the file has become shorter meanwhile */
        if (got <= 0)
            return false;
        done += (uint64_t)got;
    }
    return true;
}

static bool write_all(int descriptor, struct bytes content)
{
    for (uint64_t done = 0; done < content.size;) {
        ssize_t put = write(descriptor, content.data + done, content.size - done);
        if (put < 0 && errno == EINTR)
            continue;
        if (put < 0)
            return false;
        done += (uint64_t)put;
    }
    return true;
}

enum bvhd_status files_read(const char *path, uint64_t limit, struct memory *memory, unsigned char **ret_data,
                            uint64_t *ret_size, struct bvhd_error *error)
{
    int descriptor;
    uint64_t size;
    enum bvhd_status status = open_regular(path, &descriptor, &size, error);
    if (status != BVHD_OK)
        return status;
    unsigned char *data = NULL;
    if (size > limit)
        status = bvhd_error_set(error, BVHD_TOO_LARGE, path, "%llu bytes, at most %llu are read",
                                (unsigned long long)size, (unsigned long long)limit);
    else if (size && !(data = memory_alloc(memory, size)))
        status = bvhd_error_no_memory(error, path, "no memory for %llu bytes", (unsigned long long)size);
    else if (!read_all(descriptor, data, size))
        status = system_error(error, path, errno);
    close(descriptor);
    if (status != BVHD_OK) {
        memory_free(memory, data);
        return status;
    }
    *ret_data = data;
    *ret_size = size;
    return BVHD_OK;
}

static bool has_content(const char *path, struct bytes content)
{
    int descriptor = -1;
    uint64_t size = 0;
    if (open_regular(path, &descriptor, &size, NULL) != BVHD_OK)
        return false;
    bool same = size == content.size;
    unsigned char chunk[65536];
    for (uint64_t done = 0; same && done < size;) {
        uint64_t step = size - done < sizeof chunk ? size - done : sizeof chunk;
        same = read_all(descriptor, chunk, step) && !memcmp(chunk, content.data + done, step);
        done += step;
    }
    close(descriptor);
    return same;
}

/* A temporary file is created so that only its owner may read it; this sets the mode that any new file would have. */
static bool set_default_mode(int descriptor)
{
    mode_t mask = umask(0);
    umask(mask);
    return fchmod(descriptor, 0666 & ~mask) == 0;
}

/*
 * Creates a file whose name is `temporary` with random letters for its last six. The name is told to the handler of
 * interrupts first, for which mkostemp leaves no time.
 */
static int create_temporary(char *temporary)
{
    static const char letters[] = "0123456789abcdefghijklmnopqrstuvwxyz";
    char *tail = temporary + strlen(temporary) - TAIL;
    int descriptor = -1;
    for (int attempt = 0; attempt < ATTEMPTS && descriptor < 0; attempt++) {
        unsigned char random[TAIL];
        if (getrandom(random, sizeof random, 0) != sizeof random)
            return -1;
        for (int i = 0; i < TAIL; i++)
            tail[i] = letters[random[i] % (sizeof letters - 1)];
        interrupt_removes(temporary);
        descriptor = open(temporary, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
        if (descriptor < 0)
            interrupt_removes(NULL);
        if (descriptor < 0 && errno != EEXIST)
            return -1;
    }
    return descriptor;
}

static enum bvhd_status replace(const char *path, char *temporary, struct bytes content, struct bvhd_error *error)
{
    int descriptor = create_temporary(temporary);
    if (descriptor < 0)
        return system_error(error, path, errno);
    int number = set_default_mode(descriptor) && write_all(descriptor, content) ? 0 : errno;
    if (close(descriptor) < 0 && !number)
        number = errno;
    if (!number && rename(temporary, path) < 0)
        number = errno;
    if (number)
        unlink(temporary);
    interrupt_removes(NULL);
    return number ? system_error(error, path, number) : BVHD_OK;
}

/* Resolves a symbolic link. BVHD_IO when the path exists and is neither a regular file nor a link to one. */
static enum bvhd_status find_place(const char *path, char ret_place[PATH_MAX], struct bvhd_error *error)
{
    struct stat status;
    int known = lstat(path, &status);
    if (known < 0 && errno != ENOENT)
        return system_error(error, path, errno);
    bool is_link = known == 0 && S_ISLNK(status.st_mode);
    if (is_link && (!realpath(path, ret_place) || stat(ret_place, &status) < 0))
        return system_error(error, path, errno);
    if (known == 0 && !S_ISREG(status.st_mode))
        return bvhd_error_set(error, BVHD_IO, path, "not a regular file");
    if (!is_link && snprintf(ret_place, PATH_MAX, "%s", path) >= PATH_MAX)
        return system_error(error, path, ENAMETOOLONG);
    return BVHD_OK;
}

enum bvhd_status files_write(const char *path, struct bytes content, struct memory *memory, bool *ret_changed,
                             struct bvhd_error *error)
{
    char place[PATH_MAX];
    enum bvhd_status status = find_place(path, place, error);
    if (status != BVHD_OK)
        return status;
    bool changed = !has_content(place, content);
    if (changed) {
        uint64_t size = strlen(place) + sizeof ".XXXXXX";
        char *temporary = memory_alloc(memory, size);
        if (!temporary)
            return bvhd_error_no_memory(error, path, "no memory for its name");
        snprintf(temporary, size, "%s.XXXXXX", place);
        status = replace(place, temporary, content, error);
        memory_free(memory, temporary);
        if (status != BVHD_OK)
            return status;
    }
    if (ret_changed)
        *ret_changed = changed;
    return BVHD_OK;
}

enum bvhd_status files_stream_begin(struct files_stream *stream, const char *path, struct memory *memory,
                                    struct bvhd_error *error)
{
    char place[PATH_MAX];
    enum bvhd_status status = find_place(path, place, error);
    if (status != BVHD_OK)
        return status;
    uint64_t size = strlen(place) + sizeof ".XXXXXX";
    *stream = (struct files_stream){.memory = memory, .descriptor = -1};
    stream->path = files_copy_text(memory, path);
    stream->place = files_copy_text(memory, place);
    stream->temporary = memory_alloc(memory, size);
    if (!stream->path || !stream->place || !stream->temporary) {
        files_stream_abandon(stream);
        return bvhd_error_no_memory(error, path, "no memory for its name");
    }
    snprintf(stream->temporary, size, "%s.XXXXXX", place);
    stream->descriptor = create_temporary(stream->temporary);
    if (stream->descriptor >= 0)
        return BVHD_OK;
    status = system_error(error, path, errno);
    files_stream_abandon(stream);
    return status;
}

bool files_stream_put(struct files_stream *stream, struct bytes content)
{
    if (!stream->failure && !write_all(stream->descriptor, content))
        stream->failure = errno ? errno : EIO;
    stream->size += content.size;
    return !stream->failure;
}

/* Returns whether two files have the same bytes. */
static bool have_same_content(int descriptor, uint64_t size, const char *path)
{
    int other = -1;
    uint64_t other_size = 0;
    if (open_regular(path, &other, &other_size, NULL) != BVHD_OK)
        return false;
    bool same = size == other_size && lseek(descriptor, 0, SEEK_SET) == 0;
    unsigned char chunks[2][32768];
    for (uint64_t done = 0; same && done < size;) {
        uint64_t step = size - done < sizeof chunks[0] ? size - done : sizeof chunks[0];
        same = read_all(descriptor, chunks[0], step) && read_all(other, chunks[1], step) &&
               !memcmp(chunks[0], chunks[1], step);
        done += step;
    }
    close(other);
    return same;
}

/* Returns 0 or an errno. *ret_changed says whether the temporary file has become the file. */
static int finish_stream(struct files_stream *stream, struct bytes head, bool *ret_changed)
{
    if (stream->failure)
        return stream->failure;
    if (pwrite(stream->descriptor, head.data, head.size, 0) != (ssize_t)head.size)
        return errno ? errno : EIO;
    *ret_changed = !have_same_content(stream->descriptor, stream->size, stream->place);
    if (!*ret_changed)
        return 0;
    if (!set_default_mode(stream->descriptor) || rename(stream->temporary, stream->place) < 0)
        return errno;
    memory_free(stream->memory, stream->temporary);
    stream->temporary = NULL;
    return 0;
}

enum bvhd_status files_stream_end(struct files_stream *stream, struct bytes head, bool *ret_changed,
                                  struct bvhd_error *error)
{
    bool changed = false;
    int number = finish_stream(stream, head, &changed);
    enum bvhd_status status = number ? system_error(error, stream->path, number) : BVHD_OK;
    files_stream_abandon(stream);
    if (status == BVHD_OK && ret_changed)
        *ret_changed = changed;
    return status;
}

void files_stream_abandon(struct files_stream *stream)
{
    if (!stream || !stream->memory)
        return;
    if (stream->descriptor >= 0) {
        close(stream->descriptor);
        if (stream->temporary)
            unlink(stream->temporary);
        interrupt_removes(NULL);
    }
    memory_free(stream->memory, stream->path);
    memory_free(stream->memory, stream->place);
    memory_free(stream->memory, stream->temporary);
    *stream = (struct files_stream){0};
}

enum bvhd_status files_make_directory(const char *path, struct bvhd_error *error)
{
    char folder[4096];
    size_t length = strlen(path);
    if (length == 0 || length >= sizeof folder)
        return bvhd_error_set(error, BVHD_IO, path, "not a usable path");
    memcpy(folder, path, length + 1);
    for (size_t i = 1; i <= length; i++) {
        if (folder[i] != '/' && folder[i] != '\0')
            continue;
        char end = folder[i];
        folder[i] = '\0';
        if (mkdir(folder, 0777) < 0 && errno != EEXIST)
            return system_error(error, folder, errno);
        folder[i] = end;
    }
    if (!files_is_directory(path))
        return bvhd_error_set(error, BVHD_IO, path, "not a directory");
    return BVHD_OK;
}

bool files_is_directory(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0 && S_ISDIR(status.st_mode);
}

char *files_join(struct memory *memory, const char *directory, const char *name)
{
    size_t length = strlen(directory);
    while (length > 0 && directory[length - 1] == '/')
        length--;
    uint64_t size = length + strlen(name) + 2;
    char *path = memory_alloc(memory, size);
    if (path)
        snprintf(path, size, "%.*s/%s", (int)length, directory, name);
    return path;
}

char *files_copy_text(struct memory *memory, const char *text)
{
    uint64_t size = strlen(text) + 1;
    char *copy = memory_alloc(memory, size);
    if (copy)
        memcpy(copy, text, size);
    return copy;
}
