/* SPDX-License-Identifier: Apache-2.0 */
#include "client/bvhctl/scene/import_files.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>

#include "client/bvhctl/base/files.h"
#include "client/bvhctl/scene/import_limits.h"

static FILE *stream_of(struct aiFile *file)
{
    return (FILE *)(void *)file->UserData;
}

static size_t file_read(struct aiFile *file, char *buffer, size_t size, size_t count)
{
    return fread(buffer, size, count, stream_of(file));
}

static size_t file_write(struct aiFile *file, const char *buffer, size_t size, size_t count)
{
    (void)file, (void)buffer, (void)size, (void)count;
    return 0;
}

static size_t file_tell(struct aiFile *file)
{
    long at = ftell(stream_of(file));
    return at < 0 ? 0 : (size_t)at;
}

static size_t file_size(struct aiFile *file)
{
    struct stat status;
    return fstat(fileno(stream_of(file)), &status) < 0 ? 0 : (size_t)status.st_size;
}

static enum aiReturn file_seek(struct aiFile *file, size_t offset, enum aiOrigin origin)
{
    int whence = origin == aiOrigin_SET ? SEEK_SET : origin == aiOrigin_CUR ? SEEK_CUR : SEEK_END;
    return fseek(stream_of(file), (long)offset, whence) == 0 ? aiReturn_SUCCESS : aiReturn_FAILURE;
}

static void file_flush(struct aiFile *file)
{
    (void)file;
}

static bool is_recorded(const struct import_files *files, const char *path)
{
    for (uint32_t i = 0; i < files->count; i++)
        if (!strcmp(files->paths[i], path))
            return true;
    return false;
}

static void record(struct import_files *files, const char *path)
{
    if (files->count == files->capacity) {
        uint32_t capacity = files->capacity * 2 + 8;
        char **paths = memory_resize(files->memory, files->paths, capacity * sizeof *paths);
        files->failed |= !paths;
        if (!paths)
            return;
        files->paths = paths;
        files->capacity = capacity;
    }
    char *copy = files_copy_text(files->memory, path);
    files->failed |= !copy;
    if (copy)
        files->paths[files->count++] = copy;
}

/* Records a file before it is first read. */
static void note_file(struct import_files *files, const char *path)
{
    struct stat status;
    if (is_recorded(files, path) || stat(path, &status) < 0)
        return;
    import_limits_allow((uint64_t)status.st_size);
    record(files, path);
}

/* Opens regular files only: a directory could be opened as a stream too, and a pipe would wait for a writer. */
static FILE *open_stream(const char *path)
{
    struct stat status;
    return stat(path, &status) == 0 && S_ISREG(status.st_mode) ? fopen(path, "rbe") : NULL;
}

static struct aiFile *open_file(struct aiFileIO *io, const char *path, const char *mode)
{
    struct import_files *files = (struct import_files *)(void *)io->UserData;
    FILE *stream = mode[0] == 'r' ? open_stream(path) : NULL;
    struct aiFile *file = stream ? malloc(sizeof *file) : NULL;
    if (!file) {
        if (stream)
            fclose(stream);
        return NULL;
    }
    *file = (struct aiFile){.ReadProc = file_read,
                            .WriteProc = file_write,
                            .TellProc = file_tell,
                            .FileSizeProc = file_size,
                            .SeekProc = file_seek,
                            .FlushProc = file_flush,
                            .UserData = (aiUserData)(void *)stream};
    note_file(files, path);
    return file;
}

enum bvhd_status import_files_map(struct import_files *files, const char *path, struct bytes *ret_bytes,
                                  struct bvhd_error *error)
{
    struct stat status;
    FILE *stream = open_stream(path);
    if (!stream || fstat(fileno(stream), &status) < 0) {
        bool is_there = stat(path, &status) == 0;
        if (stream)
            fclose(stream);
        return bvhd_error_set(error, is_there ? BVHD_UNSUPPORTED : BVHD_NOT_FOUND, path, "%s",
                              is_there ? "not a file that can be read" : "no such file");
    }
    note_file(files, path);
    *ret_bytes = (struct bytes){0};
    void *map =
        status.st_size > 0 ? mmap(NULL, (size_t)status.st_size, PROT_READ, MAP_PRIVATE, fileno(stream), 0) : NULL;
    fclose(stream);
    if (map == MAP_FAILED)
        return bvhd_error_no_memory(error, path, "no memory to map it");
    *ret_bytes = (struct bytes){map, (uint64_t)status.st_size};
    return BVHD_OK;
}

void import_files_unmap(struct bytes bytes)
{
    if (bytes.data)
        munmap((void *)(uintptr_t)bytes.data, bytes.size);
}

static void close_file(struct aiFileIO *io, struct aiFile *file)
{
    (void)io;
    fclose(stream_of(file));
    free(file);
}

void import_files_init(struct import_files *files, struct memory *memory)
{
    *files = (struct import_files){.io = {.OpenProc = open_file, .CloseProc = close_file}, .memory = memory};
    files->io.UserData = (aiUserData)(void *)files;
}
