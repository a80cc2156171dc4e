/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/kernel/primitive_ref.h"

#include "builder/kernel/bins.h"

void primitive_ref_bounds(const struct primitive_ref *refs, uint32_t count, struct box *ret_bounds,
                          struct box *ret_centroids)
{
    struct vec4_box bounds, centroids;
    bins_bound(refs, count, &bounds, &centroids);
    *ret_bounds = vec4_box_get(bounds);
    *ret_centroids = vec4_box_get(centroids);
}
