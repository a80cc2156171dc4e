/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/service/payload.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <linux/magic.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include "daemon/system/release.h"

struct payload {
    atomic_uint refs;
    struct memory *memory;
    void *mapping; /* NULL for a copy, whose bytes lie behind the struct */
    struct bytes bytes;
};

/* The offset of a copy's bytes in its block, which is aligned to 64. */
enum { COPY_OFFSET = 64 };

_Static_assert(sizeof(struct payload) <= COPY_OFFSET, "the struct fits in front of the bytes");

static enum bvhd_status invalid(const struct payload_file *file, struct bvhd_error *error, const char *reason)
{
    return bvhd_error_set(error, BVHD_INVALID, file->where, "%s", reason);
}

static enum bvhd_status refused(const struct payload_file *file, struct bvhd_error *error, const char *what)
{
    enum bvhd_status status = errno == ENOMEM ? BVHD_NO_MEMORY : BVHD_IO;
    return bvhd_error_set(error, status, file->where, "%s: %s", what, strerror(errno));
}

static enum bvhd_status check_declared(const struct payload_file *file, struct bvhd_error *error)
{
    if (file->size == 0)
        return invalid(file, error, "has no bytes");
    if (file->size > file->max_size)
        return bvhd_error_set(error, BVHD_TOO_LARGE, file->where, "%" PRIu64 " bytes, the most is %" PRIu64, file->size,
                              file->max_size);
    return BVHD_OK;
}

/*
 * Checks that the descriptor is a memfd that can be read. The kernel answers F_GETFL and F_GET_SEALS by itself. Other
 * calls (fstat, fstatfs, lseek) go to the file system, and one in user space may never answer, so they come after it is
 * known that the file has seals. Files of tmpfs and of huge pages have seals too: the former cannot have those that are
 * needed, and the latter are refused by the type of their file system.
 */
static enum bvhd_status check_kind(const struct payload_file *file, int *ret_seals, struct bvhd_error *error)
{
    int mode = fcntl(file->descriptor, F_GETFL);
    if (mode < 0)
        return refused(file, error, "not open");
    if ((mode & O_PATH) || (mode & O_ACCMODE) == O_WRONLY)
        return invalid(file, error, "not open for reading");
    int seals = fcntl(file->descriptor, F_GET_SEALS);
    if (seals < 0)
        return invalid(file, error, "not a memfd");
    struct statfs filesystem;
    if (fstatfs(file->descriptor, &filesystem) != 0)
        return refused(file, error, "fstatfs");
    if (filesystem.f_type == HUGETLBFS_MAGIC)
        return invalid(file, error, "made of huge pages");
    *ret_seals = seals;
    return BVHD_OK;
}

/* The size and the absence of holes are checked after the seals, which keep them from changing. */
static enum bvhd_status check_seals(const struct payload_file *file, int seals, bool constant, struct bvhd_error *error)
{
    if (!(seals & F_SEAL_SHRINK))
        return invalid(file, error, "not sealed against shrinking");
    if (!(seals & F_SEAL_GROW))
        return invalid(file, error, "not sealed against growing");
    if (!constant && (seals & F_SEAL_WRITE))
        return invalid(file, error, "sealed against writing");
    if (constant && !(seals & F_SEAL_WRITE))
        return invalid(file, error, "not sealed against writing");
    if (constant && !(seals & F_SEAL_SEAL))
        return invalid(file, error, "not sealed against more seals");
    return BVHD_OK;
}

static enum bvhd_status check_size(const struct payload_file *file, struct bvhd_error *error)
{
    struct stat state;
    if (fstat(file->descriptor, &state) != 0)
        return refused(file, error, "fstat");
    if ((uint64_t)state.st_size != file->size)
        return bvhd_error_set(error, BVHD_INVALID, file->where, "has %" PRIu64 " bytes, not the %" PRIu64 " declared",
                              (uint64_t)state.st_size, file->size);
    return BVHD_OK;
}

/*
 * Searches for the first hole. The count of blocks would be no proof, since it includes blocks that were reserved
 * beyond the end.
 */
static enum bvhd_status check_holes(const struct payload_file *file, struct bvhd_error *error)
{
    off_t hole = lseek(file->descriptor, 0, SEEK_HOLE);
    if (hole < 0)
        return refused(file, error, "lseek");
    if ((uint64_t)hole < file->size)
        return bvhd_error_set(error, BVHD_INVALID, file->where, "has a hole at byte %" PRIu64, (uint64_t)hole);
    return BVHD_OK;
}

static enum bvhd_status check(const struct payload_file *file, bool constant, struct bvhd_error *error)
{
    int seals = 0;
    enum bvhd_status status = check_declared(file, error);
    if (status == BVHD_OK)
        status = check_kind(file, &seals, error);
    if (status == BVHD_OK)
        status = check_seals(file, seals, constant, error);
    if (status == BVHD_OK)
        status = check_size(file, error);
    if (status == BVHD_OK && constant)
        status = check_holes(file, error);
    return status;
}

/*
 * A pool is mapped shared, so that later writes of its owner are certain to be seen. A memfd that is sealed against
 * writing is mapped private: Linux before 6.7 refuses a shared mapping of it through a descriptor that is open for
 * writing, even if the mapping only reads. Neither mapping copies anything.
 */
static enum bvhd_status map(const struct payload_file *file, bool constant, struct payload **ret_payload,
                            struct bvhd_error *error)
{
    struct payload *payload = memory_alloc(file->memory, sizeof *payload);
    if (!payload)
        return bvhd_error_no_memory(error, file->where, "no memory to map it");
    void *mapping = mmap(NULL, file->size, PROT_READ, constant ? MAP_PRIVATE : MAP_SHARED, file->descriptor, 0);
    if (mapping == MAP_FAILED) {
        enum bvhd_status status = refused(file, error, "cannot be mapped");
        memory_free(file->memory, payload);
        return status;
    }
    *payload =
        (struct payload){.memory = file->memory, .mapping = mapping, .bytes = {.data = mapping, .size = file->size}};
    atomic_init(&payload->refs, 1);
    *ret_payload = payload;
    return BVHD_OK;
}

/* The mapping keeps the file, so the descriptor is closed: a process can have few of them. */
static enum bvhd_status open_file(const struct payload_file *file, bool constant, struct payload **ret_payload,
                                  struct bvhd_error *error)
{
    enum bvhd_status status = check(file, constant, error);
    if (status == BVHD_OK)
        status = map(file, constant, ret_payload, error);
    if (status != BVHD_OK) {
        release_descriptor(file->share, file->descriptor);
        return status;
    }
    close(file->descriptor);
    if (file->share)
        descriptor_share_give(file->share, 1);
    return BVHD_OK;
}

enum bvhd_status payload_open_pool(const struct payload_file *file, struct payload **ret_payload,
                                   struct bvhd_error *error)
{
    return open_file(file, false, ret_payload, error);
}

enum bvhd_status payload_open_memfd(const struct payload_file *file, struct payload **ret_payload,
                                    struct bvhd_error *error)
{
    return open_file(file, true, ret_payload, error);
}

enum bvhd_status payload_copy(struct bytes bytes, struct memory *memory, struct payload **ret_payload,
                              struct bvhd_error *error)
{
    uint64_t total;
    unsigned char *block = bytes_add(bytes.size, COPY_OFFSET, &total) ? memory_alloc(memory, total) : NULL;
    if (!block)
        return bvhd_error_no_memory(error, "payload", "no memory for %" PRIu64 " bytes", bytes.size);
    struct payload *payload = (struct payload *)(void *)block;
    *payload = (struct payload){.memory = memory, .bytes = {.data = block + COPY_OFFSET, .size = bytes.size}};
    atomic_init(&payload->refs, 1);
    if (bytes.size)
        memcpy(block + COPY_OFFSET, bytes.data, bytes.size);
    *ret_payload = payload;
    return BVHD_OK;
}

struct payload *payload_ref(struct payload *payload)
{
    atomic_fetch_add_explicit(&payload->refs, 1, memory_order_relaxed);
    return payload;
}

void payload_unref(struct payload *payload)
{
    /* acq_rel orders the reads of all other holders before the end of the payload. */
    if (!payload || atomic_fetch_sub_explicit(&payload->refs, 1, memory_order_acq_rel) != 1)
        return;
    if (payload->mapping)
        release_mapping(payload->mapping, payload->bytes.size);
    memory_free(payload->memory, payload);
}

struct bytes payload_bytes(const struct payload *payload)
{
    return payload->bytes;
}
