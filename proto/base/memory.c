/* SPDX-License-Identifier: Apache-2.0 */
#include "proto/base/memory.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

#include "proto/base/bytes.h"
#include "proto/base/mapping.h"
#include "proto/base/status.h"

/*
 * The header in front of each block. Large blocks are mappings that start on a huge page; all others come from malloc's
 * heap. The header takes as many bytes as the alignment that it must preserve.
 */
struct header {
    uint64_t size; /* as requested */
    uint64_t mapped; /* length of the mapping; 0 for a block of the heap */
};

enum { ALIGNMENT = 64, PAGE = 4096, MAPPED_FROM = 4 << 20 };

/* Bytes that memory_keep lets the process keep: in each of malloc's heaps, and in unused mappings. */
enum { KEPT_HEAP_LEAST = 128 << 10, KEPT_HEAP = 32 << 20, KEPT_MAPPINGS = 256 << 20 };

_Static_assert(sizeof(struct header) <= ALIGNMENT, "the header fits in front of the block");

/* The address sanitizer tracks only blocks from malloc. */
#if defined(__SANITIZE_ADDRESS__)
enum { USE_MAPPINGS = 0 };
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
enum { USE_MAPPINGS = 0 };
#else
enum { USE_MAPPINGS = 1 };
#endif
#else
enum { USE_MAPPINGS = 1 };
#endif

void memory_keep(void)
{
    mapping_keep(KEPT_MAPPINGS);
#ifdef __GLIBC__
    mallopt(M_MMAP_THRESHOLD, 2 * MAPPED_FROM);
    mallopt(M_TRIM_THRESHOLD, KEPT_HEAP);
#endif
}

void memory_keep_heap(uint64_t most)
{
    uint64_t least = most < KEPT_HEAP_LEAST ? KEPT_HEAP_LEAST : most;
#ifdef __GLIBC__
    mallopt(M_TRIM_THRESHOLD, (int)(least < KEPT_HEAP ? least : KEPT_HEAP));
#endif
    (void)least;
}

void memory_init(struct memory *memory, uint64_t limit)
{
    memory->parent = NULL;
    memory->limit = limit;
    atomic_init(&memory->live, 0);
    atomic_init(&memory->peak, 0);
    atomic_init(&memory->fail_after, -1);
    atomic_init(&memory->refused, 0);
    atomic_init(&memory->refused_limit, 0);
}

void memory_init_within(struct memory *memory, struct memory *parent, uint64_t limit)
{
    memory_init(memory, limit);
    memory->parent = parent;
}

static bool fails_now(struct memory *memory)
{
    int64_t left = atomic_load_explicit(&memory->fail_after, memory_order_relaxed);
    while (left >= 0)
        if (atomic_compare_exchange_weak_explicit(&memory->fail_after, &left, left - 1, memory_order_relaxed,
                                                  memory_order_relaxed))
            return left == 0;
    return false;
}

static bool injected_failure(struct memory *memory)
{
    for (; memory; memory = memory->parent)
        if (fails_now(memory))
            return true;
    return false;
}

static void raise_peak(struct memory *memory, uint64_t live)
{
    uint64_t peak = atomic_load_explicit(&memory->peak, memory_order_relaxed);
    while (peak < live && !atomic_compare_exchange_weak_explicit(&memory->peak, &peak, live, memory_order_relaxed,
                                                                 memory_order_relaxed))
        ;
}

static void release_one(struct memory *memory, uint64_t size)
{
    uint64_t before = atomic_fetch_sub_explicit(&memory->live, size, memory_order_relaxed);
    assert(before >= size);
    (void)before;
}

static void note_refusal(struct memory *memory, uint64_t needed, uint64_t limit)
{
    atomic_store_explicit(&memory->refused, needed, memory_order_relaxed);
    atomic_store_explicit(&memory->refused_limit, limit, memory_order_relaxed);
}

/* The machine has refused what the budgets allow. */
static void note_shortage(struct memory *memory, uint64_t size)
{
    note_refusal(memory, atomic_load_explicit(&memory->live, memory_order_relaxed) + size, UINT64_MAX);
}

/* Takes `size` bytes off this budget and its parents. A refused allocation does not raise any peak. */
static bool reserve(struct memory *memory, uint64_t size)
{
    uint64_t live = atomic_load_explicit(&memory->live, memory_order_relaxed), sum;
    do {
        if (!bytes_add(live, size, &sum) || sum > memory->limit) {
            note_refusal(memory, bytes_add(live, size, &sum) ? sum : UINT64_MAX, memory->limit);
            return false;
        }
    } while (
        !atomic_compare_exchange_weak_explicit(&memory->live, &live, sum, memory_order_relaxed, memory_order_relaxed));
    if (memory->parent && !reserve(memory->parent, size)) {
        release_one(memory, size);
        note_refusal(memory, atomic_load_explicit(&memory->parent->refused, memory_order_relaxed),
                     atomic_load_explicit(&memory->parent->refused_limit, memory_order_relaxed));
        return false;
    }
    raise_peak(memory, sum);
    return true;
}

static void release(struct memory *memory, uint64_t size)
{
    for (; memory; memory = memory->parent)
        release_one(memory, size);
}

bool memory_reserve(struct memory *memory, uint64_t size)
{
    return !injected_failure(memory) && reserve(memory, size);
}

void memory_release(struct memory *memory, uint64_t size)
{
    release(memory, size);
}

static struct header *header_of(void *block)
{
    return (struct header *)(void *)((unsigned char *)block - ALIGNMENT);
}

/*
 * Returns the length of the mapping for a block of `size` bytes; 0 if the block comes from the heap or is too large to
 * exist.
 */
static uint64_t mapping_length(uint64_t size)
{
    uint64_t length;
    if (!USE_MAPPINGS || size < MAPPED_FROM || !bytes_add(size, ALIGNMENT + PAGE, &length))
        return 0;
    return bytes_align(size + ALIGNMENT, PAGE);
}

static struct header *obtain(uint64_t size)
{
    uint64_t mapped = mapping_length(size), total;
    void *base = NULL;
    if (mapped) {
        base = mapping_obtain(mapped, &mapped);
    } else if (bytes_add(size, ALIGNMENT, &total) && total <= PTRDIFF_MAX) {
        if (posix_memalign(&base, ALIGNMENT, total) != 0)
            base = NULL;
    }
    struct header *header = base;
    if (header)
        *header = (struct header){.size = size, .mapped = mapped};
    return header;
}

void *memory_alloc(struct memory *memory, uint64_t size)
{
    if (size == 0 || injected_failure(memory) || !reserve(memory, size))
        return NULL;
    struct header *header = obtain(size);
    if (!header) {
        release(memory, size);
        note_shortage(memory, size);
        return NULL;
    }
    return (unsigned char *)header + ALIGNMENT;
}

void *memory_array(struct memory *memory, uint64_t count, uint64_t size)
{
    uint64_t total;
    return bytes_mul(count, size, &total) ? memory_alloc(memory, total) : NULL;
}

static struct header *remap(struct header *header, uint64_t size)
{
    uint64_t length = mapping_length(size);
    struct header *moved = mapping_resize(header, header->mapped, length);
    if (moved)
        *moved = (struct header){.size = size, .mapped = length};
    return moved;
}

static void *resize_mapped(struct memory *memory, struct header *header, uint64_t size)
{
    uint64_t old_size = header->size;
    if (injected_failure(memory) || (size > old_size && !reserve(memory, size - old_size)))
        return NULL;
    struct header *moved = remap(header, size);
    if (!moved) {
        release(memory, size > old_size ? size - old_size : 0);
        note_shortage(memory, size - old_size);
        return NULL;
    }
    if (size < old_size)
        release(memory, old_size - size);
    return (unsigned char *)moved + ALIGNMENT;
}

void *memory_resize(struct memory *memory, void *block, uint64_t size)
{
    if (!block)
        return memory_alloc(memory, size);
    struct header *header = header_of(block);
    if (header->mapped && mapping_length(size))
        return resize_mapped(memory, header, size);
    void *moved = memory_alloc(memory, size);
    if (!moved)
        return NULL;
    memcpy(moved, block, header->size < size ? header->size : size);
    memory_free(memory, block);
    return moved;
}

void memory_hand_up(struct memory *memory, void *block)
{
    assert(memory->parent);
    if (block)
        release_one(memory, header_of(block)->size);
}

void memory_free(struct memory *memory, void *block)
{
    if (!block)
        return;
    struct header *header = header_of(block);
    release(memory, header->size);
    if (header->mapped)
        mapping_release(header, header->mapped);
    else
        free(header);
}

static void format_bytes(uint64_t bytes, char ret_text[24])
{
    static const char *const units[] = {"bytes", "KiB", "MiB", "GiB", "TiB"};
    double value = (double)bytes;
    int unit = 0;
    for (; value >= 1024 && unit < 4; unit++)
        value /= 1024;
    snprintf(ret_text, 24, unit ? "%.1f %s" : "%.0f %s", value, units[unit]);
}

void memory_explain(const struct memory *memory, struct bvhd_error *error)
{
    static const char words[] = "needs at least";
    uint64_t refused = atomic_load_explicit(&memory->refused, memory_order_relaxed);
    uint64_t limit = atomic_load_explicit(&memory->refused_limit, memory_order_relaxed);
    if (!error || error->status != BVHD_NO_MEMORY || refused == 0 || strstr(error->text, words))
        return;
    char needed[24], allowed[24];
    size_t used = strlen(error->text);
    format_bytes(refused, needed);
    format_bytes(limit, allowed);
    if (limit == UINT64_MAX)
        snprintf(error->text + used, sizeof error->text - used, "%sit %s %s, more than the machine has",
                 used ? "; " : "", words, needed);
    else
        snprintf(error->text + used, sizeof error->text - used, "%sit %s %s, and the limit is %s", used ? "; " : "",
                 words, needed, allowed);
}
