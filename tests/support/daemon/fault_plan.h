/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fault_plan.h - tells a running program which of its system calls and allocations are to fail: memory that a test
 * shares with fault_shim.c, which is preloaded into that program.
 *
 * Only calls that the program itself makes count, not those of the libraries that it uses.
 */
#ifndef BVHD_FAULT_PLAN_H
#define BVHD_FAULT_PLAN_H

#include <stdint.h>

/* Names the file that both sides map; the program reads it from its environment. */
#define FAULT_PLAN_VARIABLE "BVHD_FAULT_PLAN"

/* The functions that can fail: the name, and the errno of the failure that is the most likely one. */
#define FAULT_CALLS(X)                                                                                                 \
    X(accept4, ENOMEM)                                                                                                 \
    X(allocation, ENOMEM) /* malloc, calloc, realloc, posix_memalign */                                                \
    X(close, EIO) /* the descriptor is closed all the same */                                                          \
    X(fallocate64, ENOSPC)                                                                                             \
    X(fchmod, EPERM)                                                                                                   \
    X(fcntl64, EBUSY)                                                                                                  \
    X(fdatasync, EIO)                                                                                                  \
    X(fdopendir, ENOMEM)                                                                                               \
    X(flock, ENOLCK)                                                                                                   \
    X(fstat64, EIO)                                                                                                    \
    X(fstatat64, EIO)                                                                                                  \
    X(fstatfs64, EIO)                                                                                                  \
    X(fsync, EIO)                                                                                                      \
    X(futimens, EROFS)                                                                                                 \
    X(getsockopt, ENOBUFS)                                                                                             \
    X(ioctl, EIO)                                                                                                      \
    X(lseek64, EINVAL)                                                                                                 \
    X(madvise, EAGAIN)                                                                                                 \
    X(memfd_create, EMFILE)                                                                                            \
    X(mkdir, ENOSPC)                                                                                                   \
    X(mkdirat, ENOSPC)                                                                                                 \
    X(mmap64, ENOMEM)                                                                                                  \
    X(mremap, ENOMEM)                                                                                                  \
    X(open64, EMFILE)                                                                                                  \
    X(openat64, EMFILE)                                                                                                \
    X(opendir, EMFILE)                                                                                                 \
    X(pread64, EIO)                                                                                                    \
    X(pthread_create, EAGAIN)                                                                                          \
    X(pwrite64, ENOSPC)                                                                                                \
    X(recvmsg, ENOBUFS)                                                                                                \
    X(renameat, ENOSPC)                                                                                                \
    X(send, ENOBUFS)                                                                                                   \
    X(sendmsg, ENOBUFS)                                                                                                \
    X(setsockopt, ENOBUFS)                                                                                             \
    X(socket, EMFILE)                                                                                                  \
    X(statvfs64, EIO)                                                                                                  \
    X(unlinkat, EIO)                                                                                                   \
    X(write, ENOSPC)

enum fault_call {
#define FAULT_CALL(name, number) FAULT_##name,
    FAULT_CALLS(FAULT_CALL)
#undef FAULT_CALL
        FAULT_CALL_COUNT
};

struct fault_plan {
    _Atomic uint64_t armed; /* bits of the calls that count: 1 << FAULT_... */
    _Atomic int64_t left; /* how many of them succeed before one fails */
    _Atomic int64_t most; /* how many fail then, one after the other */
    _Atomic uint64_t seen, failed; /* calls since the test set them to 0 */
    _Atomic int64_t clock_offset_s; /* added to the time of day */
    _Atomic int32_t number; /* errno of the failures; 0: the one of the table */
    _Atomic uint32_t files_only; /* only what concerns files fails, and nothing of memfds and sockets */
};

#endif
