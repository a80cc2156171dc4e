/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/handle_table.h"

#include <string.h>

#include "proto/base/parallel.h"

enum { DIGIT_BITS = 8, DIGITS = 1 << DIGIT_BITS };

static unsigned digit(uint64_t handle, unsigned shift)
{
    return handle >> shift & (DIGITS - 1);
}

/*
 * Moves the entries to `target` in the order of one digit. Returns false, and moves nothing, if the digit is the same
 * in all of them.
 */
static bool sort_by_digit(const struct handle_entry *source, struct handle_entry *target, uint32_t count,
                          unsigned shift)
{
    uint32_t starts[DIGITS] = {0};
    for (uint32_t i = 0; i < count; i++)
        starts[digit(source[i].handle, shift)]++;
    if (starts[digit(source[0].handle, shift)] == count)
        return false;

    uint32_t start = 0;
    for (unsigned i = 0; i < DIGITS; i++) {
        uint32_t size = starts[i];
        starts[i] = start;
        start += size;
    }
    for (uint32_t i = 0; i < count; i++)
        target[starts[digit(source[i].handle, shift)]++] = source[i];
    return true;
}

bool handle_sort_until(struct handle_entry *entries, struct handle_entry *scratch, uint32_t count,
                       const atomic_bool *cancel)
{
    struct handle_entry *from = entries, *to = scratch;
    for (unsigned shift = 0; count > 0 && shift < 64; shift += DIGIT_BITS) {
        if (parallel_cancelled(cancel))
            return false;
        if (!sort_by_digit(from, to, count, shift))
            continue;
        struct handle_entry *swap = from;
        from = to;
        to = swap;
    }
    if (from != entries)
        memcpy(entries, from, count * sizeof *entries);
    return true;
}

void handle_sort(struct handle_entry *entries, struct handle_entry *scratch, uint32_t count)
{
    handle_sort_until(entries, scratch, count, NULL);
}

/*
 * The search does not branch on the comparison: handles are as good as random, so branches would be mispredicted, and
 * without them successive searches overlap.
 */
uint32_t handle_find(const struct handle_entry *entries, uint32_t count, uint64_t handle)
{
    uint32_t first = 0, left = count;
    while (left > 1) {
        uint32_t half = left / 2, after = entries[first + half - 1].handle < handle;
        first += half & -after;
        left -= half;
    }
    return count > 0 && entries[first].handle == handle ? first : HANDLE_NONE;
}
