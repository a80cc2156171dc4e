/* SPDX-License-Identifier: Apache-2.0 */
#include "client/memfd.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "proto/base/seal.h"

/* Newer than some C libraries; older kernels refuse it with EINVAL. */
#ifndef MFD_NOEXEC_SEAL
#define MFD_NOEXEC_SEAL 8U
#endif

static enum bvhd_status refused(struct bvhd_error *error, const char *what)
{
    if (errno == EFAULT) /* the kernel finds it out when it copies geometry */
        return bvhd_error_set(error, BVHD_INVALID, "memfd",
                              "the geometry's memory ends before what ranges, strides and maxVertex say");
    enum bvhd_status status = errno == ENOMEM ? BVHD_NO_MEMORY : BVHD_IO;
    return bvhd_error_set(error, status, "memfd", "%s: %s", what, strerror(errno));
}

static int create(const char *name)
{
    int descriptor = memfd_create(name, MFD_CLOEXEC | MFD_ALLOW_SEALING | MFD_NOEXEC_SEAL);
    return descriptor < 0 && errno == EINVAL ? memfd_create(name, MFD_CLOEXEC | MFD_ALLOW_SEALING) : descriptor;
}

enum bvhd_status memfd_create_mapped(const char *name, uint64_t size, int *ret_descriptor, unsigned char **ret_bytes,
                                     struct bvhd_error *error)
{
    if (size > INT64_MAX)
        return bvhd_error_no_memory(error, "memfd", "%llu bytes", (unsigned long long)size);
    int descriptor = create(name);
    if (descriptor < 0)
        return refused(error, "memfd_create");
    const char *what = "ftruncate";
    void *bytes = MAP_FAILED;
    if (ftruncate(descriptor, (off_t)size) == 0) {
        what = "mmap";
        bytes = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    }
    if (bytes == MAP_FAILED) {
        enum bvhd_status status = refused(error, what);
        close(descriptor);
        return status;
    }
    *ret_descriptor = descriptor;
    *ret_bytes = bytes;
    return BVHD_OK;
}

enum bvhd_status memfd_seal(int descriptor, int seals, struct bvhd_error *error)
{
    return seal_add(descriptor, seals) == 0 ? BVHD_OK : refused(error, "sealing");
}

enum { GATHER_SIZE = 64 * 1024, GATHER_MAX_PIECE = 16 * 1024 };

enum bvhd_status memfd_open(const char *name, int *ret_descriptor, struct bvhd_error *error)
{
    int descriptor = create(name);
    if (descriptor < 0)
        return refused(error, "memfd_create");
    *ret_descriptor = descriptor;
    return BVHD_OK;
}

enum bvhd_status memfd_writer_init(struct memfd_writer *writer, int descriptor, uint64_t offset, struct memory *memory,
                                   struct bvhd_error *error)
{
    unsigned char *gathered = memory_alloc(memory, GATHER_SIZE);
    if (!gathered)
        return bvhd_error_no_memory(error, "memfd", "no memory for it");
    *writer = (struct memfd_writer){
        .memory = memory, .descriptor = descriptor, .offset = offset, .gathered = gathered, .error = error};
    return BVHD_OK;
}

static enum bvhd_status write_all(struct memfd_writer *writer, struct bytes bytes)
{
    while (bytes.size > 0) {
        ssize_t written = pwrite(writer->descriptor, bytes.data, bytes.size, (off_t)writer->offset);
        if (written < 0 && errno == EINTR)
            continue;
        if (written <= 0) {
            errno = written == 0 || errno == ENOSPC ? ENOMEM : errno;
            return refused(writer->error, "write");
        }
        bytes.data += written;
        writer->offset += (uint64_t)written;
        bytes.size -= (uint64_t)written;
    }
    return BVHD_OK;
}

static enum bvhd_status flush(struct memfd_writer *writer)
{
    struct bytes bytes = {writer->gathered, writer->used};
    writer->used = 0;
    return write_all(writer, bytes);
}

enum bvhd_status memfd_writer_put(struct memfd_writer *writer, struct bytes piece)
{
    if (piece.size > GATHER_MAX_PIECE || piece.size > GATHER_SIZE - writer->used) {
        enum bvhd_status status = flush(writer);
        if (status != BVHD_OK)
            return status;
    }
    if (piece.size > GATHER_MAX_PIECE)
        return write_all(writer, piece);
    memcpy(writer->gathered + writer->used, piece.data, piece.size);
    writer->used += piece.size;
    return BVHD_OK;
}

enum bvhd_status memfd_writer_finish(struct memfd_writer *writer, enum bvhd_status status)
{
    if (status == BVHD_OK)
        status = flush(writer);
    memory_free(writer->memory, writer->gathered);
    writer->gathered = NULL;
    return status;
}
