/* SPDX-License-Identifier: Apache-2.0 */
/*
 * import_process.c - implements import_scene of import.h: a child process reads the file with assimp and passes the
 * result through a memory file, so that a crash of assimp ends only the child. A second child reads the file
 * in disturbed memory; a file of which both do not make the same scene is refused.
 */
#include <errno.h>
#include <fcntl.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "proto/base/bytes.h"
#include "client/bvhctl/scene/import.h"
#include "client/bvhctl/scene/import_hash.h"
#include "client/bvhctl/scene/import_limits.h"
#include "client/bvhctl/scene/ply.h"

/*
 * The limits of the second child, in those of the first: it is slower, because it maps memory for each array, and its
 * failure would refuse a file that the first one has read.
 */
enum { TWIN_FACTOR = 4 };

/* The header of the memory file. */
struct outcome {
    bool is_complete;
    struct bvhd_error error; /* if its status is BVHD_OK, the data of the import follow */
    struct import import; /* only its numbers are valid, not its pointers */
    uint64_t hash; /* of the import */
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

/*
 * Reads the scene in the child, which exits here, unless assimp crashes it before. `is_twin`: only the hash is wanted.
 */
__attribute__((noreturn)) static void read_in_child(const char *path, const char *scene, bool is_twin, int descriptor,
                                                    struct memory *memory)
{
    struct outcome outcome = {0};
    enum bvhd_status status = import_read(path, scene, memory, &outcome.import, &outcome.error);
    outcome.error.status = status;
    if (!status && outcome.import.reader == IMPORT_BY_ASSIMP)
        outcome.hash = import_hash(&outcome.import);
    FILE *file = fdopen(descriptor, "w");
    if (!file)
        _exit(1);
    put(file, &outcome, sizeof outcome);
    if (!status && !is_twin)
        put_import(file, &outcome.import);
    bool ok = fflush(file) == 0 && !ferror(file);
    outcome.is_complete = true;
    if (ok && pwrite(descriptor, &outcome, sizeof outcome, 0) == (ssize_t)sizeof outcome)
        _exit(0);
    _exit(1);
}

/* Gives the child no output and finite time and memory; it is killed when its parent dies. */
static void prepare_child(unsigned factor)
{
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    static const int signals[] = {SIGINT, SIGTERM, SIGPROF, SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV};
    for (size_t i = 0; i < sizeof signals / sizeof signals[0]; i++)
        signal(signals[i], SIG_DFL); /* a handler of the parent would go on with the parent's work */
    int nowhere = open("/dev/null", O_WRONLY | O_CLOEXEC);
    if (nowhere >= 0) {
        dup2(nowhere, STDOUT_FILENO);
        dup2(nowhere, STDERR_FILENO);
    }
    import_limits_set(factor);
}

/*
 * Makes memory of this process look different from that of its parent's other children: what is allocated and freed is
 * filled with a pattern, and each array has pages of its own, so that its neighbours are others, or nothing. What
 * assimp reads beyond an array, or before it is written, differs then. Without the GNU C library nothing changes.
 */
static void disturb_memory(const char *path)
{
#ifdef M_PERTURB
    struct stat file;
    bool is_small = stat(path, &file) == 0 && file.st_size < 1 << 16;
    mallopt(M_PERTURB, 0x5b);
    mallopt(M_MMAP_THRESHOLD, is_small ? 64 : 4096);
    mallopt(M_MMAP_MAX, 30000); /* the kernel allows 65530 mappings; after so many the heap is used */
#else
    (void)path;
#endif
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
    import.name = NULL;
    import.meshes = NULL;
    import.bottoms = NULL;
    import.instances = NULL;
    import.files = NULL;
    import.mesh_count = import.bottom_count = import.file_count = 0;
    import.name = take_text(cursor);
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

/* Copies the import from the memory file of a child that has succeeded. */
static enum bvhd_status take_file(int descriptor, const struct outcome *outcome, const char *path,
                                  struct memory *memory, struct import *ret_import, struct bvhd_error *error)
{
    struct stat file;
    bool is_there = fstat(descriptor, &file) == 0 && file.st_size >= (off_t)sizeof *outcome;
    void *map = is_there ? mmap(NULL, (size_t)file.st_size, PROT_READ, MAP_PRIVATE, descriptor, 0) : MAP_FAILED;
    if (map == MAP_FAILED)
        return bvhd_error_no_memory(error, path, "no memory to pass the scene on");
    struct file_cursor cursor = {(const unsigned char *)map + sizeof *outcome, (uint64_t)file.st_size - sizeof *outcome,
                                 memory, true};
    enum bvhd_status status = take_import(&cursor, outcome, path, ret_import, error);
    munmap(map, (size_t)file.st_size);
    return status;
}

/* A process that reads a scene. */
struct child {
    pid_t pid;
    int descriptor; /* of its memory file */
};

static enum bvhd_status child_start(const char *path, const char *scene, bool is_twin, struct memory *memory,
                                    struct child *ret_child, struct bvhd_error *error)
{
    int descriptor = memfd_create("bvhctl-import", MFD_CLOEXEC);
    if (descriptor < 0)
        return bvhd_error_set(error, BVHD_IO, path, "memfd_create: %s", strerror(errno));
    pid_t pid = fork();
    if (pid == 0) {
        prepare_child(is_twin ? TWIN_FACTOR : 1);
        if (is_twin)
            disturb_memory(path);
        read_in_child(path, scene, is_twin, descriptor, memory);
    }
    if (pid < 0) {
        close(descriptor);
        return bvhd_error_set(error, BVHD_IO, path, "fork: %s", strerror(errno));
    }
    *ret_child = (struct child){pid, descriptor};
    return BVHD_OK;
}

/* Says why a child ended that was to end with status 0. */
static enum bvhd_status child_failure(int status, const char *path, struct bvhd_error *error)
{
    int number = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    if (number == SIGPROF)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, path, "assimp took too long for a file of this size");
    if (number == SIGKILL)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, path, "assimp was killed, as happens when memory is short");
    if (number)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, path, "assimp crashed on it (%s)", strsignal(number));
    return bvhd_error_no_memory(error, path, "no memory to pass the scene on");
}

/* Waits for a child. Returns its outcome, which may be that the import has failed; or the reason why there is none. */
static enum bvhd_status child_wait(const struct child *child, const char *path, struct outcome *ret_outcome,
                                   struct bvhd_error *error)
{
    int status;
    while (waitpid(child->pid, &status, 0) < 0)
        if (errno != EINTR)
            return bvhd_error_set(error, BVHD_IO, path, "waitpid: %s", strerror(errno));
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
        return child_failure(status, path, error);
    bool is_read = pread(child->descriptor, ret_outcome, sizeof *ret_outcome, 0) == (ssize_t)sizeof *ret_outcome;
    if (!is_read || !ret_outcome->is_complete)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, path, "assimp ended the process that reads the file");
    if (ret_outcome->error.status)
        *error = ret_outcome->error;
    return BVHD_OK;
}

/* Ends a child that is not needed any more. */
static void child_kill(const struct child *child)
{
    int status;
    kill(child->pid, SIGKILL);
    while (waitpid(child->pid, &status, 0) < 0 && errno == EINTR)
        continue;
    close(child->descriptor);
}

/* Waits for the second child, and compares what it read with what the first one did. */
static enum bvhd_status compare_twin(const struct child *twin, const char *path, uint64_t hash,
                                     struct bvhd_error *error)
{
    struct outcome outcome;
    enum bvhd_status status = child_wait(twin, path, &outcome, error);
    if (status)
        return status;
    if (outcome.error.status == BVHD_NO_MEMORY)
        return BVHD_NO_MEMORY;
    if (outcome.error.status == BVHD_OK && outcome.hash == hash)
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_UNSUPPORTED, path,
                          "assimp reads beside its arrays: two imports of the file differ");
}

/*
 * Returns whether both children start together, which takes less time where there are two processors. A small file is
 * read twice in no time; if it is broken, its second child would only keep the first one from its end.
 */
static bool is_large(const char *path)
{
    struct stat file;
    return stat(path, &file) == 0 && file.st_size >= 1 << 20;
}

/* Finishes an import whose first child was started: waits for it, compares it with a second one, and copies it. */
static enum bvhd_status import_from(const struct child *child, const char *path, const char *scene,
                                    struct memory *memory, struct import *ret_import, struct bvhd_error *error)
{
    struct child twin = {0};
    struct outcome outcome;
    bool has_twin = is_large(path) && child_start(path, scene, true, memory, &twin, error) == BVHD_OK;
    enum bvhd_status status = child_wait(child, path, &outcome, error);
    if (!status)
        status = outcome.error.status;
    if (status && has_twin)
        child_kill(&twin);
    if (status)
        return status;
    if (!has_twin)
        status = child_start(path, scene, true, memory, &twin, error);
    if (status)
        return status;
    status = compare_twin(&twin, path, outcome.hash, error);
    close(twin.descriptor);
    return status ? status : take_file(child->descriptor, &outcome, path, memory, ret_import, error);
}

static enum bvhd_status import_in_children(const char *path, const char *scene, struct memory *memory,
                                           struct import *ret_import, struct bvhd_error *error)
{
    struct child child = {0};
    enum bvhd_status status = child_start(path, scene, false, memory, &child, error);
    if (status)
        return status;
    status = import_from(&child, path, scene, memory, ret_import, error);
    close(child.descriptor);
    return status;
}

enum bvhd_status import_scene_by_assimp(const char *path, struct memory *memory, struct import *ret_import,
                                        struct bvhd_error *error)
{
    struct bvhd_error ignored;
    return import_in_children(path, NULL, memory, ret_import, error ? error : &ignored);
}

enum bvhd_status import_scene(const char *path, const char *scene, struct memory *memory, struct import *ret_import,
                              struct bvhd_error *error)
{
    struct bvhd_error ignored;
    error = error ? error : &ignored;
    if (!scene && ply_is_file(path))
        return ply_import(path, memory, ret_import, error);
    return import_in_children(path, scene, memory, ret_import, error);
}
