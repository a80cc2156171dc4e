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

static void put(FILE *file, const void *data, uint64_t size)
{
    if (size)
        fwrite(data, 1, size, file);
}

static void put_text(FILE *file, const char *text)
{
    uint64_t size = strlen(text) + 1;
    put(file, &size, sizeof size);
    put(file, text, size);
}

static void put_import(FILE *file, const struct import *import)
{
    put_text(file, import->name);
    put_text(file, import->source_name ? import->source_name : "");
    put(file, import->meshes, import->mesh_count * sizeof *import->meshes);
    for (uint32_t i = 0; i < import->mesh_count; i++) {
        const struct import_mesh *mesh = &import->meshes[i];
        put_text(file, mesh->name);
        put_text(file, mesh->material);
        put(file, mesh->positions, mesh->vertex_count * UINT64_C(12));
        put(file, mesh->indices, mesh->triangle_count * UINT64_C(12));
    }
    put(file, import->bottoms, import->bottom_count * sizeof *import->bottoms);
    for (uint32_t i = 0; i < import->bottom_count; i++) {
        put_text(file, import->bottoms[i].name);
        put(file, import->bottoms[i].meshes, import->bottoms[i].mesh_count * sizeof *import->bottoms[i].meshes);
    }
    put(file, import->instances, import->instance_count * sizeof *import->instances);
    for (uint32_t i = 0; i < import->file_count; i++)
        put_text(file, import->files[i]);
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
    put(file, &outcome, sizeof outcome);
    if (!status)
        put_import(file, &outcome.import);
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

/* The rest of the memory file, while it is read. */
struct file_cursor {
    const unsigned char *at;
    uint64_t left;
    struct memory *memory;
    bool ok; /* enough bytes, enough memory */
};

/* Returns a copy of the next bytes, with room for `extra` more, or NULL after an error. It is never empty. */
static void *take(struct file_cursor *cursor, uint64_t size, uint64_t extra)
{
    void *copy = cursor->ok && size <= cursor->left ? memory_alloc(cursor->memory, size + extra + 1) : NULL;
    cursor->ok = copy != NULL;
    if (!copy)
        return NULL;
    memcpy(copy, cursor->at, size);
    cursor->at += size;
    cursor->left -= size;
    return copy;
}

static char *take_text(struct file_cursor *cursor)
{
    uint64_t size;
    cursor->ok &= cursor->left >= sizeof size;
    if (!cursor->ok)
        return NULL;
    memcpy(&size, cursor->at, sizeof size);
    cursor->at += sizeof size;
    cursor->left -= sizeof size;
    return take(cursor, size, 0);
}

static void take_meshes(struct file_cursor *cursor, uint32_t count, struct import *import)
{
    import->meshes = take(cursor, count * sizeof *import->meshes, 0);
    import->mesh_count = import->meshes ? count : 0;
    for (uint32_t i = 0; i < import->mesh_count; i++) {
        struct import_mesh *mesh = &import->meshes[i];
        mesh->name = take_text(cursor);
        mesh->material = take_text(cursor);
        mesh->positions = take(cursor, mesh->vertex_count * UINT64_C(12), 12);
        mesh->indices = take(cursor, mesh->triangle_count * UINT64_C(12), 12);
    }
}

static void take_bottoms(struct file_cursor *cursor, uint32_t count, struct import *import)
{
    import->bottoms = take(cursor, count * sizeof *import->bottoms, 0);
    import->bottom_count = import->bottoms ? count : 0;
    for (uint32_t i = 0; i < import->bottom_count; i++) {
        import->bottoms[i].name = take_text(cursor);
        import->bottoms[i].meshes = take(cursor, import->bottoms[i].mesh_count * sizeof *import->bottoms[i].meshes, 0);
    }
}

static void take_files(struct file_cursor *cursor, uint32_t count, struct import *import)
{
    import->files = cursor->ok ? memory_array(cursor->memory, (uint64_t)count + 1, sizeof *import->files) : NULL;
    cursor->ok = import->files != NULL;
    for (uint32_t i = 0; i < count && import->files; i++)
        import->files[import->file_count++] = take_text(cursor);
}

static enum bvhd_status take_import(struct file_cursor *cursor, const struct outcome *outcome, const char *path,
                                    struct import *ret_import, struct bvhd_error *error)
{
    struct import import = outcome->import;
    import.memory = cursor->memory;
    import.name = import.source_name = NULL;
    import.meshes = NULL;
    import.bottoms = NULL;
    import.instances = NULL;
    import.files = NULL;
    import.mesh_count = import.bottom_count = import.file_count = 0;
    import.name = take_text(cursor);
    import.source_name = take_text(cursor);
    take_meshes(cursor, outcome->import.mesh_count, &import);
    take_bottoms(cursor, outcome->import.bottom_count, &import);
    import.instances = take(cursor, import.instance_count * sizeof *import.instances, 0);
    take_files(cursor, outcome->import.file_count, &import);
    if (!cursor->ok) {
        import_finish(&import);
        return bvhd_error_no_memory(error, path, "no memory for the scene, or more than --memory allows");
    }
    *ret_import = import;
    return BVHD_OK;
}

static enum bvhd_status take_outcome(int descriptor, const char *path, struct memory *memory, struct import *ret_import,
                                     struct bvhd_error *error)
{
    struct stat file;
    struct outcome outcome;
    bool is_there = fstat(descriptor, &file) == 0 && file.st_size >= (off_t)sizeof outcome;
    void *map = is_there ? mmap(NULL, (size_t)file.st_size, PROT_READ, MAP_PRIVATE, descriptor, 0) : MAP_FAILED;
    if (map == MAP_FAILED)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, path,
                              "the importer gave up: the file is broken, or too complex for it");
    memcpy(&outcome, map, sizeof outcome);
    struct file_cursor cursor = {(const unsigned char *)map + sizeof outcome, (uint64_t)file.st_size - sizeof outcome,
                                 memory, true};
    enum bvhd_status status = outcome.error.status;
    if (!outcome.is_complete)
        status = bvhd_error_no_memory(error, path, "no memory to pass the scene on");
    else if (status)
        *error = outcome.error;
    else
        status = take_import(&cursor, &outcome, path, ret_import, error);
    munmap(map, (size_t)file.st_size);
    return status;
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
