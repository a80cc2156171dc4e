/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import_process.c - implements import_scene of import.h: a child process reads the file and passes the result through
 * a memory file, so that a crash of assimp ends only the child.
 */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "proto/base/bytes.h"
#include "client/bvhctl/scene/import.h"

enum { CPU_SECONDS = 60, BYTES_A_SECOND = 1000000 }; /* processor time for a file: a constant, and more for its size */

/*
 * The memory for a scene, in bytes, to which each opened file adds (import_files.c). A limit is needed, because a few
 * hundred bytes of nodes that refer to each other can expand without end.
 */
static const rlim_t memory_base = (rlim_t)4 << 30;

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer) || __has_feature(memory_sanitizer)
#define HAS_SHADOW_MEMORY
#endif
#endif
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define HAS_SHADOW_MEMORY
#endif

/* The header of the memory file. */
struct outcome {
    bool is_complete;
    struct bvhd_error error; /* if its status is BVHD_OK, the data of the import follow */
    struct import import; /* only its numbers are valid, not its pointers */
};

enum { ALIGNMENT = 64, PADDING = 16, BUFFER_SIZE = 1 << 18 };

/* The memory file while it is written. Arrays are aligned in it, so that they can be used where they are. */
struct file_writer {
    FILE *file;
    uint64_t at;
};

static void put(struct file_writer *writer, const void *data, uint64_t size)
{
    if (size)
        fwrite(data, 1, size, writer->file);
    writer->at += size;
}

/* Puts an array with some bytes behind it, which those who read it in wide words may touch. `data` may be NULL. */
static void put_array(struct file_writer *writer, const void *data, uint64_t size)
{
    static const unsigned char zeros[ALIGNMENT];
    put(writer, zeros, bytes_align(writer->at, ALIGNMENT) - writer->at);
    if (data)
        put(writer, data, size);
    for (uint64_t i = data ? size : 0; i < size; i += sizeof zeros)
        put(writer, zeros, size - i < sizeof zeros ? size - i : sizeof zeros);
    put(writer, zeros, PADDING);
}

static void put_text(struct file_writer *writer, const char *text)
{
    uint64_t size = strlen(text) + 1;
    put(writer, &size, sizeof size);
    put(writer, text, size);
}

static void put_import(struct file_writer *writer, const struct import *import)
{
    put_text(writer, import->name);
    put_text(writer, import->source_name ? import->source_name : "");
    put_array(writer, import->meshes, import->mesh_count * sizeof *import->meshes);
    for (uint32_t i = 0; i < import->mesh_count; i++) {
        const struct import_mesh *mesh = &import->meshes[i];
        put_text(writer, mesh->name);
        put_text(writer, mesh->material);
        put_array(writer, mesh->positions, mesh->vertex_count * UINT64_C(12));
        put_array(writer, mesh->indices, mesh->triangle_count * UINT64_C(12));
    }
    put_array(writer, import->bottoms, import->bottom_count * sizeof *import->bottoms);
    for (uint32_t i = 0; i < import->bottom_count; i++) {
        const struct import_bottom *bottom = &import->bottoms[i];
        put_text(writer, bottom->name);
        put_array(writer, bottom->meshes, bottom->mesh_count * sizeof *bottom->meshes);
    }
    put_array(writer, import->instances, import->instance_count * sizeof *import->instances);
    put_array(writer, NULL, import->file_count * sizeof *import->files); /* room for the pointers */
    for (uint32_t i = 0; i < import->file_count; i++)
        put_text(writer, import->files[i]);
}

typedef enum bvhd_status reader(const char *path, const char *scene, struct memory *memory, struct import *ret_import,
                                struct bvhd_error *error);

/* Reads the scene in the child, which exits here, unless assimp crashes it before. */
__attribute__((noreturn)) static void read_in_child(reader *read, const char *path, const char *scene, int descriptor,
                                                    struct memory *memory)
{
    struct outcome outcome = {0};
    enum bvhd_status status = read(path, scene, memory, &outcome.import, &outcome.error);
    outcome.error.status = status;
    FILE *file = fdopen(descriptor, "w");
    if (!file)
        _exit(1);
    setvbuf(file, NULL, _IOFBF, BUFFER_SIZE);
    struct file_writer writer = {.file = file};
    put(&writer, &outcome, sizeof outcome);
    if (!status)
        put_import(&writer, &outcome.import);
    bool ok = fflush(file) == 0 && !ferror(file);
    outcome.is_complete = true;
    if (ok && pwrite(descriptor, &outcome, sizeof outcome, 0) == (ssize_t)sizeof outcome)
        _exit(0);
    _exit(1);
}

/* Returns the address space in use. Stacks of threads and heaps take much of it before anything is read. */
static rlim_t used_memory(void)
{
    unsigned long long pages = 0;
    FILE *file = fopen("/proc/self/statm", "re");
    if (file && fscanf(file, "%llu", &pages) != 1)
        pages = 0;
    if (file)
        fclose(file);
    return (rlim_t)pages * (rlim_t)sysconf(_SC_PAGESIZE);
}

/* Does nothing under a sanitizer, whose shadow memory takes terabytes of address space but uses hardly any of it. */
static void limit_memory(void)
{
#ifdef HAS_SHADOW_MEMORY
    (void)used_memory, (void)memory_base;
#else
    struct rlimit limit;
    rlim_t wanted = used_memory() + memory_base;
    if (getrlimit(RLIMIT_AS, &limit) == 0 && wanted < limit.rlim_cur) {
        limit.rlim_cur = wanted;
        setrlimit(RLIMIT_AS, &limit);
    }
#endif
}

/* Limits the child: no core file, finite time and memory, no output, and it is killed when its parent dies. */
static void prepare_child(const char *path)
{
    struct stat file;
    rlim_t seconds = CPU_SECONDS + (rlim_t)(stat(path, &file) < 0 ? 0 : file.st_size / BYTES_A_SECOND);
    setrlimit(RLIMIT_CPU, &(struct rlimit){seconds, seconds});
    limit_memory();
    setrlimit(RLIMIT_CORE, &(struct rlimit){0, 0});
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    signal(SIGINT, SIG_DFL);
    signal(SIGTERM, SIG_DFL);
    int nowhere = open("/dev/null", O_WRONLY | O_CLOEXEC);
    if (nowhere >= 0) {
        dup2(nowhere, STDOUT_FILENO);
        dup2(nowhere, STDERR_FILENO);
    }
}

/* The memory file after it was read into one block, in which the import stays. */
struct file_cursor {
    unsigned char *block;
    uint64_t at, size;
    bool ok; /* nothing was beyond the end so far */
};

/* Returns the next bytes, or NULL after an error. */
static void *take(struct file_cursor *cursor, uint64_t size)
{
    cursor->ok = cursor->ok && cursor->at <= cursor->size && size <= cursor->size - cursor->at;
    if (!cursor->ok)
        return NULL;
    cursor->at += size;
    return cursor->block + cursor->at - size;
}

static void *take_array(struct file_cursor *cursor, uint64_t size)
{
    cursor->at = bytes_align(cursor->at, ALIGNMENT);
    void *array = take(cursor, size);
    take(cursor, PADDING);
    return array;
}

static char *take_text(struct file_cursor *cursor)
{
    const void *size = take(cursor, sizeof(uint64_t));
    return size ? take(cursor, bytes_get64(size)) : NULL;
}

static void take_meshes(struct file_cursor *cursor, struct import *import)
{
    import->meshes = take_array(cursor, import->mesh_count * sizeof *import->meshes);
    for (uint32_t i = 0; i < import->mesh_count && cursor->ok; i++) {
        struct import_mesh *mesh = &import->meshes[i];
        mesh->name = take_text(cursor);
        mesh->material = take_text(cursor);
        mesh->positions = take_array(cursor, mesh->vertex_count * UINT64_C(12));
        mesh->indices = take_array(cursor, mesh->triangle_count * UINT64_C(12));
    }
}

static void take_bottoms(struct file_cursor *cursor, struct import *import)
{
    import->bottoms = take_array(cursor, import->bottom_count * sizeof *import->bottoms);
    for (uint32_t i = 0; i < import->bottom_count && cursor->ok; i++) {
        struct import_bottom *bottom = &import->bottoms[i];
        bottom->name = take_text(cursor);
        bottom->meshes = take_array(cursor, bottom->mesh_count * sizeof *bottom->meshes);
    }
}

/* Makes the import in the block. Its numbers are those of the outcome. */
static void take_import(struct file_cursor *cursor, struct import *import)
{
    import->name = take_text(cursor);
    import->source_name = take_text(cursor);
    take_meshes(cursor, import);
    take_bottoms(cursor, import);
    import->instances = take_array(cursor, import->instance_count * sizeof *import->instances);
    import->files = take_array(cursor, import->file_count * sizeof *import->files);
    for (uint32_t i = 0; i < import->file_count && cursor->ok; i++)
        import->files[i] = take_text(cursor);
}

static bool read_all(int descriptor, unsigned char *data, uint64_t size)
{
    for (uint64_t done = 0; done < size;) {
        ssize_t got = pread(descriptor, data + done, size - done, (off_t)done);
        if (got <= 0 && !(got < 0 && errno == EINTR))
            return false;
        done += got > 0 ? (uint64_t)got : 0;
    }
    return true;
}

/* Reads the import of a complete outcome from a memory file of `size` bytes. */
static enum bvhd_status read_import(int descriptor, uint64_t size, const struct outcome *outcome, const char *path,
                                    struct memory *memory, struct import *ret_import, struct bvhd_error *error)
{
    struct import import = outcome->import;
    struct file_cursor cursor = {memory_alloc(memory, size), sizeof *outcome, size, true};
    if (!cursor.block)
        return bvhd_error_no_memory(error, path, "no memory for the scene, or more than --memory allows");
    if (read_all(descriptor, cursor.block, size))
        take_import(&cursor, &import);
    else
        cursor.ok = false;
    if (!cursor.ok) {
        memory_free(memory, cursor.block);
        return bvhd_error_set(error, BVHD_INTERNAL, path, "the scene did not pass between processes");
    }
    import.memory = memory;
    import.block = cursor.block;
    *ret_import = import;
    return BVHD_OK;
}

static enum bvhd_status take_outcome(int descriptor, const char *path, struct memory *memory, struct import *ret_import,
                                     struct bvhd_error *error)
{
    struct stat file;
    struct outcome outcome;
    bool is_there = fstat(descriptor, &file) == 0 && file.st_size >= (off_t)sizeof outcome &&
                    read_all(descriptor, (unsigned char *)&outcome, sizeof outcome);
    if (!is_there)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, path,
                              "the importer gave up: the file is broken, or too complex for it");
    if (!outcome.is_complete)
        return bvhd_error_no_memory(error, path, "no memory to pass the scene on");
    enum bvhd_status status = outcome.error.status;
    if (status)
        *error = outcome.error;
    return status ? status : read_import(descriptor, (uint64_t)file.st_size, &outcome, path, memory, ret_import, error);
}

/* Waits for the child. Returns its exit status, or -1 when a signal ended it. */
static int wait_for(pid_t child)
{
    int status;
    while (waitpid(child, &status, 0) < 0)
        if (errno != EINTR)
            return -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

static enum bvhd_status read_by(reader *read, const char *path, const char *scene, struct memory *memory,
                                struct import *ret_import, struct bvhd_error *error)
{
    struct bvhd_error ignored;
    error = error ? error : &ignored;
    int descriptor = memfd_create("bvhctl-import", MFD_CLOEXEC);
    if (descriptor < 0)
        return bvhd_error_set(error, BVHD_IO, path, "memfd_create: %s", strerror(errno));
    pid_t child = fork();
    if (child == 0) {
        prepare_child(path);
        read_in_child(read, path, scene, descriptor, memory);
    }
    enum bvhd_status status;
    if (child < 0)
        status = bvhd_error_set(error, BVHD_IO, path, "fork: %s", strerror(errno));
    else if (wait_for(child) < 0)
        status =
            bvhd_error_set(error, BVHD_UNSUPPORTED, path, "the importer crashed or did not end: the file is broken");
    else
        status = take_outcome(descriptor, path, memory, ret_import, error);
    close(descriptor);
    return status;
}

enum bvhd_status import_scene(const char *path, const char *scene, struct memory *memory, struct import *ret_import,
                              struct bvhd_error *error)
{
    return read_by(import_read, path, scene, memory, ret_import, error);
}

enum bvhd_status import_scene_by_assimp(const char *path, struct memory *memory, struct import *ret_import,
                                        struct bvhd_error *error)
{
    return read_by(import_read_by_assimp, path, NULL, memory, ret_import, error);
}
