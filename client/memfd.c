/* SPDX-License-Identifier: Apache-2.0 */
#include "memfd.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/* Newer than some C libraries; kernels that do not know it say EINVAL. */
#ifndef MFD_NOEXEC_SEAL
#define MFD_NOEXEC_SEAL 8U
#endif

static enum bvhd_status refused(struct bvhd_error *error, const char *what)
{
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
        return bvhd_error_set(error, BVHD_NO_MEMORY, "memfd", "%llu bytes", (unsigned long long)size);
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
    return fcntl(descriptor, F_ADD_SEALS, seals) == 0 ? BVHD_OK : refused(error, "sealing");
}
