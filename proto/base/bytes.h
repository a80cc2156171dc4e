/* SPDX-License-Identifier: Apache-2.0 */
/*
 * bytes.h - checked arithmetic on sizes and offsets, and little-endian fields. Sizes that input influences are computed
 * with these functions.
 *
 * The checked operations return false on overflow and leave *ret untouched. Loads and stores work at any alignment.
 */
#ifndef BVHD_BYTES_H
#define BVHD_BYTES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

/*
 * A range of bytes that somebody else owns. `data` may be NULL only if `size` is 0, or to mean "not given" where a
 * header allows that.
 */
struct bytes {
    const unsigned char *data;
    uint64_t size;
};

static inline bool bytes_add(uint64_t a, uint64_t b, uint64_t *ret)
{
    return !__builtin_add_overflow(a, b, ret);
}

static inline bool bytes_mul(uint64_t a, uint64_t b, uint64_t *ret)
{
    return !__builtin_mul_overflow(a, b, ret);
}

/* Returns whether element `index` lies inside: offset + stride * index + size <= total, without overflow. */
static inline bool bytes_reach(uint64_t total, uint64_t offset, uint64_t stride, uint64_t index, uint64_t size)
{
    uint64_t at;
    return bytes_mul(stride, index, &at) && bytes_add(at, offset, &at) && bytes_add(at, size, &at) && at <= total;
}

/* Rounds up to a multiple of `alignment`, a power of two. The caller knows that the sum does not overflow. */
static inline uint64_t bytes_align(uint64_t value, uint64_t alignment)
{
    return (value + alignment - 1) & ~(alignment - 1);
}

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
               "bvhd's formats are little-endian and written by plain stores");

static inline uint16_t bytes_get16(const void *at)
{
    uint16_t value;
    memcpy(&value, at, sizeof value);
    return value;
}

static inline uint32_t bytes_get32(const void *at)
{
    uint32_t value;
    memcpy(&value, at, sizeof value);
    return value;
}

static inline uint64_t bytes_get64(const void *at)
{
    uint64_t value;
    memcpy(&value, at, sizeof value);
    return value;
}

static inline float bytes_get_float(const void *at)
{
    float value;
    memcpy(&value, at, sizeof value);
    return value;
}

static inline void bytes_put32(void *at, uint32_t value)
{
    memcpy(at, &value, sizeof value);
}

static inline void bytes_put64(void *at, uint64_t value)
{
    memcpy(at, &value, sizeof value);
}

#endif
