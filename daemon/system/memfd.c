/* SPDX-License-Identifier: Apache-2.0 */
#include "daemon/system/memfd.h"

#include <assert.h>
#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#ifndef MFD_NOEXEC_SEAL
#define MFD_NOEXEC_SEAL 8U
#endif

/* Where memory may not be overcommitted, a memfd that gets no pages fails with ENOSPC. */
enum bvhd_status memfd_refused(struct bvhd_error *error, const char *what)
{
    enum bvhd_status status = errno == ENOMEM || errno == ENOSPC ? BVHD_NO_MEMORY : BVHD_IO;
    return bvhd_error_set(error, status, "blob", "%s: %s", what, strerror(errno));
}

/*
 * The memfd is not executable where the kernel can do that (Linux 6.3). Its mode keeps clients with another user id
 * from opening it again for writing.
 */
enum bvhd_status memfd_make(int *ret_descriptor, struct bvhd_error *error)
{
    int descriptor = memfd_create("bvhd-blob", MFD_CLOEXEC | MFD_ALLOW_SEALING | MFD_NOEXEC_SEAL);
    if (descriptor < 0 && errno == EINVAL)
        descriptor = memfd_create("bvhd-blob", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    if (descriptor < 0)
        return memfd_refused(error, "memfd_create");
    if (fchmod(descriptor, S_IRUSR | S_IRGRP | S_IROTH) != 0) {
        enum bvhd_status status = memfd_refused(error, "fchmod");
        close(descriptor);
        return status;
    }
    *ret_descriptor = descriptor;
    return BVHD_OK;
}

enum bvhd_status memfd_reserve(int descriptor, uint64_t offset, uint64_t size, struct bvhd_error *error)
{
    while (fallocate(descriptor, 0, (off_t)offset, (off_t)size) != 0)
        if (errno != EINTR)
            return memfd_refused(error, "fallocate");
    return BVHD_OK;
}

/* Without the advice, munmap marks each page as used, which takes as long as all the rest that it does. */
enum bvhd_status memfd_map(int descriptor, uint64_t size, struct memfd *ret_memfd, struct bvhd_error *error)
{
    void *mapping = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
    if (mapping == MAP_FAILED)
        return memfd_refused(error, "mmap");
    madvise(mapping, size, MADV_SEQUENTIAL);
    *ret_memfd = (struct memfd){descriptor, mapping, size};
    return BVHD_OK;
}

void memfd_unmap(const struct memfd *memfd)
{
    int result = munmap(memfd->bytes, memfd->size);
    assert(result == 0);
    (void)result;
}
