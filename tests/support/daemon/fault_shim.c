/* SPDX-License-Identifier: Apache-2.0 */
/*
 * fault_shim.c - makes system calls and allocations of a program fail when a test says so, and moves its time of day:
 * a library for LD_PRELOAD, told by fault_plan.h.
 */
#undef _FILE_OFFSET_BITS /* the names with and without 64 are different functions here */
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <link.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/statfs.h>
#include <sys/statvfs.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#include "tests/support/daemon/fault_plan.h"

#define EXPORT __attribute__((visibility("default")))

static struct fault_plan *plan; /* NULL: nothing fails */
static uintptr_t program_begin, program_end; /* where the program is, without its libraries */

static const int numbers[FAULT_CALL_COUNT] = {
#define FAULT_CALL(name, number) number,
    FAULT_CALLS(FAULT_CALL)
#undef FAULT_CALL
};

static void *original(void *_Atomic *slot, const char *name)
{
    void *function = __atomic_load_n((void **)(uintptr_t)slot, __ATOMIC_RELAXED);
    if (!function) {
        function = dlsym(RTLD_NEXT, name);
        __atomic_store_n((void **)(uintptr_t)slot, function, __ATOMIC_RELAXED);
    }
    return function;
}

/* Sets `type` *real to the function that this library replaces. */
#define ORIGINAL(name)                                                                                                 \
    static void *_Atomic slot;                                                                                         \
    __typeof__(name) *real;                                                                                            \
    *(void **)&real = original(&slot, #name)

/* ---- which calls fail ---- */

/* The first object is the program itself. */
static int note_program(struct dl_phdr_info *object, size_t size, void *context)
{
    (void)size;
    (void)context;
    program_begin = UINTPTR_MAX;
    for (int i = 0; i < object->dlpi_phnum; i++) {
        const ElfW(Phdr) *part = &object->dlpi_phdr[i];
        uintptr_t begin = object->dlpi_addr + part->p_vaddr, end = begin + part->p_memsz;
        if (part->p_type != PT_LOAD)
            continue;
        program_begin = begin < program_begin ? begin : program_begin;
        program_end = end > program_end ? end : program_end;
    }
    return 1;
}

__attribute__((constructor)) static void find_plan(void)
{
    const char *path = getenv(FAULT_PLAN_VARIABLE);
    int file = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    void *mapping = file >= 0 ? mmap(NULL, sizeof *plan, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0) : MAP_FAILED;
    if (file >= 0)
        close(file);
    dl_iterate_phdr(note_program, NULL);
    if (mapping != MAP_FAILED)
        plan = mapping;
}

static bool is_armed(enum fault_call call, const void *caller)
{
    uintptr_t from = (uintptr_t)caller;
    return plan && (plan->armed >> call & 1) && from >= program_begin && from < program_end;
}

/* Returns whether this call fails, and then sets errno. */
static bool fails(enum fault_call call, const void *caller)
{
    if (!is_armed(call, caller))
        return false;
    plan->seen++;
    int64_t left = plan->left--;
    if (left > 0 || left <= -plan->most)
        return false;
    plan->failed++;
    errno = plan->number ? plan->number : numbers[call];
    return true;
}

/* Where only files count: a memfd has seals, or may get them; no other file does but those of tmpfs, sealed at once. */
static bool concerns_file(int descriptor)
{
    if (!plan || !plan->files_only)
        return true;
    int number = errno, seals = fcntl(descriptor, F_GET_SEALS), flags = fcntl(descriptor, F_GETFL);
    struct stat about;
    bool file = fstat(descriptor, &about) == 0 && S_ISREG(about.st_mode) && (flags & O_APPEND) == 0;
    errno = number;
    return file && (seals < 0 || seals == F_SEAL_SEAL);
}

/* ---- system calls ---- */

#define REPLACE(result, name, failure, concerned, parameters, arguments)                                               \
    EXPORT result name parameters                                                                                      \
    {                                                                                                                  \
        ORIGINAL(name);                                                                                                \
        if ((concerned) && fails(FAULT_##name, __builtin_return_address(0)))                                           \
            return failure;                                                                                            \
        return real arguments;                                                                                         \
    }

REPLACE(int, accept4, -1, true, (int socket, __SOCKADDR_ARG address, socklen_t *size, int flags),
        (socket, address, size, flags))
REPLACE(int, fallocate64, -1, concerns_file(file), (int file, int mode, off64_t at, off64_t size),
        (file, mode, at, size))
REPLACE(int, fchmod, -1, true, (int file, mode_t mode), (file, mode))
REPLACE(int, fdatasync, -1, true, (int file), (file))
REPLACE(DIR *, fdopendir, NULL, true, (int file), (file))
REPLACE(int, flock, -1, true, (int file, int operation), (file, operation))
REPLACE(int, fstat64, -1, true, (int file, struct stat64 *about), (file, about))
REPLACE(int, fstatat64, -1, true, (int folder, const char *name, struct stat64 *about, int flags),
        (folder, name, about, flags))
REPLACE(int, fstatfs64, -1, true, (int file, struct statfs64 *about), (file, about))
REPLACE(int, fsync, -1, true, (int file), (file))
REPLACE(int, futimens, -1, true, (int file, const struct timespec times[2]), (file, times))
REPLACE(int, getsockopt, -1, true, (int socket, int level, int name, void *value, socklen_t *size),
        (socket, level, name, value, size))
REPLACE(off64_t, lseek64, -1, true, (int file, off64_t at, int from), (file, at, from))
REPLACE(int, madvise, -1, true, (void *address, size_t size, int advice), (address, size, advice))
REPLACE(int, memfd_create, -1, true, (const char *name, unsigned flags), (name, flags))
REPLACE(int, mkdir, -1, true, (const char *path, mode_t mode), (path, mode))
REPLACE(int, mkdirat, -1, true, (int folder, const char *name, mode_t mode), (folder, name, mode))
REPLACE(void *, mmap64, MAP_FAILED, true, (void *address, size_t size, int access, int flags, int file, off64_t at),
        (address, size, access, flags, file, at))
REPLACE(DIR *, opendir, NULL, true, (const char *path), (path))
REPLACE(ssize_t, pread64, -1, true, (int file, void *bytes, size_t size, off64_t at), (file, bytes, size, at))
REPLACE(int, pthread_create, errno, true,
        (pthread_t * thread, const pthread_attr_t *attributes, void *(*run)(void *), void *context),
        (thread, attributes, run, context))
REPLACE(ssize_t, pwrite64, -1, concerns_file(file), (int file, const void *bytes, size_t size, off64_t at),
        (file, bytes, size, at))
REPLACE(ssize_t, recvmsg, -1, true, (int socket, struct msghdr *message, int flags), (socket, message, flags))
REPLACE(int, renameat, -1, true, (int from, const char *old_name, int to, const char *new_name),
        (from, old_name, to, new_name))
REPLACE(ssize_t, send, -1, true, (int socket, const void *bytes, size_t size, int flags), (socket, bytes, size, flags))
REPLACE(ssize_t, sendmsg, -1, true, (int socket, const struct msghdr *message, int flags), (socket, message, flags))
REPLACE(int, setsockopt, -1, true, (int socket, int level, int name, const void *value, socklen_t size),
        (socket, level, name, value, size))
REPLACE(int, socket, -1, true, (int family, int type, int protocol), (family, type, protocol))
REPLACE(int, statvfs64, -1, true, (const char *path, struct statvfs64 *about), (path, about))
REPLACE(int, unlinkat, -1, true, (int folder, const char *name, int flags), (folder, name, flags))
REPLACE(ssize_t, write, -1, concerns_file(file), (int file, const void *bytes, size_t size), (file, bytes, size))

EXPORT int close(int file)
{
    ORIGINAL(close);
    int result = real(file);
    return result == 0 && fails(FAULT_close, __builtin_return_address(0)) ? -1 : result;
}

static bool may_fail_to_open(int flags)
{
    return !plan || !plan->files_only || (flags & O_CREAT);
}

static mode_t mode_of(int flags, va_list arguments)
{
    return flags & (O_CREAT | O_TMPFILE) ? va_arg(arguments, mode_t) : 0;
}

EXPORT int open64(const char *path, int flags, ...)
{
    ORIGINAL(open64);
    va_list arguments;
    va_start(arguments, flags);
    mode_t mode = mode_of(flags, arguments);
    va_end(arguments);
    if (may_fail_to_open(flags) && fails(FAULT_open64, __builtin_return_address(0)))
        return -1;
    return real(path, flags, mode);
}

EXPORT int openat64(int folder, const char *path, int flags, ...)
{
    ORIGINAL(openat64);
    va_list arguments;
    va_start(arguments, flags);
    mode_t mode = mode_of(flags, arguments);
    va_end(arguments);
    if (may_fail_to_open(flags) && fails(FAULT_openat64, __builtin_return_address(0)))
        return -1;
    return real(folder, path, flags, mode);
}

EXPORT int fcntl64(int file, int command, ...)
{
    ORIGINAL(fcntl64);
    va_list arguments;
    va_start(arguments, command);
    void *value = va_arg(arguments, void *);
    va_end(arguments);
    bool asks = command == F_GETFD || command == F_GETFL || command == F_GET_SEALS; /* these never fail */
    return !asks && fails(FAULT_fcntl64, __builtin_return_address(0)) ? -1 : real(file, command, value);
}

EXPORT int ioctl(int file, unsigned long request, ...)
{
    ORIGINAL(ioctl);
    va_list arguments;
    va_start(arguments, request);
    void *value = va_arg(arguments, void *);
    va_end(arguments);
    return fails(FAULT_ioctl, __builtin_return_address(0)) ? -1 : real(file, request, value);
}

EXPORT void *mremap(void *address, size_t old_size, size_t new_size, int flags, ...)
{
    ORIGINAL(mremap);
    va_list arguments;
    va_start(arguments, flags);
    void *to = flags & MREMAP_FIXED ? va_arg(arguments, void *) : NULL;
    va_end(arguments);
    return fails(FAULT_mremap, __builtin_return_address(0)) ? MAP_FAILED : real(address, old_size, new_size, flags, to);
}

/* ---- allocations: glibc's own names, since dlsym allocates ---- */

extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t count, size_t size);
extern void *__libc_realloc(void *block, size_t size);
extern void *__libc_memalign(size_t alignment, size_t size);

EXPORT void *malloc(size_t size)
{
    return fails(FAULT_allocation, __builtin_return_address(0)) ? NULL : __libc_malloc(size);
}

EXPORT void *calloc(size_t count, size_t size)
{
    return fails(FAULT_allocation, __builtin_return_address(0)) ? NULL : __libc_calloc(count, size);
}

EXPORT void *realloc(void *block, size_t size)
{
    return fails(FAULT_allocation, __builtin_return_address(0)) ? NULL : __libc_realloc(block, size);
}

EXPORT int posix_memalign(void **ret_block, size_t alignment, size_t size)
{
    if (fails(FAULT_allocation, __builtin_return_address(0)))
        return ENOMEM;
    void *block = __libc_memalign(alignment, size);
    if (!block)
        return ENOMEM;
    *ret_block = block;
    return 0;
}

/* ---- the time of day ---- */

static int64_t clock_offset(void)
{
    return plan ? plan->clock_offset_s : 0;
}

/*
 * Asks the kernel itself: AddressSanitizer's allocator reads the clock, also while dlsym, which ORIGINAL calls, frees
 * the text of its last error. A second dlsym would then free that text again.
 */
EXPORT int clock_gettime(clockid_t clock, struct timespec *time)
{
    int result = (int)syscall(SYS_clock_gettime, clock, time);
    if (result == 0 && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE))
        time->tv_sec += clock_offset();
    return result;
}

EXPORT time_t time(time_t *ret_time)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (ret_time)
        *ret_time = now.tv_sec;
    return now.tv_sec;
}
