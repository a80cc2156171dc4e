/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/input/outline.h"

#include <math.h>

#include "builder/input/input_kind.h"
#include "builder/input/numbering.h"
#include "builder/input/reach.h"
#include "proto/base/round_outward.h"

/*
 * The work is divided into at most MOST_SHARES shares, so that their results need no allocation; how it is divided does
 * not depend on the threads. LOOK elements are added between two checks of the cancel flag.
 */
enum { MOST_SHARES = 64, LEAST_SHARE = 4096, LOOK = 8192 };

struct extent_search {
    const struct canonical *canonical;
    enum form_section section; /* elements are vertices or primitives, numbered through over all geometries */
    size_t count;
    const atomic_bool *cancel;
    struct reach shares[MOST_SHARES];
    size_t share_size;
};

/* Where the elements of one share are added. */
struct share {
    const struct canonical *canonical;
    struct reach reach;
};

static void add_elements(void *context, uint32_t index, uint32_t first, uint32_t count)
{
    struct share *share = context;
    const struct canonical_geometry *geometry = &share->canonical->geometries[index];
    input_kind_of(geometry->type)->outline(geometry, first, count, &share->reach);
}

static void find_share(void *context, size_t index)
{
    struct extent_search *finding = context;
    struct share share = {finding->canonical, reach_empty()};
    size_t begin, end;
    parallel_chunk(index, finding->share_size, finding->count, &begin, &end);
    for (; begin < end && !parallel_cancelled(finding->cancel); begin += LOOK)
        numbering_for_each(finding->canonical, finding->section, begin, end - begin < LOOK ? end : begin + LOOK,
                           add_elements, &share);
    finding->shares[index] = share.reach;
}

/* Chooses the elements by the kind of the geometries: all geometries of a structure are of one kind. */
static void choose_elements(struct extent_search *finding)
{
    const struct canonical *canonical = finding->canonical;
    const struct input_kind *kind = canonical->geometry_count > 0 ? input_kind_of(canonical->geometries[0].type) : NULL;
    if (!kind || !kind->outline)
        return;
    finding->section = kind->corners > 0 ? FORM_POSITIONS : FORM_PRIMITIVES;
    finding->count = kind->corners > 0 ? canonical->vertex_count : canonical->primitive_count;
}

bool outline_find(const struct canonical *canonical, const struct build_context *context, struct slabs *ret_slabs)
{
    struct extent_search finding = {.canonical = canonical, .cancel = context->cancel};
    struct reach reach = reach_empty();
    choose_elements(&finding);
    finding.share_size = finding.count / MOST_SHARES + 1;
    finding.share_size = finding.share_size < LEAST_SHARE ? LEAST_SHARE : finding.share_size;
    size_t shares = parallel_chunks(finding.share_size, finding.count);
    if (!parallel_for_until(context->parallel, context->cancel, shares, find_share, &finding) ||
        parallel_cancelled(context->cancel))
        return false;
    for (size_t i = 0; i < shares; i++)
        reach_join(&reach, &finding.shares[i]);
    *ret_slabs = reach_slabs(&reach);
    return true;
}

/* ---- The box of an instance ---- */

/* A direction: the sum of one to three axes, some of them negated. */
struct direction {
    int sign[3]; /* -1, 0, 1 */
};

/*
 * Returns the slab of a direction of two or three axes; *ret_is_opposite says whether the slab is along the negated
 * direction.
 */
static int slab_of(const struct direction *direction, bool *ret_is_opposite)
{
    const int *sign = direction->sign;
    for (int axis = 0; axis < 3; axis++) {
        int next = (axis + 1) % 3, last = (axis + 2) % 3;
        if (sign[last] == 0) {
            *ret_is_opposite = sign[axis] < 0;
            return sign[axis] == sign[next] ? REACH_SUMS + axis : REACH_DIFFERENCES + axis;
        }
    }
    for (int axis = 0; axis < 3; axis++) {
        int next = (axis + 1) % 3, last = (axis + 2) % 3;
        if (sign[axis] == sign[next] && sign[last] != sign[axis]) {
            *ret_is_opposite = sign[axis] < 0;
            return REACH_CORNERS + axis;
        }
    }
    *ret_is_opposite = sign[0] < 0;
    return REACH_CORNERS + 3;
}

/* Returns how far the structure reaches in a direction of `axes` axes. */
static double reach_along(const struct direction *direction, int axes, int first, const struct box *bounds,
                          const struct slabs *slabs)
{
    bool is_opposite = direction->sign[first] < 0;
    if (axes == 1)
        return is_opposite ? -(double)bounds->min[first] : bounds->max[first];
    int slab = slab_of(direction, &is_opposite);
    return is_opposite ? -(double)slabs->min[slab] : slabs->max[slab];
}

/* Sorts the axes by the size of their components, largest first. */
static void sort_axes(const double size[3], int ret_axes[3])
{
    int a = size[0] >= size[1] ? 0 : 1, b = 1 - a;
    ret_axes[0] = size[2] > size[a] ? 2 : a;
    ret_axes[1] = size[2] > size[a] ? a : size[2] > size[b] ? 2 : b;
    ret_axes[2] = 3 - ret_axes[0] - ret_axes[1];
}

/*
 * Returns an upper bound, a little above the exact value, of how far any point of the structure lies along `row` times
 * `sign`. With components a >= b >= c >= 0, the row is (a - b) times one axis, plus (b - c) times the sum of two, plus
 * c times the sum of all three; the reach along a sum is at most the sum of the reaches.
 */
static double reach_of(const float row[3], int sign, const struct box *bounds, const struct slabs *slabs)
{
    struct direction direction = {{0, 0, 0}};
    double size[3], reach = 0, magnitude = 0;
    int axes[3];
    for (int axis = 0; axis < 3; axis++)
        size[axis] = fabs((double)row[axis]);
    sort_axes(size, axes);
    for (int k = 0; k < 3; k++) {
        direction.sign[axes[k]] = row[axes[k]] < 0 ? -sign : sign;
        double along = reach_along(&direction, k + 1, axes[0], bounds, slabs);
        reach += (k < 2 ? size[axes[k]] - size[axes[k + 1]] : size[axes[k]]) * along;
        magnitude += size[axes[0]] * fabs(along);
    }
    return reach + magnitude * 0x1p-48;
}

void outline_narrow(const float matrix[12], const struct box *bounds, const struct slabs *slabs, struct box *box)
{
    if (!slabs_are_known(slabs))
        return;
    for (int axis = 0; axis < 3; axis++) {
        const float *row = matrix + 4 * axis;
        double slack = fabs((double)row[3]) * 0x1p-48;
        float low = round_down(row[3] - reach_of(row, -1, bounds, slabs) - slack) + 0.0f;
        float high = round_up(row[3] + reach_of(row, 1, bounds, slabs) + slack) + 0.0f;
        low = low > box->min[axis] ? low : box->min[axis];
        high = high < box->max[axis] ? high : box->max[axis];
        if (low > high)
            continue;
        box->min[axis] = low;
        box->max[axis] = high;
    }
}
