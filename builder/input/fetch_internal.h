/* SPDX-License-Identifier: Apache-2.0 */
/* fetch_internal.h - what the kinds of geometries share to read the caller's memory. */
#ifndef BVHD_FETCH_INTERNAL_H
#define BVHD_FETCH_INTERNAL_H

#include "builder/input/canonical_form.h"
#include "builder/input/fetch.h"

/* The facts about one geometry that are found while it is read. */
struct fetch_source {
    _Atomic uint32_t lowest, highest; /* indices in use, as in the request */
    bool transformed; /* by a matrix other than the identity */
    float matrix[12];
    uint32_t *scratch; /* as many words as the kind asked for (input_kind.h) */
    atomic_bool gathers; /* swept_spheres.c copies the vertices of pairs */
    _Atomic uint64_t index_sum; /* of these pairs */
};

/* The least and the greatest of some indices. */
struct fetch_span {
    uint32_t lowest, highest;
};

/* Returns the row of a geometry in the block that is being filled. */
static inline struct form_geometry *fetch_row(const struct fetch *fetch, uint32_t geometry)
{
    return (struct form_geometry *)(void *)(fetch->block + sizeof(struct form_header)) + geometry;
}

/*
 * Keeps the compiler from reading the caller's memory again instead of what was stored: the bytes that are checked must
 * be the stored ones.
 */
static inline void fetch_settle(void)
{
    atomic_signal_fence(memory_order_seq_cst);
}

/* Raise a number to `value` if it is lower, or lower it if it is higher; any threads may do so at once. */
static inline void fetch_raise(_Atomic uint32_t *highest, uint32_t value)
{
    uint32_t old = atomic_load_explicit(highest, memory_order_relaxed);
    while (old < value &&
           !atomic_compare_exchange_weak_explicit(highest, &old, value, memory_order_relaxed, memory_order_relaxed))
        ;
}

static inline void fetch_lower(_Atomic uint32_t *lowest, uint32_t value)
{
    uint32_t old = atomic_load_explicit(lowest, memory_order_relaxed);
    while (old > value &&
           !atomic_compare_exchange_weak_explicit(lowest, &old, value, memory_order_relaxed, memory_order_relaxed))
        ;
}

static inline void fetch_span_grow(const uint32_t *indices, size_t count, struct fetch_span *span)
{
    uint32_t lowest = span->lowest, highest = span->highest;
    for (size_t i = 0; i < count; i++) {
        lowest = indices[i] < lowest ? indices[i] : lowest;
        highest = indices[i] > highest ? indices[i] : highest;
    }
    *span = (struct fetch_span){lowest, highest};
}

/* Adds the indices that a thread has read to those of the geometry. */
static inline void fetch_span_note(const struct fetch_span *span, struct fetch_source *source)
{
    fetch_lower(&source->lowest, span->lowest);
    fetch_raise(&source->highest, span->highest);
}

/* Notes that some content breaks a rule. */
static inline void fetch_suspect(struct fetch *fetch)
{
    atomic_store_explicit(&fetch->suspect, true, memory_order_relaxed);
}

#endif
