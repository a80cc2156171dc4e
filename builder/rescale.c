/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/rescale.h"

#include <math.h>

enum { CHUNK = 16384 };

static float magnitude(const struct box *bounds)
{
    float largest = 0;
    for (int axis = 0; axis < 3; axis++) {
        largest = fmaxf(largest, fabsf(bounds->min[axis]));
        largest = fmaxf(largest, fabsf(bounds->max[axis]));
    }
    return largest;
}

bool rescale_is_needed(const struct box *bounds)
{
    float largest = magnitude(bounds);
    return !box_is_empty(bounds) && largest != 0 && (largest < 0x1p-20f || largest > 0x1p40f);
}

struct scaling {
    struct primitive_ref *refs;
    uint32_t count;
    double factor;
};

static void scale_chunk(void *context, size_t index)
{
    const struct scaling *scaling = context;
    size_t begin, end;
    parallel_chunk(index, CHUNK, scaling->count, &begin, &end);
    for (size_t i = begin; i < end; i++)
        for (int axis = 0; axis < 3; axis++) {
            scaling->refs[i].min[axis] = (float)(scaling->refs[i].min[axis] * scaling->factor);
            scaling->refs[i].max[axis] = (float)(scaling->refs[i].max[axis] * scaling->factor);
        }
}

/* Recomputes refs->bounds and refs->centroids, chunk by chunk so that a cancellation is noticed. */
static bool bound_all(struct primitive_refs *refs, const atomic_bool *cancel)
{
    refs->bounds = refs->centroids = box_empty();
    for (size_t begin = 0; begin < refs->count; begin += CHUNK) {
        struct box bounds, centroids;
        uint32_t count = refs->count - begin < CHUNK ? (uint32_t)(refs->count - begin) : CHUNK;
        if (parallel_cancelled(cancel))
            return false;
        primitive_ref_bounds(refs->refs + begin, count, &bounds, &centroids);
        box_grow(&refs->bounds, &bounds);
        box_grow(&refs->centroids, &centroids);
    }
    return true;
}

bool rescale_refs(struct primitive_refs *refs, const struct build_context *context)
{
    struct scaling scaling = {refs->refs, refs->count, ldexp(1, -ilogbf(magnitude(&refs->bounds)))};
    size_t chunks = parallel_chunks(CHUNK, refs->count);
    return parallel_for_until(context->parallel, context->cancel, chunks, scale_chunk, &scaling) &&
           bound_all(refs, context->cancel);
}
