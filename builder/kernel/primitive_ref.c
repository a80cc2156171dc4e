/* SPDX-License-Identifier: Apache-2.0 */
#include "builder/kernel/primitive_ref.h"

#include "builder/kernel/vec4.h"

void primitive_ref_bounds(const struct primitive_ref *refs, uint32_t count, struct box *ret_bounds,
                          struct box *ret_centroids)
{
    struct vec4_box bounds = vec4_box_empty(), centroids = vec4_box_empty();
    for (uint32_t i = 0; i < count; i++) {
        struct vec4_box box = vec4_box_load(&refs[i]);
        vec4 centroid = box.min + box.max;
        vec4_box_grow(&bounds, box.min, box.max);
        vec4_box_grow(&centroids, centroid, centroid);
    }
    *ret_bounds = vec4_box_get(bounds);
    *ret_centroids = vec4_box_get(centroids);
}
