/* SPDX-License-Identifier: Apache-2.0 */
/* test_memfd.h - memfds with known bytes, sealed or not. Include it after unit.h; for test programs only. */
#ifndef BVHD_TEST_MEMFD_H
#define BVHD_TEST_MEMFD_H

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

/* Byte `at` of every file. */
static inline unsigned char test_memfd_byte(uint64_t at)
{
    return (unsigned char)(at * 2654435761u >> 13);
}

static inline void test_memfd_write(int descriptor, uint64_t begin, uint64_t end)
{
    unsigned char block[4096];
    while (begin < end) {
        uint64_t count = end - begin < sizeof block ? end - begin : sizeof block;
        for (uint64_t i = 0; i < count; i++)
            block[i] = test_memfd_byte(begin + i);
        assert_int_equal(pwrite(descriptor, block, count, (off_t)begin), count);
        begin += count;
    }
}

static inline int test_memfd_empty(uint64_t size)
{
    int descriptor = memfd_create("test", MFD_CLOEXEC | MFD_ALLOW_SEALING);
    assert_true(descriptor >= 0);
    assert_int_equal(ftruncate(descriptor, (off_t)size), 0);
    return descriptor;
}

static inline void test_memfd_seal(int descriptor, int seals)
{
    assert_int_equal(fcntl(descriptor, F_ADD_SEALS, seals), 0);
}

static inline int test_memfd_sealed(uint64_t size, int seals)
{
    int descriptor = test_memfd_empty(size);
    test_memfd_write(descriptor, 0, size);
    test_memfd_seal(descriptor, seals);
    return descriptor;
}

static inline int test_memfd_reopen(int descriptor, int flags)
{
    char path[40];
    snprintf(path, sizeof path, "/proc/self/fd/%d", descriptor);
    int again = open(path, flags | O_CLOEXEC);
    assert_true(again >= 0);
    return again;
}

#endif
