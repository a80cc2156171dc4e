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
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "proto/base/bytes.h"
#include "client/bvhctl/scene/gltf.h"
#include "client/bvhctl/scene/import.h"
#include "client/bvhctl/scene/import_hash.h"
#include "client/bvhctl/scene/import_limits.h"
#include "client/bvhctl/scene/import_round.h"
#include "client/bvhctl/scene/ply.h"
#include "client/bvhctl/scene/weld.h"

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

/* Puts the arrays of a look that are there. */
static void put_look(struct file_writer *writer, const struct import_mesh *mesh)
{
    if (mesh->look.normals)
        put_array(writer, mesh->look.normals, mesh->vertex_count * UINT64_C(12));
    if (mesh->look.texcoords)
        put_array(writer, mesh->look.texcoords, mesh->vertex_count * UINT64_C(8));
    if (mesh->look.colours)
        put_array(writer, mesh->look.colours, mesh->vertex_count * UINT64_C(16));
}

static uint64_t image_size(const struct import_image *image)
{
    return UINT64_C(4) * image->width * image->height;
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
        if (mesh->end_positions)
            put_array(writer, mesh->end_positions, mesh->vertex_count * UINT64_C(12));
        put_array(writer, mesh->indices, import_corner_count(mesh) * 4);
        if (mesh->radii)
            put_array(writer, mesh->radii, mesh->vertex_count * UINT64_C(4));
        if (mesh->caps)
            put_array(writer, mesh->caps, mesh->primitive_count);
        put_look(writer, mesh);
    }
    put_array(writer, import->images, import->image_count * sizeof *import->images);
    for (uint32_t i = 0; i < import->image_count; i++)
        if (import->images[i].rgba)
            put_array(writer, import->images[i].rgba, image_size(&import->images[i]));
    put_array(writer, import->bottoms, import->bottom_count * sizeof *import->bottoms);
    for (uint32_t i = 0; i < import->bottom_count; i++) {
        const struct import_bottom *bottom = &import->bottoms[i];
        put_text(writer, bottom->name);
        put_array(writer, bottom->meshes, bottom->mesh_count * sizeof *bottom->meshes);
    }
    put_array(writer, import->instances, import->instance_count * sizeof *import->instances);
    put_array(writer, import->motions, import->motion_count * sizeof *import->motions);
    put_array(writer, import->node_names.texts, import->node_names.size);
    put_array(writer, NULL, import->file_count * sizeof *import->files); /* room for the pointers */
    for (uint32_t i = 0; i < import->file_count; i++)
        put_text(writer, import->files[i]);
}

/* How a file is read. */
struct job {
    const char *path;
    const struct import_wish *wish;
    const char *who; /* for messages */
    enum bvhd_status (*read)(const char *path, const struct import_wish *wish, struct memory *memory,
                             struct import *ret_import, struct bvhd_error *error);
    struct memory *memory;
    bool has_own_reader; /* assimp reads it only if that reader passes it on */
};

/*
 * Reads the scene in the child, which exits here, unless assimp crashes it before. `is_twin`: only the hash is wanted.
 */
__attribute__((noreturn)) static void read_in_child(const struct job *job, bool is_twin, int descriptor)
{
    struct outcome outcome = {0};
    enum bvhd_status status = job->read(job->path, job->wish, job->memory, &outcome.import, &outcome.error);
    outcome.error.status = status;
    memory_explain(job->memory, &outcome.error);
    if (!status && outcome.import.reader == IMPORT_BY_ASSIMP)
        outcome.hash = import_hash(&outcome.import);
    if (!status && outcome.import.reader == IMPORT_BY_ASSIMP && !is_twin && !weld_import(&outcome.import)) {
        status =
            bvhd_error_no_memory(&outcome.error, job->path, "no memory for the scene, or more than --memory allows");
        outcome.error.status = status;
    }
    FILE *file = fdopen(descriptor, "w");
    if (!file)
        _exit(1);
    setvbuf(file, NULL, _IOFBF, BUFFER_SIZE);
    struct file_writer writer = {.file = file};
    put(&writer, &outcome, sizeof outcome);
    if (!status && !is_twin)
        put_import(&writer, &outcome.import);
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
    static const int signals[] = {SIGINT, SIGTERM, SIGHUP, SIGPROF, SIGABRT, SIGBUS, SIGFPE, SIGILL, SIGSEGV};
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
    mallopt(M_MMAP_MAX, 30000); /* the kernel allows 65530 mappings; beyond this number the heap is used */
#else
    (void)path;
#endif
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

static void take_look(struct file_cursor *cursor, struct import_mesh *mesh)
{
    if (mesh->look.normals)
        mesh->look.normals = take_array(cursor, mesh->vertex_count * UINT64_C(12));
    if (mesh->look.texcoords)
        mesh->look.texcoords = take_array(cursor, mesh->vertex_count * UINT64_C(8));
    if (mesh->look.colours)
        mesh->look.colours = take_array(cursor, mesh->vertex_count * UINT64_C(16));
}

static void take_meshes(struct file_cursor *cursor, struct import *import)
{
    import->meshes = take_array(cursor, import->mesh_count * sizeof *import->meshes);
    for (uint32_t i = 0; i < import->mesh_count && cursor->ok; i++) {
        struct import_mesh *mesh = &import->meshes[i];
        mesh->name = take_text(cursor);
        mesh->material = take_text(cursor);
        mesh->positions = take_array(cursor, mesh->vertex_count * UINT64_C(12));
        if (mesh->end_positions)
            mesh->end_positions = take_array(cursor, mesh->vertex_count * UINT64_C(12));
        mesh->indices = take_array(cursor, import_corner_count(mesh) * 4);
        if (mesh->radii)
            mesh->radii = take_array(cursor, mesh->vertex_count * UINT64_C(4));
        if (mesh->caps)
            mesh->caps = take_array(cursor, mesh->primitive_count);
        take_look(cursor, mesh);
    }
    import->images = take_array(cursor, import->image_count * sizeof *import->images);
    for (uint32_t i = 0; i < import->image_count && cursor->ok; i++)
        if (import->images[i].rgba)
            import->images[i].rgba = take_array(cursor, image_size(&import->images[i]));
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
    import->motions = take_array(cursor, import->motion_count * sizeof *import->motions);
    import->node_names.texts = take_array(cursor, import->node_names.size);
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

/* A process that reads a scene. */
struct child {
    pid_t pid;
    int descriptor; /* of its memory file */
};

static enum bvhd_status child_start(const struct job *job, bool is_twin, struct child *ret_child,
                                    struct bvhd_error *error)
{
    int descriptor = memfd_create("bvhctl-import", MFD_CLOEXEC);
    if (descriptor < 0)
        return bvhd_error_set(error, BVHD_IO, job->path, "memfd_create: %s", strerror(errno));
    pid_t pid = fork();
    if (pid == 0) {
        prepare_child(is_twin ? TWIN_FACTOR : 1);
        if (is_twin)
            disturb_memory(job->path);
        read_in_child(job, is_twin, descriptor);
    }
    if (pid < 0) {
        close(descriptor);
        return bvhd_error_set(error, BVHD_IO, job->path, "fork: %s", strerror(errno));
    }
    *ret_child = (struct child){pid, descriptor};
    return BVHD_OK;
}

static double seconds(struct timeval time)
{
    return (double)time.tv_sec + (double)time.tv_usec * 1e-6;
}

/* Says why a child ended that was to end with status 0. */
static enum bvhd_status child_failure(int status, const struct rusage *used, const struct job *job,
                                      struct bvhd_error *error)
{
    int number = WIFSIGNALED(status) ? WTERMSIG(status) : 0;
    if (number == SIGINT || number == SIGTERM || number == SIGHUP)
        raise(number); /* the terminal sends it to both processes, and the child was faster */
    if (number == SIGPROF)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, job->path,
                              "%s took too long: it was ended after %.2f s of processor time, which is the limit for a "
                              "file of this size",
                              job->who, seconds(used->ru_utime) + seconds(used->ru_stime));
    if (number == SIGKILL)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, job->path,
                              "%s was killed, as happens when memory is short; it had %.0f MB", job->who,
                              (double)used->ru_maxrss * 1024 / 1e6);
    if (number)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, job->path, "%s crashed on it (%s)", job->who, strsignal(number));
    return bvhd_error_no_memory(error, job->path, "no memory to pass the scene on");
}

/* Waits for a child. Returns its outcome, which may be that the import has failed; or the reason why there is none. */
static enum bvhd_status child_wait(const struct child *child, const struct job *job, struct outcome *ret_outcome,
                                   struct bvhd_error *error)
{
    int status;
    struct rusage used;
    while (wait4(child->pid, &status, 0, &used) < 0)
        if (errno != EINTR)
            return bvhd_error_set(error, BVHD_IO, job->path, "wait4: %s", strerror(errno));
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
        return child_failure(status, &used, job, error);
    bool is_read = pread(child->descriptor, ret_outcome, sizeof *ret_outcome, 0) == (ssize_t)sizeof *ret_outcome;
    if (!is_read || !ret_outcome->is_complete)
        return bvhd_error_set(error, BVHD_UNSUPPORTED, job->path, "%s ended the process that reads the file", job->who);
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
static enum bvhd_status compare_twin(const struct child *twin, const struct job *job, uint64_t hash,
                                     struct bvhd_error *error)
{
    struct outcome outcome;
    enum bvhd_status status = child_wait(twin, job, &outcome, error);
    if (status)
        return status;
    if (outcome.error.status == BVHD_NO_MEMORY)
        return BVHD_NO_MEMORY;
    if (outcome.error.status == BVHD_OK && outcome.hash == hash)
        return BVHD_OK;
    return bvhd_error_set(error, BVHD_UNSUPPORTED, job->path,
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
static enum bvhd_status import_from(const struct child *child, const struct job *job, struct import *ret_import,
                                    struct bvhd_error *error)
{
    struct child twin = {0};
    struct outcome outcome;
    struct stat file;
    bool has_twin = !job->has_own_reader && is_large(job->path) && child_start(job, true, &twin, error) == BVHD_OK;
    enum bvhd_status status = child_wait(child, job, &outcome, error);
    if (!status)
        status = outcome.error.status;
    if (status && has_twin)
        child_kill(&twin);
    if (status)
        return status;
    if (outcome.import.reader == IMPORT_BY_ASSIMP) {
        if (!has_twin)
            status = child_start(job, true, &twin, error);
        if (status)
            return status;
        status = compare_twin(&twin, job, outcome.hash, error);
        close(twin.descriptor);
    }
    if (!status && fstat(child->descriptor, &file) < 0)
        status = bvhd_error_set(error, BVHD_IO, job->path, "fstat: %s", strerror(errno));
    if (status)
        return status;
    return read_import(child->descriptor, (uint64_t)file.st_size, &outcome, job->path, job->memory, ret_import, error);
}

static enum bvhd_status import_in_children(const struct job *job, struct import *ret_import, struct bvhd_error *error)
{
    struct child child = {0};
    enum bvhd_status status = child_start(job, false, &child, error);
    if (status)
        return status;
    status = import_from(&child, job, ret_import, error);
    close(child.descriptor);
    return status;
}

enum bvhd_status import_scene_by_assimp(const char *path, struct memory *memory, struct import *ret_import,
                                        struct bvhd_error *error)
{
    struct bvhd_error ignored;
    const struct import_wish wish = {0};
    const struct job job = {path, &wish, "assimp", import_read_by_assimp, memory, false};
    return import_in_children(&job, ret_import, error ? error : &ignored);
}

enum bvhd_status import_scene_as(const char *path, const struct import_wish *wish, struct memory *memory,
                                 struct import *ret_import, struct bvhd_error *error)
{
    struct bvhd_error ignored;
    error = error ? error : &ignored;
    if (!wish->scene && !wish->moment && ply_is_file(path))
        return ply_import(path, wish, memory, ret_import, error);
    bool is_gltf = gltf_is_file(path);
    const struct job job = {path, wish, is_gltf ? "the reader of glTF" : "assimp", import_read_as, memory, is_gltf};
    return import_in_children(&job, ret_import, error);
}

enum bvhd_status import_scene(const char *path, const char *scene, struct memory *memory, struct import *ret_import,
                              struct bvhd_error *error)
{
    return import_scene_as(path, &(struct import_wish){.scene = scene}, memory, ret_import, error);
}

enum bvhd_status import_scene_with_looks(const char *path, const char *scene, struct memory *memory,
                                         struct import *ret_import, struct bvhd_error *error)
{
    const struct import_wish wish = {.scene = scene, .wants_looks = true};
    return import_scene_as(path, &wish, memory, ret_import, error);
}
