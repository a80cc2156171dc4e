/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/mapping.h"

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <string.h>
#include <sys/mman.h>

#include "proto/base/bytes.h"

enum { HUGE_PAGE = 2 << 20, KEPT_MOST = 32 };

struct mapping {
    void *base;
    uint64_t length;
};

/* The cache belongs to the process, because cached blocks outlive every budget. */
static struct {
    pthread_mutex_t lock;
    uint64_t limit, bytes;
    unsigned count;
    struct mapping mappings[KEPT_MOST]; /* sorted by age, the longest unused first */
} kept = {.lock = PTHREAD_MUTEX_INITIALIZER};

/* Removes one entry from the cache. The caller holds the lock. */
static struct mapping take_out(unsigned index)
{
    struct mapping mapping = kept.mappings[index];
    kept.count--;
    kept.bytes -= mapping.length;
    memmove(&kept.mappings[index], &kept.mappings[index + 1], (kept.count - index) * sizeof mapping);
    return mapping;
}

/*
 * Takes the shortest cached mapping that is long enough and at most a quarter too long; `base` is NULL if there is
 * none.
 */
static struct mapping take_kept(uint64_t length)
{
    struct mapping mapping = {NULL, 0};
    pthread_mutex_lock(&kept.lock);
    unsigned best = kept.count;
    for (unsigned i = 0; i < kept.count; i++) {
        uint64_t own = kept.mappings[i].length;
        if (own >= length && own - length <= length / 4 && (best == kept.count || own < kept.mappings[best].length))
            best = i;
    }
    if (best < kept.count)
        mapping = take_out(best);
    pthread_mutex_unlock(&kept.lock);
    return mapping;
}

static void *map_aligned(uint64_t length)
{
    uint64_t padded;
    if (!bytes_add(length, HUGE_PAGE, &padded) || padded > PTRDIFF_MAX)
        return NULL;
    unsigned char *base = mmap(NULL, padded, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (base == MAP_FAILED)
        return NULL;
    uint64_t before = bytes_align((uintptr_t)base, HUGE_PAGE) - (uintptr_t)base;
    if (before)
        munmap(base, before);
    if (before < HUGE_PAGE)
        munmap(base + before + length, HUGE_PAGE - before);
    /* only advice: it does no harm if a kernel without huge pages refuses */
    madvise(base + before, length, MADV_HUGEPAGE);
    return base + before;
}

static void unmap_all(const struct mapping *mappings, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        munmap(mappings[i].base, mappings[i].length);
}

/* Unmaps the whole cache. Returns false if it was empty. */
static bool give_up_kept(void)
{
    struct mapping gone[KEPT_MOST];
    unsigned count = 0;
    pthread_mutex_lock(&kept.lock);
    while (kept.count > 0)
        gone[count++] = take_out(0);
    pthread_mutex_unlock(&kept.lock);
    unmap_all(gone, count);
    return count > 0;
}

/* Where address space is limited, cached mappings count against the limit: they must not make an allocation fail. */
static void *map_new(uint64_t length)
{
    void *base = map_aligned(length);
    return base || !give_up_kept() ? base : map_aligned(length);
}

void *mapping_obtain(uint64_t length, uint64_t *ret_length)
{
    struct mapping mapping = take_kept(length);
    if (!mapping.base)
        mapping = (struct mapping){map_new(length), length};
    if (mapping.base)
        *ret_length = mapping.length;
    return mapping.base;
}

/*
 * Makes room for `length` bytes in the cache, as far as possible, and returns the removed mappings. The caller holds
 * the lock.
 */
static unsigned make_room(uint64_t length, struct mapping ret_gone[KEPT_MOST])
{
    unsigned gone = 0;
    while (kept.count > 0 && (kept.count == KEPT_MOST || kept.bytes > kept.limit || length > kept.limit - kept.bytes))
        ret_gone[gone++] = take_out(0);
    return gone;
}

/* The pages are marked as free before the mapping enters the cache, from where another thread may take it. */
void mapping_release(void *mapping, uint64_t length)
{
    struct mapping gone[KEPT_MOST];
    unsigned count = 0;
    pthread_mutex_lock(&kept.lock);
    bool fits = length <= kept.limit;
    pthread_mutex_unlock(&kept.lock);
    if (!fits || madvise(mapping, length, MADV_FREE) != 0) {
        munmap(mapping, length);
        return;
    }
    pthread_mutex_lock(&kept.lock);
    count = make_room(length, gone);
    fits = length <= kept.limit;
    if (fits) {
        kept.mappings[kept.count++] = (struct mapping){mapping, length};
        kept.bytes += length;
    }
    pthread_mutex_unlock(&kept.lock);
    unmap_all(gone, count);
    if (!fits)
        munmap(mapping, length);
}

/* The new address is aligned again, so that huge pages move as a whole. */
void *mapping_resize(void *mapping, uint64_t old_length, uint64_t length)
{
    if (length < old_length)
        munmap((unsigned char *)mapping + length, old_length - length);
    if (length <= old_length)
        return mapping;
    void *place = map_new(length);
    if (!place)
        return NULL;
    if (mremap(mapping, old_length, length, MREMAP_MAYMOVE | MREMAP_FIXED, place) == MAP_FAILED) {
        munmap(place, length);
        return NULL;
    }
    return place;
}

void mapping_keep(uint64_t limit)
{
    struct mapping gone[KEPT_MOST];
    pthread_mutex_lock(&kept.lock);
    kept.limit = limit;
    unsigned count = make_room(0, gone);
    pthread_mutex_unlock(&kept.lock);
    unmap_all(gone, count);
}
