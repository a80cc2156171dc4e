/* SPDX-License-Identifier: Apache-2.0 */
/*
 * classification.h - what the kinds of geometries share to decide which primitives get a ref (primitive.h has the
 * rules), and to make it.
 */
#ifndef BVHD_CLASSIFICATION_H
#define BVHD_CLASSIFICATION_H

#include <float.h>
#include <math.h>

#include "builder/format/canonical.h"
#include "builder/kernel/primitive_ref.h"

/* The classification of one primitive, and its box. */
struct classification {
    bool active, degenerate, kept;
    struct box box; /* if kept */
};

/* Numbers of primitives that are not as usual: the fields of struct primitive_refs. */
struct classification_counts {
    uint64_t inactive, degenerate, skipped;
};

typedef struct classification (*classification_look)(const struct canonical *canonical,
                                                     const struct canonical_geometry *geometry, uint32_t index);

static inline float classification_clamp(float value)
{
    return value > FLT_MAX ? FLT_MAX : value < -FLT_MAX ? -FLT_MAX : value;
}

static inline bool classification_has_nan(const float *values, int count)
{
    for (int i = 0; i < count; i++)
        if (isnan(values[i]))
            return true;
    return false;
}

static inline bool classification_has_infinity(const float *values, int count)
{
    for (int i = 0; i < count; i++)
        if (isinf(values[i]))
            return true;
    return false;
}

/* Counts primitive `id`, and makes its ref if it is kept. Returns whether it is. */
static inline bool classification_keep(const struct classification *finding, uint32_t id,
                                       struct classification_counts *counts, struct primitive_ref *ref)
{
    counts->inactive += !finding->active;
    counts->degenerate += finding->degenerate;
    counts->skipped += finding->active && !finding->kept;
    if (!finding->kept)
        return false;
    memcpy(ref->min, finding->box.min, sizeof ref->min);
    memcpy(ref->max, finding->box.max, sizeof ref->max);
    ref->link = 0;
    ref->id = id;
    return true;
}

/*
 * Makes the refs of primitives [first, end) of a kind that looks at each of them, and returns how many are kept. It is
 * always inlined, so that the call of a `look` in the same file is no call through a pointer.
 */
__attribute__((always_inline)) static inline uint32_t classification_collect(
    classification_look look, const struct canonical *canonical, const struct canonical_geometry *geometry,
    uint32_t first, uint32_t end, struct classification_counts *counts, struct primitive_ref *refs)
{
    uint32_t kept = 0;
    for (uint32_t i = first; i < end; i++) {
        struct classification finding = look(canonical, geometry, i);
        kept += classification_keep(&finding, geometry->first_primitive + i, counts, &refs[kept]);
    }
    return kept;
}

#endif
